"""A body's true shapes at a pose, and how two of them are to each other."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING

from skillplan.collision.boxes import WorldBox
from skillplan.collision.solids.polygons import Polygon, covered
from skillplan.collision.solids.prism import Prism, prism_of
from skillplan.task.grasp import AXES
from skillplan.task.pose import Point, Pose, plus
from skillplan.task.shape import Shape

if TYPE_CHECKING:
    from skillplan.collision.solids.polyhedron import Polyhedron

TOUCH_M = 2e-4
"""Gap and overlap that still count as touching [m]."""

_PRECISION_M = 1e-4
# A height that is told from those of narrower ones may be less than that between boxes by so much.
_SLOPE_M = 5e-3


class Piece:
    """One shape at a pose: a prism where it is one, else a surface.

    Parameters
    ----------
    shape
        In the frame of its body.
    pose
        Of the body.
    """

    def __init__(self, shape: Shape, pose: Pose) -> None:
        self._shape, self._pose = shape, pose
        self.prism: Prism | None = prism_of(shape, pose)

    @cached_property
    def box(self) -> WorldBox:
        """The smallest upright box about it, exactly."""
        return _box_about(self._shape, self._pose)

    @cached_property
    def surface(self) -> Polyhedron:
        """Its surface."""
        # Takes numpy, which boards of upright boxes and cylinders do without.
        from skillplan.collision.solids.polyhedron import polyhedron_of

        return polyhedron_of(self._shape, self._pose)

    def height_above_m(self, lower: Piece, at_least_m: float) -> float:
        """Return how far it may fall onto another [m]; infinity where it is not over it."""
        if not _over(self.box, lower.box):
            return math.inf
        if self.prism is None or lower.prism is None:
            from skillplan.collision.solids.falling import height_above

            if not (self.surface.convex and lower.surface.convex):
                return height_above(self.surface, lower.surface, at_least_m)
            # What is convex is above or beneath as a whole.
            height_m = height_above(self.surface, lower.surface)
            return height_m if height_m >= at_least_m else math.inf
        # Walls that touch, or nearly do, carry nothing.
        grazing_m = min(TOUCH_M, self.prism.width_m / 4, lower.prism.width_m / 4)
        height_m = self.prism.low_m - lower.prism.high_m
        carries = height_m >= at_least_m and self.prism.beside_m(lower.prism) > grazing_m
        return height_m if carries else math.inf

    def depth_m(self, other: Piece) -> float:
        """Return how deep it is in another [m]; 0 where they are apart."""
        if not _meet(self.box, other.box, TOUCH_M):
            return 0.0
        if self.prism is None or other.prism is None:
            from skillplan.collision.solids.penetration import depth_m

            return depth_m(self.surface, other.surface)
        return max(0.0, self.prism.depth_m(other.prism))

    def touching(self, lower: Piece) -> Iterator[Polygon]:
        """Yield where it stands on another, seen from above."""
        if not _over(self.box, lower.box):
            return
        if self.prism is None or lower.prism is None:
            from skillplan.collision.solids.touching import touching

            yield from touching(self.surface, lower.surface, TOUCH_M)
        elif abs(self.prism.low_m - lower.prism.high_m) <= TOUCH_M:
            shared = self.prism.shared(lower.prism)
            if shared:
                yield shared

    def top_m(self, x_m: float, y_m: float) -> float | None:
        """Return the height of its highest surface at a point of its plan [m]; None beside it."""
        if self.prism is None:
            from skillplan.collision.solids.falling import top_at

            return top_at(self.surface, x_m, y_m)
        return self.prism.high_m if self.prism.holds(x_m, y_m) else None


@dataclass(frozen=True, eq=False)
class Solid:
    """A body at a pose.

    Parameters
    ----------
    shapes
        At least one, in the body's frame.
    pose
        Of the body.
    """

    shapes: Sequence[Shape]
    pose: Pose

    @cached_property
    def pieces(self) -> tuple[Piece, ...]:
        """Its shapes in the world."""
        return tuple(Piece(shape, self.pose) for shape in self.shapes)

    @cached_property
    def box(self) -> WorldBox:
        """The smallest upright box about it."""
        lows, highs = zip(*((piece.box.low, piece.box.high) for piece in self.pieces), strict=True)
        x0, y0, z0 = (min(values) for values in zip(*lows, strict=True))
        x1, y1, z1 = (max(values) for values in zip(*highs, strict=True))
        return WorldBox((x0, y0, z0), (x1, y1, z1))

    def fall_m(self, lower: Solid) -> float | None:
        """Return how far it may be let down from far above until it meets another [m].

        Below 0 how far it has to rise to lie on it. None where it is not over it.
        """
        return self._height_m(lower, -math.inf)

    def gap_m(self, lower: Solid) -> float | None:
        """Return how far it may fall from where it is until it meets another [m], or None."""
        return self._height_m(lower, -TOUCH_M)

    def narrowed_fall_m(self, lower: Solid, by_m: float) -> float:
        """Return how far it may fall, its walls shifted inwards by a length [m], or infinity."""
        from skillplan.collision.solids.falling import narrowed_height_above

        return min(
            narrowed_height_above(one.surface, two.surface, by_m)
            for one, two in product(self.pieces, lower.pieces)
        )

    def depth_m(self, other: Solid) -> float:
        """Return how deep it is in another [m], at the deepest pair of shapes; 0 if apart."""
        if not _meet(self.box, other.box, TOUCH_M):
            return 0.0
        return max(one.depth_m(two) for one, two in product(self.pieces, other.pieces))

    def top_m(self, x_m: float, y_m: float) -> float | None:
        """Return the height of its highest surface at a point of its plan [m]; None beside it."""
        tops_m = [top_m for one in self.pieces if (top_m := one.top_m(x_m, y_m)) is not None]
        return max(tops_m, default=None)

    def way_out_m(self, other: Solid) -> float:
        """Return how far it would have to move to be out of another [m]; 0 if they are apart.

        Exact for upright boxes and cylinders; of others the least along the axes of the world, to
        0.1 mm.
        """
        depth_m = self.depth_m(other)
        upright = all(piece.prism is not None for piece in (*self.pieces, *other.pieces))
        if upright or depth_m <= TOUCH_M:
            return depth_m
        least_m = math.inf
        for axis, direction in enumerate(AXES.values()):
            ahead_m = other.box.high[axis] - self.box.low[axis]
            back_m = self.box.high[axis] - other.box.low[axis]
            for sign, apart_m in ((1.0, ahead_m), (-1.0, back_m)):
                x, y, z = (sign * value for value in direction)
                least_m = min(least_m, self._out_m(other, (x, y, z), min(apart_m, least_m)))
        return max(depth_m, least_m)

    def _out_m(self, other: Solid, direction: Point, most_m: float) -> float:
        """Return how far it moves along a direction until it is out, `most_m` at most [m]."""
        moved_m = 0.0
        while moved_m < most_m:
            by = plus((0.0, 0.0, 0.0), direction, moved_m)
            depth_m = Solid(self.shapes, self.pose.moved(by)).depth_m(other)
            if depth_m <= TOUCH_M:
                # What is so deep counts as out.
                return moved_m + depth_m
            # It comes out by no more than it moves.
            moved_m += max(depth_m - TOUCH_M, _PRECISION_M)
        return most_m

    def contact_m2(self, lower: Solid) -> float:
        """Return the area by which it stands on another, seen from above [m2]."""
        return covered(self.contacts(lower))

    def contacts(self, lower: Solid) -> list[Polygon]:
        """Return where it stands on another, seen from above [m]."""
        if not _meet(self.box, lower.box, -TOUCH_M):
            return []
        return [
            polygon
            for one, two in product(self.pieces, lower.pieces)
            for polygon in one.touching(two)
        ]

    def _height_m(self, lower: Solid, at_least_m: float) -> float | None:
        if not _over(self.box, lower.box):
            return None
        pairs = [
            (one.box.low[2] - two.box.high[2] - _SLOPE_M, one, two)
            for one, two in product(self.pieces, lower.pieces)
        ]
        least_m = math.inf
        # Those whose boxes are closest first: no piece is above another by less than its box.
        for bound_m, one, two in sorted(pairs, key=lambda pair: pair[0]):
            if bound_m > least_m:
                break
            least_m = min(least_m, one.height_above_m(two, at_least_m))
        return None if math.isinf(least_m) else least_m


def _box_about(shape: Shape, pose: Pose) -> WorldBox:
    back = pose.inverse()
    lows, highs = [], []
    for axis, place in zip(AXES.values(), pose.position, strict=True):
        x, y, z = back.rotate(axis)
        lows.append(place - shape.reach_m((-x, -y, -z)))
        highs.append(place + shape.reach_m((x, y, z)))
    return WorldBox((lows[0], lows[1], lows[2]), (highs[0], highs[1], highs[2]))


def _over(one: WorldBox, other: WorldBox) -> bool:
    return all(one.low[i] < other.high[i] and other.low[i] < one.high[i] for i in (0, 1))


def _meet(one: WorldBox, other: WorldBox, by_m: float) -> bool:
    return all(
        one.low[i] + by_m < other.high[i] and other.low[i] + by_m < one.high[i] for i in range(3)
    )
