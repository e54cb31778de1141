"""Held-Karp: one layer of the dynamic program over feasible subsets, compiled.

Held and Karp, "A dynamic programming approach to sequencing problems" (1962); Escudero (1988) with
precedence. A *label* is a partial order: a set of visited nodes and the last of them. Among labels
with equal set and last node the cheapest dominates. A set is feasible if it contains all
predecessors of its nodes. A label is fathomed (Morin and Marsten, 1976) if its reduced cost so far
plus a lower bound on the rest reaches the gap. Cost and reduced cost differ by more than a
constant, as an order may cross a cut more than once. So the cheapest label is kept, and among
equally cheap ones the label with the least reduced cost.
"""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.kernels import compiled
from skillplan.solvers.ordering.instance import Floats, Integers
from skillplan.solvers.ordering.relaxation.cut_relaxation import Charges

Words = NDArray[np.uint64]
S = TypeVar("S", bound=np.generic)


class Layer(NamedTuple):
    """s labels with equally many visited nodes.

    Parameters
    ----------
    sets
        Visited nodes, one bit each, shape (s, words).
    lasts
        Last visited node, shape (s,).
    costs, reduced
        Cost and reduced cost so far, shape (s,) each.
    bounds
        Lower bound on the reduced cost of the whole order, shape (s,).
    parents
        Parent label in the layer before, shape (s,).
    """

    sets: Words
    lasts: NDArray[np.int16]
    costs: Floats
    reduced: Floats
    bounds: Floats
    parents: NDArray[np.int32]


class Arcs(NamedTuple):
    """The arcs by their tails, and the predecessors of nodes.

    Parameters
    ----------
    first
        First arc of each node, shape (n + 1,).
    heads, costs, reduced
        Head, cost and reduced cost of every arc, shape (arcs,) each.
    preds
        Predecessors of a node by precedence, shape (n, words).
    """

    first: Integers
    heads: Integers
    costs: Floats
    reduced: Floats
    preds: Words


class Ahead(NamedTuple):
    """Completion bounds of a layer; see `CompletionBounds`.

    Parameters
    ----------
    near
        Neighbours that a node remembers, padded with -1, shape (n, bits).
    slot
        Row of a node in this layer or -1, shape (n,).
    table
        Least reduced cost to the end by row and set of remaining neighbours, shape (rows, 2 **
        bits).
    """

    near: Integers
    slot: Integers
    table: Floats


class Limits(NamedTuple):
    """Limits on labels.

    Parameters
    ----------
    most, strict
        Greatest reduced cost with the last arc, or with the charges of the last node if `strict`.
    room
        Gap at which labels are fathomed.
    width
        Greatest number of labels; the least bounds are kept.
    whole
        True to return no label if there are more.
    """

    most: float
    strict: bool
    room: float
    width: int
    whole: bool


def make_first_layer(words: int) -> Layer:
    """Return the single label that has visited node 0, with a set of some words."""
    sets = np.zeros((1, words), dtype=np.uint64)
    sets[0, 0] = 1
    nothing = np.zeros(1)
    parents = np.zeros(1, dtype=np.int32)
    return Layer(sets, np.zeros(1, dtype=np.int16), nothing, nothing, nothing, parents)


@compiled
def _select(layer: Layer, count: int, width: int) -> tuple[int, float, float]:
    """Move the best of the first `count` labels to the front, by their bounds.

    Return their number, their largest bound, and the least bound of the others.
    """
    limit = np.partition(layer.bounds[:count], width - 1)[width - 1]
    kept, left_out = 0, np.inf
    for r in range(count):
        if layer.bounds[r] > limit or kept == width:
            left_out = min(left_out, layer.bounds[r])
            continue
        layer.sets[kept] = layer.sets[r]
        layer.lasts[kept] = layer.lasts[r]
        layer.costs[kept] = layer.costs[r]
        layer.reduced[kept] = layer.reduced[r]
        layer.bounds[kept] = layer.bounds[r]
        layer.parents[kept] = layer.parents[r]
        kept += 1
    return kept, limit, left_out


@compiled
def _empty(capacity: int, words: int) -> Layer:
    """Return a layer with room for labels."""
    return Layer(
        np.empty((capacity, words), dtype=np.uint64),
        np.empty(capacity, dtype=np.int16),
        np.empty(capacity),
        np.empty(capacity),
        np.empty(capacity),
        np.empty(capacity, dtype=np.int32),
    )


