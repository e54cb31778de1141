"""A result in two steps: a draft says who solved what, a grade what the referee grants."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from skillplan.errors import BackEndError, SkillplanError
from skillplan.model.replay import Step
from skillplan.records.result import Result, Status
from skillplan.task.skill import Skill
from skillplan.task.state import State


@dataclass(frozen=True)
class Grade:
    """What the referee grants a solution.

    Parameters
    ----------
    status
        What became of the task.
    cost
        Of the replayed plan, or expected under the policy; None without one.
    steps
        The replayed plan.
    makespan_s
        Its duration [s].
    lower_bound
        No plan costs less; None where nothing was proved.
    bound_method
        What proved the bound, in words; empty where there is none.
    reason
        Why it is no better than the status says; empty for an optimal plan.
    policy
        The policy that the plan follows; None where the solver gave a plan.
    back_end_failed
        Whether it has failed by a back end, and by no fault of the solver's.
    """

    status: Status
    cost: float | None = None
    steps: tuple[Step, ...] = ()
    makespan_s: float | None = None
    lower_bound: float | None = None
    bound_method: str = ""
    reason: str = ""
    policy: Mapping[State, Skill] | None = field(default=None, repr=False, compare=False)
    back_end_failed: bool = False


def failed_grade(error: SkillplanError) -> Grade:
    """Return the grade of a solver that failed, or met a back end that did."""
    back_end_failed = isinstance(error, BackEndError)
    return Grade(Status.FAILED, reason=str(error), back_end_failed=back_end_failed)


@dataclass(frozen=True)
class Draft:
    """A result that the referee has not seen yet: who solved what, how and at what effort.

    Parameters
    ----------
    task, kind, sha256
        The task, its domain and the hash of its content.
    solver, seed, physics, collision
        How it is solved.
    cost_unit
        The unit of the task's metric.
    timed_by
        The back ends that tell how long skills take; empty where the task's own figures count.
    states, expanded, checks, cache_hits, trajectories, wall_s
        How often the solver queried the model, and how long it took [s].
    interrupted
        Whether the user ended the search.
    trace
        Figures of the search.
    not_checked
        Sentences of the back ends about what they leave unchecked of the task.
    dwells_from
        Key paths of the task file that its dwell times are from.
    """

    task: str
    kind: str
    sha256: str
    solver: str
    seed: int
    physics: str
    collision: str
    cost_unit: str = ""
    timed_by: str = ""
    states: int = 0
    expanded: int | None = None
    checks: int = 0
    cache_hits: int = 0
    trajectories: int = 0
    wall_s: float = 0.0
    interrupted: bool = False
    trace: Mapping[str, Any] = field(default_factory=dict)
    not_checked: tuple[str, ...] = ()
    dwells_from: tuple[str, ...] = ()

    def graded(self, grade: Grade) -> Result:
        """Return the result: the draft with what the referee grants.

        Raises
        ------
        ValueError
            If the grade contradicts itself, as a plan without a cost.
        """
        return Result(**vars(self), **vars(grade))
