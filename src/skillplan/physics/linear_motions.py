"""From a skill's visits to linear motions of the hand: the via points of Moller et al., sec. 4.4.

Every visit is an approach, an act and a retreat: the tip of the hand comes down from above a
target, follows the direction in which its load goes into place, acts there, and goes back the same
way. Between two of them it is transferred at safe height. Engines and detectors that model a hand
share this planner, so that they check one and the same motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from skillplan.task.grasp import AXES, Grasp, GraspKind
from skillplan.task.motion import Event, Point, Visit
from skillplan.task.pose import (
    DOWN,
    Pose,
    Quaternion,
    cross,
    dot,
    plus,
    same_direction,
    unit,
)
from skillplan.task.scene import Body, Robot, Tool
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
# What is left between a hand and the part that it comes to from the side, before and after [m].
_STANDOFF_M = 0.02
# How far a screw is from its hole where the hand begins to follow its axis [m].
_SCREW_STRETCH_M = 0.05
# What goes in from the side is so far above where it will lie, at most, not to drag on it [m].
_SIDE_LIFT_M = 3e-4
# A hand that does not point down reaches below its tip by no more than this [m].
_HAND_RADIUS_M = 0.11


@dataclass(frozen=True, slots=True)
class LinearMotion:
    """One approach, act and retreat of the hand, which is not turned meanwhile.

    Parameters
    ----------
    visit
        What is done, and to what.
    tip
        Where the tip of the hand is when it acts [m]: midway between the fingertips, the rim of
        the suction cup, or the end of the bit, at the outermost point of the hand or tool.
    closing_yaw_rad
        Of a hand that points down the direction in which jaws close, from x about the vertical
        [rad].
    orientation
        How the hand is turned: z points out of it, y along the closing axis of its jaws.
    approach
        Where the tip goes in straight lines [m], from at safe height to `tip`; two points at least.
    retreat
        Where it goes back [m], from `tip` to safe height.
    carries
        The body in the hand during the approach, or None.
    tool
        The tool attached during the approach, or None.
    leaves_with
        The body in the hand during the retreat, or None.
    drop_m
        How high above its goal a part is let go [m], >= 0.
    """

    visit: Visit
    tip: Point
    closing_yaw_rad: float
    orientation: Quaternion
    approach: tuple[Point, ...]
    retreat: tuple[Point, ...]
    carries: str | None
    tool: Tool | None
    leaves_with: str | None
    drop_m: float = 0.0

    @classmethod
    def straight_down(
        cls,
        visit: Visit,
        tip: Point,
        above: Point,
        closing_yaw_rad: float,
        carries: str | None,
        tool: Tool | None,
        leaves_with: str | None,
        drop_m: float = 0.0,
    ) -> LinearMotion:
        """Return a motion straight down from above a target and up again."""
        closing = (math.cos(closing_yaw_rad), math.sin(closing_yaw_rad), 0.0)
        orientation = Pose.of_axes(tip, closing, DOWN).orientation
        down, up = (above, tip), (tip, above)
        return cls(
            visit,
            tip,
            closing_yaw_rad,
            orientation,
            down,
            up,
            carries,
            tool,
            leaves_with,
            drop_m,
        )

    @property
    def above(self) -> Point:
        """Where the tip comes from [m]."""
        return self.approach[0]

    @property
    def ends_at(self) -> Point:
        """Where the tip ends, at safe height [m]."""
        return self.retreat[-1]

    @property
    def hand(self) -> Pose:
        """The pose of the tip when it acts: z points out of the hand, y along the closing axis."""
        return Pose(self.tip, self.orientation)

    @property
    def points(self) -> Point:
        """Unit vector in the world in which the hand points."""
        return self.hand.rotate(AXES["z"])

    @property
    def points_down(self) -> bool:
        """Whether the hand points straight down."""
        return same_direction(self.points, DOWN)

    @property
    def is_vertical(self) -> bool:
        """Whether the hand points down, and goes straight down and up again."""
        return self.points_down and len(self.approach) == len(self.retreat) == 2

    @property
    def grasp_tip(self) -> Point:
        """Where the tip is while what it handles is exactly where it belongs [m]."""
        return (self.tip[0], self.tip[1], self.tip[2] - self.drop_m)


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
    return Grasp(GraspKind.JAWS, (x_m, y_m, top_m - depth_m), AXES["xy"[axis]], widths[axis])


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


def visited_grasp(scene_body: Body, visit: Visit) -> Grasp:
    """Return how a visit holds a body: as it says itself, or as the body is held."""
    return visit.grasp or grasp_of(scene_body)


def _linear_motion(
    task: Task,
    robot: Robot,
    visit: Visit,
    carries: str | None,
    tool: Tool | None,
    drop_height_m: float,
) -> LinearMotion:
    leaves_with = carries
    grasp: Grasp | None = None
    if visit.event in (Event.GRASP, Event.RELEASE):
        grasp = visited_grasp(task.scene.body(visit.subject), visit)
        leaves_with = visit.subject if visit.event is Event.GRASP else None
    elif visit.event is Event.FETCH:
        leaves_with = visit.subject
    elif visit.event is Event.DRIVE:
        carries, leaves_with = visit.subject, None
    points, closing = _hand_directions(visit, grasp)
    drop_m = _drop_m(visit, drop_height_m)
    tip = _tip(task, visit, grasp)
    body = None if grasp is None else task.scene.body(visit.subject)
    if body is None or visit.pose.is_upright:
        # Of an upright body, its origin is where it begins.
        low_m = visit.position[2]
    else:
        low_m = -body.reach_m(visit.pose, DOWN)
    if same_direction(points, DOWN):
        yaw_rad = _closing_yaw_rad(visit, grasp, closing)
    else:
        yaw_rad, low_m = 0.0, min(low_m, tip[2] - _HAND_RADIUS_M)
    above_m = max(robot.safe_height_m, low_m) + (tip[2] - low_m)
    up: Point = (0.0, 0.0, drop_m)
    dropped = plus(tip, up)
    orientation = Pose.of_axes(tip, closing, points).orientation
    approach, retreat = _stretches(visit, grasp, body, tip, points, closing)
    return LinearMotion(
        visit,
        dropped,
        yaw_rad,
        orientation,
        (
            _at_height(approach[-1], above_m),
            *(plus(point, up) for point in reversed(approach[1:])),
            dropped,
        ),
        (
            dropped,
            *(plus(point, up) for point in retreat[1:]),
            _at_height(retreat[-1], above_m),
        ),
        carries,
        tool,
        leaves_with,
        drop_m,
    )


def _drop_m(visit: Visit, drop_height_m: float) -> float:
    """Return how high above its goal a visit lets go of a part [m]."""
    if visit.event is not Event.RELEASE or same_direction(visit.along, AXES["z"]):
        return 0.0
    if same_direction(visit.along, DOWN):
        return drop_height_m
    return min(drop_height_m, _SIDE_LIFT_M)


def _stretches(
    visit: Visit,
    grasp: Grasp | None,
    body: Body | None,
    tip: Point,
    points: Point,
    closing: Point,
) -> tuple[tuple[Point, ...], tuple[Point, ...]]:
    """Return where the tip is on the stretches before and after it acts [m], both from `tip`.

    One point only where it goes straight up from there.
    """
    backwards = (-points[0], -points[1], -points[2])
    if grasp is None or body is None:
        if visit.event is not Event.DRIVE or same_direction(visit.along, DOWN):
            return (tip,), (tip,)
        away = (tip, plus(tip, visit.along, -(visit.insert_m or _SCREW_STRETCH_M)))
        return away, away
    free_m = body.reach_m(visit.pose, backwards) - dot(tip, backwards) + _STANDOFF_M
    freed = (tip, plus(tip, backwards, free_m))
    if visit.event is Event.GRASP:
        # The load is lifted straight up.
        return ((tip,) if same_direction(points, DOWN) else freed), (tip,)
    downwards = same_direction(visit.along, DOWN)
    length_m = visit.insert_m or free_m
    inserted = (tip,) if downwards else (tip, plus(tip, visit.along, -length_m))
    blocked = grasp.kind is GraspKind.JAWS and abs(dot(visit.along, closing)) > 1e-6
    # Jaws that close along the direction of insertion have the part between them on it.
    return inserted, (freed if blocked else inserted)


def _hand_directions(visit: Visit, grasp: Grasp | None) -> tuple[Point, Point]:
    """Return in which directions of the world the hand points and its jaws close."""
    if grasp is not None:
        return unit(visit.pose.rotate(grasp.approach)), unit(visit.pose.rotate(grasp.closing))
    points = visit.along if visit.event is Event.DRIVE else DOWN
    if same_direction(points, DOWN):
        yaw_rad = visit.yaw_rad + _NATURAL_YAW_RAD
        return DOWN, (math.cos(yaw_rad), math.sin(yaw_rad), 0.0)
    # What turns about its own axis may be turned about it: level, if it can be.
    level = cross(AXES["z"], points)
    return points, unit(level) if math.hypot(*level) > 1e-6 else AXES["y"]


def _closing_yaw_rad(visit: Visit, grasp: Grasp | None, closing: Point) -> float:
    """Return the direction in which the jaws of a hand that points down close [rad]."""
    if grasp is None:
        return visit.yaw_rad + _NATURAL_YAW_RAD
    if visit.pose.is_upright:
        return visit.yaw_rad + math.atan2(grasp.closing[1], grasp.closing[0])
    return math.atan2(closing[1], closing[0])


def _tip(task: Task, visit: Visit, grasp: Grasp | None) -> Point:
    """Return where the tip is while what it handles is where it belongs [m]."""
    if grasp is not None:
        return visit.pose.apply(grasp.tip)
    if visit.event not in (Event.FETCH, Event.DRIVE):
        return visit.position
    # The screw is at the bit: its head stands on its feeder, and on what it fastens once driven.
    return plus(visit.position, visit.along, -task.scene.body(visit.subject).height_m)


def _at_height(point: Point, height_m: float) -> Point:
    return (point[0], point[1], max(height_m, point[2]))
