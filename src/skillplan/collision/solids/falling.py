"""How far one surface is above another: the way that it may fall until both touch."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from skillplan.collision.solids.polyhedron import Floats, Polyhedron

# Walls that touch, or overlap by less than this in the plane, carry nothing [m].
_GRAZING_M = 2e-4
# A height that changes by more than so often the difference of two widths is that of a wall.
_STEEPEST = 20.0
# By how much more than in proportion height may be lost where another edge is met first.
_GENTLE = 3.0
_ROUNDING, _ROUNDING_M = 1e-12, 1e-9
# Most pairs that are compared at a time.
_PAIRS = 500_000


def height_above(upper: Polyhedron, lower: Polyhedron, at_least_m: float = -math.inf) -> float:
    """Return how far `upper` is above `lower` where that is least [m].

    So far it may fall onto `lower`; below 0 it would have to rise. Both surfaces are compared at
    all corners and all crossings of edges as seen from above, so that nothing is missed. What
    overlaps by less than 0.2 mm in the plane is beside it: twice, the upper one is made
    narrower, and the height of its full width follows from both.

    Parameters
    ----------
    upper, lower
        The surfaces.
    at_least_m
        Heights below are left out: those of what is not beneath `upper`, but above or in it.

    Returns
    -------
    float
        Infinity where it is not above it.
    """
    extent = upper.corners[:, :2].max(axis=0) - upper.corners[:, :2].min(axis=0)
    width_m = min(_GRAZING_M, float(extent.min()) / 4)
    at_full_width = _all_heights(upper, lower)
    if not len(at_full_width):
        # No more than its box is above the other: narrower, it is not either.
        return math.inf
    narrow, wide, full = (
        float(heights[heights >= at_least_m].min(initial=math.inf))
        for heights in (
            _all_heights(upper.narrowed(width_m), lower),
            _all_heights(upper.narrowed(width_m / 2), lower),
            at_full_width,
        )
    )
    if math.isinf(narrow) or math.isinf(wide) or narrow - wide > _STEEPEST * width_m:
        return narrow
    # On a slope, height is lost in proportion to width; at a wall, at once.
    gentle = wide - full <= _GENTLE * abs(narrow - wide) + _ROUNDING_M
    return full if gentle else 2 * wide - narrow


def narrowed_height_above(upper: Polyhedron, lower: Polyhedron, by_m: float) -> float:
    """Return how far `upper` is above `lower` [m] once its walls are shifted in by a length [m]."""
    return float(_all_heights(upper.narrowed(by_m), lower).min(initial=math.inf))


def top_at(surface: Polyhedron, x_m: float, y_m: float) -> float | None:
    """Return the height of a surface at a point of its plan [m]; None beside it."""
    point = np.array([[x_m, y_m, 0.0]])
    faces = _within(surface, surface.upper, point)
    heights = [*_over(point, surface.triangles[faces], surface.normals[faces])]
    tops = -np.concatenate(heights) if heights else np.empty(0)
    return float(tops.max()) if len(tops) else None


def _all_heights(upper: Polyhedron, lower: Polyhedron) -> Floats:
    """Return heights of `upper` above `lower`; none where it is not over it."""
    return np.concatenate([np.empty(0), *_heights(upper, lower)])


def _heights(upper: Polyhedron, lower: Polyhedron) -> Iterator[Floats]:
    """Yield heights of `upper` above `lower`, at all points where one may be least."""
    if not (len(upper.lower) and len(lower.upper)):
        return
    bottom = _within(upper, upper.lower, lower.corners)
    top = _within(lower, lower.upper, upper.corners)
    if not (len(bottom) and len(top)):
        return
    corners = upper.corners[np.unique(upper.faces[bottom])]
    yield from _over(corners, lower.triangles[top], lower.normals[top])
    corners = lower.corners[np.unique(lower.faces[top])]
    for heights in _over(corners, upper.triangles[bottom], upper.normals[bottom]):
        yield -heights
    yield from _crossings(upper.edges_of(bottom), lower.edges_of(top))


def _within(
    surface: Polyhedron, faces: npt.NDArray[np.intp], corners: Floats
) -> npt.NDArray[np.intp]:
    """Return the faces that may lie over or beneath what lies between some corners."""
    triangles = surface.triangles[faces][:, :, :2]
    low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
    meets = (triangles.min(axis=1) <= high) & (triangles.max(axis=1) >= low)
    return np.asarray(faces[meets.all(axis=1)])


def _over(points: Floats, triangles: Floats, normals: Floats) -> Iterator[Floats]:
    """Yield how far points are above the triangles that they lie over."""
    chunk = max(1, _PAIRS // max(1, len(points)))
    for first in range(0, len(triangles), chunk):
        corners, normal = triangles[first : first + chunk], normals[first : first + chunk]
        inside = np.ones((len(points), len(corners)), dtype=bool)
        turn = np.sign(normal[:, 2])
        for i in range(3):
            a, b = corners[:, i], corners[:, (i + 1) % 3]
            side = b - a
            beyond = points[:, None, :2] - a[None, :, :2]
            across = side[:, 0] * beyond[..., 1] - side[:, 1] * beyond[..., 0]
            inside &= across * turn >= -_ROUNDING * (1 + np.abs(side).sum(axis=1))
        which, face = np.nonzero(inside)
        away = points[which] - corners[face, 0]
        yield np.einsum("ij,ij->i", away, normal[face]) / normal[face, 2]


def _crossings(upper: Floats, lower: Floats) -> Iterator[Floats]:
    """Yield how far edges are above the edges that they cross as seen from above."""
    chunk = max(1, _PAIRS // max(1, len(lower)))
    c = lower[:, 0]
    s = lower[:, 1] - c
    for first in range(0, len(upper), chunk):
        a = upper[first : first + chunk, 0, None]
        r = upper[first : first + chunk, 1, None] - a
        between = c - a
        across = r[..., 0] * s[:, 1] - r[..., 1] * s[:, 0]
        t_times = between[..., 0] * s[:, 1] - between[..., 1] * s[:, 0]
        u_times = between[..., 0] * r[..., 1] - between[..., 1] * r[..., 0]
        sign = np.sign(across)
        reach = np.abs(across)
        meet = (t_times * sign >= 0) & (u_times * sign >= 0)
        meet &= (t_times * sign <= reach) & (u_times * sign <= reach) & (reach > 1e-18)
        i, j = np.nonzero(meet)
        t, u = t_times[i, j] / across[i, j], u_times[i, j] / across[i, j]
        yield (a[i, 0, 2] + t * r[i, 0, 2]) - (c[j, 2] + u * s[j, 2])
