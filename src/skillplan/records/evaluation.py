"""A replayed sequence, compared with the proved optimum of its task."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from skillplan.model.replay import Replay
from skillplan.records import schemas
from skillplan.records.result import Result, Status, make_step_document
from skillplan.solvers.solution import deviation, relative_gap
from skillplan.task.skill import Skill
from skillplan.task.task import Task


@dataclass(frozen=True)
class Evaluation:
    """The outcome of a sequence.

    Parameters
    ----------
    task, skills
        The sequence and its task.
    walked
        The replay.
    best
        The result of a solver on the same task; None if none was run.
    """

    task: Task
    skills: Sequence[Skill]
    walked: Replay
    best: Result | None = None

    @property
    def optimum(self) -> float | None:
        """The proved optimum; None without a proof."""
        best = self.best
        return best.cost if best is not None and best.status is Status.OPTIMAL else None

    @property
    def deviation(self) -> float | None:
        """Excess over the proved optimum, as a fraction of it; None if either is missing."""
        return deviation(self.walked.cost if self.walked.complete else None, self.optimum)

    @property
    def lower_bound(self) -> float | None:
        """The proved lower bound on the cost of all plans; None without one."""
        return None if self.best is None else self.best.lower_bound

    @property
    def gap(self) -> float | None:
        """(cost - lower bound) / cost; None if the sequence is not a plan or has no bound."""
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
            "steps": [make_step_document(step) for step in walked.steps],
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
    """A proved lower bound on the cost of a task, or the reason why there is none.

    Parameters
    ----------
    cost
        Cost in the task's metric, expected under chance; None if nothing was proved.
    actions
        Action numbers of a sequence of that cost; empty under chance or without a proof.
    solver
        Name of the solver that proved it.
    reason
        Reason why it is not proved; empty if it is.
    wall_s
        Duration of the proof [s].
    not_checked
        Sentences of the back ends about unchecked properties of the task.

    Raises
    ------
    ValueError
        If both cost and reason are given, or neither.
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
