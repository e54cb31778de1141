"""The arms that task files name, each with the hand on its flange."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from skillplan.robots.arm_description import ArmDescription, Hand, Transform
from skillplan.robots.panda import PANDA, PANDA_HAND
from skillplan.robots.ur5e import UR5E

STANDARD_HAND: Final = replace(PANDA_HAND, on_flange=Transform())
"""Hand of arms that are sold without one: its closing axis is y of the flange."""

ARMS: Final[dict[str, tuple[ArmDescription, Hand]]] = {
    "panda": (PANDA, PANDA_HAND),
    "ur5e": (UR5E, STANDARD_HAND),
}
"""Arm and hand by the name of the arm."""

DEFAULT_ARM: Final = "panda"
"""Default arm of a task."""

DEFAULT_MODEL, DEFAULT_HAND = ARMS[DEFAULT_ARM]
"""Its description, and the hand on its flange."""
