"""Where one surface stands on another, seen from above."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from skillplan.collision.solids.polygons import Polygon, area, below, intersection
from skillplan.collision.solids.polyhedron import Floats, Polyhedron

# Faces whose directions differ by more touch along a line at most [-].
_PARALLEL = 1e-3


def touching(upper: Polyhedron, lower: Polyhedron, tolerance_m: float) -> Iterator[Polygon]:
    """Yield where flat faces lie on each other, seen from above [m].

    Parameters
    ----------
    upper, lower
        The surfaces.
    tolerance_m
        Gap or overlap that still counts as contact [m].
    """
    feet = upper.lower[upper.flat[upper.lower]]
    tops = lower.upper[lower.flat[lower.upper]]
    above, beneath = upper.triangles[feet], lower.triangles[tops]
    if not (len(above) and len(beneath)):
        return
    gap = np.array([tolerance_m] * 3)
    meets = (
        (above.min(axis=1)[:, None] <= beneath.max(axis=1) + gap)
        & (above.max(axis=1)[:, None] >= beneath.min(axis=1) - gap)
    ).all(axis=2)
    meets &= upper.normals[feet] @ lower.normals[tops].T < -1 + _PARALLEL**2 / 2
    for i, j in zip(*np.nonzero(meets), strict=True):
        # Seen from above, a face that looks down turns the other way round.
        common = intersection(_seen(above[i][::-1]), _seen(beneath[j]))
        common = _near(common, above[i], beneath[j], tolerance_m)
        if len(common) > 2 and area(common) > 0:
            yield common


def _near(common: Polygon, above: Floats, beneath: Floats, tolerance_m: float) -> Polygon:
    """Return the part of a polygon where two planes are within the tolerance of each other."""
    (ax, ay, az), (bx, by, bz) = _slopes(above), _slopes(beneath)
    dx, dy, dz = ax - bx, ay - by, az - bz
    kept = below(common, (dx, dy), tolerance_m - dz)
    return tuple(below(kept, (-dx, -dy), tolerance_m + dz))


def _slopes(triangle: Floats) -> tuple[float, float, float]:
    """Return the height of a plane: how it changes along x and y, and over the origin."""
    a, b, c = triangle
    normal = np.cross(b - a, c - a)
    x, y = -normal[0] / normal[2], -normal[1] / normal[2]
    return float(x), float(y), float(a[2] - x * a[0] - y * a[1])


def _seen(triangle: Floats) -> Polygon:
    return tuple((float(x), float(y)) for x, y, _ in triangle)
