"""One layer of the dynamic program over feasible subsets, compiled.

Held and Karp (1962), Escudero (1988): of all ways to visit a set of nodes and end at one of them
only the cheapest matters. With precedence, only sets count that hold with a node all that comes
before it. A way that cannot be completed below a given cost is left out (Morin and Marsten, 1976):
what it has spent in reduced costs, and still must spend, says so. Cost and what is spent differ by
more than a constant, as an order may cross a cut more than once. So the cheapest way is kept, and
of equally cheap ones that which has spent least.
"""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.compiled import compiled
from skillplan.solvers.ordering.relaxation.reduced_costs import Charges

Integers = NDArray[np.int64]
Floats = NDArray[np.float64]
Words = NDArray[np.uint64]
S = TypeVar("S", bound=np.generic)


class Layer(NamedTuple):
    """Ways over as many nodes each; s of them.

    Parameters
    ----------
    sets
        The nodes visited, one bit each, shape (s, words).
    lasts
        Where the ways end, shape (s,).
    costs, spent
        What they cost, and what they have spent in reduced costs, shape (s,) each.
    ends
        The least to be spent to the end, that what is spent included, shape (s,).
    parents
        The way of the layer before that each came from, shape (s,).
    """

    sets: Words
    lasts: NDArray[np.int16]
    costs: Floats
    spent: Floats
    ends: Floats
    parents: NDArray[np.int32]


class Arcs(NamedTuple):
    """The arcs by their tails, and what comes before a node.

    Parameters
    ----------
    first
        Where the arcs of a node begin, shape (n + 1,).
    heads, costs, reduced
        Where an arc leads, its cost and its reduced cost, shape (arcs,) each.
    preds
        What comes before a node, shape (n, words).
    """

    first: Integers
    heads: Integers
    costs: Floats
    reduced: Floats
    preds: Words


class Ahead(NamedTuple):
    """The least spending to the end.

    Parameters
    ----------
    near
        Neighbours of a node that are remembered, -1 for none, shape (n, bits).
    slot
        The row of a node in this layer or -1, shape (n,).
    least
        By row and the neighbours that are left, shape (rows, 2 ** bits).
    """

    near: Integers
    slot: Integers
    least: Floats


class Limits(NamedTuple):
    """Which ways are left out.

    Parameters
    ----------
    most, strict
        Those that spend `most` with their last arc, or where it is strict with the charges of
        their last node.
    room
        Those that spend so much to the end.
    width
        At most so many are kept, those that spend least to the end.
    whole
        Whether to give up, with nothing kept, where there are more.
    """

    most: float
    strict: bool
    room: float
    width: int
    whole: bool


def first_layer(words: int) -> Layer:
    """Return the one way that has visited node 0 alone, its set in so many words."""
    sets = np.zeros((1, words), dtype=np.uint64)
    sets[0, 0] = 1
    nothing = np.zeros(1)
    parents = np.zeros(1, dtype=np.int32)
    return Layer(sets, np.zeros(1, dtype=np.int16), nothing, nothing, nothing, parents)


@compiled
def _sort_out(layer: Layer, count: int, width: int) -> tuple[int, float, float]:
    """Move to the front those of the first `count` ways that spend least to the end.

    Return how many, the most that one of them spends, and the least that one left out spends.
    """
    limit = np.partition(layer.ends[:count], width - 1)[width - 1]
    kept, left_out = 0, np.inf
    for r in range(count):
        if layer.ends[r] > limit or kept == width:
            left_out = min(left_out, layer.ends[r])
            continue
        layer.sets[kept] = layer.sets[r]
        layer.lasts[kept] = layer.lasts[r]
        layer.costs[kept] = layer.costs[r]
        layer.spent[kept] = layer.spent[r]
        layer.ends[kept] = layer.ends[r]
        layer.parents[kept] = layer.parents[r]
        kept += 1
    return kept, limit, left_out


