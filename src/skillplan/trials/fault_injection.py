"""Trials of detectors: right executions with an injected fault, or with a near miss.

A fault is a block in the way of a finger, the palm, the tool or the held part, at least 3 mm deep;
a part in the place of another; or a hand that reaches too deep. In a near miss a block stands
close, but nothing touches it. The geometry of the scene decides this, never a detector.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum

from skillplan.collision.boxes import WorldBox, contact_area, sweep_hits, world_boxes
from skillplan.physics.linear_motions import LinearMotion, choose_visit_grasp, plan_linear_motions
from skillplan.robots.catalogue import STANDARD_HAND
from skillplan.task.motion import Event, Point
from skillplan.task.scene import WORLD, Body, Box, Grasp, GraspKind, Placement, Pose
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task


class Truth(StrEnum):
    """The known truth about an execution."""

    LEGITIMATE = "legitimate"
    COLLISION = "collision"
    OUTCOME = "outcome"


@dataclass(frozen=True, slots=True)
class Trial:
    """An execution with a known truth.

    Parameters
    ----------
    task
        The task, possibly with an injected fault.
    truth
        Legitimate; a collision; or a wrong outcome, without contact.
    kind
        Kind of the fault, or near miss; else empty.
    fault
        Description of the fault, or place of the block of a near miss; else empty.
    """

    task: Task
    skill: Skill
    state: State
    truth: Truth
    kind: str = ""
    fault: str = ""


# Jaws open a little wider than the part: a finger passes at this distance from it [m].
_BEHIND_JAW_M = 0.008
_BLOCK_M = 0.010
# At this distance from the held part, or below the jaws, nothing touches [m].
_CLEAR_OF_PART_M = 0.002
_CLEAR_BENEATH_M = 0.002
_NEAR_MISS = "near miss"
_HEAVY_KG = 0.200
_LIGHT_KG = 0.002


@dataclass(frozen=True, slots=True)
class Block:
    """A block that becomes an obstacle in a scene.

    Parameters
    ----------
    kind, words
        Kind of fault, and description of the place.
    yaw_rad
        Rotation about the vertical [rad].
    size_xy
        Extents in its own frame [m].
    top_m
        Height of its top above the table [m]; it stands on the body below.
    """

    kind: str
    words: str
    x_m: float
    y_m: float
    yaw_rad: float
    size_xy: tuple[float, float]
    top_m: float
    mass_kg: float


def make_blocks_on_path(task: Task, motion: LinearMotion) -> Iterator[Block]:
    """Yield blocks that a motion must hit; none if the hand does not move straight down."""
    if not motion.is_vertical:
        return
    event = motion.visit.event
    if event in (Event.GRASP, Event.RELEASE):
        body = task.scene.body(motion.visit.subject)
        grasp = choose_visit_grasp(body, motion.visit)
        if grasp.kind is GraspKind.JAWS:
            yield from _block_jaws(motion, grasp)
        elif event is Event.GRASP:
            yield _on_axis(motion, "on top", f"on {body.name}, under the cup", 0.010, 0.010)
        if event is Event.RELEASE:
            yield from _block_place(motion, body)
    elif event is Event.DRIVE:
        name = motion.visit.subject
        for height_m in (0.004, 0.008):
            yield _on_axis(motion, "under the screw", f"where {name} goes", 0.008, height_m)
    elif event in (Event.LOAD, Event.OFFLOAD):
        x_m, y_m, z_m = motion.tool_tip
        words = f"in the holder of {motion.visit.subject}"
        # As wide as the open hand, so that its jaws cannot straddle it.
        size_xy = (0.100, 0.030)
        yaw_rad = motion.closing_yaw_rad
        yield Block("in the holder", words, x_m, y_m, yaw_rad, size_xy, z_m + 0.015, _HEAVY_KG)


def make_blocks_close_by(task: Task, motion: LinearMotion) -> Iterator[Block]:
    """Yield low blocks that the hand passes without contact on its way straight down."""
    if not motion.is_vertical or motion.visit.event not in (Event.GRASP, Event.RELEASE):
        return
    body = task.scene.body(motion.visit.subject)
    grasp = choose_visit_grasp(body, motion.visit)
    jaws = grasp.kind is GraspKind.JAWS
    beneath_m = grasp.width_m / 2 + _BEHIND_JAW_M + _BLOCK_M / 2
    for side in (1, -1):
        if jaws:
            words = f"{1000 * _CLEAR_BENEATH_M:.0f} mm beneath a finger"
            yield _make_near_miss(motion, side * beneath_m, 0.0, -_CLEAR_BENEATH_M, words)
        for axis in (0, 1):
            along = ("x", "y")[axis] == grasp.closing_axis
            if along and jaws:
                continue
            reach_m = _measure_reach(body, grasp, axis, side)
            if jaws:
                reach_m = max(reach_m, max(row[1] for row in STANDARD_HAND.jaw_m))
            clear_m = side * (reach_m + _CLEAR_OF_PART_M + _BLOCK_M / 2)
            words = f"{1000 * _CLEAR_OF_PART_M:.0f} mm clear of the part"
            # Only low blocks near a suction cup, because its surroundings are not known here.
            above_m = 0.010 if jaws else -0.001
            # With a closing axis y, the body's x axis points backwards.
            sign = -1 if grasp.closing_axis == "y" else 1
            offset = (clear_m, 0.0) if along else (0.0, sign * clear_m)
            yield _make_near_miss(motion, *offset, above_m, words)


def _measure_reach(body: Body, grasp: Grasp, axis: int, side: int) -> float:
    """Return the extent of a body from the tip of the hand towards one side [m]."""
    edges = [box.centre[axis] + side * box.size[axis] / 2 for box in body.boxes]
    return max(side * (edge - grasp.tip[axis]) for edge in edges)


def _make_near_miss(
    motion: LinearMotion, along_m: float, across_m: float, above_m: float, words: str
) -> Block:
    """Return a light block near a motion, with its top above the tip of the hand by `above_m`."""
    yaw_rad = motion.closing_yaw_rad
    x_m, y_m = _shift(motion.tool_tip, yaw_rad, along_m, across_m)
    towards = _name_direction(
        yaw_rad,
        round(math.copysign(1, along_m)) if along_m else 0,
        round(math.copysign(1, across_m)) if across_m else 0,
    )
    where = f"{towards} of {motion.visit.subject}, {words}"
    size_xy = (_BLOCK_M, _BLOCK_M)
    top_m = motion.tool_tip[2] + above_m
    return Block(_NEAR_MISS, where, x_m, y_m, yaw_rad, size_xy, top_m, _LIGHT_KG)


def _block_jaws(motion: LinearMotion, grasp: Grasp) -> Iterator[Block]:
    """Yield blocks below a finger or the palm."""
    name, yaw_rad = motion.visit.subject, motion.closing_yaw_rad
    for side in (1, -1):
        towards = _name_direction(yaw_rad, along=side)
        for depth_m, mass_kg in ((0.004, _HEAVY_KG), (0.010, _HEAVY_KG), (0.006, _LIGHT_KG)):
            light = mass_kg == _LIGHT_KG
            # A light block is hit near its edge, so that it may tip and be swept aside.
            along_m = _BEHIND_JAW_M + _BLOCK_M / 2 + (0.0025 if light else 0.0)
            x_m, y_m = _shift(motion.tool_tip, yaw_rad, side * (grasp.width_m / 2 + along_m), 0.0)
            words = f"{towards} of {name}, {1000 * depth_m:.0f} mm into a finger's way"
            words += ", light" if light else ""
            kind = "light, beside" if light else "beside"
            top_m = motion.tool_tip[2] + depth_m
            yield Block(kind, words, x_m, y_m, yaw_rad, (_BLOCK_M, _BLOCK_M), top_m, mass_kg)
        # The palm is rounded: the block is well within its outline, and deeper than for a finger.
        top_m = motion.tool_tip[2] + STANDARD_HAND.tip_m - STANDARD_HAND.underside_m + 0.008
        along_m = grasp.width_m / 2 + _BEHIND_JAW_M
        x_m, y_m = _shift(motion.tool_tip, yaw_rad, along_m, side * 0.018)
        words = f"{_name_direction(yaw_rad, across=side)} of {name}, 8 mm into the palm's way"
        yield Block("tall", words, x_m, y_m, yaw_rad, (_BLOCK_M, _BLOCK_M), top_m, _HEAVY_KG)


def _block_place(motion: LinearMotion, body: Body) -> Iterator[Block]:
    """Yield blocks under the edge of a part that is put down, by 5 mm."""
    x_m, y_m, z_m = motion.visit.position
    yaw_rad = motion.visit.yaw_rad
    feet = [box for box in body.boxes if box.centre[2] - box.size[2] / 2 < 1e-6]
    foot = feet[0]
    for axis, side, height_m, mass_kg in (
        (0, 1, 0.005, _HEAVY_KG),
        (0, -1, 0.010, _LIGHT_KG),
        (1, 1, 0.010, _HEAVY_KG),
        (1, -1, 0.005, _LIGHT_KG),
    ):
        offset = [foot.centre[0], foot.centre[1]]
        offset[axis] += side * foot.size[axis] / 2
        at_x, at_y = _shift((x_m, y_m, z_m), yaw_rad, offset[0], offset[1])
        light = mass_kg == _LIGHT_KG
        towards = _name_direction(yaw_rad, **{("along", "across")[axis]: side})
        words = f"where {body.name} goes, 5 mm under its edge at {towards}"
        words += ", light" if light else ""
        kind = "light, under the part" if light else "under the part"
        size_xy = (_BLOCK_M, _BLOCK_M)
        yield Block(kind, words, at_x, at_y, yaw_rad, size_xy, z_m + height_m, mass_kg)


def _on_axis(motion: LinearMotion, kind: str, where: str, side_m: float, height_m: float) -> Block:
    """Return a block on the axis of a motion, at its end."""
    x_m, y_m, z_m = motion.tool_tip if motion.visit.event is Event.GRASP else motion.visit.position
    words = f"{where}, {1000 * height_m:.0f} mm high"
    yaw_rad = motion.closing_yaw_rad
    return Block(kind, words, x_m, y_m, yaw_rad, (side_m, side_m), z_m + height_m, _HEAVY_KG)


def _name_direction(yaw_rad: float, along: int = 0, across: int = 0) -> str:
    """Return the axis of the world nearest to a direction that is rotated about the vertical."""
    x, y = _shift((0.0, 0.0, 0.0), yaw_rad, along, across)
    axis, value = ("x", x) if abs(x) > abs(y) else ("y", y)
    return f"{'+' if value > 0 else '-'}{axis}"


def _shift(origin: Point, yaw_rad: float, along_m: float, across_m: float) -> tuple[float, float]:
    """Return a point offset from another, in directions rotated about the vertical."""
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return origin[0] + cos * along_m - sin * across_m, origin[1] + sin * along_m + cos * across_m


OBSTACLE = "obstacle"

# Least depth of a collision [m].
LEAST_HIT_M = 0.003
# Bodies within this distance touch and do not overlap [m].
_TOUCH_M = 1e-5


def inject_collisions(task: Task, skill: Skill, state: State) -> Iterator[Trial]:
    """Yield executions of a skill with a collision.

    Parameters
    ----------
    skill, state
        An execution without a collision.
    """
    if skill.motion is None:
        return
    standing = find_standing_boxes(task, state)
    for motion in plan_linear_motions(task, skill, state):
        for block in make_blocks_on_path(task, motion):
            scene = _add_block(task, skill, state, motion, block, standing)
            if scene is not None:
                yield Trial(scene, skill, state, Truth.COLLISION, block.kind, block.words)
        for kind, words, scene in _make_other_faults(task, skill, state, motion, standing):
            yield Trial(scene, skill, state, Truth.COLLISION, kind, words)


def inject_near_misses(task: Task, skill: Skill, state: State) -> Iterator[Trial]:
    """Yield right executions of a skill with a block close to its path."""
    if skill.motion is None:
        return
    standing = find_standing_boxes(task, state)
    for motion in plan_linear_motions(task, skill, state):
        for block in make_blocks_close_by(task, motion):
            scene = _add_block(task, skill, state, motion, block, standing)
            if scene is not None:
                yield Trial(scene, skill, state, Truth.LEGITIMATE, block.kind, block.words)


def find_standing_boxes(task: Task, state: State) -> dict[str, tuple[WorldBox, ...]]:
    """Return the boxes of all bodies that stand in the world in a state, by name."""
    return {
        body.name: world_boxes(body, placement.pose)
        for body in task.scene.bodies
        if (placement := body.placement(state)) is not None
        and placement.solid
        and placement.frame == WORLD
    }


def is_possible(standing: dict[str, tuple[WorldBox, ...]]) -> bool:
    """Return True if every body stands on the table or on another body."""
    return all(
        min(box.low[2] for box in feet) <= _TOUCH_M
        or any(
            contact_area(foot, top, _TOUCH_M) is not None
            for other, tops in standing.items()
            if other != name
            for foot in feet
            for top in tops
        )
        for name, feet in standing.items()
    )


def _add_block(
    task: Task,
    skill: Skill,
    state: State,
    motion: LinearMotion,
    block: Block,
    standing: dict[str, tuple[WorldBox, ...]],
) -> Task | None:
    """Return the task with a block that stands firmly and overlaps nothing, or None."""
    shape = Box((*block.size_xy, 1.0), (0.0, 0.0, 0.5))
    footprint = world_boxes(
        Body(OBSTACLE, (shape,), (), 1.0), Pose.upright((block.x_m, block.y_m, 0.0), block.yaw_rad)
    )[0]
    floor_m = _find_floor(footprint, block.top_m, standing)
    if floor_m is None or block.top_m - floor_m < LEAST_HIT_M:
        return None
    # A block at the safe height would be hit by the transfer motion, or before it.
    if block.top_m > motion.above[2] - (motion.tool_tip[2] - motion.visit.position[2]) - 0.02:
        return None
    height_m = block.top_m - floor_m
    pose = Pose.upright((block.x_m, block.y_m, floor_m), block.yaw_rad)
    placements = tuple(Placement(fact, pose) for fact in _find_lasting_facts(skill, state))
    size: Point = (*block.size_xy, height_m)
    shape = Box(size, (0.0, 0.0, height_m / 2))
    return _add_body(task, Body(OBSTACLE, (shape,), placements, block.mass_kg))


def _find_floor(
    footprint: WorldBox, top_m: float, standing: dict[str, tuple[WorldBox, ...]]
) -> float | None:
    """Return the height of the support of a whole footprint; None without one, or with a clash."""
    floor_m = 0.0
    below = [
        box for boxes in standing.values() for box in boxes if _overlap(footprint, box) > _TOUCH_M
    ]
    supports = [box for box in below if _is_inside(footprint, box) and box.high[2] < top_m]
    if supports:
        floor_m = max(box.high[2] for box in supports)
    clash = any(box.high[2] > floor_m + _TOUCH_M and box.low[2] < top_m for box in below)
    return None if clash else floor_m


def _overlap(box: WorldBox, other: WorldBox) -> float:
    """Return the overlap of two boxes in the plane [m]; below 0 it is their distance."""
    return min(
        min(box.high[axis], other.high[axis]) - max(box.low[axis], other.low[axis])
        for axis in (0, 1)
    )


def _is_inside(box: WorldBox, other: WorldBox) -> bool:
    return all(
        other.low[axis] <= box.low[axis] and box.high[axis] <= other.high[axis] for axis in (0, 1)
    )


def _find_lasting_facts(skill: Skill, state: State) -> list[str]:
    """Return facts that cover the states before and after a skill: a single one if possible."""
    after = skill.prediction_in(state).apply(state)
    both = [fact for fact in state if fact in after]
    return both[:1] or [next(iter(state)), next(iter(after))]


def _add_body(task: Task, body: Body) -> Task:
    """Return a task with a further body, or with this body in place of its namesake."""
    others = task.scene.bodies
    if any(other.name == body.name for other in others):
        bodies = tuple(body if other.name == body.name else other for other in others)
    else:
        bodies = (*others, body)
    return task.replace(scene=replace(task.scene, bodies=bodies))


def _make_other_faults(
    task: Task,
    skill: Skill,
    state: State,
    motion: LinearMotion,
    standing: dict[str, tuple[WorldBox, ...]],
) -> Iterator[tuple[str, str, Task]]:
    """Yield tasks with a part in the wrong place, or with a grasp that is too deep."""
    visit = motion.visit
    if visit.event not in (Event.GRASP, Event.RELEASE):
        return
    body = task.scene.body(visit.subject)
    grasp = choose_visit_grasp(body, visit)
    if grasp.kind is GraspKind.JAWS and motion.is_vertical and visit.grasp is None:
        too_deep = replace(grasp, tip=(grasp.tip[0], grasp.tip[1], -0.004))
        words = f"the hand reaches 4 mm below {body.name}"
        yield "too deep", words, _add_body(task, replace(body, grasps=(too_deep,)))
    if visit.event is not Event.RELEASE:
        return
    assert skill.motion is not None
    safe_m = task.scene.robot(skill.motion.robot).safe_height_m
    carried = world_boxes(body, visit.pose)
    by = (0.0, 0.0, safe_m - visit.position[2])
    for other in task.scene.bodies:
        placement = other.placement(state)
        boxes = standing.get(other.name)
        if other.name == body.name or placement is None or boxes is None:
            continue
        if not placement.fact.startswith("placed(") or _supports_any(other.name, standing):
            continue
        pose = Pose(visit.position, placement.pose.orientation)
        moved = world_boxes(other, pose)
        rest = {name: boxes for name, boxes in standing.items() if name != other.name}
        floors = {_find_floor(box, box.high[2], rest) for box in moved}
        hit = any(sweep_hits(held, by, box, LEAST_HIT_M) for held in carried for box in moved)
        if hit and floors == {visit.position[2]}:
            placements = tuple(
                replace(own, pose=pose) if own == placement else own for own in other.placements
            )
            words = f"{other.name} stands where {body.name} belongs"
            changed = replace(other, placements=placements)
            yield "place taken", words, _add_body(task, changed)


def _supports_any(name: str, standing: dict[str, tuple[WorldBox, ...]]) -> bool:
    """Return True if a body supports another one, which would fall without it."""
    return any(
        contact_area(foot, top, _TOUCH_M) is not None
        for other, feet in standing.items()
        if other != name
        for foot in feet
        for top in standing[name]
    )
