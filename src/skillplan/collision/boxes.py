"""Axis-aligned boxes: boxes of bodies, sweeps and contact areas."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from skillplan.task.motion import Point
from skillplan.task.scene import Body, Box, Pose


@dataclass(frozen=True, slots=True)
class WorldBox:
    """An axis-aligned box in the world: its lower and upper corner [m]."""

    low: Point
    high: Point

    def moved(self, by: Point) -> WorldBox:
        """Return the box displaced by a vector [m]."""
        return WorldBox(_add(self.low, by), _add(self.high, by))


def world_boxes(body: Body, pose: Pose) -> tuple[WorldBox, ...]:
    """Return the boxes of a body at a pose; a turned box becomes its axis-aligned hull."""
    return tuple(box_at(box, pose) for box in body.boxes)


def shank_boxes(body: Body, pose: Pose) -> tuple[WorldBox, ...]:
    """Return the box of a screw's shank at a pose; empty for other bodies."""
    return () if body.shank is None else (box_at(body.shank.shape.box, pose),)


def box_at(box: Box, pose: Pose) -> WorldBox:
    """Return the axis-aligned hull of a box for a body at a pose."""
    if pose.is_upright:
        return world_box(box, pose.position, pose.yaw_rad)
    centre = pose.apply(box.centre)
    half = [
        sum(abs(part) * extent / 2 for part, extent in zip(row, box.size, strict=True))
        for row in pose.rotation
    ]
    (x, y, z), (a, b, c) = centre, half
    return WorldBox((x - a, y - b, z - c), (x + a, y + b, z + c))


def world_box(box: Box, origin: Point, yaw_rad: float = 0.0) -> WorldBox:
    """Return a body's box in the world."""
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    half_x, half_y, half_z = (extent / 2 for extent in box.size)
    reach_x = abs(cos) * half_x + abs(sin) * half_y
    reach_y = abs(sin) * half_x + abs(cos) * half_y
    x = origin[0] + cos * box.centre[0] - sin * box.centre[1]
    y = origin[1] + sin * box.centre[0] + cos * box.centre[1]
    z = origin[2] + box.centre[2]
    return WorldBox((x - reach_x, y - reach_y, z - half_z), (x + reach_x, y + reach_y, z + half_z))


def sweep_hits(moving: WorldBox, by: Point, obstacle: WorldBox, tolerance_m: float) -> bool:
    """Return True if `moving`, displaced by `by`, penetrates `obstacle` beyond the tolerance.

    Exact for a straight line: the path of the centre meets the obstacle grown by the moving box
    (slab
    method).
    """
    first, last = 0.0, 1.0
    for axis in range(3):
        # Range of displacements t * by[axis] with an overlap along this axis.
        low = obstacle.low[axis] - moving.high[axis] + tolerance_m
        high = obstacle.high[axis] - moving.low[axis] - tolerance_m
        step = by[axis]
        if step == 0.0:
            if not low < 0.0 < high:
                return False
            continue
        enter, leave = low / step, high / step
        if enter > leave:
            enter, leave = leave, enter
        first, last = max(first, enter), min(last, leave)
        if first >= last:
            return False
    return first < last


def contact_area(
    foot: WorldBox, top: WorldBox, tolerance_m: float
) -> tuple[float, float, float, float] | None:
    """Return the rectangle (x low, y low, x high, y high) in which `foot` stands on `top`."""
    if abs(foot.low[2] - top.high[2]) > tolerance_m:
        return None
    area = (
        max(foot.low[0], top.low[0]),
        max(foot.low[1], top.low[1]),
        min(foot.high[0], top.high[0]),
        min(foot.high[1], top.high[1]),
    )
    return area if area[0] < area[2] and area[1] < area[3] else None


def centroid(boxes: Sequence[WorldBox]) -> tuple[float, float]:
    """Return the planar centre of volume of boxes [m]."""
    total = x = y = 0.0
    for box in boxes:
        volume = math.prod(high - low for low, high in zip(box.low, box.high, strict=True))
        total += volume
        x += volume * (box.low[0] + box.high[0]) / 2
        y += volume * (box.low[1] + box.high[1]) / 2
    return x / total, y / total


def _add(a: Point, b: Point) -> Point:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])
