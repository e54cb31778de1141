"""The interface of a physics engine for the execution of skills."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from skillplan.robots.arm_description import Hand
from skillplan.task.motion import Point
from skillplan.task.scene import Body, Pose, Robot
from skillplan_pinocchio.arm_model import assume_masses
from skillplan_pinocchio.kinematics.fixed_order import times
from skillplan_simulation.kinematics import (
    ArmKinematics,
    TipPose,
    compute_turn,
    get_kinematics,
    make_unreachable_error,
)
from skillplan_simulation.motions import Setpoint

Vector = NDArray[np.float64]

STEPS_PER_S = 240
STEP_S = 1 / STEPS_PER_S
GRAVITY_M_PER_S2 = 9.81
# Speed of jaws [m/s].
JAW_SPEED_M_PER_S = 0.05
# Force that holds jaws open [N].
_OPENING_FORCE_N = 40.0
# Names with a space, which no part of a task can have.
TABLE = "work table"
ROBOT = "robot arm"
HAND = "robot hand"
FINGERS = ("left finger", "right finger")
CARRIER = "workholder carrier"
# Mass and moments of inertia of the carrier, which loads must not slow down [kg], [kg m2].
CARRIER_KG, CARRIER_KG_M2 = 100.0, 10.0


def compute_speeds(pose: Pose, after: Pose) -> tuple[Point, Point]:
    """Return linear [m/s] and angular velocity [rad/s] from a pose to the one after a step."""
    x, y, z = (STEPS_PER_S * (b - a) for a, b in zip(pose.position, after.position, strict=True))
    turned = compute_turn(np.array(pose.rotation), np.array(after.rotation))
    a, b, c = (STEPS_PER_S * turned).tolist()
    return (x, y, z), (a, b, c)


class UpsetError(Exception):
    """The simulation blew up, so it is inconclusive."""


@dataclass(frozen=True, slots=True)
class Touch:
    """A contact point of two bodies.

    Parameters
    ----------
    first, second
        Names of the bodies; of the robot, names of its hand and fingers.
    place
        Position [m], shape (3,).
    normal
        Normal from the second to the first, shape (3,).
    normal_n
        Normal force [N], > 0.
    force_n
        Force of the second on the first, friction included [N], shape (3,).
    """

    first: str
    second: str
    place: Vector
    normal: Vector
    normal_n: float
    force_n: Vector

    def turned(self) -> Touch:
        """Return the contact from the point of view of the second body."""
        normal, force_n = -self.normal, -self.force_n
        return Touch(self.second, self.first, self.place, normal, self.normal_n, force_n)


class Filters(Protocol):
    """Pairs of bodies of a world that pass through each other."""

    def part(self, name: str, others: Iterable[str]) -> None:
        """Let a body pass through others."""

    def join(self, name: str, others: Iterable[str]) -> None:
        """Let a body touch others again."""

    def withdraw(self, name: str, links: Iterable[int]) -> None:
        """Disable collisions of these links of a body only; -1 is a body without joints."""


class World(Protocol):
    """A table and bodies under gravity, advanced 240 times a simulated second.

    A context manager that frees its resources at the end. Engines inherit the fastenings.

    Attributes
    ----------
    friction
        Coefficient of lateral friction of bodies and table [-].
    numbers
        The simulator's numbers of bodies, by name.
    """

    friction: float
    steps: int
    numbers: dict[str, int]
    filters: Filters
    _masses: dict[str, float]
    # Constraints of fastenings, and of bodies on the carrier.
    _fastened: dict[tuple[str, str], int]
    _carried: list[int]

    def __init__(self, friction: float) -> None:
        self.friction, self.steps = friction, 0
        self.numbers, self._masses, self._fastened, self._carried = {}, {}, {}, []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Free all resources, if there are any."""
        return

    def step(self) -> None:
        """Advance by 1/240 s."""

    def add(self, body: Body, pose: Pose, *, stands: bool = False) -> int:
        """Put a body at a pose, its origin at the centre of its bottom; return its number.

        Parameters
        ----------
        stands
            True if the body is not to be moved. pybullet fixes it unless it is convex, because
            only a fixed body has its exact shape there.
        """

    def remove(self, name: str) -> None:
        """Take a body out of the world, with all its fastenings."""

    def stand(self, moving: Iterable[str]) -> None:
        """Fix all bodies except those to be moved, if the simulator needs that."""

    def push(self, name: str, force_n: Vector) -> None:
        """Push the centre of a body in every step until further notice [N], shape (3,)."""

    def pushed_n(self, name: str) -> Vector:
        """Return the force of `push` on a body [N], shape (3,)."""

    def put(self, name: str, pose: Pose) -> None:
        """Move a body to a pose, at rest."""

    def pose(self, name: str) -> Pose:
        """Return the pose of the centre of a body's bottom."""

    def is_sane(self) -> bool:
        """Return whether every body has a finite position and a plausible speed."""

    def mass_kg(self, name: str) -> float:
        """Return the mass of a body [kg]."""
        return self._masses[name]

    def weigh(self, name: str, mass_kg: float) -> None:
        """Change the mass of a body temporarily; its shape stays."""

    def centre(self, name: str) -> Vector:
        """Return the centre of mass of a body [m], shape (3,)."""

    def inertia_kg_m2(self, name: str) -> Vector:
        """Return the inertia tensor about the centre of mass in world axes, shape (3, 3)."""

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies of the scene, in order of insertion."""
        return tuple(self._masses)

    @property
    def fixed(self) -> frozenset[str]:
        """Bodies that are fixed now."""

    def others(self, name: str) -> list[str]:
        """Return the names of the table and all bodies but one."""
        return [other for other in (TABLE, *self.bodies) if other != name]

    def part(self, name: str, others: Iterable[str]) -> None:
        """Let a body pass through others."""
        self.filters.part(name, others)

    def join(self, name: str, others: Iterable[str]) -> None:
        """Let a body touch others again."""
        self.filters.join(name, others)

    def withdraw(self, name: str, links: Iterable[int]) -> None:
        """Disable collisions of these links of a body only; -1 is a body without joints."""
        self.filters.withdraw(name, links)

    def hold(self, name: str) -> int:
        """Fix a body in place; return the constraint for `release`."""

    def fix(self, name: str, other: str) -> int:
        """Fix a body to another in its current pose; return the constraint for `release`."""

    def release(self, constraint: int) -> None:
        """Remove a constraint."""

    def fasten(self, name: str, other: str) -> None:
        """Fix a body to another in its current pose; from now on they pass through each other."""
        self.part(name, [other])
        self._fastened[name, other] = self.hold(name) if other == TABLE else self.fix(name, other)

    @property
    def fastened(self) -> frozenset[tuple[str, str]]:
        """Pairs of bodies that `fasten` fixed to each other."""
        return frozenset(self._fastened)

    def unfasten(self, name: str, other: str) -> None:
        """Remove what `fasten` fixed; the two touch again."""
        self.release(self._fastened.pop((name, other)))
        self.join(name, [other])

    def _release_all(self, name: str) -> list[tuple[str, str]]:
        """Remove all fastenings of a body and return their pairs."""
        pairs = [pair for pair in self._fastened if name in pair]
        for pair in pairs:
            self.release(self._fastened.pop(pair))
        return pairs

    def carry(self, names: Iterable[str], pose: Pose) -> None:
        """Fix bodies to a heavy carrier at a pose, which `drive` moves."""

    def drive(self, pose: Pose, after: Pose) -> None:
        """Set the pose of the carrier, and its speed to the pose after the next step."""

    def set_down(self) -> None:
        """Release all bodies from the carrier."""
        for constraint in self._carried:
            self.release(constraint)
        self._carried = []

    def nearest(self, name: str, others: Iterable[str] | None = None) -> str | None:
        """Return the body that touches or is nearest to another within 0.5 mm, or None."""

    def is_near(self, name: str, other: str, distance_m: float) -> bool:
        """Return whether two bodies are within a distance [m]."""

    def touches(self) -> list[Touch]:
        """Return the contacts of the last step."""

    def pulled_n(self, name: str, constraint: int) -> Vector:
        """Return the force of a constraint on its body, fixed to the robot [N], shape (3,)."""


class Grip(Protocol):
    """Static friction that holds a body still between jaws.

    Attributes
    ----------
    constraint
        Constraint that holds the body; None once it slips, or if contacts alone hold it.
    """

    name: str
    constraint: int | None

    def hold(self, elapsed_s: float) -> None:
        """Let the body slip if its load since the last call exceeds the friction limit."""

    def let_go(self) -> None:
        """Release the body to its contacts."""


class Arm(Protocol):
    """The arm of a world: joints, jaws and payload. Engines inherit the motion of the jaws.

    Attributes
    ----------
    robot, hand, kinematics
        Robot of the task, current hand, and kinematics.
    link_names
        Names of links that handle parts, by the simulator's numbers.
    payload_kg, bears
        Payload of the hand [kg], and the bodies it consists of.
    press_n
        Force that the tip presses with [N], shape (3,).
    yields
        True if contacts may push the tip aside, as on the springs of a compliance device. Arms
        whose simulator is too coarse for such springs stay stiff.
    shows_hand
        True if hand and fingers are present: not with another tool, or without a tool.
    """

    robot: Robot
    hand: Hand
    kinematics: ArmKinematics
    link_names: dict[int, str]
    payload_kg: float
    bears: tuple[str, ...]
    press_n: Vector
    yields: bool
    setpoint: Setpoint | None
    shows_hand: bool
    limit_nm: Vector
    _jaw_target_m: float
    _jaw_goal_m: float
    _jaw_force_n: float

    def __init__(self, robot: Robot) -> None:
        self.robot, self.kinematics = robot, get_kinematics(robot)
        self.payload_kg, self.bears, self.press_n = 0.0, (), np.zeros(3)
        self.setpoint, self.shows_hand, self.yields = None, True, False
        self.limit_nm = np.array(assume_masses(robot.model).torque_nm)

    def fit(self, hand: Hand) -> None:
        """Mount the jaws of another hand, wide open; no body may be fixed to the arm."""

    def stand(self, joints: Vector, opening_m: float) -> None:
        """Put the arm at rest in a posture [rad], with the jaws open by `opening_m`."""

    def tip(self) -> TipPose:
        """Return the pose of the tip."""

    def tip_error_m(self) -> float:
        """Return the distance between the tip and its target [m]."""

    def joints_rad(self) -> tuple[float, ...]:
        """Return the joint angles [rad]."""

    def jaw_width_m(self) -> float:
        """Return the distance between the jaws [m]."""

    def open(self, opening_m: float) -> None:
        """Begin to open the jaws to a distance."""
        self._jaw_target_m = self.jaw_width_m() / 2
        self._jaw_goal_m, self._jaw_force_n = opening_m / 2, _OPENING_FORCE_N

    def close(self, force_n: float, *, outwards: bool = False) -> None:
        """Begin to close the jaws, or to open them inside a hole, until they grip with a force."""
        self._jaw_target_m = self.jaw_width_m() / 2
        self._jaw_goal_m = self.hand.opening_m / 2 if outwards else 0.0
        self._jaw_force_n = force_n

    def _take(self, hand: Hand) -> None:
        self.hand = hand
        self._jaw_target_m = self._jaw_goal_m = hand.opening_m / 2
        self._jaw_force_n = _OPENING_FORCE_N

    def _advance_jaws(self) -> None:
        """Move the targets of the jaws by one step towards their goals."""
        step_m = JAW_SPEED_M_PER_S * STEP_S
        left_m = self._jaw_goal_m - self._jaw_target_m
        self._jaw_target_m += max(-step_m, min(step_m, left_m))

    def _compute_load_mass(self, world: World, jacobian: Vector) -> Vector:
        """Return the share of the load in the mass matrix [kg m2], shape (joints, joints).

        Drives of the field are told it, too: without it they swing a wrist as if it were alone, and
        the hand tilts by tenths of a degree with a light, long part.

        Parameters
        ----------
        jacobian
            Jacobian of the tip, linear above angular velocity, shape (6, joints).
        """
        count = jacobian.shape[1]
        mass = np.zeros((count, count))
        linear, angular = jacobian[:3], jacobian[3:]
        tip = self.tip().position
        for name in self.bears:
            x, y, z = (world.centre(name) - tip).tolist()
            moves = linear + times(np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]), angular)
            tensor = times(world.inertia_kg_m2(name), angular)
            mass += world.mass_kg(name) * times(moves.T, moves) + times(angular.T, tensor)
        return mass

    def _find_posture(self, setpoint: Setpoint, near_rad: Vector) -> Vector:
        """Return joint angles near some for the target of the tip."""
        if setpoint.tracks_joints:
            return setpoint.posture
        x, y, z = setpoint.position.tolist()
        posture = self.kinematics.follow((x, y, z), setpoint.rotation, near_rad)
        if posture is None:
            raise make_unreachable_error((x, y, z), setpoint.rotation)
        return posture

    def actuate(self) -> None:
        """Set the motors for the next step."""

    def show_hand(self, visible: bool) -> None:
        """Enable or disable collisions of the hand and its fingers."""

    def grip(self, name: str) -> int:
        """Fix a body to the hand in its current pose; return the constraint."""

    def clasp(self, name: str) -> Grip:
        """Let friction hold a body between the jaws still."""


class Simulator(Protocol):
    """Creates worlds with and without the task's arm."""

    def world(self) -> World:
        """Return a world with only a table."""

    def cell(self, hand: Hand) -> tuple[World, Arm]:
        """Return a world with a table and the task's arm, and the arm."""
