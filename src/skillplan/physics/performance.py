"""Performances of whole plans in an engine, pictures of checks, and camera views."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Protocol, runtime_checkable

from skillplan.robots.arm_description import ArmDescription
from skillplan.task.motion import Point
from skillplan.task.scene import Pose
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import Verdict

# Default view, in which the arm hides little.
_AZIMUTH_DEG, _ELEVATION_DEG = 52.0, 28.0
# Share of half the picture's width and height that the objects fill, and least distance [m].
FILLED = 0.92
NEAREST_M = 0.3
CLOSE_UP_M = 0.62
FIELD_OF_VIEW_DEG = 45.0
WIDTH, HEIGHT = 1280, 720


@dataclass(frozen=True, slots=True)
class Angle:
    """Direction and distance of a camera.

    Parameters
    ----------
    azimuth_deg
        Direction of view about the vertical, from y towards -x [deg].
    elevation_deg
        Elevation of the camera above its target [deg], -90 to 90.
    distance_m
        Distance from the target [m]; None for the least distance that shows everything.

    Raises
    ------
    ValueError
        If the elevation or the distance is out of range.
    """

    azimuth_deg: float = _AZIMUTH_DEG
    elevation_deg: float = _ELEVATION_DEG
    distance_m: float | None = None

    def __post_init__(self) -> None:
        values = (self.azimuth_deg, self.elevation_deg, self.distance_m or 0.0)
        if not all(math.isfinite(value) for value in values):
            raise ValueError("An angle of a camera is of finite numbers.")
        if not -90 <= self.elevation_deg <= 90:
            raise ValueError(f"A camera is -90 to 90 degrees high, not {self.elevation_deg:g}.")
        if self.distance_m is not None and not 0 < self.distance_m <= 20:
            raise ValueError(f"A camera is 0 to 20 m off, not {self.distance_m:g} m.")

    @classmethod
    def parse(cls, text: str) -> Angle:
        """Return a named angle such as `front`, or one from `AZIMUTH,ELEVATION,DISTANCE`.

        Raises
        ------
        ValueError
            If the text is neither.
        """
        if text in NAMED:
            return NAMED[text]
        try:
            azimuth_deg, elevation_deg, distance_m = map(float, text.split(","))
        except ValueError:
            known = ", ".join(NAMED)
            raise ValueError(
                f"{text!r} is no camera: {known}, or AZIMUTH,ELEVATION,DISTANCE in degrees and m"
            ) from None
        return cls(azimuth_deg, elevation_deg, distance_m)

    @property
    def axes(self) -> tuple[Point, Point, Point]:
        """Right, up, and backward direction of the camera in the world."""
        a, e = math.radians(self.azimuth_deg), math.radians(self.elevation_deg)
        right = (math.cos(a), math.sin(a), 0.0)
        back = (math.sin(a) * math.cos(e), -math.cos(a) * math.cos(e), math.sin(e))
        up = (-math.sin(a) * math.sin(e), math.cos(a) * math.sin(e), math.cos(e))
        return right, up, back


NAMED = {"front": Angle(90.0, 22.0), "side": Angle(0.0, 22.0), "top": Angle(90.0, 89.0)}


@dataclass(frozen=True, slots=True)
class View:
    """Target and position of a camera.

    Parameters
    ----------
    target
        Point in the middle of the picture [m].
    distance_m
        Distance from the target [m].
    """

    target: Point
    angle: Angle
    distance_m: float

    @classmethod
    def close_up(cls, target: Point) -> View:
        """Return a view of a point and its surroundings."""
        return cls(target, Angle(), CLOSE_UP_M)

    @classmethod
    def about(cls, points: list[Point], angle: Angle | None = None) -> View:
        """Return a view of points, from the least distance unless the angle gives one."""
        angle = angle or Angle()
        low = [min(point[axis] for point in points) for axis in range(3)]
        high = [max(point[axis] for point in points) for axis in range(3)]
        middle = tuple((value + other) / 2 for value, other in zip(low, high, strict=True))
        target = (middle[0], middle[1], middle[2])
        if angle.distance_m is not None:
            return cls(target, angle, angle.distance_m)
        half = math.tan(math.radians(FIELD_OF_VIEW_DEG) / 2) * FILLED
        distance_m = NEAREST_M
        for point in points:
            away = [value - other for value, other in zip(point, target, strict=True)]
            x, y, z = (
                sum(own * value for own, value in zip(axis, away, strict=True))
                for axis in angle.axes
            )
            # A point must lie within the pyramid of view at its own depth.
            wide_m, high_m = abs(x) / (half * WIDTH / HEIGHT) + z, abs(y) / half + z
            distance_m = max(distance_m, wide_m, high_m)
        return cls(target, angle, distance_m)


@dataclass(frozen=True, slots=True)
class Image:
    """A picture: rows from the top, three bytes (red, green, blue) for each pixel.

    Raises
    ------
    ValueError
        If the number of bytes does not fit the size.
    """

    width: int
    height: int
    rgb: bytes

    def __post_init__(self) -> None:
        if len(self.rgb) != 3 * self.width * self.height:
            raise ValueError(f"{len(self.rgb)} bytes are no image {self.width} x {self.height}.")


@dataclass(frozen=True, slots=True)
class Contact:
    """A contact of two bodies at one moment.

    Parameters
    ----------
    bodies
        Names; the second body feels the force of the first.
    position
        Centre of the contact forces [m].
    force_n
        Force on the second body, friction included [N].
    """

    bodies: tuple[str, str]
    position: Point
    force_n: Point


@dataclass(frozen=True, slots=True)
class Sample:
    """One row of a trace: poses of the hand and of all bodies.

    Parameters
    ----------
    time_s
        Time since the plan began [s].
    phase
        Current phase of the skill, such as ``the travel to switch_1``.
    tip
        Position of the hand's tip [m].
    target
        Planned position of the tip at that time [m].
    joints_rad
        Joint angles of the arm [rad].
    opening_m
        Opening of the jaws [m].
    contact_n
        Greatest normal force of an unexpected contact [N].
    contacts
        All contacts, expected or not; one for every pair of bodies.
    """

    time_s: float
    skill: str
    phase: str
    tip: Point
    target: Point
    joints_rad: tuple[float, ...]
    opening_m: float
    contact_n: float
    bodies: Mapping[str, Pose]
    contacts: tuple[Contact, ...] = ()


@dataclass(frozen=True, slots=True)
class PerformedSkill:
    """The execution of one skill of a plan.

    Parameters
    ----------
    verdict
        Feasible if there was no unexpected contact and the postcondition was sensed; the evidence
        has
        the figures.
    begin_s, end_s
        Simulated time [s].
    acting_s
        Time that the hand acted at targets, dwells included [s], >= 0; None if not measured.
    waited_s
        Time that the arm waited for a part [s], >= 0.
    """

    skill: str
    verdict: Verdict
    begin_s: float
    end_s: float
    acting_s: float | None = None
    waited_s: float = 0.0


@dataclass(frozen=True, slots=True)
class Arrival:
    """Goal and final pose of a body.

    Parameters
    ----------
    offset_m
        Distance between the two [m], >= 0.
    tilt_rad
        Angle of the rotation between the two [rad], >= 0.
    """

    body: str
    goal: Pose
    final: Pose
    offset_m: float
    tilt_rad: float


@dataclass(frozen=True)
class Performance:
    """A plan executed in one continuous world.

    Parameters
    ----------
    skills
        Executed skills in order; the last one may have failed, or others if the plan went on.
    arrivals
        Bodies whose place is determined by the last state.
    simulated_s
        Simulated time [s].
    held_s
        Part of the simulated time in which the arm rested without simulation steps [s].
    pace
        Speeds of the arm in the engine, in a clause; may be empty.
    taken_away
        Parts that failed and were taken away, in order.
    """

    skills: tuple[PerformedSkill, ...]
    arrivals: tuple[Arrival, ...]
    simulated_s: float
    steps: int
    figures: Mapping[str, Any] = field(default_factory=dict, hash=False)
    held_s: float = 0.0
    pace: str = ""
    taken_away: tuple[str, ...] = ()

    @property
    def failed(self) -> PerformedSkill | None:
        """The first failed skill, or None."""
        return next((skill for skill in self.skills if not skill.verdict.is_feasible), None)


class Performer(ABC):
    """Optional interface of an engine: pictures of a check, and performances of whole plans.

    Attributes
    ----------
    contact_detectors
        Names of detectors that judge the contacts of a performance; the first one is the default.
    """

    contact_detectors: ClassVar[tuple[str, ...]] = ()

    @classmethod
    def looks(cls, arm: ArmDescription) -> Sequence[Path | None]:
        """Return meshes of an arm's base and links in their frames, as Wavefront files.

        None for a link without a mesh; empty if no mesh is known, and then the collision shapes are
        drawn.
        """
        return ()

    @abstractmethod
    def picture(self, skill: Skill, state: State) -> Image:
        """Return a picture of the moment at which `skill` fails in `state`, or of its end.

        Raises
        ------
        ValueError
            If there is no picture, with the reason.
        """

    @abstractmethod
    def footage(self, skill: Skill, state: State, frames_per_s: float) -> Iterator[Image]:
        """Yield pictures of the whole skill at a rate in simulated time."""

    @abstractmethod
    def perform(
        self,
        skills: Sequence[Skill],
        *,
        frames_per_s: float | None = None,
        show: Callable[[Image], None] | None = None,
        note: Callable[[Sample], None] | None = None,
        stopped: Callable[[], bool] = lambda: False,
        angle: Angle | None = None,
        labels: bool = False,
        keeps_going: bool = False,
    ) -> Performance:
        """Execute a plan continuously from the task's initial state, and measure.

        Parameters
        ----------
        skills
            The plan.
        frames_per_s, show
            Rate of pictures in simulated time, and their receiver.
        note
            Receiver of the rows of the trace, 60 for each simulated second; at most the first hour
            of a
            dwell at rest.
        stopped
            Polled often; once true, the plan ends after the current skill.
        angle
            Camera angle; None for the default.
        labels
            True to draw name tags of bodies, feeders and docks.
        keeps_going
            True to take away a part that failed and to go on with the others; skills that need the
            part fail, too. Otherwise the plan ends at the first skill that fails.
        """


MOST_PLAYED_S = 3_600
"""Length of the longest plan that is played [s], as all its frames are in memory."""


@dataclass(frozen=True, slots=True)
class PlannedMotion:
    """Poses of arm and parts in a plan, along its paths and without simulation.

    Parameters
    ----------
    skills
        Begin and end of each skill.
    samples
        One row for each frame, without contacts.
    """

    skills: tuple[PerformedSkill, ...]
    samples: Sequence[Sample]


@runtime_checkable
class MotionPlans(Protocol):
    """A back end that knows the paths and times of whole plans."""

    name: str

    def planned_motion(self, skills: Sequence[Skill], frames_per_s: int) -> PlannedMotion:
        """Return the motion of the arm in a plan, from the initial state.

        Parameters
        ----------
        skills
            Each applicable in its turn, with at most one motion.
        frames_per_s
            Number of samples per second, >= 1.

        Raises
        ------
        ValueError
            If a skill has no path; the message names it and the reason.
        """
