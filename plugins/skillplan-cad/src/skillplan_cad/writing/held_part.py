"""With which tool an arm holds a part, where, and how firmly; and what it cannot hold."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from skillplan.robots.catalogue import ARMS
from skillplan_cad.product import Part, Points
from skillplan_cad.writing.suction_spot import suction_spot
from skillplan_cad.writing.top_grasp import Meshes, top_grasp

GRIPPER, CUP = "gripper", "suction_cup"
_PLAY_M = 0.004
# Between jaws and parts, as engines have it. The margin is for parts held off their middle.
_FRICTION, _GRIP_MARGIN, _LEAST_GRIP_N = 0.6, 4.0, 5.0
_GRAVITY_M_PER_S2 = 9.81
# What their makers have arms carry, the hand of 0.7 kg included.
_CARRIES_KG = {"panda": 3.0, "ur5e": 5.0}
_HAND_KG = 0.7


@dataclass(frozen=True, slots=True, eq=False)
class HeldPart:
    """How an arm holds a part.

    Parameters
    ----------
    entry
        Tool and grasp, as they stand in a task file.
    meshes
        Of the part, upright: the whole one, or what is held and what is below it.
    limits
        What the arm cannot do about it, in words that follow its name.
    """

    entry: Mapping[str, Any]
    meshes: Meshes
    limits: tuple[str, ...]


def held_part(part: Part, local: Points, middle: tuple[float, float], robot: str) -> HeldPart:
    """Return how a part is held: by jaws if they open so far, or by suction.

    Parameters
    ----------
    part
        Its mass and its triangles.
    local
        Its corners, upright, from the centre of its bottom [m].
    middle
        Where its centre of mass is, x y [m].
    robot
        Name of an arm that skillplan knows.
    """
    whole = ((local, part.triangles),)
    opening_m = ARMS[robot][1].opening_m
    carries_kg = _CARRIES_KG.get(robot, min(_CARRIES_KG.values())) - _HAND_KG
    limits: tuple[str, ...] = ()
    if part.mass_kg > carries_kg:
        words = f"weighs {part.mass_kg:.1f} kg, and {robot} carries {carries_kg:.1f} kg in its hand"
        limits = (words,)
    held = top_grasp(local, part.triangles, opening_m)
    if held is not None:
        grasps = list(held.grasps)
        entry = {"tool": GRIPPER, "grasp": grasps if len(grasps) > 1 else grasps[0]}
        return HeldPart(entry, held.meshes, limits)
    size = np.ptp(local, axis=0)
    if float(size.min()) <= opening_m - _PLAY_M:
        return HeldPart({"tool": GRIPPER, "grasp": "auto"}, whole, limits)
    spot = suction_spot(local, part.triangles, middle)
    if spot is None:
        wide_mm = float(size[:2].min()) * 1e3
        words = f"is {wide_mm:.0f} mm wide, more than jaws open, and has no flat top for a cup"
        return HeldPart({"tool": CUP}, whole, (*limits, words))
    return HeldPart({"tool": CUP, "grasp": {"at_m": list(spot)}}, whole, limits)


def grip_n(mass_kg: float, most_n: float) -> float:
    """Return the force of jaws that lift a mass by friction, to a newton, well within its limit."""
    needed_n = _GRIP_MARGIN * mass_kg * _GRAVITY_M_PER_S2 / (2 * _FRICTION)
    return float(min(most_n, max(_LEAST_GRIP_N, math.ceil(needed_n))))
