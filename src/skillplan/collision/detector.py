"""The base class of collision detectors."""

from __future__ import annotations

from typing import ClassVar

from skillplan.task.back_end import BackEnd


class Detector(BackEnd):
    """Checks that a skill's motion is free of collisions and that placed bodies stay in place.

    Attributes
    ----------
    checks_arm
        True if it checks links and fingers of the arm, and the existence of postures.
    """

    checks_arm: ClassVar[bool] = False
