"""One layer of the dynamic program over feasible subsets, compiled.

Held and Karp (1962), Escudero (1988): of all ways to visit a set of nodes and end at one of them
only the cheapest matters. With precedence, only sets count that hold with a node all that comes
before it. A way that cannot be completed below a given cost is left out (Morin and Marsten, 1976):
what it has spent in reduced costs, and still must spend, says so. Cost and what is spent differ by
more than a constant, as an order may cross a cut more than once. So the cheapest way is kept, and
of equally cheap ones that which has spent least.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.compiled import compiled

Integers = NDArray[np.int64]
Floats = NDArray[np.float64]
Words = NDArray[np.uint64]


@compiled
def words_of(relation: NDArray[np.bool_]) -> Words:
    """Return the columns of a relation as bit sets, shape (n, words)."""
    n = len(relation)
    words = np.zeros((n, (n + 63) // 64), dtype=np.uint64)
    for j in range(n):
        for i in range(n):
            if relation[i, j]:
                words[j, i >> 6] |= np.uint64(1) << np.uint64(i & 63)
    return words


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

    Returns
    -------
    tuple
        How many there are, the most that one of them spends, and the least that one spends
        which is left out.
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
    most: float,
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
    most, room
        Ways are left out that spend as much so far, or to the end.
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
            word, bit = j >> 6, one << np.uint64(j & 63)
            if sets[s, word] & bit:
                continue
            fits = True
            for w in range(words):
                if preds[j, w] & ~sets[s, w]:
                    fits = False
                    break
            if not fits:
                continue
            left = 0
            for b in range(bits):
                node = near[j, b]
                if node >= 0 and not (sets[s, node >> 6] >> np.uint64(node & 63)) & one:
                    left |= 1 << b
            cost = costs[s] + arc_costs[a]
            spends = spent[s] + arc_reduced[a]
            if spends >= most:
                continue
            end = spends + ahead[row, left]
            made += 1
            if end >= limit:
                if end < room and end < dropped:
                    dropped = end
                continue
            mixed = np.uint64(j) * np.uint64(0x9E3779B97F4A7C15)
            for w in range(words):
                trial[w] = sets[s, w]
                if w == word:
                    trial[w] |= bit
                mixed = (mixed ^ trial[w]) * np.uint64(0xFF51AFD7ED558CCD)
                mixed ^= mixed >> np.uint64(32)
            at = np.int64(mixed & np.uint64(size - 1))
            while True:
                found = table[at]
                if found < 0:
                    break
                same = new_lasts[found] == j
                if same:
                    for w in range(words):
                        if new_sets[found, w] != trial[w]:
                            same = False
                            break
                if same:
                    break
                at = (at + 1) & (size - 1)
            if found >= 0:
                if cost < new_costs[found] or (
                    cost == new_costs[found] and spends < new_spent[found]
                ):
                    new_costs[found] = cost
                    new_spent[found] = spends
                    new_ends[found] = end
                    parents[found] = s
                continue
            if count == capacity and capacity < most_held:
                capacity = min(most_held, 2 * capacity)
                more_sets = np.empty((capacity, words), dtype=np.uint64)
                more_sets[:count] = new_sets
                new_sets = more_sets
                more_lasts = np.empty(capacity, dtype=np.int16)
                more_lasts[:count] = new_lasts
                new_lasts = more_lasts
                more_costs = np.empty(capacity)
                more_costs[:count] = new_costs
                new_costs = more_costs
                more_spent = np.empty(capacity)
                more_spent[:count] = new_spent
                new_spent = more_spent
                more_ends = np.empty(capacity)
                more_ends[:count] = new_ends
                new_ends = more_ends
                more_parents = np.empty(capacity, dtype=np.int32)
                more_parents[:count] = parents
                parents = more_parents
                while size < 2 * capacity:
                    size *= 2
                table = _table(new_sets, new_lasts, count, size)
                at = np.int64(-1)
            elif count == capacity and whole:
                count, dropped, full = 0, 0.0, True
                break
            elif count == capacity:
                count, limit, left_out = _sort_out(
                    new_sets, new_lasts, new_costs, new_spent, new_ends, parents, count, width
                )
                dropped = min(dropped, left_out)
                table = _table(new_sets, new_lasts, count, size)
                at = np.int64(-1)
                if end >= limit:
                    dropped = min(dropped, end)
                    continue
            if at < 0:
                at = np.int64(mixed & np.uint64(size - 1))
                while table[at] >= 0:
                    at = (at + 1) & (size - 1)
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
    out_first: Integers,
    heads: Integers,
    arc_costs: Floats,
    behind_sets: Words,
    behind_lasts: NDArray[np.int16],
    behind_costs: Floats,
    n: int,
    room: float,
) -> tuple[float, int, int]:
    """Return the cheapest order below `room` that ways from both ends make up, by one arc.

    The ways from the end name nodes backwards: n - 1 - i for node i.

    Returns
    -------
    tuple
        Its cost, and the numbers of the two ways; -1 where there is none.
    """
    words = sets.shape[1]
    size = 2
    while size < 2 * len(behind_sets):
        size *= 2
    table = _table(behind_sets, behind_lasts, len(behind_sets), size)
    least, one, other = room, -1, -1
    rest = np.empty(words, dtype=np.uint64)
    for s in range(len(sets)):
        for w in range(words):
            rest[w] = np.uint64(0)
        for i in range(n):
            if not (sets[s, i >> 6] >> np.uint64(i & 63)) & np.uint64(1):
                mirror = n - 1 - i
                rest[mirror >> 6] |= np.uint64(1) << np.uint64(mirror & 63)
        last = lasts[s]
        for a in range(out_first[last], out_first[last + 1]):
            cost = costs[s] + arc_costs[a]
            if cost >= least:
                continue
            j = n - 1 - heads[a]
            if not (rest[j >> 6] >> np.uint64(j & 63)) & np.uint64(1):
                continue
            mixed = np.uint64(j) * np.uint64(0x9E3779B97F4A7C15)
            for w in range(words):
                mixed = (mixed ^ rest[w]) * np.uint64(0xFF51AFD7ED558CCD)
                mixed ^= mixed >> np.uint64(32)
            at = np.int64(mixed & np.uint64(size - 1))
            while table[at] >= 0:
                found = table[at]
                same = behind_lasts[found] == j
                if same:
                    for w in range(words):
                        if behind_sets[found, w] != rest[w]:
                            same = False
                            break
                if same:
                    if cost + behind_costs[found] < least:
                        least, one, other = cost + behind_costs[found], s, found
                    break
                at = (at + 1) & (size - 1)
    return least, one, other


@compiled
def _table(sets: Words, lasts: NDArray[np.int16], count: int, size: int) -> NDArray[np.int32]:
    """Return a fresh table of where ways are found."""
    table = np.full(size, -1, dtype=np.int32)
    for r in range(count):
        mixed = np.uint64(lasts[r]) * np.uint64(0x9E3779B97F4A7C15)
        for w in range(sets.shape[1]):
            mixed = (mixed ^ sets[r, w]) * np.uint64(0xFF51AFD7ED558CCD)
            mixed ^= mixed >> np.uint64(32)
        at = np.int64(mixed & np.uint64(size - 1))
        while table[at] >= 0:
            at = (at + 1) & (size - 1)
        table[at] = r
    return table
