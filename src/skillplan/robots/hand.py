"""The measures of a robot's hand, and those of the hand that arms have."""

from __future__ import annotations

from dataclasses import dataclass

from skillplan.robots import panda


@dataclass(frozen=True, slots=True)
class Hand:
    """What engines and detectors know of a hand with two jaws.

    Parameters
    ----------
    opening_m
        Greatest distance between the jaws [m].
    tip_m
        From the hand's frame to the ends of its fingers [m].
    """

    opening_m: float
    tip_m: float


DEFAULT_HAND = Hand(panda.OPENING_M, panda.TIP_M)
"""The hand of every arm, as no task file names another."""
