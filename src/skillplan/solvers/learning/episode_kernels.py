"""Kernels of tabular control: TD(0) updates of SARSA and Q-learning, and first-visit Monte Carlo.

Sutton and Barto, "Reinforcement Learning: An Introduction" (2018), sections 5.3, 6.4 and 6.5;
Veeramani and Muthuswamy, Table 2. A kernel returns when it takes an action for the first time: the
caller samples the environment, and the next call resumes the episode. Random numbers come from the
kernels' own generator, so that a seed gives the same result with every version of every library.
All kernels are in one file because numba does not notice changes in functions of other files.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.kernels import compiled

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Stream = NDArray[np.uint64]

# The target of a temporal difference: the update rule of `td_episodes`.
SARSA, EXPECTED_SARSA, Q_LEARNING = 0, 1, 2
UNTRIED = -1
"""Outcome of a row that has not been taken yet."""
# Entries of `Progress.cursor`.
EPISODE, STATE, ROW, STEPS, GREEDY, CHEAPEST_STEPS, FAILED, COMPLETED, CUT = range(9)
# How an episode ends in a state: by `Tables.ends`.
GOES_ON, COMPLETE, FAILURE = 0, 1, 2

# SplitMix64: Steele, Lea and Flood, "Fast splittable pseudorandom number generators" (2014).
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_S11, _S27, _S30, _S31, _S32 = (np.uint64(shift) for shift in (11, 27, 30, 31, 32))


class Tables(NamedTuple):
    """The states, rows and outcomes met so far; arrays may be longer than what is known.

    A row is a state and an action that the mask allows there. Rows are grouped by state.

    Parameters
    ----------
    rows
        Rows of state i are ``rows[i]`` to ``rows[i + 1]``.
    ends, final
        Kind of end of an episode in a state, and the value of an end.
    best
        Row of the largest value by state; of equals, the lowest.
    starts
        States in which an episode may begin; the task's start comes first.
    counts
        Number of states, and of starts.
    owners, q, seen
        State of every row; its value; scratch, the step at which it was first taken in an episode,
        or -1.
    outcomes, last_outcomes, costs
        First outcome of every row, or `UNTRIED`; last outcome; cost.
    successors, probabilities, rewards
        State, probability and reward of every outcome.
    """

    rows: Integers
    ends: Integers
    final: Floats
    best: Integers
    starts: Integers
    counts: Integers
    owners: Integers
    q: Floats
    seen: Integers
    outcomes: Integers
    last_outcomes: Integers
    costs: Floats
    successors: Integers
    probabilities: Floats
    rewards: Floats


class Progress(NamedTuple):
    """The episode in progress, and totals of all episodes.

    Parameters
    ----------
    stream
        State of the random generator, shape (1,).
    cursor
        Episode of this call, state, row or -1 between episodes, steps, 1 if all its actions were
        greedy and it began at the task's start; steps of the cheapest such episode that completed,
        0 without one; numbers of episodes that failed, completed or were cut off.
    spent
        Cost of the episode, and of the cheapest greedy one.
    taken, received, cheapest
        Rows and rewards of the episode, rows of the cheapest greedy one, shape (max_steps,).
    """

    stream: Stream
    cursor: Integers
    spent: Floats
    taken: Integers
    received: Floats
    cheapest: Integers


class Schedule(NamedTuple):
    """Step size, exploration and length of episodes; rates change linearly by episode.

    Parameters
    ----------
    alpha, alpha_change
        Step size of episode 0, and its change from one episode to the next.
    epsilon, epsilon_change
        Probability of a random action in episode 0, and its change.
    gamma
        Discount factor.
    max_steps
        Steps after which an episode is cut off.
    """

    alpha: float
    alpha_change: float
    epsilon: float
    epsilon_change: float
    gamma: float
    max_steps: int


@compiled
def random_bits(stream: Stream) -> np.uint64:
    """Return the next 64 random bits."""
    stream[0] += _GOLDEN
    mixed = stream[0]
    mixed = (mixed ^ (mixed >> _S30)) * _MIX_1
    mixed = (mixed ^ (mixed >> _S27)) * _MIX_2
    return np.uint64(mixed ^ (mixed >> _S31))


@compiled
def _uniform(stream: Stream) -> float:
    """Return a random number in [0, 1)."""
    return np.float64(random_bits(stream) >> _S11) * 2.0**-53


@compiled
def _below(stream: Stream, count: int) -> np.int64:
    """Return a random integer in [0, count), count < 2 ** 32."""
    return np.int64(((random_bits(stream) >> _S32) * np.uint64(count)) >> _S32)


@compiled
def _greedy(q: Floats, first: int, end: int) -> int:
    """Return the row of the largest value; of equals, the lowest."""
    best, most = first, q[first]
    for row in range(first + 1, end):
        value = q[row]
        better = value > most
        most = value if better else most
        best = row if better else best
    return best


@compiled
def _explore(rows: Integers, state: int, best: int, epsilon: float, stream: Stream) -> int:
    """Return the best row of a state or, with probability epsilon, any of its rows."""
    if _uniform(stream) < epsilon:
        first = rows[state]
        return int(first + _below(stream, rows[state + 1] - first))
    return best


@compiled
def _draw(outcome: int, last: int, probabilities: Floats, stream: Stream) -> int:
    """Return an outcome between a row's first and last one, drawn only if there are several."""
    if outcome < last:
        left = _uniform(stream) - probabilities[outcome]
        while left >= 0.0 and outcome < last:
            outcome += 1
            left -= probabilities[outcome]
    return int(outcome)


