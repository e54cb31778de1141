"""How the arm moves in a plan, and how long it takes: along its planned paths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from skillplan.checks.single_check import introduce
from skillplan.errors import BackEndError, OptionError
from skillplan.physics.performance import MotionPlans, PlannedMotion
from skillplan.pipeline import registry
from skillplan.pipeline.setup import DEFAULT_PHYSICS, SCREEN, Setup
from skillplan.pipeline.solving import make_model
from skillplan.pipeline.taken_ways import by_ways
from skillplan.plugins.blame import blame
from skillplan.records.execution.simulation import PlannedTimes
from skillplan.task.skill import Skill
from skillplan.task.task import Task


def plan_motion(
    task: Task,
    setup: Setup,
    skills: Sequence[Skill],
    ways: Sequence[str | None] = (),
    *,
    frames_per_s: int,
) -> PlannedMotion | str:
    """Return where arm and parts are in a plan, or say in words why nobody knows.

    Parameters
    ----------
    task
        Whose plan it is.
    setup
        Has the options of what plans paths.
    skills
        The plan, each applicable when its turn comes.
    ways
        As in `by_ways`.
    frames_per_s
        How many samples there are to a second, >= 1.

    Raises
    ------
    BackEndError
        If what plans paths fails.
    """
    if SCREEN not in registry.names("collision"):
        return "nothing that plans paths is installed: pip install skillplan-pinocchio"
    asked = replace(
        setup, physics=DEFAULT_PHYSICS, collision=(SCREEN,), screening=False, with_chart=False
    )
    try:
        made = introduce(asked.back_ends(task))
    except OptionError as error:
        return str(error)
    plans = next((one for one in made if isinstance(one, MotionPlans)), None)
    if plans is None:
        return f"{SCREEN} tells no paths of whole plans"
    taken = by_ways(task, skills, made, ways)
    try:
        return plans.planned_motion(taken, frames_per_s)
    except ValueError as error:
        return str(error)
    except BaseException as error:
        blame(
            error,
            type(plans),
            lambda words: f"Back end {SCREEN!r} failed: {words}",
            BackEndError,
        )


def planned_times(
    task: Task,
    skills: Sequence[Skill],
    timed_by: str,
    options: Mapping[str, Mapping[str, Any]],
) -> PlannedTimes | None:
    """Return how long the skills of a plan take as planned; None if an engine planned them.

    Parameters
    ----------
    task
        Whose plan it is.
    skills
        The plan, each applicable when its turn comes, and with one motion at most.
    timed_by
        Names of the detectors that plan trajectories, by commas; empty for travel by the task.
    options
        Option values by plugin.

    Raises
    ------
    OptionError
        If a detector refuses the task or an option is wrong.
    BackEndError
        If a back end fails.
    """
    names = tuple(filter(None, timed_by.split(",")))
    if not set(names) <= set(registry.names("collision")):
        return None
    setup = Setup(DEFAULT_PHYSICS, names, options)
    back_ends = introduce(setup.back_ends(task)) if names else []
    model, state, durations_s = make_model(task, setup, back_ends=back_ends), task.initial, []
    for skill in skills:
        durations_s.append(model.duration_s(state, skill))
        state = skill.prediction_in(state).apply(state)
    return PlannedTimes(durations_s, timed_by)
