"""Linear motions of the hand for a skill's visits: the via points of Moller et al., sec. 4.4.

A visit is an approach, an act and a retreat: the tip comes down from above a target, follows the
direction of the insertion, acts, and goes back the same way. Transfers between visits are at safe
height. All engines and detectors that model a hand use this planner and check the same motion.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from skillplan.robots.arm_description import Hand
from skillplan.robots.catalogue import STANDARD_HAND
from skillplan.task.motion import AXES, Event, Point, Visit
from skillplan.task.pose import DOWN, Pose, Quaternion, cross, dot, is_same_direction, plus, unit
from skillplan.task.scene import Body, Grasp, GraspKind, Robot, Scene, Shank, Tool, ToolKind
from skillplan.task.shape import Box, Cylinder, Shape
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task

# Share of a part's height between the jaws, and its greatest value [m].
_DEPTH_FRACTION = 0.5
_MOST_DEPTH_M = 0.012
# Default rotation of the hand, with the most room for the wrist: it closes along the y axis of the
# handled body [rad].
_NATURAL_YAW_RAD = math.pi / 2
# Clearance between a hand and a part before and after a grasp from the side [m].
_STANDOFF_M = 0.02
# Distance of a screw from its hole at which the hand begins to follow its axis [m].
_SCREW_STRETCH_M = 0.05
# Greatest height of a side insertion above its goal, which avoids dragging [m].
_SIDE_LIFT_M = 3e-4
# Greatest extent below its tip of a hand that does not point down [m].
_HAND_RADIUS_M = 0.11


@dataclass(frozen=True, slots=True)
class LinearMotion:
    """One approach, act and retreat of the hand with a fixed orientation.

    Parameters
    ----------
    tip
        Position of the arm's tip during the act [m], which `Tool.tip_on_arm` separates from
        `tool_tip`. Only a tool that is longer or shorter than the arm's hand, or mounted on another
        one, has two of them.
    closing_yaw_rad
        Closing direction of a hand that points down, from x about the vertical [rad].
    orientation
        Orientation of the hand: z points out of it, y along the closing axis of its jaws.
    is_exact
        True if the hand must not be turned by half a turn, because several tools are on it.
    approach
        Polyline of the tip from safe height to `tip` [m]; two points at least.
    retreat
        Polyline of the tip from `tip` to safe height [m].
    drop_m
        Height above its goal at which a part is released [m], >= 0.
    loads
        Tool that is loaded at the target, or None.
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
    loads: Tool | None = None
    is_exact: bool = False

    @property
    def above(self) -> Point:
        """First point of the approach [m]."""
        return self.approach[0]

    @property
    def least_times_s(self) -> tuple[float, ...]:
        """Least time of each stretch of the approach [s]: 0, or that of a path of its own speed."""
        legs = pairwise((*self.visit.path, self.visit.position))
        own_s = tuple(map(self.visit.measure_leg_s, legs)) if self.visit.path else ()
        return (*(0.0 for _ in range(len(self.approach) - 1 - len(own_s))), *own_s)

    @property
    def ends_at(self) -> Point:
        """Last point of the retreat, at safe height [m]."""
        return self.retreat[-1]

    @property
    def hand(self) -> Pose:
        """Pose of the tip during the act: z points out of the hand, y along the closing axis."""
        return Pose(self.tip, self.orientation)

    @property
    def points(self) -> Point:
        """Unit vector in the world in which the hand points."""
        return self.hand.rotate(AXES["z"])

    @property
    def points_down(self) -> bool:
        """True if the hand points straight down."""
        return is_same_direction(self.points, DOWN)

    @property
    def is_vertical(self) -> bool:
        """True if the hand points down, and goes straight down and up again."""
        straight = len(self.approach) == len(self.retreat) == 2
        return self.points_down and straight and not self.is_exact

    @property
    def acting_tool(self) -> Tool | None:
        """Tool at the target: the attached one, or the one that is loaded."""
        return self.loads or self.tool

    @property
    def tool_after(self) -> Tool | None:
        """Tool on the retreat."""
        return None if self.visit.event is Event.OFFLOAD else self.acting_tool

    @property
    def tool_tip(self) -> Point:
        """Position of the tool's tip during the act [m].

        It is midway between the fingertips, the rim of the suction cup, or the end of the bit.
        """
        tool = self.acting_tool
        if tool is None or tool.mount is not None:
            return self.tool_pose.position
        return plus(self.tip, self.points, tool.beyond_m)

    @property
    def tool_pose(self) -> Pose:
        """Pose of the tool's tip during the act, with axes as of `hand`."""
        tool = self.acting_tool
        return self.hand if tool is None else self.hand.then(tool.tip_on_arm)

    @property
    def tool_points(self) -> Point:
        """Unit vector in the world in which the tool points."""
        return self.tool_pose.rotate(AXES["z"])

    @property
    def grasp_tip(self) -> Point:
        """Position of the arm's tip with the handled body at its goal [m]."""
        return (self.tip[0], self.tip[1], self.tip[2] - self.drop_m)


