"""Where a hand that comes from any side holds what is made of some shapes."""

from __future__ import annotations

import math
from collections.abc import Sequence

from skillplan.domains.assembly.handling.schema import GraspConfig, unit_of
from skillplan.domains.assembly.handling.surface import surface_m
from skillplan.physics.linear_motions import jaws_about
from skillplan.robots.catalogue import STANDARD_HAND
from skillplan.task.grasp import AXES, Grasp, GraspKind
from skillplan.task.pose import DOWN, Point, cross, dot, plus, same_direction, unit
from skillplan.task.shape import Shape

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
