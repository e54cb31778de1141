"""What boxes sweep while a skill is executed: travel, approach, insertion and retreat."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from skillplan.collision.boxes import WorldBox, box_at, world_box, world_boxes
from skillplan.task.grasp import AXES, Grasp, GraspKind
from skillplan.task.motion import Event, Visit
from skillplan.task.pose import DOWN, Point, Pose, cross, dot, plus, same_direction, unit
from skillplan.task.scene import Body, Robot, Scene, Tool
from skillplan.task.shape import Box

# What is left between a hand and a part that it comes to from the side, or pushes in [m].
_STANDOFF_M = 0.02


@dataclass(frozen=True, slots=True)
class Sweep:
    """A straight displacement of some boxes, and what moves in words."""

    label: str
    mover: str
    boxes: tuple[WorldBox, ...]
    by: Point
    spares: frozenset[str]


@dataclass(frozen=True, slots=True)
class _Load:
    """What moves at a visit, where the visit acts: by how much its origin is above its bottom."""

    body: Body | None
    tool: Tool | None
    lift_m: float


def sweeps_of(
    scene: Scene,
    robot: Robot,
    place: Point,
    tool: Tool | None,
    visits: tuple[Visit, ...],
    carries: str | None,
) -> Iterator[Sweep]:
    """Yield what moves where, at every visit, in order.

    Parameters
    ----------
    scene
        Where all this is.
    robot
        Whose tip moves.
    place
        Where that stands at first [m].
    tool
        What is attached at first.
    visits
        Where it goes.
    carries
        The body in the hand at first.
    """
    here = place
    for visit in visits:
        if visit.event is Event.DRIVE:
            carries = visit.subject
        into, out = _stretches(scene, visit)
        load = _load(scene, visit, tool, carries)
        yield from _comes(scene, visit, load, robot.safe_height_m, here, into)
        if visit.event in (Event.GRASP, Event.FETCH):
            carries = visit.subject
        elif visit.event in (Event.RELEASE, Event.DRIVE):
            carries = None
        elif visit.event is Event.OFFLOAD:
            tool = None
        elif visit.event is Event.LOAD:
            tool = next(item for item in robot.tools if item.name == visit.subject)
        load = _load(scene, visit, tool, carries)
        yield from _leaves(scene, visit, load, robot.safe_height_m, out)
        x_m, y_m, z_m = plus(visit.position, out)
        here = (x_m, y_m, max(robot.safe_height_m, z_m))


def hand_direction(scene: Scene, visit: Visit) -> Point:
    """Return in which direction of the world the hand points at a visit."""
    grasp = _grasp(scene, visit)
    if grasp is not None:
        return unit(visit.pose.rotate(grasp.approach))
    return visit.along if visit.event is Event.DRIVE else DOWN


def _comes(
    scene: Scene, visit: Visit, load: _Load, safe_height_m: float, here: Point, into: Point
) -> Iterator[Sweep]:
    """Yield the travel at safe height, the way down, and the stretch into place."""
    x_m, y_m, z_m = before = plus(visit.position, into, -1.0)
    safe_m = max(safe_height_m, z_m - load.lift_m) + load.lift_m
    transfer: Point = (x_m - here[0], y_m - here[1], 0.0)
    at_height: Point = (here[0], here[1], safe_m)
    yield from _moving(scene, "the travel", visit, load, at_height, transfer)
    down: Point = (0.0, 0.0, z_m - safe_m)
    yield from _moving(scene, "the approach", visit, load, (x_m, y_m, safe_m), down)
    if any(into):
        yield from _moving(scene, "the approach", visit, load, before, into)


def _leaves(
    scene: Scene, visit: Visit, load: _Load, safe_height_m: float, out: Point
) -> Iterator[Sweep]:
    """Yield the stretch back and the way up."""
    if any(out):
        yield from _moving(scene, "the retreat", visit, load, visit.position, out)
    after = plus(visit.position, out)
    safe_m = max(safe_height_m, after[2] - load.lift_m) + load.lift_m
    up: Point = (0.0, 0.0, safe_m - after[2])
    yield from _moving(scene, "the retreat", visit, load, after, up)


def _moving(
    scene: Scene, label: str, visit: Visit, load: _Load, origin: Point, by: Point
) -> Iterator[Sweep]:
    """Yield the sweeps of the carried body and of the tool on it."""
    body, tool = load.body, load.tool
    spares = frozenset({visit.subject} | ({body.name} if body is not None else set()))
    if body is not None:
        boxes = world_boxes(body, Pose(origin, visit.pose.orientation))
        yield Sweep(label, body.name, boxes, by, spares)
    if tool is not None and tool.envelope is not None:
        moved = plus(origin, visit.position, -1.0)
        box = _about_tool(scene, visit, load, tool.envelope, moved)
        yield Sweep(label, tool.name, (box,), by, spares)


def _about_tool(scene: Scene, visit: Visit, load: _Load, envelope: Box, moved: Point) -> WorldBox:
    """Return the box about the tool at a visit, displaced by a vector [m]."""
    body = load.body
    if body is None and visit.event in (Event.GRASP, Event.RELEASE, Event.FETCH):
        body = scene.body(visit.subject)
    points = hand_direction(scene, visit)
    if same_direction(points, DOWN):
        if body is None:
            top_m = visit.position[2]
        elif visit.pose.is_upright:
            top_m = visit.position[2] + body.height_m
        else:
            top_m = body.reach_m(visit.pose, AXES["z"])
        tip = plus((visit.position[0], visit.position[1], top_m), moved)
        return world_box(envelope, tip)
    back: Point = (-points[0], -points[1], -points[2])
    grasp = _grasp(scene, visit)
    held = visit.position if grasp is None else visit.pose.apply(grasp.tip)
    if body is not None:
        held = plus(held, back, body.reach_m(visit.pose, back) - dot(held, back))
    closing = cross(AXES["z"], points) if grasp is None else visit.pose.rotate(grasp.closing)
    level = unit(closing) if math.hypot(*closing) > 1e-6 else AXES["y"]
    return box_at(envelope, Pose.of_axes(plus(held, moved), level, back))


def _load(scene: Scene, visit: Visit, tool: Tool | None, carries: str | None) -> _Load:
    body = None if carries is None else scene.body(carries)
    if body is None or visit.pose.is_upright:
        return _Load(body, tool, 0.0)
    return _Load(body, tool, visit.position[2] + body.reach_m(visit.pose, DOWN))


def _stretches(scene: Scene, visit: Visit) -> tuple[Point, Point]:
    """Return the straight ways of the hand right before and right after it acts [m]."""
    none: Point = (0.0, 0.0, 0.0)
    if visit.event not in (Event.GRASP, Event.RELEASE, Event.DRIVE):
        return none, none
    points, grasp = hand_direction(scene, visit), _grasp(scene, visit)
    freed_m = _extent_m(scene, visit, points) + _STANDOFF_M
    if visit.event is Event.GRASP:
        # The load is lifted straight up.
        return (none if same_direction(points, DOWN) else plus(none, points, freed_m)), none
    if same_direction(visit.along, DOWN):
        return none, none
    length_m = visit.insert_m or _extent_m(scene, visit, visit.along) + _STANDOFF_M
    into = plus(none, visit.along, length_m)
    # Jaws that close along the direction of insertion have the part between them on it.
    if grasp is not None and grasp.kind is GraspKind.JAWS:
        across = dot(visit.along, visit.pose.rotate(grasp.closing))
        if abs(across) > 1e-6:
            return into, plus(none, points, -freed_m)
    return into, plus(none, visit.along, -length_m)


def _extent_m(scene: Scene, visit: Visit, direction: Point) -> float:
    """Return the extent of what is handled along a direction [m]."""
    body, back = scene.body(visit.subject), (-direction[0], -direction[1], -direction[2])
    return body.reach_m(visit.pose, direction) + body.reach_m(visit.pose, back)


def _grasp(scene: Scene, visit: Visit) -> Grasp | None:
    if visit.event not in (Event.GRASP, Event.RELEASE):
        return None
    return visit.grasp or scene.body(visit.subject).grasp