@compiled
def td_episodes(
    tables: Tables,
    schedule: Schedule,
    rule: int,
    previous: int,
    progress: Progress,
    lengths: Integers,
) -> int:
    """Run episodes with a TD(0) update after every step, until an untried row is taken.

    Parameters
    ----------
    tables
        The tables; values and best rows change.
    schedule
        A `Schedule`.
    rule
        `SARSA`, `EXPECTED_SARSA` or `Q_LEARNING`.
    previous
        Episodes run before those of `lengths`.
    progress
        The episode in progress; changed.
    lengths
        Filled with the steps of every episode.

    Returns
    -------
    int
        The untried row; -1 if all episodes of `lengths` have ended.
    """
    # Unpacked here: passing tuples on makes numba count references, four times as slow.
    rows, ends, final, best, starts, counts, _, q, _, outcomes = tables[:10]
    last_outcomes, costs, successors, probabilities, rewards = tables[10:]
    stream, cursor, spent, taken, _, cheapest = progress
    gamma, max_steps = schedule.gamma, schedule.max_steps
    n_starts, first_start = counts[1], starts[0]
    state, row, steps = cursor[STATE], cursor[ROW], cursor[STEPS]
    greedy, cost = cursor[GREEDY] == 1, spent[0]
    for episode in range(cursor[EPISODE], len(lengths)):
        alpha = schedule.alpha + schedule.alpha_change * (previous + episode)
        epsilon = schedule.epsilon + schedule.epsilon_change * (previous + episode)
        if row < 0:
            state = starts[_below(stream, n_starts)]
            row = _explore(rows, state, best[state], epsilon, stream)
            steps, cost = 0, 0.0
            greedy = state == first_start and row == best[state]
        end = GOES_ON
        while steps < max_steps:
            outcome = outcomes[row]
            if outcome == UNTRIED:
                cursor[EPISODE], cursor[STATE], cursor[ROW] = episode, state, row
                cursor[STEPS], cursor[GREEDY], spent[0] = steps, 1 if greedy else 0, cost
                return int(row)
            outcome = _draw(outcome, last_outcomes[row], probabilities, stream)
            following = successors[outcome]
            last, before = row, q[row]
            taken[steps] = last
            cost += costs[last]
            steps += 1
            end = ends[following]
            if end != GOES_ON:
                ahead = final[following]
            else:
                row = _explore(rows, following, best[following], epsilon, stream)
                greedy = greedy and row == best[following]
                if rule == SARSA:
                    ahead = q[row]
                elif rule == Q_LEARNING:
                    ahead = q[best[following]]
                else:
                    mean = q[rows[following] : rows[following + 1]].mean()
                    ahead = (1.0 - epsilon) * q[best[following]] + epsilon * mean
            value = before + alpha * (rewards[outcome] + gamma * ahead - before)
            q[last] = value
            # Most updates do not change the best row, so that it need not be searched for.
            if last == best[state]:
                if value < before:
                    best[state] = _greedy(q, rows[state], rows[state + 1])
            else:
                most = q[best[state]]
                if value > most or (value == most and last < best[state]):
                    best[state] = last
            if end != GOES_ON:
                break
            state = following
        lengths[episode] = steps
        cursor[CUT - end] += 1
        if end == COMPLETE and greedy and (cursor[CHEAPEST_STEPS] == 0 or cost < spent[1]):
            cursor[CHEAPEST_STEPS], spent[1] = steps, cost
            cheapest[:steps] = taken[:steps]
        row = -1
    cursor[EPISODE], cursor[ROW] = len(lengths), -1
    return UNTRIED


