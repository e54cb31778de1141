"""YAML schema of screws: size, head, shank, hole and thread, with the facts of the standards.

Pitches are of the coarse series of ISO 261. Heads are the greatest of ISO 4762 (socket), ISO 7045
(pan), ISO 7380-1 (button), ISO 4017 (hex) and ISO 4032 (nut); a hexagon counts as the circle
through its corners.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Final, Literal

from pydantic import Field, model_validator

from skillplan.domains.assembly.many_schema import Count, PatternConfig, ToolName
from skillplan.domains.assembly.part_schema import Mass, Names
from skillplan.domains.assembly.schema_types import (
    Direction,
    Extent,
    Length,
    PlanarOrSpatial,
    ScrewDurations,
    Spatial,
    is_absent,
    is_empty,
    make_unit,
)
from skillplan.domains.domain import Name, Strict
from skillplan.files.schema_errors import Located
from skillplan.task.pose import DOWN, Point, is_same_direction
from skillplan.task.scene import Shank
from skillplan.task.shape import Cylinder, Shape, make_ring

Size = Literal["M2", "M2.5", "M3", "M4", "M5", "M6", "M8", "M10", "M12"]
Head = Literal["socket", "pan", "button", "hex", "nut"]
Torque = Annotated[float, Field(gt=0, le=1000)]

UP: Final[Point] = (0.0, 0.0, 1.0)
"""Direction of a screw that goes in from below."""

_DEFAULT_HEAD: Final = "socket"
_STANDARDS: Final = {
    "socket": "ISO 4762",
    "pan": "ISO 7045",
    "button": "ISO 7380-1",
    "hex": "ISO 4017",
    "nut": "ISO 4032",
}
# Pitch of the coarse thread [mm].
_PITCHES_MM: Final = {
    "M2": 0.4,
    "M2.5": 0.45,
    "M3": 0.5,
    "M4": 0.7,
    "M5": 0.8,
    "M6": 1.0,
    "M8": 1.25,
    "M10": 1.5,
    "M12": 1.75,
}
# Diameter of the head, of a hexagon its width across flats, and height [mm].
_HEADS_MM: Final[dict[str, dict[str, tuple[float, float]]]] = {
    "socket": {
        "M2": (3.8, 2.0),
        "M2.5": (4.5, 2.5),
        "M3": (5.5, 3.0),
        "M4": (7.0, 4.0),
        "M5": (8.5, 5.0),
        "M6": (10.0, 6.0),
        "M8": (13.0, 8.0),
        "M10": (16.0, 10.0),
        "M12": (18.0, 12.0),
    },
    "pan": {
        "M2": (4.0, 1.6),
        "M2.5": (5.0, 2.1),
        "M3": (5.6, 2.4),
        "M4": (8.0, 3.1),
        "M5": (9.5, 3.7),
        "M6": (12.0, 4.6),
        "M8": (16.0, 6.0),
        "M10": (20.0, 7.5),
    },
    "button": {
        "M3": (5.7, 1.65),
        "M4": (7.6, 2.2),
        "M5": (9.5, 2.75),
        "M6": (10.5, 3.3),
        "M8": (14.0, 4.4),
        "M10": (17.5, 5.5),
        "M12": (21.0, 6.6),
    },
    "hex": {
        "M2": (4.0, 1.4),
        "M2.5": (5.0, 1.7),
        "M3": (5.5, 2.0),
        "M4": (7.0, 2.8),
        "M5": (8.0, 3.5),
        "M6": (10.0, 4.0),
        "M8": (13.0, 5.3),
        "M10": (16.0, 6.4),
        "M12": (18.0, 7.5),
    },
    # A nut is all head.
    "nut": {
        "M2": (4.0, 1.6),
        "M2.5": (5.0, 2.0),
        "M3": (5.5, 2.4),
        "M4": (7.0, 3.2),
        "M5": (8.0, 4.7),
        "M6": (10.0, 5.2),
        "M8": (13.0, 6.8),
        "M10": (16.0, 8.4),
        "M12": (18.0, 10.8),
    },
}
HEXAGONS: Final = ("hex", "nut")
"""Heads that sockets turn."""

# Clearance of a nut about its bolt, whose thread is not modelled [m].
_NUT_CLEARANCE_M: Final = 2.5e-4
_STEEL_KG_M3: Final = 7850.0
# Keys of a thread, which only a size has.
_THREAD_KEYS = ("head", "length_m", "pitch_m", "engagement_m")


@dataclass(frozen=True, slots=True)
class ScrewHead:
    """Diameter and height of a head [m]."""

    diameter_m: float
    height_m: float


class ScrewConfig(Strict):
    """A screw: its hole and the part that it fastens."""

    tool: ToolName = Field(
        description="the tool that drives it, or a list of tools of which the search takes one"
    )
    hole_m: PlanarOrSpatial = Field(
        description="the mouth of its hole, x y z, or x y: at the top of the part it goes through, "
        "of a screw from below at its underside; a hole in a mesh is found at its rim [m]"
    )
    axis: Direction = Field(
        [0.0, 0.0, -1.0],
        description="direction in the world in which it goes into the hole; left out: straight "
        "down",
    )
    through: Name = Field(description="the part whose top its head rests on")
    into: Names | None = Field(
        None,
        exclude_if=is_absent,
        description="the part or fixture that its thread goes into, or a list of them, which must "
        "be in place before, and which it joins to 'through'; left out: its shank may be in "
        "'through' alone",
    )
    feeder: Name | None = Field(
        None,
        description="the feeder where the tool fetches it; left out: from start_m, or the tool "
        "brings it along",
    )
    start_m: Spatial | None = Field(
        None,
        exclude_if=is_absent,
        description="place of the underside of its head at the start, x y z: it stands upright in "
        "a rack or tray [m]; instead of feeder",
    )
    size: Size | None = Field(
        None,
        exclude_if=is_absent,
        description="size of its thread; head, pitch and mass follow; left out: not stated",
    )
    thread_m: Length | None = Field(
        None,
        exclude_if=is_absent,
        description="diameter of a thread that has none of these sizes, with 'head_diameter_m' and "
        "'head_height_m', which no standard gives then [m]; left out: that of 'size'",
    )
    head: Head | None = Field(
        None,
        exclude_if=is_absent,
        description="type of its head: socket (ISO 4762), pan (ISO 7045), button (ISO 7380-1) or "
        "hex (ISO 4017); or nut (ISO 4032), a hexagon nut that a socket drives onto the bolt in "
        "'into'; left out: socket",
    )
    length_m: Length | None = Field(
        None,
        exclude_if=is_absent,
        description="length of the shank below the head [m]; left out: the shank is not modelled",
    )
    pitch_m: Annotated[float, Field(gt=0, le=0.01)] | None = Field(
        None,
        exclude_if=is_absent,
        description="pitch of its thread [m]; left out: that of the coarse thread of its size",
    )
    engagement_m: Length | None = Field(
        None,
        exclude_if=is_absent,
        description="length over which it is driven in [m]; left out: length of the shank in the "
        "parts of 'into', or the whole shank",
    )
    insert_m: Length | None = Field(
        None,
        exclude_if=is_absent,
        description="length of the straight stretch along its axis to the hole, for a screw that "
        "does not go straight down [m]; left out: its shank, 0.05 at least",
    )
    torque_nm: Torque | None = Field(
        None,
        exclude_if=is_absent,
        description="tightening torque, compared with that of its tool [N m]; left out: not stated",
    )
    hole_depth_m: Length | None = Field(
        None,
        exclude_if=is_absent,
        description="depth of its hole below the mouth, compared with its length [m]; left out: "
        "that of a hole in a mesh, or else not limited",
    )
    head_diameter_m: Extent = Field(
        0.006, description="diameter of the head [m]; with 'size', left out: that of the head"
    )
    head_height_m: Extent = Field(
        0.002, description="height of the head [m]; with 'size', left out: that of the head"
    )
    mass_kg: Mass = Field(
        0.001, description="mass [kg]; with 'size', left out: that of steel with its dimensions"
    )
    durations_s: ScrewDurations | None = Field(
        None,
        exclude_if=is_absent,
        description="dwell times of this screw [s]; left out: dwell of its tool, or of the task",
    )
    count: Count | None = Field(
        None,
        exclude_if=is_absent,
        description="number of such screws, NAME_1, NAME_2 and so on; left out: one, NAME",
    )
    start_in: Name | None = Field(
        None,
        exclude_if=is_absent,
        description="the tray where it stands at the start, in the next free pocket, with its head "
        "on the plate; of a count each goes to the hole of its number; instead of start_m",
    )
    start_pattern: PatternConfig | None = Field(
        None,
        exclude_if=is_absent,
        description="with 'count', places at the start, the first at start_m; left out: all come "
        "from a tray or a feeder, or with the tool",
    )
    hole_pattern: PatternConfig | None = Field(
        None,
        exclude_if=is_absent,
        description="with 'count', the holes, the first at hole_m; left out: one hole",
    )

    other_tools: Annotated[list[Name], Field(min_length=1, max_length=8)] | None = Field(
        None,
        exclude_if=is_absent,
        description="tools that may drive it instead of 'tool', of which the search takes one; "
        "left out: none",
    )
    orientation: Name | None = Field(
        None,
        exclude_if=is_absent,
        description="orientation of its workholder in which it is put in; left out: any",
    )
    optional: bool = Field(
        False,
        exclude_if=is_empty,
        description="it need not be driven, unless 'goal' names it; left out: it must",
    )

    @property
    def tools(self) -> tuple[str, ...]:
        """The tools that may act on it, the preferred one first."""
        return (self.tool, *(self.other_tools or ()))

    @property
    def direction(self) -> Point:
        """Unit vector in the world along which it goes into its hole."""
        return make_unit(self.axis)

    @property
    def into_names(self) -> list[str]:
        """Names of the parts and fixtures that its thread goes into."""
        return list(self.into or ())

    @property
    def diameter_m(self) -> float:
        """Nominal diameter of the thread [m]; 0 if it is not modelled."""
        return self.thread_m or 0.0 if self.size is None else float(self.size[1:]) / 1e3

    @property
    def thread_pitch_m(self) -> float | None:
        """Pitch of the thread [m]; None without a size."""
        if self.pitch_m is not None or self.size is None:
            return self.pitch_m
        return _PITCHES_MM[self.size] / 1e3

    @property
    def standard_head(self) -> ScrewHead | None:
        """Head of the size by its standard; None without a size."""
        if self.size is None:
            return None
        kind = self.head or _DEFAULT_HEAD
        width_mm, height_mm = _HEADS_MM[kind][self.size]
        diameter_mm = width_mm * 2 / math.sqrt(3) if kind in HEXAGONS else width_mm
        return ScrewHead(diameter_mm / 1e3, height_mm / 1e3)

    @property
    def flats_m(self) -> float | None:
        """Width across the flats of a hexagon [m]; None for other heads."""
        if not self.diameter_m or self.head not in HEXAGONS:
            return None
        return self.head_diameter_m * math.sqrt(3) / 2

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """Its head, or the ring of a nut."""
        height_m = self.head_height_m
        if self.head == "nut":
            hole_m = (self.diameter_m / 2 + _NUT_CLEARANCE_M) / math.cos(math.pi / 6)
            return make_ring(hole_m, self.head_diameter_m / 2, 0.0, height_m, 6)
        return (Cylinder(self.head_diameter_m, height_m, (0.0, 0.0, height_m / 2)),)

    @property
    def shank(self) -> Shank | None:
        """Shank below the head; None without a length."""
        if self.length_m is None:
            return None
        return Shank(self.diameter_m, self.length_m, (self.through, *self.into_names))

    def describe(self) -> str:
        """Return its designation, such as ``M4 x 16 socket``; empty without a thread."""
        if not self.diameter_m:
            return ""
        size = self.size or f"{self.diameter_m * 1e3:g} mm"
        length = "" if self.length_m is None else f" x {self.length_m * 1e3:g}"
        return f"{size}{length} {self.head or _DEFAULT_HEAD}"

    @model_validator(mode="after")
    def _require_one_start(self) -> ScrewConfig:
        if self.feeder is not None and self.start_m is not None:
            raise Located("give one of 'feeder' and 'start_m', not both.", "start_m")
        return self

    @model_validator(mode="after")
    def _require_size(self) -> ScrewConfig:
        for key in _THREAD_KEYS:
            if not self.diameter_m and getattr(self, key) is not None:
                raise Located("give 'size', too, such as M4.", key)
        if self.head == "nut":
            return self._check_nut()
        if self.hole_depth_m is not None and self.length_m is None:
            raise Located("give 'length_m', too: it is compared with it.", "hole_depth_m")
        if (self.engagement_m or 0.0) > (self.length_m or math.inf):
            words = f"is more than the shank, {self.length_m:g} m."
            raise Located(words, "engagement_m")
        return self

    def _check_nut(self) -> ScrewConfig:
        for key in ("length_m", "hole_depth_m"):
            if getattr(self, key) is not None:
                raise Located("a nut has no shank. Leave it out.", key)
        if self.into is None:
            raise Located("give 'into', the part with the bolt that it goes on.", "head")
        return self

    @model_validator(mode="after")
    def _take_standard(self) -> ScrewConfig:
        """Fill in the dimensions and the mass that follow from the size."""
        if not self.diameter_m:
            return self
        kind = self.head or _DEFAULT_HEAD
        own = {"head_diameter_m", "head_height_m"} <= self.model_fields_set
        if self.thread_m is not None and (self.size is not None or not own):
            words = "give 'size' instead, or 'head_diameter_m' and 'head_height_m' with it."
            raise Located(words, "thread_m")
        if self.size not in _HEADS_MM[kind] and not own:
            known = ", ".join(_HEADS_MM[kind])
            words = (
                f"{_STANDARDS[kind]} has no {self.size} ({known}). Give 'head_diameter_m' and "
                "'head_height_m', or another head."
            )
            raise Located(words, "head")
        if not own:
            head = self.standard_head
            assert head is not None
            self._fill_in("head_diameter_m", head.diameter_m)
            self._fill_in("head_height_m", head.height_m)
        shank_m3 = self.diameter_m**2 * (self.length_m or 0.0)
        head_m3 = self.head_diameter_m**2 * self.head_height_m
        if self.head == "nut":
            head_m3 -= self.diameter_m**2 * self.head_height_m
        self._fill_in("mass_kg", round(_STEEL_KG_M3 * math.pi / 4 * (shank_m3 + head_m3), 6))
        if self.head_diameter_m <= self.diameter_m:
            words = f"is not wider than the thread, {self.diameter_m:g} m."
            raise Located(words, "head_diameter_m")
        return self

    def _fill_in(self, key: str, value: float) -> None:
        """Set a key that the file leaves out."""
        if key not in self.model_fields_set:
            # Assigning to a frozen model fails.
            object.__setattr__(self, key, value)

    @model_validator(mode="after")
    def _need_no_stretch_down(self) -> ScrewConfig:
        if self.insert_m is not None and make_unit(self.axis) == DOWN:
            message = "a screw that goes straight down comes along its axis anyway. Leave it out."
            raise Located(message, "insert_m")
        return self

    @model_validator(mode="after")
    def _require_height_of_oblique_hole(self) -> ScrewConfig:
        upright = is_same_direction(make_unit(self.axis), UP)
        if len(self.hole_m) < 3 and make_unit(self.axis) != DOWN and not upright:
            message = "give the hole x y z [m], as its axis is neither straight down nor up."
            raise Located(message, "hole_m")
        return self
