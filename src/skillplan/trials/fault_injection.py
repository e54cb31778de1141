"""Collisions injected into right executions of a task, so that detectors can be tried on them.

A block is put where a finger, the palm, the tool or the part in the hand must hit it, at least
3 mm deep; or a part stands where another belongs; or the hand reaches too deep. Near misses are
right: a block stands close, but clear of everything. Where that is so follows from the geometry
of the scene, never from a detector.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from skillplan.collision.boxes import WorldBox, contact_area, sweep_hits, world_boxes
from skillplan.physics.linear_motions import LinearMotion, linear_motions, visited_grasp
from skillplan.task.motion import Event, Point
from skillplan.task.scene import WORLD, Body, Box, GraspKind, Placement, Pose
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.trials.detector_trial import Trial, Truth
from skillplan.trials.injected_obstacle import Block, blocks_close_by, blocks_on_path

OBSTACLE = "obstacle"

# What collides does so by this much at least [m].
LEAST_HIT_M = 0.003
# Bodies this close touch rather than overlap [m].
_TOUCH_M = 1e-5


def injected_collisions(task: Task, skill: Skill, state: State) -> Iterator[Trial]:
    """Yield executions of a skill in which something collides.

    Parameters
    ----------
    task
        With bodies.
    skill, state
        An execution in which nothing does.
    """
    if skill.motion is None:
        return
    standing = standing_boxes(task, state)
    for motion in linear_motions(task, skill, state):
        for block in blocks_on_path(task, motion):
            scene = _with_block(task, skill, state, motion, block, standing)
            if scene is not None:
                yield Trial(scene, skill, state, Truth.COLLISION, block.kind, block.words)
        for kind, words, scene in _changed(task, skill, state, motion, standing):
            yield Trial(scene, skill, state, Truth.COLLISION, kind, words)


def near_misses(task: Task, skill: Skill, state: State) -> Iterator[Trial]:
    """Yield right executions of a skill with a block close to what moves; see above."""
    if skill.motion is None:
        return
    standing = standing_boxes(task, state)
    for motion in linear_motions(task, skill, state):
        for block in blocks_close_by(task, motion):
            scene = _with_block(task, skill, state, motion, block, standing)
            if scene is not None:
                yield Trial(scene, skill, state, Truth.LEGITIMATE, block.kind, block.words)


def standing_boxes(task: Task, state: State) -> dict[str, tuple[WorldBox, ...]]:
    """Return the boxes of all bodies that stand in the world in a state, by name."""
    return {
        body.name: world_boxes(body, placement.pose)
        for body in task.scene.bodies
        if (placement := body.placement(state)) is not None
        and placement.solid
        and placement.frame == WORLD
    }


def is_possible(standing: dict[str, tuple[WorldBox, ...]]) -> bool:
    """Whether every body stands on the table or on another one."""
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


def _with_block(
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
    floor_m = _floor(footprint, block.top_m, standing)
    if floor_m is None or block.top_m - floor_m < LEAST_HIT_M:
        return None
    # What reaches the safe height would be hit by the transfer motion, or before it begins.
    if block.top_m > motion.above[2] - (motion.tip[2] - motion.visit.position[2]) - 0.02:
        return None
    height_m = block.top_m - floor_m
    pose = Pose.upright((block.x_m, block.y_m, floor_m), block.yaw_rad)
    placements = tuple(Placement(fact, pose) for fact in _lasting(skill, state))
    size: Point = (*block.size_xy, height_m)
    shape = Box(size, (0.0, 0.0, height_m / 2))
    return _with_body(task, Body(OBSTACLE, (shape,), placements, block.mass_kg))


def _floor(
    footprint: WorldBox, top_m: float, standing: dict[str, tuple[WorldBox, ...]]
) -> float | None:
    """Return the height of what supports a whole footprint; None if nothing does or it clashes."""
    floor_m = 0.0
    below = [
        box for boxes in standing.values() for box in boxes if _overlap(footprint, box) > _TOUCH_M
    ]
    supports = [box for box in below if _inside(footprint, box) and box.high[2] < top_m]
    if supports:
        floor_m = max(box.high[2] for box in supports)
    clash = any(box.high[2] > floor_m + _TOUCH_M and box.low[2] < top_m for box in below)
    return None if clash else floor_m


def _overlap(one: WorldBox, other: WorldBox) -> float:
    """Return how far two boxes overlap in the plane [m]; below 0 their distance."""
    return min(
        min(one.high[axis], other.high[axis]) - max(one.low[axis], other.low[axis])
        for axis in (0, 1)
    )


def _inside(one: WorldBox, other: WorldBox) -> bool:
    return all(
        other.low[axis] <= one.low[axis] and one.high[axis] <= other.high[axis] for axis in (0, 1)
    )


def _lasting(skill: Skill, state: State) -> list[str]:
    """Return facts of which one holds before the skill and one after; a single fact if any does."""
    after = skill.prediction_in(state).apply(state)
    both = [fact for fact in state if fact in after]
    return both[:1] or [next(iter(state)), next(iter(after))]


def _with_body(task: Task, body: Body) -> Task:
    """Return a task with one more body, or with this body instead of the one of its name."""
    others = task.scene.bodies
    if any(other.name == body.name for other in others):
        bodies = tuple(body if other.name == body.name else other for other in others)
    else:
        bodies = (*others, body)
    return task.replace(scene=replace(task.scene, bodies=bodies))


def _changed(
    task: Task,
    skill: Skill,
    state: State,
    motion: LinearMotion,
    standing: dict[str, tuple[WorldBox, ...]],
) -> Iterator[tuple[str, str, Task]]:
    """Yield tasks in which a part stands in the wrong place, or a grasp is too deep."""
    visit = motion.visit
    if visit.event not in (Event.GRASP, Event.RELEASE):
        return
    body = task.scene.body(visit.subject)
    grasp = visited_grasp(body, visit)
    if grasp.kind is GraspKind.JAWS and motion.is_vertical and visit.grasp is None:
        too_deep = replace(grasp, tip=(grasp.tip[0], grasp.tip[1], -0.004))
        words = f"the hand reaches 4 mm below {body.name}"
        yield "too deep", words, _with_body(task, replace(body, grasps=(too_deep,)))
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
        floors = {_floor(box, box.high[2], rest) for box in moved}
        hit = any(sweep_hits(one, by, box, LEAST_HIT_M) for one in carried for box in moved)
        if hit and floors == {visit.position[2]}:
            placements = tuple(
                replace(one, pose=pose) if one == placement else one for one in other.placements
            )
            words = f"{other.name} stands where {body.name} belongs"
            changed = replace(other, placements=placements)
            yield "place taken", words, _with_body(task, changed)


def _supports_any(name: str, standing: dict[str, tuple[WorldBox, ...]]) -> bool:
    """Whether something stands on a body, which would fall if it were elsewhere."""
    return any(
        contact_area(foot, top, _TOUCH_M) is not None
        for other, feet in standing.items()
        if other != name
        for foot in feet
        for top in standing[name]
    )
