"""YAML schema of the tools of the changer."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, Literal

from pydantic import Field, model_validator

from skillplan.domains.assembly.schema_types import (
    Extents,
    Height,
    Length,
    Planar,
    ToolDurations,
    is_absent,
)
from skillplan.domains.domain import Strict
from skillplan.files.schema_errors import Located
from skillplan.robots.arm_description import Hand
from skillplan.task.pose import Point
from skillplan.task.scene import STANDARD_BIT_M, STANDARD_CUP_M

JawRow = Annotated[list[Annotated[float, Field(ge=0, le=1)]], Field(min_length=4, max_length=4)]


class ToolConfig(Strict):
    """A tool of the changer."""

    type: Literal["gripper", "suction", "screwdriver"] | None = Field(
        None,
        description="its type; left out: screwdriver if it only drives screws, else gripper",
    )
    opening_m: Length | None = Field(
        None,
        description="greatest distance between the jaws of a gripper [m]; left out: not modelled",
    )
    force_n: Annotated[float, Field(gt=0, le=10_000)] | None = Field(
        None,
        description="greatest force of a gripper or a suction cup [N]; left out: default of the "
        "engine",
    )
    jaw_profile_m: Annotated[list[JawRow], Field(min_length=2, max_length=32)] | None = Field(
        None,
        description="a jaw of a gripper from its end upwards, as rows of: height above the end, "
        "half its width, and how far behind its face it begins and ends [m]; convex between; left "
        "out: that of the arm's hand",
    )
    cup_diameter_m: Annotated[float, Field(ge=1e-3, le=0.2)] | None = Field(
        None,
        exclude_if=is_absent,
        description=f"diameter of a suction cup [m]; one narrower than {STANDARD_CUP_M:g} m has a "
        f"stem as narrow, 0.04 m long; left out: {STANDARD_CUP_M:g}",
    )
    length_m: Annotated[float, Field(gt=0, le=2)] | None = Field(
        None,
        exclude_if=is_absent,
        description="distance from the flange to its tip along the axis of the flange [m]: the "
        "ends of the jaws, the rim of the cup, the end of the bit; left out: that of the arm's "
        "hand, 0.112 for most",
    )
    bit_length_m: Annotated[float, Field(ge=1e-3, le=1)] | None = Field(
        None,
        exclude_if=is_absent,
        description="length of the bit of a screwdriver below its body [m]; left out: 0.04",
    )
    bit_diameter_m: Annotated[float, Field(ge=5e-4, le=0.1)] | None = Field(
        None,
        exclude_if=is_absent,
        description="diameter of the bit of a screwdriver [m]; left out: 0.005",
    )
    torque_nm: Annotated[float, Field(gt=0, le=10_000)] | None = Field(
        None,
        exclude_if=is_absent,
        description="greatest tightening torque of a screwdriver [N m]; left out: not compared",
    )
    speed_rpm: Annotated[float, Field(ge=1, le=100_000)] | None = Field(
        None,
        exclude_if=is_absent,
        description="speed of a screwdriver while it drives a screw in [1/min]; left out: screws "
        "take durations_s.fasten",
    )
    holder_m: Planar = Field(description="place of its holder, x y [m]")
    holder_height_m: Height = Field(0.0, description="height of the holder [m]")
    envelope_m: Extents | None = Field(
        None, description="box about the tool above its tip, x y z [m]; left out: not modelled"
    )
    durations_s: ToolDurations | None = Field(
        None,
        exclude_if=is_absent,
        description="dwell times with this tool [s]; left out: the task's",
    )

    mass_kg: Annotated[float, Field(ge=0, le=10_000)] | None = Field(
        None,
        exclude_if=is_absent,
        description="mass on the flange while it is attached [kg]; left out: that of the arm's "
        "hand",
    )

    @model_validator(mode="after")
    def _jaws_rise(self) -> ToolConfig:
        rows = self.jaw_profile_m or ()
        if self.jaw_profile_m is not None and self.type not in (None, "gripper"):
            raise Located("only a gripper has jaws. Leave it out.", "jaw_profile_m")
        for number, (height_m, half_m, begin_m, end_m) in enumerate(rows):
            if half_m <= 0 or end_m <= begin_m:
                words = "a jaw has a width, and ends behind where it begins."
                raise Located(words, "jaw_profile_m", number)
            if number and height_m < rows[number - 1][0]:
                raise Located("heights rise from row to row.", "jaw_profile_m", number)
        return self

    @property
    def holder(self) -> Point:
        """Position of its holder [m]."""
        return (self.holder_m[0], self.holder_m[1], self.holder_height_m)

    @property
    def bit_m(self) -> tuple[float, float] | None:
        """Length and diameter of the bit [m]; None for the standard one."""
        if self.bit_length_m is None and self.bit_diameter_m is None:
            return None
        length_m = STANDARD_BIT_M[0] if self.bit_length_m is None else self.bit_length_m
        diameter_m = STANDARD_BIT_M[1] if self.bit_diameter_m is None else self.bit_diameter_m
        return (length_m, diameter_m)

    def measure_beyond_m(self, hand: Hand) -> float:
        """Return the distance of its tip beyond the jaws' ends of the arm's hand [m]."""
        return 0.0 if self.length_m is None else self.length_m - hand.tip_on_flange.xyz_m[2]

    def hand_on(self, hand: Hand) -> Hand | None:
        """Return the hand that this tool replaces the arm's hand by, or None."""
        beyond_m = self.measure_beyond_m(hand)
        if self.jaw_profile_m is None and not beyond_m:
            return None
        opening_m = self.opening_m or hand.opening_m
        force_n = self.force_n if self.force_n is not None else hand.force_n
        assert math.isfinite(force_n)
        rows = hand.jaw_m if self.jaw_profile_m is None else self.jaw_profile_m
        jaw = [(row[0], row[1], row[2], row[3]) for row in rows]
        if beyond_m:
            # The fingers reach up to the hand.
            height_m, *section = jaw[-1]
            jaw.append((height_m + beyond_m, section[0], section[1], section[2]))
        return replace(
            hand,
            jaw_m=tuple(jaw),
            jaw_corners_m=(),
            opening_m=opening_m,
            force_n=force_n,
            tip_m=hand.tip_m + beyond_m,
            beyond_m=beyond_m,
        )
