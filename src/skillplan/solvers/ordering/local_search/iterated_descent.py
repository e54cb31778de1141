"""Iterated descent on orders with reversible strings: exchanges of arcs, and kicks.

Martin, Otto and Felten, "Large-step Markov chains for the traveling salesman problem" (1991): an
order is changed at random in one place, descends by exchanges of two and three arcs, and is
accepted as in simulated annealing. The exchanges are by Lin, "Computer solutions of the traveling
salesman problem" (1965), with neighbour lists and a queue of nodes with changed arcs; precedence
is checked as by Gambardella and Dorigo (2000). A kick swaps the first and the last of three
consecutive strings, or removes nodes and inserts them at the least cost.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.kernels import compiled
from skillplan.solvers.ordering.instance import NO_ARC, Booleans, Floats, Integers

Randoms = NDArray[np.uint64]
# Positions of the nodes, and the arrays that `note_reversals` writes.
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
    """Insert a node at the least cost, skipping positions at random; return the cost."""
    best, where, lowest, at = np.inf, -1, np.inf, -1
    for position in range(size - 1, 0, -1):
        # Place of the node: before order[position].
        here, there = order[position - 1], order[position]
        if before[there, node]:
            break
        if before[node, here]:
            # The node belongs before all positions so far.
            best, where, lowest, at = np.inf, -1, np.inf, -1
            continue
        added = costs[here, node] + costs[node, there] - costs[here, there]
        if added < lowest:
            lowest, at = added, position
        if added < best and (blink <= 0.0 or draw(random) >= blink):
            best, where = added, position
    if where < 0:
        best, where = lowest, at
    for position in range(size, where, -1):
        order[position] = order[position - 1]
    order[where] = node
    return best


@compiled
def cost_of(order: Integers, costs: Floats) -> float:
    """Return the cost of an order."""
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
    """Return True if no node from `first` to `middle` must come before one up to `last`."""
    for i in range(first, middle + 1):
        node = order[i]
        for k in range(follow.shape[1]):
            after = follow[node, k]
            if after < 0:
                break
            if middle < rank[after] <= last:
                return False
    return True


# Exchanges of three arcs of an order A B C D: A C B D, A C -B D, A -C B D and A -B -C D, where -B
# is B reversed. Ends of the strings are numbered along the order; each exchange lists the joined
# ends, and flags for swapping B and C, reversing B and reversing C.
_MATES = np.array([[3, 4, 5, 0, 1, 2], [3, 5, 4, 0, 2, 1], [4, 3, 5, 1, 0, 2], [2, 4, 0, 5, 1, 3]])
_CHANGES = np.array([[1, 0, 0], [1, 1, 0], [1, 0, 1], [0, 1, 1]], dtype=np.bool_)


def _kinds() -> Integers:
    """Return tables by end: its partner, and the partner of the partner's mate.

    The last table has the exchange, or -1; the mate of an end is the other end of its arc.
    """
    kinds = np.full((6, 6, 6), -1)
    for kind, mates in enumerate(_MATES):
        for end, other in enumerate(mates):
            kinds[end, other, mates[other ^ 1]] = kind
    return kinds


_KINDS = _kinds()
# Number of nearest nodes for new arcs.
_FIRST, _SECOND = 8, 6
# Least decrease that counts as an improvement.
_ROUNDING = 1e-9
# Share of kicks that swap strings, greatest length of strings, and number of attempts.
_SWAPS, _WINDOW, _TRIES = 0.8, 50, 50
# Greatest number of strings removed together, and of their nodes.
_STRINGS, _STRING = 3, 6
_BLINK = 0.1

# Order, positions of its nodes, costs and limits of reversals, and room for a string.
Order = tuple[Integers, Integers, Floats, Integers, Integers]
# Queue of nodes as a ring, membership flags, begin of the ring, and length.
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
    """Put both ends of the arc after a position into the queue."""
    _wake(queue, order[cut])
    _wake(queue, order[cut + 1])


@compiled
def _reverse(order: Integers, rank: Integers, room: Integers, first: int, last: int) -> None:
    """Reverse a string in place."""
    room[:] = order
    write_string(order, first, room, first, last, True)
    for i in range(first, last + 1):
        rank[order[i]] = i


@compiled
def _exchange(
    order: Integers, rank: Integers, room: Integers, p: int, q: int, r: int, kind: int
) -> None:
    """Exchange the arcs at three cuts."""
    swapped, first, second = _CHANGES[kind]
    room[:] = order
    write_string(order, p + 1 + (r - q if swapped else 0), room, p + 1, q, first)
    write_string(order, p + 1 + (0 if swapped else q - p), room, q + 1, r, second)
    for i in range(p + 1, r + 1):
        rank[order[i]] = i


@compiled
def _added(
    order: Integers, turning: Floats, costs: Floats, p: int, q: int, r: int, kind: int
) -> float:
    """Return the cost of the new arcs of an exchange, and of reversing its strings."""
    a, b, c, d, e, f = order[p], order[p + 1], order[q], order[q + 1], order[r], order[r + 1]
    first, second = turning[q] - turning[p + 1], turning[r] - turning[q + 1]
    if kind == 0:
        added = costs[a, d] + costs[e, b] + costs[c, f]
    elif kind == 1:
        added = costs[a, d] + costs[e, c] + costs[b, f] + first
    elif kind == 2:
        added = costs[a, e] + costs[d, b] + costs[c, f] + second
    else:
        added = costs[a, c] + costs[b, e] + costs[d, f] + first + second
    return float(added)


@compiled
def _allowed(
    order: Integers,
    rank: Integers,
    reach: Integers,
    follow: Integers,
    p: int,
    q: int,
    r: int,
    kind: int,
) -> bool:
    """Return True if precedence allows an exchange."""
    swapped, first, second = _CHANGES[kind]
    if (first and reach[q] > p + 1) or (second and reach[r] > q + 1):
        return False
    return not swapped or may_pass(order, follow, rank, p + 1, q, r)


@compiled
def _improved(
    order: Integers,
    rank: Integers,
    turning: Floats,
    reach: Integers,
    room: Integers,
    costs: Floats,
    near: Integers,
    apart: Floats,
    follow: Integers,
    changed: Integers,
    node: int,
) -> int:
    """Make the first improving exchange that joins a node with a near one.

    Return the number of exchanged arcs, 0 without an improvement; their ends are in `changed`.
    """
    # Arrays are separate and not in tuples, whose references numba counts, and there is one loop:
    # tuples made it four times as slow, a function for the third arc 1.6 times.
    n = len(order)
    for side in range(2):
        # First the arc after the node, then the arc before it.
        cut = rank[node] - side
        if not 0 <= cut < n - 1:
            continue
        saved = costs[order[cut], order[cut + 1]]
        for k in range(min(_FIRST, near.shape[1])):
            gain = saved - apart[node, k]
            if gain <= _ROUNDING:
                break
            for its_side in range(2):
                its_cut = rank[near[node, k]] - its_side
                if not 0 <= its_cut < n - 1 or its_cut == cut:
                    continue
                its_cost = costs[order[its_cut], order[its_cut + 1]]
                low, high = min(cut, its_cut), max(cut, its_cut)
                if its_side == side and high > low + 1 and reach[high] <= low + 1:
                    added = costs[order[low], order[high]]
                    added += costs[order[low + 1], order[high + 1]] - saved - its_cost
                    if added + turning[high] - turning[low + 1] < -_ROUNDING:
                        changed[0], changed[1] = order[low], order[low + 1]
                        changed[2], changed[3] = order[high], order[high + 1]
                        _reverse(order, rank, room, low + 1, high)
                        return 2
                gone = saved + its_cost
                loose = order[its_cut + 1 - its_side]
                for m in range(min(_SECOND, near.shape[1])):
                    if gain + its_cost - apart[loose, m] <= _ROUNDING:
                        break
                    for side3 in range(2):
                        third = rank[near[loose, m]] - side3
                        if not 0 <= third < n - 1 or third in (cut, its_cut):
                            continue
                        p, r = min(low, third), max(high, third)
                        q = low + high + third - p - r
                        place = (cut > its_cut) + (cut > third)
                        its_place = (cut < its_cut) + (its_cut > third)
                        end, its_end = 2 * place + side, 2 * its_place + its_side
                        kind = _KINDS[end, its_end, 2 * (3 - place - its_place) + side3]
                        if kind < 0:
                            continue
                        added = _added(order, turning, costs, p, q, r, kind) - gone
                        if added - costs[order[third], order[third + 1]] >= -_ROUNDING:
                            continue
                        if _allowed(order, rank, reach, follow, p, q, r, kind):
                            changed[0], changed[1] = order[p], order[p + 1]
                            changed[2], changed[3] = order[q], order[q + 1]
                            changed[4], changed[5] = order[r], order[r + 1]
                            _exchange(order, rank, room, p, q, r, kind)
                            return 3
    return 0


@compiled
def _descend(
    at: Order, costs: Floats, near: Integers, apart: Floats, follow: Integers, queue: Queue
) -> None:
    """Make exchanges until no queued node has a cheaper one; the queue is empty then."""
    order, rank, turning, reach, room = at
    ring, waiting, ends = queue
    changed = np.empty(6, dtype=np.int64)
    note_reversals(order, costs, follow, (rank, turning, reach))
    while ends[1] > 0:
        node = ring[ends[0]]
        ends[0] = (ends[0] + 1) % len(ring)
        ends[1] -= 1
        waiting[node] = False
        while True:
            arcs = _improved(
                order, rank, turning, reach, room, costs, near, apart, follow, changed, node
            )
            if arcs == 0:
                break
            for i in range(2 * arcs):
                _wake(queue, changed[i])
            note_reversals(order, costs, follow, (rank, turning, reach))


@compiled
def _swap_ends(at: Order, follow: Integers, queue: Queue, random: Randoms) -> bool:
    """Swap the first and the last of three consecutive strings, if precedence allows."""
    order, rank, room = at[0], at[1], at[4]
    n = len(order)
    for _ in range(_TRIES):
        width = 4 + int(draw(random) * draw(random) * min(_WINDOW, n - 6))
        low = int(draw(random) * (n - 2 - width))
        high = low + width
        first = low + 1 + int(draw(random) * (width - 2))
        two = low + 1 + int(draw(random) * (width - 2))
        a, b = min(first, two), max(first, two)
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
    """Remove strings about near nodes, and insert their nodes at the least cost."""
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
        # Changed arcs are at removed nodes or at their neighbours.
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
    """Kick the order `start` in place repeatedly, and keep the best order in `best`.

    Parameters
    ----------
    start
        Order, shape (n,), n >= 8; changed in place.
    best
        Best order, shape (n,); changed in place.
    costs, before
        See `OrderingInstance`.
    near
        Nearest nodes of each node, nearest first, shape (n, k).
    follow
        Direct successors of each node by precedence, padded with -1, shape (n, f).
    temperature, last_temperature
        Temperatures of the first and the last kick, in the unit of costs, > 0.
    random
        State of the generator, shape (1,); changed in place.

    Returns
    -------
    float
        Cost of the best order.
    """
    n = len(start)
    order = start.copy()
    at = (order, np.argsort(order), np.empty(n), np.empty_like(order), np.empty_like(order))
    ring, waiting = order.copy(), np.ones(n, dtype=np.bool_)
    queue = (ring, waiting, np.array([0, n]))
    apart = np.empty(near.shape)
    for node in range(n):
        for k in range(near.shape[1]):
            apart[node, k] = min(costs[node, near[node, k]], costs[near[node, k], node])
    _descend(at, costs, near, apart, follow, queue)
    start[:] = order
    now, lowest = cost_of(start, costs), cost_of(best, costs)
    if now < lowest:
        lowest = now
        best[:] = start
    cooling = (last_temperature / temperature) ** (1.0 / max(1, kicks))
    for _ in range(kicks):
        temperature *= cooling
        order[:] = start
        at[1][order] = np.arange(n)
        if draw(random) >= _SWAPS or not _swap_ends(at, follow, queue, random):
            _insert_anew(at, costs, before, near, queue, random)
        _descend(at, costs, near, apart, follow, queue)
        cost = cost_of(order, costs)
        if cost < now - temperature * np.log(draw(random) + 1e-300):
            now = cost
            start[:] = order
            if cost < lowest:
                lowest = cost
                best[:] = order
    return lowest
