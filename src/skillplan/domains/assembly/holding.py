"""Where a straight line meets the surface of a shape: what a suction cup lands on."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import count
from typing import Literal

from skillplan.domains.assembly.schema_types import GraspConfig, unit_of
from skillplan.physics.linear_motions import jaws_about
from skillplan.robots.catalogue import STANDARD_HAND
from skillplan.task.motion import AXES, Grasp, GraspKind
from skillplan.task.pose import DOWN, Point, cross, dot, plus, same_direction, unit
from skillplan.task.shape import Box, Cylinder, Mesh, Shape

# A line along an edge meets the shape; rounding may put it so far out [m].
_RIM_M = 1e-9


def surface_m(shapes: Iterable[Shape], start: Point, direction: Point) -> float | None:
    """Return how far along a line from a point the first surface is [m], or None without one.

    Parameters
    ----------
    shapes
        In the frame of their body.
    start
        A point outside all of them [m].
    direction
        Of length 1.
    """
    spans = (_span(shape, start, direction) for shape in shapes)
    return min((span[0] for span in spans if span is not None), default=None)


def _span(shape: Shape, start: Point, direction: Point) -> tuple[float, float] | None:
    """Return from where to where a line is inside a convex shape [m], or None."""
    if isinstance(shape, Box):
        return _meeting(
            _between(start[axis] - shape.centre[axis], direction[axis], shape.size[axis] / 2)
            for axis in range(3)
        )
    if isinstance(shape, Cylinder):
        z = _between(start[2] - shape.centre[2], direction[2], shape.height_m / 2)
        return _meeting((z, _round(shape, start, direction)))
    return _through(shape, start, direction)


def _between(offset: float, slope: float, half: float) -> tuple[float, float] | None:
    """Return where ``|offset + t * slope| <= half``."""
    if abs(slope) < 1e-12:
        return (-math.inf, math.inf) if abs(offset) <= half + _RIM_M else None
    ends = ((-half - offset) / slope, (half - offset) / slope)
    return min(ends), max(ends)


def _round(shape: Cylinder, start: Point, direction: Point) -> tuple[float, float] | None:
    """Return where a line is inside an upright cylinder without ends."""
    x, y = start[0] - shape.centre[0], start[1] - shape.centre[1]
    a = direction[0] ** 2 + direction[1] ** 2
    radius = shape.diameter_m / 2
    if a < 1e-18:
        return (-math.inf, math.inf) if math.hypot(x, y) <= radius + _RIM_M else None
    middle = -(x * direction[0] + y * direction[1]) / a
    off2 = (x + middle * direction[0]) ** 2 + (y + middle * direction[1]) ** 2
    if off2 > (radius + _RIM_M) ** 2:
        return None
    half = math.sqrt(max(radius * radius - off2, 0.0) / a)
    return middle - half, middle + half


def _through(shape: Mesh, start: Point, direction: Point) -> tuple[float, float] | None:
    """Return where a line goes into a closed surface of triangles and where it comes out."""
    met = []
    for face in shape.faces:
        corner, one, other = (shape.corners[index] for index in face)
        u, v = plus(one, corner, -1.0), plus(other, corner, -1.0)
        normal = cross(u, v)
        steep = dot(normal, direction)
        if abs(steep) < 1e-18:
            continue
        away = dot(normal, plus(corner, start, -1.0)) / steep
        inside = plus(plus(start, direction, away), corner, -1.0)
        size = dot(normal, normal)
        b = dot(cross(inside, v), normal) / size
        c = dot(cross(u, inside), normal) / size
        if min(b, c, 1 - b - c) >= -1e-9:
            met.append(away)
    return (min(met), max(met)) if met else None


def _meeting(spans: Iterable[tuple[float, float] | None]) -> tuple[float, float] | None:
    low, high = -math.inf, math.inf
    for span in spans:
        if span is None:
            return None
        low, high = max(low, span[0]), min(high, span[1])
    return (low, high) if low <= high + _RIM_M else None


# Of what is between the jaws so much is held, and never more than so much [m].
_DEPTH_FRACTION = 0.5
_MOST_DEPTH_M = 0.012
_FINGER_HALF_WIDTH_M = STANDARD_HAND.jaw_half_width_m
# Directions whose cosine is no more than this are at right angles; what is left is taken away.
_RIGHT_ANGLE = 0.01


class Handle:
    """A way to hold some shapes, as a task file says it.

    Parameters
    ----------
    given
        What the file says.
    kind
        Jaws or suction.
    shapes
        Of the part, in its frame.

    Attributes
    ----------
    approach
        Unit vector in the part's frame in which the hand points.
    """

    def __init__(self, given: GraspConfig, kind: GraspKind, shapes: Sequence[Shape]) -> None:
        self.given = given
        self.kind = kind
        self.shapes = tuple(shapes)
        self.approach = unit_of(given.approach)
        self.outwards: Point = _opposite(self.approach)

    @property
    def from_top(self) -> bool:
        """Whether the hand comes from the part's top."""
        return same_direction(self.approach, DOWN)

    @property
    def height_m(self) -> float:
        """Extent of the part along the direction in which the hand points [m]."""
        return self.reach_m(self.outwards) + self.reach_m(self.approach)

    @property
    def closing(self) -> Point | None:
        """Direction along which the jaws are to close; None where that is left to the part."""
        axis = self.given.closing_axis
        if axis == "auto":
            return None
        wanted = AXES[axis] if isinstance(axis, str) else unit_of(axis)
        off = dot(wanted, self.approach)
        return wanted if off == 0 else unit(plus(wanted, self.approach, -off))

    @property
    def closes_askew(self) -> bool:
        """Whether the jaws are to close in a direction that is not at right angles to the hand."""
        axis = self.given.closing_axis
        if axis == "auto":
            return False
        wanted = AXES[axis] if isinstance(axis, str) else unit_of(axis)
        return abs(dot(wanted, self.approach)) > _RIGHT_ANGLE

    def reach_m(self, direction: Point) -> float:
        """Return how far the part reaches along a direction from its origin [m]."""
        return max(shape.reach_m(direction) for shape in self.shapes)

    def grasp(self) -> Grasp:
        """Return the grasp; where there is nothing to hold, as if there were."""
        return self.suction() if self.kind is GraspKind.SUCTION else self.jaws()

    def point(self) -> Point | None:
        """Return the point that the hand's axis is to go through, or None."""
        at_m = self.given.at_m
        return None if at_m is None else (at_m[0], at_m[1], at_m[2] if len(at_m) > 2 else 0.0)

    def suction(self) -> Grasp:
        """Return how a cup holds it: where a line meets its surface first."""
        # The closed hand is turned such that the wrist has most room.
        closing = self.closing or _across(self.approach)
        through = self.point() or self._middle(closing)
        away_m = self.lands_m(through)
        top_m = self.reach_m(self.outwards) if away_m is None else away_m
        tip = plus(through, self.outwards, top_m - dot(through, self.outwards))
        return Grasp(GraspKind.SUCTION, tip, closing, approach=self.approach)

    def lands_m(self, through: Point) -> float | None:
        """Return how far out the surface is on a line through a point [m]; None beside it."""
        if self.from_top:
            tops_m = (shape.top_m(through[0], through[1]) for shape in self.shapes)
            return max((top_m for top_m in tops_m if top_m is not None), default=None)
        top_m = self.reach_m(self.outwards)
        above = plus(through, self.outwards, top_m - dot(through, self.outwards))
        met_m = surface_m(self.shapes, above, self.approach)
        return None if met_m is None else top_m - met_m

    def cup_axis(self) -> Point:
        """Return a point on the axis of a suction cup [m]."""
        return self.point() or self._middle(self.closing or _across(self.approach))

    def jaws(self, *, centred: bool = False) -> Grasp:
        """Return how jaws hold it; `centred`: in the middle, wherever they are to hold it."""
        point = None if centred else self.point()
        named = self.given.closing_axis
        if self.from_top and named in ("x", "y", "auto"):
            axis = None if named == "auto" else str(named)
            boxes = [shape.box for shape in self.shapes]
            place = None if point is None else point[:2]
            return jaws_about(boxes, axis, self.given.depth_m, place)
        closing = self.closing
        if closing is not None:
            return self._jaws(closing, point)
        one, other = (self._jaws(axis, point) for axis in _crosswise(self.approach))
        return one if one.width_m <= other.width_m + 1e-9 else other

    def between_fingers(self, grasp: Grasp) -> bool:
        """Whether anything of the part is between the fingers' faces above their ends."""
        across = cross(self.approach, grasp.closing)
        out_m = dot(grasp.tip, self.outwards)

        def meets(shape: Shape, direction: Point, half_m: float) -> bool:
            low, high = -shape.reach_m(_opposite(direction)), shape.reach_m(direction)
            middle = dot(grasp.tip, direction)
            return abs((low + high) / 2 - middle) < (high - low) / 2 + half_m

        return any(
            shape.reach_m(self.outwards) > out_m + 1e-9
            and meets(shape, across, _FINGER_HALF_WIDTH_M)
            and meets(shape, grasp.closing, grasp.width_m / 2)
            for shape in self.shapes
        )

    def _jaws(self, closing: Point, point: Point | None) -> Grasp:
        """Return how jaws that close along a direction hold it."""
        outwards = self.outwards
        across = cross(self.approach, closing)
        tops_m = [shape.reach_m(outwards) for shape in self.shapes]
        top_m = max(tops_m)
        depth_m = self.given.depth_m
        if depth_m is None:
            thinnest_m = min(
                high_m + shape.reach_m(self.approach)
                for shape, high_m in zip(self.shapes, tops_m, strict=True)
                if high_m > top_m - 1e-6
            )
            depth_m = min(_DEPTH_FRACTION * thinnest_m, _MOST_DEPTH_M)
        held = [
            shape
            for shape, high_m in zip(self.shapes, tops_m, strict=True)
            if high_m > top_m - depth_m
        ]
        low_m, high_m = _extent(held, closing)
        tip = plus((0.0, 0.0, 0.0), outwards, top_m - depth_m)
        if point is None:
            tip = plus(tip, closing, (low_m + high_m) / 2)
            tip = plus(tip, across, sum(_extent(held, across)) / 2)
        else:
            tip = plus(plus(tip, closing, dot(point, closing)), across, dot(point, across))
        return Grasp(GraspKind.JAWS, tip, closing, high_m - low_m, self.approach)

    def _middle(self, closing: Point) -> Point:
        """Return a point on the axis of a hand that is to hold it in the middle."""
        if self.from_top:
            return (0.0, 0.0, 0.0)
        across = cross(self.approach, closing)
        middle = plus((0.0, 0.0, 0.0), closing, sum(_extent(self.shapes, closing)) / 2)
        return plus(middle, across, sum(_extent(self.shapes, across)) / 2)


