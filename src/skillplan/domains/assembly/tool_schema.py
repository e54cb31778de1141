"""YAML schema of the tools of the changer, and of the works of presses and dispensers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise, product
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import Field, ValidationError, ValidationInfo, model_validator

from skillplan.domains.assembly.part_schema import Names, Shaped
from skillplan.domains.assembly.schema_types import (
    Angles,
    Extents,
    Height,
    Length,
    Planar,
    Spatial,
    ToolDurations,
    is_absent,
)
from skillplan.domains.assembly.tool_models import TOOLS, ToolFileError, read_tool_model
from skillplan.domains.domain import Name, Strict
from skillplan.files.schema_errors import Located, continue_sentence, list_schema_issues, shown
from skillplan.robots.arm_description import Hand, JawProfile
from skillplan.task.motion import AXES
from skillplan.task.pose import Point, Pose, plus
from skillplan.task.scene import STANDARD_BIT_M, STANDARD_CUP_M, ToolKind, find_cup_height_m
from skillplan.task.shape import Box, Cylinder, Mesh, Shape, make_ring, move_shape

SAFETY_FACTOR: Final = 2.0
"""Safety factor of suction for parts that are not smooth and dense (Schmalz, holding forces)."""

ACCELERATION_M_PER_S2: Final = 5.0
"""Acceleration of a part at a suction tool that a task does not give."""

# Greatest distance of a cup from the place opposite to another one [m].
_OPPOSITE_M: Final = 1e-6
# Outer diameter of a socket and its depth about a hexagon, in widths of that: the heads of ISO 4017
# are 0.35 to 0.44 high. Its play about the corners [m], and its number of pieces.
_SOCKET_WIDTHS, _SOCKET_BELOW, _SOCKET_PLAY_M, _SOCKET_SIDES = 1.5, 0.33, 3e-4, 12
# Sides of the prism about a cylinder.
_SIDES: Final = 16
# Keys of a tool file that a task's own key replaces.
_INSTEAD: Final = {"jaw_profile_m": "fingers", "fingers": "jaw_profile_m", "envelope_m": "body"}
JawRow = Annotated[list[Annotated[float, Field(ge=0, le=1)]], Field(min_length=4, max_length=4)]


class ToolConfig(Strict):
    """A tool of the changer."""

    # Its keys are in the hash one by one.
    model: Annotated[str, Field(min_length=1, max_length=4096)] | None = Field(
        None,
        exclude=True,
        description=f"{', '.join(TOOLS)}, or a file of a tool in the task file's folder, or in a "
        "folder of it; the keys given here come first; left out: none",
    )
    type: Literal["gripper", "suction", "screwdriver", "press", "dispenser"] | None = Field(
        None, description="its type; left out: screwdriver if it only drives screws, else gripper"
    )
    opening_m: Length | None = Field(
        None,
        description="greatest distance between the jaws of a gripper [m]; left out: not modelled",
    )
    clearance_m: Annotated[float, Field(ge=0, le=0.04)] | None = Field(
        None,
        exclude_if=is_absent,
        description="clearance of the open jaws of a gripper on each side of a part [m]; left out: "
        "option 'clearance_m' of the back end",
    )
    force_n: Annotated[float, Field(gt=0, le=10_000)] | None = Field(
        None,
        description="greatest force of a gripper, suction cup or press [N]; left out: default of "
        "the engine",
    )
    jaw_profile_m: Annotated[list[JawRow], Field(min_length=2, max_length=32)] | None = Field(
        None,
        description="a jaw of a gripper from its end upwards, as rows of: height above the end, "
        "half its width, and how far behind its face it begins and ends [m]; convex between; left "
        "out: that of the arm's hand",
    )
    cup_diameter_m: Annotated[float, Field(ge=5e-4, le=0.2)] | None = Field(
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
        description="length of the bit of a screwdriver, the ram of a press or the needle of a "
        "dispenser below its body [m]; left out: 0.04",
    )
    bit_diameter_m: Annotated[float, Field(ge=5e-4, le=0.1)] | None = Field(
        None,
        exclude_if=is_absent,
        description="diameter of that bit, ram or needle [m]; left out: 0.005",
    )
    socket_m: Annotated[float, Field(ge=2e-3, le=0.1)] | None = Field(
        None,
        exclude_if=is_absent,
        description="width across the flats of the hexagon that the socket of a screwdriver takes "
        "[m]; it turns nuts and hexagon heads, its outer diameter is 'bit_diameter_m', left out: "
        "1.5 times the width; left out: a bit",
    )
    socket_depth_m: Annotated[float, Field(ge=1e-4, le=0.1)] | None = Field(
        None,
        exclude_if=is_absent,
        description="depth of that socket about a nut or head, less than its height [m]; left out: "
        "0.33 times the width",
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
    fingers: Shaped | None = Field(
        None,
        exclude_if=is_absent,
        description="a finger of a gripper, in the keys of a part's shape: x from its face "
        "outwards, y across, z from its end up; instead of 'jaw_profile_m'",
    )
    body: Shaped | None = Field(
        None,
        exclude_if=is_absent,
        description="shape of the tool above its fingers, cups or bit, in the keys of a part's "
        "shape, from where these end: x along the closing axis, z towards the flange; left out: "
        "the body of the arm's hand, and a shank of other tools",
    )
    cups_m: Annotated[list[Planar], Field(min_length=1, max_length=64)] | None = Field(
        None,
        exclude_if=is_absent,
        description="centres of the cups of a suction tool from its axis, x y [m]; each has its "
        "opposite; left out: one on the axis",
    )
    safety_factor: Annotated[float, Field(ge=1, le=20)] | None = Field(
        None,
        exclude_if=is_absent,
        description="of a suction tool, holding force 'force_n' over the force that a part needs, "
        f"at least; left out: {SAFETY_FACTOR:g} [-]",
    )
    acceleration_m_per_s2: Annotated[float, Field(ge=0, le=1000)] | None = Field(
        None,
        exclude_if=is_absent,
        description="greatest acceleration of a part that the suction tool holds [m/s2]; left out: "
        f"{ACCELERATION_M_PER_S2:g}",
    )
    outer_grip_m: Annotated[list[Height], Field(min_length=2, max_length=2)] | None = Field(
        None,
        exclude_if=is_absent,
        description="least and greatest width of a part that a gripper holds from outside [m]; "
        "left out: from 0 to its opening",
    )
    inner_grip_m: Annotated[list[Height], Field(min_length=2, max_length=2)] | None = Field(
        None,
        exclude_if=is_absent,
        description="least and greatest width of a hole that a gripper holds from inside [m]; left "
        "out: from the thickness of both fingers, opened as wide as they do",
    )
    mounted_on: Name | None = Field(
        None,
        exclude_if=is_absent,
        description="the tool on whose hand it is, too: both are attached at once, and no tool "
        "change is between them; left out: it has a holder of its own",
    )
    mount_m: Spatial | None = Field(
        None,
        exclude_if=is_absent,
        description="place of its own flange on that of the hand that it is on: x along the "
        "closing axis, z out of the flange [m]; left out: 0 0 0",
    )
    mount_rpy_rad: Angles | None = Field(
        None,
        exclude_if=is_absent,
        description="turn of its own flange there, about x, then y, then z [rad]; left out: none",
    )
    holder_m: Planar | None = Field(
        None,
        description="place of its holder, x y [m], needed unless it is on the hand of another "
        "tool; left out: it has none",
    )
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

    @model_validator(mode="before")
    @classmethod
    def _read_model(cls, data: Any, info: ValidationInfo) -> Any:
        """Add the keys of a tool file that the task does not give."""
        name = data.get("model") if isinstance(data, dict) else None
        if not isinstance(name, str):
            return data
        folder = Path((info.context or {}).get("folder", Path()))
        try:
            facts = read_tool_model(folder, name).keys
        except ToolFileError as error:
            raise Located(f"{shown(name)}: {continue_sentence(str(error))}", "model") from None
        if name not in TOOLS:
            cls._check_alone(name, facts, info)
        instead = {_INSTEAD.get(key) for key in data}
        return {**{key: value for key, value in facts.items() if key not in instead}, **data}

    @classmethod
    def _check_alone(cls, name: str, facts: Mapping[str, Any], info: ValidationInfo) -> None:
        """Raise the faults of a tool file under the key that names it."""
        try:
            cls.model_validate({**facts, "holder_m": [0.0, 0.0]}, context=info.context)
        except ValidationError as error:
            issues = "; ".join(map(str, list_schema_issues(error, cls)))
            raise Located(f"{shown(name)}: {issues}", "model") from None

    @model_validator(mode="after")
    def _has_one_place(self) -> ToolConfig:
        if self.mounted_on is None:
            for key in ("mount_m", "mount_rpy_rad"):
                if getattr(self, key) is not None:
                    raise Located("needs 'mounted_on', the tool on whose hand it is.", key)
            if self.holder_m is None:
                raise Located("key 'holder_m' is missing: place of its holder, x y [m].")
            return self
        for key in ("holder_m", "holder_height_m"):
            if key in self.model_fields_set:
                raise Located("is that of the tool that it is mounted on. Leave it out.", key)
        if self.mass_kg is None:
            raise Located("key 'mass_kg' is missing: mass that it adds to the hand [kg].")
        if self.envelope_m is not None:
            raise Located(
                "give 'body' instead: a mounted tool is checked by its shapes.", "envelope_m"
            )
        return self

    @model_validator(mode="after")
    def _cups_are_opposite(self) -> ToolConfig:
        for number, (x_m, y_m) in enumerate(self.cups):
            if all(math.hypot(x_m + x, y_m + y) > _OPPOSITE_M for x, y in self.cups):
                words = (
                    f"no cup is opposite to [{x_m:g}, {y_m:g}], at [{-x_m:g}, {-y_m:g}]. Add one: "
                    "a hand may turn by half a turn."
                )
                raise Located(words, "cups_m", number)
        return self

    @model_validator(mode="after")
    def _fingers_begin_at_their_end(self) -> ToolConfig:
        if self.fingers is None:
            return self
        if self.jaw_profile_m is not None:
            raise Located("give 'fingers' or 'jaw_profile_m'.", "fingers")
        boxes = self.fingers.bounding_boxes
        behind_m, low_m = (min(_span(box, axis)[0] for box in boxes) for axis in (0, 2))
        if abs(behind_m) > _OPPOSITE_M or abs(low_m) > _OPPOSITE_M:
            words = (
                f"begins {behind_m:g} m behind its face and {low_m:g} m above its end, not at 0. "
                "Shift it: boxes and meshes have 'centre_m'."
            )
            raise Located(words, "fingers")
        return self

    @model_validator(mode="after")
    def _socket_has_walls(self) -> ToolConfig:
        if self.socket_m is None:
            if self.socket_depth_m is not None:
                raise Located("give 'socket_m', too, or leave it out.", "socket_depth_m")
            return self
        if self.type != "screwdriver":
            raise Located("only a screwdriver has a socket. Give type: screwdriver.", "socket_m")
        if self.body is None:
            raise Located("give 'body', too, the shape of the tool above its socket.", "socket_m")
        least_m = 2 * (self.socket_m / math.sqrt(3) + 2 * _SOCKET_PLAY_M)
        if self.bit_diameter_m is not None and self.bit_diameter_m < least_m:
            words = f"is no socket about {self.socket_m:g} m. Give {least_m:.4f} or more."
            raise Located(words, "bit_diameter_m")
        return self

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
        x_m, y_m = self.holder_m or (0.0, 0.0)
        # The rim of a socket is below its tip.
        return (x_m, y_m, self.holder_height_m + self.socket_below_m)

    @property
    def socket_below_m(self) -> float:
        """Depth of the socket below the tip [m]; 0 without one."""
        return self.socket_depth_m or _SOCKET_BELOW * (self.socket_m or 0.0)

    @property
    def bit_m(self) -> tuple[float, float] | None:
        """Length and diameter of the bit [m]; None for the standard one."""
        if self.bit_length_m is None and self.bit_diameter_m is None:
            return None
        length_m = STANDARD_BIT_M[0] if self.bit_length_m is None else self.bit_length_m
        diameter_m = STANDARD_BIT_M[1] if self.bit_diameter_m is None else self.bit_diameter_m
        return (length_m, diameter_m)

    @property
    def cups(self) -> tuple[tuple[float, float], ...]:
        """Centres of the cups from the axis [m]."""
        return tuple((x, y) for x, y in self.cups_m or [[0.0, 0.0]])

    @property
    def outer_m(self) -> tuple[float, float] | None:
        """Least and greatest width that a gripper holds from outside [m], if given."""
        return None if self.outer_grip_m is None else (self.outer_grip_m[0], self.outer_grip_m[1])

    def measure_end_m(self, kind: ToolKind, hand: Hand) -> float:
        """Return the height above its tip at which fingers, cups or bit end [m]."""
        if kind is ToolKind.SUCTION:
            return find_cup_height_m(self.cup_diameter_m or STANDARD_CUP_M)
        if kind is not ToolKind.GRIPPER:
            return (self.bit_m or STANDARD_BIT_M)[0]
        if self.fingers is not None:
            return self.fingers.height_m
        return (self.jaw_profile_m or hand.jaw_m)[-1][0]

    def measure_length_m(self, kind: ToolKind, hand: Hand) -> float:
        """Return the distance from the flange to its tip [m]."""
        own_m = hand.tip_on_flange.xyz_m[2]
        if self.length_m is not None:
            return self.length_m
        if self.body is not None:
            return self.measure_end_m(kind, hand) + self.body.height_m
        if self.fingers is not None and kind is ToolKind.GRIPPER:
            return own_m + self.fingers.height_m - hand.jaw_m[-1][0]
        return own_m

    def measure_beyond_m(self, kind: ToolKind, hand: Hand) -> float:
        """Return the distance of its tip beyond the jaws' ends of the arm's hand [m]."""
        length_m, own_m = self.measure_length_m(kind, hand), hand.tip_on_flange.xyz_m[2]
        return 0.0 if length_m == own_m else length_m - own_m

    def find_mount(self, kind: ToolKind, hand: Hand) -> Pose | None:
        """Return the pose of its tip in the frame of the arm's tip, if it is mounted."""
        if self.mounted_on is None:
            return None
        roll, pitch, yaw = self.mount_rpy_rad or (0.0, 0.0, 0.0)
        x_m, y_m, z_m = self.mount_m or (0.0, 0.0, 0.0)
        flange = Pose.turned((x_m, y_m, z_m), (roll, pitch, yaw))
        tip = flange.apply((0.0, 0.0, self.measure_length_m(kind, hand)))
        # From axes with x along the closing axis to axes with y along it.
        own_m = (0.0, 0.0, hand.tip_on_flange.xyz_m[2])
        y, z = (_to_arm(flange.rotate(axis)) for axis in (AXES["x"], AXES["z"]))
        return Pose.of_axes(_to_arm(plus(tip, own_m, -1.0)), y, z)

    def hand_on(self, hand: Hand) -> Hand | None:
        """Return the hand that this gripper replaces the arm's hand by, or None."""
        beyond_m = self.measure_beyond_m(ToolKind.GRIPPER, hand)
        own = (self.jaw_profile_m, self.fingers, self.body)
        if own == (None, None, None) and not beyond_m:
            return None
        changes: dict[str, Any] = {
            "opening_m": self.opening_m or hand.opening_m,
            "force_n": self.force_n if self.force_n is not None else hand.force_n,
            "tip_m": hand.tip_m + beyond_m,
            "beyond_m": beyond_m,
        }
        jaw = hand.jaw_m
        if self.jaw_profile_m is not None:
            jaw = tuple((row[0], row[1], row[2], row[3]) for row in self.jaw_profile_m)
        if self.fingers is not None:
            pieces = self.fingers.convex_shapes
            jaw = _outline_fingers([piece.box for piece in pieces])
            changes["jaw_pieces_m"] = tuple(map(list_shape_corners, pieces))
        elif self.body is None and beyond_m > 0:
            # The fingers reach up to the hand.
            height_m, *section = jaw[-1]
            jaw = (*jaw, (height_m + beyond_m, section[0], section[1], section[2]))
        if jaw != hand.jaw_m:
            changes |= {"jaw_m": jaw, "jaw_corners_m": ()}
        if self.body is not None:
            begins_m = hand.tip_m + beyond_m - jaw[-1][0]
            changes |= _place_body(self.body.convex_shapes, begins_m)
        return replace(hand, **changes)

    def _list_socket_shapes(self) -> Iterator[Shape]:
        """Yield a socket from its tip, which is on the hexagon in it, and its extension."""
        if self.socket_m is None:
            return
        length_m, _ = self.bit_m or STANDARD_BIT_M
        outer_m = (self.bit_diameter_m or _SOCKET_WIDTHS * self.socket_m) / 2
        inner_m = self.socket_m / math.sqrt(3) + _SOCKET_PLAY_M
        flat = math.cos(math.pi / _SOCKET_SIDES)
        inside_m = min(self.socket_m, length_m / 2)
        corners_m = inner_m / flat, outer_m / flat
        yield from make_ring(*corners_m, -self.socket_below_m, inside_m, _SOCKET_SIDES)
        yield Cylinder(2 * outer_m, length_m - inside_m, (0.0, 0.0, (inside_m + length_m) / 2))

    def list_shapes(self, kind: ToolKind, hand: Hand) -> tuple[Shape, ...]:
        """Return the convex shapes of the body from its tip, each with its half turn."""
        if self.body is None or kind is ToolKind.GRIPPER:
            return ()
        above = Pose((0.0, 0.0, self.measure_end_m(kind, hand)))
        shapes = [
            *self._list_socket_shapes(),
            *(move_shape(shape, above) for shape in self.body.convex_shapes),
        ]
        # A hand may be turned by half a turn, and the tool with it.
        return tuple(dict.fromkeys([*shapes, *map(_turn_shape, shapes)]))


