"""The YAML schema of directions and of grasps."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag

from skillplan.domains.assembly.handling.ranges import Extent, PlanarOrSpatial
from skillplan.domains.domain import Strict
from skillplan.files.schema_errors import ONE, SEVERAL, WORD, Located
from skillplan.task.pose import Point

# Shorter than this, three numbers are no direction, whatever they are divided by.
_NO_LENGTH = 1e-6

_Component = Annotated[float, Field(ge=-1000, le=1000)]


def _with_length(vector: list[float]) -> list[float]:
    if math.hypot(*vector) < _NO_LENGTH:
        raise Located(
            "is a vector of length 0, which is no direction. Give one such as [0, 0, -1]."
        )
    return vector


Direction = Annotated[
    list[_Component], Field(min_length=3, max_length=3), AfterValidator(_with_length)
]
"""Three numbers, not all 0; only their ratio counts."""


def _how_many(value: Any) -> str:
    """Return which of the two forms a list of directions has."""
    return SEVERAL if isinstance(value, list) and any(isinstance(v, list) for v in value) else ONE


Directions = Annotated[
    Annotated[Direction, Tag(ONE)]
    | Annotated[list[Direction], Field(min_length=1, max_length=16), Tag(SEVERAL)],
    Discriminator(_how_many),
]
"""A direction, or a list of them."""

Axis = Annotated[
    Annotated[Literal["x", "y", "z", "auto"], Tag(WORD)] | Annotated[Direction, Tag(ONE)],
    Discriminator(lambda value: ONE if isinstance(value, list) else WORD),
]
"""An axis of a part by name, or a direction."""


class GraspConfig(Strict):
    """How a part is held."""

    type: Literal["jaws", "suction"] | None = Field(
        None, description="between jaws, or by suction; left out: as its tool does"
    )
    approach: Direction = Field(
        [0.0, 0.0, -1.0],
        description="direction in the part's frame in which the hand points; left out: from the "
        "part's top, [0, 0, -1]",
    )
    closing_axis: Axis = Field(
        "auto",
        description="axis of the part along which jaws close, or a direction in its frame; auto: "
        "where it is narrower",
    )
    depth_m: Extent | None = Field(
        None,
        description="how far below the part's top, seen from the hand, the fingers reach [m]; left "
        "out: half of what they hold, 0.012 at most",
    )
    at_m: PlanarOrSpatial | None = Field(
        None,
        description="where the tip of the hand is, x y from the centre of the part's bottom [m]; a "
        "hand that does not come from the part's top needs x y z of a point on its axis; left out: "
        "over that centre for suction from the top, else in the middle of what is held",
    )


def _which(value: Any) -> str:
    """Return which form a grasp has."""
    if isinstance(value, str):
        return WORD
    return SEVERAL if isinstance(value, list) else ONE


Grasps = Annotated[
    Annotated[GraspConfig, Tag(ONE)]
    | Annotated[list[GraspConfig], Field(min_length=1, max_length=32), Tag(SEVERAL)]
    | Annotated[Literal["auto"], Tag(WORD)],
    Discriminator(_which),
]
"""One grasp, several to choose from, or ``auto``."""


def unit_of(vector: list[float]) -> Point:
    """Return the direction of three numbers that have one, as a vector of length 1."""
    # What is a unit vector already stays as it is, to the last bit.
    length = math.hypot(*vector)
    x, y, z = vector if abs(length - 1) < 1e-12 else (value / length for value in vector)
    return (x + 0.0, y + 0.0, z + 0.0)
