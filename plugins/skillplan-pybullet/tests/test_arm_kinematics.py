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
from skillplan.robots.ur5e import UR5E
from skillplan.task.pose import Pose
from skillplan.task.scene import Robot
from skillplan_pybullet.arm.dynamics import PinocchioDynamics
from skillplan_pybullet.arm.joint_motion import JointMotion, turned_on_the_way
from skillplan_pybullet.arm.kinematics import UnreachableError, kinematics_of
from skillplan_pybullet.arm.link_bounds import LinkBounds
from skillplan_pybullet.arm.robot_file import JAW_LINKS
from skillplan_pybullet.arm.rotations import (
    of_vector,
    pointing_down,
    rotation_error,
    turn_between,
)
from skillplan_pybullet.arm.simulated_arm import SimulatedArm
from skillplan_pybullet.execution_settings import ExecutionSettings
from skillplan_pybullet.simulator.world import World

ROBOT = Robot("robot", (0.0, 0.0, 0.0), 0.8, 0.2, {})
# A second arm, on a base that is turned; and one that hangs.
TURNED, HANGING = (
    Robot("robot", pose.position, 0.8, 0.2, {}, model=UR5E, base_orientation=pose.orientation)
    for pose in (
        Pose.upright((0.1, -0.2, 0.3), 2.0),
        Pose.turned((0.1, -0.2, 1.1), (2.9, -0.1, 2.0)),
    )
)
ROBOTS = (ROBOT, TURNED)
KINEMATICS = kinematics_of(ROBOT)
shares = st.tuples(*[st.floats(0.0, 1.0)] * 7)
rates = st.tuples(*[st.floats(-2.0, 2.0)] * 7)
turns = st.tuples(*[st.floats(-1.8, 1.8)] * 3)


@pytest.fixture(scope="module", params=ROBOTS, ids=lambda robot: robot.model.name)
def arm(request):
    """An arm in an empty world."""
    with World(0.6) as world:
        yield SimulatedArm(world, request.param, ExecutionSettings())


def posture(arm, shares):
    """Return joint angles by shares of their ranges."""
    low, high = arm.kinematics.low_rad, arm.kinematics.high_rad
    return low + np.array(shares[: len(low)]) * (high - low)


@settings(max_examples=examples(50))
@given(shares)
def test_the_tip_is_where_the_simulated_one_is(arm, shares):
    joints = posture(arm, shares)
    arm.stand(joints, 0.0)
    pose, jacobian = arm.kinematics.tip_and_jacobian(joints)
    simulated = arm.tip()
    assert np.allclose(pose.position, simulated.position, atol=1e-6)
    assert np.allclose(pose.rotation, simulated.rotation, atol=1e-6)
    angles = np.array([*joints, 0.0, 0.0])
    terms = arm.dynamics.terms(angles, np.zeros(len(angles)))
    assert np.allclose(jacobian, terms.jacobian, atol=1e-9)


@settings(max_examples=examples(50))
@given(shares, rates)
def test_pinocchio_and_the_simulator_agree_on_the_dynamics(arm, shares, speeds):
    joints = posture(arm, shares)
    position = np.array([*joints, 0.01, 0.01])
    velocity = np.array([*speeds[: len(joints)], 0.0, 0.0])
    own = arm.dynamics.terms(position, velocity)
    other = PinocchioDynamics(arm.file, arm.robot.mount).terms(position, velocity)
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
    rotation = pointing_down(yaw)
    joints = KINEMATICS.reach((x, y, z), rotation)
    pose = KINEMATICS.tip(joints)
    assert np.linalg.norm(pose.position - (x, y, z)) < 1e-6
    assert np.linalg.norm(rotation_error(pose.rotation, rotation)) < 1e-6
    assert (joints >= panda.JOINT_LOW_RAD).all()
    assert (joints <= panda.JOINT_HIGH_RAD).all()


def test_a_hand_that_points_forwards_is_brought_there_as_one_that_points_down():
    rotation = of_vector(np.array([0.0, -math.pi / 2, 0.0])) @ pointing_down(0.3)
    pose = KINEMATICS.tip(KINEMATICS.reach((0.5, 0.1, 0.3), rotation))
    assert pose.position == pytest.approx((0.5, 0.1, 0.3), abs=1e-6)
    assert pose.rotation == pytest.approx(rotation, abs=1e-6)
    assert pose.rotation[:, 2] == pytest.approx((1.0, 0.0, 0.0), abs=1e-6)


