"""The arm of a pybullet world: joints, jaws, payload and tool."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pybullet
from numpy.typing import NDArray
from pydantic import Field

from skillplan.robots.arm_description import Hand
from skillplan.task.scene import Robot
from skillplan_pinocchio.kinematics.fixed_order import cross
from skillplan_pybullet.control import (
    Dynamics,
    PinocchioDynamics,
    PybulletDynamics,
    compute_torques,
    compute_tracking_torques,
)
from skillplan_pybullet.quiet_output import quiet_output
from skillplan_pybullet.robot_file import RobotFile, write_robot_file
from skillplan_pybullet.world import World
from skillplan_simulation.execution_settings import ExecutionSettings
from skillplan_simulation.kinematics import TipPose, is_balanced, points_down
from skillplan_simulation.motions import Setpoint
from skillplan_simulation.robot_shapes import get_hand
from skillplan_simulation.simulator import FINGERS, GRAVITY_M_PER_S2, HAND, ROBOT, Arm
from skillplan_simulation.static_friction import StaticFriction


class SimulationSettings(ExecutionSettings):
    """Settings of motion, grip and contact, and the source of the arm's dynamics."""

    dynamics: Literal["pybullet", "pinocchio"] = Field(
        default="pybullet",
        description="library that computes mass matrix, Jacobian and bias forces",
    )


Vector = NDArray[np.float64]

_FINGER_FRICTION = 1.0
# Torsional friction of a jaw's contact, per unit of normal force [m].
_FINGER_SPINNING_M = 0.01
# Coupling of the fingers; pybullet ignores the one in the description.
_GEAR_ERP = 0.1
_GEAR_FORCE_N = 50.0
# Proportional gain and torque limits of position control.
_POSITION_GAIN = 0.3


