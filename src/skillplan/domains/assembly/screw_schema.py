"""YAML schema of screws: hole, head and the part that a screw fastens."""

from __future__ import annotations

from pydantic import Field, model_validator

from skillplan.domains.assembly.part_schema import Mass
from skillplan.domains.assembly.schema_types import (
    Direction,
    Extent,
    PlanarOrSpatial,
    ScrewDurations,
    is_absent,
    make_unit,
)
from skillplan.domains.domain import Name, Strict
from skillplan.files.schema_errors import Located
from skillplan.task.pose import DOWN, Point


class ScrewConfig(Strict):
    """A screw: its hole and the part that it fastens."""

    tool: Name = Field(description="the tool that drives it")
    hole_m: PlanarOrSpatial = Field(
        description="the mouth of its hole, x y z, or x y: at the top of the part it goes through "
        "[m]"
    )
    axis: Direction = Field(
        [0.0, 0.0, -1.0],
        description="direction in the world in which it goes into the hole; left out: straight "
        "down",
    )
    through: Name = Field(description="the part whose top its head rests on")
    feeder: Name | None = Field(
        None,
        description="the feeder where the tool fetches it; left out: the tool brings it along",
    )
    head_diameter_m: Extent = Field(0.006, description="diameter of the head [m]")
    head_height_m: Extent = Field(0.002, description="height of the head [m]")
    mass_kg: Mass = Field(0.001, description="mass [kg]")
    durations_s: ScrewDurations | None = Field(
        None,
        exclude_if=is_absent,
        description="dwell times of this screw [s]; left out: dwell of its tool, or of the task",
    )

    @property
    def direction(self) -> Point:
        """Unit vector in the world along which it goes into its hole."""
        return make_unit(self.axis)

    @model_validator(mode="after")
    def _require_height_of_oblique_hole(self) -> ScrewConfig:
        if len(self.hole_m) < 3 and make_unit(self.axis) != DOWN:
            message = "give the hole x y z [m], as its axis is not straight down."
            raise Located(message, "hole_m")
        return self
