"""When a search stops, and the best that is known when it does."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

from skillplan.model.feasibility import CheckCount
from skillplan.solvers.solution import Plan

# A solver that polls returns long before; one that does not is stopped by the model.
_GRACE_S = 1.0


@dataclass(frozen=True, slots=True)
class Progress:
    """A search in figures, for people who wait.

    Parameters
    ----------
    best_cost
        Cost of the best plan so far, or None.
    lower_bound
        The best bound so far, or None.
    nodes
        Nodes expanded or visited.
    asked
        What has been asked of dear back ends; None where there is none.
    """

    best_cost: float | None
    lower_bound: float | None
    nodes: int
    asked: CheckCount | None = None


def relative_gap(cost: float | None, lower_bound: float | None) -> float | None:
    """Return (cost - lower bound) / cost, never below 0; None where either is missing."""
    if cost is None or lower_bound is None or not math.isfinite(lower_bound):
        return None
    if cost <= lower_bound or cost == 0:
        return 0.0
    return (cost - lower_bound) / cost


class Stop:
    """Says when to stop; keeps the incumbent and the bound, on which that may depend.

    Parameters
    ----------
    time_limit_s
        Stop after this time [s], > 0; None for no limit.
    gap
        Stop once cost and bound are this close, as a fraction of the cost, in [0, 1].
    on_progress
        Called with the figures now and then.

    Raises
    ------
    ValueError
        If a limit is out of range.
    """

    def __init__(
        self,
        *,
        time_limit_s: float | None = None,
        gap: float = 0.0,
        on_progress: Callable[[Progress], None] | None = None,
    ) -> None:
        if time_limit_s is not None and not time_limit_s > 0:
            raise ValueError(f"Time limit must be > 0 s, not {time_limit_s}.")
        if not 0 <= gap <= 1:
            raise ValueError(f"Gap must be in [0, 1], not {gap}.")
        self._begin_s = time.monotonic()
        self._deadline_s = math.inf if time_limit_s is None else self._begin_s + time_limit_s
        self._told_s: float | None = None
        self._own_reason: str | None = None
        self._gap = gap
        self._on_progress = on_progress
        self.interrupted = False
        self.best: Plan | None = None
        self.lower_bound: float | None = None
        self.nodes = 0
        self._asked: CheckCount | None = None

    def __call__(self) -> bool:
        """Whether to stop now; solvers poll this once in a while."""
        if self._told_s is not None:
            return True
        now_s = time.monotonic()
        if self.interrupted or now_s >= self._deadline_s or self._close_enough():
            self._told_s = now_s
            return True
        return False

    def renew(self) -> None:
        """Forget the best plan and the bound, for the next task of a chain.

        The time goes on, and an interruption stays.
        """
        self.best = None
        self.lower_bound = None
        self.nodes = 0
        self._own_reason = None
        if not self.interrupted and time.monotonic() < self._deadline_s:
            self._told_s = None

    def within(self, time_limit_s: float) -> Stop:
        """Return a stop for a search on the side, which ends no later than this one."""
        left_s = self._deadline_s - time.monotonic()
        return Stop(time_limit_s=max(1e-3, min(time_limit_s, left_s)))

    def interrupt(self) -> None:
        """Ask the search to stop and hand over the best it has."""
        self.interrupted = True

    def end(self, reason: str) -> None:
        """Say that the solver ends its search for a reason of its own, such as a limit."""
        self._own_reason = reason
        if self._told_s is None:
            self._told_s = time.monotonic()

    def overdue(self) -> bool:
        """Whether a solver should have stopped long ago."""
        if self._told_s is None:
            # A pending gap is no reason to cut a solver off: only time and interruption are.
            if self.interrupted or time.monotonic() >= self._deadline_s:
                self._told_s = time.monotonic()
            return False
        return time.monotonic() > self._told_s + _GRACE_S

    @property
    def limited(self) -> bool:
        """Whether there is a time limit, so that whoever can may use it up."""
        return math.isfinite(self._deadline_s)

    @property
    def reason(self) -> str | None:
        """Why the search was stopped, or None while it was not."""
        if self._told_s is None:
            return None
        if self.interrupted:
            return "interrupted"
        if self._own_reason is not None:
            return self._own_reason
        return "time limit" if self._told_s >= self._deadline_s else "gap reached"

    def incumbent(self, plan: Plan) -> None:
        """Keep a feasible plan if it costs less than the best so far; it must name its cost."""
        if plan.cost is None:
            raise ValueError("An incumbent must name its cost.")
        if self.best is None or self.best.cost is None or plan.cost < self.best.cost:
            self.best = plan
            self._report()

    def bound(self, lower_bound: float, nodes: int | None = None) -> None:
        """Keep a proven lower bound on the cost of every plan, if it is the best so far."""
        if math.isnan(lower_bound):
            raise ValueError("A lower bound must be a number.")
        if nodes is not None:
            self.nodes = nodes
        if self.lower_bound is None or lower_bound > self.lower_bound:
            self.lower_bound = lower_bound
        self._report()

    def checked(self, asked: CheckCount) -> None:
        """Take note of how far the asking of dear back ends has come, and show it."""
        self._asked = asked
        self._report()

    def _close_enough(self) -> bool:
        if self._gap == 0 or self.best is None:
            return False
        gap = relative_gap(self.best.cost, self.lower_bound)
        return gap is not None and gap <= self._gap

    def _report(self) -> None:
        if self._on_progress is not None:
            cost = None if self.best is None else self.best.cost
            self._on_progress(Progress(cost, self.lower_bound, self.nodes, self._asked))
