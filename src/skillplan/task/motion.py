"""What a skill makes a robot do, in via points; how it is executed is an engine's matter."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

from skillplan.task.state import State

Point = tuple[float, float, float]


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
    position
        World position of the target [m]: the bottom centre of the body that is grasped or
        released, the mouth of a hole or of a tool holder.
    event
        What the hand does there.
    subject
        The body or tool it does it to.
    yaw_rad
        How the body is turned about the vertical there [rad].

    Raises
    ------
    ValueError
        If a coordinate is not finite.
    """

    position: Point
    event: Event
    subject: str
    yaw_rad: float = 0.0

    def __post_init__(self) -> None:
        if not all(math.isfinite(value) for value in self.position):
            raise ValueError(f"Visit position must be finite, not {self.position}.")


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
