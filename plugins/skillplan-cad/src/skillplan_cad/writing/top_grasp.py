"""Where jaws hold a part from above: by what stands highest on it, as a mesh of its own.

A grasp is worked out from the box about a mesh. So a part with a knob is written as two meshes
that meet in a plane: what fingers hold, and what is below.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import manifold3d
import numpy as np
from numpy.typing import NDArray

from skillplan_cad.product import Points, Triangles

Meshes = tuple[tuple[Points, Triangles], ...]

_FLAT_M = 1e-4
_PLAY_M = 0.004
_SHARE = 0.5
_MOST_DEPTH_M = 0.012
_LEAST_KNOB_M = 0.004
_NARROWER_M = 0.001
_SHEET_M = 1e-5


@dataclass(frozen=True, slots=True, eq=False)
class TopGrasp:
    """How a part is held from above.

    Parameters
    ----------
    meshes
        Of the part, upright: the whole one, or what is held and what is below it.
    grasps
        As they stand in a task file, the narrower one first.
    """

    meshes: Meshes
    grasps: tuple[dict[str, Any], ...]


def top_grasp(
    vertices_m: Points, triangles: Triangles, opening_m: float, most_depth_m: float | None = None
) -> TopGrasp | None:
    """Return how jaws hold a part from above, or None where they do not open so wide.

    Parameters
    ----------
    vertices_m, triangles
        The part, upright, its bottom at z = 0.
    opening_m
        Greatest distance between the jaws.
    most_depth_m
        How far down fingers may reach at most; None for no bound but that of jaws.
    """
    corners = vertices_m[triangles]
    meshes: Meshes = ((vertices_m, triangles),)
    shoulder = _shoulder(corners)
    if shoulder is not None:
        meshes = _halves(vertices_m, triangles, shoulder) or meshes
    held = meshes[0][0]
    size = np.ptp(held, axis=0)
    most = _MOST_DEPTH_M if most_depth_m is None else min(_MOST_DEPTH_M, most_depth_m)
    depth = min(most, _SHARE * float(size[2]))
    grasps = [
        {"closing_axis": "xy"[axis], "depth_m": round(depth, 6)}
        for axis in np.argsort(np.round(size[:2], 6), kind="stable").tolist()
        if size[axis] <= opening_m - _PLAY_M
    ]
    return TopGrasp(meshes, tuple(grasps)) if grasps else None


def _shoulder(corners: NDArray[np.float64]) -> float | None:
    """Return the height of the highest face beside a knob, or None for what has none."""
    top = float(corners[:, :, 2].max())
    flat = corners[(corners[:, :, 2] > top - _FLAT_M).all(axis=1)][:, :, :2].reshape(-1, 2)
    if not len(flat):
        return None
    low, high = flat.min(axis=0), flat.max(axis=0)
    everything = corners[:, :, :2].reshape(-1, 2)
    wider = everything.max(axis=0) - everything.min(axis=0) - (high - low)
    if float(wider.max()) < _NARROWER_M:
        return None
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.maximum(np.linalg.norm(normals, axis=1), 1e-30)
    upwards = normals[:, 2] / lengths > _SHARE
    heights = corners[:, :, 2].max(axis=1)
    outside = ((corners[:, :, :2].max(axis=1) > high + _NARROWER_M).any(axis=1)) | (
        (corners[:, :, :2].min(axis=1) < low - _NARROWER_M).any(axis=1)
    )
    beside = heights[upwards & outside & (heights < top - _LEAST_KNOB_M)]
    return float(beside.max()) if len(beside) and beside.max() > _FLAT_M else None


def _halves(vertices_m: Points, triangles: Triangles, height_m: float) -> Meshes | None:
    """Return what of a part is above a height, and what is below it."""
    mesh = manifold3d.Mesh64(
        vert_properties=np.ascontiguousarray(vertices_m * 1e3),
        tri_verts=np.ascontiguousarray(triangles, dtype=np.uint64),
    )
    solid = manifold3d.Manifold(mesh)
    if solid.is_empty():
        return None
    # Just above the shoulder: at its height the upper half would keep a sheet of it.
    above = solid.trim_by_plane((0.0, 0.0, 1.0), (height_m + _SHEET_M) * 1e3)
    halves = (above, solid.trim_by_plane((0.0, 0.0, -1.0), -height_m * 1e3))
    if any(half.is_empty() for half in halves):
        return None
    found = []
    for half in halves:
        made = half.to_mesh64()
        points = np.asarray(made.vert_properties, dtype=np.float64)[:, :3] / 1e3
        found.append((points, np.asarray(made.tri_verts, dtype=np.int64)))
    return tuple(found)
