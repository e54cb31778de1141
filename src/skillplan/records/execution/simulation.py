"""A plan executed in one continuous world: how each skill went, and where all bodies ended."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from skillplan.physics.performance import Performance, PerformedSkill
from skillplan.records import schemas
from skillplan.task.scene import Pose
from skillplan.task.skill import Skill
from skillplan.task.task import Task


@dataclass(frozen=True)
class Simulation:
    """What became of a plan in simulation.

    Parameters
    ----------
    task, skills
        What was to be executed.
    physics
        The engine's name.
    performance
        What was measured.
    wall_s
        How long that took [s], >= 0.
    stopped
        Whether it was ended early.
    files
        What was written besides, by option.
    obstacle
        Why the plan cannot be gone through, by its preconditions alone; None where it can.
    """

    task: Task
    skills: Sequence[Skill]
    physics: str
    performance: Performance
    wall_s: float
    stopped: bool = False
    files: Mapping[str, str] | None = None
    obstacle: str | None = None

    @property
    def feasible(self) -> bool:
        """Whether no skill of the plan failed, and each is applicable when its turn comes."""
        return self.performance.failed is None and self.obstacle is None

    @property
    def complete(self) -> bool:
        """Whether the goal holds in the end, by the predictions of the skills that succeeded."""
        state = self.task.initial
        for skill, done in zip(self.skills, self.performance.skills, strict=False):
            if done.verdict.is_feasible:
                state = skill.prediction_in(state).apply(state)
        return self.task.goal.holds(state)

    @property
    def steps_per_s(self) -> float | None:
        """How many simulated steps were made a second [1/s]; None where no time has passed."""
        return self.performance.steps / self.wall_s if self.wall_s > 0 else None

    def document(self) -> dict[str, Any]:
        """Return the JSON document ``skillplan.simulation/1``."""
        task, made = self.task, self.performance
        return {
            "schema": schemas.SIMULATION,
            "task": {"name": task.name, "kind": task.kind, "sha256": task.sha256},
            "physics": self.physics,
            "actions": [task.action(skill) for skill in self.skills],
            "feasible": self.feasible,
            "complete": self.complete,
            "stopped": self.stopped,
            "obstacle": self.obstacle,
            "simulated_s": made.simulated_s,
            "steps": made.steps,
            "wall_s": self.wall_s,
            "steps_per_s": self.steps_per_s,
            "skills": [
                {
                    "index": index,
                    "skill": skill.name,
                    "action": task.action(skill),
                    **({"way": way_of(skill, one)} if skill.ways else {}),
                    "status": one.verdict.status.value,
                    "reason": one.verdict.reason or None,
                    "begin_s": one.begin_s,
                    "end_s": one.end_s,
                    "evidence": dict(one.verdict.evidence),
                }
                for index, (skill, one) in enumerate(zip(self.skills, made.skills, strict=False))
            ],
            "arrivals": [
                {
                    "body": one.body,
                    "goal": _pose(one.goal),
                    "final": _pose(one.final),
                    "offset_mm": 1000 * one.offset_m,
                    "tilt_deg": math.degrees(one.tilt_rad),
                }
                for one in made.arrivals
            ],
            "largest_offset_mm": self.largest_mm,
            "largest_tilt_deg": self.largest_deg,
            "figures": dict(made.figures),
            "files": dict(self.files or {}),
        }

    @property
    def largest_mm(self) -> float | None:
        """How far off its goal the body farthest off ended [mm]; None without arrivals."""
        return max((1000 * one.offset_m for one in self.performance.arrivals), default=None)

    @property
    def largest_deg(self) -> float | None:
        """How far the body most turned away from its goal ended [deg]; None without arrivals."""
        arrivals = self.performance.arrivals
        return max((math.degrees(one.tilt_rad) for one in arrivals), default=None)


def way_of(skill: Skill, done: PerformedSkill) -> str | None:
    """Return the way in words that a skill with several took; None of a skill with one."""
    return done.skill.removeprefix(f"{skill.name} ") if skill.ways else None


def applicable_part(task: Task, skills: Sequence[Skill]) -> tuple[Sequence[Skill], str | None]:
    """Return how far a plan can be gone through by its preconditions, and why no further."""
    state = task.initial
    for index, skill in enumerate(skills):
        if not skill.applicable(state):
            amiss = skill.why_not(state)
            names = [*amiss.requires, *(f"not {name}" for name in amiss.forbids)]
            why = f"at step {index + 1} ({skill.name}): precondition: {', '.join(names)} must hold"
            return skills[:index], why
        state = skill.prediction_in(state).apply(state)
    return skills, None


def _pose(pose: Pose) -> dict[str, list[float]]:
    return {"position_m": list(pose.position), "orientation": list(pose.orientation)}