def test_a_point_out_of_reach_is_said_to_be():
    with pytest.raises(UnreachableError, match=r"straight down, to \(0\.900, 0\.000, 0\.100\) m"):
        KINEMATICS.reach((0.9, 0.0, 0.1), pointing_down(0.0))


def test_following_a_line_stays_on_the_same_branch():
    points = [(0.5, 0.0, 0.2 - 0.01 * step) for step in range(11)]
    postures = KINEMATICS.along(points, pointing_down(-math.pi / 2))
    assert np.abs(np.diff(postures, axis=0)).max() < 0.1


@settings(max_examples=examples(50))
@given(turns, turns)
def test_the_turn_between_two_rotations_leads_from_one_to_the_other(one, other):
    start, end = of_vector(np.array(one)), of_vector(np.array(other))
    turn = turn_between(start, end)
    assert of_vector(turn) @ start == pytest.approx(end, abs=1e-6)
    assert np.linalg.norm(turn) <= math.pi + 1e-9


def test_half_a_turn_has_an_axis():
    turn = turn_between(np.eye(3), np.diag([-1.0, 1.0, -1.0]))
    assert np.abs(turn) == pytest.approx((0.0, math.pi, 0.0))


def test_a_turn_is_counted_as_the_wrist_makes_it():
    start = KINEMATICS.reach((0.5, 0.0, 0.2), pointing_down(-math.pi / 2))
    end = start.copy()
    end[6] -= 3.5
    # Beyond half a circle, where the shortest turn would go the other way round.
    assert turned_on_the_way(KINEMATICS, start, end) == pytest.approx(3.5, abs=1e-6)


def test_a_move_in_joint_space_says_how_fast_the_tip_goes():
    start = KINEMATICS.home_rad
    end = start + np.array([0.4, 0.2, -0.1, 0.3, 0.5, -0.4, 0.6])
    move = JointMotion.between(
        KINEMATICS, start, end, speed_m_per_s=0.25, acceleration_m_per_s2=1.5
    )
    time_s, step_s = 0.4 * move.duration_s, 1e-5
    before, at, after = (move.at(time_s + sign * step_s) for sign in (-1, 0, 1))
    assert (after.position - before.position) / (2 * step_s) == pytest.approx(
        at.velocity, rel=1e-4, abs=1e-6
    )
    spin = turn_between(before.rotation, after.rotation) / (2 * step_s)
    assert spin == pytest.approx(at.spin_rad_per_s, rel=1e-4, abs=1e-6)
    assert KINEMATICS.tip(end).position == pytest.approx(move.at(move.duration_s).position)


def test_an_arm_that_hangs_stays_where_it_is():
    with World(0.6) as world:
        arm = SimulatedArm(world, HANGING, ExecutionSettings())
        arm.stand(arm.kinematics.home_rad + 0.2, 0.04)
        for _ in range(60):
            arm.actuate()
            world.step()
        assert arm.tip_error_m() < 1e-5


def test_what_the_hand_is_made_of_is_told_apart_by_name(arm):
    for number, name in arm.link_names.items():
        info = pybullet.getJointInfo(arm.number, number, physicsClientId=arm.world.client)
        assert info[12].decode() in ({"robot hand": "hand"}.get(name, ""), *JAW_LINKS)


@settings(max_examples=examples(10))
@given(shares)
def test_boxes_about_the_links_hold_them_as_they_are_simulated(arm, shares):
    joints = posture(arm, shares)
    arm.stand(joints, 0.0)
    client = arm.world.client
    # The point of a link that is nearest to a wall is its outermost one on that side.
    shape = pybullet.createCollisionShape(
        pybullet.GEOM_BOX, halfExtents=(9.0, 9.0, 9.0), physicsClientId=client
    )
    wall = pybullet.createMultiBody(0, shape, physicsClientId=client)
    for axis in range(3):
        for side, corner in ((-1, 0), (1, 1)):
            place = [0.0, 0.0, 0.0]
            place[axis] = side * 12.0
            pybullet.resetBasePositionAndOrientation(wall, place, (0, 0, 0, 1), client)
            for number, box in enumerate(LinkBounds(arm.kinematics).at(joints)):
                points = pybullet.getClosestPoints(
                    arm.number, wall, 5.0, number, -1, physicsClientId=client
                )
                outermost = max(side * point[5][axis] for point in points)
                # The simulator makes hulls 1 mm larger.
                assert -0.003 < side * box[corner][axis] - outermost + 0.001 < 0.003
    pybullet.removeBody(wall, physicsClientId=client)
