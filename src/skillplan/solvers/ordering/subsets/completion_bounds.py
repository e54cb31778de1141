"""Completion bounds: the least reduced cost from a label to the end, by ng-route relaxation.

The relaxation is that of `neighbourhood_paths`, worked out once for all labels.
"""

from __future__ import annotations

import numpy as np

from skillplan.solvers.ordering.instance import Floats, Integers, OrderingInstance
from skillplan.solvers.ordering.relaxation.reduced_costs import Duals
from skillplan.solvers.ordering.subsets.neighbourhood_paths import backward, memory_tables, spread

# Of computing the tables: some tenths of a second, and as many bytes at the very most.
_MOST_STEPS = 200_000_000


class CompletionBounds:
    """The cheapest walks to the end by position, node and the neighbours that are left to visit.

    Parameters
    ----------
    instance
        The ordering.
    duals
        Reduced costs; inf for arcs that are fixed to zero.
    bits
        How many neighbours a node remembers at most, >= 0; fewer where there are many arcs, to
        save time and memory.

    Attributes
    ----------
    near
        The neighbours of a node, -1 where there are fewer, shape (n, bits).
    slot
        Row of a position and a node, -1 where the node cannot stand there, shape (n, n).
    ahead
        Least reduced cost to the end by row and set of neighbours left, shape (rows, 2 ** bits).
    """

    def __init__(self, instance: OrderingInstance, duals: Duals, bits: int) -> None:
        n = instance.n
        arcs = int(np.isfinite(duals.reduced).sum())
        while bits and (arcs * n) << bits > _MOST_STEPS:
            bits -= 1
        self.near = _neighbours(duals.reduced, min(bits, n - 1))
        before = instance.before
        positions = np.arange(n)[:, None]
        possible = (positions >= before.sum(axis=0)) & (positions < n - before.sum(axis=1))
        self.slot: Integers = np.where(
            possible, np.cumsum(possible).reshape(possible.shape) - 1, -1
        )
        heads, tails = np.nonzero(np.isfinite(duals.reduced.T))
        moved, bars = memory_tables(tails, heads, self.near, before)
        first = np.searchsorted(heads, np.arange(n + 1))
        costs = duals.reduced[tails, heads]
        self.ahead: Floats = backward(tails, costs, first, moved, bars, self.slot, moved.shape[1])
        spread(self.ahead, self.near.shape[1])


def _neighbours(reduced: Floats, bits: int) -> Integers:
    """Return the nodes to and from which it is cheapest to go, of every node."""
    apart = reduced + reduced.T
    np.fill_diagonal(apart, np.inf)
    ranked = np.argsort(apart, axis=1, kind="stable")[:, :bits]
    near = np.where(np.isfinite(np.take_along_axis(apart, ranked, axis=1)), ranked, -1)
    return np.ascontiguousarray(near, dtype=np.int64)
