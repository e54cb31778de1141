"""Settings of an execution: the engine options that affect motion."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from skillplan.task import back_end


class ExecutionSettings(back_end.Options):
    """Settings of motion, grip and contact."""

    control: Literal["osc", "position"] = Field(
        default="osc",
        description="osc: operational-space control, as in the paper; position: joint controllers",
    )
    stiffness_per_s2: float = Field(
        default=2500.0,
        ge=100,
        le=20_000,
        description="stiffness of operational-space control per unit of mass [1/s2]",
    )
    speed_m_per_s: float = Field(
        default=0.25,
        ge=0.01,
        le=1.0,
        description="maximum speed of the tip to a target and back [m/s]",
    )
    acceleration_m_per_s2: float = Field(
        default=1.5,
        ge=0.05,
        le=10.0,
        description="maximum acceleration of the tip then, and of a part in the jaws [m/s2]",
    )
    speed_fraction: float = Field(
        default=0.5,
        gt=0,
        le=1,
        description="fraction of the joints' speed and acceleration limits for travels [-]",
    )
    travel_checks: int = Field(
        default=5_000,
        ge=1,
        le=1_000_000,
        description="postures checked for a path around an obstacle before the verdict is "
        "unknown [-]",
    )
    grip_force_n: float = Field(
        default=5.0,
        ge=0.5,
        le=70.0,
        description="grip force of jaws if the gripper has none of its own [N]",
    )
    clearance_m: float = Field(
        default=0.004,
        ge=0.0005,
        le=0.03,
        description="clearance of open jaws on either side of a part [m]",
    )
    drop_height_m: float = Field(
        default=0.001,
        ge=0.0,
        le=0.05,
        description="height above its goal at which a part is released [m]",
    )
    friction: float = Field(
        default=0.6, ge=0.05, le=2.0, description="lateral friction of parts and table [-]"
    )
    press_force_n: float = Field(
        default=5.0, ge=0.5, le=60.0, description="force that drives a screw [N]"
    )
    press_travel_m: float = Field(
        default=0.003,
        ge=0.0005,
        le=0.02,
        description="distance beyond its mouth up to which a hole is searched [m]",
    )

    @property
    def pace(self) -> str:
        """Speeds of the arm, as a clause."""
        return (
            f"strokes at {self.speed_m_per_s:g} m/s and {self.acceleration_m_per_s2:g} m/s2 at "
            f"most, travels at {self.speed_fraction:.0%} of the joints' limits"
        )
