"""Cutting planes: tightens the linear relaxation, round by round."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from skillplan.solvers.ordering.relaxation.cut_relaxation import CutRelaxation
from skillplan.solvers.ordering.relaxation.reduced_costs import Duals


def tighten(
    relaxation: CutRelaxation,
    cutoff: float,
    stop: Callable[[], bool],
    on_bound: Callable[[Duals], None],
    *,
    enough: float = 1e-4,
) -> Duals:
    """Add cuts until nothing is gained, the bound reaches the cutoff or `stop` returns true.

    Parameters
    ----------
    relaxation
        Cuts are added to it, and arcs fixed, in place.
    cutoff
        Orders that cost as much are not of interest.
    stop
        Whether to stop now.
    on_bound
        Called with every better bound.
    enough
        Least gain of a round, as a fraction of the gap, > 0.
    """
    best: Duals | None = None
    stalled = 0
    while True:
        if not relaxation.settle(relaxation.arcs, stop):
            return Duals(np.inf, np.full_like(relaxation.instance.costs, np.inf))
        duals = relaxation.duals()
        if best is None or duals.bound > best.bound:
            gained = np.inf if best is None else duals.bound - best.bound
            stalled = 0 if gained > enough * max(1.0, abs(cutoff - duals.bound)) else stalled + 1
            best = duals
            on_bound(duals)
        else:
            stalled += 1
        if duals.bound >= cutoff or stop() or stalled >= 8:
            return best
        relaxation.fix(duals, cutoff)
        relaxation.drop()
        if not relaxation.cut(100):
            return best
