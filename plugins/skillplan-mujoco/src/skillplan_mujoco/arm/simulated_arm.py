"""An arm in a simulated world: its joints, its jaws, and what it holds."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from skillplan.robots.arm_description import Hand
from skillplan.task.scene import Robot
from skillplan_mujoco.arm.control import ArmState, posture_torques, torques
from skillplan_mujoco.arm.smooth_pads import SmoothPads
from skillplan_mujoco.simulator.cell_model import TIP, joint_name
from skillplan_mujoco.simulator.shapes_model import ARM_TORSION_M
from skillplan_mujoco.simulator.world import World
from skillplan_simulation.arm.kinematics import TipPose, kinematics_of, unreachable
from skillplan_simulation.arm.rotations import points_down
from skillplan_simulation.arm.straight_motion import Setpoint
from skillplan_simulation.execution_settings import ExecutionSettings
from skillplan_simulation.simulator import (
    FINGERS,
    GRAVITY_M_PER_S2,
    HAND,
    JAW_SPEED_M_PER_S,
    ROBOT,
    STEP_S,
)

Vector = NDArray[np.float64]

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
        found = self.kinematics.follow((x, y, z), wanted.rotation, self._posture)
        if found is None:
            raise unreachable((x, y, z), wanted.rotation)
        return found

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
