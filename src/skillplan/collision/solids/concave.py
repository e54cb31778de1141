"""How deep points and edges are in a closed surface that need not be convex."""

from __future__ import annotations

import math

import numpy as np

from skillplan.collision.solids.polyhedron import Floats, Polyhedron

# How precisely the deepest point of an edge is sought, and what is not worth a search [m].
_PRECISION_M = 5e-5
_LEAST_M = 2e-4
# Most pairs of points and faces at a time.
_PAIRS = 400_000


def depths(surface: Polyhedron, points: Floats) -> Floats:
    """Return how deep points are in a surface [m]; below 0 how far they are from it."""
    triangles = surface.triangles
    found = np.empty(len(points))
    chunk = max(1, _PAIRS // len(triangles))
    for first in range(0, len(points), chunk):
        some = points[first : first + chunk]
        distances = np.sqrt(_squares(triangles, some).min(axis=1))
        inside = _turns(triangles, some) > 0.5
        found[first : first + chunk] = np.where(inside, distances, -distances)
    return found


def deepest_within(surface: Polyhedron, edges: Floats) -> float:
    """Return how deep any point of some edges is in a surface [m]; 0 where none is.

    The depth changes by no more than the way along an edge, so that halves of which the middle
    is too far out are left out.
    """
    low, high = surface.corners.min(axis=0), surface.corners.max(axis=0)
    begins, ends = _clipped(edges, low, high)
    deepest = 0.0
    while len(begins):
        middles, halves = (begins + ends) / 2, np.linalg.norm(ends - begins, axis=1) / 2
        depth = depths(surface, middles)
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


def _squares(triangles: Floats, points: Floats) -> Floats:
    """Return the squares of the distances of points from triangles, shape (points, triangles)."""
    a, b, c = (triangles[:, i] for i in range(3))
    normal = np.cross(b - a, c - a)
    area = np.einsum("ij,ij->i", normal, normal)
    away = points[:, None] - a
    height = np.einsum("pti,ti->pt", away, normal)
    inside = np.ones(height.shape, dtype=bool)
    nearest = np.full(height.shape, math.inf)
    for begin, end in ((a, b), (b, c), (c, a)):
        side = end - begin
        beyond = points[:, None] - begin
        inside &= np.einsum("pti,ti->pt", beyond, np.cross(normal, side)) >= 0
        length = np.maximum(np.einsum("ij,ij->i", side, side), 1e-30)
        share = np.clip(np.einsum("pti,ti->pt", beyond, side) / length, 0, 1)
        rest = beyond - share[..., None] * side
        nearest = np.minimum(nearest, np.einsum("pti,pti->pt", rest, rest))
    flat = height**2 / np.maximum(area, 1e-30)
    return np.asarray(np.where(inside & (area > 1e-30), flat, nearest))


def _turns(triangles: Floats, points: Floats) -> Floats:
    """Return how often a surface goes round points (Van Oosterom and Strackee 1983)."""
    a, b, c = (triangles[:, i] - points[:, None] for i in range(3))
    x, y, z = (np.sqrt(np.einsum("pti,pti->pt", one, one)) for one in (a, b, c))
    volume = np.einsum("pti,pti->pt", a, np.cross(b, c))
    below = (
        x * y * z
        + np.einsum("pti,pti->pt", a, b) * z
        + np.einsum("pti,pti->pt", b, c) * x
        + np.einsum("pti,pti->pt", c, a) * y
    )
    return np.asarray(np.arctan2(volume, below).sum(axis=1) / (2 * math.pi))
