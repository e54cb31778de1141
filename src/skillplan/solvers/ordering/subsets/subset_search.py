"""Beam search over feasible subsets, with the layers of Held-Karp and completion bounds.

A beam that left no label out has proved its order optimal; one that did still proves a bound: the
least bound of the labels left out.
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
    """The result of one pass.

    Parameters
    ----------
    order
        The cheapest order found, or None.
    bound
        No order costs less than this or the cutoff, whichever is less.
    whole
        Whether no label was left out for the width.
    made
        Labels generated.
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
    """Run a beam search; return None where it was stopped.

    Parameters
    ----------
    instance
        The ordering.
    duals
        A bound and reduced costs; inf where no order below the cutoff takes an arc.
    cutoff
        Only orders that cost less are searched for.
    width
        At most so many labels are kept in a layer, >= 1.
    stop
        Whether to stop; polled once a layer.
    on_layer
        Called with the number of a layer and how many labels it has.
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
    labels = first_layer(arcs.preds.shape[1])
    history = []
    least, made = np.inf, 0
    for layer in range(1, n):
        ahead = Ahead(bounds.near, bounds.slot[layer], bounds.ahead)
        labels, dropped, tried = expand(labels, arcs, ahead, charges, limits)
        least = min(least, dropped)
        made += tried
        on_layer(layer, len(labels.lasts))
        if stop():
            return None
        if not len(labels.lasts):
            return Beam(None, min(cutoff, least + duals.bound), np.isinf(least), made)
        history.append((labels.lasts, labels.parents))
    at = int(np.argmin(labels.costs))
    order = [n - 1]
    for lasts, parents in reversed(history):
        at_last = int(lasts[at])
        if at_last != n - 1:
            order.append(at_last)
        at = int(parents[at])
    order.append(0)
    return Beam(
        np.array(order[::-1], dtype=np.int64),
        min(cutoff, least + duals.bound, float(labels.costs.min())),
        np.isinf(least),
        made,
    )
