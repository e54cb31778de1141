"""Beam search for cheap plans in a learned model, as one compiled kernel.

Literals are bits that are set, followed by bits that are not set, packed in 64-bit words. All
kernels are in one file because numba does not notice changes in functions of other files.
"""

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
# Most actions in a row without progress, such as putting a tool away and fetching another.
_IDLE = 2
# Penalty of a plan without a goal whose last action is known already, in worth of progress.
_KNOWN = 1e3
# Outcomes of an action under the rules.
_FAILS, _OPEN, _SUCCEEDS = 0, 1, 2


class Rules(NamedTuple):
    """Learned schemas of all actions.

    Parameters
    ----------
    sets, clears
        Bits that an action sets and clears, shape (actions, words).
    passing
        Bits that last for one step only, shape (words,).
    costs
        Cost of an action after another one, shape (actions + 1, actions); row 0 is the start.
    untried
        Actions that never succeeded, shape (actions,).
    sure
        Literals under which an action is allowed, and succeeds, shape (2, actions, 2 * words).
    needed
        Literals that an action needs to be allowed, and to succeed, of the same shape.
    lacking
        Sets of literals; an action needs one literal of each of its sets, shape (n, 2 * words).
    first
        Index in `lacking` of the first set of an action, shape (2, actions + 1).
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
    """Goal and rating of a search.

    Parameters
    ----------
    goal
        Literals of the goal, shape (2 * words,); none to seek as much progress as possible.
    counted
        Literals that count as progress, shape (2 * words,).
    weights
        Least cost of making a literal true, shape (2 * words * 64,).
    hope
        Without a goal: factor on the worth of progress after an action that may fail, in (0, 1).
    worth
        Without a goal: worth of one literal of progress.
    trial
        Without a goal: worth of ending with an action that never succeeded, in literals.
    most_cost
        Upper limit of the cost of a plan.
    """

    goal: Words
    counted: Words
    weights: Floats
    hope: float
    worth: float
    trial: float
    most_cost: float


@compiled
def _rate(literals: Words, weights: Floats) -> float:
    """Return the least cost to come: the sum over all literals that do not hold."""
    total = 0.0
    for word in range(len(literals)):
        missing = ~literals[word]
        for bit in range(64):
            if missing >> np.uint64(bit) & np.uint64(1):
                total += weights[word * 64 + bit]
    return total


@compiled
def _rate_change(come: float, weights: Floats, before: Words, after: Words) -> float:
    """Return the least cost to come of a successor, given that of its parent."""
    words = len(before)
    for word in range(words):
        changed = before[word] ^ after[word]
        if not changed:
            continue
        for bit in range(64):
            mask = np.uint64(1) << np.uint64(bit)
            if changed & mask:
                high = weights[word * 64 + bit]
                low = weights[(words + word) * 64 + bit]
                come += (low - high) if after[word] & mask else (high - low)
    return come


@compiled
def _judge(rules: Rules, action: int, literals: Words) -> int:
    """Return whether an action succeeds, may succeed, or fails where literals hold."""
    verdict = _SUCCEEDS
    for kind in range(2):
        for word in range(len(literals)):
            if rules.needed[kind, action, word] & ~literals[word]:
                return _FAILS
        sure = True
        for word in range(len(literals)):
            if rules.sure[kind, action, word] & ~literals[word]:
                sure = False
                break
        if sure:
            continue
        verdict = _OPEN
        for row in range(rules.first[kind, action], rules.first[kind, action + 1]):
            holds = False
            for word in range(len(literals)):
                if rules.lacking[row, word] & literals[word]:
                    holds = True
                    break
            if not holds:
                return _FAILS
    return verdict


@compiled
def _apply(rules: Rules, action: int, before: Words, after: Words) -> bool:
    """Fill in the bits after an action; return whether any bit changed."""
    changed = False
    for word in range(len(before)):
        kept = before[word] & ~rules.passing[word] & ~rules.clears[action, word]
        after[word] = kept | rules.sets[action, word]
        changed = changed or after[word] != before[word]
    return changed


@compiled
def _count_gain(counted: Words, before: Words, after: Words) -> int:
    """Return the increase of the number of literals of progress that hold."""
    words, gain = len(before), 0
    for word in range(words):
        up, down = after[word] & ~before[word], before[word] & ~after[word]
        gain += _count_bits(up & counted[word]) - _count_bits(down & counted[word])
        gain += _count_bits(down & counted[words + word]) - _count_bits(up & counted[words + word])
    return gain


@compiled
def _reaches(goal: Words, bits: Words) -> bool:
    """Return whether all literals of a goal hold."""
    words = len(bits)
    for word in range(words):
        if goal[word] & ~bits[word] or goal[words + word] & bits[word]:
            return False
    return True


@compiled
def _hash(bits: Words, last: int) -> np.uint64:
    value = np.uint64(last + 1) * _MIX
    for word in range(len(bits)):
        value = (value ^ bits[word]) * _GOLDEN
        value ^= value >> _SHIFT
        value *= _MIX
        value ^= value >> _SHIFT
    return value


@compiled
def _count_bits(value: np.uint64) -> int:
    count = 0
    while value:
        value &= value - np.uint64(1)
        count += 1
    return count


@compiled
def _waiting_nodes(head: int, chain: Integers) -> Integers:
    """Return the nodes of a linked list, oldest first."""
    count, node = 0, head
    while node >= 0:
        count, node = count + 1, chain[node]
    nodes, node = np.empty(count, np.int64), head
    for place in range(count - 1, -1, -1):
        nodes[place], node = node, chain[node]
    return nodes


@compiled
def _select(nodes: Integers, rates: Floats, hashes: Words, width: int) -> Integers:
    """Return the `width` best nodes, every state once."""
    order = np.argsort(rates[nodes], kind="mergesort")
    slots = 16
    while slots < 2 * len(order):
        slots *= 2
    table, used = np.zeros(slots, np.uint64), np.zeros(slots, np.bool_)
    selected, count = np.empty(min(width, len(order)), np.int64), 0
    for place in order:
        key = hashes[nodes[place]]
        slot = np.int64(key & np.uint64(slots - 1))
        while used[slot] and table[slot] != key:
            slot = (slot + 1) & (slots - 1)
        if used[slot]:
            continue
        used[slot], table[slot] = True, key
        selected[count] = nodes[place]
        count += 1
        if count == width:
            break
    return selected[:count]


@compiled
def _grow(array: Grown) -> Grown:
    """Return an array of twice the length."""
    return np.concatenate((array, np.empty_like(array)))  # type: ignore[return-value]


@compiled
def beam_search(
    rules: Rules, search: Search, start: Words, last: int, depth: int, width: int
) -> tuple[Integers, float, int]:
    """Return the best plan, its cost, and how it ends.

    Plans with equal progress compete with each other: the `width` best are expanded, and as many
    after every action without progress.

    Parameters
    ----------
    rules, search
        The learned model, and the goal.
    start
        Current bits, shape (words,).
    last
        Latest action; -1 at the start of an episode.
    depth
        Most actions of a plan.
    width
        Plans expanded at equal progress.

    Returns
    -------
    actions
        In order; empty if no action is possible.
    cost
        Cost of the plan; without a goal, minus the worth of its progress.
    end
        2 if the goal is reached, 1 if the plan ends with an action that never succeeded, else 0.
    """
    # Nodes are rows of ten arrays that grow, which helper functions would have to return.
    words, actions = len(start), rules.sets.shape[0]
    has_goal, layers = False, 2
    for word in range(2 * words):
        has_goal = has_goal or search.goal[word] != 0
        layers += _count_bits(search.counted[word])
    size = 64 * width + 64
    bits, hashes = np.empty((size, words), np.uint64), np.empty(size, np.uint64)
    costs, to_come, worth = np.empty(size), np.empty(size), np.empty(size)
    rates, lasts, parents = np.empty(size), np.empty(size, np.int64), np.empty(size, np.int64)
    steps, chain = np.empty(size, np.int64), np.empty(size, np.int64)
    heads = np.full(layers, -1, np.int64)
    literals, after = np.empty(2 * words, np.uint64), np.empty(words, np.uint64)
    literals[:words], literals[words:] = start, ~start
    bits[0], hashes[0], costs[0], worth[0] = start, _hash(start, last), 0.0, search.worth
    to_come[0] = _rate(literals, search.weights) if has_goal else 0.0
    rates[0], lasts[0], parents[0], steps[0], chain[0] = to_come[0], last, -1, 0, -1
    heads[0], count = 0, 1
    best, best_node, best_action, best_end = np.inf, -1, -1, 0
    most_cost = search.most_cost
    for layer in range(layers):
        for turn in range(_IDLE + 1):
            waiting = _waiting_nodes(heads[layer], chain)
            if len(waiting) == 0:
                break
            heads[layer] = -1
            for node in _select(waiting, rates, hashes, width):
                if steps[node] >= depth or (has_goal and rates[node] >= most_cost):
                    continue
                literals[:words], literals[words:] = bits[node], ~bits[node]
                for action in range(actions):
                    never = rules.untried[action]
                    if never and has_goal:
                        continue
                    verdict = _judge(rules, action, literals)
                    if verdict == _FAILS:
                        continue
                    cost = costs[node] + rules.costs[lasts[node] + 1, action]
                    value = worth[node] * search.hope if verdict == _OPEN else worth[node]
                    if never:
                        total = cost + to_come[node] - search.trial * value
                        if total < best:
                            best, best_node, best_action, best_end = total, node, action, 1
                        continue
                    changed = _apply(rules, action, bits[node], after)
                    gain = _count_gain(search.counted, bits[node], after)
                    if not changed or gain < 0 or (gain == 0 and turn == _IDLE):
                        continue
                    if has_goal:
                        come = _rate_change(to_come[node], search.weights, bits[node], after)
                        if cost + come >= most_cost:
                            continue
                        if _reaches(search.goal, after):
                            if cost < best:
                                best, best_node, best_action, best_end = cost, node, action, 2
                                most_cost = min(most_cost, best)
                            continue
                    else:
                        come = to_come[node] - gain * value
                        known = verdict == _SUCCEEDS
                        total = cost + come + (_KNOWN * search.worth if known else 0.0)
                        if total < best:
                            best, best_node, best_action, best_end = total, node, action, 0
                    if count == size:
                        bits, hashes = _grow(bits), _grow(hashes)
                        costs, to_come, worth = _grow(costs), _grow(to_come), _grow(worth)
                        rates, lasts, parents = _grow(rates), _grow(lasts), _grow(parents)
                        steps, chain = _grow(steps), _grow(chain)
                        size *= 2
                    bits[count], hashes[count] = after, _hash(after, action)
                    costs[count], to_come[count], worth[count] = cost, come, value
                    rates[count], lasts[count], parents[count] = cost + come, action, node
                    steps[count] = steps[node] + 1
                    chain[count] = heads[layer + gain]
                    heads[layer + gain] = count
                    count += 1
    if best_action < 0:
        return np.empty(0, np.int64), np.inf, 0
    plan = np.empty(steps[best_node] + 1, np.int64)
    plan[-1], node = best_action, best_node
    while parents[node] >= 0:
        plan[steps[node] - 1], node = lasts[node], parents[node]
    return plan, best, best_end
