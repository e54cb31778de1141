"""The search for cheap ways through what a run has learned, as one compiled kernel."""

from __future__ import annotations

from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.kernels import compiled

Words = NDArray[np.uint64]
Integers = NDArray[np.int64]
Floats = NDArray[np.float64]
Grown = TypeVar("Grown", bound=NDArray[Any])

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIX = np.uint64(0xBF58476D1CE4E5B9)
_SHIFT = np.uint64(29)
# So many actions in a row may make no progress, such as putting a tool away and fetching another.
_IDLE = 2
# Times the worth of progress: of a plan that ends with what is known.
_NOWHERE = 1e3


class Rules(NamedTuple):
    """What is known of actions; literals are bits that are set, then bits that are not.

    Parameters
    ----------
    sets, clears
        Shape (actions, words).
    passing
        Bits that last for one step only, shape (words,).
    costs
        Of an action after another one, shape (actions + 1, actions).
    untried
        Actions that never succeeded, shape (actions,).
    needed, lacking, first
        Of `allowed` and `feasible`, see `Compiled`; those of `feasible` after those of `allowed`,
        shapes (2, actions, 2 * words), (n, 2 * words) and (2, actions + 1).
    sure
        Shape (2, actions, 2 * words).
    """

    sets: Words
    clears: Words
    passing: Words
    costs: Floats
    untried: NDArray[np.bool_]
    sure: Words
    needed: Words
    lacking: Words
    first: Integers


class Search(NamedTuple):
    """What is searched for.

    Parameters
    ----------
    goal
        Literals that hold in the end, shape (2 * words,); where there are none, as much as
        possible of what is counted is sought.
    counted
        Literals that are counted as progress, shape (2 * words,).
    weights
        Least cost to come for every literal that does not hold, shape (2 * words * 64,).
    hope
        Where there is no goal: what progress is worth after every action of which it is not known
        whether it succeeds, as a share of what it was worth before, in (0, 1).
    worth
        Where there is no goal: of progress by one literal.
    trial
        Where there is no goal: of an action that never succeeded yet, with which a plan ends, in
        worth of progress.
    most_cost
        Plans that come to more are left out.
    """

    goal: Words
    counted: Words
    weights: Floats
    hope: float
    worth: float
    trial: float
    most_cost: float


@compiled
def _rated(literals: Words, weights: Floats) -> float:
    """Return the least cost to come of what does not hold."""
    total = 0.0
    for word in range(len(literals)):
        missing = ~literals[word]
        for bit in range(64):
            if missing >> np.uint64(bit) & np.uint64(1):
                total += weights[word * 64 + bit]
    return total


@compiled
def _verdict(rules: Rules, action: int, literals: Words) -> int:
    """Return 2 where an action is sure to succeed, 1 where that is unknown, 0 where it fails."""
    found = 2
    for kind in range(2):
        for word in range(len(literals)):
            if rules.needed[kind, action, word] & ~literals[word]:
                return 0
        sure = True
        for word in range(len(literals)):
            if rules.sure[kind, action, word] & ~literals[word]:
                sure = False
                break
        if sure:
            continue
        found = 1
        for row in range(rules.first[kind, action], rules.first[kind, action + 1]):
            holds = False
            for word in range(len(literals)):
                if rules.lacking[row, word] & literals[word]:
                    holds = True
                    break
            if not holds:
                return 0
    return found


@compiled
def _hashed(bits: Words, last: int) -> np.uint64:
    value = np.uint64(last + 1) * _MIX
    for word in range(len(bits)):
        value = (value ^ bits[word]) * _GOLDEN
        value ^= value >> _SHIFT
        value *= _MIX
        value ^= value >> _SHIFT
    return value


@compiled
def _ones(value: np.uint64) -> int:
    """Return how many bits are set."""
    count = 0
    while value:
        value &= value - np.uint64(1)
        count += 1
    return count


@compiled
def _chosen(indices: Integers, rates: Floats, hashes: Words, width: int) -> Integers:
    """Return the best of some nodes, every state once."""
    order = np.argsort(rates[indices], kind="mergesort")
    slots = 16
    while slots < 2 * len(order):
        slots *= 2
    table, used = np.zeros(slots, np.uint64), np.zeros(slots, np.bool_)
    found, count = np.empty(min(width, len(order)), np.int64), 0
    for at in order:
        key = hashes[indices[at]]
        slot = np.int64(key & np.uint64(slots - 1))
        while used[slot] and table[slot] != key:
            slot = (slot + 1) & (slots - 1)
        if used[slot]:
            continue
        used[slot], table[slot] = True, key
        found[count] = indices[at]
        count += 1
        if count == width:
            break
    return found[:count]


@compiled
def _grown(array: Grown) -> Grown:
    """Return an array with room for as much again."""
    return np.concatenate((array, np.empty_like(array)))  # type: ignore[return-value]


