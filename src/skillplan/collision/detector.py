"""The base class of collision detectors."""

from __future__ import annotations

from skillplan.task.back_end import BackEnd


class Detector(BackEnd):
    """Rules on whether a skill's motion is free of collision and what it places stays put."""
