"""With what settings skills are executed: the options of the engine that bear on the motion."""

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
        description="stiffness of operational-space control by unit of mass [1/s2]",
    )
    speed_m_per_s: float = Field(
        default=0.25,
        ge=0.01,
        le=1.0,
        description="highest speed of the tip to a target and back [m/s]",
    )
    acceleration_m_per_s2: float = Field(
        default=1.5,
        ge=0.05,
        le=10.0,
        description="highest acceleration of the tip then, and of a part in the jaws [m/s2]",
    )
    speed_fraction: float = Field(
        default=0.5,
        gt=0,
        le=1,
        description="share of the joints' speed and acceleration limits that travels use [-]",
    )
    travel_checks: int = Field(
        default=5_000,
        ge=1,
        le=1_000_000,
        description="postures that are checked for a way round what stands in a straight "
        "travel, before the verdict is unknown [-]",
    )
    grip_force_n: float = Field(
        default=5.0,
        ge=0.5,
        le=70.0,
        description="force with which jaws close, where the gripper names none [N]",
    )
    clearance_m: float = Field(
        default=0.004,
        ge=0.0005,
        le=0.03,
        description="how far open jaws stand off a part on either side [m]",
    )
    drop_height_m: float = Field(
        default=0.001,
        ge=0.0,
        le=0.05,
        description="from how high above its goal a part is let go [m]",
    )
    friction: float = Field(
        default=0.6, ge=0.05, le=2.0, description="lateral friction of parts and table [-]"
    )
    press_force_n: float = Field(
        default=5.0, ge=0.5, le=60.0, description="force with which a screw is driven [N]"
    )
    press_travel_m: float = Field(
        default=0.003,
        ge=0.0005,
        le=0.02,
        description="how far beyond its mouth a hole is felt for [m]",
    )

    @property
    def pace(self) -> str:
        """Speeds of the arm, in a clause."""
        return (
            f"strokes at {self.speed_m_per_s:g} m/s and {self.acceleration_m_per_s2:g} m/s2 at "
            f"most, travels at {self.speed_fraction:.0%} of the joints' limits"
        )
