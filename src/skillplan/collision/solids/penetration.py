"""How deep two closed surfaces are in each other."""

from __future__ import annotations

import numpy as np

from skillplan.collision.solids.concave import deepest_within
from skillplan.collision.solids.polyhedron import Floats, Polyhedron

# How precisely the deepest point of an edge is sought, by halving the rest of its length.
_HALVINGS = 40
_GOLDEN = (5**0.5 - 1) / 2
# Most pairs of points and planes at a time.
_PAIRS = 1_000_000


def depth_m(one: Polyhedron, other: Polyhedron) -> float:
    """Return how deep an edge of one surface is in the other [m]; 0 where none is.

    Two polyhedra that have a volume in common have an edge of one in the other; how deep is its
    distance to the nearest face. In what is not convex that is found to 0.05 mm.
    """
    return max(_deepest(one, other), _deepest(other, one))


def _deepest(edges_of: Polyhedron, within: Polyhedron) -> float:
    edges = edges_of.edges
    low, high = within.corners.min(axis=0), within.corners.max(axis=0)
    near = (edges.min(axis=1) < high) & (edges.max(axis=1) > low)
    edges = edges[near.all(axis=1)]
    if not len(edges):
        return 0.0
    if not within.convex:
        return deepest_within(within, edges)
    normals, offsets = within.planes
    deepest = 0.0
    chunk = max(1, _PAIRS // len(normals))
    for first in range(0, len(edges), chunk):
        begins, ends = edges[first : first + chunk, 0], edges[first : first + chunk, 1]
        # How far the ends lie beneath every plane; between them that is linear.
        a, b = offsets - begins @ normals.T, offsets - ends @ normals.T
        inside = (np.maximum(a, b) > deepest).all(axis=1)
        if inside.any():
            deepest = max(deepest, _highest_least(a[inside], b[inside]))
    return deepest


def _highest_least(a: Floats, b: Floats) -> float:
    """Return the greatest of the least of linear functions, by their values at both ends.

    Parameters
    ----------
    a, b
        Values at 0 and at 1, a row for each set of functions; searched by golden section.
    """
    low, high = np.zeros(len(a)), np.ones(len(a))

    def least(share: Floats) -> Floats:
        return np.asarray((a + (b - a) * share[:, None]).min(axis=1))

    best = np.maximum(least(low), least(high))
    for _ in range(_HALVINGS):
        left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        at_left, at_right = least(left), least(right)
        best = np.maximum(best, np.maximum(at_left, at_right))
        rises = at_left < at_right
        low, high = np.where(rises, left, low), np.where(rises, high, right)
    return float(best.max())
