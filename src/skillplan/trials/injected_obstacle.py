"""Obstacles on the path of a linear motion of the hand, or close to it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from skillplan.physics.linear_motions import LinearMotion, visited_grasp
from skillplan.robots.catalogue import STANDARD_HAND
from skillplan.task.motion import Event, Point
from skillplan.task.scene import Body, Grasp, GraspKind
from skillplan.task.task import Task

# Jaws open a little wider than what they grasp: a finger is sure to pass at this distance [m].
_BEHIND_JAW_M = 0.008
_BLOCK_M = 0.010
# At this distance beside the part in the hand, or beneath the jaws, nothing touches [m].
_CLEAR_OF_PART_M = 0.002
_CLEAR_BENEATH_M = 0.002
_NEAR_MISS = "near miss"
_HEAVY_KG = 0.200
_LIGHT_KG = 0.002


@dataclass(frozen=True, slots=True)
class Block:
    """A block to be put into a scene as an obstacle.

    Parameters
    ----------
    kind, words
        What it is for, in short, and where it stands.
    x_m, y_m
        Its centre in the plane [m].
    yaw_rad
        How it is turned about the vertical [rad].
    size_xy
        Extents in its own frame [m].
    top_m
        Height of its top above the table [m]; it stands on what is beneath it.
    mass_kg
        Mass [kg].
    """

    kind: str
    words: str
    x_m: float
    y_m: float
    yaw_rad: float
    size_xy: tuple[float, float]
    top_m: float
    mass_kg: float


def blocks_on_path(task: Task, motion: LinearMotion) -> Iterator[Block]:
    """Yield blocks that one motion must hit; none where the hand does not go straight down."""
    if not motion.is_vertical:
        return
    event = motion.visit.event
    if event in (Event.GRASP, Event.RELEASE):
        body = task.scene.body(motion.visit.subject)
        grasp = visited_grasp(body, motion.visit)
        if grasp.kind is GraspKind.JAWS:
            yield from _beside_jaws(motion, grasp)
        elif event is Event.GRASP:
            yield _on_axis(motion, "on top", f"on {body.name}, under the cup", 0.010, 0.010)
        if event is Event.RELEASE:
            yield from _under_part(motion, body)
    elif event is Event.DRIVE:
        name = motion.visit.subject
        for height_m in (0.004, 0.008):
            yield _on_axis(motion, "under the screw", f"where {name} goes", 0.008, height_m)
    elif event in (Event.LOAD, Event.OFFLOAD):
        x_m, y_m, z_m = motion.tip
        words = f"in the holder of {motion.visit.subject}"
        # As wide as the hand opens: its jaws do not straddle it.
        size_xy = (0.100, 0.030)
        yaw_rad = motion.closing_yaw_rad
        yield Block("in the holder", words, x_m, y_m, yaw_rad, size_xy, z_m + 0.015, _HEAVY_KG)


def blocks_close_by(task: Task, motion: LinearMotion) -> Iterator[Block]:
    """Yield low blocks that a motion straight down, and the hand, pass without contact."""
    if not motion.is_vertical or motion.visit.event not in (Event.GRASP, Event.RELEASE):
        return
    body = task.scene.body(motion.visit.subject)
    grasp = visited_grasp(body, motion.visit)
    jaws = grasp.kind is GraspKind.JAWS
    beneath_m = grasp.width_m / 2 + _BEHIND_JAW_M + _BLOCK_M / 2
    for side in (1, -1):
        if jaws:
            words = f"{1000 * _CLEAR_BENEATH_M:.0f} mm beneath a finger"
            yield _passed(motion, side * beneath_m, 0.0, -_CLEAR_BENEATH_M, words)
        for axis in (0, 1):
            along = ("x", "y")[axis] == grasp.closing_axis
            if along and jaws:
                continue
            reach_m = _reach_m(body, grasp, axis, side)
            if jaws:
                reach_m = max(reach_m, max(row[1] for row in STANDARD_HAND.jaw_m))
            clear_m = side * (reach_m + _CLEAR_OF_PART_M + _BLOCK_M / 2)
            words = f"{1000 * _CLEAR_OF_PART_M:.0f} mm clear of the part"
            # Beside a suction cup low blocks only: its surroundings are not known here.
            above_m = 0.010 if jaws else -0.001
            # Turned by the yaw of a closing axis y, the body's x axis points backwards.
            sign = -1 if grasp.closing_axis == "y" else 1
            offset = (clear_m, 0.0) if along else (0.0, sign * clear_m)
            yield _passed(motion, *offset, above_m, words)


def _reach_m(body: Body, grasp: Grasp, axis: int, side: int) -> float:
    """Return how far a body extends from the tip of the hand towards one side [m]."""
    edges = [box.centre[axis] + side * box.size[axis] / 2 for box in body.boxes]
    return max(side * (edge - grasp.tip[axis]) for edge in edges)


def _passed(
    motion: LinearMotion, along_m: float, across_m: float, above_m: float, words: str
) -> Block:
    """Return a light block beside a motion whose top is so far above the tip of the hand."""
    yaw_rad = motion.closing_yaw_rad
    x_m, y_m = _offset(motion.tip, yaw_rad, along_m, across_m)
    towards = _towards(
        yaw_rad,
        round(math.copysign(1, along_m)) if along_m else 0,
        round(math.copysign(1, across_m)) if across_m else 0,
    )
    where = f"{towards} of {motion.visit.subject}, {words}"
    size_xy = (_BLOCK_M, _BLOCK_M)
    top_m = motion.tip[2] + above_m
    return Block(_NEAR_MISS, where, x_m, y_m, yaw_rad, size_xy, top_m, _LIGHT_KG)


def _beside_jaws(motion: LinearMotion, grasp: Grasp) -> Iterator[Block]:
    """Yield blocks that a finger or the palm comes down on."""
    name, yaw_rad = motion.visit.subject, motion.closing_yaw_rad
    for side in (1, -1):
        towards = _towards(yaw_rad, along=side)
        for depth_m, mass_kg in ((0.004, _HEAVY_KG), (0.010, _HEAVY_KG), (0.006, _LIGHT_KG)):
            light = mass_kg == _LIGHT_KG
            # A light one is hit near its edge, so that it may tip and be swept aside.
            along_m = _BEHIND_JAW_M + _BLOCK_M / 2 + (0.0025 if light else 0.0)
            x_m, y_m = _offset(motion.tip, yaw_rad, side * (grasp.width_m / 2 + along_m), 0.0)
            words = f"{towards} of {name}, {1000 * depth_m:.0f} mm into a finger's way"
            words += ", light" if light else ""
            kind = "light, beside" if light else "beside"
            top_m = motion.tip[2] + depth_m
            yield Block(kind, words, x_m, y_m, yaw_rad, (_BLOCK_M, _BLOCK_M), top_m, mass_kg)
        # The palm is rounded: well within its outline, and deeper than a finger's.
        top_m = motion.tip[2] + STANDARD_HAND.tip_m - STANDARD_HAND.underside_m + 0.008
        along_m = grasp.width_m / 2 + _BEHIND_JAW_M
        x_m, y_m = _offset(motion.tip, yaw_rad, along_m, side * 0.018)
        words = f"{_towards(yaw_rad, across=side)} of {name}, 8 mm into the palm's way"
        yield Block("tall", words, x_m, y_m, yaw_rad, (_BLOCK_M, _BLOCK_M), top_m, _HEAVY_KG)


def _under_part(motion: LinearMotion, body: Body) -> Iterator[Block]:
    """Yield blocks that stand 5 mm under the edge of where a part is put down."""
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
        at_x, at_y = _offset((x_m, y_m, z_m), yaw_rad, offset[0], offset[1])
        light = mass_kg == _LIGHT_KG
        towards = _towards(yaw_rad, **{("along", "across")[axis]: side})
        words = f"where {body.name} goes, 5 mm under its edge at {towards}"
        words += ", light" if light else ""
        kind = "light, under the part" if light else "under the part"
        size_xy = (_BLOCK_M, _BLOCK_M)
        yield Block(kind, words, at_x, at_y, yaw_rad, size_xy, z_m + height_m, mass_kg)


def _on_axis(motion: LinearMotion, kind: str, where: str, side_m: float, height_m: float) -> Block:
    """Return a block on the axis of a motion, on what the motion ends at."""
    x_m, y_m, z_m = motion.tip if motion.visit.event is Event.GRASP else motion.visit.position
    words = f"{where}, {1000 * height_m:.0f} mm high"
    yaw_rad = motion.closing_yaw_rad
    return Block(kind, words, x_m, y_m, yaw_rad, (side_m, side_m), z_m + height_m, _HEAVY_KG)


def _towards(yaw_rad: float, along: int = 0, across: int = 0) -> str:
    """Return the axis of the world nearest to a direction turned about the vertical."""
    x, y = _offset((0.0, 0.0, 0.0), yaw_rad, along, across)
    axis, value = ("x", x) if abs(x) > abs(y) else ("y", y)
    return f"{'+' if value > 0 else '-'}{axis}"


def _offset(origin: Point, yaw_rad: float, along_m: float, across_m: float) -> tuple[float, float]:
    """Return a point beside another, in directions turned about the vertical."""
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return origin[0] + cos * along_m - sin * across_m, origin[1] + sin * along_m + cos * across_m
