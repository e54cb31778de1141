"""What an engine that moves bodies can show: pictures of a check, and whole plans performed."""

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

# From the side that the arm does not hide.
_AZIMUTH_DEG, _ELEVATION_DEG = 52.0, 28.0
# Of half the picture's width and height so much is filled by what has to be seen, from no nearer.
FILLED = 0.92
NEAREST_M = 0.3
CLOSE_UP_M = 0.62
FIELD_OF_VIEW_DEG = 45.0
WIDTH, HEIGHT = 1280, 720


@dataclass(frozen=True, slots=True)
class Angle:
    """From which side a camera looks, and from how far off.

    Parameters
    ----------
    azimuth_deg
        Of the direction in which it looks, about the vertical, from y towards -x [deg].
    elevation_deg
        How far above what it looks at it stands [deg], -90 to 90.
    distance_m
        From how far off [m]; left out: from as near as shows all.

    Raises
    ------
    ValueError
        If the elevation or the distance is not in its range.
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
        """Return what a name or numbers say: `front`, or `AZIMUTH,ELEVATION,DISTANCE`.

        Raises
        ------
        ValueError
            If it is neither, in words.
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
        """To the right, up, and back to the camera, in the world."""
        a, e = math.radians(self.azimuth_deg), math.radians(self.elevation_deg)
        right = (math.cos(a), math.sin(a), 0.0)
        back = (math.sin(a) * math.cos(e), -math.cos(a) * math.cos(e), math.sin(e))
        up = (-math.sin(a) * math.sin(e), math.cos(a) * math.sin(e), math.cos(e))
        return right, up, back


NAMED = {
    "front": Angle(90.0, 22.0),
    "side": Angle(0.0, 22.0),
    "top": Angle(90.0, 89.0),
}


@dataclass(frozen=True, slots=True)
class View:
    """What a camera looks at, from where.

    Parameters
    ----------
    target
        What is in the middle [m].
    angle
        From which side.
    distance_m
        From how far off [m].
    """

    target: Point
    angle: Angle
    distance_m: float

    @classmethod
    def close_up(cls, target: Point) -> View:
        """Return a view of a point and what is about it."""
        return cls(target, Angle(), CLOSE_UP_M)

    @classmethod
    def about(cls, points: list[Point], angle: Angle | None = None) -> View:
        """Return a view of all of some points, from as near as it can be, unless that is said."""
        angle = angle or Angle()
        low = [min(point[axis] for point in points) for axis in range(3)]
        high = [max(point[axis] for point in points) for axis in range(3)]
        middle = tuple((one + other) / 2 for one, other in zip(low, high, strict=True))
        target = (middle[0], middle[1], middle[2])
        if angle.distance_m is not None:
            return cls(target, angle, angle.distance_m)
        half = math.tan(math.radians(FIELD_OF_VIEW_DEG) / 2) * FILLED
        distance_m = NEAREST_M
        for point in points:
            away = [one - other for one, other in zip(point, target, strict=True)]
            x, y, z = (
                sum(own * one for own, one in zip(axis, away, strict=True)) for axis in angle.axes
            )
            # A point at the middle's depth plus its own must lie within the pyramid of view.
            wide_m, high_m = abs(x) / (half * WIDTH / HEIGHT) + z, abs(y) / half + z
            distance_m = max(distance_m, wide_m, high_m)
        return cls(target, angle, distance_m)


@dataclass(frozen=True, slots=True)
class Image:
    """A picture: rows from the top, three bytes a pixel, red, green and blue.

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
    """Two bodies that touch at one moment.

    Parameters
    ----------
    bodies
        The second feels the force of the first.
    position
        Where they touch, in the middle of their forces [m].
    force_n
        What the second body feels of the first, friction included [N].
    """

    bodies: tuple[str, str]
    position: Point
    force_n: Point


@dataclass(frozen=True, slots=True)
class Sample:
    """One row of a trace: where the hand and all bodies are.

    Parameters
    ----------
    time_s
        Since the plan began [s].
    skill
        The current skill.
    phase
        What the robot is at in it, in words, such as ``the travel to switch_1``.
    tip
        Where the tip of the hand is [m].
    target
        Where it is to be at that time [m].
    joints_rad
        Joint angles of the arm [rad].
    opening_m
        Between the jaws [m].
    contact_n
        The greatest normal force between bodies that are not expected to touch [N].
    bodies
        Poses by name.
    contacts
        All that touches, expected or not; one for every pair of bodies.
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
    """How one skill of a plan went.

    Parameters
    ----------
    skill
        Its name.
    verdict
        Feasible where it was executed without unexpected contact and its postcondition was
        sensed; with the figures as evidence.
    begin_s, end_s
        Simulated time [s].
    acting_s
        Part of it in which the hand acted at targets, dwells included [s], >= 0; None if the engine
        does not measure it.
    """

    skill: str
    verdict: Verdict
    begin_s: float
    end_s: float
    acting_s: float | None = None


