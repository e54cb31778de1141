"""From a skill's visits to linear motions of the hand: the via points of Moller et al., sec. 4.4.

Every visit is an approach, an act and a retreat: the tip of the hand comes down from above a
target, acts there, and goes up again. Between two of them it is transferred at safe height. Engines
and detectors that model a hand share this planner, so that they check one and the same motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from skillplan.task.motion import Event, Point, Visit
from skillplan.task.scene import Body, Grasp, GraspKind, Robot, Tool
from skillplan.task.shape import Box
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task

# Of a part's height so much is between the jaws, and never more than so much [m].
_DEPTH_FRACTION = 0.5
_MOST_DEPTH_M = 0.012
# Unless something else is requested, the hand is turned as the wrist has most room: closing along
# the y of what it handles [rad].
_NATURAL_YAW_RAD = math.pi / 2


@dataclass(frozen=True, slots=True)
class LinearMotion:
    """One approach, act and retreat of the hand.

    Parameters
    ----------
    visit
        What is done, and to what.
    tip
        Where the tip of the hand is when it acts [m]: midway between the fingertips, the rim of
        the suction cup, or the end of the bit, at the lowest point of the hand or tool.
    above
        Where it comes from and goes back to [m].
    closing_yaw_rad
        Direction in which jaws close, from x about the vertical [rad].
    carries
        The body in the hand during the approach, or None.
    tool
        The tool attached during the approach, or None.
    leaves_with
        The body in the hand during the retreat, or None.
    """

    visit: Visit
    tip: Point
    above: Point
    closing_yaw_rad: float
    carries: str | None
    tool: Tool | None
    leaves_with: str | None


def grasp_of(body: Body) -> Grasp:
    """Return how a body is held: as the task says, or else across its narrower side."""
    return body.grasp or jaws_about(body.boxes)


def jaws_about(
    boxes: Sequence[Box],
    closing_axis: str | None = None,
    depth_m: float | None = None,
    at_m: tuple[float, float] | None = None,
) -> Grasp:
    """Return how jaws hold what is made of some boxes.

    Parameters
    ----------
    boxes
        At least one, in the body's frame.
    closing_axis
        ``x`` or ``y``; None for the narrower side.
    depth_m
        How far below the top the fingers reach [m]; None for half the height of what they hold,
        12 mm at most.
    at_m
        Where the tip is in the body's frame [m]; None for the middle of what is held.
    """
    tops_m = [box.centre[2] + box.size[2] / 2 for box in boxes]
    top_m = max(tops_m)
    if depth_m is None:
        highest = [box for box, z_m in zip(boxes, tops_m, strict=True) if z_m > top_m - 1e-6]
        depth_m = min(_DEPTH_FRACTION * min(box.size[2] for box in highest), _MOST_DEPTH_M)
    held = [box for box, z_m in zip(boxes, tops_m, strict=True) if z_m > top_m - depth_m]
    spans = [
        (
            min(box.centre[axis] - box.size[axis] / 2 for box in held),
            max(box.centre[axis] + box.size[axis] / 2 for box in held),
        )
        for axis in (0, 1)
    ]
    widths = [high - low for low, high in spans]
    axis = "xy".index(closing_axis or ("x" if widths[0] <= widths[1] + 1e-9 else "y"))
    x_m, y_m = at_m or ((low + high) / 2 for low, high in spans)
    return Grasp(GraspKind.JAWS, (x_m, y_m, top_m - depth_m), "xy"[axis], widths[axis])


def linear_motions(
    task: Task, skill: Skill, state: State, drop_height_m: float = 0.0
) -> list[LinearMotion]:
    """Return the linear motions of a skill in a state in which it is applicable.

    Parameters
    ----------
    task
        The skill's task.
    skill
        With a motion.
    state
        Where it starts.
    drop_height_m
        From how high above its goal a part is let go [m], >= 0.

    Raises
    ------
    ValueError
        If the skill has no motion, or no route of it fits the state.
    """
    if skill.motion is None:
        raise ValueError(f"Skill {skill.name!r} has no motion.")
    robot = task.scene.robot(skill.motion.robot)
    tool = robot.tool(state)
    carries = skill.motion.carries
    found = []
    for visit in skill.motion.visits(state):
        motion = _linear_motion(task, robot, visit, carries, tool, drop_height_m)
        found.append(motion)
        carries = motion.leaves_with
        tool = tool_after(robot, visit, tool)
    return found


def tool_after(robot: Robot, visit: Visit, tool: Tool | None) -> Tool | None:
    """Return the tool that is attached after a visit."""
    if visit.event is Event.OFFLOAD:
        return None
    if visit.event is Event.LOAD:
        return next(item for item in robot.tools if item.name == visit.subject)
    return tool


def _linear_motion(
    task: Task,
    robot: Robot,
    visit: Visit,
    carries: str | None,
    tool: Tool | None,
    drop_height_m: float,
) -> LinearMotion:
    x_m, y_m, z_m = visit.position
    safe_m = max(robot.safe_height_m, z_m)
    yaw_rad = visit.yaw_rad + _NATURAL_YAW_RAD
    lift_m = drop_m = 0.0
    leaves_with = carries
    if visit.event in (Event.GRASP, Event.RELEASE):
        grasp = grasp_of(task.scene.body(visit.subject))
        tip_x, tip_y, lift_m = grasp.tip
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        x_m, y_m = x_m + cos * tip_x - sin * tip_y, y_m + sin * tip_x + cos * tip_y
        if grasp.closing_axis == "x":
            yaw_rad -= _NATURAL_YAW_RAD
        if visit.event is Event.RELEASE:
            drop_m, leaves_with = drop_height_m, None
        else:
            leaves_with = visit.subject
    elif visit.event is Event.FETCH:
        leaves_with = visit.subject
    elif visit.event is Event.DRIVE:
        # The screw is at the bit, its head on what it fastens once it is driven.
        lift_m = task.scene.body(visit.subject).height_m
        carries, leaves_with = visit.subject, None
    return LinearMotion(
        visit,
        (x_m, y_m, z_m + lift_m + drop_m),
        (x_m, y_m, safe_m + lift_m),
        yaw_rad,
        carries,
        tool,
        leaves_with,
    )
