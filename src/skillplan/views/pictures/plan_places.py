"""Where a plan takes arm and parts: its path over the table, what it reaches, how it lets go."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

from skillplan.task.motion import Event
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.views.pictures.drawing import Point


@dataclass(frozen=True, slots=True)
class PathStep:
    """A step of a plan on its way over the table.

    Parameters
    ----------
    number
        From 1.
    stops
        Where it begins, every place it visits, such as a feeder, and where it ends, in the plane
        [m].
    """

    number: int
    stops: tuple[Point, ...]


def path_steps(task: Task, skills: Sequence[str]) -> list[PathStep]:
    """Return the steps of a plan that move the arm of a task with one."""
    state, steps = task.initial, []
    for number, name in enumerate(skills, start=1):
        skill = task.skill(name)
        after = skill.prediction_in(state).apply(state)
        if skill.motion is not None:
            robot = task.scene.robot(skill.motion.robot)
            (_, begin), (_, end) = robot.place(state), robot.place(after)
            visits = [visit.position for visit in skill.motion.visits(state)]
            stops = [point[:2] for point in (begin, *visits, end)]
            steps.append(PathStep(number, tuple(point for point, _ in groupby(stops))))
        state = after
    return steps


def reached_state(task: Task, skills: Sequence[str]) -> State:
    """Return the state after a plan."""
    state = task.initial
    for name in skills:
        state = task.skill(name).prediction_in(state).apply(state)
    return state


def releases(task: Task, skills: Sequence[str]) -> dict[str, tuple[float, float, float]]:
    """Return by body the direction in which a plan leaves it at its place."""
    state, found = task.initial, {}
    for name in skills:
        skill = task.skill(name)
        if skill.motion is not None:
            for visit in skill.motion.visits(state):
                if visit.event in (Event.RELEASE, Event.DRIVE):
                    found[visit.subject] = visit.along
        state = skill.prediction_in(state).apply(state)
    return found