def choose_grasp(body: Body) -> Grasp:
    """Return the grasp of a body: as given, or across its narrower side."""
    return body.grasp or grasp_boxes(body.boxes)


def grasp_boxes(
    boxes: Sequence[Box],
    closing_axis: str | None = None,
    depth_m: float | None = None,
    at_m: tuple[float, float] | None = None,
) -> Grasp:
    """Return the grasp of jaws about boxes.

    Parameters
    ----------
    closing_axis
        ``x`` or ``y``; None for the narrower side.
    depth_m
        Distance of the fingertips below the top [m]; None for half the held height, at most 12 mm.
    at_m
        Position of the tip in the body's frame [m]; None for the middle of the held boxes.
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


def plan_linear_motions(
    task: Task, skill: Skill, state: State, drop_height_m: float = 0.0
) -> list[LinearMotion]:
    """Return the linear motions of a skill in a state in which it is applicable.

    Parameters
    ----------
    drop_height_m
        Height above its goal at which a part is released [m], >= 0.

    Raises
    ------
    ValueError
        If the skill has no motion, or no route of it fits the state.
    """
    if skill.motion is None:
        raise ValueError(f"Skill {skill.name!r} has no motion.")
    robot = task.scene.robot(skill.motion.robot)
    tool = robot.tool(state, skill.parameters.get("tool"))
    carries = skill.motion.carries
    motions = []
    for visit in skill.motion.visits(state):
        motion = _plan_linear_motion(task, robot, visit, carries, tool, drop_height_m)
        motions.append(motion)
        carries = motion.leaves_with
        tool = find_tool_after(robot, visit, tool)
    return motions


def find_tool_after(robot: Robot, visit: Visit, tool: Tool | None) -> Tool | None:
    """Return the tool that is attached after a visit."""
    if visit.event is Event.OFFLOAD:
        return None
    if visit.event is Event.LOAD:
        return next(item for item in robot.tools if item.name == visit.subject)
    return tool


def choose_visit_grasp(scene_body: Body, visit: Visit) -> Grasp:
    """Return the grasp of a visit: its own, or that of the body."""
    return visit.grasp or choose_grasp(scene_body)


def _plan_linear_motion(
    task: Task,
    robot: Robot,
    visit: Visit,
    carries: str | None,
    tool: Tool | None,
    drop_height_m: float,
) -> LinearMotion:
    grasps = visit.event in (Event.GRASP, Event.RELEASE)
    body = task.scene.body(visit.subject) if grasps else None
    grasp = None if body is None else choose_visit_grasp(body, visit)
    leaves_with = carries
    if visit.event in (Event.GRASP, Event.FETCH):
        leaves_with = visit.subject
    elif visit.event in (Event.RELEASE, Event.DRIVE):
        leaves_with = None
    if visit.event is Event.DRIVE:
        carries = visit.subject
    loads = find_tool_after(robot, visit, tool) if visit.event is Event.LOAD else None
    acting = loads or tool
    points, closing = _find_hand_directions(visit, grasp)
    is_free = visit.event in (Event.FETCH, Event.DRIVE, Event.WORK)
    if acting is not None and acting.mount is not None and is_free:
        closing = _turn_outwards(robot, visit, acting.mount, points, closing)
    drop_m = _choose_drop_m(task.scene, visit, drop_height_m)
    tip = _find_tip(task, visit, grasp)
    low_m = _find_low_m(task, visit, body)
    if is_same_direction(points, DOWN):
        yaw_rad = _find_closing_yaw_rad(visit, grasp, closing)
    else:
        yaw_rad, low_m = 0.0, min(low_m, tip[2] - _HAND_RADIUS_M)
    hand = Pose.of_axes(tip, closing, points)
    if acting is not None and acting.mount is not None:
        hand = hand.then(acting.mount.inverse())
    elif acting is not None and acting.beyond_m:
        hand = hand.moved(plus((0.0, 0.0, 0.0), points, -acting.beyond_m))
    is_exact = acting is not None and bool(robot.list_companions(acting))
    if acting is not None and is_exact:
        low_m = min(low_m, _measure_lowest_m(robot, acting, hand))
    above_m = max(robot.safe_height_m, low_m) + (tip[2] - low_m)
    up: Point = (0.0, 0.0, drop_m)
    dropped = plus(tip, up)
    approach, retreat = _plan_stretches(visit, grasp, body, tip, points, closing)
    down = (
        _raise_to(approach[-1], above_m),
        *(plus(point, up) for point in reversed(approach[1:])),
        dropped,
    )
    back = (dropped, *(plus(point, up) for point in retreat[1:]), _raise_to(retreat[-1], above_m))
    if acting is not None and acting.mount is not None:
        behind = plus(hand.position, tip, -1.0)
        # The hand keeps its orientation, so the arm's tip is as far behind everywhere.
        down, back = (tuple(plus(point, behind) for point in line) for line in (down, back))
        closes = hand.rotate(AXES["y"])
        is_down = is_same_direction(hand.rotate(AXES["z"]), DOWN)
        yaw_rad = math.atan2(closes[1], closes[0]) if is_down else 0.0
    elif acting is not None and acting.beyond_m:
        down, back = (
            tuple(plus(point, points, -acting.beyond_m) for point in line) for line in (down, back)
        )
    return LinearMotion(
        visit,
        down[-1],
        yaw_rad,
        hand.orientation,
        down,
        back,
        carries,
        tool,
        leaves_with,
        drop_m,
        loads,
        is_exact,
    )


def _find_low_m(task: Task, visit: Visit, body: Body | None) -> float:
    """Return the lowest height of the held body at a visit [m]."""
    shank = _find_shank(task, visit)
    if shank is not None:
        return visit.position[2] - _lower_m(shank.shape, visit.pose)
    if body is None or visit.pose.is_upright:
        # The origin of an upright body is at its bottom.
        return visit.position[2]
    return -body.reach_m(visit.pose, DOWN)


def _turn_outwards(robot: Robot, visit: Visit, mount: Pose, points: Point, closing: Point) -> Point:
    """Return the closing direction with which a hand lies away from its base above a target.

    A bit, ram or needle on its side may turn about its axis: the arm reaches farthest outwards.
    """
    x, y, _ = mount.inverse().rotate(AXES["z"])
    away = plus(visit.position, robot.base, -1.0)
    if not is_same_direction(points, DOWN) or math.hypot(x, y) < 1e-6:
        return closing
    yaw_rad = math.atan2(away[1], away[0]) - math.atan2(x, y)
    return (math.cos(yaw_rad), math.sin(yaw_rad), 0.0)


def _measure_lowest_m(robot: Robot, tool: Tool, hand: Pose) -> float:
    """Return the height of the lowest point of all tools on a hand, jaws wide open [m].

    Parameters
    ----------
    hand
        Pose of the arm's tip: z points out of the hand, y along its closing axis.
    """
    heights_m = []
    for item in (tool, *robot.list_companions(tool)):
        if item.kind is ToolKind.GRIPPER:
            worn = robot.hand_of(item)
            corners = [
                (across, along, depth_m - worn.arm_tip_m)
                for piece in worn.body
                for along, across, depth_m in piece
            ]
            corners += [
                (across, side * (worn.opening_m / 2 + behind), worn.beyond_m - up_m)
                for side in (-1, 1)
                for piece in worn.jaw
                for behind, across, up_m in piece
            ]
            heights_m += [hand.apply(corner)[2] for corner in corners]
            continue
        # From its tip, with z towards the flange and x along the closing axis.
        tip = hand.then(item.tip_on_arm)
        y, z = tip.rotate(AXES["x"]), tip.rotate(AXES["z"])
        upright = Pose.of_axes(tip.position, y, (-z[0], -z[1], -z[2]))
        down = upright.inverse().rotate(DOWN)
        shapes = build_tool_shapes(item, robot.hand)
        heights_m += [tip.position[2] - shape.reach_m(down) for shape in shapes]
    return min(heights_m)


def _find_shank(task: Task, visit: Visit) -> Shank | None:
    """Return the shank of the screw that a visit fetches or drives, if it is modelled."""
    handles = visit.event in (Event.FETCH, Event.DRIVE)
    return task.scene.body(visit.subject).shank if handles else None


def _lower_m(shape: Shape, pose: Pose) -> float:
    """Return how far a shape at a pose reaches below its origin [m], >= 0."""
    return max(0.0, shape.reach_m(pose.inverse().rotate(DOWN)))


def _choose_drop_m(scene: Scene, visit: Visit, drop_height_m: float) -> float:
    """Return the height above its goal at which a visit releases a part [m]."""
    if visit.event is not Event.RELEASE or is_same_direction(visit.along, AXES["z"]):
        return 0.0
    body = scene.body(visit.subject)
    fits = body.fits if visit.is_fitted else ()
    if any(fit.is_led for fit in fits):
        # The hand brings it to its seat.
        return 0.0
    if is_same_direction(visit.along, DOWN):
        return max(drop_height_m, body.release_m) if visit.at_goal else drop_height_m
    # A pin in a hole has no more room above than beside it.
    return min(drop_height_m, _SIDE_LIFT_M, *(max(fit.drawn_m, fit.play_m) for fit in fits))


def _plan_stretches(
    visit: Visit, grasp: Grasp | None, body: Body | None, tip: Point, points: Point, closing: Point
) -> tuple[tuple[Point, ...], tuple[Point, ...]]:
    """Return the stretches of the tip before and after the act [m], both starting at `tip`.

    A stretch has one point if the hand goes straight up.
    """
    backwards = (-points[0], -points[1], -points[2])
    if grasp is None or body is None:
        if visit.path:
            return (tip, *reversed(visit.path)), (tip,)
        if visit.event is not Event.DRIVE or is_same_direction(visit.along, DOWN):
            return (tip,), (tip,)
        below = plus(tip, visit.along, -(visit.insert_m or _SCREW_STRETCH_M))
        if visit.aside_m is None:
            return (tip, below), (tip, below)
        away = (tip, below, plus(below, visit.aside_m))
        return away, away
    free_m = body.reach_m(visit.pose, backwards) - dot(tip, backwards) + _STANDOFF_M
    freed = (tip, plus(tip, backwards, free_m))
    if visit.event is Event.GRASP:
        # The load is lifted straight up.
        return ((tip,) if is_same_direction(points, DOWN) else freed), (tip,)
    downwards = is_same_direction(visit.along, DOWN)
    length_m = visit.insert_m or free_m
    inserted = (tip,) if downwards else (tip, plus(tip, visit.along, -length_m))
    return inserted, (freed if body.is_left_straight(visit, grasp) else inserted)


def _find_hand_directions(visit: Visit, grasp: Grasp | None) -> tuple[Point, Point]:
    """Return the directions in the world in which the hand points and its jaws close."""
    if grasp is not None:
        return unit(visit.pose.rotate(grasp.approach)), unit(visit.pose.rotate(grasp.closing))
    points = visit.along if visit.event is Event.DRIVE else DOWN
    if is_same_direction(points, DOWN):
        yaw_rad = visit.yaw_rad + _NATURAL_YAW_RAD
        return DOWN, (math.cos(yaw_rad), math.sin(yaw_rad), 0.0)
    # A rotation about its own axis is free: take a horizontal one if possible.
    level = cross(AXES["z"], points)
    return points, unit(level) if math.hypot(*level) > 1e-6 else AXES["y"]


def _find_closing_yaw_rad(visit: Visit, grasp: Grasp | None, closing: Point) -> float:
    """Return the closing direction of a hand that points down [rad]."""
    if grasp is None:
        return visit.yaw_rad + _NATURAL_YAW_RAD
    if visit.pose.is_upright:
        return visit.yaw_rad + math.atan2(grasp.closing[1], grasp.closing[0])
    return math.atan2(closing[1], closing[0])


def _find_tip(task: Task, visit: Visit, grasp: Grasp | None) -> Point:
    """Return the position of the tip with the handled body at its goal [m]."""
    if grasp is not None:
        return visit.pose.apply(grasp.tip)
    if visit.event not in (Event.FETCH, Event.DRIVE):
        return visit.position
    # The screw is at the bit: its head is on the feeder, or on its part once driven.
    return plus(visit.position, visit.along, -task.scene.body(visit.subject).height_m)


def _raise_to(point: Point, height_m: float) -> Point:
    return (point[0], point[1], max(height_m, point[2]))


_ROUNDING_M = 1e-6


def find_opening_m(tool: Tool | None, hand: Hand = STANDARD_HAND) -> float:
    """Return the greatest opening of the jaws of a tool [m].

    Parameters
    ----------
    tool
        A gripper; None for the hand itself.
    """
    if tool is not None and tool.hand is not None:
        hand = tool.hand
    if tool is None or tool.opening_m is None:
        return hand.opening_m
    return min(tool.opening_m, hand.opening_m)


def choose_opening_m(
    grasp: Grasp, clearance_m: float | None, tool: Tool | None, hand: Hand = STANDARD_HAND
) -> float:
    """Return the opening of the jaws about a part [m]; 0 for suction.

    Inside a hole, it is the distance of the jaws with that clearance to its walls.

    Parameters
    ----------
    clearance_m
        Clearance on each side [m], >= 0, unless the tool has its own; limited by the opening.
        None if the jaws hold the part.
    """
    if grasp.kind is GraspKind.SUCTION:
        return 0.0
    clearance_m = 0.0 if clearance_m is None else choose_clearance_m(clearance_m, tool)
    if grasp.is_inner:
        return max(grasp.width_m - grasp.inside_m - 2 * clearance_m, 0.0)
    return min(grasp.width_m + 2 * clearance_m, find_opening_m(tool, hand))


def choose_clearance_m(clearance_m: float, tool: Tool | None) -> float:
    """Return the clearance of open jaws on each side of a part: the tool's, if it has one [m]."""
    own_m = None if tool is None else tool.clearance_m
    return clearance_m if own_m is None else own_m


