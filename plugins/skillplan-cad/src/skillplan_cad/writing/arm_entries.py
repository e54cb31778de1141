"""The entries of a task file that say which arm works, and with which tools."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from skillplan.robots.catalogue import ARMS
from skillplan_cad.product import Part
from skillplan_cad.writing.held_part import CUP, GRIPPER
from skillplan_cad.writing.tray import HOLDERS, HOME
from skillplan_cad.writing.upright import Upright

DRIVER = "screwdriver"

# Between jaws and parts, as engines have it. The margin is for parts held off their middle.
_FRICTION, _GRIP_MARGIN, _LEAST_GRIP_N = 0.6, 4.0, 5.0
_GRAVITY_M_PER_S2 = 9.81
_LEAST_SAFE_M = 0.15
_ABOVE_PRODUCT_M = 0.05


def robot_entry(
    robot: str, parts: Sequence[Part], gripped: Sequence[Part], upright: Upright
) -> dict[str, Any]:
    """Return the entry of an arm, which travels above the product and what it carries.

    Parameters
    ----------
    robot
        Its name.
    parts, gripped
        All parts of the task, and those that it carries.
    upright
        How they stand.
    """
    height = max(float(upright.vertices(part)[:, 2].max()) for part in parts)
    tallest = max(float(upright.size(part)[2]) for part in gripped)
    safe = max(_LEAST_SAFE_M, height + _ABOVE_PRODUCT_M, tallest + _ABOVE_PRODUCT_M)
    named = {"name": robot, "model": robot, "home_m": list(HOME)}
    return {**named, "safe_height_m": round(safe, 3)}


def tool_entries(robot: str, entries: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the tools that parts and screws name; jaws press as the heaviest part needs it.

    Parameters
    ----------
    robot
        Name of the arm.
    entries
        Of parts and screws.
    """
    used = {entry["tool"] for entry in entries}
    kinds = {GRIPPER: "gripper", CUP: "suction", DRIVER: "screwdriver"}
    found: dict[str, Any] = {}
    for (name, kind), holder in zip(kinds.items(), HOLDERS, strict=True):
        if name in used:
            found[name] = {"type": kind, "holder_m": list(holder)}
    if GRIPPER in found:
        hand = ARMS[robot][1]
        found[GRIPPER]["opening_m"] = hand.opening_m
        heaviest_kg = max(entry["mass_kg"] for entry in entries if entry["tool"] == GRIPPER)
        found[GRIPPER]["force_n"] = _grip_n(heaviest_kg, hand.force_n)
    return found


def _grip_n(mass_kg: float, most_n: float) -> float:
    """Return the force of jaws that lift a mass by friction, to a newton, well within its limit."""
    needed_n = _GRIP_MARGIN * mass_kg * _GRAVITY_M_PER_S2 / (2 * _FRICTION)
    return float(min(most_n, max(_LEAST_GRIP_N, math.ceil(needed_n))))
