"""Closed triangulated surfaces in the world: gaps, contact areas and penetration depths."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from skillplan.collision.solid import Polygon, area, clip_below, intersect
from skillplan.task.pose import Pose
from skillplan.task.shape import Box, Cylinder, Mesh, Shape, list_prism_faces

if TYPE_CHECKING:
    import shapely

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

# Number of sides of the prism about an inclined cylinder. The prism stands out by at most 0.03 % of
# the radius, and not at the lowest line.
_SIDES = 128
# Greatest vertical component of the normal of a wall.
_UPRIGHT = 1e-6
_CORNERS = np.array([(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], dtype=float) / 2
_BOX_FACES = np.array(
    [
        (0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4),
        (2, 6, 7), (2, 7, 3), (0, 4, 6), (0, 6, 2), (1, 3, 7), (1, 7, 5),
    ]
)  # fmt: skip


def cross_rows(first: Floats, second: Floats) -> Floats:
    """Return the cross product of each row with that of another array; faster than numpy's."""
    (a, b, c), (x, y, z) = first.T, second.T
    return np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=1)


@dataclass(frozen=True, eq=False)
class Polyhedron:
    """A closed surface of triangles.

    Parameters
    ----------
    corners
        Corners in the world [m], shape (corners, 3).
    faces
        Three indices of corners each, anticlockwise from outside, shape (faces, 3).
    flat
        True for faces of planes, False for faces of curved surfaces, shape (faces,).
    """

    corners: Floats
    faces: Indices
    flat: npt.NDArray[np.bool_]
    convex: bool = True
    _narrower: dict[float, Polyhedron] = field(default_factory=dict, init=False, repr=False)

    @cached_property
    def triangles(self) -> Floats:
        """Corners of the faces [m], shape (faces, 3, 3)."""
        return np.asarray(self.corners[self.faces])

    @cached_property
    def normals(self) -> Floats:
        """Outward unit normals of the faces, shape (faces, 3); zero for faces without area."""
        a, b, c = (self.triangles[:, i] for i in range(3))
        normals = cross_rows(b - a, c - a)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        return np.asarray(normals / np.where(lengths > 0, lengths, 1.0))

    @cached_property
    def upper(self) -> npt.NDArray[np.intp]:
        """Indices of the faces that look up."""
        return np.flatnonzero(self.normals[:, 2] > _UPRIGHT)

    @cached_property
    def lower(self) -> npt.NDArray[np.intp]:
        """Indices of the faces that look down."""
        return np.flatnonzero(self.normals[:, 2] < -_UPRIGHT)

    @cached_property
    def planes(self) -> tuple[Floats, Floats]:
        """Distinct outward normals of the faces, and offsets of their planes [m]."""
        sound = np.abs(self.normals).max(axis=1) > 0
        normals = self.normals[sound]
        offsets = np.einsum("ij,ij->i", normals, self.triangles[sound, 0])
        known = np.round(np.column_stack([normals, offsets]), 9)
        _, first = np.unique(known, axis=0, return_index=True)
        return np.asarray(normals[first]), np.asarray(offsets[first])

    @cached_property
    def feet(self) -> _FlatFaces:
        """Flat faces that look down."""
        return _FlatFaces.select(self, self.lower)

    @cached_property
    def tops(self) -> _FlatFaces:
        """Flat faces that look up."""
        return _FlatFaces.select(self, self.upper)

    def edges_of(self, faces: npt.NDArray[np.intp]) -> Floats:
        """Return the ends of the distinct edges of faces [m], shape (edges, 2, 3)."""
        chosen = self.faces[faces]
        pairs = np.concatenate([chosen[:, [0, 1]], chosen[:, [1, 2]], chosen[:, [2, 0]]])
        # np.unique is far faster for numbers than for rows.
        count = len(self.corners)
        numbers = np.unique(pairs.min(axis=1) * count + pairs.max(axis=1))
        return np.asarray(self.corners[np.stack(np.divmod(numbers, count), axis=1)])

    @cached_property
    def edges(self) -> Floats:
        """Ends of the edges between faces of different planes [m], shape (edges, 2, 3)."""
        sides = np.concatenate(
            [self.faces[:, [0, 1]], self.faces[:, [1, 2]], self.faces[:, [2, 0]]]
        )
        owners = np.tile(np.arange(len(self.faces)), 3)
        pairs, index = np.unique(np.sort(sides, axis=1), axis=0, return_inverse=True)
        total = np.zeros((len(pairs), 3))
        np.add.at(total, index.reshape(-1), self.normals[owners])
        # The normals of two coplanar faces add up to length 2.
        return np.asarray(self.corners[pairs[np.linalg.norm(total, axis=1) < 2 - 1e-12]])

    def narrowed(self, by_m: float) -> Polyhedron:
        """Return the surface with all walls and slopes shifted inwards in plan by a length [m].

        To first order at corners with more than three faces.
        """
        if by_m not in self._narrower:
            self._narrower[by_m] = self._narrow(by_m)
        return self._narrower[by_m]

    def _narrow(self, by_m: float) -> Polyhedron:
        flat = self.normals[:, :2]
        lengths = np.linalg.norm(flat, axis=1)
        walls = lengths > _UPRIGHT
        across = flat[walls] / lengths[walls, None]
        count = len(self.corners)
        matrix, vector = np.zeros((count, 2, 2)), np.zeros((count, 2))
        for i in range(3):
            np.add.at(matrix, self.faces[walls, i], across[:, :, None] * across[:, None, :])
            np.add.at(vector, self.faces[walls, i], across)
        shift = -by_m * np.einsum("ijk,ik->ij", np.linalg.pinv(matrix, rcond=1e-6), vector)
        length = np.linalg.norm(shift, axis=1, keepdims=True)
        shift *= np.minimum(1.0, 4 * by_m / np.maximum(length, by_m))
        moved = self.corners.copy()
        moved[:, :2] += shift
        return Polyhedron(moved, self.faces, self.flat, self.convex)


