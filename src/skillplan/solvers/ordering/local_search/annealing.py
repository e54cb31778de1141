"""Simulated annealing of orders, with several cooling schedules in turn.

Kirkpatrick, Gelatt and Vecchi, "Optimization by simulated annealing" (1983); the moves are those
of `ruin_and_recreate`, or those of `iterated_descent` where strings may be reversed. A run is made
in portions, between which it can be stopped.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from skillplan.solvers.ordering.instance import NO_ARC, Integers, OrderingInstance
from skillplan.solvers.ordering.local_search.iterated_descent import descend_again
from skillplan.solvers.ordering.local_search.ruin_and_recreate import improve

_NEAR = 40
# Of the runs in turn: the initial temperature as a share of the cost per node, and the share of
# moves that shift a string as it is; and the factor by which the temperature falls.
_SCHEDULES = ((1.0, 0.5), (2.0, 0.9), (1.0, 0.9), (2.0, 0.3), (0.5, 0.6))
_COOLING = 300.0
# Where reversing strings pays, orders are kicked and descend again: costs of the two directions
# differ by at most this share of them, and of all pairs of nodes at most this share is in a
# precedence. A run begins so many times as hot then, the factor is smaller, and a kick counts as so
# many moves. Several runs of so many moves find better orders than one that is longer.
_SKEW, _ORDERED = 0.2, 0.25
_KICK_HEAT, _KICK_COOLING, _KICK_MOVES = 2.0, 20.0, 8
_LONGEST_RUN = 1_000_000
_LEAST_NODES = 8
# Moves times nodes of a portion: some tenths of a second.
_PORTION = 10_000_000


def cheapest_first(instance: OrderingInstance) -> Integers:
    """Return a greedy order: the cheapest node next whose predecessors have all been visited."""
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


def nearest(instance: OrderingInstance) -> Integers:
    """Return the nearest nodes of each, in either direction."""
    both = np.minimum(instance.costs, instance.costs.T)
    near = np.argsort(both, axis=1, kind="stable")[:, : min(_NEAR, instance.n - 1)]
    return np.ascontiguousarray(near)


def followers(instance: OrderingInstance) -> Integers:
    """Return the inner nodes that come right after each by precedence, filled up with -1."""
    inner = instance.before.copy()
    inner[0] = inner[:, -1] = False
    count = inner.astype(np.float32)
    direct = inner & ~(count @ count > 0.5)
    follow = np.full((instance.n, int(direct.sum(axis=1).max()) + 1), -1)
    for node, after in enumerate(direct):
        follow[node, : after.sum()] = np.nonzero(after)[0]
    return follow


def _reversible(instance: OrderingInstance) -> bool:
    """Whether reversing strings changes costs little and is seldom forbidden."""
    costs, inner = instance.costs, instance.before[1:-1, 1:-1]
    both = (costs < NO_ARC) & (costs.T < NO_ARC)
    skew = np.abs(costs - costs.T)[both].sum()
    return bool(skew <= _SKEW * costs[both].sum() and 2 * inner.sum() <= _ORDERED * inner.size)


class Annealing:
    """Local search on one instance; its random numbers continue from call to call.

    Parameters
    ----------
    instance
        The ordering.
    seed
        Governs all randomness.

    Attributes
    ----------
    kicked
        Whether orders are kicked and descend again, as strings may be reversed.
    """

    def __init__(self, instance: OrderingInstance, seed: int) -> None:
        self._instance = instance
        self._random = np.array([0x9E3779B97F4A7C15 ^ (seed * 2 + 1)], dtype=np.uint64)
        self._near = nearest(instance)
        self._follow = followers(instance)
        used = instance.costs[instance.costs < NO_ARC]
        self._typical = float(used.mean()) if used.size else 1.0
        self.kicked = instance.n >= _LEAST_NODES and _reversible(instance)
        self._cooling = _KICK_COOLING if self.kicked else _COOLING
        self._turn = 0

    def portions(self, order: Integers, cost: float, moves: int) -> Iterator[tuple[Integers, int]]:
        """Improve an order by runs; yield the best so far and the moves of each portion.

        Parameters
        ----------
        order
            Where to begin.
        cost
            What it costs; inf for an order that takes arcs that no order takes.
        moves
            How many in all; each kick counts as several.
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
