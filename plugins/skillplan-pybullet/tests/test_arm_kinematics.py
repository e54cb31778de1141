"""Where the tip of the arm is, held against the model that is simulated."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pybullet
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from skillplan.robots import UR5E
from skillplan.task import Pose, Robot
from skillplan_pinocchio import JointLimits, JointPath, find_fastest_trajectory
from skillplan_pybullet import JAW_LINKS, PinocchioDynamics, SimulatedArm, SimulationSettings, World
from skillplan_simulation import JointMotion, LinkBounds, compute_turn, get_kinematics

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
KINEMATICS = get_kinematics(ROBOT)
shares = st.tuples(*[st.floats(0.0, 1.0)] * 7)
rates = st.tuples(*[st.floats(-2.0, 2.0)] * 7)
turns = st.tuples(*[st.floats(-1.8, 1.8)] * 3)


@pytest.fixture(scope="module", params=ROBOTS, ids=lambda robot: robot.model.name)
def arm(request):
    """An arm in an empty world."""
    with World(0.6) as world:
        yield SimulatedArm(world, request.param, SimulationSettings())


def posture(arm, shares):
    """Return joint angles by shares of their ranges."""
    low, high = arm.kinematics.low_rad, arm.kinematics.high_rad
    return low + np.array(shares[: len(low)]) * (high - low)


@settings(max_examples=examples(50))
@given(shares)
def test_the_tip_is_where_the_simulated_one_is(arm, shares):
    joints = posture(arm, shares)
    arm.stand(joints, 0.0)
    pose = arm.kinematics.tip(joints)
    simulated = arm.tip()
    assert np.allclose(pose.position, simulated.position, atol=1e-6)
    assert np.allclose(pose.rotation, simulated.rotation, atol=1e-6)


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


@settings(max_examples=examples(50))
@given(turns, turns)
def test_the_turn_between_two_rotations_leads_from_one_to_the_other(one, other):
    start, end = pin.exp3(np.array(one)), pin.exp3(np.array(other))
    turn = compute_turn(start, end)
    assert pin.exp3(turn) @ start == pytest.approx(end, abs=1e-6)
    assert np.linalg.norm(turn) <= math.pi + 1e-9


def test_half_a_turn_has_an_axis():
    turn = compute_turn(np.eye(3), np.diag([-1.0, 1.0, -1.0]))
    assert np.abs(turn) == pytest.approx((0.0, math.pi, 0.0))


def test_a_move_along_a_path_says_how_fast_the_joints_go():
    """And where the tip is then; in the end all is at rest."""
    start = KINEMATICS.home_rad
    path = JointPath([start, start + np.array([0.4, 0.2, -0.1, 0.3, 0.5, -0.4, 0.6])])
    run = find_fastest_trajectory(path, JointLimits.of(ROBOT.model))
    move = JointMotion(KINEMATICS, path.nodes, run)
    time_s, step_s = 0.4 * move.duration_s, 1e-5
    before, at, after = (move.at(time_s + sign * step_s) for sign in (-1, 0, 1))
    speeds = (after.posture - before.posture) / (2 * step_s)
    assert speeds == pytest.approx(at.joints.speeds_rad_per_s, rel=1e-4, abs=1e-6)
    end = move.at(move.duration_s)
    assert end.posture == pytest.approx(path.nodes[-1])
    assert end.position == pytest.approx(KINEMATICS.tip(path.nodes[-1]).position)
    assert not end.joints.speeds_rad_per_s.any()
    assert not end.joints.accelerations_rad_per_s2.any()


def test_an_arm_that_hangs_stays_where_it_is():
    with World(0.6) as world:
        arm = SimulatedArm(world, HANGING, SimulationSettings())
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