@dataclass(frozen=True, slots=True, eq=False)
class _FlatFaces:
    """Triangles of planes, with their boxes and unit normals [m]."""

    triangles: Floats
    lows: Floats
    highs: Floats
    normals: Floats

    @classmethod
    def select(cls, surface: Polyhedron, faces: npt.NDArray[np.intp]) -> _FlatFaces:
        """Return some faces of a surface, without those of curved surfaces."""
        flat = faces[surface.flat[faces]]
        triangles = surface.triangles[flat]
        return cls(triangles, triangles.min(axis=1), triangles.max(axis=1), surface.normals[flat])

    def near(self, other: _FlatFaces, tolerance_m: float) -> _FlatFaces:
        """Return the faces within a distance of the box about other faces."""
        least, most = np.inf, -np.inf
        low, high = other.lows.min(axis=0, initial=least), other.highs.max(axis=0, initial=most)
        near = (self.lows <= high + tolerance_m) & (self.highs >= low - tolerance_m)
        kept = near.all(axis=1)
        return _FlatFaces(
            self.triangles[kept], self.lows[kept], self.highs[kept], self.normals[kept]
        )


def make_polyhedron(shape: Shape, pose: Pose) -> Polyhedron:
    """Return the surface of a shape at a pose."""
    rotation = np.array(pose.rotation)
    if isinstance(shape, Box):
        corners, faces = _CORNERS * np.array(shape.size) + np.array(shape.centre), _BOX_FACES
        flat = np.ones(len(faces), dtype=bool)
    elif isinstance(shape, Cylinder):
        corners, faces, flat = _make_prism(shape, rotation[2])
    else:
        corners, faces = np.array(shape.corners, dtype=float), np.array(shape.faces)
        flat = np.ones(len(faces), dtype=bool)
    convex = not isinstance(shape, Mesh) or shape.convex
    return Polyhedron(corners @ rotation.T + np.array(pose.position), faces, flat, convex)


def _make_prism(cylinder: Cylinder, up: Floats) -> tuple[Floats, Indices, npt.NDArray[np.bool_]]:
    """Return the prism about a cylinder with the middle of a side at its lowest line."""
    step = 2 * math.pi / _SIDES
    angles = math.atan2(up[1], up[0]) + step * (np.arange(_SIDES) + 0.5)
    radius_m = cylinder.diameter_m / 2 / math.cos(step / 2)
    ring = np.column_stack([np.cos(angles), np.sin(angles)]) * radius_m
    half_m = cylinder.height_m / 2
    corners = np.concatenate(
        [
            np.column_stack([ring, np.full(_SIDES, -half_m)]),
            np.column_stack([ring, np.full(_SIDES, half_m)]),
        ]
    ) + np.array(cylinder.centre)
    faces = np.array(list_prism_faces(_SIDES))
    return corners, faces, np.arange(len(faces)) >= 2 * _SIDES