@compiled
def beam_search(
    rules: Rules, search: Search, start: Words, last: int, depth: int, width: int
) -> tuple[Integers, float, int]:
    """Return the actions of the best plan found, what it costs, and how it ends.

    Plans that have made as much progress compete with each other; of these, so many are gone on
    with, and as many after every action that makes none.

    Parameters
    ----------
    rules, search
        What is known, and what is sought.
    start
        Bits that are observed now, shape (words,).
    last
        The action taken last; -1 where there was none.
    depth
        Most actions of a plan.
    width
        How many plans are gone on with.

    Returns
    -------
    actions
        In order; none where nothing can be done.
    cost
        Of the plan; where there is no goal, less what its progress is worth.
    end
        2 where the goal is reached, 1 where an action is tried for the first time, else 0.
    """
    # One function: nodes are rows of ten arrays that grow, and a part of the loop would take and
    # return all of them.
    words, actions = len(start), rules.sets.shape[0]
    has_goal, layers = False, 2
    for word in range(2 * words):
        has_goal = has_goal or search.goal[word] != 0
        layers += _ones(search.counted[word])
    size = 64 * width + 64
    bits, hashes = np.empty((size, words), np.uint64), np.empty(size, np.uint64)
    costs, to_come, worth = np.empty(size), np.empty(size), np.empty(size)
    rates, lasts, parents = np.empty(size), np.empty(size, np.int64), np.empty(size, np.int64)
    steps, chain = np.empty(size, np.int64), np.empty(size, np.int64)
    heads = np.full(layers, -1, np.int64)
    literals, after = np.empty(2 * words, np.uint64), np.empty(words, np.uint64)
    literals[:words], literals[words:] = start, ~start
    bits[0], hashes[0], costs[0], worth[0] = start, _hashed(start, last), 0.0, search.worth
    to_come[0] = _rated(literals, search.weights) if has_goal else 0.0
    rates[0], lasts[0], parents[0], steps[0], chain[0] = to_come[0], last, -1, 0, -1
    heads[0], count = 0, 1
    best, best_at, best_action, best_end = np.inf, -1, -1, 0
    if not has_goal:
        best = np.inf
    most_cost = search.most_cost
    for layer in range(layers):
        for turn in range(_IDLE + 1):
            many, at = 0, heads[layer]
            while at >= 0:
                many, at = many + 1, chain[at]
            if many == 0:
                break
            waiting = np.empty(many, np.int64)
            many, at = 0, heads[layer]
            while at >= 0:
                waiting[many] = at
                many, at = many + 1, chain[at]
            heads[layer] = -1
            for at in _chosen(waiting[::-1], rates, hashes, width):
                if steps[at] >= depth or (has_goal and rates[at] >= most_cost):
                    continue
                literals[:words], literals[words:] = bits[at], ~bits[at]
                for action in range(actions):
                    never = rules.untried[action]
                    if never and has_goal:
                        continue
                    verdict = _verdict(rules, action, literals)
                    if verdict == 0:
                        continue
                    cost = costs[at] + rules.costs[lasts[at] + 1, action]
                    value = worth[at] * search.hope if verdict == 1 else worth[at]
                    if never:
                        total = cost + to_come[at] - search.trial * value
                        if total < best:
                            best, best_at, best_action, best_end = total, at, action, 1
                        continue
                    gain, come, same = 0, to_come[at], True
                    for word in range(words):
                        then = bits[at, word]
                        now = (then & ~rules.passing[word] & ~rules.clears[action, word]) | (
                            rules.sets[action, word]
                        )
                        after[word] = now
                        same = same and now == then
                        up, down = now & ~then, then & ~now
                        gain += _ones(up & search.counted[word])
                        gain += _ones(down & search.counted[words + word])
                        gain -= _ones(down & search.counted[word])
                        gain -= _ones(up & search.counted[words + word])
                        if has_goal and up | down:
                            for bit in range(64):
                                one = np.uint64(1) << np.uint64(bit)
                                if (up | down) & one:
                                    high = search.weights[word * 64 + bit]
                                    low = search.weights[(words + word) * 64 + bit]
                                    come += (low - high) if up & one else (high - low)
                    if same or gain < 0 or (gain == 0 and turn == _IDLE):
                        continue
                    if has_goal:
                        if cost + come >= most_cost:
                            continue
                        reached = True
                        for word in range(words):
                            if search.goal[word] & ~after[word]:
                                reached = False
                            if search.goal[words + word] & after[word]:
                                reached = False
                        if reached:
                            if cost < best:
                                best, best_at, best_action, best_end = cost, at, action, 2
                                most_cost = min(most_cost, best)
                            continue
                    else:
                        come = to_come[at] - gain * value
                        # What is sure and leads nowhere brings nothing.
                        total = cost + come + (_NOWHERE * search.worth if verdict == 2 else 0.0)
                        if total < best:
                            best, best_at, best_action, best_end = total, at, action, 0
                    if count == size:
                        bits, hashes = _grown(bits), _grown(hashes)
                        costs, to_come, worth = _grown(costs), _grown(to_come), _grown(worth)
                        rates, lasts, parents = _grown(rates), _grown(lasts), _grown(parents)
                        steps, chain = _grown(steps), _grown(chain)
                        size *= 2
                    bits[count], hashes[count] = after, _hashed(after, action)
                    costs[count], to_come[count], worth[count] = cost, come, value
                    rates[count], lasts[count], parents[count] = cost + come, action, at
                    steps[count] = steps[at] + 1
                    chain[count] = heads[layer + gain]
                    heads[layer + gain] = count
                    count += 1
    if best_action < 0:
        return np.empty(0, np.int64), np.inf, 0
    plan = np.empty(steps[best_at] + 1, np.int64)
    plan[-1], at = best_action, best_at
    while parents[at] >= 0:
        plan[steps[at] - 1], at = lasts[at], parents[at]
    return plan, best, best_end
