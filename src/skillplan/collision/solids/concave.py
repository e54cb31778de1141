"""How deep points and edges are in a closed surface that need not be convex."""

from __future__ import annotations

import math

import numpy as np

from skillplan.collision.solids.polyhedron import Floats, Polyhedron

# How precisely the deepest point of an edge is sought, and what is not worth a search [m].
_PRECISION_M = 5e-5
_LEAST_M = 2e-4
# Most pairs of points and faces at a time: their arrays stay in the cache of a core.
_PAIRS = 30_000
_FEWEST = 16


def depths(surface: Polyhedron, points: Floats) -> Floats:
    """Return how deep points are in a surface [m]; below 0 how far they are from it."""
    faces = _Faces(surface)
    distances = faces.distances(points)
    return np.where(faces.inside(points), distances, -distances)


def outermost(surface: Polyhedron, points: Floats) -> float:
    """Return how far the outermost of some points is from a surface [m]; 0 where all are inside.

    Those that are farthest from it are looked at first, until one is outside.
    """
    faces = _Faces(surface)
    distances = faces.distances(points)
    order = np.argsort(-distances)
    first, count = 0, _FEWEST
    while first < len(order):
        some = order[first : first + count]
        outside = some[~faces.inside(points[some])]
        if len(outside):
            return float(distances[outside[0]])
        first, count = first + count, 2 * count
    return 0.0


def deepest_within(surface: Polyhedron, edges: Floats) -> float:
    """Return how deep any point of some edges is in a surface [m]; 0 where none is.

    No point of an edge is farther from a triangle, which is convex, than the farther of its ends;
    and the depth changes by no more than the way along it. Halves that can have nothing deeper are
    left out.
    """
    faces = _Faces(surface)
    low, high = surface.corners.min(axis=0), surface.corners.max(axis=0)
    begins, ends = _clipped(edges, low, high)
    deepest = 0.0
    while len(begins):
        worth = faces.farthest(begins, ends) > max(deepest + _PRECISION_M, _LEAST_M)
        begins, ends = begins[worth], ends[worth]
        if not len(begins):
            break
        middles, halves = (begins + ends) / 2, np.linalg.norm(ends - begins, axis=1) / 2
        distances = faces.distances(middles)
        depth = np.where(faces.inside(middles), distances, -distances)
        deepest = max(deepest, float(depth.max()))
        worth = depth + halves > max(deepest + _PRECISION_M, _LEAST_M)
        begins, middles, ends = begins[worth], middles[worth], ends[worth]
        begins, ends = np.concatenate([begins, middles]), np.concatenate([middles, ends])
    return max(0.0, deepest)


def _clipped(edges: Floats, low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """Return the parts of edges that are in an upright box."""
    begins, way = edges[:, 0], edges[:, 1] - edges[:, 0]
    slope = np.where(np.abs(way) < 1e-15, 1e-15, way)
    one, other = (low - begins) / slope, (high - begins) / slope
    enter = np.clip(np.minimum(one, other).max(axis=1), 0, 1)[:, None]
    leave = np.clip(np.maximum(one, other).min(axis=1), 0, 1)[:, None]
    inside = (enter < leave)[:, 0]
    return (begins + enter * way)[inside], (begins + leave * way)[inside]


class _Faces:
    """Triangles of a surface, with what all points are compared with.

    Every distance is a sum of products of a point's coordinates and constants of a face, so that a
    product of two matrices has it for all pairs. About the surface's middle, these sums lose
    nothing above a nanometre.
    """

    def __init__(self, surface: Polyhedron) -> None:
        self._middle = surface.corners.mean(axis=0)
        corners = surface.triangles - self._middle
        a, b, c = (corners[:, i] for i in range(3))
        normal = np.cross(b - a, c - a)
        area = np.einsum("ij,ij->i", normal, normal)
        self._corners = (a, b, c)
        self._squares = tuple(np.einsum("ij,ij->i", one, one) for one in (a, b, c))
        self._normal, self._height = normal.T, np.einsum("ij,ij->i", a, normal)
        self._sound, self._per_area = area > 1e-30, 1 / np.maximum(area, 1e-30)
        self._sides = [_Side(begin, end - begin, normal) for begin, end in ((a, b), (b, c), (c, a))]
        self._chunk = max(1, _PAIRS // max(1, len(corners)))

    def distances(self, points: Floats) -> Floats:
        """Return how far points are from the nearest face [m]."""
        found = np.empty(len(points))
        for first in range(0, len(points), self._chunk):
            some = slice(first, first + self._chunk)
            found[some] = self._squares_from(points[some]).min(axis=1)
        return np.asarray(np.sqrt(np.maximum(found, 0.0)))

    def farthest(self, begins: Floats, ends: Floats) -> Floats:
        """Return of edges what no point of them is farther from a face than [m]."""
        found = np.empty(len(begins))
        for first in range(0, len(begins), self._chunk):
            some = slice(first, first + self._chunk)
            both = np.maximum(self._squares_from(begins[some]), self._squares_from(ends[some]))
            found[some] = both.min(axis=1)
        return np.asarray(np.sqrt(np.maximum(found, 0.0)))

    def inside(self, points: Floats) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        """Return which points a surface goes round (Van Oosterom and Strackee 1983)."""
        found = np.empty(len(points), dtype=bool)
        for first in range(0, len(points), self._chunk):
            some = slice(first, first + self._chunk)
            found[some] = self._turns(points[some]) > 0.5
        return found

    def _squares_from(self, points: Floats) -> Floats:
        """Return squares of the distances of points from faces [m2], shape (points, faces)."""
        points = points - self._middle
        own = np.einsum("ij,ij->i", points, points)[:, None]
        nearest = np.full((len(points), len(self._height)), math.inf)
        within = np.broadcast_to(self._sound, nearest.shape).copy()
        for side, begin, square in zip(self._sides, self._corners, self._squares, strict=True):
            within &= points @ side.inwards >= side.inner
            along = points @ side.way - side.begin
            share = np.clip(along * side.per_square, 0, 1)
            away = own - 2 * (points @ begin.T) + square
            np.minimum(nearest, away - share * (2 * along - share * side.square), out=nearest)
        flat = (points @ self._normal - self._height) ** 2 * self._per_area
        return np.where(within, flat, nearest)

    def _turns(self, points: Floats) -> Floats:
        points = points - self._middle
        own = np.einsum("ij,ij->i", points, points)[:, None]
        to = [points @ one.T for one in self._corners]
        x, y, z = (
            np.sqrt(np.maximum(own - 2 * one + square, 0.0))
            for one, square in zip(to, self._squares, strict=True)
        )
        a, b, c = self._corners
        volume = self._height - points @ self._normal
        below = x * y * z
        for one, other, rest, i, j in ((a, b, z, 0, 1), (b, c, x, 1, 2), (c, a, y, 2, 0)):
            below += (own - to[i] - to[j] + np.einsum("ij,ij->i", one, other)) * rest
        return np.asarray(np.arctan2(volume, below).sum(axis=1) / (2 * math.pi))


class _Side:
    """What points are compared with at one side of all triangles."""

    def __init__(self, begin: Floats, way: Floats, normal: Floats) -> None:
        inwards = np.cross(normal, way)
        self.way, self.inwards = way.T, inwards.T
        self.begin = np.einsum("ij,ij->i", begin, way)
        self.inner = np.einsum("ij,ij->i", begin, inwards)
        self.square = np.einsum("ij,ij->i", way, way)
        self.per_square = 1 / np.maximum(self.square, 1e-30)
