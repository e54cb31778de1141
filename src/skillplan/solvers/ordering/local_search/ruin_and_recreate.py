"""Ruin and recreate by string removal (SISR), and moves of whole strings.

SISR removes strings of an order and reinserts their nodes greedily: Christiaens and Vanden Berghe,
"Slack induction by string removals for vehicle routing problems" (2020), for one path. Worse orders
are accepted as in simulated annealing.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from skillplan.solvers.kernels import compiled
from skillplan.solvers.ordering.instance import NO_ARC, Booleans, Floats, Integers, OrderingInstance
from skillplan.solvers.ordering.local_search.iterated_descent import (
    Randoms,
    cost_of,
    descend_again,
    draw,
    insert,
    write_string,
)

# Greatest length of strings, and average number of removed nodes.
_LONGEST, _REMOVED = 10.0, 10.0
_BLINK = 0.01


@compiled
def _barred(
    start: Integers, before: Booleans, first: int, last: int, passed: int, step: int
) -> bool:
    """Return True if precedence forbids a string to pass a node before it (-1) or after it (1)."""
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
    """Move a string to its cheapest other position in `trial`; return the cost."""
    n = len(start)
    last = first + length - 1
    head, tail = start[first], start[last]
    behind, ahead = start[first - 1], start[last + 1]
    freed = costs[behind, ahead] - costs[behind, head] - costs[tail, ahead]
    best, where = np.inf, -1
    for step in (-1, 1):
        position = first - 1 if step < 0 else last + 1
        while 0 < position < n - 1:
            # Place of the string: right after this node.
            passed, beyond = start[position], start[position + step]
            begin, other = (beyond, passed) if step < 0 else (passed, beyond)
            if _barred(start, before, first, last, passed, step):
                break
            added = costs[begin, head] + costs[tail, other] - costs[begin, other]
            if added < best:
                best, where = added, position
            position += step
    if where < 0:
        return np.inf
    low, high = (where, last) if where < first else (first, where)
    middle = first if where < first else last + 1
    trial[:] = start
    write_string(trial, low, start, middle, high, False)
    write_string(trial, low + high + 1 - middle, start, low, middle - 1, False)
    cost: float = now + freed + best
    return cost


@compiled
def _remove_strings(
    start: Integers,
    rank: Integers,
    near: Integers,
    removed: Integers,
    gone: Booleans,
    random: Randoms,
) -> int:
    """Mark strings about near nodes as removed, list their nodes and return the number."""
    n = len(start)
    longest = min(_LONGEST, n - 2)
    many = int(draw(random) * (4.0 * _REMOVED / (1.0 + longest) - 1.0) + 1.0)
    seed = 1 + int(draw(random) * (n - 2))
    count = 0
    for neighbour in range(near.shape[1] + 1):
        if many < 1:
            break
        node = seed if neighbour == 0 else near[seed, neighbour - 1]
        if node == 0 or node == n - 1 or gone[node]:
            continue
        length = 1 + int(draw(random) * longest)
        first = rank[node] - int(draw(random) * length)
        first = max(1, min(first, n - 1 - length))
        for position in range(first, min(first + length, n - 1)):
            other = start[position]
            if not gone[other]:
                gone[other] = True
                removed[count] = other
                count += 1
        many -= 1
    return count


@compiled
def _recreate(
    start: Integers,
    trial: Integers,
    costs: Floats,
    before: Booleans,
    near: Integers,
    rank: Integers,
    random: Randoms,
) -> float:
    """Write the order with removed strings reinserted to `trial`; return its cost."""
    n = len(start)
    removed, keys = np.empty_like(start), np.empty(n)
    gone = np.zeros(n, dtype=np.bool_)
    count = _remove_strings(start, rank, near, removed, gone, random)
    size = 0
    for i in range(n):
        if not gone[start[i]]:
            trial[size] = start[i]
            size += 1
    sorting = draw(random)
    for i in range(count):
        node = removed[i]
        place = rank[node] if sorting < 0.75 else -rank[node]
        keys[i] = draw(random) if sorting < 0.5 else place
    chosen = np.argsort(keys[:count])
    for i in range(count):
        insert(trial, size, removed[chosen[i]], costs, before, random, _BLINK)
        size += 1
    return cost_of(trial, costs)


@compiled
def improve(
    start: Integers,
    best: Integers,
    costs: Floats,
    before: Booleans,
    near: Integers,
    iterations: int,
    temperature: float,
    last_temperature: float,
    moves: float,
    random: Randoms,
) -> float:
    """Improve the order `start` in place, keep the best order in `best`, and return its cost.

    Parameters
    ----------
    start
        Order, shape (n,); changed in place.
    best
        Best order, shape (n,); changed in place.
    costs, before
        See `OrderingInstance`.
    near
        Nearest nodes of each node, shape (n, k).
    temperature, last_temperature
        Temperatures of the first and the last move, in the unit of costs, > 0.
    moves
        Share of moves of whole strings, in [0, 1]; the others recreate strings.
    random
        State of the generator, shape (1,); changed in place.
    """
    n = len(start)
    now, lowest = cost_of(start, costs), cost_of(best, costs)
    if n < 4:
        return lowest
    rank, trial = np.argsort(start), np.empty_like(start)
    cooling = (last_temperature / temperature) ** (1.0 / max(1, iterations))
    inner = n - 2
    for _ in range(iterations):
        temperature *= cooling
        most = -temperature * np.log(draw(random) + 1e-300)
        if draw(random) < moves:
            length = 1 + int((inner - 1) * draw(random) ** 3)
            first = 1 + int(draw(random) * (inner - length + 1))
            cost = _move_string(start, trial, costs, before, now, first, length)
        else:
            cost = _recreate(start, trial, costs, before, near, rank, random)
        if cost < now + most:
            now = cost
            start[:] = trial
            for i in range(n):
                rank[trial[i]] = i
            if cost < lowest:
                lowest = cost
                best[:] = trial
    return lowest


_NEAR = 40
# Schedules of successive runs: initial temperature as a share of the cost per node, share of moves
# of whole strings, and factor of the temperature.
_SCHEDULES = ((1.0, 0.5), (2.0, 0.9), (1.0, 0.9), (2.0, 0.3), (0.5, 0.6))
_COOLING = 300.0
# Orders are kicked if reversing strings is cheap: greatest relative difference of costs in both
# directions, and greatest share of ordered pairs. Such runs begin hotter by this factor, cool with
# another factor, and a kick counts as several moves. Several runs of this length are better than
# one longer run.
_SKEW, _ORDERED = 0.2, 0.25
_KICK_HEAT, _KICK_COOLING, _KICK_MOVES = 2.0, 20.0, 8
_LONGEST_RUN = 1_000_000
_LEAST_NODES = 8
# Moves times nodes of a portion: some tenths of a second.
_PORTION = 10_000_000


def build_greedy(instance: OrderingInstance) -> Integers:
    """Return a greedy order: always the cheapest node whose predecessors are visited."""
    n = instance.n
    lacking = instance.before.sum(axis=0) - instance.before[0]
    order, done = [0], np.zeros(n, dtype=np.bool_)
    done[0] = True
    while len(order) < n:
        free = np.nonzero(~done & (lacking == 0))[0]
        chosen = int(free[np.argmin(instance.costs[order[-1], free])])
        done[chosen] = True
        order.append(chosen)
        lacking = lacking - instance.before[chosen]
    return np.array(order)


def find_nearest(instance: OrderingInstance) -> Integers:
    """Return the nearest nodes of each node, in either direction."""
    both = np.minimum(instance.costs, instance.costs.T)
    near = np.argsort(both, axis=1, kind="stable")[:, : min(_NEAR, instance.n - 1)]
    return np.ascontiguousarray(near)


def find_followers(instance: OrderingInstance) -> Integers:
    """Return the direct successors of inner nodes by precedence, padded with -1."""
    inner = instance.before.copy()
    inner[0] = inner[:, -1] = False
    count = inner.astype(np.float32)
    direct = inner & ~(count @ count > 0.5)
    follow = np.full((instance.n, int(direct.sum(axis=1).max()) + 1), -1)
    for node, after in enumerate(direct):
        follow[node, : after.sum()] = np.nonzero(after)[0]
    return follow


def _is_reversible(instance: OrderingInstance) -> bool:
    """Return True if reversing strings changes costs little and is seldom forbidden."""
    costs, inner = instance.costs, instance.before[1:-1, 1:-1]
    both = (costs < NO_ARC) & (costs.T < NO_ARC)
    skew = np.abs(costs - costs.T)[both].sum()
    return bool(skew <= _SKEW * costs[both].sum() and 2 * inner.sum() <= _ORDERED * inner.size)


class Annealing:
    """Local search on one instance; its random numbers continue from call to call.

    Attributes
    ----------
    kicked
        True if orders are kicked, because strings may be reversed.
    """

    def __init__(self, instance: OrderingInstance, seed: int) -> None:
        self._instance = instance
        self._random = np.array([0x9E3779B97F4A7C15 ^ (seed * 2 + 1)], dtype=np.uint64)
        self._near = find_nearest(instance)
        self._follow = find_followers(instance)
        used = instance.costs[instance.costs < NO_ARC]
        self._typical = float(used.mean()) if used.size else 1.0
        self.kicked = instance.n >= _LEAST_NODES and _is_reversible(instance)
        self._cooling = _KICK_COOLING if self.kicked else _COOLING
        self._turn = 0

    def portions(self, order: Integers, cost: float, moves: int) -> Iterator[tuple[Integers, int]]:
        """Improve an order by runs; yield the best order and the moves of each portion.

        Parameters
        ----------
        cost
            Cost of the order; inf if it takes forbidden arcs.
        moves
            Total number of moves; each kick counts as several.
        """
        best = order.copy()
        runs = max(1, moves // _LONGEST_RUN) if self.kicked else 1
        for _ in range(runs):
            cost = min(cost, self._instance.cost(best))
            yield from self._one_run(best, cost, moves // runs)

    def _one_run(self, best: Integers, cost: float, moves: int) -> Iterator[tuple[Integers, int]]:
        """Improve an order, in place, by one run with the next schedule."""
        n = self._instance.n
        share, shifts = _SCHEDULES[self._turn % len(_SCHEDULES)]
        self._turn += 1
        share *= _KICK_HEAT if self.kicked else 1.0
        initial = share * max(1e-9, min(cost, n * self._typical) / n)
        count = max(8, moves * n // _PORTION)
        now = best.copy()
        for portion in range(count):
            temperature = initial * self._cooling ** (-portion / count)
            last = temperature * self._cooling ** (-1 / count)
            self._run(now, best, moves // count, (temperature, last), shifts)
            yield best, moves // count

    def _run(
        self,
        now: Integers,
        best: Integers,
        moves: int,
        temperatures: tuple[float, float],
        shifts: float,
    ) -> None:
        costs, before, random = self._instance.costs, self._instance.before, self._random
        first, last = temperatures
        if self.kicked:
            kicks = max(1, moves // _KICK_MOVES)
            arrays = (costs, before, self._near, self._follow)
            descend_again(now, best, *arrays, kicks, first, last, random)
        else:
            improve(now, best, costs, before, self._near, moves, first, last, shifts, random)
