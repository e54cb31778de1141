"""Shapes of bodies: boxes, upright cylinders and meshes, in the body's frame.

The origin of this frame is the centre of the body's bottom, z points up.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

from skillplan.task.pose import Point, Pose, dot

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

# Rounding error of points on the rim of a shape [m].
_RIM_M = 1e-9


@dataclass(frozen=True, slots=True)
class Box:
    """A box of a body.

    Parameters
    ----------
    size
        Extents along x, y and z [m], each > 0.
    centre
        Centre in the body's frame [m].
    """

    size: Point
    centre: Point

    def __post_init__(self) -> None:
        if not all(math.isfinite(value) and value > 0 for value in self.size):
            raise ValueError(f"Box extents must be > 0, not {self.size}.")

    @property
    def box(self) -> Box:
        """The bounding box."""
        return self

    @property
    def core(self) -> Box:
        """An inscribed upright box."""
        return self

    def top_m(self, x_m: float, y_m: float) -> float | None:
        """Return the height of the top above a point of the plan [m]; None outside."""
        inside = (
            abs(x_m - self.centre[0]) <= self.size[0] / 2 + _RIM_M
            and abs(y_m - self.centre[1]) <= self.size[1] / 2 + _RIM_M
        )
        return self.centre[2] + self.size[2] / 2 if inside else None

    def reach_m(self, direction: Point) -> float:
        """Return the extent along a direction from the body's origin [m]."""
        half = sum(abs(d) * extent / 2 for d, extent in zip(direction, self.size, strict=True))
        return dot(direction, self.centre) + half


@dataclass(frozen=True, slots=True)
class Cylinder:
    """An upright cylinder of a body.

    Parameters
    ----------
    diameter_m, height_m
        Diameter and height [m], > 0.
    centre
        Centre in the body's frame [m].
    """

    diameter_m: float
    height_m: float
    centre: Point

    def __post_init__(self) -> None:
        for name in ("diameter_m", "height_m"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"Cylinder {name} must be > 0, not {value}.")

    @property
    def box(self) -> Box:
        """The bounding box."""
        return Box((self.diameter_m, self.diameter_m, self.height_m), self.centre)

    @property
    def core(self) -> Box:
        """The largest inscribed upright box with a square base."""
        side_m = self.diameter_m / math.sqrt(2)
        return Box((side_m, side_m, self.height_m), self.centre)

    def top_m(self, x_m: float, y_m: float) -> float | None:
        """Return the height of the top above a point of the plan [m]; None outside."""
        distance_m = math.hypot(x_m - self.centre[0], y_m - self.centre[1])
        inside = distance_m <= self.diameter_m / 2 + _RIM_M
        return self.centre[2] + self.height_m / 2 if inside else None

    def reach_m(self, direction: Point) -> float:
        """Return the extent along a direction from the body's origin [m]."""
        x, y, z = direction
        away_m = self.diameter_m / 2 * math.hypot(x, y) + self.height_m / 2 * abs(z)
        return dot(direction, self.centre) + away_m


@dataclass(frozen=True)
class Mesh:
    """A polyhedron of a body, given by its corners; measures are kept, as meshes may be large.

    Parameters
    ----------
    corners
        At least four points in the body's frame [m], not in one plane.
    faces
        Triangles of its surface, by three indices of corners each, anticlockwise from outside.
    convex
        True if the mesh is convex, so that its corners define it.
    """

    corners: tuple[Point, ...]
    faces: tuple[tuple[int, int, int], ...]
    convex: bool = True
    _reaches_m: dict[Point, float] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        if len(self.corners) < 4:
            raise ValueError(f"Mesh needs at least 4 corners, not {len(self.corners)}.")
        if not all(0 <= index < len(self.corners) for face in self.faces for index in face):
            raise ValueError(f"Mesh faces must name corners 0 to {len(self.corners) - 1}.")
        if not all(math.isfinite(value) for corner in self.corners for value in corner):
            raise ValueError("Mesh corners must be finite.")
        if not all(high > low for low, high in zip(*self._bounds, strict=True)):
            raise ValueError("Mesh must have an extent along every axis.")

    @cached_property
    def box(self) -> Box:
        """The bounding box."""
        (x0, y0, z0), (x1, y1, z1) = self._bounds
        return Box((x1 - x0, y1 - y0, z1 - z0), ((x0 + x1) / 2, (y0 + y1) / 2, (z0 + z1) / 2))

    @property
    def core(self) -> Box:
        """An inscribed upright box about the mean of the corners, with the proportions of `box`."""
        count = len(self.corners)
        x, y, z = (math.fsum(values) / count for values in zip(*self.corners, strict=True))
        size = self.box.size
        share = 1.0
        for normal, offset in self._planes():
            spread = sum(abs(n) * extent / 2 for n, extent in zip(normal, size, strict=True))
            room = offset - (normal[0] * x + normal[1] * y + normal[2] * z)
            share = min(share, room / spread)
        # A mesh that is not closed or convex may have none; then the box is tiny.
        share = max(share, 1e-9)
        return Box((size[0] * share, size[1] * share, size[2] * share), (x, y, z))

    def top_m(self, x_m: float, y_m: float) -> float | None:
        """Return the height of the top above a point of the plan [m]; None outside."""
        tops_m = []
        for face in self.faces:
            (ax, ay, az), (bx, by, bz), (cx, cy, cz) = (self.corners[index] for index in face)
            area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
            if area <= 0:
                # A face of the underside, or a wall.
                continue
            b = ((x_m - ax) * (cy - ay) - (cx - ax) * (y_m - ay)) / area
            c = ((bx - ax) * (y_m - ay) - (x_m - ax) * (by - ay)) / area
            if min(b, c, 1 - b - c) >= -1e-9:
                tops_m.append(az + b * (bz - az) + c * (cz - az))
        return max(tops_m, default=None)

    def reach_m(self, direction: Point) -> float:
        """Return the extent along a direction from the body's origin [m]."""
        if direction not in self._reaches_m:
            a, b, c = direction
            self._reaches_m[direction] = max(a * x + b * y + c * z for x, y, z in self.corners)
        return self._reaches_m[direction]

    @cached_property
    def triangles(self) -> Floats:
        """Corners of the faces [m], shape (faces, 3, 3)."""
        # Boards of boxes do without numpy.
        import numpy as np

        faces = np.array(self.faces, dtype=np.int64).reshape(-1, 3)
        return np.asarray(np.array(self.corners)[faces])

    def _planes(self) -> Iterator[tuple[Point, float]]:
        """Yield the outward normal of each face, and its distance from the origin."""
        for face in self.faces:
            a, b, c = (self.corners[index] for index in face)
            u = [p - q for p, q in zip(b, a, strict=True)]
            v = [p - q for p, q in zip(c, a, strict=True)]
            normal = (
                u[1] * v[2] - u[2] * v[1],
                u[2] * v[0] - u[0] * v[2],
                u[0] * v[1] - u[1] * v[0],
            )
            length = math.sqrt(sum(value * value for value in normal))
            if length > 0:
                x, y, z = (value / length for value in normal)
                yield (x, y, z), x * a[0] + y * a[1] + z * a[2]

    @cached_property
    def _bounds(self) -> tuple[Point, Point]:
        xs, ys, zs = zip(*self.corners, strict=True)
        return (min(xs), min(ys), min(zs)), (max(xs), max(ys), max(zs))


