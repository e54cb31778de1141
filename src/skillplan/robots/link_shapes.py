"""Shapes about the links of an arm: convex pieces, capsules and cylinders.

All of them are convex, so that every engine has its own way to compute with them.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path

Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Hull:
    """The convex hull of some corners.

    Parameters
    ----------
    corners_m
        In the link's frame [m], four at least, not all in one plane.

    Raises
    ------
    ValueError
        If there are fewer, or one is not finite.
    """

    corners_m: tuple[Triple, ...]

    def __post_init__(self) -> None:
        if len(self.corners_m) < 4:
            raise ValueError(f"Hull needs four corners at least, not {len(self.corners_m)}.")
        for corner in self.corners_m:
            _require_point("Hull corner", corner)


@dataclass(frozen=True, slots=True)
class Capsule:
    """All points within a distance of a segment; a ball where its ends are one.

    Parameters
    ----------
    start_m, end_m
        Ends of the segment in the link's frame [m].
    radius_m
        > 0.

    Raises
    ------
    ValueError
        If the radius is not positive, or a number not finite.
    """

    start_m: Triple
    end_m: Triple
    radius_m: float

    def __post_init__(self) -> None:
        _require_round("Capsule", self.start_m, self.end_m, self.radius_m)


@dataclass(frozen=True, slots=True)
class Rod:
    """A cylinder between two points, with flat ends.

    Parameters
    ----------
    start_m, end_m
        Centres of its ends in the link's frame [m], apart from each other.
    radius_m
        > 0.

    Raises
    ------
    ValueError
        If the radius is not positive, a number not finite, or the ends are one.
    """

    start_m: Triple
    end_m: Triple
    radius_m: float

    def __post_init__(self) -> None:
        _require_round("Rod", self.start_m, self.end_m, self.radius_m)
        if self.start_m == self.end_m:
            raise ValueError("Rod must have two ends.")


LinkShape = Hull | Capsule | Rod
"""Any of them."""


def read_hulls(name: str) -> tuple[tuple[Hull, ...], ...]:
    """Return the convex pieces of a shipped robot's bodies, in the order of its file.

    Parameters
    ----------
    name
        File in the folder ``shapes``, without its suffix.
    """
    path = Path(__file__).with_name("shapes") / f"{name}.json"
    bodies = json.loads(path.read_text("utf-8"))["hulls_mm"]
    return tuple(
        tuple(Hull(tuple((x / 1e3, y / 1e3, z / 1e3) for x, y, z in hull)) for hull in hulls)
        for hulls in bodies
    )


def _require_round(what: str, start_m: Triple, end_m: Triple, radius_m: float) -> None:
    _require_point(f"{what} start_m", start_m)
    _require_point(f"{what} end_m", end_m)
    if not (math.isfinite(radius_m) and radius_m > 0):
        raise ValueError(f"{what} radius_m must be > 0, not {radius_m}.")


def _require_point(what: str, point: Triple) -> None:
    if len(point) != 3 or not all(math.isfinite(value) for value in point):
        raise ValueError(f"{what} must be three finite numbers, not {point}.")
