"""Where jaws hold a part from above: by what stands highest on it, as a mesh of its own.

A grasp is worked out from the box about a mesh. So a part with a knob is written as two meshes
that meet in a plane: what fingers hold, and what is below.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import manifold3d
import numpy as np
from numpy.typing import NDArray

from skillplan.robots.catalogue import ARMS
from skillplan_cad.product import Part, Points, Triangles, Vector

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


_STEP_M = 0.002
_CUP_M = 0.008
_RIM_POINTS = 8
_FLAT_M_HELD_PART = 1e-4


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
    flat = corners[(corners[:, :, 2] > top - _FLAT_M_HELD_PART).all(axis=1)][:, :, :2]
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


GRIPPER, CUP = "gripper", "suction_cup"

_PLAY_M_HELD_PART = 0.004
# Between the tips of fingers and what a part goes into.
_ABOVE_M = 0.001
_LEAST_DEPTH_M = 0.001
# What their makers have arms carry, the hand of 0.7 kg included.
_CARRIES_KG = {"panda": 3.0, "ur5e": 5.0}
_HAND_KG = 0.7
_NO_TOP = "has no flat top wide enough for a cup"


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """How a part is held.

    Parameters
    ----------
    entry
        Keys ``tool`` and ``grasp`` of its entry in a task file.
    meshes
        As which it is written.
    limits
        What one arm cannot do about that, in words that go after its name.
    """

    entry: dict[str, Any]
    meshes: Meshes
    limits: tuple[str, ...] = ()


def held_part(
    part: Part, local: Points, centre_m: tuple[float, float], robot: str, sunk_m: float = 0.0
) -> Held:
    """Return how a part is held: by jaws if they open so far, or else by suction.

    Parameters
    ----------
    part
        With its mass and triangles.
    local
        Its corners, upright, from the centre of its bottom.
    centre_m
        Of its mass in that frame, x y.
    robot
        Name of the arm.
    sunk_m
        How high about it there is, at its goal, what it goes into, above its bottom [m].
    """
    opening_m = ARMS[robot][1].opening_m
    limits = _too_heavy(part.mass_kg, robot)
    size = np.ptp(local, axis=0)
    free_m = float(size[2]) - sunk_m - _ABOVE_M
    held = top_grasp(local, part.triangles, opening_m, free_m if sunk_m else None)
    if held is not None and (not sunk_m or free_m >= _LEAST_DEPTH_M):
        grasps = list(held.grasps)
        entry = {"tool": GRIPPER, "grasp": grasps if len(grasps) > 1 else grasps[0]}
        return Held(entry, held.meshes, limits)
    whole: Meshes = ((local, part.triangles),)
    if held is None and float(size.min()) <= opening_m - _PLAY_M_HELD_PART:
        return Held({"tool": GRIPPER, "grasp": "auto"}, whole, limits)
    spot = suction_spot(local, part.triangles, centre_m)
    if spot is not None:
        return Held({"tool": CUP, "grasp": {"at_m": list(spot)}}, whole, limits)
    if held is not None:
        words = f"ends in what it goes into, where no jaws reach, and {_NO_TOP}"
        return Held({"tool": GRIPPER, "grasp": "auto"}, whole, (*limits, words))
    wide_mm = float(size[:2].min()) * 1e3
    words = f"is {wide_mm:.0f} mm wide, more than jaws open, and {_NO_TOP}"
    return Held({"tool": CUP}, whole, (*limits, words))


def _too_heavy(mass_kg: float, robot: str) -> tuple[str, ...]:
    carries_kg = _CARRIES_KG.get(robot, min(_CARRIES_KG.values())) - _HAND_KG
    if mass_kg <= carries_kg:
        return ()
    return (f"weighs {mass_kg:.1f} kg, and {robot} carries {carries_kg:.1f} kg in its hand",)


Array = NDArray[np.float64]
_DECIMALS = 7


@dataclass(frozen=True, eq=False)
class Upright:
    """Where everything is once the product stands at a place of the table.

    Parameters
    ----------
    matrix
        Rotation from the product's frame to the world's.
    offset_m
        What is added after that.
    """

    matrix: Array
    offset_m: Array

    def point(self, point_m: Vector) -> tuple[float, float, float]:
        """Return a point of the product in the world, to a tenth of a micrometre."""
        return _rounded(self.matrix @ np.asarray(point_m) + self.offset_m)

    def vector(self, vector: Vector) -> tuple[float, float, float]:
        """Return a direction of the product in the world."""
        return _rounded(self.matrix @ np.asarray(vector))

    def vertices(self, part: Part) -> Points:
        """Return the corners of a part in the world."""
        return part.vertices_m @ self.matrix.T + self.offset_m

    def bottom(self, part: Part) -> tuple[float, float, float]:
        """Return the centre of the bottom of the box about a part."""
        points = self.vertices(part)
        low, high = points.min(axis=0), points.max(axis=0)
        return _rounded(np.array([*((low + high) / 2)[:2], low[2]]))

    def size(self, part: Part) -> Array:
        """Return the extents of the box about a part."""
        return np.asarray(np.ptp(self.vertices(part), axis=0))


def standing(parts: Iterable[Part], up: Vector, place_m: tuple[float, float]) -> Upright:
    """Return parts of a product with their lowest point on the table, their middle over a place.

    Parameters
    ----------
    parts
        Those that stand.
    up
        What points up, in its frame.
    place_m
        Of the middle of its box on the table, x y.
    """
    matrix = _rotation_to_z(up)
    points = np.concatenate([part.vertices_m for part in parts]) @ matrix.T
    low, high = points.min(axis=0), points.max(axis=0)
    middle = (low + high) / 2
    return Upright(matrix, np.array([place_m[0] - middle[0], place_m[1] - middle[1], -low[2]]))


def _rotation_to_z(up: Vector) -> Array:
    """Return a rotation that turns a unit vector upwards, and nothing more than that takes."""
    z = np.asarray(up) / np.linalg.norm(up)
    if abs(z[2]) > 1 - 1e-12:
        return np.diag([1.0, z[2], z[2]])
    axis = np.cross(z, [0.0, 0.0, 1.0])
    sine, cosine = float(np.linalg.norm(axis)), float(z[2])
    x, y, w = axis / sine
    across = np.array([[0.0, -w, y], [w, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + sine * across + (1 - cosine) * across @ across)


def _rounded(values: Array) -> tuple[float, float, float]:
    x, y, z = (round(float(one), _DECIMALS) + 0.0 for one in values)
    return x, y, z
