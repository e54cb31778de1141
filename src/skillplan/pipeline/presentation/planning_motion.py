"""How the arm moves in a plan that no engine performs: along its planned paths."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from skillplan.checks.single_check import introduce
from skillplan.errors import BackEndError, OptionError
from skillplan.physics.planned_motion import MotionPlans, PlannedMotion
from skillplan.pipeline import registry
from skillplan.pipeline.setup import DEFAULT_PHYSICS, SCREEN, Setup
from skillplan.pipeline.taken_ways import by_ways
from skillplan.plugins.blame import blame
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
    asked = replace(setup, physics=DEFAULT_PHYSICS, collision=(SCREEN,), screening=False)
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
