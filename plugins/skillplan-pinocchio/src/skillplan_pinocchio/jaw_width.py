"""Whether jaws open as wide as a skill needs."""

from __future__ import annotations

from collections.abc import Iterator

from skillplan.physics.strokes import grasp_of
from skillplan.task.motion import Event, Visit
from skillplan.task.scene import GraspKind, Robot, Scene
from skillplan.task.skill import Skill
from skillplan_pinocchio.hulls import widest_m

_ROUNDING_M = 1e-6


def too_wide(scene: Scene, robot: Robot, skill: Skill) -> str | None:
    """Return in words which part is wider than the jaws open, or None.

    Parameters
    ----------
    scene
        The task's scene.
    robot
        Whose hand it is.
    skill
        What it is to do.
    """
    attached = skill.parameters.get("tool")
    tool = next((tool for tool in robot.tools if tool.name == attached), None)
    for visit in handled(skill):
        grasp = grasp_of(scene.body(visit.subject))
        opening_m = widest_m(tool)
        if grasp.kind is GraspKind.JAWS and grasp.width_m > opening_m + _ROUNDING_M:
            return (
                f"{visit.subject} is {grasp.width_m:.3f} m wide between the jaws, "
                f"and they open {opening_m:.3f} m"
            )
    return None


def handled(skill: Skill) -> Iterator[Visit]:
    """Yield the visits at which a skill takes or leaves a part."""
    for route in skill.motion.routes if skill.motion is not None else ():
        for visit in route.visits:
            if visit.event in (Event.GRASP, Event.RELEASE):
                yield visit