class WorkConfig(Strict):
    """A press that pushes on a part, or a dispenser that puts a bead or drop on it."""

    tool: Name = Field(description="its tool, of type press or dispenser")
    part: Name = Field(description="the part on whose top it acts, which is at its goal then")
    at_m: Planar | None = Field(
        None, description="place, x y [m]; instead of path_m; on the top of the part"
    )
    path_m: Annotated[list[Planar], Field(min_length=2, max_length=64)] | None = Field(
        None, description="corners of the path of a dispenser, x y [m]; instead of at_m"
    )
    before: Names | None = Field(
        None, description="parts and screws that come after it; left out: none"
    )
    force_n: Annotated[float, Field(gt=0, le=10_000)] | None = Field(
        None,
        description="force of a press, at most that of its tool [N]; left out: a dispenser has "
        "none",
    )
    speed_m_per_s: Annotated[float, Field(ge=1e-4, le=10)] = Field(
        0.05, description="speed of a dispenser along its path [m/s]"
    )
    gap_m: Annotated[float, Field(ge=0, le=0.1)] = Field(
        0.001, description="gap between the needle of a dispenser and the part [m]"
    )
    orientation: Name | None = Field(
        None,
        exclude_if=is_absent,
        description="orientation of the part's workholder in which it is done, from above, at the "
        "place that at_m or path_m gives in the first one; left out: the first",
    )
    dwell_s: Annotated[float, Field(ge=0, le=1e6)] = Field(
        1.0, description="time of a press at its force, or of a dispenser at the place [s]"
    )

    @model_validator(mode="after")
    def _one_place(self) -> WorkConfig:
        if (self.at_m is None) == (self.path_m is None):
            raise Located("give one of 'at_m' and 'path_m'.")
        return self

    @property
    def corners(self) -> list[tuple[float, float]]:
        """Corners of the path, or the one place, x y [m]."""
        return [(x, y) for x, y in self.path_m or [self.at_m or [0.0, 0.0]]]