# Precision of the deepest point of an edge, and least depth worth a search [m].
_PRECISION_M = 5e-5
_LEAST_M = 2e-4
# Greatest number of pairs of points and faces in one array, which fits the cache of a core.
_PAIRS = 30_000
# Number of points that are compared with many faces at once.
_FEW = 4
# Distances from a surface within which points only count if none is farther outside [m].
_NEAR_SURFACE_M = 1e-4, 1e-5, 1e-6, 1e-8
# Rotation that is along no axis and no usual slope.
_SKEW = np.linalg.qr(np.array([[1.0, 0.37, 0.23], [-0.41, 1.0, 0.31], [-0.19, -0.43, 1.0]]))[0]
# Share of faces that are left below which constants of them are kept.
_FEWER = 0.85
_NM = 1e-9
# Numbers of the next corners of a triangle, and of those before.
_NEXT, _LAST = [1, 2, 0], [2, 0, 1]


def measure_depths(surface: Polyhedron, points: Floats) -> Floats:
    """Return the depths of points in a surface [m]; negative outside."""
    faces = _Faces(surface.triangles, surface.corners.mean(axis=0))
    distances = faces.distances(points)
    return np.where(faces.inside(points), distances, -distances)


def measure_outermost(surface: Polyhedron, points: Floats) -> float:
    """Return the distance of the outermost point from a surface [m]; 0 if all are inside.

    Most points are near the surface, and only count if none is farther outside.
    """
    faces = _Faces(surface.triangles, surface.corners.mean(axis=0))
    for within_m in _NEAR_SURFACE_M:
        is_near = faces.find_along(points, points, within_m)
        farther = points[~is_near]
        outside = farther[~faces.inside(farther)]
        if len(outside):
            return float(faces.distances(outside).max())
        points = points[is_near]
    return 0.0


def measure_deepest(surface: Polyhedron, edges: Floats) -> float:
    """Return the greatest depth of edges in a surface [m]; 0 if all are outside.

    A triangle is convex, so no point of an edge is farther from it than the farther end. The depth
    changes by at most the distance along the edge. Halves that cannot be deeper are dropped.
    """
    faces = _Faces(surface.triangles, surface.corners.mean(axis=0))
    low, high = surface.corners.min(axis=0), surface.corners.max(axis=0)
    begins, ends = _clip_edges(edges, low, high)
    # Depths of the middles of the edges that these are halves of; the first have none.
    wholes = np.zeros(len(begins))
    deepest = 0.0
    while len(begins):
        worth = ~faces.find_along(begins, ends, max(deepest + _PRECISION_M, _LEAST_M))
        begins, ends, wholes = begins[worth], ends[worth], wholes[worth]
        if not len(begins):
            break
        middles, halves = (begins + ends) / 2, np.linalg.norm(ends - begins, axis=1) / 2
        distances = faces.distances(middles)
        # No face is nearer to the middle of the whole edge, so both middles are on its side.
        known = np.abs(wholes) > halves
        is_inside = wholes > 0
        is_inside[~known] = faces.inside(middles[~known])
        depth = np.where(is_inside, distances, -distances)
        deepest = max(deepest, float(depth.max()))
        worth = depth + halves > max(deepest + _PRECISION_M, _LEAST_M)
        begins, middles, ends = begins[worth], middles[worth], ends[worth]
        wholes = np.tile(depth[worth], 2)
        begins, ends = np.concatenate([begins, middles]), np.concatenate([middles, ends])
    return max(0.0, deepest)