def _extent(shapes: Sequence[Shape], direction: Point) -> tuple[float, float]:
    opposite = _opposite(direction)
    low_m = min(-shape.reach_m(opposite) for shape in shapes)
    return low_m, max(shape.reach_m(direction) for shape in shapes)


def _opposite(direction: Point) -> Point:
    return (-direction[0], -direction[1], -direction[2])


def _crosswise(approach: Point) -> tuple[Point, Point]:
    """Return two directions at right angles to one: axes of the part where that is along one."""
    axes = [axis for axis in AXES.values() if abs(dot(axis, approach)) < 1e-9]
    if len(axes) == 2:
        return axes[0], axes[1]
    level = axes[0] if axes else unit(cross(AXES["z"], approach))
    return level, cross(approach, level)


def _across(approach: Point) -> Point:
    """Return how a suction cup is turned that points in a direction: as y, if it can be."""
    one, other = _crosswise(approach)
    return other if math.fabs(other[1]) > math.fabs(one[1]) else one


_SIDES: tuple[tuple[str, Point], ...] = (
    ("top", DOWN),
    ("-x", AXES["x"]),
    ("+x", (-1.0, 0.0, 0.0)),
    ("-y", AXES["y"]),
    ("+y", (0.0, -1.0, 0.0)),
    ("bottom", AXES["z"]),
)
"""The sides of a part, and in which direction of its frame a hand there points."""
_AXES: tuple[Literal["x", "y", "z"], ...] = ("x", "y", "z")


