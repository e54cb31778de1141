"""Bodies at poses: gaps, penetration depths, contact areas and supports.

Upright boxes and cylinders are prisms, compared exactly and without numpy. Other shapes are
surfaces (see `surface`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain, pairwise, product
from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

from skillplan.collision.boxes import WorldBox
from skillplan.task.motion import AXES
from skillplan.task.pose import Point, Pose, cross, dot, plus
from skillplan.task.shape import Box, Cylinder, Mesh, Shape

if TYPE_CHECKING:
    from skillplan.collision.surface import Polyhedron


Planar = tuple[float, float]
Polygon = tuple[Planar, ...]


def area(polygon: Sequence[Planar]) -> float:
    """Return the area of a polygon whose corners are listed anticlockwise."""
    return sum(
        (a[0] * b[1] - b[0] * a[1]) / 2
        for a, b in zip(polygon, (*polygon[1:], *polygon[:1]), strict=True)
    )


def intersect(polygon: Sequence[Planar], other: Sequence[Planar]) -> Polygon:
    """Return the intersection of two convex polygons (Sutherland and Hodgman); may be empty."""
    left = list(polygon)
    for begin, end in _sides(other):
        dx, dy = end[0] - begin[0], end[1] - begin[1]
        left = clip_below(left, (dy, -dx), dy * begin[0] - dx * begin[1])
    return tuple(left) if len(left) > 2 else ()


def clip_below(polygon: Sequence[Planar], normal: Planar, offset: float) -> list[Planar]:
    """Return the part of a convex polygon with normal . point <= offset."""
    beyond = [normal[0] * x + normal[1] * y - offset for x, y in polygon]
    kept: list[Planar] = []
    for i, here in enumerate(polygon):
        j = (i + 1) % len(polygon)
        if beyond[i] <= 0:
            kept.append(here)
        if beyond[i] * beyond[j] < 0:
            share = beyond[i] / (beyond[i] - beyond[j])
            there = polygon[j]
            kept.append(
                (here[0] + share * (there[0] - here[0]), here[1] + share * (there[1] - here[1]))
            )
    return kept


def measure_overlap(first: Sequence[Planar], other: Sequence[Planar]) -> float:
    """Return the least shift that separates two convex polygons (separating axes).

    It is negative if they are disjoint.
    """
    depth = math.inf
    for polygon in (first, other):
        for begin, end in _sides(polygon):
            dx, dy = end[0] - begin[0], end[1] - begin[1]
            length = math.hypot(dx, dy)
            if length == 0:
                continue
            normal = (dy / length, -dx / length)
            low_1, high_1 = _extent(first, normal)
            low_2, high_2 = _extent(other, normal)
            depth = min(depth, high_1 - low_2, high_2 - low_1)
    return depth


def measure_inwards(polygon: Sequence[Planar], point: Planar) -> float:
    """Return the distance of a point from the border of a convex polygon; negative outside."""
    distance, inside = math.inf, True
    for begin, end in _sides(polygon):
        dx, dy = end[0] - begin[0], end[1] - begin[1]
        px, py = point[0] - begin[0], point[1] - begin[1]
        inside = inside and dx * py - dy * px >= 0
        along = min(1.0, max(0.0, (px * dx + py * dy) / (dx * dx + dy * dy)))
        distance = min(distance, math.hypot(px - along * dx, py - along * dy))
    return distance if inside else -distance


def measure_union(polygons: Sequence[Sequence[Planar]]) -> float:
    """Return the area of the union of convex polygons."""
    if len(polygons) < 2:
        return sum(area(polygon) for polygon in polygons)
    # Imports numpy.
    import shapely

    # A corner that comes twice but for rounding makes a polygon invalid; its hull is valid.
    hulls = [shapely.Polygon(polygon).convex_hull for polygon in polygons]
    return float(shapely.union_all(hulls).area)


def _sides(polygon: Sequence[Planar]) -> Iterator[tuple[Planar, Planar]]:
    return zip(polygon, (*polygon[1:], *polygon[:1]), strict=True)


def _extent(polygon: Sequence[Planar], normal: Planar) -> tuple[float, float]:
    along = [normal[0] * x + normal[1] * y for x, y in polygon]
    return min(along), max(along)


# Tolerance of the cosine of a vertical axis: 5 micrometres at 100 mm.
_VERTICAL = 1e-9
# Points on the rim count as inside; rounding may put them this far outside [m].
_RIM_M = 1e-9
# Corners of the polygon that replaces a circle of equal area.
_CIRCLE = 180


@dataclass(frozen=True, slots=True)
class Prism:
    """An upright prism over a polygon or a circle.

    Parameters
    ----------
    low_m, high_m
        Heights of bottom and top [m].
    outline
        Corners seen from above, anticlockwise [m]; empty for a circle.
    centre, radius_m
        Centre and radius of the circle [m].
    """

    low_m: float
    high_m: float
    outline: Polygon = ()
    centre: Planar = (0.0, 0.0)
    radius_m: float = 0.0

    @property
    def width_m(self) -> float:
        """Least extent in the plane [m]."""
        if not self.outline:
            return 2 * self.radius_m
        a, b, c = self.outline[:3]
        return min(math.dist(a, b), math.dist(b, c))

    @property
    def face(self) -> Polygon:
        """Outline of top and bottom; for a circle a polygon of the same area."""
        if self.outline:
            return self.outline
        step = 2 * math.pi / _CIRCLE
        radius_m = self.radius_m * math.sqrt(step / math.sin(step))
        x, y = self.centre
        return tuple(
            (x + radius_m * math.cos(step * i), y + radius_m * math.sin(step * i))
            for i in range(_CIRCLE)
        )

    def beside_m(self, other: Prism) -> float:
        """Return the least planar shift that separates two prisms [m]; negative if disjoint."""
        if self.outline and other.outline:
            return measure_overlap(self.outline, other.outline)
        if self.outline:
            return other.radius_m + measure_inwards(self.outline, other.centre)
        if other.outline:
            return self.radius_m + measure_inwards(other.outline, self.centre)
        return self.radius_m + other.radius_m - math.dist(self.centre, other.centre)

    def depth_m(self, other: Prism) -> float:
        """Return the least shift that separates two prisms [m]; negative if they are disjoint."""
        upright = min(self.high_m - other.low_m, other.high_m - self.low_m)
        return upright if upright <= 0 else min(upright, self.beside_m(other))

    def holds(self, x_m: float, y_m: float) -> bool:
        """Return True if a point of the plane is in the outline or on the rim."""
        if self.outline:
            return measure_inwards(self.outline, (x_m, y_m)) >= -_RIM_M
        return math.dist(self.centre, (x_m, y_m)) <= self.radius_m + _RIM_M

    def shared(self, other: Prism) -> Polygon:
        """Return the intersection of both outlines."""
        return intersect(self.face, other.face)


def make_prism(shape: Shape, pose: Pose) -> Prism | None:
    """Return a shape at a pose as an upright prism, or None if it is another shape."""
    if not isinstance(shape, Box | Cylinder):
        return None
    size = shape.box.size
    rows = pose.rotation
    up = max(range(3), key=lambda axis: abs(rows[2][axis]))
    if 1 - abs(rows[2][up]) > _VERTICAL or (isinstance(shape, Cylinder) and up != 2):
        return None
    x, y, z = pose.apply(shape.centre)
    low_m, high_m = z - size[up] / 2, z + size[up] / 2
    if isinstance(shape, Cylinder):
        return Prism(low_m, high_m, centre=(x, y), radius_m=shape.diameter_m / 2)
    u, v = (axis for axis in range(3) if axis != up)
    a = (rows[0][u] * size[u] / 2, rows[1][u] * size[u] / 2)
    b = (rows[0][v] * size[v] / 2, rows[1][v] * size[v] / 2)
    if a[0] * b[1] < a[1] * b[0]:
        b = (-b[0], -b[1])
    return Prism(
        low_m,
        high_m,
        (
            (x - a[0] - b[0], y - a[1] - b[1]),
            (x + a[0] - b[0], y + a[1] - b[1]),
            (x + a[0] + b[0], y + a[1] + b[1]),
            (x - a[0] + b[0], y - a[1] + b[1]),
        ),
    )


_ROUNDING_M = 1e-9


def find_centre(shapes: Sequence[Shape], pose: Pose) -> Point:
    """Return the centre of volume of shapes at a pose [m].

    Overlaps of shapes count several times.
    """
    measured = [_measure_volume(shape) for shape in shapes]
    total = sum(volume for volume, _ in measured)
    x, y, z = (sum(volume * at[i] for volume, at in measured) / total for i in range(3))
    return pose.apply((x, y, z))


def is_supported(centre: Sequence[float], corners: Iterable[Planar]) -> bool:
    """Return True if a point lies within the convex hull of other points, seen from above."""
    angles = []
    for x, y in corners:
        dx, dy = x - centre[0], y - centre[1]
        if math.hypot(dx, dy) <= _ROUNDING_M:
            return True
        angles.append(math.atan2(dy, dx))
    if not angles:
        return False
    angles.sort()
    around = [*angles, angles[0] + 2 * math.pi]
    return max(b - a for a, b in pairwise(around)) <= math.pi + _ROUNDING_M


def _measure_volume(shape: Shape) -> tuple[float, Point]:
    """Return the volume of a shape [m3] and its centre [m]."""
    if isinstance(shape, Box):
        return math.prod(shape.size), shape.centre
    if isinstance(shape, Cylinder):
        return math.pi / 4 * shape.diameter_m**2 * shape.height_m, shape.centre
    return _measure_mesh_volume(shape)


def _measure_mesh_volume(mesh: Mesh) -> tuple[float, Point]:
    total, x, y, z = 0.0, 0.0, 0.0, 0.0
    for face in mesh.faces:
        a, b, c = (mesh.corners[index] for index in face)
        # Tetrahedron with the origin as its fourth corner.
        volume = dot(a, cross(b, c)) / 6
        total += volume
        x += volume * (a[0] + b[0] + c[0]) / 4
        y += volume * (a[1] + b[1] + c[1]) / 4
        z += volume * (a[2] + b[2] + c[2]) / 4
    return total, (x / total, y / total, z / total)


TOUCH_M = 2e-4
"""Gap and overlap that still count as touching [m]."""

_PRECISION_M = 1e-4
# Heights derived from narrowed surfaces may be less than the gap of the boxes by this length.
_SLOPE_M = 5e-3


class Piece:
    """One shape at a pose: a prism if possible, else a surface."""

    def __init__(self, shape: Shape, pose: Pose) -> None:
        self._shape, self._pose = shape, pose
        self.prism: Prism | None = make_prism(shape, pose)

    @cached_property
    def box(self) -> WorldBox:
        """Smallest upright box about the shape, exactly."""
        return _find_box(self._shape, self._pose)

    @cached_property
    def surface(self) -> Polyhedron:
        """Surface of the shape."""
        # Imports numpy, which boards of upright boxes and cylinders do not need.
        from skillplan.collision.surface import make_polyhedron

        return make_polyhedron(self._shape, self._pose)

    def height_above_m(self, lower: Piece, at_least_m: float) -> float:
        """Return the gap to fall onto another piece [m]; infinity if it is not above it."""
        if not _is_over(self.box, lower.box):
            return math.inf
        if self.prism is None or lower.prism is None:
            from skillplan.collision.surface import measure_gap

            if not (self.surface.convex and lower.surface.convex):
                return measure_gap(self.surface, lower.surface, at_least_m)
            # A convex piece is above or below as a whole.
            height_m = measure_gap(self.surface, lower.surface)
            return height_m if height_m >= at_least_m else math.inf
        # Walls that touch or nearly touch do not bear.
        grazing_m = min(TOUCH_M, self.prism.width_m / 4, lower.prism.width_m / 4)
        height_m = self.prism.low_m - lower.prism.high_m
        carries = height_m >= at_least_m and self.prism.beside_m(lower.prism) > grazing_m
        return height_m if carries else math.inf

    def depth_m(self, other: Piece) -> float:
        """Return the penetration depth in another piece [m]; 0 if they are disjoint."""
        if not _has_overlap(self.box, other.box, TOUCH_M):
            return 0.0
        if self.prism is None or other.prism is None:
            from skillplan.collision.surface import measure_depth_m

            return measure_depth_m(self.surface, other.surface)
        return max(0.0, self.prism.depth_m(other.prism))

    def touching(self, lower: Piece) -> Iterator[Polygon]:
        """Yield the contact areas on another piece, seen from above."""
        if not _is_over(self.box, lower.box):
            return
        if self.prism is None or lower.prism is None:
            from skillplan.collision.surface import find_contacts

            yield from find_contacts(self.surface, lower.surface, TOUCH_M)
        elif abs(self.prism.low_m - lower.prism.high_m) <= TOUCH_M:
            shared = self.prism.shared(lower.prism)
            if shared:
                yield shared

    def top_m(self, x_m: float, y_m: float) -> float | None:
        """Return the height of the highest surface at a point in plan [m], or None."""
        if self.prism is None:
            from skillplan.collision.surface import find_top

            return find_top(self.surface, x_m, y_m)
        return self.prism.high_m if self.prism.holds(x_m, y_m) else None


@dataclass(frozen=True, eq=False)
class Solid:
    """A body at a pose.

    Parameters
    ----------
    shapes
        At least one shape in the body's frame.
    """

    shapes: Sequence[Shape]
    pose: Pose
    # Answers about other bodies while they exist. A moved copy of the body begins without any.
    _heights_m: WeakKeyDictionary[Solid, dict[float, float | None]] = field(
        default_factory=WeakKeyDictionary, init=False, repr=False
    )
    _depths_m: WeakKeyDictionary[Solid, float] = field(
        default_factory=WeakKeyDictionary, init=False, repr=False
    )
    _contacts: WeakKeyDictionary[Solid, list[Polygon]] = field(
        default_factory=WeakKeyDictionary, init=False, repr=False
    )

    @cached_property
    def pieces(self) -> tuple[Piece, ...]:
        """Shapes in the world."""
        return tuple(Piece(shape, self.pose) for shape in self.shapes)

    @cached_property
    def box(self) -> WorldBox:
        """Smallest upright box about the body."""
        lows, highs = zip(*((piece.box.low, piece.box.high) for piece in self.pieces), strict=True)
        x0, y0, z0 = (min(values) for values in zip(*lows, strict=True))
        x1, y1, z1 = (max(values) for values in zip(*highs, strict=True))
        return WorldBox((x0, y0, z0), (x1, y1, z1))

    @cached_property
    def centre(self) -> Point:
        """Centre of its volume [m]; see `find_centre`."""
        return find_centre(self.shapes, self.pose)

    def fall_m(self, lower: Solid) -> float | None:
        """Return the distance to lower the body from far above onto another [m].

        The distance is negative if the body has to rise to lie on it. None if it is not above it.
        """
        return self._height_m(lower, -math.inf)

    def gap_m(self, lower: Solid) -> float | None:
        """Return the gap below the body to another body [m]; None if it is not above it."""
        return self._height_m(lower, -TOUCH_M)

    def narrowed_fall_m(self, lower: Solid, by_m: float) -> float:
        """Return the distance to fall with walls shifted inwards by a length [m], or infinity."""
        from skillplan.collision.surface import measure_narrowed_gap

        return min(
            measure_narrowed_gap(piece.surface, two.surface, by_m)
            for piece, two in product(self.pieces, lower.pieces)
        )

    def depth_m(self, other: Solid) -> float:
        """Return the penetration depth of the deepest pair of shapes [m]; 0 if disjoint."""
        if not _has_overlap(self.box, other.box, TOUCH_M):
            return 0.0
        if other not in self._depths_m:
            self._depths_m[other] = max(
                piece.depth_m(two) for piece, two in product(self.pieces, other.pieces)
            )
        return self._depths_m[other]

    def top_m(self, x_m: float, y_m: float) -> float | None:
        """Return the height of the highest surface at a point in plan [m], or None."""
        tops_m = [top_m for piece in self.pieces if (top_m := piece.top_m(x_m, y_m)) is not None]
        return max(tops_m, default=None)

    def spans_m(self, start: Point, direction: Point) -> list[tuple[float, float]]:
        """Return the stretches of a line within the body, as distances from its start [m].

        Parameters
        ----------
        direction
            Unit vector in the world. Stretches before the start have negative distances.
        """
        # Imports numpy.
        from skillplan.collision.surface import find_spans

        spans: list[tuple[float, float]] = []
        all_spans = (find_spans(piece.surface, start, direction) for piece in self.pieces)
        for begin_m, end_m in sorted(chain.from_iterable(all_spans)):
            if spans and begin_m <= spans[-1][1] + _ROUNDING_M:
                spans[-1] = (spans[-1][0], max(spans[-1][1], end_m))
            else:
                spans.append((begin_m, end_m))
        return spans

    def way_out_m(self, other: Solid) -> float:
        """Return the shift that separates two bodies [m]; 0 if they are disjoint.

        Exact for upright boxes and cylinders. For other shapes it is the least shift along the axes
        of the
        world, to 0.1 mm.
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
        """Return the shift along a direction that separates the bodies, at most `most_m` [m]."""
        moved_m = 0.0
        while moved_m < most_m:
            by = plus((0.0, 0.0, 0.0), direction, moved_m)
            depth_m = Solid(self.shapes, self.pose.moved(by)).depth_m(other)
            if depth_m <= TOUCH_M:
                # A depth below the tolerance counts as separated.
                return moved_m + depth_m
            # The depth decreases by at most the shift.
            moved_m += max(depth_m - TOUCH_M, _PRECISION_M)
        return most_m

    def contact_m2(self, lower: Solid) -> float:
        """Return the contact area on another body, seen from above [m2]."""
        return measure_union(self.contacts(lower))

    def contacts(self, lower: Solid) -> list[Polygon]:
        """Return the contact polygons on another body, seen from above [m]."""
        if not _has_overlap(self.box, lower.box, -TOUCH_M):
            return []
        if lower not in self._contacts:
            self._contacts[lower] = [
                polygon
                for piece, two in product(self.pieces, lower.pieces)
                for polygon in piece.touching(two)
            ]
        return self._contacts[lower]

    def _height_m(self, lower: Solid, at_least_m: float) -> float | None:
        """Return the gap to fall onto another body [m] without gaps below a limit, or None."""
        known = self._heights_m.setdefault(lower, {})
        if at_least_m not in known:
            known[at_least_m] = self._measure_height_m(lower, at_least_m)
        return known[at_least_m]

    def _measure_height_m(self, lower: Solid, at_least_m: float) -> float | None:
        if not _is_over(self.box, lower.box):
            return None
        pairs = [
            (piece.box.low[2] - two.box.high[2] - _SLOPE_M, piece, two)
            for piece, two in product(self.pieces, lower.pieces)
        ]
        least_m = math.inf
        # Closest boxes first: the gap between pieces is at least that between their boxes.
        for bound_m, piece, two in sorted(pairs, key=lambda pair: pair[0]):
            if bound_m > least_m:
                break
            least_m = min(least_m, piece.height_above_m(two, at_least_m))
        return None if math.isinf(least_m) else least_m


def _find_box(shape: Shape, pose: Pose) -> WorldBox:
    back = pose.inverse()
    lows, highs = [], []
    for axis, place in zip(AXES.values(), pose.position, strict=True):
        x, y, z = back.rotate(axis)
        lows.append(place - shape.reach_m((-x, -y, -z)))
        highs.append(place + shape.reach_m((x, y, z)))
    return WorldBox((lows[0], lows[1], lows[2]), (highs[0], highs[1], highs[2]))


def _is_over(box: WorldBox, other: WorldBox) -> bool:
    return all(box.low[i] < other.high[i] and other.low[i] < box.high[i] for i in (0, 1))


def _has_overlap(box: WorldBox, other: WorldBox, by_m: float) -> bool:
    return all(
        box.low[i] + by_m < other.high[i] and other.low[i] + by_m < box.high[i] for i in range(3)
    )
