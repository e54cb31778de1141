"""Simulation of a plan in one continuous world: its skills, the final poses, and its trace."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skillplan.files.atomic_file import replace_file
from skillplan.files.output_path import report_write_errors
from skillplan.physics.performance import Performance, PerformedSkill, Sample
from skillplan.records import schemas
from skillplan.records.result import SimulationOutcome
from skillplan.task.scene import Pose
from skillplan.task.skill import Skill
from skillplan.task.task import Task

SUFFIXES = (".csv",)

_POSE = ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")


@contextmanager
def trace_file(
    path: Path, bodies: Sequence[str], option: str
) -> Iterator[Callable[[Sample], None]]:
    """Open a CSV file and yield a function that writes a row per sample; an old file is replaced.

    Columns are ``time_s``, ``skill``, ``phase`` (of the skill), tip and target [m], joint angles
    [rad], the opening of the jaws [m], the force between bodies that should not touch [N], and of
    every body its position [m] and orientation, empty for a body that is nowhere.

    Parameters
    ----------
    bodies
        Names of the bodies, in the order of the columns.
    option
        Option that names the file, for messages.

    Raises
    ------
    OptionError
        If it cannot be written.
    """
    with report_write_errors(option, path), replace_file(path) as file:
        text = io.TextIOWrapper(file, "utf-8", newline="")
        trace = _Trace(csv.writer(text, lineterminator="\n"), bodies)

        def note(sample: Sample) -> None:
            with report_write_errors(option, path):
                trace.note(sample)

        yield note
        text.detach()


class _Trace:
    """Writes rows, and the heading with the first one, when the number of joints is known."""

    def __init__(self, writer: Any, bodies: Sequence[str]) -> None:
        self._writer = writer
        self._bodies = bodies
        self._begun = False

    def note(self, sample: Sample) -> None:
        """Write a row."""
        if not self._begun:
            self._begun = True
            self._writer.writerow(self._heading(len(sample.joints_rad)))
        cells = [f"{sample.time_s:.6f}", sample.skill, sample.phase]
        figures = (*sample.tip, *sample.target, *sample.joints_rad)
        cells += [_format(value) for value in (*figures, sample.opening_m, sample.contact_n)]
        for name in self._bodies:
            pose = sample.bodies.get(name)
            cells += (
                [""] * len(_POSE)
                if pose is None
                else [_format(value) for value in (*pose.position, *pose.orientation)]
            )
        self._writer.writerow(cells)

    def _heading(self, joints: int) -> list[str]:
        heading = ["time_s", "skill", "phase"]
        heading += [f"{point}_{axis}_m" for point in ("tip", "target") for axis in "xyz"]
        heading += [f"joint_{number}_rad" for number in range(1, joints + 1)]
        heading += ["opening_m", "contact_n"]
        return heading + [f"{name}_{figure}" for name in self._bodies for figure in _POSE]


def _format(value: float) -> str:
    # Adding 0.0 removes the sign of a rounded negative zero.
    return f"{round(value, 6) + 0.0:.6f}"


@dataclass(frozen=True)
class PlannedTimes:
    """Planned times of a plan.

    Parameters
    ----------
    timed_by
        Back ends that planned the trajectories; empty if travel is by the task's speed.
    waits_s
        Parts of the durations in which the arm waits for parts [s]; empty for none.
    """

    durations_s: Sequence[float]
    timed_by: str
    waits_s: Sequence[float] = ()


@dataclass(frozen=True)
class TimeDifference:
    """Difference of simulated and planned time, over the skills that succeeded.

    Parameters
    ----------
    simulated_s, planned_s
        Durations of these skills [s].
    settling_s
        Time before the first skill, in which the world comes to rest [s].
    acting_s
        Time at targets beyond the dwells [s]; None if the engine does not measure it.
    moving_s
        Travels and strokes minus the planned ones [s]; None with `acting_s`.
    waiting_s
        Waits for parts minus the planned ones [s].
    timed_by
        As in `PlannedTimes`.
    """

    simulated_s: float
    planned_s: float
    settling_s: float
    acting_s: float | None
    moving_s: float | None
    waiting_s: float
    timed_by: str

    @property
    def difference_s(self) -> float:
        """Simulated minus planned time [s]."""
        return self.simulated_s - self.planned_s

    def document(self) -> dict[str, Any]:
        """Return the JSON values."""
        return {
            "simulated_s": self.simulated_s,
            "planned_s": self.planned_s,
            "timed_by": self.timed_by,
            "difference_s": self.difference_s,
            "settling_s": self.settling_s,
            "acting_s": self.acting_s,
            "moving_s": self.moving_s,
            "waiting_s": self.waiting_s,
        }


def compute_time_difference(
    task: Task, skills: Sequence[Skill], planned: PlannedTimes, performance: Performance
) -> TimeDifference | None:
    """Return the difference of simulated and planned time; None if no skill succeeded."""
    state, dwells_s = task.initial, 0.0
    done = []
    for skill, done_skill in zip(skills, performance.skills, strict=False):
        if not done_skill.verdict.is_feasible:
            break
        visits = () if skill.motion is None else skill.motion.visits(state)
        dwells_s += sum(visit.acts_s for visit in visits)
        state = skill.prediction_in(state).apply(state)
        done.append(done_skill)
    if not done:
        return None
    planned_s = sum(planned.durations_s[: len(done)])
    acting_times = [done_skill.acting_s for done_skill in done if done_skill.acting_s is not None]
    acting_s = sum(acting_times) - dwells_s if len(acting_times) == len(done) else None
    settling_s = done[0].begin_s
    difference_s = done[-1].end_s - planned_s
    waiting_s = sum(entry.waited_s for entry in done) - sum(planned.waits_s[: len(done)])
    moving_s = None if acting_s is None else difference_s - settling_s - acting_s - waiting_s
    return TimeDifference(
        done[-1].end_s, planned_s, settling_s, acting_s, moving_s, waiting_s, planned.timed_by
    )


def summarise_simulation(
    task: Task, skills: Sequence[Skill], engine: str, performance: Performance
) -> SimulationOutcome:
    """Summarise the simulation of a whole plan."""
    failed = performance.failed
    if failed is not None:
        step = performance.skills.index(failed) + 1
        return SimulationOutcome(engine, False, step, failed.skill, failed.verdict.reason)
    if len(performance.skills) < len(skills):
        reason = f"ended after {len(performance.skills)} of {len(skills)} skills"
        return SimulationOutcome(engine, False, reason=reason)
    state = task.initial
    for skill in skills:
        state = skill.prediction_in(state).apply(state)
    complete = task.goal.holds(state)
    return SimulationOutcome(engine, complete, reason="" if complete else "the goal is not reached")


@dataclass(frozen=True)
class Simulation:
    """Simulation of a plan.

    Parameters
    ----------
    stopped
        True if it ended early.
    files
        Further files that were written, by option.
    obstacle
        Precondition that stops the plan, if any.
    planned
        Planned times, if known.
    not_checked
        Sentences of the engine about what it did not simulate.
    """

    task: Task
    skills: Sequence[Skill]
    physics: str
    performance: Performance
    wall_s: float
    stopped: bool = False
    files: Mapping[str, str] | None = None
    obstacle: str | None = None
    planned: PlannedTimes | None = None
    not_checked: Sequence[str] = ()

    @property
    def feasible(self) -> bool:
        """True if no skill failed and every skill was applicable in its turn."""
        return self.performance.failed is None and self.obstacle is None

    @property
    def complete(self) -> bool:
        """True if the goal holds at the end, by the predictions of the skills that succeeded."""
        state = self.task.initial
        for skill, done in zip(self.skills, self.performance.skills, strict=False):
            if done.verdict.is_feasible:
                state = skill.prediction_in(state).apply(state)
        return self.task.goal.holds(state)

    @property
    def steps_per_s(self) -> float | None:
        """Simulated steps per second [1/s]; None if no time has passed."""
        return self.performance.steps / self.wall_s if self.wall_s > 0 else None

    @property
    def times(self) -> TimeDifference | None:
        """Difference of simulated and planned time, if known."""
        if self.planned is None:
            return None
        return compute_time_difference(self.task, self.skills, self.planned, self.performance)

    def document(self) -> dict[str, Any]:
        """Return the JSON document ``skillplan.simulation/1``."""
        task, performance, times = self.task, self.performance, self.times
        return {
            "schema": schemas.SIMULATION,
            "task": {"name": task.name, "kind": task.kind, "sha256": task.sha256},
            "physics": self.physics,
            "actions": [task.action(skill) for skill in self.skills],
            "feasible": self.feasible,
            "complete": self.complete,
            "stopped": self.stopped,
            "obstacle": self.obstacle,
            "simulated_s": performance.simulated_s,
            "held_s": performance.held_s,
            "times": None if times is None else times.document(),
            "steps": performance.steps,
            "wall_s": self.wall_s,
            "steps_per_s": self.steps_per_s,
            "skills": [
                {
                    "index": index,
                    "skill": skill.name,
                    "action": task.action(skill),
                    **({"way": get_variant(skill, entry)} if skill.ways else {}),
                    "status": entry.verdict.status.value,
                    "reason": entry.verdict.reason or None,
                    "begin_s": entry.begin_s,
                    "end_s": entry.end_s,
                    "acting_s": entry.acting_s,
                    "planned_s": None if self.planned is None else self.planned.durations_s[index],
                    "evidence": dict(entry.verdict.evidence),
                }
                for index, (skill, entry) in enumerate(
                    zip(self.skills, performance.skills, strict=False)
                )
            ],
            "arrivals": [
                {
                    "body": arrival.body,
                    "goal": _pose(arrival.goal),
                    "final": _pose(arrival.final),
                    "offset_mm": 1000 * arrival.offset_m,
                    "tilt_deg": math.degrees(arrival.tilt_rad),
                }
                for arrival in performance.arrivals
            ],
            "taken_away": list(performance.taken_away),
            "largest_offset_mm": self.largest_mm,
            "largest_tilt_deg": self.largest_deg,
            "figures": dict(performance.figures),
            "not_checked": list(self.not_checked),
            "files": dict(self.files or {}),
        }

    @property
    def largest_mm(self) -> float | None:
        """Largest distance of a body from its goal [mm]; None without arrivals."""
        return max((1000 * arrival.offset_m for arrival in self.performance.arrivals), default=None)

    @property
    def largest_deg(self) -> float | None:
        """Largest rotation of a body from its goal [deg]; None without arrivals."""
        arrivals = self.performance.arrivals
        return max((math.degrees(arrival.tilt_rad) for arrival in arrivals), default=None)


def get_variant(skill: Skill, done: PerformedSkill) -> str | None:
    """Return the variant that a skill took; None for a skill without variants."""
    return done.skill.removeprefix(f"{skill.name} ") if skill.ways else None


def find_applicable_part(task: Task, skills: Sequence[Skill]) -> tuple[Sequence[Skill], str | None]:
    """Return the part of a plan that preconditions allow, and why it ends there."""
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
