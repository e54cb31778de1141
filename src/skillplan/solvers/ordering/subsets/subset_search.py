"""Dynamic programming over feasible subsets, layer by layer, with a beam that may widen.

A beam that left nothing out has proved what it found; one that did still proves a bound: the
least that anything left out could have come to.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from skillplan.solvers.ordering.instance import Integers, OrderingInstance
from skillplan.solvers.ordering.relaxation.reduced_costs import Duals, charges_of
from skillplan.solvers.ordering.subsets.bit_sets import words_of
from skillplan.solvers.ordering.subsets.completion_bounds import CompletionBounds
from skillplan.solvers.ordering.subsets.held_karp import Ahead, Arcs, Limits, expand, first_layer

_BITS = 8


@dataclass
class Beam:
    """What a pass found.

    Parameters
    ----------
    order
        The cheapest order met, or None.
    bound
        No order costs less than this or the cutoff, whichever is less.
    whole
        Whether nothing was left out for the width.
    made
        Ways looked at.
    """

    order: Integers | None
    bound: float
    whole: bool
    made: int


def beam(
    instance: OrderingInstance,
    duals: Duals,
    cutoff: float,
    width: int,
    stop: Callable[[], bool],
    on_layer: Callable[[int, int], None] = lambda layer, states: None,
) -> Beam | None:
    """Search with a beam; return None where it was stopped.

    Parameters
    ----------
    instance
        The ordering.
    duals
        A bound and reduced costs; inf where no order below the cutoff takes an arc.
    cutoff
        Orders that cost as much are not looked for.
    width
        At most so many ways are kept in a layer, >= 1.
    stop
        Whether to give up; polled once a layer.
    on_layer
        Told of the number of a layer and of its ways.
    """
    n = instance.n
    bounds = CompletionBounds(instance, duals, _BITS)
    room = cutoff - duals.bound
    tails, heads = np.nonzero(np.isfinite(duals.reduced))
    arcs = Arcs(
        np.searchsorted(tails, np.arange(n + 1)),
        heads,
        instance.costs[tails, heads],
        duals.reduced[tails, heads],
        words_of(instance.before),
    )
    charges = charges_of(duals)
    limits = Limits(room, False, room, width, False)
    ways = first_layer(arcs.preds.shape[1])
    history = []
    least, made = np.inf, 0
    for layer in range(1, n):
        ahead = Ahead(bounds.near, bounds.slot[layer], bounds.ahead)
        ways, dropped, tried = expand(ways, arcs, ahead, charges, limits)
        least = min(least, dropped)
        made += tried
        on_layer(layer, len(ways.lasts))
        if stop():
            return None
        if not len(ways.lasts):
            return Beam(None, min(cutoff, least + duals.bound), np.isinf(least), made)
        history.append((ways.lasts, ways.parents))
    at = int(np.argmin(ways.costs))
    order = [n - 1]
    for lasts, parents in reversed(history):
        at_last = int(lasts[at])
        if at_last != n - 1:
            order.append(at_last)
        at = int(parents[at])
    order.append(0)
    return Beam(
        np.array(order[::-1], dtype=np.int64),
        min(cutoff, least + duals.bound, float(ways.costs.min())),
        np.isinf(least),
        made,
    )
