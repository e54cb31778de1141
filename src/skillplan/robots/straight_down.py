"""Where arms surely point straight down: what needs no inverse kinematics to be answered."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from skillplan.robots.arm_description import ArmDescription
from skillplan.robots.panda import PANDA
from skillplan.robots.ur5e import UR5E


@dataclass(frozen=True)
class Annulus:
    """A ring about the axis of an arm's base, with a rectangular section.

    Parameters
    ----------
    near_m, far_m
        Distances from that axis [m], 0 <= near < far.
    low_m, high_m
        Heights above the foot of the base [m], low < high.
    """

    near_m: float
    far_m: float
    low_m: float
    high_m: float

    def holds(self, point: tuple[float, float, float]) -> bool:
        """Whether a point in the frame of the base [m] lies in it."""
        distance_m = math.hypot(point[0], point[1])
        return self.near_m <= distance_m <= self.far_m and self.low_m <= point[2] <= self.high_m


# Measured with the inverse kinematics of both: the hand as it is turned does not matter there.
_FLANGES: Final = (
    (PANDA, Annulus(0.28, 0.75, 0.06, 0.41)),
    (UR5E, Annulus(0.28, 0.75, 0.06, 0.41)),
)


def straight_down(arm: ArmDescription) -> Annulus | None:
    """Return where the flange of an arm on an upright base can point straight down.

    However it is turned about the vertical, some posture within the joints' limits brings it
    there. It does so elsewhere, too: this is what it surely reaches.

    Parameters
    ----------
    arm
        The arm.

    Returns
    -------
    Annulus | None
        In the frame of the base; None where nothing is known of the arm.
    """
    return next((ring for known, ring in _FLANGES if known.joints == arm.joints), None)
