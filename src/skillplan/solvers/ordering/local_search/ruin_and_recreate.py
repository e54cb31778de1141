"""Ruin and recreate by string removal (SISR), and 3-exchange: local search under precedence.

SISR removes strings of an order and reinserts their nodes greedily: Christiaens and Vanden Berghe,
"Slack induction by string removals for vehicle routing problems" (2020), for one path. The other
move is the path-preserving 3-exchange of Gambardella and Dorigo (2000), and where costs hardly
depend on the direction also with reversed strings; new arcs go to near nodes. Worse orders are
accepted as in simulated annealing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.compiled import compiled
from skillplan.solvers.ordering.instance import NO_ARC

Integers = NDArray[np.int64]
Floats = NDArray[np.float64]
Booleans = NDArray[np.bool_]
Randoms = NDArray[np.uint64]
# Of an order: the positions of the nodes, and what `_note` says of reversing strings.
Notes = tuple[Integers, Floats, Integers]

# The 3-exchanges of an order A B C D. Of each: the new arcs between the six ends of the strings,
# which are numbered along the order; whether B and C are swapped, and whether B and C are
# reversed. The last reverses B and C as one.
_ARCS = np.array(
    [
        [[0, 3], [4, 1], [2, 5]],
        [[0, 3], [4, 2], [1, 5]],
        [[0, 4], [3, 1], [2, 5]],
        [[0, 2], [1, 4], [3, 5]],
        [[0, 4], [1, 5], [3, 2]],
    ]
)
_CHANGES = np.array([[1, 0, 0], [1, 1, 0], [1, 0, 1], [0, 1, 1], [1, 1, 1]], dtype=np.bool_)
# So many exchanges are tried in one move, with so many of the nearest nodes.
_TRIES = 128
_NEAREST = 6


@compiled
def _draw(state: Randoms) -> float:
    """Return a number in [0, 1): xorshift64*, Vigna (2016)."""
    x = state[0]
    x ^= x >> np.uint64(12)
    x ^= x << np.uint64(25)
    x ^= x >> np.uint64(27)
    state[0] = x
    return float((x * np.uint64(2685821657736338717)) >> np.uint64(11)) / 9007199254740992.0


@compiled
def _insert(
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
        if added < best and (blink <= 0.0 or _draw(random) >= blink):
            best, where = added, position
    if where < 0:
        best, where = least, at
    for position in range(size, where, -1):
        order[position] = order[position - 1]
    order[where] = node
    return best


@compiled
def _cost(order: Integers, costs: Floats) -> float:
    """Return what an order costs."""
    cost = 0.0
    for i in range(len(order) - 1):
        cost += costs[order[i], order[i + 1]]
    return cost


@compiled
def _write(trial: Integers, at: int, start: Integers, first: int, last: int, reverse: bool) -> None:
    """Write a string of one order into another, reversed on demand."""
    for i in range(last - first + 1):
        trial[at + i] = start[last - i] if reverse else start[first + i]


@compiled
def _barred(
    start: Integers, before: Booleans, first: int, last: int, passed: int, step: int
) -> bool:
    """Whether precedence forbids a string to pass a node before it (-1) or after it (1)."""
    for i in range(first, last + 1):
        if before[passed, start[i]] if step < 0 else before[start[i], passed]:
            return True
    return False


@compiled
def _move_string(
    start: Integers,
    trial: Integers,
    costs: Floats,
    before: Booleans,
    now: float,
    first: int,
    length: int,
) -> float:
    """Move a string to the cheapest other position; write the order to `trial`, return its cost."""
    n = len(start)
    last = first + length - 1
    head, tail = start[first], start[last]
    behind, ahead = start[first - 1], start[last + 1]
    freed = costs[behind, ahead] - costs[behind, head] - costs[tail, ahead]
    best, where = np.inf, -1
    for step in (-1, 1):
        position = first - 1 if step < 0 else last + 1
        while 0 < position < n - 1:
            # The string would stand right beyond this node.
            passed, beyond = start[position], start[position + step]
            one, other = (beyond, passed) if step < 0 else (passed, beyond)
            if _barred(start, before, first, last, passed, step):
                break
            added = costs[one, head] + costs[tail, other] - costs[one, other]
            if added < best:
                best, where = added, position
            position += step
    if where < 0:
        return np.inf
    low, high = (where, last) if where < first else (first, where)
    middle = first if where < first else last + 1
    trial[:] = start
    _write(trial, low, start, middle, high, False)
    _write(trial, low + high + 1 - middle, start, low, middle - 1, False)
    cost: float = now + freed + best
    return cost


@compiled
def _note(order: Integers, costs: Floats, follow: Integers, notes: Notes) -> None:
    """Set `turning` and `reach`: reversing from i to j costs turning[j] - turning[i] more.

    It is allowed if reach[j] <= i.
    """
    rank, turning, reach = notes
    reach[:] = 0
    turning[0] = 0.0
    for i in range(len(order)):
        for node in follow[order[i]]:
            if node < 0:
                break
            reach[rank[node]] = i + 1
    for i in range(1, len(order)):
        forth, back = costs[order[i - 1], order[i]], costs[order[i], order[i - 1]]
        turning[i] = turning[i - 1]
        if max(forth, back) < NO_ARC:
            turning[i] += back - forth
        else:
            reach[i] = i
        reach[i] = max(reach[i], reach[i - 1])


@compiled
def _passes(
    order: Integers, follow: Integers, rank: Integers, first: int, middle: int, last: int
) -> bool:
    """Whether no node from `first` to `middle` must come before one up to `last`."""
    for i in range(first, middle + 1):
        for node in follow[order[i]]:
            if node < 0:
                break
            if middle < rank[node] <= last:
                return False
    return True


@compiled
def _exchange_arcs(
    start: Integers,
    trial: Integers,
    costs: Floats,
    near: Integers,
    follow: Integers,
    notes: Notes,
    most: float,
    random: Randoms,
) -> float:
    """Exchange three arcs for others that cost less than `most` more, into `trial`.

    Two of the new arcs go to near nodes. Return the order's cost, inf where no try succeeded.
    """
    n = len(start)
    rank, turning, reach = notes
    width = min(_NEAREST, near.shape[1])
    cuts = np.empty(3, dtype=np.int64)
    for _ in range(_TRIES):
        kind = int(_draw(random) * len(_ARCS))
        arcs = _ARCS[kind]
        one, two = arcs[int(_draw(random) * (2 if kind == 4 else 3))]
        node = int(_draw(random) * n)
        other = near[node, int(_draw(random) * width)]
        if (rank[node] < rank[other]) != (one < two):
            node, other = other, node
        cuts[one // 2] = rank[node] - one % 2
        cuts[two // 2] = rank[other] - two % 2
        if kind == 4:
            cuts[1] = cuts[0] + 1
        else:
            free = 3 - one // 2 - two // 2
            end = 2 * free + int(_draw(random) * 2)
            for arc in arcs:
                if end in (arc[0], arc[1]):
                    mate = arc[0] + arc[1] - end
            at = cuts[mate // 2] + mate % 2
            if at < 0 or at >= n:
                continue
            third = near[start[at], int(_draw(random) * width)]
            cuts[free] = rank[third] - end % 2
        p, q, r = int(cuts[0]), int(cuts[1]), int(cuts[2])
        if not 0 <= p < q < r < n - 1:
            continue
        change = _CHANGES[kind]
        swapped, first, second = bool(change[0]), bool(change[1]), bool(change[2])
        added = 0.0
        for k in range(3):
            arc, cut = arcs[k], cuts[k]
            here, there = cuts[arc[0] // 2] + arc[0] % 2, cuts[arc[1] // 2] + arc[1] % 2
            added += costs[start[here], start[there]] - costs[start[cut], start[cut + 1]]
        if first:
            added += turning[q] - turning[p + 1]
        if second:
            added += turning[r] - turning[q + 1]
        if added >= most or (first and reach[q] > p + 1) or (second and reach[r] > q + 1):
            continue
        if swapped and not _passes(start, follow, rank, p + 1, q, r):
            continue
        trial[:] = start
        _write(trial, p + 1 + (r - q if swapped else 0), start, p + 1, q, first)
        _write(trial, p + 1 + (0 if swapped else q - p), start, q + 1, r, second)
        return _cost(trial, costs)
    return np.inf


@compiled
def improve(
    start: Integers,
    best: Integers,
    costs: Floats,
    before: Booleans,
    near: Integers,
    follow: Integers,
    iterations: int,
    temperature: float,
    last_temperature: float,
    exchanges: float,
    moves: float,
    random: Randoms,
) -> float:
    """Improve the order `start` in place, keep the best of all in `best`, return its cost.

    Parameters
    ----------
    start
        The order, shape (n,); changed in place.
    best
        The best order so far, shape (n,); changed in place.
    costs, before
        Those of an `OrderingInstance`.
    near
        The nearest nodes of each, shape (n, k).
    follow
        Nodes right after each by precedence, filled up with -1, shape (n, f).
    iterations
        Moves to make.
    temperature, last_temperature
        Of the first and of the last move, in the unit of costs, > 0.
    exchanges
        Share of moves that exchange arcs, in [0, 1].
    moves
        Of the others, the share that moves a string as it is, in [0, 1].
    random
        State of the generator, shape (1,); changed in place.
    """
    n = len(start)
    now, least = _cost(start, costs), _cost(best, costs)
    if n < 4:
        return least
    rank = np.argsort(start)
    notes = (rank, np.empty(n), np.empty_like(start))
    noted = False
    trial, removed = np.empty_like(start), np.empty_like(start)
    gone = np.zeros(n, dtype=np.bool_)
    keys = np.empty(n)
    cooling = (last_temperature / temperature) ** (1.0 / max(1, iterations))
    inner = n - 2
    longest = min(10.0, inner)
    strings = 40.0 / (1.0 + longest) - 1.0
    for _ in range(iterations):
        temperature *= cooling
        most = -temperature * np.log(_draw(random) + 1e-300)
        if _draw(random) < exchanges:
            if not noted:
                _note(start, costs, follow, notes)
                noted = True
            cost = _exchange_arcs(start, trial, costs, near, follow, notes, most, random)
        elif _draw(random) < moves:
            length = 1 + int((inner - 1) * _draw(random) ** 3)
            first = 1 + int(_draw(random) * (inner - length + 1))
            cost = _move_string(start, trial, costs, before, now, first, length)
        else:
            many = int(_draw(random) * strings + 1.0)
            seed = 1 + int(_draw(random) * inner)
            count = 0
            for neighbour in range(near.shape[1] + 1):
                if many < 1:
                    break
                node = seed if neighbour == 0 else near[seed, neighbour - 1]
                if node == 0 or node == n - 1 or gone[node]:
                    continue
                length = 1 + int(_draw(random) * longest)
                first = rank[node] - int(_draw(random) * length)
                first = max(1, min(first, n - 1 - length))
                for position in range(first, min(first + length, n - 1)):
                    other = start[position]
                    if not gone[other]:
                        gone[other] = True
                        removed[count] = other
                        count += 1
                many -= 1
            size = 0
            for i in range(n):
                if not gone[start[i]]:
                    trial[size] = start[i]
                    size += 1
            sorting = _draw(random)
            for i in range(count):
                node = removed[i]
                gone[node] = False
                place = rank[node] if sorting < 0.75 else -rank[node]
                keys[i] = _draw(random) if sorting < 0.5 else place
            chosen = np.argsort(keys[:count])
            for i in range(count):
                _insert(trial, size, removed[chosen[i]], costs, before, random, 0.01)
                size += 1
            cost = _cost(trial, costs)
        if cost < now + most:
            now = cost
            noted = False
            start[:] = trial
            for i in range(n):
                rank[trial[i]] = i
            if cost < least:
                least = cost
                best[:] = trial
    return least
