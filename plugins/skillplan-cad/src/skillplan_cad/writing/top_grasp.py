"""Find grasps from above, and split off the knob that jaws hold as its own mesh.

A grasp is derived from the bounding box of a mesh. A part with a knob is therefore written as two
meshes that meet in a plane: the knob, and the rest below it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan.robots.catalogue import ARMS
from skillplan_cad.product import Part, Points, Triangles, Vector, make_solid

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
    """A grasp from above.

    Parameters
    ----------
    meshes
        Meshes of the upright part: one, or the held knob and the rest.
    grasps
        Grasps as in a task file, the narrower one first.
    """

    meshes: Meshes
    grasps: tuple[dict[str, Any], ...]


def find_top_grasp(
    vertices_m: Points, triangles: Triangles, opening_m: float, most_depth_m: float | None = None
) -> TopGrasp | None:
    """Return the grasps by jaws from above, or None if the part is too wide.

    Parameters
    ----------
    vertices_m, triangles
        The upright part, with its bottom at z = 0.
    opening_m
        Greatest distance between the jaws [m].
    most_depth_m
        Depth limit of the fingers below the top [m]; None for that of the jaws.
    """
    corners = vertices_m[triangles]
    meshes: Meshes = ((vertices_m, triangles),)
    shoulder = _find_shoulder(corners)
    if shoulder is not None:
        meshes = _split_at(vertices_m, triangles, shoulder) or meshes
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


def _find_shoulder(corners: NDArray[np.float64]) -> float | None:
    """Return the height of the highest face next to a knob [m], or None."""
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


def _split_at(vertices_m: Points, triangles: Triangles, height_m: float) -> Meshes | None:
    """Return the parts of a mesh above and below a height."""
    solid = make_solid(vertices_m, triangles)
    if solid.is_empty():
        return None
    # Cut just above the shoulder; a cut in its plane would leave a sheet on the upper half.
    above = solid.trim_by_plane((0.0, 0.0, 1.0), (height_m + _SHEET_M) * 1e3)
    halves = (above, solid.trim_by_plane((0.0, 0.0, -1.0), -height_m * 1e3))
    if any(half.is_empty() for half in halves):
        return None
    meshes = []
    for half in halves:
        mesh64 = half.to_mesh64()
        points = np.asarray(mesh64.vert_properties, dtype=np.float64)[:, :3] / 1e3
        meshes.append((points, np.asarray(mesh64.tri_verts, dtype=np.int64)))
    return tuple(meshes)


_STEP_M = 0.002
_CUP_M = 0.008
_RIM_POINTS = 8
_FLAT_M_HELD_PART = 1e-4


def find_suction_spot(
    vertices_m: Points, triangles: Triangles, centre_m: tuple[float, float]
) -> tuple[float, float] | None:
    """Return a point of the highest flat face that fits a cup, or None.

    Parameters
    ----------
    centre_m
        Point to stay close to, x y [m].
    """
    top = float(vertices_m[:, 2].max())
    corners = vertices_m[triangles]
    flat = corners[(corners[:, :, 2] > top - _FLAT_M_HELD_PART).all(axis=1)][:, :, :2]
    if not len(flat):
        return None
    low, high = flat.min(axis=(0, 1)), flat.max(axis=(0, 1))
    axes = [np.arange(low[k] + _CUP_M, high[k] - _CUP_M + 1e-9, _STEP_M) for k in (0, 1)]
    points = np.array([(x, y) for x in axes[0] for y in axes[1]]).reshape(-1, 2)
    points = np.concatenate([np.array([centre_m]), points])
    turns = 2 * np.pi * np.arange(_RIM_POINTS) / _RIM_POINTS
    rim = _CUP_M * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    fits = _mask_inside(points, flat)
    for offset in rim:
        fits &= _mask_inside(points + offset, flat)
    if not fits.any():
        return None
    good = points[fits]
    best = good[int(np.argmin(np.linalg.norm(good - np.asarray(centre_m), axis=1)))]
    return round(float(best[0]), 6), round(float(best[1]), 6)


def _mask_inside(points: NDArray[np.float64], flat: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return a mask of the points that lie in any of the triangles."""
    inside = np.zeros(len(points), dtype=np.bool_)
    for a, b, c in flat:
        signs = [
            (q[0] - p[0]) * (points[:, 1] - p[1]) - (q[1] - p[1]) * (points[:, 0] - p[0])
            for p, q in ((a, b), (b, c), (c, a))
        ]
        inside |= np.all([sign >= -1e-12 for sign in signs], axis=0)
    return inside


GRIPPER, CUP = "gripper", "suction_cup"

_PLAY_M_HELD_PART = 0.004
# Clearance between fingertips and the surface around the goal.
_ABOVE_M = 0.001
_LEAST_DEPTH_M = 0.001
_HAND_KG = 0.7
_NO_TOP = "has no flat top wide enough for a cup"


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """A grasp of a part, with the meshes to write.

    Parameters
    ----------
    entry
        Keys ``tool`` and ``grasp`` of its entry in a task file.
    limits
        Limits of one arm, as clauses that follow the part's name.
    """

    entry: dict[str, Any]
    meshes: Meshes
    limits: tuple[str, ...] = ()


