"""The base class of collision detectors."""

from __future__ import annotations

from typing import ClassVar

from skillplan.task.back_end import BackEnd


class Detector(BackEnd):
    """Rules on whether a skill's motion is free of collision and what it places stays put.

    Attributes
    ----------
    checks_arm
        Whether it checks links and fingers of the arm, and whether postures exist.
    """

    checks_arm: ClassVar[bool] = False