def describe_too_wide(scene: Scene, robot: Robot, skill: Skill) -> str | None:
    """Return a message on a part of a skill that is wider than the jaws open, or None."""
    attached = skill.parameters.get("tool")
    tool = next((tool for tool in robot.tools if tool.name == attached), None)
    for visit in list_handled(skill):
        grasp = choose_visit_grasp(scene.body(visit.subject), visit)
        opening_m = find_opening_m(tool, robot.hand)
        if grasp.is_inner and grasp.width_m - grasp.inside_m > opening_m + _ROUNDING_M:
            return (
                f"the hole of {visit.subject} is {grasp.width_m:.3f} m wide, and the jaws reach "
                f"{opening_m + grasp.inside_m:.3f} m apart inside; give another grasp"
            )
        if grasp.is_inner:
            continue
        low_m, high_m = (0.0, opening_m) if tool is None else (tool.outer_m or (0.0, opening_m))
        if grasp.kind is GraspKind.JAWS and grasp.width_m < low_m - _ROUNDING_M:
            return (
                f"{visit.subject} is {grasp.width_m:.3f} m wide between the jaws, and they hold "
                f"{low_m:.3f} m at least; give it another closing axis or another tool"
            )
        opening_m = min(opening_m, high_m)
        if grasp.kind is GraspKind.JAWS and grasp.width_m > opening_m + _ROUNDING_M:
            return (
                f"{visit.subject} is {grasp.width_m:.3f} m wide between the jaws, and they open "
                f"{opening_m:.3f} m; give it another closing axis, or grasp: {{type: suction}}"
            )
    return None


