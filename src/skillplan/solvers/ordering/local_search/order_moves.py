"""Parts of the moves of local search on orders: insertion, strings, and what precedence allows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.compiled import compiled
from skillplan.solvers.ordering.instance import NO_ARC

Integers = NDArray[np.int64]
Floats = NDArray[np.float64]
Booleans = NDArray[np.bool_]
Randoms = NDArray[np.uint64]
# Of an order: the positions of the nodes, and what `note_reversals` says of reversing strings.
Notes = tuple[Integers, Floats, Integers]


@compiled
def draw(state: Randoms) -> float:
    """Return a number in [0, 1): xorshift64*, Vigna (2016)."""
    x = state[0]
    x ^= x >> np.uint64(12)
    x ^= x << np.uint64(25)
    x ^= x >> np.uint64(27)
    state[0] = x
    return float((x * np.uint64(2685821657736338717)) >> np.uint64(11)) / 9007199254740992.0


@compiled
def insert(
    order: Integers,
    size: int,
    node: int,
    costs: Floats,
    before: Booleans,
    random: Randoms,
    blink: float,
) -> float:
    """Insert a node where it costs least, with random blinks at positions; return the cost."""
    best, where, least, at = np.inf, -1, np.inf, -1
    for position in range(size - 1, 0, -1):
        # The node would stand before order[position].
        here, there = order[position - 1], order[position]
        if before[there, node]:
            break
        if before[node, here]:
            # It belongs further ahead than all positions seen so far.
            best, where, least, at = np.inf, -1, np.inf, -1
            continue
        added = costs[here, node] + costs[node, there] - costs[here, there]
        if added < least:
            least, at = added, position
        if added < best and (blink <= 0.0 or draw(random) >= blink):
            best, where = added, position
    if where < 0:
        best, where = least, at
    for position in range(size, where, -1):
        order[position] = order[position - 1]
    order[where] = node
    return best


@compiled
def cost_of(order: Integers, costs: Floats) -> float:
    """Return what an order costs."""
    cost = 0.0
    for i in range(len(order) - 1):
        cost += costs[order[i], order[i + 1]]
    return cost


@compiled
def write_string(
    trial: Integers, at: int, start: Integers, first: int, last: int, reverse: bool
) -> None:
    """Write a string of one order into another, reversed on demand."""
    for i in range(last - first + 1):
        trial[at + i] = start[last - i] if reverse else start[first + i]


@compiled
def note_reversals(order: Integers, costs: Floats, follow: Integers, notes: Notes) -> None:
    """Set `turning` and `reach`: reversing from i to j costs turning[j] - turning[i] more.

    It is allowed if reach[j] <= i.
    """
    rank, turning, reach = notes
    reach[:] = 0
    turning[0] = 0.0
    for i in range(len(order)):
        node = order[i]
        # A slice of the followers would cost more than the loop.
        for k in range(follow.shape[1]):
            after = follow[node, k]
            if after < 0:
                break
            reach[rank[after]] = i + 1
    turned = 0.0
    for i in range(1, len(order)):
        here, there = order[i - 1], order[i]
        forth, back = costs[here, there], costs[there, here]
        if max(forth, back) < NO_ARC:
            turned += back - forth
        else:
            reach[i] = i
        turning[i] = turned
        reach[i] = max(reach[i], reach[i - 1])


@compiled
def may_pass(
    order: Integers, follow: Integers, rank: Integers, first: int, middle: int, last: int
) -> bool:
    """Whether no node from `first` to `middle` must come before one up to `last`."""
    for i in range(first, middle + 1):
        node = order[i]
        for k in range(follow.shape[1]):
            after = follow[node, k]
            if after < 0:
                break
            if middle < rank[after] <= last:
                return False
    return True