@compiled
def _grown(layer: Layer, capacity: int) -> Layer:
    """Return a copy of a layer with more room."""
    longer, n = _empty(capacity, layer.sets.shape[1]), len(layer.lasts)
    longer.sets[:n] = layer.sets
    longer.lasts[:n] = layer.lasts
    longer.costs[:n] = layer.costs
    longer.reduced[:n] = layer.reduced
    longer.bounds[:n] = layer.bounds
    longer.parents[:n] = layer.parents
    return longer


@compiled
def _front(layer: Layer, count: int) -> Layer:
    """Return the first labels of a layer."""
    return Layer(
        layer.sets[:count].copy(),
        layer.lasts[:count].copy(),
        layer.costs[:count].copy(),
        layer.reduced[:count].copy(),
        layer.bounds[:count].copy(),
        layer.parents[:count].copy(),
    )


@compiled
def _open(visited: Words, preds: Words, node: int) -> bool:
    """Return True if a node is unvisited, and all its predecessors are visited."""
    fits = not (visited[node >> 6] >> np.uint64(node & 63)) & np.uint64(1)
    for w in range(len(visited)):
        fits &= not preds[w] & ~visited[w]
    return fits


@compiled
def _charged(visited: Words, last: int, node: int, charges: Charges) -> float:
    """Return the charges of a label for its next node; see `Charges`."""
    uint64 = np.uint64(1)
    total = 0.0
    for c in range(charges.first[node], charges.first[node + 1]):
        has, lacks = charges.has[c], charges.lacks[c]
        if not (visited[has >> 6] >> np.uint64(has & 63)) & uint64 or charges.after[c] == last:
            continue
        if lacks < 0 or not (visited[lacks >> 6] >> np.uint64(lacks & 63)) & uint64:
            total += charges.amounts[c]
    return total


@compiled
def _hash(visited: Words, last: int) -> int:
    """Return a hash of the set and the last node."""
    value = np.uint64(last) * np.uint64(0x9E3779B97F4A7C15)
    for word in visited:
        value = (value ^ word) * np.uint64(0xFF51AFD7ED558CCD)
        value ^= value >> np.uint64(32)
    return int(value >> np.uint64(1))


@compiled
def _place(
    table: NDArray[np.int32], sets: Words, lasts: NDArray[np.int16], visited: Words, last: int
) -> int:
    """Return the slot of a label in the hash table: its own, or a free one."""
    at = _hash(visited, last) & (len(table) - 1)
    while table[at] >= 0:
        slot = table[at]
        same = lasts[slot] == last
        for w in range(len(visited)):
            same &= sets[slot, w] == visited[w]
        if same:
            break
        at = (at + 1) & (len(table) - 1)
    return at


@compiled
def _table(layer: Layer, count: int, capacity: int) -> NDArray[np.int32]:
    """Return a hash table of the first labels of a layer, with room for `capacity`."""
    size = 2
    while size < 2 * capacity:
        size *= 2
    table = np.full(size, -1, dtype=np.int32)
    for r in range(count):
        at = _hash(layer.sets[r], layer.lasts[r]) & (size - 1)
        while table[at] >= 0:
            at = (at + 1) & (size - 1)
        table[at] = r
    return table


@compiled
def _left(visited: Words, near: Integers, j: int) -> int:
    """Return the remaining neighbours of a node, one bit each."""
    left = 0
    for b in range(near.shape[1]):
        node = near[j, b]
        if node >= 0 and not (visited[node >> 6] >> np.uint64(node & 63)) & np.uint64(1):
            left |= 1 << b
    return left