@dataclass(frozen=True, slots=True)
class Arrival:
    """Where a body was to be in the end, and how far from there it is.

    Parameters
    ----------
    body
        Its name.
    goal, final
        Poses in the world.
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
        Those that were executed, in order; the last may have failed.
    arrivals
        One for every body whose place the state after the last skill determines.
    simulated_s
        Simulated time [s].
    steps
        How many simulation steps that took.
    figures
        What else was measured.
    held_s
        Part of the simulated time in which the arm dwelt at rest, which takes no steps [s].
    pace
        Speeds of the arm in the engine, in a clause; empty if the engine gives none.
    """

    skills: tuple[PerformedSkill, ...]
    arrivals: tuple[Arrival, ...]
    simulated_s: float
    steps: int
    figures: Mapping[str, Any] = field(default_factory=dict, hash=False)
    held_s: float = 0.0
    pace: str = ""

    @property
    def failed(self) -> PerformedSkill | None:
        """The skill at which it stopped, or None."""
        return next((one for one in self.skills if not one.verdict.is_feasible), None)


class Performer(ABC):
    """What an engine may be besides: able to draw a check and to perform a whole plan.

    Attributes
    ----------
    contact_detectors
        Names of the detectors that rule on the contacts of a performance where they are beside
        the engine; the first of them where nobody chooses one.
    """

    contact_detectors: ClassVar[tuple[str, ...]] = ()

    @classmethod
    def looks(cls, arm: ArmDescription) -> Sequence[Path | None]:
        """Return meshes of an arm's base and links in their frames, as Wavefront files.

        None for a link that has none, and nothing at all where nobody has any: then what links
        collide with is what they look like.
        """
        return ()

    @abstractmethod
    def picture(self, skill: Skill, state: State) -> Image:
        """Return the moment at which `skill` fails in `state`, or its end where it does not.

        Raises
        ------
        ValueError
            If there is nothing to be seen, in words.
        """

    @abstractmethod
    def footage(self, skill: Skill, state: State, frames_per_s: float) -> Iterator[Image]:
        """Yield pictures of the whole skill, so many a simulated second."""

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
    ) -> Performance:
        """Execute a plan from the task's initial state, without a break, and measure.

        Parameters
        ----------
        skills
            The plan; it ends early at the first skill that fails.
        frames_per_s, show
            How many pictures a simulated second are shown, and to what.
        note
            Called with a row of the trace 60 times a simulated second; of a dwell at rest, for its
            first hour at most.
        stopped
            Called often; once true, the plan ends after the current skill.
        angle
            From which side pictures are taken; left out: from the one that the arm does not hide.
        labels
            Whether bodies, feeders and docks have name tags in pictures.
        """


MOST_PLAYED_S = 3_600
"""Length of the longest plan that is played [s], as all its frames are in memory."""


@dataclass(frozen=True, slots=True)
class PlannedMotion:
    """Where arm and parts are at every moment of a plan, by its paths.

    Parameters
    ----------
    skills
        When each begins and ends.
    samples
        One row a frame; contacts are in none of them.
    """

    skills: tuple[PerformedSkill, ...]
    samples: Sequence[Sample]


@runtime_checkable
class MotionPlans(Protocol):
    """A back end that knows the paths and times of whole plans."""

    name: str

    def planned_motion(self, skills: Sequence[Skill], frames_per_s: int) -> PlannedMotion:
        """Return how the arm moves in a plan, from the initial state on.

        Parameters
        ----------
        skills
            Each applicable when its turn comes, and with one motion at most.
        frames_per_s
            How many samples there are to a second, >= 1.

        Raises
        ------
        ValueError
            If there is no path for one of them; says in a clause for which, and why.
        """
