"""Dynamic programming over feasible subsets, layer by layer, with a beam that may widen.

A beam that left nothing out has proved what it found; one that did still proves a bound: the
least that anything left out could have come to.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from skillplan.solvers.ordering.instance import Floats, Integers, OrderingInstance
from skillplan.solvers.ordering.relaxation.reduced_costs import Duals, charges_of
from skillplan.solvers.ordering.subsets.bit_sets import words_of
from skillplan.solvers.ordering.subsets.completion_bounds import CompletionBounds
from skillplan.solvers.ordering.subsets.held_karp import expand

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
    """Search with a beam of some width; None where it was stopped."""
    n = instance.n
    bounds = CompletionBounds(instance, duals, _BITS)
    room = cutoff - duals.bound
    tails, heads = np.nonzero(np.isfinite(duals.reduced))
    out_first = np.searchsorted(tails, np.arange(n + 1))
    arc_reduced = duals.reduced[tails, heads]
    arc_costs = instance.costs[tails, heads]
    preds = words_of(instance.before)
    charges = charges_of(duals)
    sets = np.zeros((1, preds.shape[1]), dtype=np.uint64)
    sets[0, 0] = 1
    lasts = np.zeros(1, dtype=np.int16)
    costs: Floats = np.zeros(1)
    spent: Floats = np.zeros(1)
    history = []
    least, made = np.inf, 0
    for layer in range(1, n):
        sets, lasts, costs, spent, _, parents, dropped, tried = expand(
            sets,
            lasts,
            costs,
            spent,
            out_first,
            heads,
            arc_costs,
            arc_reduced,
            preds,
            bounds.near,
            bounds.slot[layer],
            bounds.ahead,
            charges,
            room,
            False,
            room,
            width,
            False,
        )
        least = min(least, dropped)
        made += tried
        on_layer(layer, len(lasts))
        if stop():
            return None
        if not len(lasts):
            return Beam(None, min(cutoff, least + duals.bound), np.isinf(least), made)
        history.append((lasts, parents))
    at = int(np.argmin(costs))
    order = [n - 1]
    for lasts, parents in reversed(history):
        at_last = int(lasts[at])
        if at_last != n - 1:
            order.append(at_last)
        at = int(parents[at])
    order.append(0)
    return Beam(
        np.array(order[::-1], dtype=np.int64),
        min(cutoff, least + duals.bound, float(costs.min())),
        np.isinf(least),
        made,
    )
