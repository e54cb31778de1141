"""How wide jaws open: what they can hold, and how far they stand off it."""

from __future__ import annotations

from collections.abc import Iterator

from skillplan.physics.linear_motions import visited_grasp
from skillplan.robots.catalogue import STANDARD_HAND
from skillplan.robots.hand import Hand
from skillplan.task.motion import Event, Visit
from skillplan.task.scene import Grasp, GraspKind, Robot, Scene, Tool
from skillplan.task.skill import Skill
from skillplan.task.task import Task

_ROUNDING_M = 1e-6


def widest_m(tool: Tool | None, hand: Hand = STANDARD_HAND) -> float:
    """Return how far the jaws of a tool open at most [m].

    Parameters
    ----------
    tool
        A gripper; None for the hand itself.
    hand
        What is on the flange of the arm.
    """
    if tool is not None and tool.hand is not None:
        hand = tool.hand
    if tool is None or tool.opening_m is None:
        return hand.opening_m
    return min(tool.opening_m, hand.opening_m)


def jaw_opening_m(
    grasp: Grasp, clearance_m: float, tool: Tool | None, hand: Hand = STANDARD_HAND
) -> float:
    """Return how far open jaws are about a part [m]; closed for one that is lifted by suction.

    Parameters
    ----------
    grasp
        How the part is held.
    clearance_m
        How far each jaw stands off it [m], >= 0; less where they do not open so far.
    tool
        Whose jaws they are.
    hand
        What is on the flange of the arm.
    """
    if grasp.kind is GraspKind.SUCTION:
        return 0.0
    return min(grasp.width_m + 2 * clearance_m, widest_m(tool, hand))


def too_wide(scene: Scene, robot: Robot, skill: Skill) -> str | None:
    """Return in words which part of a skill is wider than the jaws open, or None.

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
    for visit in _handled(skill):
        grasp = visited_grasp(scene.body(visit.subject), visit)
        opening_m = widest_m(tool, robot.hand)
        if grasp.kind is GraspKind.JAWS and grasp.width_m > opening_m + _ROUNDING_M:
            return (
                f"{visit.subject} is {grasp.width_m:.3f} m wide between the jaws, and they open "
                f"{opening_m:.3f} m; give it another closing axis, or grasp: {{type: suction}}"
            )
    return None


def jaw_faults(task: Task) -> dict[str, str]:
    """Return the parts of a task with one robot that are too wide, by a fact about each."""
    found: dict[str, str] = {}
    scene = task.scene
    for skill in task.skills:
        ways = [skill.by(way) for way in skill.ways] or [skill]
        reasons = [too_wide(scene, scene.robots[0], one) for one in ways]
        # What is too wide in one way may be held in another.
        words = reasons[0] if all(reasons) else None
        for visit in _handled(skill) if words is not None else ():
            first = scene.body(visit.subject).placements[0].fact
            found.setdefault(task.operations.get(visit.subject, first), f"{words}.")
    return found


def _handled(skill: Skill) -> Iterator[Visit]:
    """Yield the visits at which a skill takes or leaves a part."""
    for route in skill.motion.routes if skill.motion is not None else ():
        for visit in route.visits:
            if visit.event in (Event.GRASP, Event.RELEASE):
                yield visit