@compiled
def monte_carlo_episodes(
    tables: Tables,
    schedule: Schedule,
    exploring: bool,
    previous: int,
    progress: Progress,
    lengths: Integers,
) -> int:
    """Run episodes of first-visit Monte Carlo control, until an untried row is taken.

    After an episode, values move towards the return that followed the first visit of each row. The
    return of an episode that was cut off continues with the value of the state it had reached.

    Parameters
    ----------
    exploring
        True if an episode begins with a random row of its first state.
    tables, schedule, previous, progress, lengths
        As in `td_episodes`.

    Returns
    -------
    int
        The untried row; -1 if all episodes of `lengths` have ended.
    """
    rows, ends, final, best, starts, counts, owners, q, seen, outcomes = tables[:10]
    last_outcomes, costs, successors, probabilities, rewards = tables[10:]
    stream, cursor, spent, taken, received, cheapest = progress
    gamma, max_steps = schedule.gamma, schedule.max_steps
    n_starts, first_start = counts[1], starts[0]
    state, row, steps = cursor[STATE], cursor[ROW], cursor[STEPS]
    greedy, cost = cursor[GREEDY] == 1, spent[0]
    for episode in range(cursor[EPISODE], len(lengths)):
        alpha = schedule.alpha + schedule.alpha_change * (previous + episode)
        epsilon = schedule.epsilon + schedule.epsilon_change * (previous + episode)
        if row < 0:
            state = starts[_below(stream, n_starts)]
            if exploring:
                row = rows[state] + _below(stream, rows[state + 1] - rows[state])
            else:
                row = _explore(rows, state, best[state], epsilon, stream)
            steps, cost = 0, 0.0
            greedy = state == first_start and row == best[state]
        end = GOES_ON
        while True:
            outcome = outcomes[row]
            if outcome == UNTRIED:
                cursor[EPISODE], cursor[STATE], cursor[ROW] = episode, state, row
                cursor[STEPS], cursor[GREEDY], spent[0] = steps, 1 if greedy else 0, cost
                return int(row)
            outcome = _draw(outcome, last_outcomes[row], probabilities, stream)
            taken[steps], received[steps] = row, rewards[outcome]
            cost += costs[row]
            if seen[row] < 0:
                seen[row] = steps
            steps += 1
            state = successors[outcome]
            end = ends[state]
            if end != GOES_ON:
                value = final[state]
                break
            if steps == max_steps:
                value = q[best[state]]
                break
            row = _explore(rows, state, best[state], epsilon, stream)
            greedy = greedy and row == best[state]
        lengths[episode] = steps
        cursor[CUT - end] += 1
        if end == COMPLETE and greedy and (cursor[CHEAPEST_STEPS] == 0 or cost < spent[1]):
            cursor[CHEAPEST_STEPS], spent[1] = steps, cost
            cheapest[:steps] = taken[:steps]
        for step in range(steps - 1, -1, -1):
            value = received[step] + gamma * value
            row = taken[step]
            if seen[row] == step:
                seen[row] = -1
                state, before = owners[row], q[row]
                q[row] = before + alpha * (value - before)
                if row == best[state]:
                    if q[row] < before:
                        best[state] = _greedy(q, rows[state], rows[state + 1])
                else:
                    most = q[best[state]]
                    if q[row] > most or (q[row] == most and row < best[state]):
                        best[state] = row
        row = -1
    cursor[EPISODE], cursor[ROW] = len(lengths), -1
    return UNTRIED
