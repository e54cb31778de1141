"""One layer of the dynamic program over feasible subsets, compiled.

Held and Karp (1962), Escudero (1988): of all ways to visit a set of nodes and end at one of them
only the cheapest matters. With precedence, only sets count that hold with a node all that comes
before it. A way that cannot be completed below a given cost is left out (Morin and Marsten, 1976):
what it has spent in reduced costs, and still must spend, says so. Cost and what is spent differ by
more than a constant, as an order may cross a cut more than once. So the cheapest way is kept, and
of equally cheap ones that which has spent least.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.compiled import compiled
from skillplan.solvers.ordering.relaxation.reduced_costs import Charges

Integers = NDArray[np.int64]
Floats = NDArray[np.float64]
Words = NDArray[np.uint64]
S = TypeVar("S", bound=np.generic)


@compiled
def _sort_out(
    sets: Words,
    lasts: NDArray[np.int16],
    costs: Floats,
    spent: Floats,
    ends: Floats,
    parents: NDArray[np.int32],
    count: int,
    width: int,
) -> tuple[int, float, float]:
    """Move to the front those of the first `count` ways that spend least to the end.

    Return how many, the most that one of them spends, and the least that one left out spends.
    """
    limit = np.partition(ends[:count], width - 1)[width - 1]
    kept, left_out = 0, np.inf
    for r in range(count):
        if ends[r] > limit or kept == width:
            left_out = min(left_out, ends[r])
            continue
        sets[kept] = sets[r]
        lasts[kept] = lasts[r]
        costs[kept] = costs[r]
        spent[kept] = spent[r]
        ends[kept] = ends[r]
        parents[kept] = parents[r]
        kept += 1
    return kept, limit, left_out


@compiled
def _grown(array: NDArray[S], capacity: int) -> NDArray[S]:
    """Return a longer array that begins with another."""
    longer = np.empty((capacity, *array.shape[1:]), dtype=array.dtype)
    longer[: len(array)] = array
    return longer


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
    table: NDArray[np.int32],
    sets: Words,
    lasts: NDArray[np.int16],
    visited: Words,
    last: int,
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
def expand(
    sets: Words,
    lasts: NDArray[np.int16],
    costs: Floats,
    spent: Floats,
    out_first: Integers,
    heads: Integers,
    arc_costs: Floats,
    arc_reduced: Floats,
    preds: Words,
    near: Integers,
    slot: Integers,
    ahead: Floats,
    charges: Charges,
    most: float,
    strict: bool,
    room: float,
    width: int,
    whole: bool,
) -> tuple[Words, NDArray[np.int16], Floats, Floats, Floats, NDArray[np.int32], float, int]:
    """Return the ways that are one node longer.

    Parameters
    ----------
    sets, lasts, costs, spent
        Sets visited, shape (s, words), where the ways end, what they cost and what they have
        spent in reduced costs, shape (s,) each.
    out_first, heads, arc_costs, arc_reduced
        The arcs by their tails.
    preds
        What comes before a node, shape (n, words).
    near, slot, ahead
        Least spending to the end: neighbours remembered, shape (n, bits); the row of a node in this
        layer or -1, shape (n,); by row and the neighbours that are left, shape (rows, 2 **
        bits).
    charges
        What is spent beside arcs.
    most, strict, room
        Ways are left out that spend `most` with their last arc, or where it is strict with the
        charges of their last node; or `room` to the end.
    width
        At most so many are kept, those that spend least to the end.
    whole
        Whether to give up, with nothing kept, where there are more.

    Returns
    -------
    tuple
        Sets, lasts, costs, what was spent, the least to be spent to the end, where each came
        from, the least to be spent to the end by what was left out for the width (inf where
        nothing was), and how many ways were looked at.
    """
    words = sets.shape[1]
    bits = near.shape[1]
    # A beam sorts out now and then what it does not keep.
    most_held = width if whole else 2 * width
    capacity = min(most_held, max(1024, 2 * len(sets)))
    size = 1
    while size < 2 * capacity:
        size *= 2
    table = np.full(size, -1, dtype=np.int32)
    new_sets = np.empty((capacity, words), dtype=np.uint64)
    new_lasts = np.empty(capacity, dtype=np.int16)
    new_costs = np.empty(capacity)
    new_spent = np.empty(capacity)
    new_ends = np.empty(capacity)
    parents = np.empty(capacity, dtype=np.int32)
    count = 0
    made = 0
    dropped = np.inf
    limit = room
    trial = np.empty(words, dtype=np.uint64)
    one = np.uint64(1)
    full = False
    for s in range(len(sets)):
        if full:
            break
        last = lasts[s]
        for a in range(out_first[last], out_first[last + 1]):
            j = heads[a]
            row = slot[j]
            if row < 0:
                continue
            if not _open(sets[s], preds[j], j):
                continue
            left = 0
            for b in range(bits):
                node = near[j, b]
                if node >= 0 and not (sets[s, node >> 6] >> np.uint64(node & 63)) & one:
                    left |= 1 << b
            cost = costs[s] + arc_costs[a]
            spends = spent[s] + arc_reduced[a]
            if spends >= most or spends + ahead[row, left] >= room:
                continue
            spends += _charged(sets[s], last, j, charges)
            if strict and spends >= most:
                continue
            end = spends + ahead[row, left]
            made += 1
            if end >= limit:
                if end < room and end < dropped:
                    dropped = end
                continue
            trial[:] = sets[s]
            trial[j >> 6] |= one << np.uint64(j & 63)
            at = _place(table, new_sets, new_lasts, trial, j)
            found = table[at]
            if found >= 0:
                dearer = cost > new_costs[found]
                if not dearer and (cost < new_costs[found] or spends < new_spent[found]):
                    new_costs[found] = cost
                    new_spent[found] = spends
                    new_ends[found] = end
                    parents[found] = s
                continue
            if count == capacity and capacity < most_held:
                capacity = min(most_held, 2 * capacity)
                new_sets = _grown(new_sets, capacity)
                new_lasts = _grown(new_lasts, capacity)
                new_costs = _grown(new_costs, capacity)
                new_spent = _grown(new_spent, capacity)
                new_ends = _grown(new_ends, capacity)
                parents = _grown(parents, capacity)
                while size < 2 * capacity:
                    size *= 2
                table = _table(new_sets, new_lasts, count, size)
                at = _place(table, new_sets, new_lasts, trial, j)
            elif count == capacity and whole:
                count, dropped, full = 0, 0.0, True
                break
            elif count == capacity:
                count, limit, left_out = _sort_out(
                    new_sets, new_lasts, new_costs, new_spent, new_ends, parents, count, width
                )
                dropped = min(dropped, left_out)
                table = _table(new_sets, new_lasts, count, size)
                at = _place(table, new_sets, new_lasts, trial, j)
                if end >= limit:
                    dropped = min(dropped, end)
                    continue
            table[at] = count
            new_sets[count] = trial
            new_lasts[count] = j
            new_costs[count] = cost
            new_spent[count] = spends
            new_ends[count] = end
            parents[count] = s
            count += 1
    if count > width:
        count, limit, left_out = _sort_out(
            new_sets, new_lasts, new_costs, new_spent, new_ends, parents, count, width
        )
        dropped = min(dropped, left_out)
    return (
        new_sets[:count].copy(),
        new_lasts[:count].copy(),
        new_costs[:count].copy(),
        new_spent[:count].copy(),
        new_ends[:count].copy(),
        parents[:count].copy(),
        dropped,
        made,
    )


@compiled
def meet(
    sets: Words,
    lasts: NDArray[np.int16],
    costs: Floats,
    spent: Floats,
    out_first: Integers,
    heads: Integers,
    arc_costs: Floats,
    arc_reduced: Floats,
    preds: Words,
    most: float,
    behind_sets: Words,
    behind_lasts: NDArray[np.int16],
    behind_costs: Floats,
    n: int,
    room: float,
) -> tuple[float, int, int]:
    """Return the cheapest order below `room` that ways from both ends make up, by one arc.

    The ways from the end name nodes backwards: n - 1 - i for node i. Ways from the start that may
    be longer by a node without spending `most` are left to the next layer.

    Returns
    -------
    tuple
        Its cost, and the numbers of the two ways; -1 where there is none.
    """
    size = 2
    while size < 2 * len(behind_sets):
        size *= 2
    table = _table(behind_sets, behind_lasts, len(behind_sets), size)
    least, one, other = room, -1, -1
    rest = np.empty(sets.shape[1], dtype=np.uint64)
    for s in range(len(sets)):
        rest[:] = np.uint64(0)
        for i in range(n):
            if not (sets[s, i >> 6] >> np.uint64(i & 63)) & np.uint64(1):
                mirror = n - 1 - i
                rest[mirror >> 6] |= np.uint64(1) << np.uint64(mirror & 63)
        last = lasts[s]
        for a in range(out_first[last], out_first[last + 1]):
            cost = costs[s] + arc_costs[a]
            if cost >= least or not _open(sets[s], preds[heads[a]], heads[a]):
                continue
            if spent[s] + arc_reduced[a] < most:
                continue
            j = n - 1 - heads[a]
            found = table[_place(table, behind_sets, behind_lasts, rest, j)]
            if found >= 0 and cost + behind_costs[found] < least:
                least, one, other = cost + behind_costs[found], s, found
    return least, one, other


@compiled
def _table(sets: Words, lasts: NDArray[np.int16], count: int, size: int) -> NDArray[np.int32]:
    """Return a fresh table of where ways are found."""
    table = np.full(size, -1, dtype=np.int32)
    for r in range(count):
        at = _mixed(sets[r], lasts[r]) & (size - 1)
        while table[at] >= 0:
            at = (at + 1) & (size - 1)
        table[at] = r
    return table
