"""A replayed sequence, compared with the proved optimum of its task."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from skillplan.model.replay import Replay
from skillplan.records import schemas
from skillplan.records.result import Result, Status, step_document
from skillplan.solvers.solution import deviation, relative_gap
from skillplan.task.skill import Skill
from skillplan.task.task import Task


@dataclass(frozen=True)
class Evaluation:
    """What became of a sequence.

    Parameters
    ----------
    task, skills
        What was replayed.
    walked
        The replay.
    best
        What a solver found and proved on the same task, or None where none was run.
    """

    task: Task
    skills: Sequence[Skill]
    walked: Replay
    best: Result | None = None

    @property
    def optimum(self) -> float | None:
        """The proved optimum; None where it is not proved."""
        best = self.best
        return best.cost if best is not None and best.status is Status.OPTIMAL else None

    @property
    def deviation(self) -> float | None:
        """Excess over the proved optimum, as a fraction of it; None where either is missing."""
        return deviation(self.walked.cost if self.walked.complete else None, self.optimum)

    @property
    def lower_bound(self) -> float | None:
        """What any plan costs at least, as far as that was proved; None where nothing was."""
        return None if self.best is None else self.best.lower_bound

    @property
    def gap(self) -> float | None:
        """(cost - lower bound) / cost; None where the sequence is no plan, or nothing proved."""
        cost = self.walked.cost if self.walked.complete else None
        return relative_gap(cost, self.lower_bound)

    def document(self) -> dict[str, Any]:
        """Return the JSON document ``skillplan.evaluation/1``."""
        task, walked = self.task, self.walked
        return {
            "schema": schemas.EVALUATION,
            "task": {"name": task.name, "kind": task.kind, "sha256": task.sha256},
            "feasible": walked.feasible,
            "complete": walked.complete,
            "cost": walked.cost,
            "cost_unit": task.metric.unit,
            "optimum": self.optimum,
            "deviation": self.deviation,
            "lower_bound": self.lower_bound,
            "bound_method": self.best.bound_method if self.best is not None else "",
            "gap": self.gap,
            "makespan": len(walked.steps),
            "makespan_s": walked.duration_s,
            "reward": walked.total_reward,
            "actions": [task.action(skill) for skill in self.skills],
            "steps": [step_document(step) for step in walked.steps],
            "violations": [
                {
                    "step": violation.step,
                    "skill": violation.skill,
                    "stage": violation.stage,
                    "reason": violation.reason,
                    "facts": list(violation.facts),
                }
                for violation in walked.violations
            ],
        }


@dataclass(frozen=True, slots=True)
class Optimum:
    """What the task costs at least.

    Parameters
    ----------
    cost
        In the task's metric, under chance expected; None where nothing was proved.
    actions
        A sequence of that cost, by number; empty under chance, or where nothing was proved.
    solver
        Who proved it.
    reason
        Why it is not proved; empty where it is.
    wall_s
        How long that took [s].
    not_checked
        What the back ends of the proof left unchecked, in sentences.

    Raises
    ------
    ValueError
        If there is a cost and a reason against it, or neither.
    """

    cost: float | None = None
    actions: tuple[int, ...] = ()
    solver: str = "auto"
    reason: str = ""
    wall_s: float | None = None
    not_checked: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if (self.cost is None) != bool(self.reason):
            raise ValueError("An optimum is either proved, or there is a reason.")
