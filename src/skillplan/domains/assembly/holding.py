"""Hands on parts: grasp points for a hand from any side, and names of sides and grasps."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import count
from typing import Literal

from skillplan.domains.assembly.schema_types import GraspConfig, make_unit
from skillplan.physics.linear_motions import grasp_boxes
from skillplan.robots.arm_description import Hand
from skillplan.robots.catalogue import STANDARD_HAND
from skillplan.task.motion import AXES, Grasp, GraspKind
from skillplan.task.pose import DOWN, Point, cross, dot, is_same_direction, plus, unit
from skillplan.task.shape import Box, Cylinder, Mesh, Shape

# Share of the height between the jaws that they hold, and the most of it [m].
_DEPTH_FRACTION = 0.5
_MOST_DEPTH_M = 0.012
_FINGER_HALF_WIDTH_M = STANDARD_HAND.jaw_half_width_m
# Least depth of fingers in a hole [m].
_LEAST_DEPTH_M = 0.002
# Lines across a wall or a hole: shares of a finger's half width, and of its depth.
_ACROSS, _ABOVE = (-0.97, -0.5, 1e-4, 0.5, 0.97), (0.15, 0.5, 0.85)
# Distance of a line's begin from the part [m].
_BESIDE_M = 0.01
# Greatest cosine of two directions that count as perpendicular; the rest is projected away.
_RIGHT_ANGLE = 0.01
# A ray along an edge meets the shape; rounding may put it this far outside [m].
_RIM_M = 1e-9

_SIDES: tuple[tuple[str, Point], ...] = (
    ("top", DOWN),
    ("-x", AXES["x"]),
    ("+x", (-1.0, 0.0, 0.0)),
    ("-y", AXES["y"]),
    ("+y", (0.0, -1.0, 0.0)),
    ("bottom", AXES["z"]),
)
"""Sides of a part, and the direction in its frame of a hand that comes from there."""
_AXES: tuple[Literal["x", "y", "z"], ...] = ("x", "y", "z")


class Handle:
    """A grasp of a part as a task file describes it.

    Attributes
    ----------
    approach
        Unit vector in the part's frame in which the hand points.
    closing
        Direction in which the jaws close; None if the part decides.
    closes_askew
        True if that direction is not perpendicular to the approach.
    point
        A point on the hand's axis [m]; None if the part decides.
    hand
        The hand that takes it.
    """

    def __init__(
        self,
        given: GraspConfig,
        kind: GraspKind,
        shapes: Sequence[Shape],
        hand: Hand = STANDARD_HAND,
    ) -> None:
        self.given = given
        self.kind = kind
        self.hand = hand
        self.shapes = tuple(shapes)
        self.approach = make_unit(given.approach)
        self.outwards: Point = _negate(self.approach)
        self.from_top = is_same_direction(self.approach, DOWN)
        self.closing: Point | None = None
        self.closes_askew = False
        axis = given.closing_axis
        if axis != "auto":
            closing = AXES[axis] if isinstance(axis, str) else make_unit(axis)
            off = dot(closing, self.approach)
            self.closes_askew = abs(off) > _RIGHT_ANGLE
            if not self.closes_askew:
                self.closing = closing if off == 0 else unit(plus(closing, self.approach, -off))
        at_m = given.at_m
        self.point: Point | None = (
            None if at_m is None else (at_m[0], at_m[1], at_m[2] if len(at_m) > 2 else 0.0)
        )

    @property
    def height_m(self) -> float:
        """Extent of the part along the approach [m]."""
        return self.reach_m(self.outwards) + self.reach_m(self.approach)

    def reach_m(self, direction: Point) -> float:
        """Return the extent of the part from its origin along a direction [m]."""
        return max(shape.reach_m(direction) for shape in self.shapes)

    def grasp(self) -> Grasp:
        """Return the grasp; if there is nothing to hold, the grasp of an imagined surface."""
        if self.kind is GraspKind.JAWS:
            return self.jaws()
        # The closed hand is turned for the most room at the wrist.
        closing = self.closing or _choose_closing(self.approach)
        through = self.cup_axis()
        surface_out_m = self.lands_m(through)
        top_m = self.reach_m(self.outwards) if surface_out_m is None else surface_out_m
        tip = plus(through, self.outwards, top_m - dot(through, self.outwards))
        return Grasp(GraspKind.SUCTION, tip, closing, approach=self.approach)

    def lands_m(self, through: Point) -> float | None:
        """Return the distance of the surface from the origin along `outwards` [m].

        Parameters
        ----------
        through
            A point on the axis of the suction cup [m].

        Returns
        -------
        float or None
            None if the axis misses the part.
        """
        if self.from_top:
            tops_m = (shape.top_m(through[0], through[1]) for shape in self.shapes)
            return max((top_m for top_m in tops_m if top_m is not None), default=None)
        top_m = self.reach_m(self.outwards)
        above = plus(through, self.outwards, top_m - dot(through, self.outwards))
        met_m = trace_ray_m(self.shapes, above, self.approach)
        return None if met_m is None else top_m - met_m

    def cup_axis(self) -> Point:
        """Return a point on the axis of a suction cup [m]: as given, or in the part's middle."""
        if self.point is not None or self.from_top:
            return self.point or (0.0, 0.0, 0.0)
        closing = self.closing or _choose_closing(self.approach)
        across = cross(self.approach, closing)
        middle = plus((0.0, 0.0, 0.0), closing, sum(_measure_extent(self.shapes, closing)) / 2)
        return plus(middle, across, sum(_measure_extent(self.shapes, across)) / 2)

    def jaws(self, *, centred: bool = False) -> Grasp:
        """Return the grasp of jaws; `centred` ignores a given point."""
        grasp = self._choose_jaws(None if centred else self.point)
        if self.given.hold != "outer":
            grasp = self.feature or grasp
        width_m = self.given.width_m
        grasp = grasp if width_m is None else replace(grasp, width_m=width_m)
        if self.given.hold != "inner":
            return grasp
        fingers_m = 2 * self.hand.jaw_thickness_m(self.depth_m(grasp))
        return replace(grasp, inside_m=min(fingers_m, grasp.width_m))

    def depth_m(self, grasp: Grasp) -> float:
        """Return the depth of the fingers' ends below the part's top, seen from the hand [m]."""
        return self.reach_m(self.outwards) - dot(grasp.tip, self.outwards)

    @cached_property
    def feature(self) -> Grasp | None:
        """The grasp of a wall or a hole, centred on it; None if there is none."""
        coarse = self._choose_jaws(self.point)
        closing = coarse.closing
        across = cross(self.approach, closing)
        depth_m = self.given.depth_m
        if depth_m is None:
            depth_m = min(_DEPTH_FRACTION * self.height_m, _MOST_DEPTH_M)
            if self.given.hold == "inner":
                depth_m = min(depth_m, max(self.hand.straight_jaw_m, _LEAST_DEPTH_M))
        end_m = self.reach_m(self.outwards) - depth_m
        tip = plus(coarse.tip, self.outwards, end_m - dot(coarse.tip, self.outwards))
        half_m = self.hand.jaw_half_width_m
        lines = [
            plus(plus(tip, across, share * half_m), self.outwards, above * depth_m)
            for share in _ACROSS
            for above in _ABOVE
        ]
        spans = [self._trace_material(line, closing) for line in lines]
        middle = spans[len(spans) // 2]
        is_wall = self.given.hold == "wall"
        if self.point is not None or not is_wall:
            at_m = dot(tip, closing)
        elif len(middle) < 2:
            return None
        else:
            at_m = sum(middle[-1]) / 2
        gaps = [_find_wall(span, at_m) if is_wall else _find_gap(span, at_m) for span in spans]
        sides = [side for side in gaps if side is not None]
        if not sides or (not is_wall and len(sides) < len(gaps)):
            return None
        lows_m, highs_m = zip(*sides, strict=True)
        low_m, high_m = (min(lows_m), max(highs_m)) if is_wall else (max(lows_m), min(highs_m))
        if high_m - low_m <= _RIM_M:
            return None
        tip = plus(tip, closing, (low_m + high_m) / 2 - dot(tip, closing))
        return Grasp(GraspKind.JAWS, tip, closing, high_m - low_m, self.approach)

    def _trace_material(self, through: Point, closing: Point) -> list[tuple[float, float]]:
        """Return the stretches of a line in the part, from its origin along `closing` [m]."""
        begin_m = -self.reach_m(_negate(closing)) - _BESIDE_M
        start = plus(through, closing, begin_m - dot(through, closing))
        spans = sorted(span for shape in self.shapes for span in _find_spans(shape, start, closing))
        merged: list[tuple[float, float]] = []
        for low, high in spans:
            if merged and low <= merged[-1][1] + _RIM_M:
                merged[-1] = merged[-1][0], max(merged[-1][1], high)
            else:
                merged.append((low, high))
        return [(begin_m + low, begin_m + high) for low, high in merged]

    def _choose_jaws(self, point: Point | None) -> Grasp:
        named = self.given.closing_axis
        if self.from_top and named in ("x", "y", "auto"):
            axis = None if named == "auto" else str(named)
            boxes = [shape.box for shape in self.shapes]
            place = None if point is None else point[:2]
            return grasp_boxes(boxes, axis, self.given.depth_m, place)
        if self.closing is not None:
            return self._jaws(self.closing, point)
        grasp, other = (self._jaws(axis, point) for axis in _find_perpendicular(self.approach))
        return grasp if grasp.width_m <= other.width_m + 1e-9 else other

    def between_fingers(self, grasp: Grasp) -> bool:
        """Return True if some shape is between the faces of the fingers, above their ends."""
        across = cross(self.approach, grasp.closing)
        out_m = dot(grasp.tip, self.outwards)

        def meets(shape: Shape, direction: Point, half_m: float) -> bool:
            low, high = -shape.reach_m(_negate(direction)), shape.reach_m(direction)
            middle = dot(grasp.tip, direction)
            return abs((low + high) / 2 - middle) < (high - low) / 2 + half_m

        return any(
            shape.reach_m(self.outwards) > out_m + 1e-9
            and meets(shape, across, _FINGER_HALF_WIDTH_M)
            and meets(shape, grasp.closing, grasp.width_m / 2)
            for shape in self.shapes
        )

    def _jaws(self, closing: Point, point: Point | None) -> Grasp:
        """Return the grasp of jaws that close in a direction."""
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
        low_m, high_m = _measure_extent(held, closing)
        tip = plus((0.0, 0.0, 0.0), outwards, top_m - depth_m)
        if point is None:
            tip = plus(tip, closing, (low_m + high_m) / 2)
            tip = plus(tip, across, sum(_measure_extent(held, across)) / 2)
        else:
            tip = plus(plus(tip, closing, dot(point, closing)), across, dot(point, across))
        return Grasp(GraspKind.JAWS, tip, closing, high_m - low_m, self.approach)


def trace_ray_m(shapes: Iterable[Shape], start: Point, direction: Point) -> float | None:
    """Return the distance along a ray to the first surface ahead [m]; None if there is none.

    Parameters
    ----------
    start
        A point outside all of them, or 0 is returned [m].
    """
    met_m: list[float] = []
    for shape in shapes:
        if isinstance(shape, Mesh):
            crossings = _list_crossings(shape, start, direction)
            ahead = sorted((round(at, 9), side) for at, side in crossings if at > 0)
            # The first face ahead is left if the start is inside.
            met_m += [at if side < 0 else 0.0 for at, side in ahead[:1]]
        elif (span := _find_span(shape, start, direction)) is not None and span[1] > 0:
            met_m.append(max(span[0], 0.0))
    return min(met_m, default=None)


def _find_wall(spans: Sequence[tuple[float, float]], at_m: float) -> tuple[float, float] | None:
    """Return the stretch of material at a place of a line, or None if there is none."""
    return next((span for span in spans if span[0] - _RIM_M <= at_m <= span[1] + _RIM_M), None)


def _find_gap(spans: Sequence[tuple[float, float]], at_m: float) -> tuple[float, float] | None:
    """Return the gap between material on both sides of a place of a line, or None."""
    below = max((high for _, high in spans if high <= at_m), default=None)
    above = min((low for low, _ in spans if low >= at_m), default=None)
    is_blocked = _find_wall(spans, at_m) is not None
    return None if below is None or above is None or is_blocked else (below, above)


def _find_spans(shape: Shape, start: Point, direction: Point) -> list[tuple[float, float]]:
    """Return all stretches of a line inside a shape [m]."""
    if not isinstance(shape, Mesh) or shape.convex:
        span = _find_span(shape, start, direction)
        return [] if span is None else [span]
    events = sorted({(round(at, 9), side) for at, side in _list_crossings(shape, start, direction)})
    spans, enters, inside = [], 0.0, 0
    for at, side in events:
        enters = at if inside == 0 and side < 0 else enters
        inside -= side
        if inside == 0:
            spans.append((enters, at))
    return spans


def _find_span(shape: Shape, start: Point, direction: Point) -> tuple[float, float] | None:
    """Return the first and last distance at which a line is inside a shape [m], or None."""
    if isinstance(shape, Box):
        return _intersect(
            _cross_slab(start[axis] - shape.centre[axis], direction[axis], shape.size[axis] / 2)
            for axis in range(3)
        )
    if isinstance(shape, Cylinder):
        z = _cross_slab(start[2] - shape.centre[2], direction[2], shape.height_m / 2)
        return _intersect((z, _cross_mantle(shape, start, direction)))
    return _cross_mesh(shape, start, direction)


def _cross_slab(offset: float, slope: float, half: float) -> tuple[float, float] | None:
    """Return the range of ``t`` with ``|offset + t * slope| <= half``."""
    if abs(slope) < 1e-12:
        return (-math.inf, math.inf) if abs(offset) <= half + _RIM_M else None
    ends = ((-half - offset) / slope, (half - offset) / slope)
    return min(ends), max(ends)


def _cross_mantle(shape: Cylinder, start: Point, direction: Point) -> tuple[float, float] | None:
    """Return the span of a line in an upright cylinder without ends."""
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


def _cross_mesh(shape: Mesh, start: Point, direction: Point) -> tuple[float, float] | None:
    """Return the span of a line from its first to its last crossing of a mesh."""
    met = [at for at, _ in _list_crossings(shape, start, direction)]
    return (min(met), max(met)) if met else None


def _list_crossings(shape: Mesh, start: Point, direction: Point) -> list[tuple[float, int]]:
    """Return where a line crosses faces of a mesh, with -1 into it and 1 out of it."""
    box = shape.box
    off = cross(plus(box.centre, start, -1.0), direction)
    if dot(off, off) > dot(box.size, box.size) / 4 + _RIM_M:
        # The line passes the sphere about the box.
        return []
    # Boards of boxes do without numpy.
    import numpy as np

    a, b, c = (shape.triangles[:, corner] for corner in range(3))
    u, v = b - a, c - a
    normals = np.cross(u, v)
    steep = normals @ np.array(direction)
    crossed = np.abs(steep) >= 1e-18
    a, u, v, normals, steep = (values[crossed] for values in (a, u, v, normals, steep))
    distances = np.einsum("ij,ij->i", normals, a - np.array(start)) / steep
    inside = np.array(start) + distances[:, None] * np.array(direction) - a
    sizes = np.einsum("ij,ij->i", normals, normals)
    along_u = np.einsum("ij,ij->i", np.cross(inside, v), normals) / sizes
    along_v = np.einsum("ij,ij->i", np.cross(u, inside), normals) / sizes
    met = np.minimum(np.minimum(along_u, along_v), 1 - along_u - along_v) >= -1e-9
    sides = np.where(steep[met] > 0, 1, -1)
    return list(zip(distances[met].tolist(), sides.tolist(), strict=True))


def _intersect(spans: Iterable[tuple[float, float] | None]) -> tuple[float, float] | None:
    """Return the intersection of spans; None if it is empty."""
    low, high = -math.inf, math.inf
    for span in spans:
        if span is None:
            return None
        low, high = max(low, span[0]), min(high, span[1])
    return (low, high) if low <= high + _RIM_M else None


def name_side(approach: Point) -> str:
    """Return the name of the side from which a hand comes."""
    for name, direction in _SIDES:
        if is_same_direction(direction, approach):
            return name
    return name_direction(_negate(approach))


def name_direction(direction: Point) -> str:
    """Return the name of a unit vector: ``-x``, or its components if it is oblique."""
    for name, axis in AXES.items():
        for sign in (1.0, -1.0):
            if is_same_direction((sign * axis[0], sign * axis[1], sign * axis[2]), direction):
                return f"{'+' if sign > 0 else '-'}{name}"
    return "(" + " ".join(f"{value + 0.0:.3g}" for value in direction) + ")"


def list_automatic_grasps() -> list[GraspConfig]:
    """Return the candidates of ``auto``: each side, with the jaws along either axis there."""
    return [
        GraspConfig(approach=list(approach), closing_axis=axis)
        for _, approach in _SIDES
        for axis in _AXES
        if not dot(AXES[axis], approach)
    ]


def name_grasps(grasps: Sequence[Grasp]) -> tuple[Grasp, ...]:
    """Return grasps with distinct names; a single grasp gets none."""
    if len(grasps) < 2:
        return tuple(grasps)
    names = [name_side(grasp.approach) for grasp in grasps]
    for detail in (_describe_closing, _describe_kind):
        taken = Counter(names)
        details = [detail(grasp) for grasp in grasps]
        # Grasps that share the last detail, too, are numbered.
        kinds = Counter(name for name, _ in set(zip(names, details, strict=True)))
        tells = taken if detail is _describe_closing else kinds
        names = [
            f"{name} {words}" if tells[name] > 1 else name
            for name, words in zip(names, details, strict=True)
        ]
    taken, numbers = Counter(names), {name: count(1) for name in names}
    names = [f"{name} {next(numbers[name])}" if taken[name] > 1 else name for name in names]
    return tuple(replace(grasp, name=name) for grasp, name in zip(grasps, names, strict=True))


def _describe_closing(grasp: Grasp) -> str:
    axis = grasp.closing_axis
    return f"closing along {axis if axis is not None else name_direction(grasp.closing)}"


def _describe_kind(grasp: Grasp) -> str:
    if grasp.is_inner:
        return "from inside"
    return "by suction" if grasp.kind is GraspKind.SUCTION else "by jaws"


def _measure_extent(shapes: Sequence[Shape], direction: Point) -> tuple[float, float]:
    opposite = _negate(direction)
    low_m = min(-shape.reach_m(opposite) for shape in shapes)
    return low_m, max(shape.reach_m(direction) for shape in shapes)


def _negate(direction: Point) -> Point:
    return (-direction[0], -direction[1], -direction[2])


def _find_perpendicular(approach: Point) -> tuple[Point, Point]:
    """Return two directions perpendicular to an approach: axes of the part if possible."""
    axes = [axis for axis in AXES.values() if abs(dot(axis, approach)) < 1e-9]
    if len(axes) == 2:
        return axes[0], axes[1]
    level = axes[0] if axes else unit(cross(AXES["z"], approach))
    return level, cross(approach, level)


def _choose_closing(approach: Point) -> Point:
    """Return the closing direction of a suction cup: the one nearest to y."""
    direction, other = _find_perpendicular(approach)
    return other if math.fabs(other[1]) > math.fabs(direction[1]) else direction