def _outline_fingers(boxes: Sequence[Box]) -> JawProfile:
    """Return the outline of a finger about the boxes of its pieces, from its end upwards."""
    heights = sorted({round(height, 9) for box in boxes for height in _span(box, 2)})
    rows = []
    for low_m, high_m in pairwise(heights):
        middle_m = (low_m + high_m) / 2
        spans = [box for box in boxes if _span(box, 2)[0] < middle_m < _span(box, 2)[1]]
        if spans:
            half_m = max(max(map(abs, _span(box, 1))) for box in spans)
            begin_m, end_m = (
                min(_span(box, 0)[0] for box in spans),
                max(_span(box, 0)[1] for box in spans),
            )
            rows += [(low_m, half_m, begin_m, end_m), (high_m, half_m, begin_m, end_m)]
    return tuple(rows)


def _to_arm(vector: Point) -> Point:
    x, y, z = vector
    return (0.0 - y, x, z)


def _span(box: Box, axis: int) -> tuple[float, float]:
    middle_m, half_m = box.centre[axis], box.size[axis] / 2
    return middle_m - half_m, middle_m + half_m


def _place_body(shapes: Sequence[Shape], begins_m: float) -> dict[str, Any]:
    """Return the fields of a hand for a body that begins at a depth in the hand's frame [m]."""
    pieces = tuple(
        tuple((x_m, y_m, begins_m - z_m) for x_m, y_m, z_m in list_shape_corners(shape))
        for shape in shapes
    )
    corners = [corner for piece in pieces for corner in piece]
    length_m = max(abs(x_m) for x_m, _, _ in corners)
    width_m = max(abs(y_m) for _, y_m, _ in corners)
    depths_m = [depth_m for _, _, depth_m in corners]
    rows = tuple((depth_m, length_m, width_m) for depth_m in (max(depths_m), min(depths_m)))
    return {"body_m": rows, "body_corners_m": (), "body_pieces_m": pieces}


def list_shape_corners(shape: Shape) -> tuple[Point, ...]:
    """Return the corners of a convex shape [m]; a cylinder becomes a prism about it."""
    if isinstance(shape, Mesh):
        return shape.corners
    if isinstance(shape, Box):
        return tuple(product(_span(shape, 0), _span(shape, 1), _span(shape, 2)))
    radius_m = shape.diameter_m / 2 / math.cos(math.pi / _SIDES)
    turns = [2 * math.pi * side / _SIDES for side in range(_SIDES)]
    x_m, y_m, _ = shape.centre
    return tuple(
        (x_m + radius_m * math.cos(turn), y_m + radius_m * math.sin(turn), z_m)
        for turn in turns
        for z_m in _span(shape.box, 2)
    )


def _turn_shape(shape: Shape) -> Shape:
    """Return a shape after half a turn about the axis of the tool."""
    if isinstance(shape, Mesh):
        return replace(shape, corners=tuple((-x, -y, z) for x, y, z in shape.corners))
    x_m, y_m, z_m = shape.centre
    return replace(shape, centre=(0.0 - x_m, 0.0 - y_m, z_m))
