"""Kernels of tabular control: TD(0) updates of SARSA and Q-learning, and first-visit Monte Carlo.

Sutton and Barto, "Reinforcement Learning: An Introduction" (2018), sections 5.3, 6.4 and 6.5;
Veeramani and Muthuswamy, Table 2. Random numbers come from the kernels' own generator, so that a
seed gives the same result with every version of every library. All kernels are in one file because
numba does not notice changes in functions of other files.
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

# SplitMix64: Steele, Lea and Flood, "Fast splittable pseudorandom number generators" (2014).
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_S11, _S27, _S30, _S31, _S32 = (np.uint64(shift) for shift in (11, 27, 30, 31, 32))


class Environment(NamedTuple):
    """The environment of episodes; offsets as in `TabularMDP`.

    Parameters
    ----------
    rows, outcomes, successors, probabilities
        Those of a `TabularMDP`.
    rewards
        Reward of every outcome, shape (k,).
    ends
        True for states in which an episode ends, shape (n,).
    final
        Value of a state in which an episode ends, shape (n,): 0 at the goal.
    starts
        States in which an episode may begin, at least one.
    """

    rows: Integers
    outcomes: Integers
    successors: Integers
    probabilities: Floats
    rewards: Floats
    ends: NDArray[np.bool_]
    final: Floats
    starts: Integers


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
def _outcome(outcomes: Integers, probabilities: Floats, row: int, stream: Stream) -> int:
    """Return the outcome of taking a row, drawn only where there are several."""
    outcome, last = outcomes[row], outcomes[row + 1] - 1
    if outcome < last:
        left = _uniform(stream) - probabilities[outcome]
        while left >= 0.0 and outcome < last:
            outcome += 1
            left -= probabilities[outcome]
    return int(outcome)


@compiled
def td_episodes(
    env: Environment,
    schedule: Schedule,
    rule: int,
    previous: int,
    q: Floats,
    stream: Stream,
    lengths: Integers,
) -> None:
    """Run `len(lengths)` episodes with a TD(0) update after every step.

    Parameters
    ----------
    env
        An `Environment`.
    schedule
        A `Schedule`.
    rule
        `SARSA`, `EXPECTED_SARSA` or `Q_LEARNING`.
    previous
        Episodes run before.
    q
        Value of every row, shape (m,); changed.
    stream
        State of the generator, shape (1,); changed.
    lengths
        Filled with the steps of every episode.
    """
    # Unpacked here: passing tuples on makes numba count references, four times as slow.
    rows, outcomes, successors, probabilities, rewards, ends, final, starts = env
    gamma, max_steps = schedule.gamma, schedule.max_steps
    best = np.empty(len(ends), dtype=np.int64)
    for state in range(len(ends)):
        if not ends[state]:
            best[state] = _greedy(q, rows[state], rows[state + 1])
    for episode in range(len(lengths)):
        alpha = schedule.alpha + schedule.alpha_change * (previous + episode)
        epsilon = schedule.epsilon + schedule.epsilon_change * (previous + episode)
        state = starts[_below(stream, len(starts))]
        row = _explore(rows, state, best[state], epsilon, stream)
        steps = 0
        while steps < max_steps:
            steps += 1
            outcome = _outcome(outcomes, probabilities, row, stream)
            following = successors[outcome]
            taken, before = row, q[row]
            if ends[following]:
                ahead = final[following]
            else:
                row = _explore(rows, following, best[following], epsilon, stream)
                if rule == SARSA:
                    ahead = q[row]
                elif rule == Q_LEARNING:
                    ahead = q[best[following]]
                else:
                    mean = q[rows[following] : rows[following + 1]].mean()
                    ahead = (1.0 - epsilon) * q[best[following]] + epsilon * mean
            value = before + alpha * (rewards[outcome] + gamma * ahead - before)
            q[taken] = value
            # Most updates do not change the best row, so that it need not be searched for.
            if taken == best[state]:
                if value < before:
                    best[state] = _greedy(q, rows[state], rows[state + 1])
            else:
                most = q[best[state]]
                if value > most or (value == most and taken < best[state]):
                    best[state] = taken
            if ends[following]:
                break
            state = following
        lengths[episode] = steps


@compiled
def monte_carlo_episodes(
    env: Environment,
    schedule: Schedule,
    previous: int,
    q: Floats,
    seen: Integers,
    taken: Integers,
    received: Floats,
    stream: Stream,
    lengths: Integers,
) -> None:
    """Run `len(lengths)` episodes of Monte Carlo control, with updates after each of them.

    First-visit Monte Carlo control with exploring starts: an episode begins with a random row of
    a random state, and values are moved towards the return that followed the first visit of each
    row.

    Parameters
    ----------
    env, schedule, previous, q, stream, lengths
        As in `td_episodes`.
    seen
        Scratch, shape (m,): the step at which a row was first taken in this episode, -1 outside.
    taken, received
        Scratch for the rows and rewards of an episode, shape (max_steps,).
    """
    rows, outcomes, successors, probabilities, rewards, ends, final, starts = env
    gamma, max_steps = schedule.gamma, schedule.max_steps
    for episode in range(len(lengths)):
        alpha = schedule.alpha + schedule.alpha_change * (previous + episode)
        epsilon = schedule.epsilon + schedule.epsilon_change * (previous + episode)
        state = starts[_below(stream, len(starts))]
        first, end = rows[state], rows[state + 1]
        row = first + _below(stream, end - first)
        steps = 0
        value = 0.0
        while True:
            outcome = _outcome(outcomes, probabilities, row, stream)
            taken[steps], received[steps] = row, rewards[outcome]
            if seen[row] < 0:
                seen[row] = steps
            steps += 1
            state = successors[outcome]
            if ends[state]:
                value = final[state]
                break
            if steps == max_steps:
                break
            best = _greedy(q, rows[state], rows[state + 1])
            row = _explore(rows, state, best, epsilon, stream)
        for step in range(steps - 1, -1, -1):
            value = received[step] + gamma * value
            row = taken[step]
            if seen[row] == step:
                q[row] += alpha * (value - q[row])
                seen[row] = -1
        lengths[episode] = steps