@compiled
def _empty(capacity: int, words: int) -> Layer:
    """Return a layer with room for so many ways."""
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
    """Return a layer with more room that begins with another."""
    longer, n = _empty(capacity, layer.sets.shape[1]), len(layer.lasts)
    longer.sets[:n] = layer.sets
    longer.lasts[:n] = layer.lasts
    longer.costs[:n] = layer.costs
    longer.spent[:n] = layer.spent
    longer.ends[:n] = layer.ends
    longer.parents[:n] = layer.parents
    return longer


@compiled
def _front(layer: Layer, count: int) -> Layer:
    """Return the first ways of a layer."""
    return Layer(
        layer.sets[:count].copy(),
        layer.lasts[:count].copy(),
        layer.costs[:count].copy(),
        layer.spent[:count].copy(),
        layer.ends[:count].copy(),
        layer.parents[:count].copy(),
    )


@compiled
def _open(visited: Words, preds: Words, node: int) -> bool:
    """Return whether a node is still to be visited, and all that comes before it was."""
    fits = not (visited[node >> 6] >> np.uint64(node & 63)) & np.uint64(1)
    for w in range(len(visited)):
        fits &= not preds[w] & ~visited[w]
    return fits


@compiled
def _charged(visited: Words, last: int, node: int, charges: Charges) -> float:
    """Return what a way is charged for its next node."""
    one = np.uint64(1)
    total = 0.0
    for c in range(charges.first[node], charges.first[node + 1]):
        has, lacks = charges.has[c], charges.lacks[c]
        if not (visited[has >> 6] >> np.uint64(has & 63)) & one or charges.after[c] == last:
            continue
        if lacks < 0 or not (visited[lacks >> 6] >> np.uint64(lacks & 63)) & one:
            total += charges.amounts[c]
    return total


@compiled
def _mixed(visited: Words, last: int) -> int:
    """Return a number in which the set and the last node are mixed."""
    mixed = np.uint64(last) * np.uint64(0x9E3779B97F4A7C15)
    for word in visited:
        mixed = (mixed ^ word) * np.uint64(0xFF51AFD7ED558CCD)
        mixed ^= mixed >> np.uint64(32)
    return int(mixed >> np.uint64(1))


@compiled
def _place(
    table: NDArray[np.int32], sets: Words, lasts: NDArray[np.int16], visited: Words, last: int
) -> int:
    """Return where in the table a way over a set to a node stands, or is to stand."""
    at = _mixed(visited, last) & (len(table) - 1)
    while table[at] >= 0:
        found = table[at]
        same = lasts[found] == last
        for w in range(len(visited)):
            same &= sets[found, w] == visited[w]
        if same:
            break
        at = (at + 1) & (len(table) - 1)
    return at


@compiled
def _table(layer: Layer, count: int, capacity: int) -> NDArray[np.int32]:
    """Return a fresh table of where the first ways of a layer are found, for so many of them."""
    size = 2
    while size < 2 * capacity:
        size *= 2
    table = np.full(size, -1, dtype=np.int32)
    for r in range(count):
        at = _mixed(layer.sets[r], layer.lasts[r]) & (size - 1)
        while table[at] >= 0:
            at = (at + 1) & (size - 1)
        table[at] = r
    return table


