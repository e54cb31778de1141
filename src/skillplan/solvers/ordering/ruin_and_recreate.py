"""Local search: tear strings out of an order and put their nodes back where they cost least.

Christiaens and Vanden Berghe, "Slack induction by string removals for vehicle routing problems"
(2020), for one path under precedence: a node goes back between the last that comes before it and
the first that comes after. Worse orders are accepted as in simulated annealing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.compiled import compiled

Integers = NDArray[np.int64]
Floats = NDArray[np.float64]
Booleans = NDArray[np.bool_]
Randoms = NDArray[np.uint64]


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
    """Put a node where it costs least, now and then overlooking a place; return the cost."""
    best, where = np.inf, -1
    least, at = np.inf, -1
    for position in range(size - 1, 0, -1):
        # The node would stand before order[position].
        here, there = order[position - 1], order[position]
        if before[there, node]:
            break
        if before[node, here]:
            # It belongs further ahead than all places seen so far.
            best, where = np.inf, -1
            least, at = np.inf, -1
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
def _move_string(
    start: Integers,
    trial: Integers,
    costs: Floats,
    before: Booleans,
    now: float,
    first: int,
    length: int,
) -> float:
    """Write into `trial` the order with a string where it costs least but here; return its cost.

    An exchange of two neighbouring strings: the path-preserving 3-exchange of Gambardella and
    Dorigo (2000).
    """
    n = len(start)
    last = first + length - 1
    head, tail = start[first], start[last]
    behind, ahead = start[first - 1], start[last + 1]
    freed = costs[behind, ahead] - costs[behind, head] - costs[tail, ahead]
    best, where = np.inf, -1
    for position in range(first - 1, 0, -1):
        # The string would stand before start[position].
        passed = start[position]
        blocked = False
        for i in range(first, last + 1):
            if before[passed, start[i]]:
                blocked = True
                break
        if blocked:
            break
        here = start[position - 1]
        added = costs[here, head] + costs[tail, passed] - costs[here, passed]
        if added < best:
            best, where = added, position
    for position in range(last + 1, n - 1):
        # The string would stand after start[position].
        passed = start[position]
        blocked = False
        for i in range(first, last + 1):
            if before[start[i], passed]:
                blocked = True
                break
        if blocked:
            break
        there = start[position + 1]
        added = costs[passed, head] + costs[tail, there] - costs[passed, there]
        if added < best:
            best, where = added, position
    if where < 0:
        return np.inf
    size = 0
    low, high = (where, last + 1) if where < first else (first, where + 1)
    for i in range(low):
        trial[i] = start[i]
    size = low
    if where < first:
        for i in range(first, last + 1):
            trial[size] = start[i]
            size += 1
        for i in range(where, first):
            trial[size] = start[i]
            size += 1
    else:
        for i in range(last + 1, where + 1):
            trial[size] = start[i]
            size += 1
        for i in range(first, last + 1):
            trial[size] = start[i]
            size += 1
    for i in range(high, n):
        trial[i] = start[i]
    cost: float = now + freed + best
    return cost


@compiled
def improve(
    start: Integers,
    best: Integers,
    costs: Floats,
    before: Booleans,
    near: Integers,
    iterations: int,
    hot: float,
    cold: float,
    moves: float,
    random: Randoms,
) -> float:
    """Improve the order `start` in place, keep the best of all in `best`, return its cost."""
    n = len(start)
    longest, average = 10.0, 10.0
    now = 0.0
    for i in range(n - 1):
        now += costs[start[i], start[i + 1]]
    least = 0.0
    for i in range(n - 1):
        least += costs[best[i], best[i + 1]]
    rank = np.empty(n, dtype=np.int64)
    for i in range(n):
        rank[start[i]] = i
    trial = np.empty(n, dtype=np.int64)
    gone = np.zeros(n, dtype=np.bool_)
    removed = np.empty(n, dtype=np.int64)
    keys = np.empty(n, dtype=np.float64)
    if n < 4:
        return least
    cooling = (cold / hot) ** (1.0 / max(1, iterations))
    heat = hot
    inner = n - 2
    longest = min(longest, float(inner))
    strings = 4.0 * average / (1.0 + longest) - 1.0
    for _ in range(iterations):
        heat *= cooling
        if _draw(random) < moves:
            length = 1 + int((inner - 1) * _draw(random) ** 3)
            first = 1 + int(_draw(random) * (inner - length + 1))
            cost = _move_string(start, trial, costs, before, now, first, length)
            if cost < now - heat * np.log(_draw(random) + 1e-300):
                now = cost
                for i in range(n):
                    start[i] = trial[i]
                    rank[trial[i]] = i
                if cost < least:
                    least = cost
                    for i in range(n):
                        best[i] = trial[i]
            continue
        many = int(_draw(random) * strings + 1.0)
        seed = 1 + int(_draw(random) * inner)
        count = 0
        torn = 0
        for neighbour in range(near.shape[1] + 1):
            if torn >= many:
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
            torn += 1
        size = 0
        for i in range(n):
            if not gone[start[i]]:
                trial[size] = start[i]
                size += 1
        way = _draw(random)
        for i in range(count):
            node = removed[i]
            gone[node] = False
            if way < 0.5:
                keys[i] = _draw(random)
            elif way < 0.75:
                keys[i] = float(rank[node])
            else:
                keys[i] = -float(rank[node])
        chosen = np.argsort(keys[:count])
        for i in range(count):
            _insert(trial, size, removed[chosen[i]], costs, before, random, 0.01)
            size += 1
        cost = 0.0
        for i in range(n - 1):
            cost += costs[trial[i], trial[i + 1]]
        if cost < now - heat * np.log(_draw(random) + 1e-300):
            now = cost
            for i in range(n):
                start[i] = trial[i]
                rank[trial[i]] = i
            if cost < least:
                least = cost
                for i in range(n):
                    best[i] = trial[i]
    return least
