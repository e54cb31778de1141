"""ng-route relaxation: cheapest walks that remember neighbours only, backwards and with precedence.

Baldacci, Mingozzi and Roberti, "New route relaxation and pricing strategies for the vehicle
routing problem" (2011). A walk has as many nodes as an order, each within the positions that
precedence leaves it. It remembers which neighbours of its present node come later: none of them may
be visited again, nor any node that they must come before.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.compiled import compiled

Integers = NDArray[np.int64]
Floats = NDArray[np.float64]
Booleans = NDArray[np.bool_]


@compiled
def memory_tables(
    tails: Integers, heads: Integers, near: Integers, before: Booleans
) -> tuple[Integers, Integers]:
    """Return what the memory at the head of an arc becomes at its tail, and what bars the arc.

    Parameters
    ----------
    tails, heads
        The arcs, shape (m,).
    near
        The neighbours that a node remembers, -1 where there are fewer, shape (n, bits).
    before
        The closed relation, shape (n, n).

    Returns
    -------
    tuple
        Memory at the tail by arc and memory at the head, shape (m, 2 ** bits), and the bits at
        the head of which none may be set, shape (m,).
    """
    bits = near.shape[1]
    moved = np.zeros((len(tails), 1 << bits), dtype=np.int64)
    bars = np.zeros(len(tails), dtype=np.int64)
    single = np.zeros(bits, dtype=np.int64)
    for a in range(len(tails)):
        i, j = tails[a], heads[a]
        base = 0
        for b in range(bits):
            if near[i, b] == j:
                base = 1 << b
        for b in range(bits):
            single[b] = 0
            node = near[j, b]
            if node < 0:
                continue
            if node == i or before[node, i]:
                bars[a] |= 1 << b
            for c in range(bits):
                if near[i, c] == node:
                    single[b] = 1 << c
        moved[a, 0] = base
        for memory in range(1, 1 << bits):
            low = memory & -memory
            b = 0
            while low >> b != 1:
                b += 1
            moved[a, memory] = moved[a, memory ^ low] | single[b]
    return moved, bars


@compiled
def backward(
    tails: Integers,
    costs: Floats,
    first: Integers,
    moved: Integers,
    bars: Integers,
    slot: Integers,
    memories: int,
) -> Floats:
    """Return the least costs to the end by position, node and memory.

    Parameters
    ----------
    tails, costs
        The arcs ordered by their heads, shape (m,).
    first
        Where the arcs into a node begin, shape (n + 1,).
    moved, bars
        From `memory_tables`.
    slot
        Row of a position and a node, -1 where the node cannot be there, shape (n, n).
    memories
        2 ** bits.

    Returns
    -------
    ndarray
        Shape (rows, memories); inf where there is no walk.
    """
    n = len(slot)
    value = np.full((slot.max() + 1, memories), np.inf)
    value[slot[n - 1, n - 1], 0] = 0.0
    for position in range(n - 1, 0, -1):
        for j in range(n):
            here = slot[position, j]
            if here < 0:
                continue
            for a in range(first[j], first[j + 1]):
                there = slot[position - 1, tails[a]]
                if there < 0:
                    continue
                cost, bar = costs[a], bars[a]
                for memory in range(memories):
                    if memory & bar:
                        continue
                    total = value[here, memory] + cost
                    kept = moved[a, memory]
                    if total < value[there, kept]:
                        value[there, kept] = total
    return value


@compiled
def spread(value: Floats, bits: int) -> None:
    """Let every entry be the least over the memories that are part of its own, in place."""
    for row in range(len(value)):
        for b in range(bits):
            bit = 1 << b
            for memory in range(1 << bits):
                if memory & bit and value[row, memory ^ bit] < value[row, memory]:
                    value[row, memory] = value[row, memory ^ bit]