def side_name(approach: Point) -> str:
    """Return the side of a part from which a hand comes that points in a direction."""
    for name, direction in _SIDES:
        if same_direction(direction, approach):
            return name
    return direction_name((-approach[0], -approach[1], -approach[2]))


def direction_name(direction: Point) -> str:
    """Return a unit vector in words: ``-x``, or its numbers where it is along no axis."""
    for name, axis in AXES.items():
        for sign in (1.0, -1.0):
            if same_direction((sign * axis[0], sign * axis[1], sign * axis[2]), direction):
                return f"{'+' if sign > 0 else '-'}{name}"
    return "(" + " ".join(f"{value + 0.0:.3g}" for value in direction) + ")"


def automatic() -> list[GraspConfig]:
    """Return the grasps that ``auto`` tries: from every side, closing along either axis there."""
    return [
        GraspConfig(approach=list(approach), closing_axis=axis)
        for _, approach in _SIDES
        for axis in _AXES
        if not dot(AXES[axis], approach)
    ]


def named(grasps: Sequence[Grasp]) -> tuple[Grasp, ...]:
    """Return grasps with names that tell them apart; a single one needs none."""
    if len(grasps) < 2:
        return tuple(grasps)
    names = [side_name(grasp.approach) for grasp in grasps]
    for more in (_closing, _kind):
        taken = Counter(names)
        names = [
            f"{name} {more(grasp)}" if taken[name] > 1 else name
            for name, grasp in zip(names, grasps, strict=True)
        ]
    taken, seen = Counter(names), {name: count(1) for name in names}
    names = [f"{name} {next(seen[name])}" if taken[name] > 1 else name for name in names]
    return tuple(replace(grasp, name=name) for grasp, name in zip(grasps, names, strict=True))


def _closing(grasp: Grasp) -> str:
    axis = grasp.closing_axis
    return f"closing along {axis if axis is not None else direction_name(grasp.closing)}"


def _kind(grasp: Grasp) -> str:
    return "by suction" if grasp.kind is GraspKind.SUCTION else "by jaws"
