"""A plan executed in one continuous world: how each skill went, and where all bodies ended."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from skillplan.files.atomic_file import replacing
from skillplan.files.output_path import refusing
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
    """Yield what writes a row of the trace; what was there is replaced in the end.

    Columns are ``time_s``, ``skill``, ``phase`` (what the robot is at in it), tip and target [m],
    joint angles [rad], the opening of the
    jaws [m], the contact force between bodies that are not expected to touch [N], and of every
    body its position [m] and orientation; empty where a body is nowhere.

    Parameters
    ----------
    path
        Where to.
    bodies
        Their names, in the order of the columns.
    option
        Which names the file, for messages.

    Raises
    ------
    OptionError
        If it cannot be written.
    """
    with (
        refusing(option, path),
        replacing(path) as file,
    ):
        text = io.TextIOWrapper(file, "utf-8", newline="")
        trace = _Trace(csv.writer(text, lineterminator="\n"), bodies)

        def note(sample: Sample) -> None:
            with refusing(option, path):
                trace.note(sample)

        yield note
        text.detach()


class _Trace:
    """Writes the heading with the first row, when the number of joints is known."""

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
        cells += [_cell(value) for value in (*figures, sample.opening_m, sample.contact_n)]
        for name in self._bodies:
            pose = sample.bodies.get(name)
            cells += (
                [""] * len(_POSE)
                if pose is None
                else [_cell(value) for value in (*pose.position, *pose.orientation)]
            )
        self._writer.writerow(cells)

    def _heading(self, joints: int) -> list[str]:
        heading = ["time_s", "skill", "phase"]
        heading += [f"{point}_{axis}_m" for point in ("tip", "target") for axis in "xyz"]
        heading += [f"joint_{number}_rad" for number in range(1, joints + 1)]
        heading += ["opening_m", "contact_n"]
        return heading + [f"{name}_{figure}" for name in self._bodies for figure in _POSE]


def _cell(value: float) -> str:
    # Rounded to nothing, a figure below zero has no sign.
    return f"{round(value, 6) + 0.0:.6f}"


@dataclass(frozen=True)
class PlannedTimes:
    """Times of a plan as it was planned.

    Parameters
    ----------
    durations_s
        Of every skill [s].
    timed_by
        The back ends that planned the trajectories; empty if travel is by the task's speed.
    """

    durations_s: Sequence[float]
    timed_by: str


@dataclass(frozen=True)
class TimeDifference:
    """Difference of simulated and planned time, over the skills that succeeded.

    Parameters
    ----------
    simulated_s, planned_s
        Times of those skills [s].
    settling_s
        Time before the first skill, in which the world comes to rest [s].
    acting_s
        Time at targets beyond the dwells [s]; None if the engine does not measure it.
    moving_s
        Travels and strokes, less those that were planned [s]; None with `acting_s`.
    timed_by
        As of `PlannedTimes`.
    """

    simulated_s: float
    planned_s: float
    settling_s: float
    acting_s: float | None
    moving_s: float | None
    timed_by: str

    @property
    def difference_s(self) -> float:
        """Simulated less planned time [s]."""
        return self.simulated_s - self.planned_s

    def document(self) -> dict[str, Any]:
        """Return it as JSON values."""
        return {
            "simulated_s": self.simulated_s,
            "planned_s": self.planned_s,
            "timed_by": self.timed_by,
            "difference_s": self.difference_s,
            "settling_s": self.settling_s,
            "acting_s": self.acting_s,
            "moving_s": self.moving_s,
        }


def time_difference(
    task: Task, skills: Sequence[Skill], planned: PlannedTimes, performance: Performance
) -> TimeDifference | None:
    """Return the difference of simulated and planned time; None if no skill succeeded.

    Parameters
    ----------
    task, skills
        The plan.
    planned
        Its planned times.
    performance
        Its simulation.
    """
    state, dwells_s = task.initial, 0.0
    done = []
    for skill, one in zip(skills, performance.skills, strict=False):
        if not one.verdict.is_feasible:
            break
        visits = () if skill.motion is None else skill.motion.visits(state)
        dwells_s += sum(visit.dwell_s for visit in visits)
        state = skill.prediction_in(state).apply(state)
        done.append(one)
    if not done:
        return None
    planned_s = sum(planned.durations_s[: len(done)])
    acted = [one.acting_s for one in done if one.acting_s is not None]
    acting_s = sum(acted) - dwells_s if len(acted) == len(done) else None
    settling_s = done[0].begin_s
    difference_s = done[-1].end_s - planned_s
    moving_s = None if acting_s is None else difference_s - settling_s - acting_s
    return TimeDifference(
        done[-1].end_s, planned_s, settling_s, acting_s, moving_s, planned.timed_by
    )


def simulation_outcome(
    task: Task, skills: Sequence[Skill], engine: str, performance: Performance
) -> SimulationOutcome:
    """Return the outcome of a simulation of a whole plan.

    Parameters
    ----------
    task, skills
        The task and the plan.
    engine
        Name of the engine.
    performance
        Its measurements.
    """
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
    planned
        Planned times; None if they are not known.
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

    @property
    def times(self) -> TimeDifference | None:
        """Difference of simulated and planned time; None if it is not known."""
        if self.planned is None:
            return None
        return time_difference(self.task, self.skills, self.planned, self.performance)

    def document(self) -> dict[str, Any]:
        """Return the JSON document ``skillplan.simulation/1``."""
        task, made, times = self.task, self.performance, self.times
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
            "held_s": made.held_s,
            "times": None if times is None else times.document(),
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
                    "acting_s": one.acting_s,
                    "planned_s": None if self.planned is None else self.planned.durations_s[index],
                    "evidence": dict(one.verdict.evidence),
                }
                for index, (skill, one) in enumerate(zip(self.skills, made.skills, strict=False))
            ],
            "arrivals": [
                {
                    "body": arrival.body,
                    "goal": _pose(arrival.goal),
                    "final": _pose(arrival.final),
                    "offset_mm": 1000 * arrival.offset_m,
                    "tilt_deg": math.degrees(arrival.tilt_rad),
                }
                for arrival in made.arrivals
            ],
            "largest_offset_mm": self.largest_mm,
            "largest_tilt_deg": self.largest_deg,
            "figures": dict(made.figures),
            "files": dict(self.files or {}),
        }

    @property
    def largest_mm(self) -> float | None:
        """How far off its goal the body farthest off ended [mm]; None without arrivals."""
        return max((1000 * arrival.offset_m for arrival in self.performance.arrivals), default=None)

    @property
    def largest_deg(self) -> float | None:
        """How far the body most turned away from its goal ended [deg]; None without arrivals."""
        arrivals = self.performance.arrivals
        return max((math.degrees(arrival.tilt_rad) for arrival in arrivals), default=None)


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
