"""Iterated descent on orders whose strings may be reversed: exchanges of arcs, and kicks.

Martin, Otto and Felten, "Large-step Markov chains for the traveling salesman problem" (1991): an
order is changed at random in one place, descends by exchanges of two and three arcs, and is kept
as in simulated annealing. The exchanges are those of Lin, "Computer solutions of the traveling
salesman problem" (1965), with neighbour lists and a queue of nodes whose arcs have changed;
precedence is checked as by Gambardella and Dorigo (2000). A kick swaps the first and the last of
three strings in a row, or removes nodes and inserts them where they cost least.
"""

from __future__ import annotations

import numpy as np

from skillplan.solvers.compiled import compiled
from skillplan.solvers.ordering.local_search.order_moves import (
    Booleans,
    Floats,
    Integers,
    Randoms,
    cost_of,
    draw,
    insert,
    may_pass,
    note_reversals,
    write_string,
)

# The exchanges of three arcs of an order A B C D. Ends of the strings are numbered along the
# order; of each exchange, to which end the new arc from each goes, whether B and C are swapped, and
# whether B and C are reversed.
_MATES = np.array([[3, 4, 5, 0, 1, 2], [3, 5, 4, 0, 2, 1], [4, 3, 5, 1, 0, 2], [2, 4, 0, 5, 1, 3]])
_CHANGES = np.array([[1, 0, 0], [1, 1, 0], [1, 0, 1], [0, 1, 1]], dtype=np.bool_)
# New arcs go to so many of the nearest nodes.
_FIRST, _SECOND = 8, 6
# A cost that falls by less is the same.
_ROUNDING = 1e-9
# Share of the kicks that swap strings; their nodes, at most; and how often it is tried.
_SWAPS, _WINDOW, _TRIES = 0.8, 50, 50
# Strings that are removed together, at most; and the nodes of each.
_STRINGS, _STRING = 3, 6
_BLINK = 0.1

# Of an order: it and the positions of its nodes; what reversing costs and up to where it may; and
# room for a string.
Order = tuple[Integers, Integers, Floats, Integers, Integers]
# Nodes to look at, as a ring; whether each is among them; where the ring begins, and how many.
Queue = tuple[Integers, Booleans, Integers]


@compiled
def _wake(queue: Queue, node: int) -> None:
    """Put a node into the queue."""
    ring, waiting, ends = queue
    if not waiting[node]:
        waiting[node] = True
        ring[(ends[0] + ends[1]) % len(ring)] = node
        ends[1] += 1


@compiled
def _wake_ends(queue: Queue, order: Integers, cut: int) -> None:
    """Put both ends of the arc behind a position into the queue."""
    _wake(queue, order[cut])
    _wake(queue, order[cut + 1])


@compiled
def _turned(at: Order, costs: Floats, queue: Queue, one: int, other: int) -> bool:
    """Reverse the string between two cuts if that is cheaper and allowed."""
    order, rank, turning, reach, room = at
    p, r = min(one, other), max(one, other)
    if r <= p + 1 or reach[r] > p + 1:
        return False
    added = costs[order[p], order[r]] + costs[order[p + 1], order[r + 1]]
    added -= costs[order[p], order[p + 1]] + costs[order[r], order[r + 1]]
    if added + turning[r] - turning[p + 1] >= -_ROUNDING:
        return False
    _wake_ends(queue, order, p)
    _wake_ends(queue, order, r)
    room[:] = order
    write_string(order, p + 1, room, p + 1, r, True)
    for i in range(p + 1, r + 1):
        rank[order[i]] = i
    return True