class SimulatedArm(Arm):
    """The arm of a world; see `skillplan_simulation.simulator.Arm`.

    Parameters
    ----------
    hand
        Current hand. Default: the one without a tool.
    """

    def __init__(
        self, world: World, robot: Robot, settings: SimulationSettings, hand: Hand | None = None
    ) -> None:
        super().__init__(robot)
        self.world, self.settings = world, settings
        self._load(get_hand(robot) if hand is None else hand)
        self._joints = self.kinematics.home_rad

    def fit(self, hand: Hand) -> None:
        """Mount the jaws of another hand, wide open; no body may be fixed to the arm."""
        if hand == self.hand:
            return
        client = self.world.client
        states = pybullet.getJointStates(self.number, self.file.joints, physicsClientId=client)
        with quiet_output():
            pybullet.removeBody(self.number, physicsClientId=client)
        del self.world.names[self.number]
        self._load(hand)
        for joint, state in zip(self.file.joints, states, strict=True):
            pybullet.resetJointState(self.number, joint, state[0], state[1], physicsClientId=client)
        for joint in self.file.jaws:
            pybullet.resetJointState(
                self.number, joint, self._jaw_goal_m, 0.0, physicsClientId=client
            )
        self.world.renew(ROBOT)

    def _load(self, hand: Hand) -> None:
        """Load the arm with a hand."""
        world, robot, settings = self.world, self.robot, self.settings
        self._take(hand)
        self.file: RobotFile = write_robot_file(robot.model, robot.tip, self.hand)
        # Names of the links that handle parts.
        self.link_names = dict(
            zip((self.file.hand, *self.file.jaws), (HAND, *FINGERS), strict=True)
        )
        world.link_names = self.link_names
        client = world.client
        # Pictures come from the painter, so visual shapes are not loaded.
        flags = pybullet.URDF_USE_INERTIA_FROM_FILE | pybullet.URDF_IGNORE_VISUAL_SHAPES
        with quiet_output():
            self.number = int(
                pybullet.loadURDF(
                    str(self.file.path),
                    basePosition=robot.base,
                    baseOrientation=robot.mount.orientation,
                    useFixedBase=True,
                    flags=flags,
                    physicsClientId=client,
                )
            )
        world.name(self.number, ROBOT)
        # pybullet's own dynamics ignore a tilted base.
        by_pinocchio = settings.dynamics == "pinocchio" or not robot.mount.is_upright
        self.dynamics: Dynamics = (
            PinocchioDynamics(self.file, robot.mount)
            if by_pinocchio
            else PybulletDynamics(client, self.number, self.file, robot.mount)
        )
        self._prepare()

    def _prepare(self) -> None:
        client = self.world.client
        for joint in (*self.file.joints, *self.file.jaws):
            pybullet.setJointMotorControl2(
                self.number, joint, pybullet.VELOCITY_CONTROL, force=0, physicsClientId=client
            )
        gear = pybullet.createConstraint(
            self.number,
            self.file.jaws[0],
            self.number,
            self.file.jaws[1],
            pybullet.JOINT_GEAR,
            (1, 0, 0),
            (0, 0, 0),
            (0, 0, 0),
            physicsClientId=client,
        )
        pybullet.changeConstraint(
            gear, gearRatio=-1, erp=_GEAR_ERP, maxForce=_GEAR_FORCE_N, physicsClientId=client
        )
        for link in self.file.jaws:
            pybullet.changeDynamics(
                self.number,
                link,
                lateralFriction=_FINGER_FRICTION,
                spinningFriction=_FINGER_SPINNING_M,
                frictionAnchor=1,
                physicsClientId=client,
            )

    def stand(self, joints: Vector, opening_m: float) -> None:
        """Put the arm at rest in a posture [rad], with the jaws open by `opening_m`."""
        self._joints = joints
        client = self.world.client
        for joint, angle in zip(self.file.joints, joints.tolist(), strict=True):
            pybullet.resetJointState(self.number, joint, angle, 0.0, physicsClientId=client)
        for joint in self.file.jaws:
            pybullet.resetJointState(self.number, joint, opening_m / 2, 0.0, physicsClientId=client)
        self._jaw_target_m = self._jaw_goal_m = opening_m / 2
        tip = self.kinematics.tip(joints)
        self.setpoint = Setpoint.at_rest(tip.position, tip.rotation, joints)

    def tip(self) -> TipPose:
        """Return the pose of the tip."""
        link = pybullet.getLinkState(
            self.number,
            self.file.hand,
            computeForwardKinematics=True,
            physicsClientId=self.world.client,
        )
        return TipPose(np.array(link[4]), World.rotation(link[5]))

    def tip_error_m(self) -> float:
        """Return the distance between the tip and its target [m]."""
        assert self.setpoint is not None
        return float(np.linalg.norm(self.tip().position - self.setpoint.position))

    def joints_rad(self) -> tuple[float, ...]:
        """Return the joint angles [rad]."""
        states = pybullet.getJointStates(
            self.number, self.file.joints, physicsClientId=self.world.client
        )
        return tuple(state[0] for state in states)

    def jaw_width_m(self) -> float:
        """Return the distance between the jaws [m]."""
        states = pybullet.getJointStates(
            self.number, self.file.jaws, physicsClientId=self.world.client
        )
        return float(states[0][0] + states[1][0])

    def actuate(self) -> None:
        """Set the motors for the next step."""
        self._move_jaws()
        assert self.setpoint is not None
        if self.settings.control == "position":
            self._follow_by_position()
            return
        client = self.world.client
        states = pybullet.getJointStates(
            self.number, (*self.file.joints, *self.file.jaws), physicsClientId=client
        )
        arm = len(self.file.joints)
        angles = np.array([state[0] for state in states])
        rates = np.array([state[1] for state in states])
        lift_n, moment_nm = self._lift()
        terms = self.dynamics.terms(angles, rates)
        load_mass = self._compute_load_mass(self.world, terms.jacobian)
        terms = replace(terms, mass=terms.mass + load_mass)
        if self.setpoint.tracks_joints and self.setpoint.joints is not None:
            torques_nm = compute_tracking_torques(
                terms,
                angles[:arm],
                rates[:arm],
                self.setpoint.posture,
                self.setpoint.joints,
                stiffness_per_s2=self.settings.stiffness_per_s2,
                load=np.concatenate([lift_n, moment_nm]),
                limit_nm=self.limit_nm,
            )
        else:
            torques_nm = compute_torques(
                terms,
                angles[:arm],
                rates[:arm],
                self.tip(),
                self.setpoint,
                stiffness_per_s2=self.settings.stiffness_per_s2,
                force_n=lift_n + self.press_n,
                moment_nm=moment_nm,
                limit_nm=self.limit_nm,
            )
        pybullet.setJointMotorControlArray(
            self.number,
            self.file.joints,
            pybullet.TORQUE_CONTROL,
            forces=torques_nm.tolist(),
            physicsClientId=client,
        )

    def _lift(self) -> tuple[Vector, Vector]:
        """Return the force [N] and the moment about the tip [N m] that bear the payload.

        Under a hand that points down, a small moment is neglected.
        """
        assert self.setpoint is not None
        lift_n = np.array([0.0, 0.0, self.payload_kg * GRAVITY_M_PER_S2])
        moment_nm = np.zeros(3)
        if not self.bears:
            return lift_n, moment_nm
        tip = self.tip().position
        for name in self.bears:
            weight_n = np.array([0.0, 0.0, self.world.mass_kg(name) * GRAVITY_M_PER_S2])
            moment_nm += cross(self.world.centre(name) - tip, weight_n)
        if points_down(self.setpoint.rotation) and is_balanced(moment_nm):
            return lift_n, np.zeros(3)
        return lift_n, moment_nm

    def grip_friction(self, friction: float) -> tuple[float, float]:
        """Return the lateral [-] and torsional friction [m] between a jaw and a body."""
        return _FINGER_FRICTION * friction, _FINGER_SPINNING_M * friction

    def show_hand(self, visible: bool) -> None:
        """Enable or disable collisions of the hand and its fingers."""
        self.shows_hand = visible
        self.world.withdraw(ROBOT, () if visible else (self.file.hand, *self.file.jaws))

    def grip(self, name: str) -> int:
        """Fix a body to the hand in its current pose; return the constraint."""
        client = self.world.client
        other = self.world.numbers[name]
        link = pybullet.getLinkState(
            self.number, self.file.hand, computeForwardKinematics=True, physicsClientId=client
        )
        position, orientation = pybullet.getBasePositionAndOrientation(
            other, physicsClientId=client
        )
        # Fixed joints are relative to the hand's centre of mass.
        away = pybullet.invertTransform(link[0], link[1])
        offset, turn = pybullet.multiplyTransforms(*away, position, orientation)
        return int(
            pybullet.createConstraint(
                self.number,
                self.file.hand,
                other,
                -1,
                pybullet.JOINT_FIXED,
                (0, 0, 0),
                offset,
                (0, 0, 0),
                turn,
                (0, 0, 0, 1),
                physicsClientId=client,
            )
        )

    def clasp(self, name: str) -> StaticFriction:
        """Let friction hold a body between the jaws still."""
        return StaticFriction(self.world, self, name)

    def _move_jaws(self) -> None:
        self._advance_jaws()
        pybullet.setJointMotorControlArray(
            self.number,
            self.file.jaws,
            pybullet.POSITION_CONTROL,
            targetPositions=[self._jaw_target_m] * 2,
            forces=[self._jaw_force_n] * 2,
            physicsClientId=self.world.client,
        )

    def _follow_by_position(self) -> None:
        assert self.setpoint is not None
        self._joints = self._find_posture(self.setpoint, self._joints)
        pybullet.setJointMotorControlArray(
            self.number,
            self.file.joints,
            pybullet.POSITION_CONTROL,
            targetPositions=self._joints.tolist(),
            forces=self.limit_nm.tolist(),
            positionGains=[_POSITION_GAIN] * len(self.file.joints),
            physicsClientId=self.world.client,
        )
