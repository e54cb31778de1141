"""How a hand holds a body."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from skillplan.task.pose import DOWN, Point, dot, is_unit, same_direction

AXES: dict[str, Point] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
"""The axes of a frame, by name."""


class GraspKind(StrEnum):
    """How a hand holds a part: between two jaws, or by suction."""

    JAWS = "jaws"
    SUCTION = "suction"


@dataclass(frozen=True, slots=True)
class Grasp:
    """Where and how a hand holds a body.

    Parameters
    ----------
    kind
        Jaws or suction.
    tip
        Where the end of the hand is, in the body's frame [m]: midway between the fingertips, or
        the rim of the suction cup.
    closing
        Direction in the body's frame along which jaws close, of length 1; of a suction cup how
        the hand is turned about its axis.
    width_m
        Extent of the body between the jaws [m], > 0; 0 for suction.
    approach
        Direction in the body's frame in which the hand points, of length 1, at right angles to
        `closing`.
    name
        What tells it from the other grasps of the body; "" for the only one.

    Raises
    ------
    ValueError
        If a direction is not of length 1, the two are not at right angles, or the width does not
        fit the kind.
    """

    kind: GraspKind
    tip: Point
    closing: Point = AXES["x"]
    width_m: float = 0.0
    approach: Point = DOWN
    name: str = ""

    def __post_init__(self) -> None:
        for what in ("closing", "approach"):
            if not is_unit(getattr(self, what)):
                raise ValueError(f"Grasp {what} must be of length 1, not {getattr(self, what)}.")
        if abs(dot(self.closing, self.approach)) > 1e-9:
            raise ValueError("Grasp must close at right angles to where the hand points.")
        if (self.width_m > 0) != (self.kind is GraspKind.JAWS):
            raise ValueError(f"Grasp by {self.kind} cannot have the width {self.width_m} m.")

    @property
    def closing_axis(self) -> str | None:
        """The axis of the body's frame along which jaws close; None for none of them."""
        backwards = (-self.closing[0], -self.closing[1], -self.closing[2])
        for name, axis in AXES.items():
            if same_direction(axis, self.closing) or same_direction(axis, backwards):
                return name
        return None

    @property
    def from_above(self) -> bool:
        """Whether the hand points along -z of the body's frame."""
        return same_direction(self.approach, DOWN)
