"""A plan executed in one continuous world: how each skill went, and where all bodies ended."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from skillplan.physics.performance import Performance, PerformedSkill
from skillplan.task.scene import Pose
from skillplan.task.skill import Skill
from skillplan.task.task import Task
from skillplan.views.tables.evidence_text import evidence_text
from skillplan.views.tables.table import Column, Table


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
    def _steps_per_s(self) -> float | None:
        return self.performance.steps / self.wall_s if self.wall_s > 0 else None

    def document(self) -> dict[str, Any]:
        """Return the JSON document ``skillplan.simulation/1``."""
        task, made = self.task, self.performance
        return {
            "schema": "skillplan.simulation/1",
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
            "steps_per_s": self._steps_per_s,
            "skills": [
                {
                    "index": index,
                    "skill": one.skill,
                    "action": task.action(one.skill),
                    "status": one.verdict.status.value,
                    "reason": one.verdict.reason or None,
                    "begin_s": one.begin_s,
                    "end_s": one.end_s,
                    "evidence": dict(one.verdict.evidence),
                }
                for index, one in enumerate(made.skills)
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
            "largest_offset_mm": self._largest_mm,
            "largest_tilt_deg": self._largest_deg,
            "figures": dict(made.figures),
            "files": dict(self.files or {}),
        }

    @property
    def _largest_mm(self) -> float | None:
        return max((1000 * one.offset_m for one in self.performance.arrivals), default=None)

    @property
    def _largest_deg(self) -> float | None:
        arrivals = self.performance.arrivals
        return max((math.degrees(one.tilt_rad) for one in arrivals), default=None)

    def tables(self) -> list[Table]:
        """Return where all bodies ended, and how each skill went with the whole below."""
        title = f"{self.task.name}: simulated by {self.physics}"
        columns = [
            Column("body"),
            Column("off goal [mm]", right=True),
            Column("turned [deg]", right=True),
            Column("final x y z [m]", right=True),
        ]
        arrivals = [
            (
                one.body,
                f"{1000 * one.offset_m:.3f}",
                f"{math.degrees(one.tilt_rad):.3f}",
                " ".join(f"{round(value, 4) + 0.0:.4f}" for value in one.final.position),
            )
            for one in self.performance.arrivals
        ]
        tables = [Table(f"{title}: where bodies ended", columns, arrivals)] if arrivals else []
        columns = [
            Column("step", right=True),
            Column("action", right=True),
            Column("skill"),
            Column("verdict"),
            Column("from [s]", right=True),
            Column("to [s]", right=True),
            Column("reason"),
            Column("measured", below=True),
        ]
        rows = [self._row(index, one) for index, one in enumerate(self.performance.skills)]
        return [*tables, Table(title, columns, rows, self._notes())]

    def _row(self, index: int, one: PerformedSkill) -> tuple[str, ...]:
        return (
            str(index + 1),
            str(self.task.action(one.skill)),
            one.skill,
            one.verdict.status.value,
            f"{one.begin_s:.1f}",
            f"{one.end_s:.1f}",
            one.verdict.reason or "-",
            evidence_text(one.verdict.evidence) or "-",
        )

    def _notes(self) -> list[str]:
        made = self.performance
        notes = [f"feasible   {_yes(self.feasible)}", f"complete   {_yes(self.complete)}"]
        failed = made.failed
        if failed is not None:
            step = len(made.skills)
            notes.append(f"failure    at step {step} ({failed.skill}): {failed.verdict.reason}")
        elif self.obstacle is not None:
            notes.append(f"failure    {self.obstacle}")
        elif self.stopped:
            notes.append(f"stopped    after {len(made.skills)} of {len(self.skills)} skills")
        elif not self.complete:
            notes.append("failure    at the end: the goal is not reached")
        largest_mm, largest_deg = self._largest_mm, self._largest_deg
        if largest_mm is not None and largest_deg is not None:
            notes.append(f"arrival    within {largest_mm:.3f} mm and {largest_deg:.3f} degrees")
        rate = self._steps_per_s
        speed = f", {rate:,.0f} steps/s" if rate is not None else ""
        speed += ", filming included" if "video" in (self.files or {}) else ""
        notes.append(
            f"effort     {made.simulated_s:.1f} s simulated in {made.steps:,} steps, "
            f"{self.wall_s:.1f} s{speed}"
        )
        if made.figures:
            notes.append(f"measured   {evidence_text(made.figures)}")
        notes += [f"{option:<10} {path}" for option, path in (self.files or {}).items()]
        return notes


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


def _yes(value: bool) -> str:
    return "yes" if value else "no"
