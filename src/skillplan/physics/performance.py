"""What an engine that moves bodies can show: pictures of a check, and whole plans performed."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from skillplan.physics.view import Angle
from skillplan.robots.arm_description import ArmDescription
from skillplan.task.motion import Point
from skillplan.task.scene import Pose
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import Verdict


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
