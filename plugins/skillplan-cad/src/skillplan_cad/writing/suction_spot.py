"""Where a suction cup holds a part: on the flat top, as near over its centre of mass as can be."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skillplan_cad.product import Points, Triangles

_STEP_M = 0.002
_CUP_M = 0.008
_RIM_POINTS = 8
_FLAT_M = 1e-4


def suction_spot(
    vertices_m: Points, triangles: Triangles, centre_m: tuple[float, float]
) -> tuple[float, float] | None:
    """Return a point of the highest flat face that a cup fits on, or None where there is none.

    Parameters
    ----------
    vertices_m, triangles
        The part, upright.
    centre_m
        What it should be near to, x y.
    """
    top = float(vertices_m[:, 2].max())
    corners = vertices_m[triangles]
    flat = corners[(corners[:, :, 2] > top - _FLAT_M).all(axis=1)][:, :, :2]
    if not len(flat):
        return None
    low, high = flat.min(axis=(0, 1)), flat.max(axis=(0, 1))
    axes = [np.arange(low[k] + _CUP_M, high[k] - _CUP_M + 1e-9, _STEP_M) for k in (0, 1)]
    points = np.array([(x, y) for x in axes[0] for y in axes[1]]).reshape(-1, 2)
    points = np.concatenate([np.array([centre_m]), points])
    turns = 2 * np.pi * np.arange(_RIM_POINTS) / _RIM_POINTS
    rim = _CUP_M * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    fits = _inside(points, flat)
    for offset in rim:
        fits &= _inside(points + offset, flat)
    if not fits.any():
        return None
    good = points[fits]
    best = good[int(np.argmin(np.linalg.norm(good - np.asarray(centre_m), axis=1)))]
    return round(float(best[0]), 6), round(float(best[1]), 6)


def _inside(points: NDArray[np.float64], flat: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which points of the plane lie in any of some triangles."""
    found = np.zeros(len(points), dtype=np.bool_)
    for a, b, c in flat:
        signs = [
            (q[0] - p[0]) * (points[:, 1] - p[1]) - (q[1] - p[1]) * (points[:, 0] - p[0])
            for p, q in ((a, b), (b, c), (c, a))
        ]
        found |= np.all([sign >= -1e-12 for sign in signs], axis=0)
    return found
