"""Where the tip of the arm is, held against the model that is simulated."""

from __future__ import annotations

import math

import numpy as np
import pybullet
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from skillplan.robots import panda
from skillplan_pybullet.arm.dynamics import HAND_LINK, PinocchioDynamics, PybulletDynamics
from skillplan_pybullet.arm.panda_kinematics import (
    UnreachableError,
    follow,
    forward,
    pointing_down,
    reach,
    rotation_error,
)
from skillplan_pybullet.arm.simulated_arm import SimulatedArm
from skillplan_pybullet.execution_settings import ExecutionSettings
from skillplan_pybullet.simulator.world import World

BASE = (0.0, 0.0, 0.0)
angles = st.tuples(
    *(
        st.floats(low, high)
        for low, high in zip(panda.JOINT_LOW_RAD, panda.JOINT_HIGH_RAD, strict=True)
    )
)
rates = st.tuples(*[st.floats(-2.0, 2.0)] * 7)


@pytest.fixture(scope="module")
def arm():
    """An arm in an empty world."""
    with World(0.6) as world:
        yield SimulatedArm(world, BASE, ExecutionSettings())


@settings(max_examples=examples(50))
@given(angles)
def test_the_tip_is_where_the_simulated_one_is(arm, joints):
    for joint, angle in enumerate(joints):
        pybullet.resetJointState(arm.number, joint, angle, physicsClientId=arm.world.client)
    pose, jacobian = forward(np.array(joints), BASE)
    simulated = arm.tip()
    assert np.allclose(pose.position, simulated.position, atol=1e-6)
    assert np.allclose(pose.rotation, simulated.rotation, atol=1e-6)
    terms = PybulletDynamics(arm.world.client, arm.number).terms(
        np.array([*joints, 0.0, 0.0]), np.zeros(9)
    )
    assert np.allclose(jacobian, terms.jacobian, atol=1e-9)


@settings(max_examples=examples(50))
@given(angles, rates)
def test_pinocchio_and_the_simulator_agree_on_the_dynamics(arm, joints, speeds):
    pytest.importorskip("pinocchio", reason="pinocchio is optional here")
    position, velocity = np.array([*joints, 0.01, 0.01]), np.array([*speeds, 0.0, 0.0])
    own = PybulletDynamics(arm.world.client, arm.number).terms(position, velocity)
    other = PinocchioDynamics().terms(position, velocity)
    assert np.allclose(own.mass, other.mass, atol=1e-9)
    assert np.allclose(own.jacobian, other.jacobian, atol=1e-9)
    assert np.allclose(own.bias, other.bias, atol=1e-4)


@settings(max_examples=examples(40))
@given(
    st.floats(0.30, 0.65),
    st.floats(-0.30, 0.30),
    st.floats(0.0, 0.25),
    st.floats(-math.pi, math.pi),
)
def test_inverse_kinematics_brings_the_tip_there_within_the_joints_limits(x, y, z, yaw):
    try:
        joints = reach((x, y, z), yaw, BASE)
    except UnreachableError:
        # The wrist cannot be turned that way; by half a turn it can.
        yaw += math.pi
        joints = reach((x, y, z), yaw, BASE)
    pose, _ = forward(joints, BASE)
    assert np.linalg.norm(pose.position - (x, y, z)) < 1e-5
    assert np.linalg.norm(rotation_error(pose.rotation, pointing_down(yaw))) < 1e-5
    assert (joints >= panda.JOINT_LOW_RAD).all()
    assert (joints <= panda.JOINT_HIGH_RAD).all()


def test_a_point_out_of_reach_is_said_to_be():
    with pytest.raises(UnreachableError, match=r"to \(0\.900, 0\.000, 0\.100\) m"):
        reach((0.9, 0.0, 0.1), 0.0, BASE)


def test_following_a_line_stays_on_the_same_branch():
    yaw = -math.pi / 2
    joints = reach((0.5, 0.0, 0.2), yaw, BASE)
    for step in range(1, 11):
        following = follow((0.5, 0.0, 0.2 - 0.01 * step), yaw, BASE, joints)
        assert np.abs(following - joints).max() < 0.1
        joints = following


def test_the_link_of_the_hand_is_the_hand(arm):
    info = pybullet.getJointInfo(arm.number, HAND_LINK, physicsClientId=arm.world.client)
    assert info[12] == b"panda_hand"
