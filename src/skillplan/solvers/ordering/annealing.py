"""Annealings of orders in turn, each of another temper, in portions that can be stopped between."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from skillplan.solvers.ordering.ordering_instance import NO_ARC, Integers, OrderingInstance
from skillplan.solvers.ordering.ruin_and_recreate import improve

_NEAR = 40
# Of the annealings in turn: the first heat as a share of the cost per node, and the share of
# moves that shift a string as it is; and how far the heat falls.
_TEMPERS = ((1.0, 0.5), (2.0, 0.9), (1.0, 0.9), (2.0, 0.3), (0.5, 0.6))
_COOLS = 300.0
# Moves times nodes of a portion of it: some tenths of a second.
_PORTION = 10_000_000


class Annealing:
    """Local search on one instance; goes on with the same random numbers from call to call.

    Parameters
    ----------
    instance
        The ordering.
    seed
        Governs all randomness.
    """

    def __init__(self, instance: OrderingInstance, seed: int) -> None:
        self._instance = instance
        self._random = np.array([0x9E3779B97F4A7C15 ^ (seed * 2 + 1)], dtype=np.uint64)
        both = np.minimum(instance.costs, instance.costs.T)
        self._near = np.ascontiguousarray(
            np.argsort(both, axis=1, kind="stable")[:, : min(_NEAR, instance.n - 1)]
        )
        used = instance.costs[instance.costs < NO_ARC]
        self._typical = float(used.mean()) if used.size else 1.0
        self._turn = 0

    def portions(self, order: Integers, cost: float, moves: int) -> Iterator[tuple[Integers, int]]:
        """Improve an order, hot at first; yield the best so far and the moves of each portion.

        Parameters
        ----------
        order
            Where to begin.
        cost
            What it costs; inf for an order that takes arcs that no order takes.
        moves
            How many in all.
        """
        n = self._instance.n
        share, shifts = _TEMPERS[self._turn % len(_TEMPERS)]
        self._turn += 1
        heat = share * max(1e-9, min(cost, n * self._typical) / n)
        count = max(8, moves * n // _PORTION)
        now, best = order.copy(), order.copy()
        for portion in range(count):
            hot = heat * _COOLS ** (-portion / count)
            improve(
                now,
                best,
                self._instance.costs,
                self._instance.before,
                self._near,
                moves // count,
                hot,
                hot * _COOLS ** (-1 / count),
                shifts,
                self._random,
            )
            yield best, moves // count