def _clip_edges(edges: Floats, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Return the parts of edges that are in an upright box."""
    begins, way = edges[:, 0], edges[:, 1] - edges[:, 0]
    slope = np.where(np.abs(way) < 1e-15, 1e-15, way)
    at_low, at_high = (low - begins) / slope, (high - begins) / slope
    enter = np.clip(np.minimum(at_low, at_high).max(axis=1), 0, 1)[:, None]
    leave = np.clip(np.maximum(at_low, at_high).min(axis=1), 0, 1)[:, None]
    inside = (enter < leave)[:, 0]
    return (begins + enter * way)[inside], (begins + leave * way)[inside]


class _Faces:
    """Triangles of a surface with constants for distances to many points.

    Every distance is a sum of products of a point's coordinates and constants of a face, so one
    matrix
    product yields all pairs. Relative to the middle of the surface, rounding stays below a
    nanometre.
    """

    def __init__(self, triangles: Floats, middle: Floats) -> None:
        self._triangles, self._middle = triangles, middle
        corners = triangles - middle
        a, b, c = (corners[:, i] for i in range(3))
        normal = cross_rows(b - a, c - a)
        area = np.einsum("ij,ij->i", normal, normal)
        self._corners = (a, b, c)
        self._squares = tuple(np.einsum("ij,ij->i", corner, corner) for corner in (a, b, c))
        self._normal, self._height = normal.T, np.einsum("ij,ij->i", a, normal)
        self._sound, self._per_area = area > 1e-30, 1 / np.maximum(area, 1e-30)
        self._sides = [_Side(begin, end - begin, normal) for begin, end in ((a, b), (b, c), (c, a))]
        self._chunk = max(1, _PAIRS // max(1, len(corners)))

    def distances(self, points: Floats) -> Floats:
        """Return the distances of points from the nearest face [m]."""
        squares = np.empty(len(points))
        for some, faces in self._split(points):
            squares[some] = faces._squares_from(points[some]).min(axis=1)
        return np.asarray(np.sqrt(np.maximum(squares, 0.0)))

    def find_along(self, begins: Floats, ends: Floats, within_m: float) -> npt.NDArray[np.bool_]:
        """Return True for edges with both ends within a distance [m] of one face."""
        tree, lows, highs = self._boxes
        is_along = np.zeros(len(begins), dtype=bool)
        reach_m = np.array([[-within_m], [within_m]])
        for which, face in _query_in_plan(begins[:, None] + reach_m, tree):
            low, high = lows[face] - within_m, highs[face] + within_m
            begin, end = begins[which], ends[which]
            near = (begin >= low) & (begin <= high) & (end >= low) & (end <= high)
            near = near.all(axis=1) & ~is_along[which]
            which, faces = which[near], _Faces(self._triangles[face[near]], self._middle)
            squares = [faces._squares_from(end[which], is_paired=True) for end in (begins, ends)]
            is_along[which[np.maximum(*squares) <= within_m**2]] = True
        return is_along

    @cached_property
    def _boxes(self) -> tuple[shapely.STRtree, Floats, Floats]:
        """Tree of the boxes of faces in plan, and their lowest and highest corners [m]."""
        triangles = self._triangles
        return _build_tree(triangles), triangles.min(axis=1), triangles.max(axis=1)

    def _split(self, points: Floats) -> Iterator[tuple[Indices, _Faces]]:
        """Yield numbers of points that are near each other, and the faces that may be nearest."""
        waiting = [(np.arange(len(points)), self)]
        while waiting:
            group, faces = waiting.pop()
            if len(group) <= max(faces._chunk, _FEW):
                yield group, faces
                continue
            centre = points[group].mean(axis=0)
            radius = float(np.linalg.norm(points[group] - centre, axis=1).max())
            away = np.sqrt(np.maximum(faces._squares_from(centre[None])[0], 0.0))
            near = away <= float(away.min()) + 2 * radius + _NM
            if near.sum() < _FEWER * len(near):
                faces = _Faces(faces._triangles[near], self._middle)
            axis = int(np.ptp(points[group], axis=0).argmax())
            order = np.argsort(points[group, axis], kind="stable")
            middle = len(group) // 2
            waiting += [(group[order[:middle]], faces), (group[order[middle:]], faces)]

    def inside(self, points: Floats) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Return True for points inside the surface, by their turns or the faces above them."""
        is_inside = np.zeros(len(points), dtype=bool)
        is_open = np.ones(len(points), dtype=bool)
        if len(points) * len(self._height) > _PAIRS:
            counts, is_open = self._count_above(points)
            is_inside = counts > 0
        rest = np.flatnonzero(is_open)
        for first in range(0, len(rest), self._chunk):
            some = rest[first : first + self._chunk]
            is_inside[some] = self._turns(points[some]) > 0.5
        return is_inside

    @cached_property
    def _skewed(self) -> tuple[Floats, shapely.STRtree]:
        """Turned triangles, shape (axes, corners, faces), and their boxes in plan.

        Few walls are upright then.
        """
        tops = (self._triangles - self._middle) @ _SKEW.T
        return np.ascontiguousarray(tops.T), _build_tree(tops)

    def _count_above(self, points: Floats) -> tuple[Indices, npt.NDArray[np.bool_]]:
        """Return by how many more upward than downward faces are above points, and the open points.

        A point is open if it is too near a face, or if its ray is too near an edge. Coordinates are
        turned, so few rays along walls and edges are.
        """
        tops, tree = self._skewed
        origins = (points - self._middle) @ _SKEW.T
        counts, is_open = np.zeros(len(points), dtype=np.int64), np.zeros(len(points), dtype=bool)
        slack = _ROUNDING * float(np.abs(tops).max()) ** 2
        highest = tops[2].max(axis=0) + _SLACK_M
        for which, face in _query_in_plan(origins[:, None], tree):
            is_above = highest[face] > origins[which, 2]
            which, face = which[is_above], face[is_above]
            x, y, z = tops.take(face, axis=2) - origins.T.take(which, axis=1)[:, None]
            # Areas of the triangles of the point with the sides of the face, in plan.
            areas = x * y[_NEXT] - y * x[_NEXT]
            turn = np.sign(areas)
            is_near = (np.abs(areas) <= slack).any(axis=0)
            is_met = np.abs(turn.sum(axis=0)) == 3
            met = areas[:, is_met]
            heights = (met * z[_LAST][:, is_met]).sum(axis=0) / met.sum(axis=0)
            is_near[is_met] |= np.abs(heights) <= _SLACK_M
            is_open[which[is_near]] = True
            crossed = np.flatnonzero(is_met)[heights > 0]
            np.add.at(counts, which[crossed], turn[0, crossed].astype(np.int64))
        return counts, is_open

    def _squares_from(self, points: Floats, *, is_paired: bool = False) -> Floats:
        """Return the squared distances of points from faces [m2], shape (points, faces).

        Parameters
        ----------
        is_paired
            True for the distance of each point from the face of its number alone.
        """
        points = points - self._middle
        own = np.einsum("ij,ij->i", points, points)
        if not is_paired:
            own = own[:, None]

        def multiply(constants: Floats) -> Floats:
            """Return the products of points and columns."""
            if is_paired:
                return np.asarray(np.einsum("ij,ji->i", points, constants))
            return np.asarray(points @ constants)

        flat = (multiply(self._normal) - self._height) ** 2 * self._per_area
        nearest = np.full(flat.shape, math.inf)
        within = np.broadcast_to(self._sound, flat.shape).copy()
        for side, begin, square in zip(self._sides, self._corners, self._squares, strict=True):
            within &= multiply(side.inwards) >= side.inner
            along = multiply(side.way) - side.begin
            share = np.clip(along * side.per_square, 0, 1)
            away = own - 2 * multiply(begin.T) + square
            np.minimum(nearest, away - share * (2 * along - share * side.square), out=nearest)
        return np.where(within, flat, nearest)

    def _turns(self, points: Floats) -> Floats:
        points = points - self._middle
        own = np.einsum("ij,ij->i", points, points)[:, None]
        to = [points @ corner.T for corner in self._corners]
        x, y, z = (
            np.sqrt(np.maximum(own - 2 * product + square, 0.0))
            for product, square in zip(to, self._squares, strict=True)
        )
        a, b, c = self._corners
        volume = self._height - points @ self._normal
        below = x * y * z
        for begin, end, rest, i, j in ((a, b, z, 0, 1), (b, c, x, 1, 2), (c, a, y, 2, 0)):
            below += (own - to[i] - to[j] + np.einsum("ij,ij->i", begin, end)) * rest
        return np.asarray(np.arctan2(volume, below).sum(axis=1) / (2 * math.pi))


class _Side:
    """Constants of one side of all triangles."""

    def __init__(self, begin: Floats, way: Floats, normal: Floats) -> None:
        inwards = cross_rows(normal, way)
        self.way, self.inwards = way.T, inwards.T
        self.begin = np.einsum("ij,ij->i", begin, way)
        self.inner = np.einsum("ij,ij->i", begin, inwards)
        self.square = np.einsum("ij,ij->i", way, way)
        self.per_square = 1 / np.maximum(self.square, 1e-30)


# Walls that overlap by less than this in the plane do not bear [m].
_GRAZING_M = 2e-4
# A height that changes by more than this multiple of the change of width is that of a wall.
_STEEPEST = 20.0
# Greatest ratio of height loss to width loss on a slope, if another edge is met first.
_GENTLE = 3.0
_ROUNDING, _ROUNDING_M = 1e-12, 1e-9
# Greatest number of pairs in one array, and slack of bounding boxes in plan [m].
_PAIRS_FALLING, _SLACK_M = 2_000_000, 1e-6


def measure_gap(upper: Polyhedron, lower: Polyhedron, at_least_m: float = -math.inf) -> float:
    """Return the least gap between `upper` and `lower` [m].

    This is the distance that `upper` may fall; a negative gap means that it has to rise. The
    surfaces are compared at all corners and all crossings of edges in plan, which is exact.
    Overlaps
    below 0.2 mm in plan do not count: the gap is computed for two narrowed surfaces and
    extrapolated to
    the full width.

    Parameters
    ----------
    at_least_m
        Smaller gaps are ignored: such faces are not below `upper`, but above it or inside.

    Returns
    -------
    float
        Infinity if `upper` is not above `lower`.
    """
    extent = upper.corners[:, :2].max(axis=0) - upper.corners[:, :2].min(axis=0)
    width_m = min(_GRAZING_M, float(extent.min()) / 4)
    at_full_width = _collect_heights(upper, lower)
    if not len(at_full_width):
        # Only the bounding boxes overlap in plan, so the narrowed surfaces do not overlap either.
        return math.inf
    narrow, wide, full = (
        float(heights[heights >= at_least_m].min(initial=math.inf))
        for heights in (
            _collect_heights(upper.narrowed(width_m), lower),
            _collect_heights(upper.narrowed(width_m / 2), lower),
            at_full_width,
        )
    )
    if math.isinf(narrow) or math.isinf(wide) or narrow - wide > _STEEPEST * width_m:
        return narrow
    # On a slope the gap changes in proportion to the width, at a wall it jumps.
    gentle = wide - full <= _GENTLE * abs(narrow - wide) + _ROUNDING_M
    return full if gentle else 2 * wide - narrow


def measure_narrowed_gap(upper: Polyhedron, lower: Polyhedron, by_m: float) -> float:
    """Return the least gap with the walls of `upper` shifted inwards by a length [m]."""
    return float(_collect_heights(upper.narrowed(by_m), lower).min(initial=math.inf))


def find_top(surface: Polyhedron, x_m: float, y_m: float) -> float | None:
    """Return the height of a surface at a point in plan [m]; None outside its outline."""
    point = np.array([[x_m, y_m, 0.0]])
    faces = _select_faces(surface, surface.upper, point)
    heights = [*_measure_over(point, surface.triangles[faces], surface.normals[faces])]
    tops = -np.concatenate(heights) if heights else np.empty(0)
    return float(tops.max()) if len(tops) else None


# Crossings of neighbouring faces at their common edge differ by less than this [m].
_SAME_CROSSING_M = 1e-9


def find_spans(
    surface: Polyhedron, start: tuple[float, float, float], direction: tuple[float, float, float]
) -> list[tuple[float, float]]:
    """Return the stretches of a line within a surface, as distances from its start [m].

    Parameters
    ----------
    direction
        Unit vector. Stretches before the start have negative distances.
    """
    begin, along = np.array(start), np.array(direction)
    first, second, third = (surface.triangles[:, corner] for corner in range(3))
    normals = cross_rows(second - first, third - first)
    steep = normals @ along
    faces = np.flatnonzero(np.abs(steep) > 1e-9 * np.linalg.norm(normals, axis=1))
    normals, steep = normals[faces], steep[faces]
    distances = np.einsum("ij,ij->i", normals, first[faces] - begin) / steep
    points = begin + distances[:, None] * along
    inside = np.ones(len(faces), dtype=bool)
    for corner, following in ((first, second), (second, third), (third, first)):
        turn = cross_rows(following[faces] - corner[faces], points - corner[faces])
        inside &= np.einsum("ij,ij->i", turn, normals) >= -1e-12 * np.abs(steep)
    spans: list[tuple[float, float]] = []
    depth, entered, last = 0, 0.0, (math.nan, False)
    for distance, leaves in sorted(
        zip(distances[inside].tolist(), (steep[inside] > 0).tolist(), strict=True)
    ):
        if leaves is last[1] and abs(distance - last[0]) < _SAME_CROSSING_M:
            continue
        last = (distance, leaves)
        if not leaves and depth == 0:
            entered = distance
        if leaves and depth == 1:
            spans.append((entered, distance))
        depth = max(0, depth + (-1 if leaves else 1))
    return spans


def _collect_heights(upper: Polyhedron, lower: Polyhedron) -> Floats:
    """Return gaps between `upper` and `lower`; empty if they do not overlap in plan."""
    return np.concatenate([np.empty(0), *_list_heights(upper, lower)])


def _list_heights(upper: Polyhedron, lower: Polyhedron) -> Iterator[Floats]:
    """Yield gaps at all points that may have the least one."""
    if not (len(upper.lower) and len(lower.upper)):
        return
    bottom = _select_faces(upper, upper.lower, lower.corners)
    top = _select_faces(lower, lower.upper, upper.corners)
    if not (len(bottom) and len(top)):
        return
    corners = upper.corners[np.unique(upper.faces[bottom])]
    yield from _measure_over(corners, lower.triangles[top], lower.normals[top])
    corners = lower.corners[np.unique(lower.faces[top])]
    for heights in _measure_over(corners, upper.triangles[bottom], upper.normals[bottom]):
        yield -heights
    yield from _measure_crossings(upper.edges_of(bottom), lower.edges_of(top))


def _select_faces(
    surface: Polyhedron, faces: npt.NDArray[np.intp], corners: Floats
) -> npt.NDArray[np.intp]:
    """Return the faces that may overlap the bounding box of corners in plan."""
    triangles = surface.triangles[faces][:, :, :2]
    low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
    meets = (triangles.min(axis=1) <= high) & (triangles.max(axis=1) >= low)
    return np.asarray(faces[meets.all(axis=1)])


def _measure_over(points: Floats, triangles: Floats, normals: Floats) -> Iterator[Floats]:
    """Yield heights of points above the triangles below or above them."""
    for which, face in _pair_in_plan(points[:, None], triangles):
        point, corners, normal = points[which], triangles[face], normals[face]
        inside = np.ones(len(which), dtype=bool)
        turn = np.sign(normal[:, 2])
        for i in range(3):
            a, b = corners[:, i], corners[:, (i + 1) % 3]
            side, beyond = b - a, point - a
            across = side[:, 0] * beyond[:, 1] - side[:, 1] * beyond[:, 0]
            inside &= across * turn >= -_ROUNDING * (1 + np.abs(side).sum(axis=1))
        away, normal = point[inside] - corners[inside, 0], normal[inside]
        yield np.einsum("ij,ij->i", away, normal) / normal[:, 2]


def _measure_crossings(upper: Floats, lower: Floats) -> Iterator[Floats]:
    """Yield height differences at crossings of edges in plan."""
    for i, j in _pair_in_plan(upper, lower):
        a, c = upper[i, 0], lower[j, 0]
        r, s = upper[i, 1] - a, lower[j, 1] - c
        between = c - a
        across = r[:, 0] * s[:, 1] - r[:, 1] * s[:, 0]
        t_times = between[:, 0] * s[:, 1] - between[:, 1] * s[:, 0]
        u_times = between[:, 0] * r[:, 1] - between[:, 1] * r[:, 0]
        sign = np.sign(across)
        reach = np.abs(across)
        meet = (t_times * sign >= 0) & (u_times * sign >= 0)
        meet &= (t_times * sign <= reach) & (u_times * sign <= reach) & (reach > 1e-18)
        t, u = t_times[meet] / across[meet], u_times[meet] / across[meet]
        yield (a[meet, 2] + t * r[meet, 2]) - (c[meet, 2] + u * s[meet, 2])


def _pair_in_plan(items: Floats, others: Floats) -> Iterator[tuple[Indices, Indices]]:
    """Yield the numbers of items and others whose bounding boxes overlap in plan.

    Parameters
    ----------
    items, others
        Points, edges or triangles by their corners [m], shape (items, corners, 3).
    """
    if len(items) and len(others):
        yield from _query_in_plan(items, _build_tree(others))


def _build_tree(triangles: Floats) -> shapely.STRtree:
    """Return a tree of the bounding boxes in plan of points, edges or triangles."""
    import shapely

    low, high = triangles[:, :, :2].min(axis=1), triangles[:, :, :2].max(axis=1)
    return shapely.STRtree(shapely.box(*(low - _SLACK_M).T, *(high + _SLACK_M).T))


def _query_in_plan(items: Floats, tree: shapely.STRtree) -> Iterator[tuple[Indices, Indices]]:
    """Yield the numbers of items and of boxes of a tree that overlap in plan."""
    import shapely

    low, high = items[:, :, :2].min(axis=1), items[:, :, :2].max(axis=1)
    chunk = max(1, _PAIRS_FALLING // len(tree))
    for first in range(0, len(items), chunk):
        some = slice(first, first + chunk)
        is_point = items.shape[1] == 1
        boxes = shapely.points(low[some]) if is_point else shapely.box(*low[some].T, *high[some].T)
        item, other = tree.query(boxes)
        yield first + item, other


# Least angle between faces that touch along a line at most [rad].
_PARALLEL = 1e-3


def find_contacts(upper: Polyhedron, lower: Polyhedron, tolerance_m: float) -> Iterator[Polygon]:
    """Yield the contact areas of flat faces, seen from above [m].

    Parameters
    ----------
    tolerance_m
        Gap or overlap that still counts as contact [m].
    """
    feet, tops = upper.feet.near(lower.tops, tolerance_m), lower.tops.near(upper.feet, tolerance_m)
    meets = (feet.lows[:, None] <= tops.highs + tolerance_m).all(axis=2)
    meets &= (feet.highs[:, None] >= tops.lows - tolerance_m).all(axis=2)
    meets &= feet.normals @ tops.normals.T < -1 + _PARALLEL**2 / 2
    above, beneath = feet.triangles, tops.triangles
    for i, j in zip(*np.nonzero(meets), strict=True):
        # Seen from above, the corners of a downward face are clockwise.
        common = intersect(_project(above[i][::-1]), _project(beneath[j]))
        common = _clip_near(common, above[i], beneath[j], tolerance_m)
        if len(common) > 2 and area(common) > 0:
            yield common


def _clip_near(common: Polygon, above: Floats, beneath: Floats, tolerance_m: float) -> Polygon:
    """Return the part of a polygon with two planes within the tolerance of each other."""
    (ax, ay, az), (bx, by, bz) = _find_slopes(above), _find_slopes(beneath)
    dx, dy, dz = ax - bx, ay - by, az - bz
    kept = clip_below(common, (dx, dy), tolerance_m - dz)
    return tuple(clip_below(kept, (-dx, -dy), tolerance_m + dz))


def _find_slopes(triangle: Floats) -> tuple[float, float, float]:
    """Return slopes of a plane along x and y, and its height at the origin."""
    a, b, c = triangle.tolist()
    u_x, u_y, u_z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    v_x, v_y, v_z = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    # np.cross takes 50 times as long for one pair of vectors.
    height = u_x * v_y - u_y * v_x
    x, y = -(u_y * v_z - u_z * v_y) / height, -(u_z * v_x - u_x * v_z) / height
    return x, y, a[2] - x * a[0] - y * a[1]


def _project(triangle: Floats) -> Polygon:
    return tuple((float(x), float(y)) for x, y, _ in triangle)


# Iterations of the golden-section search for the deepest point of an edge.
_HALVINGS = 40
_GOLDEN = (5**0.5 - 1) / 2
# Greatest number of pairs of points and planes in one array.
_PAIRS_PENETRATION = 1_000_000


def measure_depth_m(surface: Polyhedron, other: Polyhedron) -> float:
    """Return the greatest depth of an edge of either surface in the other [m]; 0 if disjoint.

    Polyhedra with a common volume have an edge of one in the other. The depth is the distance to
    the
    nearest face, found to 0.05 mm in concave surfaces.
    """
    return max(_measure_deepest(surface, other), _measure_deepest(other, surface))


def _measure_deepest(edges_of: Polyhedron, within: Polyhedron) -> float:
    edges = edges_of.edges
    low, high = within.corners.min(axis=0), within.corners.max(axis=0)
    near = (edges.min(axis=1) < high) & (edges.max(axis=1) > low)
    edges = edges[near.all(axis=1)]
    if not len(edges):
        return 0.0
    if not within.convex:
        return measure_deepest(within, edges)
    normals, offsets = within.planes
    deepest = 0.0
    chunk = max(1, _PAIRS_PENETRATION // len(normals))
    for first in range(0, len(edges), chunk):
        begins, ends = edges[first : first + chunk, 0], edges[first : first + chunk, 1]
        # Depths of the ends below every plane; they are linear in between.
        a, b = offsets - begins @ normals.T, offsets - ends @ normals.T
        inside = (np.maximum(a, b) > deepest).all(axis=1)
        if inside.any():
            deepest = max(deepest, _find_highest_minimum(a[inside], b[inside]))
    return deepest


def _find_highest_minimum(a: Floats, b: Floats) -> float:
    """Return the greatest minimum of linear functions on [0, 1].

    Parameters
    ----------
    a, b
        Values at 0 and at 1, one row for each set of functions; the search is by golden section.
    """
    low, high = np.zeros(len(a)), np.ones(len(a))

    def lowest(share: Floats) -> Floats:
        return np.asarray((a + (b - a) * share[:, None]).min(axis=1))

    best = np.maximum(lowest(low), lowest(high))
    for _ in range(_HALVINGS):
        left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        at_left, at_right = lowest(left), lowest(right)
        best = np.maximum(best, np.maximum(at_left, at_right))
        rises = at_left < at_right
        low, high = np.where(rises, left, low), np.where(rises, high, right)
    return float(best.max())
