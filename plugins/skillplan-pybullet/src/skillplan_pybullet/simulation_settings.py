"""The options of the engine that bear on the motion: those of every engine, and its own."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from skillplan_simulation.execution_settings import ExecutionSettings


class SimulationSettings(ExecutionSettings):
    """Settings of motion, grip and contact, and what works out the arm's dynamics."""

    dynamics: Literal["pybullet", "pinocchio"] = Field(
        default="pybullet",
        description="what works out mass matrix, Jacobian and bias forces",
    )