@compiled
def _left(visited: Words, near: Integers, j: int) -> int:
    """Return which of a node's neighbours are left to visit, one bit each."""
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
    """Return the ways that are one node longer.

    Parameters
    ----------
    layer
        The ways.
    arcs
        How they may go on.
    ahead
        The least spending to the end.
    charges
        What is spent beside arcs.
    limits
        Which ways are left out.

    Returns
    -------
    tuple
        The longer ways, the least to be spent to the end by what was left out for the width (inf
        where nothing was), and how many ways were looked at.
    """
    # What the inner loop reads is taken out of its tuple first: numba counts references to all
    # arrays of a tuple wherever it is passed on or read from, which made this four times as slow.
    # For the same reason what is decided there stands here and not in functions of tuples.
    sets, lasts, costs, spent, _, _ = layer
    first, heads, arc_costs, reduced, preds = arcs
    near, slot, least = ahead
    most, strict, room, width, whole = limits
    # A beam sorts out now and then what it does not keep.
    most_held = width if whole else 2 * width
    capacity = min(most_held, max(1024, 2 * len(lasts)))
    longer = _empty(capacity, sets.shape[1])
    new_sets, new_lasts, new_costs, new_spent, new_ends, parents = longer
    table = _table(longer, 0, capacity)
    trial = np.empty(sets.shape[1], dtype=np.uint64)
    count = made = 0
    dropped, limit = np.inf, room
    for s in range(len(lasts)):
        visited = sets[s]
        for a in range(first[lasts[s]], first[lasts[s] + 1]):
            j = heads[a]
            row = slot[j]
            if row < 0 or not _open(visited, preds[j], j):
                continue
            to_go = least[row, _left(visited, near, j)]
            spends = spent[s] + reduced[a]
            if spends >= most or spends + to_go >= room:
                continue
            spends += _charged(visited, lasts[s], j, charges)
            if strict and spends >= most:
                continue
            made += 1
            cost, end = costs[s] + arc_costs[a], spends + to_go
            if end >= limit:
                if end < room and end < dropped:
                    dropped = end
                continue
            trial[:] = visited
            trial[j >> 6] |= np.uint64(1) << np.uint64(j & 63)
            at = _place(table, new_sets, new_lasts, trial, j)
            found = table[at]
            if found >= 0:
                costlier = cost > new_costs[found]
                if costlier or (cost == new_costs[found] and spends >= new_spent[found]):
                    continue
            elif count == capacity:
                if capacity < most_held:
                    capacity = min(most_held, 2 * capacity)
                    longer = _grown(longer, capacity)
                    new_sets, new_lasts, new_costs, new_spent, new_ends, parents = longer
                elif whole:
                    return _front(longer, 0), 0.0, made
                else:
                    count, limit, left_out = _sort_out(longer, count, width)
                    dropped = min(dropped, left_out)
                table = _table(longer, count, capacity)
                at = _place(table, new_sets, new_lasts, trial, j)
                if end >= limit:
                    dropped = min(dropped, end)
                    continue
            if found < 0:
                found = table[at] = count
                new_sets[found] = trial
                new_lasts[found] = j
                count += 1
            new_costs[found] = cost
            new_spent[found] = spends
            new_ends[found] = end
            parents[found] = s
    if count > width:
        count, limit, left_out = _sort_out(longer, count, width)
        dropped = min(dropped, left_out)
    return _front(longer, count), dropped, made


@compiled
def meet(
    layer: Layer, arcs: Arcs, most: float, behind: Layer, room: float
) -> tuple[float, int, int]:
    """Return the cheapest order below `room` that ways from both ends make up, by one arc.

    Parameters
    ----------
    layer, arcs
        Ways from the start, and how they may go on.
    most
        Ways that may be longer by a node without spending so much are left to the next layer.
    behind
        Ways from the end. They name nodes backwards: n - 1 - i for node i.
    room
        What the order has to cost less than.

    Returns
    -------
    tuple
        Its cost, and the numbers of the two ways; -1 where there is none.
    """
    sets, lasts, costs, spent, _, _ = layer
    first, heads, arc_costs, reduced, preds = arcs
    n = len(preds)
    table = _table(behind, len(behind.lasts), len(behind.lasts))
    least, one, other = room, -1, -1
    rest = np.empty(sets.shape[1], dtype=np.uint64)
    for s in range(len(lasts)):
        rest[:] = np.uint64(0)
        for i in range(n):
            if not (sets[s, i >> 6] >> np.uint64(i & 63)) & np.uint64(1):
                mirror = n - 1 - i
                rest[mirror >> 6] |= np.uint64(1) << np.uint64(mirror & 63)
        for a in range(first[lasts[s]], first[lasts[s] + 1]):
            cost, head = costs[s] + arc_costs[a], heads[a]
            if cost >= least or not _open(sets[s], preds[head], head):
                continue
            if spent[s] + reduced[a] < most:
                continue
            found = table[_place(table, behind.sets, behind.lasts, rest, n - 1 - head)]
            if found >= 0 and cost + behind.costs[found] < least:
                least, one, other = cost + behind.costs[found], s, found
    return least, one, other
