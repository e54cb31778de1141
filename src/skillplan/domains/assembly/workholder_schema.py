"""YAML schema of workholders, which turn the product, and of holders, which keep parts in place."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from skillplan.domains.assembly.part_schema import Names
from skillplan.domains.assembly.schema_types import (
    Angles,
    Duration,
    Planar,
    Spatial,
    is_absent,
    make_point,
)
from skillplan.domains.domain import Name, Strict
from skillplan.files.schema_errors import Located
from skillplan.task.pose import Point, Pose

_TURN_S = 5.0
_CLAMP_S = 1.0
# Rounding of angles in a file, by which a quarter turn may be missed [-].
_EXACT = 1e-6


def _is_true(value: bool) -> bool:
    return value


def _is_false(value: bool) -> bool:
    return not value


class OrientationConfig(Strict):
    """An orientation of a workholder, as a turn from the first one."""

    rpy_rad: Angles = Field(
        [0.0, 0.0, 0.0],
        description="turn from the first orientation about axes through the pivot that are "
        "parallel to the fixed x, y and z, in this order [rad]; left out: none",
    )
    shift_m: Spatial = Field(
        [0.0, 0.0, 0.0], description="displacement after the turn, x y z [m]; left out: none"
    )

    def build_motion(self, pivot_m: Point) -> Pose:
        """Return the motion of bodies from the first orientation to this one."""
        roll, pitch, yaw = self.rpy_rad
        turn = Pose.turned((0.0, 0.0, 0.0), (roll, pitch, yaw))
        y, z = ((row[0], row[1], row[2]) for row in list(zip(*turn.rotation, strict=True))[1:])
        exact = [tuple(float(round(value)) for value in axis) for axis in (y, z)]
        if all(
            abs(value - whole) < _EXACT
            for axis, wholes in zip((y, z), exact, strict=True)
            for value, whole in zip(axis, wholes, strict=True)
        ):
            # Quarter turns are exact, which keeps level faces level.
            y, z = (make_point(list(axis)) for axis in exact)
            turn = Pose.of_axes((0.0, 0.0, 0.0), y, z)
        x_m, y_m, z_m = turn.rotate(pivot_m)
        by = self.shift_m
        return Pose(
            (pivot_m[0] - x_m + by[0], pivot_m[1] - y_m + by[1], pivot_m[2] - z_m + by[2]),
            turn.orientation,
        )


class WorkholderConfig(Strict):
    """A station that carries the product and turns it: a flip station, a turntable."""

    pivot_m: Spatial = Field(description="fixed point of all its turns in the world, x y z [m]")
    orientations: Annotated[dict[Name, OrientationConfig], Field(min_length=2, max_length=16)] = (
        Field(
            description="orientations by name, as {up: {}, down: {rpy_rad: [3.14159265, 0, 0]}}; "
            "the first is the one at the start, in which the file gives goals, holes and "
            "insertions"
        )
    )
    carries: Names | None = Field(
        None,
        description="parts that turn with it once they are placed, a name or a list; screws go "
        "with the part that they go through; left out: all parts that hands move",
    )
    fixtures: Names | None = Field(
        None,
        description="fixtures that belong to it and turn along, such as a plate, a cradle or a "
        "nest, given as they are in the first orientation; left out: none",
    )
    in_order: bool = Field(
        False,
        exclude_if=_is_false,
        description="true: orientations follow each other as they are listed, each once, and all "
        "parts and screws with an 'orientation' are in before it ends; left out: any order",
    )
    takes_s: Duration = Field(_TURN_S, description="time of a turn [s]")
    stand_m: Planar | None = Field(
        None,
        description="place where the arm waits during a turn, x y [m]; left out: home_m of the "
        "robot",
    )


class HolderConfig(Strict):
    """A clamp or a passive holder, which keeps a part where it is."""

    kind: Literal["clamp", "hold"] = Field(
        description="clamp: closes on a part that is placed; hold: may be set before the part "
        "comes, too, and the part stays when the hand lets go"
    )
    parts: Names = Field(
        description="parts that it can hold, one at a time, a name or a list of them"
    )
    takes_s: Duration = Field(
        _CLAMP_S, description="time to close, and to open again [s]; the arm stays where it is"
    )
    force_n: Annotated[float, Field(gt=0, le=100_000)] | None = Field(
        None,
        exclude_if=is_absent,
        description="force of its jaws [N], for the check of stability; left out: it holds any "
        "load",
    )
    fixtures: Names | None = Field(
        None,
        exclude_if=is_absent,
        description="fixtures that are there only while it holds a part, such as its closed jaws; "
        "left out: it has no body",
    )
    turns: bool = Field(
        True,
        exclude_if=_is_true,
        description="true: it turns along with the workholder that carries its parts; false: it "
        "stands in the world, holds in the first orientation only, and what it holds cannot turn",
    )
    stays: bool = Field(
        False,
        exclude_if=_is_false,
        description="true: it is set for its one part from the start, as a support or a nest, and "
        "stays, so it has no skills; left out: skills set and release it",
    )

    @model_validator(mode="after")
    def _stays_for_one(self) -> HolderConfig:
        if self.stays and self.kind == "clamp":
            raise Located("a clamp closes on a part that is placed. Give kind hold.", "stays")
        if self.stays and "takes_s" in self.model_fields_set:
            raise Located("it is set from the start, which takes no time. Leave it out.", "takes_s")
        if self.stays and len(self.parts) > 1:
            raise Located("it stays for one part. Give each a holder of its own.", "parts")
        return self
