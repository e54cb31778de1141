"""The arms that task files name, each with the hand on its flange.

Every arm is a file of data in the folder ``arms``, with its sources: lengths, limits, speeds and
payload of data sheets, and shapes of our own. A file is read when its arm is first used.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Final

from skillplan.robots.arm_description import (
    ArmDescription,
    Hand,
    Joint,
    LinkInertia,
    Transform,
    build_hulls,
    read_data,
)
from skillplan.robots.panda_hand import PANDA_HAND

STANDARD_HAND: Final = replace(PANDA_HAND, on_flange=Transform())
"""Hand of arms that are sold without one: its closing axis is y of the flange."""

DEFAULT_ARM: Final = "panda"
"""Default arm of a task."""

_FOLDER: Final = Path(__file__).with_name("arms")
_HANDS: Final = {"panda": PANDA_HAND, "fr3": PANDA_HAND}
# Time to the top speed of a joint whose acceleration is not published [s].
_RAMP_S: Final = 0.25


class _Catalogue(Mapping[str, tuple[ArmDescription, Hand]]):
    """Arms and hands by name; only access to an arm reads its file."""

    def __getitem__(self, name: str) -> tuple[ArmDescription, Hand]:
        if name not in self:
            raise KeyError(name)
        return _read_arm(name), _HANDS.get(name, STANDARD_HAND)

    def __contains__(self, name: object) -> bool:
        return name in _list_names()

    def __iter__(self) -> Iterator[str]:
        return iter(_list_names())

    def __len__(self) -> int:
        return len(_list_names())


@cache
def _list_names() -> tuple[str, ...]:
    """Return the names of all arms, the default first."""
    names = {path.stem for path in _FOLDER.glob("*.json")}
    return (DEFAULT_ARM, *sorted(names - {DEFAULT_ARM}))


@cache
def _read_arm(name: str) -> ArmDescription:
    data = read_data(f"arms/{name}.json")
    joints, flange = _build_joints(data)
    swing = data.get("swing")
    return ArmDescription(
        name=data["name"],
        joints=joints,
        tip=flange,
        home_rad=tuple(_read_angles(data, "home")),
        shapes=build_hulls(data["hulls_mm"]),
        reach_m=data["reach_m"],
        swing=swing and (int(swing[0]), int(swing[1]), int(swing[2])),
        payload_kg=data["payload_kg"],
    )


def _build_joints(data: dict[str, Any]) -> tuple[tuple[Joint, ...], Transform]:
    """Return the joints of a file, and the flange in the frame of the last joint."""
    count = len(data["joints"])
    placements, ends = _place_joints(data, count)
    axes = data.get("axes", [(0.0, 0.0, 1.0)] * count)
    ranges = _read_angles(data, "range")
    speeds = _read_angles(data, "speed", "_per_s")
    accelerations = _read_angles(data, "acceleration", "_per_s2") or [
        speed / _RAMP_S for speed in speeds
    ]
    torques = data.get("torque_nm", [None] * count)
    links = data.get("links", [None] * count)
    joints = tuple(
        Joint(
            data["joints"][number],
            placements[number],
            ranges[number][0],
            ranges[number][1],
            speeds[number],
            accelerations[number],
            torques[number],
            _build_link(links[number], ends[number]),
            tuple(axes[number]),
        )
        for number in range(count)
    )
    return joints, placements[-1]


def _place_joints(data: dict[str, Any], count: int) -> tuple[list[Transform], list[Transform]]:
    """Return the frames of all joints and the flange, and the frames of the links' masses."""
    if "standard_dh" in data:
        ends = [_turn(Transform.from_standard_dh, row) for row in data["standard_dh"]]
        # Each row ends at the next joint, and there masses are given.
        return [Transform(), *ends], ends
    flange = _turn(_make_frame, data["flange"])
    if "modified_dh" in data:
        rows = [_turn(Transform.from_modified_dh, row) for row in data["modified_dh"]]
    else:
        rows = [_turn(_make_frame, row) for row in data["frames"]]
    return [*rows, flange], [Transform()] * count


def _make_frame(x_m: float, y_m: float, z_m: float, *rpy_rad: float) -> Transform:
    roll, pitch, yaw = rpy_rad
    return Transform((x_m, y_m, z_m), (roll, pitch, yaw))


def _turn(make: Any, row: Sequence[float]) -> Transform:
    """Return a transform from lengths [m] and, at the end of the row, angles [degrees]."""
    lengths = 3 if len(row) == 6 else 2
    frame: Transform = make(*row[:lengths], *(math.radians(angle) for angle in row[lengths:]))
    return frame


def _read_angles(data: dict[str, Any], key: str, suffix: str = "") -> Any:
    """Return the values of a column in radians; None if the file has no such column."""
    if f"{key}_rad{suffix}" in data:
        return data[f"{key}_rad{suffix}"]
    return _to_radians(data.get(f"{key}_deg{suffix}"))


def _to_radians(values: Any) -> Any:
    if isinstance(values, list):
        return [_to_radians(value) for value in values]
    return None if values is None else math.radians(values)


def _build_link(row: Sequence[float] | None, frame: Transform) -> LinkInertia | None:
    """Return the mass of a link from its row: mass, centre, and xx, yy, zz, xy, xz, yz."""
    if row is None:
        return None
    mass_kg, x_m, y_m, z_m, xx, yy, zz, xy, xz, yz = row
    return LinkInertia(mass_kg, (x_m, y_m, z_m), (xx, yy, zz, xy, xz, yz), frame)


ARMS: Final[Mapping[str, tuple[ArmDescription, Hand]]] = _Catalogue()
"""Arm and hand by the name of the arm."""

PANDA: Final = ARMS["panda"][0]
"""The Franka Emika Panda without its hand; its tip is the flange."""

UR5E: Final = ARMS["ur5e"][0]
"""The Universal Robots UR5e; its tip is the tool flange."""

DEFAULT_MODEL, DEFAULT_HAND = ARMS[DEFAULT_ARM]
"""Description of the default arm, and the hand on its flange."""
