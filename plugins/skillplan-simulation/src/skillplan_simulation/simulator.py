"""What a physics engine has to offer for skills to be executed in it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from skillplan.robots.arm_description import Hand
from skillplan.task.scene import Body, Pose, Robot
from skillplan_simulation.kinematics import ArmKinematics, TipPose
from skillplan_simulation.motions import Setpoint

Vector = NDArray[np.float64]

STEPS_PER_S = 240
STEP_S = 1 / STEPS_PER_S
GRAVITY_M_PER_S2 = 9.81
# How fast jaws move [m/s].
JAW_SPEED_M_PER_S = 0.05
# Light parts turn as if they had this moment of inertia: below it, parts between two jaws flicker
# about the vertical at 240 steps a second until they fall out.
LEAST_INERTIA_KG_M2 = 2e-5
# Names with a space, which no part of a task can have.
TABLE = "work table"
ROBOT = "robot arm"
HAND = "robot hand"
FINGERS = ("left finger", "right finger")


class UpsetError(Exception):
    """Raised, in words, where the simulation blew up and says nothing any more."""


@dataclass(frozen=True, slots=True)
class Touch:
    """A point at which two bodies press on each other.

    Parameters
    ----------
    first, second
        Their names; of the robot, those of its hand and fingers count.
    place
        Where [m], shape (3,).
    normal
        From the second to the first, shape (3,).
    normal_n
        Normal force [N], > 0.
    force_n
        What the first feels of the second, friction included [N], shape (3,).
    """

    first: str
    second: str
    place: Vector
    normal: Vector
    normal_n: float
    force_n: Vector

    def turned(self) -> Touch:
        """Return it as the second feels it of the first."""
        normal, force_n = -self.normal, -self.force_n
        return Touch(self.second, self.first, self.place, normal, self.normal_n, force_n)


class World(Protocol):
    """A table and bodies under gravity, advanced 240 times a simulated second.

    To be used as a context manager: what it takes up is given back at the end.

    Attributes
    ----------
    friction
        Coefficient of lateral friction of bodies and table [-].
    steps
        How often it was advanced.
    numbers
        The simulator's numbers of what is there, by name.
    """

    friction: float
    steps: int
    numbers: dict[str, int]

    def __enter__(self) -> Self:
        """Return it."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Give back what it takes up."""

    def step(self) -> None:
        """Advance by 1/240 s."""

    def add(self, body: Body, pose: Pose, *, stands: bool = False) -> int:
        """Put a body at a pose; return its number."""

    def stand(self, moving: Iterable[str]) -> None:
        """Have all bodies stand but some, which are to be moved."""

    def put(self, name: str, pose: Pose) -> None:
        """Move a body to a pose, at rest."""

    def pose(self, name: str) -> Pose:
        """Return where a body is: the pose of the centre of its bottom."""

    def is_sane(self) -> bool:
        """Whether every body is at a finite place and none races off."""

    def mass_kg(self, name: str) -> float:
        """Return the mass of a body [kg]."""

    def weigh(self, name: str, mass_kg: float) -> None:
        """Change the mass of a body for a while; its shape stays."""

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies of the scene, in the order in which they were put."""

    @property
    def fixed(self) -> frozenset[str]:
        """Bodies that nothing can move for the time being."""

    def others(self, name: str) -> list[str]:
        """Return the names of the table and all bodies but one."""

    def part(self, one: str, others: Iterable[str]) -> None:
        """Let a body pass through others."""

    def join(self, one: str, others: Iterable[str]) -> None:
        """Let a body touch others again."""

    def withdraw(self, name: str, links: Iterable[int]) -> None:
        """Let these links of a body touch nothing; that of a body without joints is -1."""

    def hold(self, name: str) -> int:
        """Fix a body where it is; return the constraint, to be given to `release`."""

    def fasten(self, name: str, other: str) -> None:
        """Fix a body to another as it is; the two pass through each other from now on."""

    def release(self, constraint: int) -> None:
        """Undo a constraint."""

    def nearest(self, name: str, others: Iterable[str] | None = None) -> str | None:
        """Return which of the others touches a body, or is nearest to it by 0.5 mm; else None."""

    def is_near(self, one: str, other: str, distance_m: float) -> bool:
        """Whether two bodies are no farther apart than a distance [m]."""

    def touches(self) -> list[Touch]:
        """Return where bodies press on each other, after the last step."""

    def pulled_n(self, name: str, constraint: int) -> Vector:
        """Return what a constraint does to a body that it fixes to the robot [N], shape (3,)."""


class Grip(Protocol):
    """Static friction that holds a body still between jaws, for as long as it can.

    Attributes
    ----------
    name
        Of the body.
    constraint
        What holds it meanwhile; None once it slips, or where contacts alone hold it.
    """

    name: str
    constraint: int | None

    def hold(self, elapsed_s: float) -> None:
        """Let the body slip if its load since the last time was beyond what friction holds."""

    def let_go(self) -> None:
        """Leave the body to its contacts."""


class Arm(Protocol):
    """The arm of a world: its joints, its jaws, and what it holds.

    Attributes
    ----------
    world, robot, hand, kinematics
        Where it is, which it is, what jaws it has, and where its tip is.
    link_names
        What its links that handle parts are called, by the simulator's numbers.
    payload_kg, bears
        What the hand lifts beside itself [kg], and the bodies that this is the mass of.
    press_n
        The force that it presses with [N], shape (3,).
    wanted
        Where the tip is to be.
    shows_hand
        Whether hand and fingers are there: not while the arm has another tool, or none.
    """

    robot: Robot
    hand: Hand
    kinematics: ArmKinematics
    link_names: dict[int, str]
    payload_kg: float
    bears: tuple[str, ...]
    press_n: Vector
    wanted: Setpoint | None
    shows_hand: bool

    def fit(self, hand: Hand) -> None:
        """Have the jaws of another hand, wide open; nothing may be fixed to the arm."""

    def stand(self, joints: Vector, opening_m: float) -> None:
        """Put the arm at rest in a posture [rad], its jaws so far open."""

    def tip(self) -> TipPose:
        """Return where the tip is."""

    def tip_error_m(self) -> float:
        """Return how far the tip is from where it is to be [m]."""

    def joints_rad(self) -> tuple[float, ...]:
        """Return the joint angles [rad]."""

    def jaw_width_m(self) -> float:
        """Return the distance between the jaws [m]."""

    def open(self, opening_m: float) -> None:
        """Begin to open the jaws to a distance."""

    def close(self, force_n: float) -> None:
        """Begin to close the jaws until they grip with a force."""

    def actuate(self) -> None:
        """Set motors for the step to come."""

    def show_hand(self, visible: bool) -> None:
        """Take the hand and its fingers out of collision and sight, or put them back."""

    def grip(self, name: str) -> int:
        """Fix a body to the hand as it is; return the constraint."""

    def clasp(self, name: str) -> Grip:
        """Have friction hold a body that is between the jaws still."""


class Simulator(Protocol):
    """Makes worlds, with the task's arm and without."""

    def world(self) -> World:
        """Return a world with a table and nothing else."""

    def cell(self, hand: Hand) -> tuple[World, Arm]:
        """Return a world with a table and the task's arm, and the arm.

        Parameters
        ----------
        hand
            What jaws it has.
        """
