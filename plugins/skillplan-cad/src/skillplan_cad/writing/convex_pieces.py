"""Convex pieces of a solid: it is cut where its hull stands out of it most, again and again.

Every piece is the hull of what a cut leaves, so that pieces enclose their solid whatever happens;
how far they stand out of it is what cuts make smaller.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count

import manifold3d
import numpy as np
from numpy.typing import NDArray

from skillplan_cad.product import Points, Triangles

Pieces = tuple[tuple[Points, Triangles], ...]
Floats = NDArray[np.float64]
Normal = tuple[float, float, float]

MOST_PIECES = 160
_TO_MM = 1e3
# Of the surfaces that bound what a hull adds, so many are tried as cuts.
_MOST_PLANES = 8
_LEAST_MM = 1e-3
# Of millimetres, as many as files of meshes have of metres less three.
_DECIMALS = 4
_LEAST_MM3 = 1e-6
# Cuts are so far inside of gaps: on a face, rounding would leave a sheet of it.
_SHEET_MM = 2e-4
# Thinner is what rounding leaves between a body and its hull.
_FILM_MM = 1e-3
# Where the best cut leaves more than this share of what a hull adds, gaps are halved.
_WORTH = 0.6
_LEAST_SHARE = 1e-3
# Of three coordinates from -1000 to 1000.
_PLACES = np.array([10**8, 10**4, 1])
# Of the corners of a gap so many lie on the wall of a round hollow, if it is the hollow's.
_ON_WALL = 0.3
# Corners whose middle is so near to the axis, of the radius, are all round it.
_ROUND = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Hollow:
    """A round hollow of a solid.

    Parameters
    ----------
    point_m
        Any point of its axis.
    axis
        Unit vector.
    radius_m
        Of its wall, where it has one radius; a cone has none that helps.
    """

    point_m: Floats
    axis: Floats
    radius_m: float


def convex_pieces(
    vertices_m: Points,
    triangles: Triangles,
    allowed_m: float,
    hollows: Sequence[Hollow] = (),
    most: int = MOST_PIECES,
) -> Pieces:
    """Return convex pieces that enclose a solid, or nothing where there are none.

    Parameters
    ----------
    vertices_m, triangles
        Its closed mesh.
    allowed_m
        How far a piece may stand out of it; a gap between two faces counts as far as it is wide.
    hollows
        Its round ones: cuts through their axes make the fewest pieces.
    most
        Number of pieces at which no more cuts are made.
    """
    whole = _solid(vertices_m, triangles)
    if whole.is_empty():
        return ()
    waiting: list[tuple[float, int, manifold3d.Manifold, manifold3d.Manifold]] = []
    done: list[manifold3d.Manifold] = []
    numbers = count()

    def add(solid: manifold3d.Manifold) -> None:
        for body in solid.decompose():
            if body.volume() < _LEAST_MM3:
                continue
            hull = body.hull()
            gap_mm, gap = _widest_gap(hull - body)
            if gap_mm <= allowed_m * _TO_MM:
                done.append(hull)
            else:
                heapq.heappush(waiting, (-gap_mm, next(numbers), body, gap))

    add(whole)
    while waiting and len(done) + len(waiting) < most:
        _, _, body, gap = heapq.heappop(waiting)
        halves = _cut(body, gap, hollows)
        if halves is None:
            done.append(body.hull())
            continue
        for half in halves:
            add(half)
    done += [body.hull() for _, _, body, _ in waiting]
    return tuple(piece for piece in map(_mesh, done) if piece is not None)


def _solid(vertices_m: Points, triangles: Triangles) -> manifold3d.Manifold:
    mesh = manifold3d.Mesh64(
        vert_properties=np.ascontiguousarray(vertices_m * _TO_MM),
        tri_verts=np.ascontiguousarray(triangles, dtype=np.uint64),
    )
    return manifold3d.Manifold(mesh)


def _mesh(hull: manifold3d.Manifold) -> tuple[Points, Triangles] | None:
    """Return a hull with corners as a file has them, or None for what rounding flattens."""
    made = hull.to_mesh64()
    points = np.asarray(made.vert_properties, dtype=np.float64)[:, :3]
    rounded = np.unique(np.round(points, _DECIMALS), axis=0)
    again = manifold3d.Manifold.hull_points(rounded)
    if again.is_empty() or again.volume() < _LEAST_MM3:
        return None
    made = again.to_mesh64()
    points = np.asarray(made.vert_properties, dtype=np.float64)[:, :3] / _TO_MM
    return points, np.asarray(made.tri_verts, dtype=np.int64)


def _faces(solid: manifold3d.Manifold) -> tuple[Points, Points, Floats, Floats]:
    """Return a solid's points, and its triangles' corners, unit normals and areas [mm, mm²]."""
    made = solid.to_mesh64()
    points = np.asarray(made.vert_properties, dtype=np.float64)[:, :3]
    corners = points[np.asarray(made.tri_verts, dtype=np.int64)]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(across, axis=1)
    return points, corners, across / np.maximum(lengths, 1e-30)[:, None], lengths / 2


def _widest_gap(added: manifold3d.Manifold) -> tuple[float, manifold3d.Manifold]:
    """Return how wide what a hull adds is at most, square to its surfaces, and where."""
    widest, where = 0.0, added
    for gap in added.decompose():
        points, _, normals, areas = _faces(gap)
        if 2 * gap.volume() < _FILM_MM * float(areas.sum()):
            continue
        large = normals[areas > 1e-3 * areas.max()]
        # A number each, in the order of the rows: far quicker to tell apart than rows.
        numbers = np.round(large * 1000).astype(np.int64) @ _PLACES
        _, first = np.unique(numbers, return_index=True)
        heights = points @ large[first].T
        width = float(np.ptp(heights, axis=0).min())
        if width > widest:
            widest, where = width, gap
    return widest, where


def _cut(
    body: manifold3d.Manifold, gap: manifold3d.Manifold, hollows: Sequence[Hollow]
) -> tuple[manifold3d.Manifold, manifold3d.Manifold] | None:
    """Return a body in two, so that the gap is gone or halved; None where no cut is possible."""
    points, corners, normals, areas = _faces(gap)
    points = np.unique(points, axis=0)
    wall = _wall(points, hollows)
    if wall is not None and wall.is_all:
        for normal, offset in wall.planes():
            halves = _split(body, normal, offset)
            if halves is not None:
                return halves
    wholes = body.hull().volume() - body.volume()
    planes = _largest_planes(corners, normals, areas)
    ends = [(axis, (points @ axis).min(), (points @ axis).max()) for axis in np.eye(3)]
    planes += [
        _plane(axis, height)
        for axis, low, high in ends
        for height in (low + _SHEET_MM, high - _SHEET_MM)
    ]
    if wall is not None and not wall.is_all:
        _, halves = _best(body, wall.tangents())
        if halves is not None:
            return halves
    added, found = _best(body, planes)
    if added > _WORTH * wholes:
        middles = [_plane(axis, (low + high) / 2) for axis, low, high in ends]
        less, other = _best(body, middles)
        found = other if other is not None and less < added * (1 - _LEAST_SHARE) else found
    return found


def _split(
    body: manifold3d.Manifold, normal: Normal, offset: float
) -> tuple[manifold3d.Manifold, manifold3d.Manifold] | None:
    """Return both sides of a plane, or None where the one is no more than a sheet."""
    points = np.asarray(body.to_mesh64().vert_properties, dtype=np.float64)[:, :3]
    heights = points @ np.asarray(normal)
    if min(float(heights.max()) - offset, offset - float(heights.min())) < _LEAST_MM:
        return None
    one, other = body.split_by_plane(normal, offset)
    return None if min(one.volume(), other.volume()) < _LEAST_MM3 else (one, other)


def _largest_planes(corners: Points, normals: Floats, areas: Floats) -> list[tuple[Normal, float]]:
    """Return the planes that hold most of a surface."""
    offsets = np.einsum("ij,ij->i", corners[:, 0], normals)
    keys = np.round(np.column_stack([normals, offsets]), 3)
    _, first, which = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    totals = np.bincount(which.reshape(-1), weights=areas)
    order = first[np.argsort(-np.round(totals, 6), kind="stable")[:_MOST_PLANES]]
    return [_plane(normals[face], float(offsets[face]) - _SHEET_MM) for face in order.tolist()]


def _best(
    body: manifold3d.Manifold, planes: Iterable[tuple[Normal, float]]
) -> tuple[float, tuple[manifold3d.Manifold, manifold3d.Manifold] | None]:
    """Return how much the hulls of both halves add where that is least, and the halves."""
    best, halves = np.inf, None
    for normal, offset in planes:
        cut = _split(body, normal, offset)
        if cut is None:
            continue
        hulls = sum(part.hull().volume() for half in cut for part in half.decompose())
        added = max(hulls - body.volume(), 0.0)
        # Equals do not hang on rounding.
        if added < best * (1 - _LEAST_SHARE) - _LEAST_MM3:
            best, halves = added, cut
    return best, halves


@dataclass(frozen=True, slots=True, eq=False)
class _Wall:
    """The corners of a gap that lie on the wall of a round hollow."""

    hollow: Hollow
    points: Points
    is_all: bool

    def planes(self) -> Iterator[tuple[Normal, float]]:
        """Yield planes that cut what lies before it: its ends, then through its axis."""
        way, origin = self.hollow.axis, self.hollow.point_m * _TO_MM
        heights = self.points @ way
        yield _plane(way, float(heights.min()) + _SHEET_MM)
        yield _plane(way, float(heights.max()) - _SHEET_MM)
        out = self.points - origin
        out = out - np.outer(out @ way, way)
        middle = out.mean(axis=0)
        if float(np.linalg.norm(middle)) < _ROUND * self.hollow.radius_m * _TO_MM:
            # A gap all the way round becomes one in a box, which is cut anywhere.
            yield from self.tangents()
            across = self._frame()[0]
            yield _plane(across, float(origin @ across))
            return
        middle /= np.linalg.norm(middle)
        square = np.cross(way, middle)
        angles = np.arctan2(out @ square, out @ middle)
        half = (float(angles.min()) + float(angles.max())) / 2
        across = math.cos(half) * square - math.sin(half) * middle
        yield _plane(across, float(origin @ across))

    def tangents(self) -> Iterator[tuple[Normal, float]]:
        """Yield planes that part it from what lies beside it."""
        for axis in self._frame():
            heights = self.points @ axis
            yield _plane(axis, float(heights.min()) + _SHEET_MM)
            yield _plane(axis, float(heights.max()) - _SHEET_MM)

    def _frame(self) -> tuple[Floats, Floats]:
        """Return two directions across its axis, those of the frame if that is one of it."""
        way = self.hollow.axis
        across = np.eye(3)[int(np.argmin(np.abs(way)))]
        across = across - (across @ way) * way
        across /= np.linalg.norm(across)
        return across, np.cross(way, across)


def _wall(points: Points, hollows: Sequence[Hollow]) -> _Wall | None:
    """Return the wall on which most corners of a gap lie, if that is enough of them."""
    best, found = _ON_WALL, None
    for hollow in hollows:
        apart = points - hollow.point_m * _TO_MM
        across = apart - np.outer(apart @ hollow.axis, hollow.axis)
        distances = np.linalg.norm(across, axis=1)
        on = np.abs(distances - hollow.radius_m * _TO_MM) < _LEAST_MM
        if float(on.mean()) > best:
            within = float(distances.max()) <= hollow.radius_m * _TO_MM + _LEAST_MM
            best, found = float(on.mean()), _Wall(hollow, points[on], within)
    return found


def _plane(normal: Floats, offset: float) -> tuple[Normal, float]:
    x, y, z = (float(one) for one in normal)
    return (x, y, z), float(offset)
