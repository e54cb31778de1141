"""How one arm holds a part from above: with which tool, where, and whether it can."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan.robots.catalogue import ARMS
from skillplan_cad.product import Part, Points, Triangles
from skillplan_cad.writing.top_grasp import Meshes, top_grasp

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


GRIPPER, CUP = "gripper", "suction_cup"

_PLAY_M = 0.004
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
    if held is None and float(size.min()) <= opening_m - _PLAY_M:
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
