"""The arm of a MuJoCo world: torque control, jaws, and the friction grip.

The control laws equal `skillplan_pybullet.control`, with every sum in a fixed order.
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
from skillplan_mujoco.cell_model import ARM_TORSION_M, TIP, format_joint_name
from skillplan_mujoco.world import World, multiply, multiply_matrices, multiply_transposed
from skillplan_pinocchio.kinematics.fixed_order import solve_linear
from skillplan_simulation.execution_settings import ExecutionSettings
from skillplan_simulation.kinematics import (
    TipPose,
    compute_rotation_left,
    is_balanced,
    points_down,
    resolve_acceleration,
)
from skillplan_simulation.motions import Setpoint
from skillplan_simulation.simulator import (
    FINGERS,
    GRAVITY_M_PER_S2,
    HAND,
    ROBOT,
    STEP_S,
    STEPS_PER_S,
    Arm,
)
from skillplan_simulation.static_friction import HoldingArm, StaticFriction

Vector = NDArray[np.float64]

# Stiffness of the null-space motion towards the posture [1/s2].
_NULLSPACE_STIFFNESS_PER_S2 = 400.0
# Springs of a tip that yields, as of a compliance device [N/m], [N m/rad], and their damping ratio.
SPRING_N_PER_M, _SPRING_NM_PER_RAD = 1e4, 200.0
_SPRING_DAMPING = 0.7
# Steps of control in a step of the world on springs, as the hand is light, and for parts that land.
_FINE_STEPS, _LANDING_STEPS = 4, 10
# Share of a joint's lag that position control removes in one step [-].
_SERVO_SHARE = 0.3


@dataclass(slots=True)
class ArmState:
    """State of the arm that control reads; overwritten in every step.

    Parameters
    ----------
    angles, rates
        Joint angles [rad] and rates [rad/s], shape (joints,).
    mass
        Mass matrix [kg m2], shape (joints, joints).
    jacobian
        Jacobian of the tip, linear above angular velocity, shape (6, joints).
    bias
        Torques of gravity, centrifugal and Coriolis forces [N m], shape (joints,).
    """

    angles: Vector
    rates: Vector
    tip: TipPose
    mass: Vector
    jacobian: Vector
    bias: Vector


def compute_torques(
    state: ArmState,
    setpoint: Setpoint,
    stiffness_per_s2: float,
    load: Vector,
    *,
    yields: bool = False,
) -> Vector:
    """Return joint torques [N m], shape (joints,).

    Parameters
    ----------
    setpoint
        Target of the tip or of every joint.
    stiffness_per_s2
        Stiffness per unit of inertia; damping is critical.
    load
        Additional force [N] and moment [N m] that the tip exerts, shape (6,).
    yields
        True if the tip is on damped springs, which contacts push aside. A tip that is accelerated
        like a free mass presses across its way where contacts stop it.
    """
    if setpoint.tracks_joints and setpoint.joints is not None:
        gain = (
            setpoint.joints.accelerations_rad_per_s2
            + stiffness_per_s2 * (setpoint.posture - state.angles)
            + 2 * math.sqrt(stiffness_per_s2) * (setpoint.joints.speeds_rad_per_s - state.rates)
        )
        return multiply(state.mass, gain) + state.bias + multiply_transposed(state.jacobian, load)
    jacobian = state.jacobian
    if jacobian.shape[1] < len(jacobian):
        aims = _compute_acceleration(state, setpoint, stiffness_per_s2)
        gain = resolve_acceleration(jacobian, aims)
        return multiply(state.mass, gain) + state.bias + multiply_transposed(jacobian, load)
    # Column: joint accelerations caused by a unit force or moment at the tip.
    yielding = solve_linear(state.mass, jacobian.T)
    pull = _compute_pull(state, setpoint)
    # Both remove the component of the pull that would move the tip.
    mobility = multiply_matrices(jacobian, yielding)
    if yields:
        load = load + _compute_springs(state, setpoint, mobility)
        aims = np.pad(setpoint.acceleration, (0, 3))
    else:
        aims = _compute_acceleration(state, setpoint, stiffness_per_s2)
    wrench = solve_linear(mobility, aims - multiply(jacobian, pull)) + load
    return multiply_transposed(jacobian, wrench) + state.bias + multiply(state.mass, pull)


def compute_posture_torques(state: ArmState, posture: Vector, load: Vector) -> Vector:
    """Return the torques of joint servos that follow a posture [N m], shape (joints,).

    Each joint aims at the speed that removes a fixed share of its lag in one step.

    Parameters
    ----------
    posture
        Target joint angles [rad], shape (joints,).
    load
        Additional force [N] and moment [N m] that the tip exerts, shape (6,).
    """
    speeds = _SERVO_SHARE * STEPS_PER_S * (posture - state.angles)
    gain = STEPS_PER_S * (speeds - state.rates)
    return multiply(state.mass, gain) + state.bias + multiply_transposed(state.jacobian, load)


def _compute_acceleration(state: ArmState, setpoint: Setpoint, stiffness_per_s2: float) -> Vector:
    """Return the target acceleration of the tip, linear before angular, shape (6,)."""
    damping_per_s = 2 * math.sqrt(stiffness_per_s2)
    gains = [
        stiffness_per_s2 * away + damping_per_s * lag
        for away, lag in zip(*_compute_errors(state, setpoint), strict=True)
    ]
    for axis, gain in enumerate(setpoint.acceleration.tolist()):
        gains[axis] += gain
    return np.array(gains)


def _compute_errors(state: ArmState, setpoint: Setpoint) -> tuple[list[float], list[float]]:
    """Return the lags of the tip in pose and velocity, linear before angular, six each."""
    # Floats are faster here than arrays of three.
    away = (setpoint.position - state.tip.position).tolist()
    away += compute_rotation_left(state.tip.rotation, setpoint.rotation)
    rates = [*setpoint.velocity.tolist(), *setpoint.spin_rad_per_s.tolist()]
    moves = multiply(state.jacobian, state.rates).tolist()
    return away, [rate - move for rate, move in zip(rates, moves, strict=True)]


def _compute_springs(state: ArmState, setpoint: Setpoint, mobility: Vector) -> Vector:
    """Return the force [N] and moment [N m] of damped springs on the tip, shape (6,).

    Parameters
    ----------
    mobility
        Accelerations of the tip by unit forces and moments, shape (6, 6).
    """
    away, lag = map(np.array, _compute_errors(state, setpoint))
    springs = np.zeros(6)
    for rows, stiffness in ((slice(0, 3), SPRING_N_PER_M), (slice(3, 6), _SPRING_NM_PER_RAD)):
        inertia = 3 / sum(mobility.diagonal()[rows].tolist())
        damping = _SPRING_DAMPING * 2 * math.sqrt(stiffness * inertia)
        springs[rows] = stiffness * away[rows] + damping * lag[rows]
    return springs


def _compute_pull(state: ArmState, setpoint: Setpoint) -> Vector:
    """Return the accelerations that draw the joints to their posture, shape (joints,)."""
    firmness = _NULLSPACE_STIFFNESS_PER_S2
    away, lag = setpoint.posture - state.angles, -state.rates
    if setpoint.joints is not None:
        lag = setpoint.joints.speeds_rad_per_s - state.rates
    pull: Vector = firmness * away + 2 * math.sqrt(firmness) * lag
    if setpoint.joints is not None:
        pull = pull + setpoint.joints.accelerations_rad_per_s2
    return pull


class SmoothPads(StaticFriction):
    """Holds a part still between the jaws as long as friction can; see `StaticFriction`.

    Frictional contacts would hold the part as well, but not in place: each step moves the arm along
    the tangent of its path, and contacts do not correct the error, 0.2 mm in a lift by 0.25 m. They
    would pull against the bond with full force, so the pads have no friction meanwhile.

    Parameters
    ----------
    world, arm
        World and arm of the jaws.
    """

    world: World

    def __init__(self, world: World, arm: HoldingArm, name: str) -> None:
        super().__init__(world, arm, name)
        if self.constraint is not None:
            world.smooth(FINGERS)

    def let_go(self) -> None:
        """Release the part to its contacts."""
        if self.constraint is not None:
            self.world.roughen(FINGERS)
        super().let_go()


# Stiffness [N/m] and damping [N s/m] of a jaw's position control. Its force saturates on a part.
_JAW_STIFFNESS_N_PER_M, _JAW_DAMPING_N_S_PER_M = 4000.0, 40.0
# Lag of a jaw that meets a part [m], and the time in which its force then grows [s].
_BLOCKED_M, _GROWS_S = 0.001, 0.1


class SimulatedArm(Arm):
    """The arm of a world; see `skillplan_simulation.simulator.Arm`.

    Parameters
    ----------
    hand
        Current hand, one of those in the model.
    """

    def __init__(self, world: World, robot: Robot, settings: ExecutionSettings, hand: Hand) -> None:
        super().__init__(robot)
        self.world, self.settings = world, settings
        self.link_names = {world.ids[name]: name for name in (HAND, *FINGERS)}
        model = world.model
        # The joints of the arm come first, then the joints of the jaws.
        self._count = len(robot.model.joints)
        assert int(model.joint(format_joint_name(self._count - 1)).dofadr[0]) == self._count - 1
        self._jaws = [int(model.joint(name).dofadr[0]) for name in FINGERS]
        self._site = int(model.site(TIP).id)
        data, count = world.data, self._count
        # Views of the simulator's state, which every step overwrites in place.
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
        self._entries = find_mass_entries(model, count)
        self._posture: Vector = self.kinematics.home_rad
        self._take(hand)

    def fit(self, hand: Hand) -> None:
        """Mount the jaws of another hand, wide open; no body may be fixed to the arm."""
        if hand == self.hand:
            return
        self._take(hand)
        data = self.world.data
        data.qpos[self._jaws] = self._jaw_goal_m
        data.qvel[self._jaws] = 0.0
        self.world.placed()

    def _take(self, hand: Hand) -> None:
        super()._take(hand)
        self.world.fit(hand)

    def stand(self, joints: Vector, opening_m: float) -> None:
        """Put the arm at rest in a posture [rad], with the jaws open by `opening_m`."""
        data = self.world.data
        data.qpos[: self._count] = joints
        data.qpos[self._jaws] = opening_m / 2
        data.qvel[: self._count] = 0.0
        data.qvel[self._jaws] = 0.0
        self._jaw_target_m = self._jaw_goal_m = opening_m / 2
        self.world.placed()
        self._posture = joints
        tip = self.kinematics.tip(joints)
        self.setpoint = Setpoint.at_rest(tip.position, tip.rotation, joints)

    def tip(self) -> TipPose:
        """Return the pose of the tip."""
        return TipPose(np.array(self._tip_at), np.array(self._tip_turned))

    def tip_error_m(self) -> float:
        """Return the distance between the tip and its target [m]."""
        assert self.setpoint is not None
        here: list[float] = self._tip_at.tolist()
        return math.dist(here, self.setpoint.position.tolist())

    def joints_rad(self) -> tuple[float, ...]:
        """Return the joint angles [rad]."""
        return tuple(self._angles.tolist())

    def jaw_width_m(self) -> float:
        """Return the distance between the jaws [m]."""
        left, right = self.world.data.qpos[self._jaws].tolist()
        return float(left + right)

    def close(self, force_n: float, *, outwards: bool = False) -> None:
        """Begin to close the jaws, or to open them inside a hole, until they grip with a force."""
        super().close(force_n, outwards=outwards)
        # Beyond the part, so that thin parts feel the whole force, too.
        beyond_m = force_n / _JAW_STIFFNESS_N_PER_M
        self._jaw_goal_m += beyond_m if outwards else -beyond_m

    def actuate(self) -> None:
        """Set torques and jaw forces for the next step."""
        # Servos of joints do not yield. A part that has sunk into many pieces is pushed aside.
        is_fine = (self.yields and self.settings.control == "osc") or self.world.moves_thin()
        is_landing = self.world.has_falling()
        count = _LANDING_STEPS if is_landing else _FINE_STEPS if is_fine else 1
        self.world.divide(count, stiff=is_landing)
        self.world.prepare()
        self._move_jaws()
        self._set_torques()
        for _ in range(count - 1):
            self.world.advance()
            self.world.prepare()
            self._set_torques()

    def _set_torques(self) -> None:
        """Set the torques of the joints for the state of the world."""
        assert self.setpoint is not None
        jacobian, state = self._jacobian, self._state
        mujoco.mj_jacSite(self.world.model, self.world.data, jacobian[:3], jacobian[3:], self._site)
        state.jacobian[:] = jacobian[:, : self._count]
        state.mass = self.world.data.M[self._entries]
        state.mass += self._compute_load_mass(self.world, state.jacobian)
        if self.settings.control == "position":
            self._posture = self._find_posture(self.setpoint, self._posture)
            torques_nm = compute_posture_torques(state, self._posture, self._load())
        else:
            torques_nm = compute_torques(
                state,
                self.setpoint,
                self.settings.stiffness_per_s2,
                self._load(),
                yields=self.yields,
            )
        self._applied[:] = np.minimum(np.maximum(torques_nm, -self.limit_nm), self.limit_nm)

    def show_hand(self, visible: bool) -> None:
        """Enable or disable collisions of the hand and its fingers."""
        self.shows_hand = visible
        self.world.withdraw(ROBOT, () if visible else self.link_names)

    def grip(self, name: str) -> int:
        """Fix a body to the hand in its current pose; return the constraint."""
        return self.world.bond(self.world.ids[HAND], self.world.numbers[name])

    def grip_friction(self, friction: float) -> tuple[float, float]:
        """Return the lateral [-] and torsional friction [m] between a jaw and a body."""
        return friction, ARM_TORSION_M * friction

    def clasp(self, name: str) -> SmoothPads:
        """Let friction hold a body between the jaws still."""
        return SmoothPads(self.world, self, name)

    def _load(self) -> Vector:
        """Return the force [N] and moment [N m] that bear the payload and press, shape (6,).

        Under a hand that points down, a small moment of the payload is neglected.
        """
        assert self.setpoint is not None
        load = np.zeros(6)
        load[2] = self.payload_kg * GRAVITY_M_PER_S2
        if not self.setpoint.tracks_joints:
            # A travel does not press.
            load[:3] += self.press_n
        for name in self.bears:
            x_m, y_m, _ = (self.world.centre(name) - self._tip_at).tolist()
            weight_n = self.world.mass_kg(name) * GRAVITY_M_PER_S2
            load[3] += y_m * weight_n
            load[4] -= x_m * weight_n
        if points_down(self.setpoint.rotation) and is_balanced(load[3:]):
            load[3:] = 0.0
        return load

    def _move_jaws(self) -> None:
        lag_m = self._jaw_target_m - self.jaw_width_m() / 2
        if abs(lag_m) > _BLOCKED_M:
            # Target and force grow faster on a part.
            grown_m = self._jaw_force_n / _JAW_STIFFNESS_N_PER_M * STEP_S / _GROWS_S
            left_m = self._jaw_goal_m - self._jaw_target_m
            self._jaw_target_m += max(-grown_m, min(grown_m, left_m))
        self._advance_jaws()
        most_n = self._jaw_force_n
        for jaw in self._jaws:
            away_m = self._jaw_target_m - float(self._qpos[jaw])
            speed_m_per_s = float(self._qvel[jaw])
            force_n = _JAW_STIFFNESS_N_PER_M * away_m - _JAW_DAMPING_N_S_PER_M * speed_m_per_s
            applied_n = max(-most_n, min(most_n, force_n)) + float(self._all_bias[jaw])
            self._all_applied[jaw] = applied_n


def find_mass_entries(model: Any, count: int) -> NDArray[np.intp]:
    """Return indices of the mass matrix of the first joints in MuJoCo's sparse one.

    MuJoCo stores the nonzero entries of the lower triangle row by row. All joints of an arm are
    coupled.
    """
    entries = np.zeros((count, count), dtype=np.intp)
    for row in range(count):
        begin = int(model.M_rowadr[row])
        columns = model.M_colind[begin : begin + int(model.M_rownnz[row])].tolist()
        for column in range(row + 1):
            entries[row, column] = entries[column, row] = begin + columns.index(column)
    return entries