@compiled
def expand(
    layer: Layer, arcs: Arcs, ahead: Ahead, charges: Charges, limits: Limits
) -> tuple[Layer, float, int]:
    """Extend all labels by one node.

    Parameters
    ----------
    ahead
        Completion bounds of the next layer.

    Returns
    -------
    tuple
        The next layer, the least bound of the labels beyond the width (inf for none), and the
        number
        of generated labels.
    """
    # The arrays of the inner loop are taken out of their tuples first: numba counts references to
    # all arrays of a tuple at each use, which made this four times as slow. For the same reason the
    # decisions are inlined and not in functions of tuples.
    sets, lasts, costs, reduced, _, _ = layer
    first, heads, arc_costs, arc_reduced, preds = arcs
    near, slot, lowest = ahead
    most, strict, room, width, whole = limits
    # A beam drops the worst labels each time the layer is full.
    most_held = width if whole else 2 * width
    capacity = min(most_held, max(1024, 2 * len(lasts)))
    longer = _empty(capacity, sets.shape[1])
    new_sets, new_lasts, new_costs, new_reduced, new_bounds, parents = longer
    table = _table(longer, 0, capacity)
    trial = np.empty(sets.shape[1], dtype=np.uint64)
    count = generated = 0
    dropped, limit = np.inf, room
    for s in range(len(lasts)):
        visited = sets[s]
        for a in range(first[lasts[s]], first[lasts[s] + 1]):
            j = heads[a]
            row = slot[j]
            if row < 0 or not _open(visited, preds[j], j):
                continue
            to_go = lowest[row, _left(visited, near, j)]
            total = reduced[s] + arc_reduced[a]
            if total >= most or total + to_go >= room:
                continue
            total += _charged(visited, lasts[s], j, charges)
            if strict and total >= most:
                continue
            generated += 1
            cost, bound = costs[s] + arc_costs[a], total + to_go
            if bound >= limit:
                if bound < room and bound < dropped:
                    dropped = bound
                continue
            trial[:] = visited
            trial[j >> 6] |= np.uint64(1) << np.uint64(j & 63)
            at = _place(table, new_sets, new_lasts, trial, j)
            entry = table[at]
            if entry >= 0:
                dominated = cost > new_costs[entry]
                if dominated or (cost == new_costs[entry] and total >= new_reduced[entry]):
                    continue
            elif count == capacity:
                if capacity < most_held:
                    capacity = min(most_held, 2 * capacity)
                    longer = _grown(longer, capacity)
                    new_sets, new_lasts, new_costs, new_reduced, new_bounds, parents = longer
                elif whole:
                    return _front(longer, 0), 0.0, generated
                else:
                    count, limit, left_out = _select(longer, count, width)
                    dropped = min(dropped, left_out)
                table = _table(longer, count, capacity)
                at = _place(table, new_sets, new_lasts, trial, j)
                if bound >= limit:
                    dropped = min(dropped, bound)
                    continue
            if entry < 0:
                entry = table[at] = count
                new_sets[entry] = trial
                new_lasts[entry] = j
                count += 1
            new_costs[entry] = cost
            new_reduced[entry] = total
            new_bounds[entry] = bound
            parents[entry] = s
    if count > width:
        count, limit, left_out = _select(longer, count, width)
        dropped = min(dropped, left_out)
    return _front(longer, count), dropped, generated


@compiled
def meet(
    layer: Layer, arcs: Arcs, most: float, behind: Layer, room: float
) -> tuple[float, int, int]:
    """Join labels from both ends by an arc: return the cheapest order below `room`.

    Parameters
    ----------
    layer, arcs
        Labels from the start, and the arcs that may extend them.
    most
        Reduced cost with the arc below which labels are left to the next layer.
    behind
        Labels from the end, with node n - 1 - i for i.
    room
        Upper bound on the cost of the order, exclusive.

    Returns
    -------
    tuple
        Cost, and indices of the two labels; -1 for none.
    """
    sets, lasts, costs, reduced, _, _ = layer
    first, heads, arc_costs, arc_reduced, preds = arcs
    n = len(preds)
    table = _table(behind, len(behind.lasts), len(behind.lasts))
    lowest, own, other = room, -1, -1
    rest = np.empty(sets.shape[1], dtype=np.uint64)
    for s in range(len(lasts)):
        rest[:] = np.uint64(0)
        for i in range(n):
            if not (sets[s, i >> 6] >> np.uint64(i & 63)) & np.uint64(1):
                mirror = n - 1 - i
                rest[mirror >> 6] |= np.uint64(1) << np.uint64(mirror & 63)
        for a in range(first[lasts[s]], first[lasts[s] + 1]):
            cost, head = costs[s] + arc_costs[a], heads[a]
            if cost >= lowest or not _open(sets[s], preds[head], head):
                continue
            if reduced[s] + arc_reduced[a] < most:
                continue
            slot = table[_place(table, behind.sets, behind.lasts, rest, n - 1 - head)]
            if slot >= 0 and cost + behind.costs[slot] < lowest:
                lowest, own, other = cost + behind.costs[slot], s, slot
    return lowest, own, other


@compiled
def pack_words(relation: NDArray[np.bool_]) -> NDArray[np.uint64]:
    """Return the columns of a relation as bit sets, shape (n, words)."""
    n = len(relation)
    words = np.zeros((n, (n + 63) // 64), dtype=np.uint64)
    for j in range(n):
        for i in range(n):
            if relation[i, j]:
                words[j, i >> 6] |= np.uint64(1) << np.uint64(i & 63)
    return words
