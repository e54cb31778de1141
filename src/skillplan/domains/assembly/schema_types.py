"""Types of keys that several sections share: places, lengths, directions, grasps, dwell times.

A dwell time is the time of the hand at a target, without travels and strokes. That of a part or
screw comes first, then that of its tool, then that of the task.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal, Protocol

from pydantic import AfterValidator, Discriminator, Field, Tag

from skillplan.domains.domain import Strict
from skillplan.files.schema_errors import ONE, SEVERAL, WORD, Located
from skillplan.task.pose import Point

Coordinate = Annotated[float, Field(ge=-10, le=10)]
Planar = Annotated[list[Coordinate], Field(min_length=2, max_length=2)]
Spatial = Annotated[list[Coordinate], Field(min_length=3, max_length=3)]
PlanarOrSpatial = Annotated[list[Coordinate], Field(min_length=2, max_length=3)]
# A box thinner than a micrometre has no volume.
Extent = Annotated[float, Field(ge=1e-6, le=10)]
Length = Annotated[float, Field(gt=0, le=10)]
ReleaseHeight = Annotated[float, Field(gt=0, le=0.03)]
Extents = Annotated[list[Extent], Field(min_length=3, max_length=3)]
Height = Annotated[float, Field(ge=0, le=10)]
Angle = Annotated[float, Field(ge=-6.2832, le=6.2832)]
Angles = Annotated[list[Angle], Field(min_length=3, max_length=3)]


# Least length of a direction before it is normalised.
_NO_LENGTH = 1e-6

_Component = Annotated[float, Field(ge=-1000, le=1000)]


def _require_length(vector: list[float]) -> list[float]:
    if math.hypot(*vector) < _NO_LENGTH:
        raise Located(
            "is a vector of length 0, which is no direction. Give one such as [0, 0, -1]."
        )
    return vector


Direction = Annotated[
    list[_Component], Field(min_length=3, max_length=3), AfterValidator(_require_length)
]
"""Three numbers, not all 0; only their ratio matters."""


def _select_form(value: Any) -> str:
    """Return the form of a list of directions."""
    return SEVERAL if isinstance(value, list) and any(isinstance(v, list) for v in value) else ONE


Directions = Annotated[
    Annotated[Direction, Tag(ONE)]
    | Annotated[list[Direction], Field(min_length=1, max_length=16), Tag(SEVERAL)],
    Discriminator(_select_form),
]
"""A direction, or a list of them."""

Axis = Annotated[
    Annotated[Literal["x", "y", "z", "auto"], Tag(WORD)] | Annotated[Direction, Tag(ONE)],
    Discriminator(lambda value: ONE if isinstance(value, list) else WORD),
]
"""An axis of a part by name, or a direction."""


def is_absent(value: Any) -> bool:
    """Return True if a key is left out: such files keep the hash of earlier versions."""
    return value is None


def _is_outer(value: Any) -> bool:
    return bool(value == "outer")


class GraspConfig(Strict):
    """A grasp of a part."""

    type: Literal["jaws", "suction"] | None = Field(
        None, description="between jaws, or by suction; left out: as its tool does"
    )
    approach: Direction = Field(
        [0.0, 0.0, -1.0],
        description="direction in the part's frame in which the hand points; left out: from the "
        "part's top, [0, 0, -1]",
    )
    hold: Literal["outer", "inner", "wall"] = Field(
        "outer",
        exclude_if=_is_outer,
        description="outer: jaws close about the part; inner: they open inside a hole; wall: they "
        "close about one wall, as of a ring, at 'at_m' or else on the far side",
    )
    closing_axis: Axis = Field(
        "auto",
        description="axis of the part along which jaws close, or a direction in its frame; auto: "
        "the narrower direction",
    )
    depth_m: Extent | None = Field(
        None,
        description="depth of the fingers below the part's top, seen from the hand [m]; left "
        "out: half of the held height, 0.012 at most",
    )
    width_m: Extent | None = Field(
        None,
        exclude_if=is_absent,
        description="distance of the jaws when they hold it, which is the part's thickness at "
        "'at_m', or of their outer faces inside a hole [m]; left out: extent of the held shapes, "
        "or measured on the wall or the hole",
    )
    at_m: PlanarOrSpatial | None = Field(
        None,
        description="place of the hand's tip, x y from the centre of the part's bottom [m]; a "
        "hand that does not come from the part's top needs x y z of a point on its axis; left out: "
        "over that centre for suction from the top, else in the middle of the held shapes",
    )


def _select_grasp_form(value: Any) -> str:
    """Return the form of a grasp."""
    if isinstance(value, str):
        return WORD
    return SEVERAL if isinstance(value, list) else ONE


Grasps = Annotated[
    Annotated[GraspConfig, Tag(ONE)]
    | Annotated[list[GraspConfig], Field(min_length=1, max_length=32), Tag(SEVERAL)]
    | Annotated[Literal["auto"], Tag(WORD)],
    Discriminator(_select_grasp_form),
]
"""One grasp, several to choose from, or ``auto``."""


def make_point(values: list[float]) -> Point:
    """Return three numbers as a point."""
    x, y, z = values
    return (x, y, z)


def make_unit(vector: list[float]) -> Point:
    """Return a unit vector in the direction of three numbers."""
    # A unit vector stays the same bit for bit.
    length = math.hypot(*vector)
    x, y, z = vector if abs(length - 1) < 1e-12 else (value / length for value in vector)
    return (x + 0.0, y + 0.0, z + 0.0)


Duration = Annotated[float, Field(ge=0, le=86_400)]
_FETCH_S = 1.0
_NEXT = "left out: dwell of its tool, or of the task"
_LAST = "left out: dwell of the task"


def is_empty(value: Any) -> bool:
    """Return True if a section is left out or empty, as `is_absent`."""
    return not value


def _is_usual(value: float) -> bool:
    return value == _FETCH_S


class DurationsConfig(Strict):
    """Dwell times of the task, if neither part, screw nor tool gives one."""

    pick: Duration = Field(3.0, description="close the jaws on a part, or draw it by suction [s]")
    place: Duration = Field(3.0, description="let go of a part where it belongs [s]")
    load: Duration = Field(5.0, description="attach a tool [s]")
    offload: Duration = Field(
        5.0, description="put a tool back, also as the first half of a swap [s]"
    )
    fetch: Duration = Field(
        _FETCH_S, exclude_if=_is_usual, description="take a screw from its feeder [s]"
    )
    fasten: Duration = Field(8.0, description="drive a screw [s]")


class PartDurations(Strict):
    """Dwell times of one part."""

    pick: Duration | None = Field(None, description=f"close the jaws on it [s]; {_NEXT}")
    place: Duration | None = Field(None, description=f"let go of it at its goal [s]; {_NEXT}")


class ScrewDurations(Strict):
    """Dwell times of one screw."""

    fetch: Duration | None = Field(None, description=f"take it from its feeder [s]; {_NEXT}")
    fasten: Duration | None = Field(None, description=f"drive it [s]; {_NEXT}")


class ToolDurations(Strict):
    """Dwell times with one tool."""

    pick: Duration | None = Field(None, description=f"close it on a part [s]; {_LAST}")
    place: Duration | None = Field(None, description=f"let go of a part [s]; {_LAST}")
    load: Duration | None = Field(None, description=f"attach it [s]; {_LAST}")
    offload: Duration | None = Field(None, description=f"put it back [s]; {_LAST}")
    fetch: Duration | None = Field(None, description=f"take a screw from a feeder [s]; {_LAST}")
    fasten: Duration | None = Field(None, description=f"drive a screw [s]; {_LAST}")


class _Dwells(Protocol):
    """A part, a screw or a tool with optional dwell times."""

    @property
    def durations_s(self) -> Strict | None: ...


def find_dwell_s(kind: str, task: DurationsConfig, *owners: _Dwells) -> float:
    """Return a dwell time [s].

    Parameters
    ----------
    owners
        Part or screw, and tool: the first owner with the dwell time decides.
    """
    given = (getattr(owner.durations_s, kind, None) for owner in owners)
    taken_s: float = next((value for value in given if value is not None), getattr(task, kind))
    return taken_s


def list_given_kinds(owner: _Dwells) -> Iterator[str]:
    """Yield the keys of the dwell times that a part, a screw or a tool gives."""
    for kind in DurationsConfig.model_fields:
        if getattr(owner.durations_s, kind, None) is not None:
            yield kind
