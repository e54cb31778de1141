"""The arm built from the facts of the robot, against the description that pybullet brings along."""

import math

import numpy as np
import pinocchio as pin
import pytest

from skillplan.robots import PANDA, TIP_M
from skillplan_pinocchio import ArmModel, get_closing_yaw_rad, make_pose_down


def postures(count):
    """Return joint angles within the limits, drawn evenly."""
    rng = np.random.default_rng(1)
    return rng.uniform(PANDA.low_rad, PANDA.high_rad, (count, 7))


def test_forward_kinematics_equal_those_of_the_published_description(panda_files):
    """To a nanometre and a nanoradian, anywhere within the limits."""
    arm = ArmModel()
    other = pin.buildModelFromUrdf(str(panda_files / "panda.urdf"))
    data = other.createData()
    hand = other.getFrameId("panda_hand")
    for joints in postures(200):
        pin.framesForwardKinematics(other, data, np.concatenate([joints, np.zeros(other.nq - 7)]))
        expected = data.oMf[hand] * pin.SE3(np.eye(3), np.array([0.0, 0.0, TIP_M]))
        position, rotation = arm.tip(joints)
        assert np.abs(position - expected.translation).max() < 1e-9
        assert np.abs(rotation - expected.rotation).max() < 1e-9


def test_the_limits_are_those_of_the_robot():
    """Positions, speeds and torques."""
    model = ArmModel().model
    assert model.nq == 7
    assert tuple(model.lowerPositionLimit) == PANDA.low_rad
    assert tuple(model.upperPositionLimit) == PANDA.high_rad
    assert tuple(model.velocityLimit) == PANDA.speed_rad_per_s
    assert tuple(model.effortLimit) == PANDA.torque_nm


def test_the_arm_stands_where_its_base_is():
    """All is displaced by it."""
    base = (0.4, -0.2, 0.1)
    for joints in postures(5):
        here, _ = ArmModel(base).tip(joints)
        there, _ = ArmModel().tip(joints)
        assert here - there == pytest.approx(base)


def test_the_ready_pose_points_straight_down_in_front_of_the_base():
    """Tip below the wrist, hand across."""
    position, rotation = ArmModel().tip(np.array(PANDA.home_rad))
    assert position[1] == pytest.approx(0.0, abs=1e-12)
    assert rotation[:, 2] == pytest.approx((0.0, 0.0, -1.0), abs=1e-12)
    assert get_closing_yaw_rad(rotation) == pytest.approx(-math.pi / 2)


@pytest.mark.parametrize("yaw_rad", [-2.0, 0.0, 0.3, math.pi / 2])
def test_jaws_close_along_the_y_of_the_hand(yaw_rad):
    """The yaw of a pose is that of its second axis, and the pose is a rotation."""
    pose = make_pose_down((0.5, 0.1, 0.2), yaw_rad)
    assert get_closing_yaw_rad(pose.rotation) == pytest.approx(yaw_rad)
    assert pose.rotation[:, 1] == pytest.approx((math.cos(yaw_rad), math.sin(yaw_rad), 0.0))
    assert np.linalg.det(pose.rotation) == pytest.approx(1.0)


def test_the_jacobian_is_the_derivative_of_the_error():
    """By differences."""
    arm = ArmModel()
    target = make_pose_down((0.5, 0.1, 0.2), 0.4)
    for joints in postures(5):
        _, jacobian = arm.error(joints, target)
        here = arm.tip(joints)
        for number in range(7):
            moved = joints.copy()
            moved[number] += 1e-6
            there = arm.tip(moved)
            step = pin.log6(pin.SE3(here[1], here[0]).actInv(pin.SE3(there[1], there[0])))
            assert step.vector / 1e-6 == pytest.approx(jacobian[:, number], abs=1e-5)