Shape = Box | Cylinder | Mesh

# Corners of the circle of a cylinder that lies.
_ROUND = 64
_AXIS = 1 - 1e-9


def move_shape(shape: Shape, pose: Pose) -> Shape:
    """Return a shape in the parent frame of its own.

    A box that is not turned by quarters becomes a mesh, and so does a cylinder that does not stand:
    its circles become polygons with 64 corners on them.
    """
    if isinstance(shape, Mesh):
        corners = tuple(pose.apply(corner) for corner in shape.corners)
        return Mesh(corners, shape.faces, shape.convex)
    centre = pose.apply(shape.centre)
    rows = pose.rotation
    if isinstance(shape, Cylinder):
        if abs(rows[2][2]) >= _AXIS:
            return Cylinder(shape.diameter_m, shape.height_m, centre)
        turns = [2 * math.pi * number / _ROUND for number in range(_ROUND)]
        radius_m = shape.diameter_m / 2
        outline = [(radius_m * math.cos(turn), radius_m * math.sin(turn)) for turn in turns]
        half_m = shape.height_m / 2
        return _make_prism(outline, -half_m, half_m, pose.then(Pose(shape.centre)))
    if all(max(map(abs, row)) >= _AXIS for row in rows):
        x, y, z = (sum(abs(r) * e for r, e in zip(row, shape.size, strict=True)) for row in rows)
        return Box((x, y, z), centre)
    x, y, z = (extent / 2 for extent in shape.size)
    return _make_prism([(x, y), (-x, y), (-x, -y), (x, -y)], -z, z, pose.then(Pose(shape.centre)))


def list_prism_faces(count: int) -> list[tuple[int, int, int]]:
    """Return the triangles of a prism: two for each side, then the bottom, then the top.

    Parameters
    ----------
    count
        Number of sides, >= 3. Corners are those of the bottom anticlockwise, then of the top.
    """
    faces = []
    for first in range(count):
        second = (first + 1) % count
        faces += [(first, second, count + second), (first, count + second, count + first)]
    faces += [(0, number + 1, number) for number in range(1, count - 1)]
    return faces + [(count, count + number, count + number + 1) for number in range(1, count - 1)]


def _make_prism(
    outline: Sequence[tuple[float, float]], low_m: float, high_m: float, pose: Pose
) -> Mesh:
    """Return an upright convex prism as a mesh in the parent frame.

    Parameters
    ----------
    outline
        Corners anticlockwise [m].
    """
    corners = [pose.apply((x_m, y_m, z_m)) for z_m in (low_m, high_m) for x_m, y_m in outline]
    return Mesh(tuple(corners), tuple(list_prism_faces(len(outline))))


def make_ring(
    inner_m: float, outer_m: float, low_m: float, high_m: float, sides: int
) -> tuple[Mesh, ...]:
    """Return the convex pieces of an upright ring about the origin.

    Parameters
    ----------
    inner_m, outer_m
        Distances of its inner and outer corners from the axis [m], 0 < inner < outer.
    low_m, high_m
        Heights of its bottom and top [m].
    sides
        Number of pieces, >= 3.
    """
    turns = [2 * math.pi * side / sides for side in range(sides + 1)]
    return tuple(
        _make_prism(
            [
                (radius_m * math.cos(turn), radius_m * math.sin(turn))
                for radius_m, turn in (
                    (inner_m, begin),
                    (outer_m, begin),
                    (outer_m, end),
                    (inner_m, end),
                )
            ],
            low_m,
            high_m,
            Pose((0.0, 0.0, 0.0)),
        )
        for begin, end in pairwise(turns)
    )
