"""The Pareto front of two costs, as data and as a document."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from skillplan.records import schemas
from skillplan.records.result import Origin, Status
from skillplan.task.task import Metric


@dataclass(frozen=True)
class FrontPoint:
    """A plan of the front.

    Parameters
    ----------
    costs
        Its two costs, in the units of the metrics.
    proved
        True if no plan of the task is as good in both costs and better in one.
    skills, actions
        Names and action numbers of its skills.
    makespan_s
        Duration of the plan [s].
    """

    costs: tuple[float, float]
    proved: bool
    skills: tuple[str, ...]
    actions: tuple[int, ...]
    makespan_s: float


@dataclass(frozen=True)
class Front:
    """The Pareto front of two costs of a task.

    Parameters
    ----------
    names
        Names of the costs, as in ``--pareto``.
    metrics
        Their units.
    status
        ``optimal``: the whole front, each point proved. ``solved``: points without the others.
        ``infeasible``, ``unsolved``, ``wrong``, ``refused``: as of a result.
    points
        In ascending order of the first cost.
    reached
        The front is complete up to this first cost; None if it is complete as a whole.
    confirmed_by
        Solver that proved the least of each cost in a search of its own; empty without one.
    """

    task: str
    kind: str
    sha256: str
    names: tuple[str, str]
    metrics: tuple[Metric, Metric]
    status: Status
    points: tuple[FrontPoint, ...] = ()
    reached: float | None = None
    reason: str = ""
    physics: str = ""
    collision: str = ""
    timed_by: str = ""
    not_checked: tuple[str, ...] = ()
    confirmed_by: str = ""
    interrupted: bool = False
    origin: Origin | None = None
    stats: Mapping[str, Any] = field(default_factory=dict)

    @property
    def proved_by(self) -> tuple[str, ...]:
        """Names of the back ends under which the points hold, physics first."""
        return tuple(filter(None, (self.physics, *self.collision.split(","))))

    def document(self) -> dict[str, Any]:
        """Return the JSON document ``skillplan.front/1``."""
        return {
            "schema": schemas.FRONT,
            "task": {"name": self.task, "kind": self.kind, "sha256": self.sha256},
            "origin": None if self.origin is None else self.origin.document(),
            "costs": [
                {"name": name, "unit": metric.unit}
                for name, metric in zip(self.names, self.metrics, strict=True)
            ],
            "status": self.status.value,
            "reason": self.reason,
            "reached": self.reached,
            "physics": self.physics,
            "collision": self.collision,
            "timed_by": self.timed_by,
            "proved_by": list(self.proved_by),
            "confirmed_by": self.confirmed_by,
            "not_checked": list(self.not_checked),
            "points": [
                {
                    "costs": list(point.costs),
                    "proved": point.proved,
                    "skills": list(point.skills),
                    "actions": list(point.actions),
                    "makespan": len(point.skills),
                    "makespan_s": point.makespan_s,
                }
                for point in self.points
            ],
            "stats": dict(self.stats),
        }
