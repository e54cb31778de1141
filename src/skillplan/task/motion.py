"""What a skill makes a robot do, in via points; how it is executed is an engine's matter."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from skillplan.task.pose import DOWN, Point, Pose, dot, is_unit, same_direction
from skillplan.task.state import State

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


__all__ = ["Event", "Motion", "Point", "Route", "Visit"]


class Event(StrEnum):
    """What the hand does at a via point."""

    GRASP = "grasp"
    RELEASE = "release"
    LOAD = "load"
    OFFLOAD = "offload"
    DRIVE = "drive"
    FETCH = "fetch"


@dataclass(frozen=True, slots=True)
class Visit:
    """A transfer motion above a target at safe height, then approach, act and retreat.

    Parameters
    ----------
    pose
        Of the target in the world: of the body that is grasped or released, of the mouth of a hole
        or of a tool holder. A screw's head is on the side of its z axis.
    event
        What the hand does there.
    subject
        The body or tool it does it to.
    grasp
        How the body is held; None where the body says it.
    along
        Unit vector in the world along which the subject moves on the last stretch to where it is
        left, or a screw into its hole; straight down by default.
    insert_m
        Length of that stretch [m], > 0; None for a default.
    dwell_s
        Time that the hand stays at the target to act [s], >= 0.

    Raises
    ------
    ValueError
        If `along` is not of length 1, the length is not positive, or the dwell is negative.
    """

    pose: Pose
    event: Event
    subject: str
    grasp: Grasp | None = None
    along: Point = DOWN
    insert_m: float | None = None
    dwell_s: float = 0.0

    def __post_init__(self) -> None:
        if not is_unit(self.along):
            raise ValueError(f"Visit along must be of length 1, not {self.along}.")
        if self.insert_m is not None and not 0 < self.insert_m < math.inf:
            raise ValueError(f"Visit insert_m must be > 0, not {self.insert_m}.")
        if not 0 <= self.dwell_s < math.inf:
            raise ValueError(f"Visit dwell_s must be >= 0, not {self.dwell_s}.")

    @property
    def position(self) -> Point:
        """Where the origin of the target is in the world [m]."""
        return self.pose.position

    @property
    def yaw_rad(self) -> float:
        """How the target is turned about the vertical [rad]."""
        return self.pose.yaw_rad


@dataclass(frozen=True, slots=True)
class Route:
    """The visits of a skill in the states in which the facts `when` hold."""

    when: State
    visits: tuple[Visit, ...]


@dataclass(frozen=True, slots=True)
class Motion:
    """The via points of a skill.

    Parameters
    ----------
    robot
        The robot that moves.
    routes
        At least one; the first whose facts hold counts. Several only where the path depends
        on the state, as when the tool to be put back first may be one of several.
    carries
        The body in the hand at the start, or None.

    Raises
    ------
    ValueError
        If there is no route or a route has no visit.
    """

    robot: str
    routes: tuple[Route, ...]
    carries: str | None = None

    def __post_init__(self) -> None:
        if not self.routes or not all(route.visits for route in self.routes):
            raise ValueError(f"Motion of {self.robot!r} needs at least one visit.")

    def visits(self, state: State) -> tuple[Visit, ...]:
        """Return the visits made from `state`.

        Raises
        ------
        ValueError
            If no route fits the state.
        """
        for route in self.routes:
            if state.bits & route.when.bits == route.when.bits:
                return route.visits
        raise ValueError(f"No route of {self.robot!r} fits the state {state}.")
