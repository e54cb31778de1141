"""A pinocchio model of any described arm, with its base and the tool on its flange."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from skillplan.robots.arm_description import ArmDescription, Joint, LinkInertia, Transform

Vector = NDArray[np.float64]

_NOWHERE = Transform()


class SerialArm:
    """A mounted arm: pose of its tip, and Jacobian.

    Calls are independent but share work memory: use one object per thread.

    Parameters
    ----------
    base
        Pose of the base in the world, as a `Transform` or `pinocchio.SE3`.
    tool
        Pose of the tip in the frame of the flange.

    Attributes
    ----------
    base, flange_to_tip
        Poses as `pinocchio.SE3`.
    low_rad, high_rad
        Joint limits [rad], shape (joints,).
    home_rad
        Home posture [rad], shape (joints,).
    model
        `pinocchio.Model` with masses and the frame `tip`.
    coupling
        Motions of all joints per motion of the independent ones, shape (joints, freedoms); None if
        no joint follows another.

    Examples
    --------
    >>> from skillplan.robots.catalogue import UR5E
    >>> SerialArm(UR5E).tip(np.zeros(6)).translation.round(4).tolist()
    [-0.8172, -0.2329, 0.0628]
    """

    def __init__(
        self, description: ArmDescription, base: Any = _NOWHERE, tool: Transform = _NOWHERE
    ) -> None:
        self.description = description
        self.base = make_placement(base)
        self.flange_to_tip = make_placement(tool)
        self.low_rad: Vector = np.array(description.low_rad)
        self.high_rad: Vector = np.array(description.high_rad)
        self.home_rad: Vector = np.array(description.home_rad)
        self.model = build_model(description, base, tool)
        self.coupling = compute_coupling(description)
        self._data = self.model.createData()
        self._tip = self.model.getFrameId("tip")

    def tip(self, joints_rad: Vector) -> Any:
        """Return the pose of the tip in the world, as `pinocchio.SE3`.

        Parameters
        ----------
        joints_rad
            Joint angles [rad], shape (joints,).
        """
        pin.framesForwardKinematics(self.model, self._data, joints_rad)
        return self._data.oMf[self._tip].copy()

    def error(self, joints_rad: Vector, target: Any) -> tuple[Vector, Vector]:
        """Return the error of the tip's pose and the Jacobian, both in the tip's frame.

        Parameters
        ----------
        joints_rad
            Joint angles [rad], shape (joints,).
        target
            Target pose of the tip in the world, as `pinocchio.SE3`.

        Returns
        -------
        twist
            Remaining displacement [m] and rotation vector [rad], shape (6,).
        jacobian
            Shape (6, joints).
        """
        pin.computeJointJacobians(self.model, self._data, joints_rad)
        here = pin.updateFramePlacement(self.model, self._data, self._tip)
        jacobian = pin.getFrameJacobian(self.model, self._data, self._tip, pin.LOCAL)
        return pin.log6(here.actInv(target)).vector, jacobian


def make_placement(transform: Any) -> Any:
    """Return a `Transform` as `pinocchio.SE3`."""
    if isinstance(transform, pin.SE3):
        return transform
    roll, pitch, yaw = transform.rpy_rad
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    rotation = np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
    return pin.SE3(rotation, np.array(transform.xyz_m))


def build_model(
    description: ArmDescription, base: Any = _NOWHERE, tool: Transform = _NOWHERE
) -> Any:
    """Return the `pinocchio.Model` of an arm.

    Parameters
    ----------
    base
        Pose of the base in the world, as a `Transform` or `pinocchio.SE3`.
    tool
        Pose of the frame `tip` in the frame `flange`.
    """
    model = pin.Model()
    model.name = description.name
    parent, before = 0, make_placement(base)
    for joint in description.joints:
        placed = before * make_placement(joint.placement)
        parent = model.addJoint(parent, _make_joint_model(joint), placed, joint.name)
        if joint.link is not None:
            frame = make_placement(joint.link.frame)
            model.appendBodyToJoint(parent, _inertia(joint.link), frame)
        before = pin.SE3.Identity()
    model.lowerPositionLimit[:] = description.low_rad
    model.upperPositionLimit[:] = description.high_rad
    model.velocityLimit[:] = description.speed_rad_per_s
    model.effortLimit[:] = description.torque_nm
    flange = make_placement(description.tip)
    for name, where in (("flange", flange), ("tip", flange * make_placement(tool))):
        model.addFrame(pin.Frame(name, parent, where, pin.FrameType.OP_FRAME))
    return model


def compute_coupling(description: ArmDescription) -> Vector | None:
    """Return motions of all joints per motion of the independent ones, None if all are independent.

    Shape (joints, freedoms).
    """
    joints = description.joints
    if description.freedoms == len(joints):
        return None
    own = [number for number, joint in enumerate(joints) if joint.follows is None]
    coupling = np.zeros((len(joints), len(own)))
    for number, joint in enumerate(joints):
        leader, factor, _ = joint.follows or (number, 1.0, 0.0)
        coupling[number, own.index(leader)] = factor
    return coupling


def compute_strokes_m(description: ArmDescription) -> Vector:
    """Return how far each prismatic joint moves from 0 at most [m], 0 for others."""
    return np.array(
        [
            max(abs(joint.low_rad), abs(joint.high_rad)) if joint.is_prismatic else 0.0
            for joint in description.joints
        ]
    )


def _make_joint_model(joint: Joint) -> Any:
    if joint.is_prismatic:
        return pin.JointModelPrismaticUnaligned(np.array(joint.axis))
    if joint.axis == (0.0, 0.0, 1.0):
        return pin.JointModelRZ()
    return pin.JointModelRevoluteUnaligned(np.array(joint.axis))


def _inertia(link: LinkInertia) -> Any:
    xx, yy, zz, xy, xz, yz = link.tensor_kg_m2
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return pin.Inertia(link.mass_kg, np.array(link.centre_m), tensor)