def choose_grasp(
    part: Part, local: Points, centre_m: tuple[float, float], robot: str, sunk_m: float = 0.0
) -> Held:
    """Choose jaws if the part fits between them, suction otherwise.

    Parameters
    ----------
    local
        Vertices of the upright part, relative to the centre of its bottom [m].
    centre_m
        Centre of mass in that frame, x y [m].
    sunk_m
        Height up to which other parts enclose it at its goal, from its bottom [m].
    """
    opening_m = ARMS[robot][1].opening_m
    limits = _check_payload(part.mass_kg, robot)
    size = np.ptp(local, axis=0)
    free_m = float(size[2]) - sunk_m - _ABOVE_M
    held = find_top_grasp(local, part.triangles, opening_m, free_m if sunk_m else None)
    if held is not None and (not sunk_m or free_m >= _LEAST_DEPTH_M):
        grasps = list(held.grasps)
        entry = {"tool": GRIPPER, "grasp": grasps if len(grasps) > 1 else grasps[0]}
        return Held(entry, held.meshes, limits)
    whole: Meshes = ((local, part.triangles),)
    if held is None and float(size.min()) <= opening_m - _PLAY_M_HELD_PART:
        return Held({"tool": GRIPPER, "grasp": "auto"}, whole, limits)
    spot = find_suction_spot(local, part.triangles, centre_m)
    if spot is not None:
        return Held({"tool": CUP, "grasp": {"at_m": list(spot)}}, whole, limits)
    if held is not None:
        words = f"is enclosed by other parts up to its top, out of reach of jaws, and {_NO_TOP}"
        return Held({"tool": GRIPPER, "grasp": "auto"}, whole, (*limits, words))
    wide_mm = float(size[:2].min()) * 1e3
    words = f"is {wide_mm:.0f} mm wide, more than jaws open, and {_NO_TOP}"
    return Held({"tool": CUP}, whole, (*limits, words))


def _check_payload(mass_kg: float, robot: str) -> tuple[str, ...]:
    payload_kg = ARMS[robot][0].payload_kg
    assert payload_kg is not None
    carries_kg = payload_kg - _HAND_KG
    if mass_kg <= carries_kg:
        return ()
    return (f"weighs {mass_kg:.1f} kg, and {robot} carries {carries_kg:.1f} kg in its hand",)


Array = NDArray[np.float64]
_DECIMALS = 7


@dataclass(frozen=True, eq=False)
class Upright:
    """Pose of the product on the table.

    Parameters
    ----------
    matrix
        Rotation from the product's frame to the world.
    offset_m
        Translation after the rotation [m].
    """

    matrix: Array
    offset_m: Array

    def point(self, point_m: Vector) -> tuple[float, float, float]:
        """Return a point of the product in the world, rounded to 0.1 micrometres."""
        return _round(self.matrix @ np.asarray(point_m) + self.offset_m)

    def vector(self, vector: Vector) -> tuple[float, float, float]:
        """Return a direction of the product in the world."""
        return _round(self.matrix @ np.asarray(vector))

    def vertices(self, part: Part) -> Points:
        """Return the vertices of a part in the world."""
        return part.vertices_m @ self.matrix.T + self.offset_m

    def bottom(self, part: Part) -> tuple[float, float, float]:
        """Return the centre of the bottom face of a part's bounding box."""
        points = self.vertices(part)
        low, high = points.min(axis=0), points.max(axis=0)
        return _round(np.array([*((low + high) / 2)[:2], low[2]]))

    def size(self, part: Part) -> Array:
        """Return the extents of a part's bounding box."""
        return np.asarray(np.ptp(self.vertices(part), axis=0))


def place_upright(parts: Iterable[Part], up: Vector, place_m: tuple[float, float]) -> Upright:
    """Return the pose that puts parts on the table, centred on a place.

    Parameters
    ----------
    up
        Vector that points up, in the product's frame.
    place_m
        Centre of their bounding box on the table, x y [m].
    """
    matrix = _compute_rotation_to_z(up)
    points = np.concatenate([part.vertices_m for part in parts]) @ matrix.T
    low, high = points.min(axis=0), points.max(axis=0)
    middle = (low + high) / 2
    return Upright(matrix, np.array([place_m[0] - middle[0], place_m[1] - middle[1], -low[2]]))


def _compute_rotation_to_z(up: Vector) -> Array:
    """Return the smallest rotation that turns a unit vector upwards."""
    z = np.asarray(up) / np.linalg.norm(up)
    if abs(z[2]) > 1 - 1e-12:
        return np.diag([1.0, z[2], z[2]])
    axis = np.cross(z, [0.0, 0.0, 1.0])
    sine, cosine = float(np.linalg.norm(axis)), float(z[2])
    x, y, w = axis / sine
    across = np.array([[0.0, -w, y], [w, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + sine * across + (1 - cosine) * across @ across)


def _round(values: Array) -> tuple[float, float, float]:
    x, y, z = (round(float(value), _DECIMALS) + 0.0 for value in values)
    return x, y, z