def find_jaw_faults(task: Task) -> dict[str, str]:
    """Return messages on parts that are too wide for the only robot, by a fact about each."""
    faults: dict[str, str] = {}
    scene = task.scene
    for skill in task.skills:
        ways = [skill.by(way) for way in skill.ways] or [skill]
        reasons = [describe_too_wide(scene, scene.robots[0], variant) for variant in ways]
        # A part may be too wide for one grasp and fit another.
        words = reasons[0] if all(reasons) else None
        for visit in list_handled(skill) if words is not None else ():
            first = scene.body(visit.subject).placements[0].fact
            faults.setdefault(task.operations.get(visit.subject, first), f"{words}.")
    return faults


def list_handled(skill: Skill) -> Iterator[Visit]:
    """Yield the visits at which a skill grasps or releases a part."""
    for route in skill.motion.routes if skill.motion is not None else ():
        for visit in route.visits:
            if visit.event in (Event.GRASP, Event.RELEASE):
                yield visit


SHANK_DIAMETER_M: Final = 0.036
"""Diameter of the shank above a bit or pad [m]."""


def build_tool_shapes(tool: Tool, hand: Hand = STANDARD_HAND) -> tuple[Shape, ...]:
    """Return the shapes of a tool from its tip, z up; empty for a gripper.

    The paper gives no dimensions of its tools; those of a tool without `shapes` are plausible, not
    measured.

    Parameters
    ----------
    hand
        Any hand of the arm; a tool ends `beyond_m` from the arm's tip.
    """
    if tool.kind is ToolKind.GRIPPER:
        return ()
    if tool.envelope is not None:
        return (tool.envelope,)
    if tool.shapes:
        return (*tool.ends, *tool.shapes)
    height_m = tool.ends[0].height_m
    shank_m = hand.arm_tip_m + tool.beyond_m - height_m
    return (*tool.ends, Cylinder(SHANK_DIAMETER_M, shank_m, (0.0, 0.0, height_m + shank_m / 2)))
