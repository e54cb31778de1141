"""YAML schema of what comes in numbers: grids of places, and trays whose pockets are one."""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, model_validator

from skillplan.domains.assembly.schema_types import (
    Angle,
    Coordinate,
    Extent,
    Planar,
    PlanarOrSpatial,
)
from skillplan.domains.domain import Name, Strict
from skillplan.files.schema_errors import Located
from skillplan.task.pose import Point

_Size = Annotated[int, Field(ge=1, le=256)]
Count = Annotated[int, Field(ge=1, le=256)]
"""Number of parts or screws of an entry."""


def _keep(value: Any) -> Any:
    """Return a value; lists are written out before validation."""
    return value


_Time = Annotated[float, Field(ge=0, le=86_400)]
ArrivalTime = Annotated[_Time, BeforeValidator(_keep, json_schema_input_type=_Time | list[_Time])]
"""Time of arrival [s]; in a file, also a list of times for the parts of a count."""

ToolName = Annotated[Name, BeforeValidator(_keep, json_schema_input_type=Name | list[Name])]
"""A tool; in a file, also a list of tools, the first of which is this."""


class PatternConfig(Strict):
    """A grid of places, numbered along x first, then along y, then level by level."""

    grid: Annotated[list[_Size], Field(min_length=2, max_length=3)] = Field(
        description="numbers of places along x and y, and of levels if there are several"
    )
    pitch_m: PlanarOrSpatial = Field(
        description="distances between neighbours along x and y, and between levels [m]; negative "
        "to go the other way"
    )
    step_m: Planar = Field(
        [0.0, 0.0], description="shift of each level against the one below, x y: a stepped rack [m]"
    )
    yaw_rad: Angle = Field(0.0, description="rotation of the grid about its first place [rad]")

    @model_validator(mode="after")
    def _levels_have_a_pitch(self) -> PatternConfig:
        if len(self.grid) != len(self.pitch_m):
            words = f"{len(self.pitch_m)} distances for a grid of {len(self.grid)} directions."
            raise Located(words, "pitch_m")
        if self.places > 256:
            raise Located(f"{self.places} places, where 256 are the most.", "grid")
        return self

    @model_validator(mode="after")
    def _step_needs_levels(self) -> PatternConfig:
        if self.levels == 1 and any(self.step_m):
            raise Located("it is from level to level: give 'grid' three numbers.", "step_m")
        return self

    @property
    def places(self) -> int:
        """Number of places."""
        return math.prod(self.grid)

    @property
    def levels(self) -> int:
        """Number of levels."""
        return self.grid[2] if len(self.grid) > 2 else 1

    def offset(self, index: int) -> Point:
        """Return the offset of a place, from 0, from the first one [m]."""
        columns, rows = self.grid[:2]
        level, within = divmod(index, columns * rows)
        row, column = divmod(within, columns)
        x_m = column * self.pitch_m[0] + level * self.step_m[0]
        y_m = row * self.pitch_m[1] + level * self.step_m[1]
        z_m = level * self.pitch_m[2] if len(self.pitch_m) > 2 else 0.0
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return (round(cos * x_m - sin * y_m, 9), round(sin * x_m + cos * y_m, 9), round(z_m, 9))


class TrayConfig(Strict):
    """A tray or rack that parts lie in at the start."""

    at_m: Planar = Field(description="place of its first pocket, x y [m]")
    height_m: Extent = Field(
        0.01, description="height of the floor of its pockets, and thickness of each level [m]"
    )
    pattern: PatternConfig = Field(description="its pockets")
    border_m: Annotated[Coordinate, Field(ge=0)] | None = Field(
        None,
        description="width of the plate about the middles of the outer pockets [m]; left out: half "
        "of the distance between pockets",
    )

    @property
    def yaw_rad(self) -> float:
        """Rotation about the vertical [rad]."""
        return self.pattern.yaw_rad

    def pocket(self, index: int) -> Point:
        """Return the middle of the floor of a pocket [m]."""
        x_m, y_m, z_m = self.pattern.offset(index)
        return (
            round(self.at_m[0] + x_m, 9),
            round(self.at_m[1] + y_m, 9),
            round(self.height_m + z_m, 9),
        )

    def build_fixture(self) -> dict[str, object]:
        """Return the fixture of its plates, as the keys of a task file."""
        pattern, height_m = self.pattern, self.height_m
        columns, rows = pattern.grid[:2]
        borders_m = [
            abs(pitch_m) / 2 if self.border_m is None else self.border_m
            for pitch_m in pattern.pitch_m[:2]
        ]
        size_m = [
            max(1e-3, (number - 1) * abs(pitch_m) + 2 * border_m)
            for number, pitch_m, border_m in zip(
                (columns, rows), pattern.pitch_m[:2], borders_m, strict=True
            )
        ]
        boxes = []
        for level in range(pattern.levels):
            middle = [
                (number - 1) * pitch_m / 2 + level * step_m
                for number, pitch_m, step_m in zip(
                    (columns, rows), pattern.pitch_m[:2], pattern.step_m, strict=True
                )
            ]
            rises_m = level * pattern.pitch_m[2] if pattern.levels > 1 else 0.0
            # A stepped rack stands on the table at every level; shelves have room beneath.
            stands = any(pattern.step_m)
            thick_m = height_m + rises_m if stands else height_m
            z_m = thick_m / 2 if stands else rises_m + height_m / 2
            boxes.append(
                {
                    "size_m": [round(value, 9) for value in (*size_m, thick_m)],
                    "centre_m": [round(value, 9) for value in (*middle, z_m)],
                }
            )
        return {"boxes": boxes, "at_m": list(self.at_m), "yaw_rad": self.yaw_rad}


Trays = Annotated[dict[Name, TrayConfig], Field(max_length=32)]
