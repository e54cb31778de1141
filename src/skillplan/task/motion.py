"""Motions of skills as via points with grasps; engines decide how to execute them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise

from skillplan.task.pose import DOWN, Point, Pose, dot, is_same_direction, is_unit
from skillplan.task.state import State

AXES: dict[str, Point] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
"""Unit vectors of the axes, by name."""


class GraspKind(StrEnum):
    """Kind of a grasp: between two jaws, or by suction."""

    JAWS = "jaws"
    SUCTION = "suction"


@dataclass(frozen=True, slots=True)
class Grasp:
    """Position and orientation of a hand that holds a body.

    Parameters
    ----------
    tip
        Tip of the hand in the body's frame [m]: midway between the fingertips, or the centre of the
        suction cup's rim.
    closing
        Unit vector in the body's frame along which jaws close; for a suction cup, it gives the
        rotation about the cup's axis.
    width_m
        Extent of the body between the jaws, or of the hole about them [m], > 0; 0 for suction.
    approach
        Unit vector in the body's frame in which the hand points, perpendicular to `closing`.
    name
        Name among the grasps of the body; "" for the only one.
    inside_m
        Thickness of both jaws [m], >= 0, if they open inside a hole; 0 if they close about it.
    """

    kind: GraspKind
    tip: Point
    closing: Point = AXES["x"]
    width_m: float = 0.0
    approach: Point = DOWN
    name: str = ""
    inside_m: float = 0.0

    def __post_init__(self) -> None:
        for what in ("closing", "approach"):
            if not is_unit(getattr(self, what)):
                raise ValueError(f"Grasp {what} must be of length 1, not {getattr(self, what)}.")
        if abs(dot(self.closing, self.approach)) > 1e-9:
            raise ValueError("Grasp must close at right angles to where the hand points.")
        if (self.width_m > 0) != (self.kind is GraspKind.JAWS):
            raise ValueError(f"Grasp by {self.kind} cannot have the width {self.width_m} m.")
        if not 0 <= self.inside_m <= self.width_m:
            raise ValueError(f"Grasp inside_m must be 0 to {self.width_m}, not {self.inside_m}.")

    @property
    def is_inner(self) -> bool:
        """True if the jaws open inside a hole of the body."""
        return self.inside_m > 0

    @property
    def closing_axis(self) -> str | None:
        """Name of the body axis along which jaws close, or None."""
        backwards = (-self.closing[0], -self.closing[1], -self.closing[2])
        for name, axis in AXES.items():
            if is_same_direction(axis, self.closing) or is_same_direction(axis, backwards):
                return name
        return None

    @property
    def from_above(self) -> bool:
        """True if the hand points along -z of the body's frame."""
        return is_same_direction(self.approach, DOWN)


__all__ = ["Event", "Motion", "Point", "Route", "Visit"]


class Event(StrEnum):
    """Action of the hand at a via point."""

    GRASP = "grasp"
    RELEASE = "release"
    LOAD = "load"
    OFFLOAD = "offload"
    DRIVE = "drive"
    FETCH = "fetch"
    WORK = "work"
    TURN = "turn"


@dataclass(frozen=True, slots=True)
class Visit:
    """A transfer above a target at safe height, then approach, act and retract.

    Parameters
    ----------
    pose
        Pose of the target in the world: a body that is grasped or released, or the mouth of a hole
        or tool holder. The head of a screw is on its z side.
    subject
        Body or tool that the action applies to; of a turn, ``WORKHOLDER.ORIENTATION`` after it.
    grasp
        Grasp of the body; None for its preferred one.
    along
        Unit vector in the world along which the subject moves on the last stretch to its goal, or a
        screw into its hole; down by default.
    insert_m
        Length of this stretch [m], > 0; None for a default.
    dwell_s
        Time at the target [s], >= 0, without that of `path`.
    aside_m
        Displacement from below the target to where the hand comes down and goes up again [m]; None
        above it.
    path
        Points in the world that the tip passes at a work before the target [m].
    path_speed_m_per_s
        Greatest speed of the tip along `path` [m/s], > 0; None for that of travels.
    press_n
        Force with which the tip presses at a work [N], >= 0.
    torque_nm
        Tightening torque of a screw [N m], > 0, for the controller; None if it is not stated.
    at_goal
        False where a part is put down elsewhere than at its goal, so that its fits do not act.
    """

    pose: Pose
    event: Event
    subject: str
    grasp: Grasp | None = None
    along: Point = DOWN
    insert_m: float | None = None
    dwell_s: float = 0.0
    aside_m: Point | None = None
    path: tuple[Point, ...] = ()
    path_speed_m_per_s: float | None = None
    press_n: float = 0.0
    torque_nm: float | None = None
    at_goal: bool = True

    def __post_init__(self) -> None:
        if self.press_n < 0 or not math.isfinite(self.press_n):
            raise ValueError(f"Visit press_n must be >= 0, not {self.press_n}.")
        if not is_unit(self.along):
            raise ValueError(f"Visit along must be of length 1, not {self.along}.")
        if self.insert_m is not None and not 0 < self.insert_m < math.inf:
            raise ValueError(f"Visit insert_m must be > 0, not {self.insert_m}.")
        if not 0 <= self.dwell_s < math.inf:
            raise ValueError(f"Visit dwell_s must be >= 0, not {self.dwell_s}.")
        if self.path_speed_m_per_s is not None and not 0 < self.path_speed_m_per_s < math.inf:
            raise ValueError(
                f"Visit path_speed_m_per_s must be > 0, not {self.path_speed_m_per_s}."
            )

    @property
    def is_fitted(self) -> bool:
        """True if a part is released at its goal, where its fits act."""
        return self.event is Event.RELEASE and self.at_goal

    @property
    def path_s(self) -> float:
        """Least time of the tip along `path` [s]; 0 without a speed of its own."""
        return math.fsum(map(self.measure_leg_s, pairwise((*self.path, self.position))))

    def measure_leg_s(self, leg: tuple[Point, Point]) -> float:
        """Return the least time between two points of `path` [s]."""
        return 0.0 if self.path_speed_m_per_s is None else math.dist(*leg) / self.path_speed_m_per_s

    @property
    def acts_s(self) -> float:
        """Time at the target and along `path` [s]."""
        return self.dwell_s + self.path_s

    @property
    def position(self) -> Point:
        """Position of the target's origin in the world [m]."""
        return self.pose.position

    @property
    def yaw_rad(self) -> float:
        """Rotation of the target about the vertical [rad]."""
        return self.pose.yaw_rad


@dataclass(frozen=True, slots=True)
class Route:
    """The visits of a skill while the facts `when` hold."""

    when: State
    visits: tuple[Visit, ...]


@dataclass(frozen=True, slots=True)
class Motion:
    """The via points of a skill, by state.

    Parameters
    ----------
    routes
        Routes; the first whose facts hold counts. Several if the path depends on the state, such as
        on the tool that must be put back first.
    carries
        Body in the hand at the start, or None.
    """

    robot: str
    routes: tuple[Route, ...]
    carries: str | None = None

    def __post_init__(self) -> None:
        if not self.routes or not all(route.visits for route in self.routes):
            raise ValueError(f"Motion of {self.robot!r} needs at least one visit.")

    def visits(self, state: State) -> tuple[Visit, ...]:
        """Return the visits in `state`.

        Raises
        ------
        ValueError
            If no route fits the state.
        """
        for route in self.routes:
            if state.bits & route.when.bits == route.when.bits:
                return route.visits
        raise ValueError(f"No route of {self.robot!r} fits the state {state}.")