@compiled
def _exchanged(
    at: Order, costs: Floats, follow: Integers, queue: Queue, cuts: Integers, kind: int
) -> bool:
    """Exchange the arcs at three cuts, in their order, if that is cheaper and allowed."""
    order, rank, turning, reach, room = at
    p, q, r = cuts
    swapped, first, second = _CHANGES[kind]
    added = 0.0
    for end in range(6):
        cut, mate = cuts[end // 2], _MATES[kind, end]
        if end % 2 == 0:
            added -= costs[order[cut], order[cut + 1]]
        if end < mate:
            added += costs[order[cut + end % 2], order[cuts[mate // 2] + mate % 2]]
    if first:
        added += turning[q] - turning[p + 1]
    if second:
        added += turning[r] - turning[q + 1]
    if added >= -_ROUNDING or (first and reach[q] > p + 1) or (second and reach[r] > q + 1):
        return False
    if swapped and not may_pass(order, follow, rank, p + 1, q, r):
        return False
    for cut in cuts:
        _wake_ends(queue, order, cut)
    room[:] = order
    write_string(order, p + 1 + (r - q if swapped else 0), room, p + 1, q, first)
    write_string(order, p + 1 + (0 if swapped else q - p), room, q + 1, r, second)
    for i in range(p + 1, r + 1):
        rank[order[i]] = i
    return True


@compiled
def _third_found(
    at: Order,
    costs: Floats,
    near: Integers,
    follow: Integers,
    queue: Queue,
    one: tuple[int, int],
    two: tuple[int, int],
    gain: float,
) -> bool:
    """Look for the third cut of an exchange, and make it.

    Parameters
    ----------
    at, costs, near, follow, queue
        As of `descend`.
    one, two
        Cuts, and which end of each, 0 or 1, is joined with that of the other.
    gain
        What is saved so far.
    """
    order, rank = at[0], at[1]
    n = len(order)
    cuts = np.empty(3, dtype=np.int64)
    cut1, side1 = one
    cut2, side2 = two
    loose = order[cut2 + 1 - side2]
    for node in near[loose, :_SECOND]:
        if gain - min(costs[loose, node], costs[node, loose]) <= _ROUNDING:
            break
        for side3 in range(2):
            cut3 = rank[node] - side3
            if not 0 <= cut3 < n - 1 or cut3 in (cut1, cut2):
                continue
            place1 = int(cut2 < cut1) + int(cut3 < cut1)
            place2 = int(cut1 < cut2) + int(cut3 < cut2)
            place3 = 3 - place1 - place2
            cuts[place1], cuts[place2], cuts[place3] = cut1, cut2, cut3
            for kind in range(4):
                mates = _MATES[kind]
                if (
                    mates[2 * place1 + side1] == 2 * place2 + side2
                    and mates[2 * place2 + 1 - side2] == 2 * place3 + side3
                    and _exchanged(at, costs, follow, queue, cuts, kind)
                ):
                    return True
    return False


@compiled
def _improved(
    at: Order, costs: Floats, near: Integers, follow: Integers, queue: Queue, node: int
) -> bool:
    """Make the first exchange found that joins a node with a near one and is cheaper."""
    order, rank = at[0], at[1]
    n = len(order)
    for side in range(2):
        # Of its two arcs the one behind it, and the one before it.
        cut = rank[node] - side
        if not 0 <= cut < n - 1:
            continue
        saved = costs[order[cut], order[cut + 1]]
        for other in near[node, :_FIRST]:
            gain = saved - min(costs[node, other], costs[other, node])
            if gain <= _ROUNDING:
                break
            for its_side in range(2):
                its_cut = rank[other] - its_side
                if not 0 <= its_cut < n - 1 or its_cut == cut:
                    continue
                if its_side == side and _turned(at, costs, queue, cut, its_cut):
                    return True
                both = gain + costs[order[its_cut], order[its_cut + 1]]
                one, two = (cut, side), (its_cut, its_side)
                if _third_found(at, costs, near, follow, queue, one, two, both):
                    return True
    return False


@compiled
def _descend(at: Order, costs: Floats, near: Integers, follow: Integers, queue: Queue) -> None:
    """Make exchanges until no node in the queue has a cheaper one; the queue is empty then."""
    ring, waiting, ends = queue
    note_reversals(at[0], costs, follow, (at[1], at[2], at[3]))
    while ends[1] > 0:
        node = ring[ends[0]]
        ends[0] = (ends[0] + 1) % len(ring)
        ends[1] -= 1
        waiting[node] = False
        while _improved(at, costs, near, follow, queue, node):
            note_reversals(at[0], costs, follow, (at[1], at[2], at[3]))


@compiled
def _swap_ends(at: Order, follow: Integers, queue: Queue, random: Randoms) -> bool:
    """Swap the first and the last of three strings in a row, if precedence allows some such."""
    order, rank, room = at[0], at[1], at[4]
    n = len(order)
    for _ in range(_TRIES):
        width = 4 + int(draw(random) * draw(random) * min(_WINDOW, n - 6))
        low = int(draw(random) * (n - 2 - width))
        high = low + width
        one = low + 1 + int(draw(random) * (width - 2))
        two = low + 1 + int(draw(random) * (width - 2))
        a, b = min(one, two), max(one, two)
        if (
            a == b
            or not may_pass(order, follow, rank, low + 1, b, high)
            or not may_pass(order, follow, rank, low + 1, a, b)
        ):
            continue
        room[:] = order
        write_string(order, low + 1, room, b + 1, high, False)
        write_string(order, low + 1 + high - b, room, a + 1, b, False)
        write_string(order, low + 1 + high - a, room, low + 1, a, False)
        for i in range(low + 1, high + 1):
            rank[order[i]] = i
        for cut in (low, low + high - b, low + high - a, high):
            _wake_ends(queue, order, cut)
        return True
    return False


@compiled
def _insert_anew(
    at: Order, costs: Floats, before: Booleans, near: Integers, queue: Queue, random: Randoms
) -> None:
    """Remove strings about near nodes, and insert their nodes where they cost least."""
    order, rank, gone = at[0], at[1], at[4]
    n = len(order)
    gone[:] = 0
    removed = np.empty(n, dtype=np.int64)
    count, many = 0, 1 + int(draw(random) * _STRINGS)
    seed = 1 + int(draw(random) * (n - 2))
    for neighbour in range(near.shape[1] + 1):
        node = seed if neighbour == 0 else near[seed, neighbour - 1]
        if node == 0 or node == n - 1 or gone[node]:
            continue
        length = 1 + int(draw(random) * min(_STRING, n - 3))
        first = max(1, min(rank[node] - int(draw(random) * length), n - 1 - length))
        for i in range(first, first + length):
            if not gone[order[i]]:
                gone[order[i]] = 1
                removed[count] = order[i]
                count += 1
        many -= 1
        if many == 0:
            break
    size = 0
    for i in range(n):
        if not gone[order[i]]:
            order[size] = order[i]
            size += 1
    for i in range(count):
        chosen = i + int(draw(random) * (count - i))
        removed[i], removed[chosen] = removed[chosen], removed[i]
        insert(order, size, removed[i], costs, before, random, _BLINK)
        size += 1
    rank[order] = np.arange(n)
    for i in range(n - 1):
        # Arcs that are gone and have come are at nodes that were removed, or were beside them.
        if gone[order[i]] or gone[order[i + 1]]:
            _wake_ends(queue, order, i)


@compiled
def descend_again(
    start: Integers,
    best: Integers,
    costs: Floats,
    before: Booleans,
    near: Integers,
    follow: Integers,
    kicks: int,
    temperature: float,
    last_temperature: float,
    random: Randoms,
) -> float:
    """Kick the order `start` in place again and again; keep the best of all in `best`.

    Parameters
    ----------
    start
        The order, shape (n,), n >= 8; changed in place.
    best
        The best order so far, shape (n,); changed in place.
    costs, before
        Those of an `OrderingInstance`.
    near
        The nearest nodes of each, nearest first, shape (n, k).
    follow
        Nodes right after each by precedence, filled up with -1, shape (n, f).
    kicks
        How often.
    temperature, last_temperature
        Of the first and of the last kick, in the unit of costs, > 0.
    random
        State of the generator, shape (1,); changed in place.

    Returns
    -------
    float
        What the best order costs.
    """
    n = len(start)
    order = start.copy()
    at = (order, np.argsort(order), np.empty(n), np.empty_like(order), np.empty_like(order))
    ring, waiting = order.copy(), np.ones(n, dtype=np.bool_)
    queue = (ring, waiting, np.array([0, n]))
    _descend(at, costs, near, follow, queue)
    start[:] = order
    now, least = cost_of(start, costs), cost_of(best, costs)
    if now < least:
        least = now
        best[:] = start
    cooling = (last_temperature / temperature) ** (1.0 / max(1, kicks))
    for _ in range(kicks):
        temperature *= cooling
        order[:] = start
        at[1][order] = np.arange(n)
        if draw(random) >= _SWAPS or not _swap_ends(at, follow, queue, random):
            _insert_anew(at, costs, before, near, queue, random)
        _descend(at, costs, near, follow, queue)
        cost = cost_of(order, costs)
        if cost < now - temperature * np.log(draw(random) + 1e-300):
            now = cost
            start[:] = order
            if cost < least:
                least = cost
                best[:] = order
    return least
