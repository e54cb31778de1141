"""The stopping criterion of a search, with its incumbent and its best bound."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from skillplan.checks.feasibility import CheckCount
from skillplan.solvers.solution import Plan, relative_gap
from skillplan.workers.processes import measure_resident_bytes

# A solver that polls returns long before; one that does not is stopped by the model [s].
_GRACE_S = 1.0
MEMORY_LIMIT = "memory limit"
# Reading the resident size takes microseconds; a search allocates little in between.
_MEMORY_EVERY_S = 0.01
# Part of the memory limit that is reserved for the work after the search, such as the replay.
_KEPT_MEMORY = 32
# The speed of a search is measured over this time, so that it follows recent changes.
_SPEED_OVER_S = 1.0


@dataclass(frozen=True, slots=True)
class Progress:
    """The progress of a search in figures, for display.

    Parameters
    ----------
    best_cost
        Cost of the best plan so far, or None.
    lower_bound
        The best bound so far, or None.
    nodes
        Number of nodes expanded or visited.
    queries
        Number of queries to expensive back ends; None without such back ends.
    nodes_per_s
        Present speed of the search [nodes/s]; None until it is measured.
    decimals
        Number of decimals of a printed cost; None if unknown.
    """

    best_cost: float | None
    lower_bound: float | None
    nodes: int
    queries: CheckCount | None = None
    nodes_per_s: float | None = None
    decimals: int | None = None


def _rises(low: float, high: float) -> bool:
    """Return whether one figure exceeds another by more than rounding."""
    return high > low + 1e-9 * max(1.0, abs(low))


class Stop:
    """The stopping criterion of a search, with its incumbent and its bound.

    Parameters
    ----------
    time_limit_s
        Time limit [s], > 0; None for none.
    gap
        Relative gap between cost and bound at which the search stops, in [0, 1].
    stall_s
        Time without a better plan or bound after which the search stops [s], > 0; None for no
        limit. It counts from the first plan.
    memory_limit_bytes
        Limit of the memory of this process [B], > 0; None for none. A solver that allocates much
        at once calls `memory_left_bytes` before.
    on_progress
        Called with the progress when a plan, a bound or checks are reported.

    Attributes
    ----------
    best, lower_bound
        The best plan and bound so far, or None. At first `best` is the plan to start from, if any.
    decimals
        Number of decimals of a printed cost; None if unknown.

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
        stall_s: float | None = None,
        memory_limit_bytes: int | None = None,
        on_progress: Callable[[Progress], None] | None = None,
    ) -> None:
        if time_limit_s is not None and not time_limit_s > 0:
            raise ValueError(f"Time limit must be > 0 s, not {time_limit_s}.")
        if not 0 <= gap <= 1:
            raise ValueError(f"Gap must be in [0, 1], not {gap}.")
        if stall_s is not None and not stall_s > 0:
            raise ValueError(f"Stall must be > 0 s, not {stall_s}.")
        if memory_limit_bytes is not None and not memory_limit_bytes > 0:
            raise ValueError(f"Memory limit must be > 0 bytes, not {memory_limit_bytes}.")
        now_s = time.monotonic()
        self._deadline_s = math.inf if time_limit_s is None else now_s + time_limit_s
        self._stopped_s: float | None = None
        self._own_reason: str | None = None
        self._gap = gap
        self._stall_s = math.inf if stall_s is None else stall_s
        self._improved_s = now_s
        self._memory_limit_bytes = memory_limit_bytes
        self._memory_due_s = -math.inf
        self._speed = _Speed(now_s)
        self._on_progress = on_progress
        self.interrupted = False
        self.best: Plan | None = None
        self.lower_bound: float | None = None
        self.nodes = 0
        self.decimals: int | None = None
        self._queries: CheckCount | None = None

    def __call__(self) -> bool:
        """Return whether to stop now; solvers poll this."""
        if self._stopped_s is not None:
            return True
        now_s = time.monotonic()
        if self.interrupted or now_s >= self._deadline_s or self._close_enough():
            self._stopped_s = now_s
        elif self._memory_short(now_s):
            self.end(MEMORY_LIMIT)
        elif self.best is not None and now_s >= self._improved_s + self._stall_s:
            self.end("stalled")
        return self._stopped_s is not None

    def renew(self) -> None:
        """Forget the best plan and the bound, for the next task of a chain.

        The clock runs on, and an interruption stays.
        """
        self.best = None
        self.lower_bound = None
        self.nodes = 0
        self._own_reason = None
        self._improved_s = time.monotonic()
        self._speed = _Speed(self._improved_s)
        if not self.interrupted and time.monotonic() < self._deadline_s:
            self._stopped_s = None

    def within(self, time_limit_s: float) -> Stop:
        """Return a stop for a subordinate search, which ends no later than this one."""
        left_s = self._deadline_s - time.monotonic()
        return Stop(
            time_limit_s=max(1e-3, min(time_limit_s, left_s)),
            memory_limit_bytes=self._memory_limit_bytes,
        )

    @property
    def left_s(self) -> float | None:
        """Time left for the search [s]; None for no limit."""
        if not math.isfinite(self._deadline_s):
            return None
        return max(1e-3, self._deadline_s - time.monotonic())

    def left(self) -> dict[str, Any]:
        """Return the remaining limits as keywords of another stop."""
        stalls = math.isfinite(self._stall_s)
        return {
            "time_limit_s": self.left_s,
            "gap": self._gap,
            "stall_s": self._stall_s if stalls else None,
            "memory_limit_bytes": self._memory_limit_bytes,
        }

    @property
    def stall_s(self) -> float:
        """Time without progress after which a search stops [s]; infinite for no limit."""
        return self._stall_s

    def interrupt(self) -> None:
        """Request that the search stop and return its best."""
        self.interrupted = True

    def listen(self, on_progress: Callable[[Progress], None]) -> None:
        """Call a function with the progress from now on, in place of any other."""
        self._on_progress = on_progress

    def end(self, reason: str) -> None:
        """Stop for a reason of the solver's own, such as a limit."""
        self._own_reason = reason
        if self._stopped_s is None:
            self._stopped_s = time.monotonic()

    def overdue(self) -> bool:
        """Return whether a solver should have stopped long ago."""
        now_s = time.monotonic()
        if self._own_reason == MEMORY_LIMIT and self.memory_left_bytes() == 0:
            # Waiting any longer would take more memory.
            return True
        if self._stopped_s is None:
            # A pending gap is no reason to cut a solver off: time, memory, interruption are.
            if self.interrupted or now_s >= self._deadline_s:
                self._stopped_s = now_s
            elif self._memory_short(now_s):
                self.end(MEMORY_LIMIT)
            return False
        return now_s > self._stopped_s + _GRACE_S

    @property
    def memory_limit_bytes(self) -> int | None:
        """Limit of the memory of this process [B]; None for none."""
        return self._memory_limit_bytes

    def memory_left_bytes(self) -> int | None:
        """Return the memory that may still be allocated [B], >= 0.

        None without a limit, or if the system does not report the size of a process.
        """
        if self._memory_limit_bytes is None:
            return None
        held = measure_resident_bytes()
        return None if held is None else max(0, self._memory_limit_bytes - held)

    @property
    def limited(self) -> bool:
        """True if there is a time limit, which an anytime solver may use up."""
        return math.isfinite(self._deadline_s)

    @property
    def limits_effort(self) -> bool:
        """True if time or memory is limited, also for a solver that does not poll."""
        return self.limited or self._memory_limit_bytes is not None

    @property
    def reason(self) -> str | None:
        """Reason why the search was stopped; None if it was not."""
        if self._stopped_s is None:
            return None
        if self.interrupted:
            return "interrupted"
        if self._own_reason is not None:
            return self._own_reason
        return "time limit" if self._stopped_s >= self._deadline_s else "gap reached"

    def incumbent(self, plan: Plan) -> None:
        """Keep a feasible plan if it costs less than the best so far; it must have a cost."""
        if plan.cost is None:
            raise ValueError("An incumbent must have a cost.")
        if self.best is None or self.best.cost is None or plan.cost < self.best.cost:
            if self.best is None or self.best.cost is None or _rises(plan.cost, self.best.cost):
                self._improved_s = time.monotonic()
            self.best = plan
            self._report()

    def bound(self, lower_bound: float, nodes: int | None = None) -> None:
        """Keep a proven lower bound on the cost of every plan, if it is the best so far."""
        if math.isnan(lower_bound):
            raise ValueError("A lower bound must be a number.")
        if nodes is not None:
            self.nodes = nodes
        if self.lower_bound is None or lower_bound > self.lower_bound:
            if self.lower_bound is None or _rises(self.lower_bound, lower_bound):
                self._improved_s = time.monotonic()
            self.lower_bound = lower_bound
        self._report()

    def checked(self, queries: CheckCount) -> None:
        """Record the number of queries to expensive back ends, and report it."""
        self._queries = queries
        self._report()

    def _close_enough(self) -> bool:
        if self._gap == 0 or self.best is None:
            return False
        gap = relative_gap(self.best.cost, self.lower_bound)
        return gap is not None and gap <= self._gap

    def _memory_short(self, now_s: float) -> bool:
        """Return whether little memory is left; it is measured only now and then."""
        if self._memory_limit_bytes is None or now_s < self._memory_due_s:
            return False
        self._memory_due_s = now_s + _MEMORY_EVERY_S
        left = self.memory_left_bytes()
        return left is not None and left < self._memory_limit_bytes // _KEPT_MEMORY

    def _report(self) -> None:
        if self._on_progress is not None:
            cost = None if self.best is None else self.best.cost
            speed = self._speed.at(time.monotonic(), self.nodes)
            self._on_progress(
                Progress(cost, self.lower_bound, self.nodes, self._queries, speed, self.decimals)
            )


class _Speed:
    """The rate at which a count rises, between two measurements."""

    def __init__(self, now_s: float) -> None:
        self._since_s = now_s
        self._count = 0
        self._per_s: float | None = None

    def at(self, now_s: float, count: int) -> float | None:
        """Record a count and return the rate [1/s]; None before the second measurement."""
        passed_s = now_s - self._since_s
        if passed_s >= _SPEED_OVER_S:
            self._per_s = max(0, count - self._count) / passed_s
            self._since_s, self._count = now_s, count
        return self._per_s
