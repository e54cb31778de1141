"""Changes of a cell that save cost, each proved by solving the changed task; as a document."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from skillplan.records import schemas
from skillplan.records.result import Origin, Result, Status

_S_PER_H = 3600.0


@dataclass(frozen=True, slots=True)
class TimeShares:
    """Time of a plan by travel, work, tool change and waiting [s].

    Parameters
    ----------
    travel_s
        Travels and strokes, except in tool changes.
    work_s
        Dwells: grasping, placing, fetching, fastening.
    change_s
        Tool changes with their travels.
    wait_s
        Waits for parts that arrive, and for feeders.
    """

    travel_s: float
    work_s: float
    change_s: float
    wait_s: float = 0.0

    @property
    def total_s(self) -> float:
        """Time of the plan [s]."""
        return self.travel_s + self.work_s + self.change_s + self.wait_s

    @property
    def cycles_per_hour(self) -> float | None:
        """Number of cycles in an hour; None for a plan that takes no time."""
        return compute_cycles_per_hour(self.total_s)

    def document(self) -> dict[str, Any]:
        """Return the shares as JSON values."""
        return {
            "makespan_s": self.total_s,
            "cycles_per_hour": self.cycles_per_hour,
            "travel_s": self.travel_s,
            "work_s": self.work_s,
            "change_s": self.change_s,
            "wait_s": self.wait_s,
        }


def compute_cycles_per_hour(makespan_s: float | None) -> float | None:
    """Return the number of cycles in an hour, or None if the cycle takes no time."""
    return _S_PER_H / makespan_s if makespan_s else None


@dataclass(frozen=True)
class Tip:
    """A change and the result of the changed task.

    Parameters
    ----------
    saving
        Cost of the file's plan minus that of the changed task's, in the unit of the cost.
    """

    item: str
    words: str
    changes: Mapping[str, str]
    result: Result
    saving: float

    @property
    def proved(self) -> bool:
        """True if the plan of the changed task is proved to be the best."""
        return self.result.status is Status.OPTIMAL

    def document(self) -> dict[str, Any]:
        """Return the change as JSON values."""
        makespan_s = self.result.makespan_s
        return {
            "item": self.item,
            "words": self.words,
            "set": dict(self.changes),
            "cost": self.result.cost,
            "saving": self.saving,
            "proved": self.proved,
            "makespan_s": makespan_s,
            "cycles_per_hour": compute_cycles_per_hour(makespan_s),
            "skills": [step.skill for step in self.result.steps],
        }


@dataclass(frozen=True)
class Advice:
    """The changes of a cell that save most.

    Parameters
    ----------
    base
        Result of the file as it is.
    shares
        Time of its plan; None without a plan.
    tips
        Changes that save, the greatest saving first.
    proposed, tried, refused, useless, longer
        Number of changes: in all, solved, refused by the checks of the file, solved without a
        saving, and places left out because they do not shorten the plan of the file.
    wrong, cut
        Numbers of tried changes whose result the referee has refuted, and whose search ended at a
        limit of the solver; they are not listed.
    reason
        Reason why changes were left out; empty if none were.
    """

    base: Result
    shares: TimeShares | None
    within_m: float
    tips: tuple[Tip, ...] = ()
    proposed: int = 0
    tried: int = 0
    refused: int = 0
    useless: int = 0
    longer: int = 0
    wrong: int = 0
    cut: int = 0
    reason: str = ""
    interrupted: bool = False
    origin: Origin | None = None
    decimals: int = 5
    stats: Mapping[str, Any] = field(default_factory=dict)

    def document(self) -> dict[str, Any]:
        """Return the JSON document ``skillplan.advice/1``."""
        base = self.base
        return {
            "schema": schemas.ADVICE,
            "task": {"name": base.task, "kind": base.kind, "sha256": base.sha256},
            "origin": None if self.origin is None else self.origin.document(),
            "status": base.status.value,
            "cost": base.cost,
            "cost_unit": base.cost_unit,
            "proved_by": list(base.proved_by),
            "not_checked": list(base.not_checked),
            "timed_by": base.timed_by,
            "cycle": None if self.shares is None else self.shares.document(),
            "within_m": self.within_m,
            "proposed": self.proposed,
            "tried": self.tried,
            "refused": self.refused,
            "useless": self.useless,
            "longer": self.longer,
            "wrong": self.wrong,
            "cut": self.cut,
            "reason": self.reason,
            "tips": [tip.document() for tip in self.tips],
            "stats": dict(self.stats),
        }
