"""The result of one solver on one task, as the referee grades it, and where the task is from."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from skillplan.model.replay import Step
from skillplan.records import schemas
from skillplan.solvers.solution import relative_gap
from skillplan.task.skill import Skill
from skillplan.task.state import State


@dataclass(frozen=True)
class Origin:
    """The task file and how it was read.

    Parameters
    ----------
    file
        Path as the user gave it.
    part
        Name of one task of a chain; None for the only task or all.
    changes
        Key path to YAML value; they override the file.
    physics, collision
        Names of the back ends that the user chose; None and empty for the choice of the file.
    options
        Plugin name to option values that the user gave.
    screening
        True if geometry was checked before anything was executed.
    """

    file: str
    part: str | None = None
    changes: Mapping[str, str] = field(default_factory=dict)
    physics: str | None = None
    collision: tuple[str, ...] = ()
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    screening: bool = False

    def given(self) -> list[str]:
        """Return the options that changed how the file was read, as on a command line."""
        return [
            *(f"--set {key}={value}" for key, value in self.changes.items()),
            *([] if self.part is None else [f"--part {self.part}"]),
            *([] if self.physics is None else [f"--physics {self.physics}"]),
            *([f"--collision {','.join(self.collision)}"] if self.collision else []),
            *(
                f"-O {plugin}.{key}={value}"
                for plugin, values in self.options.items()
                for key, value in values.items()
            ),
        ]

    def document(self) -> dict[str, Any]:
        """Return the origin as JSON values."""
        return {
            "file": self.file,
            "part": self.part,
            "set": dict(self.changes),
            "physics": self.physics,
            "collision": list(self.collision),
            "options": {plugin: dict(values) for plugin, values in self.options.items()},
            "screening": self.screening,
        }


class Status(StrEnum):
    """The verdict of the referee.

    ``optimal``: a valid plan, proved to be the best. ``solved``: a valid plan. ``infeasible``: no
    plan exists, proved. ``unsolved``: no plan was found. ``refused``: the solver does not serve the
    task. ``wrong``: the solver made a false claim. ``failed``: the solver or a back end raised.
    """

    OPTIMAL = "optimal"
    SOLVED = "solved"
    INFEASIBLE = "infeasible"
    UNSOLVED = "unsolved"
    REFUSED = "refused"
    WRONG = "wrong"
    FAILED = "failed"


@dataclass(frozen=True)
class SimulationOutcome:
    """Outcome of one simulation of a whole plan.

    Parameters
    ----------
    engine
        The physics engine.
    complete
        True if every skill succeeded and the goal was reached.
    failed_step
        Number of the first failed skill, from 1; None without one.
    skill
        Name of the first failed skill.
    reason
        Reason why the simulation failed or ended early; empty if it is complete.
    """

    engine: str
    complete: bool
    failed_step: int | None = None
    skill: str | None = None
    reason: str = ""

    def document(self) -> dict[str, Any]:
        """Return the outcome as JSON values."""
        return {
            "engine": self.engine,
            "complete": self.complete,
            "failed_step": self.failed_step,
            "skill": self.skill,
            "reason": self.reason,
        }


@dataclass(frozen=True)
class Result:
    """The result of one solver on one task, graded by the referee.

    Parameters
    ----------
    task, kind, sha256
        Name and kind of the task, and the hash of its content.
    solver, seed, physics, collision
        Solver and back ends.
    status
        The verdict of the referee.
    cost, cost_unit
        Cost of the replayed plan, or expected cost of the policy; None without one.
    lower_bound
        No plan costs less; None if nothing was proved.
    bound_method
        The method that proved the bound; empty without one.
    steps
        The replayed plan.
    makespan_s
        Duration of the plan [s].
    reason
        Reason for the status; empty for an optimal plan.
    timed_by
        Names of the back ends that plan times; empty for times of the task file.
    states, expanded, checks, cache_hits, trajectories, wall_s
        Effort of the solver, and its duration [s] without the referee.
    trace
        Figures of the search.
    policy
        The policy behind the plan; None if the solver gave a plan.
    origin
        The task file and how it was read; None if the task is not from a file.
    back_end_failed
        True if a back end failed, and not the solver.
    not_checked
        Sentences of the back ends about unchecked properties of the task.
    simulation
        Outcome of a simulation of the whole plan; None if it was not simulated.
    dwells_from
        Key paths of the dwell times in the task file.

    Raises
    ------
    ValueError
        If a plan has no cost, a cost or time is negative, the bound exceeds the cost, or an
        optimal plan has a gap.
    """

    task: str
    kind: str
    sha256: str
    solver: str
    seed: int
    physics: str
    collision: str
    status: Status
    cost: float | None = None
    cost_unit: str = ""
    lower_bound: float | None = None
    bound_method: str = ""
    steps: tuple[Step, ...] = ()
    makespan_s: float | None = None
    reason: str = ""
    timed_by: str = ""
    states: int = 0
    expanded: int | None = None
    checks: int = 0
    cache_hits: int = 0
    trajectories: int = 0
    wall_s: float = 0.0
    interrupted: bool = False
    trace: Mapping[str, Any] = field(default_factory=dict)
    policy: Mapping[State, Skill] | None = field(default=None, repr=False, compare=False)
    origin: Origin | None = None
    back_end_failed: bool = False
    not_checked: tuple[str, ...] = ()
    simulation: SimulationOutcome | None = None
    dwells_from: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        has_plan = self.status in (Status.OPTIMAL, Status.SOLVED)
        if has_plan != (self.cost is not None):
            raise ValueError(
                f"A result {self.status!s} must{'' if has_plan else ' not'} have a cost."
            )
        if self.wall_s < 0 or (self.makespan_s or 0) < 0 or (self.cost or 0) < 0:
            raise ValueError("Costs and times must be >= 0.")
        counts = (self.states, self.expanded or 0, self.checks, self.cache_hits, self.trajectories)
        if min(counts) < 0:
            raise ValueError("Counts must be >= 0.")
        cost, bound = self.cost, self.lower_bound
        if cost is not None and bound is not None and bound > cost + tolerance(cost):
            raise ValueError(f"Bound {bound} exceeds cost {cost}.")
        if self.status is Status.OPTIMAL and (self.gap is None or self.gap > 1e-6):
            raise ValueError("An optimal plan must not have a gap.")

    @property
    def gap(self) -> float | None:
        """(cost - lower bound) / cost; None if either is missing."""
        return relative_gap(self.cost, self.lower_bound)

    @property
    def makespan(self) -> int | None:
        """Number of skills of the plan; None without one."""
        return len(self.steps) if self.cost is not None else None

    @property
    def proved_by(self) -> tuple[str, ...]:
        """Names of the back ends under which the status was checked, physics first.

        The referee has replayed the plan under all of them. An ``optimal`` plan is the best, and
        an ``infeasible`` task has no plan, among the plans that all of them allow. Empty if the
        status makes no such claim.
        """
        if self.status not in (Status.OPTIMAL, Status.SOLVED, Status.INFEASIBLE):
            return ()
        return tuple(filter(None, (self.physics, *self.collision.split(","))))

    def document(self) -> dict[str, Any]:
        """Return the JSON document ``skillplan.result/1``."""
        bound = self.lower_bound
        bound = bound if bound is not None and math.isfinite(bound) else None
        return {
            "schema": schemas.RESULT,
            "task": {"name": self.task, "kind": self.kind, "sha256": self.sha256},
            "origin": None if self.origin is None else self.origin.document(),
            "solver": self.solver,
            "seed": self.seed,
            "physics": self.physics,
            "collision": self.collision,
            "status": self.status.value,
            "reason": self.reason,
            "proved_by": list(self.proved_by),
            "simulation": None if self.simulation is None else self.simulation.document(),
            "not_checked": list(self.not_checked),
            "cost": self.cost,
            "cost_unit": self.cost_unit,
            "lower_bound": bound,
            "bound_method": "" if bound is None else self.bound_method,
            "gap": self.gap,
            "makespan": self.makespan,
            "makespan_s": self.makespan_s,
            "timed_by": self.timed_by,
            "dwells_from": list(self.dwells_from),
            "skills": [step.skill for step in self.steps],
            "actions": [step.action for step in self.steps],
            "steps": [make_step_document(step) for step in self.steps],
            "stats": {
                "states": self.states,
                "expanded": self.expanded,
                "checks": self.checks,
                "cache_hits": self.cache_hits,
                "trajectories": self.trajectories,
                "wall_s": self.wall_s,
            },
            "trace": dict(self.trace),
            "policy": self.policy is not None,
        }


def make_step_document(step: Step) -> dict[str, Any]:
    """Return a step as JSON values, with the variant if the skill has several."""
    return {
        "index": step.index,
        "skill": step.skill,
        "action": step.action,
        "start": None if step.start is None else list(step.start),
        "goal": None if step.goal is None else list(step.goal),
        "cost": step.cost,
        "duration_s": step.duration_s,
        **({} if step.way is None else {"way": step.way}),
        **({} if not step.wait_s else {"wait_s": step.wait_s}),
    }


def tolerance(cost: float) -> float:
    """Return the difference by which rounding may change a cost."""
    return 1e-9 * max(1.0, abs(cost))
