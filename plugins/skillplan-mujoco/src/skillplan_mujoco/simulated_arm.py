"""Torques of the joints: by operational space for the tip, or for every joint on its own.

The laws are those of the other engine (`operational_space` and `joint_tracking` there), written so
that every sum has a fixed order.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from skillplan.robots.arm_description import Hand
from skillplan.task.scene import Robot
from skillplan_mujoco.cell_model import ARM_TORSION_M, TIP, joint_name
from skillplan_mujoco.world import World, product, times, times_transposed
from skillplan_pinocchio.kinematics.fixed_order import solved
from skillplan_simulation.execution_settings import ExecutionSettings
from skillplan_simulation.kinematics import (
    TipPose,
    kinematics_of,
    points_down,
    rotation_left,
    unreachable,
)
from skillplan_simulation.motions import Setpoint
from skillplan_simulation.simulator import (
    FINGERS,
    GRAVITY_M_PER_S2,
    HAND,
    JAW_SPEED_M_PER_S,
    ROBOT,
    STEP_S,
    STEPS_PER_S,
)
from skillplan_simulation.static_friction import HoldingArm, StaticFriction

Vector = NDArray[np.float64]

# How firmly the arm is drawn to its posture [1/s2].
_NULLSPACE_STIFFNESS_PER_S2 = 400.0
# So much of what a joint lags behind is to be gone after one step, under control by position [-].
_SERVO_SHARE = 0.3


@dataclass(slots=True)
class ArmState:
    """What control has to know of the arm; written anew for every step.

    Parameters
    ----------
    angles, rates
        Joint angles [rad] and rates [rad/s], shape (joints,).
    tip
        Where the tip is.
    mass
        Mass matrix [kg m2], shape (joints, joints).
    jacobian
        Of the tip, linear above angular velocity, shape (6, joints).
    bias
        Torques of gravity, centrifugal and Coriolis forces [N m], shape (joints,).
    """

    angles: Vector
    rates: Vector
    tip: TipPose
    mass: Vector
    jacobian: Vector
    bias: Vector


def torques(state: ArmState, wanted: Setpoint, stiffness_per_s2: float, load: Vector) -> Vector:
    """Return joint torques [N m], shape (joints,).

    Parameters
    ----------
    state
        Of the arm.
    wanted
        Where the tip is to be, or every joint.
    stiffness_per_s2
        Stiffness by unit of inertia; damping is critical.
    load
        Force [N] and moment [N m] that the tip exerts besides, shape (6,).
    """
    if wanted.tracks_joints and wanted.joints is not None:
        gain = (
            wanted.joints.accelerations_rad_per_s2
            + stiffness_per_s2 * (wanted.posture - state.angles)
            + 2 * math.sqrt(stiffness_per_s2) * (wanted.joints.speeds_rad_per_s - state.rates)
        )
        return times(state.mass, gain) + state.bias + times_transposed(state.jacobian, load)
    jacobian = state.jacobian
    # Each column how the joints are accelerated by a force or moment at the tip.
    yielding = solved(state.mass, jacobian.T)
    pull = _pull(state, wanted)
    # What of the pull would move the tip is taken from it.
    lacking = _acceleration(state, wanted, stiffness_per_s2) - times(jacobian, pull)
    wrench = solved(product(jacobian, yielding), lacking) + load
    return times_transposed(jacobian, wrench) + state.bias + times(state.mass, pull)


def posture_torques(state: ArmState, posture: Vector, load: Vector) -> Vector:
    """Return joint torques that follow a posture as servos do, one for every joint [N m].

    Each has its joint turn, after one step, as fast as takes away a share of what it lags behind.

    Parameters
    ----------
    state
        Of the arm.
    posture
        Where the joints are to be [rad], shape (joints,).
    load
        Force [N] and moment [N m] that the tip exerts besides, shape (6,).
    """
    speeds = _SERVO_SHARE * STEPS_PER_S * (posture - state.angles)
    gain = STEPS_PER_S * (speeds - state.rates)
    return times(state.mass, gain) + state.bias + times_transposed(state.jacobian, load)


def _acceleration(state: ArmState, wanted: Setpoint, stiffness_per_s2: float) -> Vector:
    """Return how the tip is to be accelerated, linear before angular, shape (6,)."""
    # Numbers are quicker here than arrays of three.
    away = (wanted.position - state.tip.position).tolist()
    away += rotation_left(state.tip.rotation, wanted.rotation)
    rates = [*wanted.velocity.tolist(), *wanted.spin_rad_per_s.tolist()]
    moves = times(state.jacobian, state.rates).tolist()
    damping_per_s = 2 * math.sqrt(stiffness_per_s2)
    found = [
        stiffness_per_s2 * lack + damping_per_s * (rate - move)
        for lack, rate, move in zip(away, rates, moves, strict=True)
    ]
    for axis, gain in enumerate(wanted.acceleration.tolist()):
        found[axis] += gain
    return np.array(found)


def _pull(state: ArmState, wanted: Setpoint) -> Vector:
    """Return the accelerations that draw the joints to their posture, shape (joints,)."""
    firmness = _NULLSPACE_STIFFNESS_PER_S2
    away, lag = wanted.posture - state.angles, -state.rates
    if wanted.joints is not None:
        lag = wanted.joints.speeds_rad_per_s - state.rates
    pull: Vector = firmness * away + 2 * math.sqrt(firmness) * lag
    if wanted.joints is not None:
        pull = pull + wanted.joints.accelerations_rad_per_s2
    return pull


class SmoothPads(StaticFriction):
    """Holds a part still in the jaws while friction can; see `StaticFriction`.

    Contacts with friction would hold it as well, yet not where it was: a step leads an arm along
    the tangent of its way, and contacts let stand by how much it ends beside it, 0.2 mm in a lift
    by 0.25 m. They would draw at the bond with all that they have.

    Parameters
    ----------
    world, arm
        Where, and whose jaws.
    name
        Of the part.
    """

    world: World

    def __init__(self, world: World, arm: HoldingArm, name: str) -> None:
        super().__init__(world, arm, name)
        if self.constraint is not None:
            world.smooth(FINGERS)

    def let_go(self) -> None:
        """Leave the part to its contacts."""
        if self.constraint is not None:
            self.world.roughen(FINGERS)
        super().let_go()


# With what force jaws are held open [N], and how firmly each follows where it is to be [N/m],
# [N s/m]: closing on a part, it is farther off than its force allows.
_OPENING_FORCE_N = 40.0
_JAW_STIFFNESS_N_PER_M, _JAW_DAMPING_N_S_PER_M = 4000.0, 40.0


class SimulatedArm:
    """The arm of a world; see `skillplan_simulation.simulator.Arm`.

    Parameters
    ----------
    world
        Whose arm it is.
    robot
        Of the task.
    settings
        How it is controlled.
    hand
        What jaws it has: some of those of the model.
    """

    def __init__(self, world: World, robot: Robot, settings: ExecutionSettings, hand: Hand) -> None:
        self.world, self.robot, self.settings = world, robot, settings
        self.kinematics = kinematics_of(robot)
        self.link_names = {world.ids[name]: name for name in (HAND, *FINGERS)}
        self.payload_kg = 0.0
        self.bears: tuple[str, ...] = ()
        self.press_n: Vector = np.zeros(3)
        self.wanted: Setpoint | None = None
        self.shows_hand = True
        self.limit_nm = np.array(robot.model.torque_nm)
        model = world.model
        # Joints of the arm come first, and those of the jaws after them.
        self._count = len(robot.model.joints)
        assert int(model.joint(joint_name(self._count - 1)).dofadr[0]) == self._count - 1
        self._jaws = [int(model.joint(name).dofadr[0]) for name in FINGERS]
        self._site = int(model.site(TIP).id)
        data, count = world.data, self._count
        # Parts of the simulator's state, which every step writes anew in the same place.
        self._angles, self._rates = data.qpos[:count], data.qvel[:count]
        self._bias, self._applied = data.qfrc_bias[:count], data.qfrc_applied[:count]
        self._tip_at = data.site_xpos[self._site]
        self._tip_turned = data.site_xmat[self._site].reshape(3, 3)
        self._jacobian = np.zeros((6, model.nv))
        self._qpos, self._qvel = data.qpos, data.qvel
        self._all_bias, self._all_applied = data.qfrc_bias, data.qfrc_applied
        self._state = ArmState(
            self._angles,
            self._rates,
            TipPose(self._tip_at, self._tip_turned),
            np.zeros((count, count)),
            np.zeros((6, count)),
            self._bias,
        )
        self._entries = mass_entries(model, count)
        self._posture: Vector = self.kinematics.home_rad
        self._take(hand)

    def fit(self, hand: Hand) -> None:
        """Have the jaws of another hand, wide open; nothing may be fixed to the arm."""
        if hand == self.hand:
            return
        self._take(hand)
        data = self.world.data
        data.qpos[self._jaws] = self._jaw_wanted_m
        data.qvel[self._jaws] = 0.0
        self.world.placed()

    def _take(self, hand: Hand) -> None:
        self.hand = hand
        self.world.fit(hand)
        self._jaw_target_m = self._jaw_wanted_m = hand.opening_m / 2
        self._jaw_force_n = _OPENING_FORCE_N

    def stand(self, joints: Vector, opening_m: float) -> None:
        """Put the arm at rest in a posture [rad], its jaws so far open."""
        data = self.world.data
        data.qpos[: self._count] = joints
        data.qpos[self._jaws] = opening_m / 2
        data.qvel[: self._count] = 0.0
        data.qvel[self._jaws] = 0.0
        self._jaw_target_m = self._jaw_wanted_m = opening_m / 2
        self.world.placed()
        self._posture = joints
        tip = self.kinematics.tip(joints)
        self.wanted = Setpoint.at_rest(tip.position, tip.rotation, joints)

    def tip(self) -> TipPose:
        """Return where the tip is."""
        return TipPose(np.array(self._tip_at), np.array(self._tip_turned))

    def tip_error_m(self) -> float:
        """Return how far the tip is from where it is to be [m]."""
        assert self.wanted is not None
        here: list[float] = self._tip_at.tolist()
        return math.dist(here, self.wanted.position.tolist())

    def joints_rad(self) -> tuple[float, ...]:
        """Return the joint angles [rad]."""
        return tuple(self._angles.tolist())

    def jaw_width_m(self) -> float:
        """Return the distance between the jaws [m]."""
        left, right = self.world.data.qpos[self._jaws].tolist()
        return float(left + right)

    def open(self, opening_m: float) -> None:
        """Begin to open the jaws to a distance."""
        self._jaw_target_m = self.jaw_width_m() / 2
        self._jaw_wanted_m, self._jaw_force_n = opening_m / 2, _OPENING_FORCE_N

    def close(self, force_n: float) -> None:
        """Begin to close the jaws until they grip with a force."""
        self._jaw_target_m = self.jaw_width_m() / 2
        self._jaw_wanted_m, self._jaw_force_n = 0.0, force_n

    def actuate(self) -> None:
        """Set torques and forces for the step to come."""
        assert self.wanted is not None
        self.world.prepare()
        self._move_jaws()
        jacobian, state = self._jacobian, self._state
        mujoco.mj_jacSite(self.world.model, self.world.data, jacobian[:3], jacobian[3:], self._site)
        state.mass = self.world.data.M[self._entries]
        state.jacobian[:] = jacobian[:, : self._count]
        if self.settings.control == "position":
            self._posture = self._posture_for(self.wanted)
            found = posture_torques(state, self._posture, self._load())
        else:
            found = torques(state, self.wanted, self.settings.stiffness_per_s2, self._load())
        self._applied[:] = np.minimum(np.maximum(found, -self.limit_nm), self.limit_nm)

    def _posture_for(self, wanted: Setpoint) -> Vector:
        """Return joint angles near the last ones that bring the tip where it is to be."""
        if wanted.tracks_joints:
            return wanted.posture
        x, y, z = wanted.position.tolist()
        follow = self.kinematics.follow((x, y, z), wanted.rotation, self._posture)
        if follow is None:
            raise unreachable((x, y, z), wanted.rotation)
        return follow

    def show_hand(self, visible: bool) -> None:
        """Take the hand and its fingers out of collision, or put them back."""
        self.shows_hand = visible
        self.world.withdraw(ROBOT, () if visible else self.link_names)

    def grip(self, name: str) -> int:
        """Fix a body to the hand as it is; return the constraint."""
        return self.world.bond(self.world.ids[HAND], self.world.numbers[name])

    def grip_friction(self, friction: float) -> tuple[float, float]:
        """Return lateral [-] and torsional friction [m] between a jaw and what has a friction."""
        return friction, ARM_TORSION_M * friction

    def clasp(self, name: str) -> SmoothPads:
        """Have friction hold a body that is between the jaws still."""
        return SmoothPads(self.world, self, name)

    def _load(self) -> Vector:
        """Return force [N] and moment [N m] that bear the payload and press, shape (6,).

        Beneath a hand that points down, the moment of the payload counts for nothing.
        """
        assert self.wanted is not None
        load = np.zeros(6)
        load[2] = self.payload_kg * GRAVITY_M_PER_S2
        if not self.wanted.tracks_joints:
            # On a travel nothing is pressed.
            load[:3] += self.press_n
        if points_down(self.wanted.rotation):
            return load
        for name in self.bears:
            x_m, y_m, _ = (self.world.centre(name) - self._tip_at).tolist()
            weight_n = self.world.mass_kg(name) * GRAVITY_M_PER_S2
            load[3] += y_m * weight_n
            load[4] -= x_m * weight_n
        return load

    def _move_jaws(self) -> None:
        step_m = JAW_SPEED_M_PER_S * STEP_S
        left_m = self._jaw_wanted_m - self._jaw_target_m
        self._jaw_target_m += max(-step_m, min(step_m, left_m))
        most_n = self._jaw_force_n
        for jaw in self._jaws:
            away_m = self._jaw_target_m - float(self._qpos[jaw])
            speed_m_per_s = float(self._qvel[jaw])
            force_n = _JAW_STIFFNESS_N_PER_M * away_m - _JAW_DAMPING_N_S_PER_M * speed_m_per_s
            applied_n = max(-most_n, min(most_n, force_n)) + float(self._all_bias[jaw])
            self._all_applied[jaw] = applied_n


def mass_entries(model: Any, count: int) -> NDArray[np.intp]:
    """Return where the mass matrix of the first joints is in the simulator's own, row by row.

    That holds the lower triangle, of each row only what is not zero; no joint of an arm is apart
    from another.
    """
    found = np.zeros((count, count), dtype=np.intp)
    for row in range(count):
        begin = int(model.M_rowadr[row])
        columns = model.M_colind[begin : begin + int(model.M_rownnz[row])].tolist()
        for column in range(row + 1):
            found[row, column] = found[column, row] = begin + columns.index(column)
    return found
