"""Which of the installed engines executes skills with a simulated arm, where none is named."""

from __future__ import annotations

from skillplan.plugins.installed import registered

AUTO = "auto"
"""What names no engine, but the first of `PREFERRED` that is installed."""

PREFERRED = ("pybullet", "mujoco")
"""Engines that execute skills, the one that is taken first."""


def installed_simulator() -> str | None:
    """Return the name of the engine that ``auto`` stands for; None where none is installed."""
    known = registered("physics").names
    return next((name for name in PREFERRED if name in known), None)
