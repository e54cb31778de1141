"""The arm built from the facts of the robot, against the description that pybullet brings along."""

import math

import numpy as np
import pinocchio as pin
import pytest

from skillplan import load_problem
from skillplan.robots import PANDA, STANDARD_HAND, TIP_M, UR5E
from skillplan_pinocchio import (
    ArmModel,
    ConvexPiece,
    SelfCheck,
    SweptDetector,
    get_closing_yaw_rad,
    iterate_descents,
    make_pose_down,
)


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


# Strokes that fold an arm into itself: refused if every posture does, else one is chosen.


TASK = """kind: assembly
name: close_to_its_base
robot: {{model: ur5e, home_m: [0.4, 0.0], safe_height_m: 0.25}}
initial_tool: gripper
tools: {{gripper: {{type: gripper, holder_m: [0.5, 0.3]}}}}
parts:
  block:
    tool: gripper
    size_m: [0.04, 0.04, 0.04]
    start_m: [{x_m}, 0.0]
    goal_m: [0.4, -0.2]
"""


@pytest.fixture(scope="module")
def arm():
    """Return a UR5e with the standard hand."""
    return ArmModel(description=UR5E, hand=STANDARD_HAND)


def picked(tmp_path, x_m, **options):
    """Return detector, skill and state of picking a block so far in front of a UR5e."""
    path = tmp_path / "task.yaml"
    path.write_text(TASK.format(x_m=x_m))
    task = load_problem(str(path)).task
    skill = next(skill for skill in task.skills if skill.name == "pick(block)")
    detector = SweptDetector(task, SweptDetector.Options(**options))
    return detector, skill, task.initial


def test_where_every_posture_folds_the_arm_into_itself_a_skill_is_infeasible(tmp_path):
    """The evidence names the two that touch; no other body has to be there."""
    detector, skill, state = picked(tmp_path, 0.15)
    verdict = detector.check(skill, state)
    assert verdict.is_infeasible
    assert verdict.evidence["links"] == ["block", "link 2 of the arm"]
    assert verdict.reason == "block runs into link 2 of the arm on the approach or retreat"
    assert 0 <= verdict.evidence["fraction"] <= 1
    assert [str(fact) for fact in verdict.present] == ["tool(gripper)"]


def test_links_are_checked_only_if_they_are_to_be(tmp_path):
    """`check_arm: false` is about the arm itself, too."""
    detector, skill, state = picked(tmp_path, 0.15, check_arm=False)
    assert detector.check(skill, state).is_feasible


def test_a_posture_that_is_free_is_taken_where_a_preferred_one_is_not(arm, tmp_path):
    """A little farther out some postures leave room."""
    check = SelfCheck(arm)
    paths = list(iterate_descents(arm, (0.18, 0.0, 0.05), (0.18, 0.0, 0.25), 0.0))
    assert check.first_hit(paths[0]) is not None
    assert any(check.first_hit(path) is None for path in paths)
    detector, skill, state = picked(tmp_path, 0.2)
    assert detector.check(skill, state).is_feasible


def test_a_free_stroke_has_no_hit(arm):
    """In front of the arm no posture touches anything."""
    check = SelfCheck(arm)
    for path in iterate_descents(arm, (0.4, 0.0, 0.05), (0.4, 0.0, 0.25), 0.0):
        assert check.first_hit(path) is None


def test_what_is_held_runs_into_the_base(arm):
    """Or into the first link above it: a long bar across the tip, where a short one passes."""
    check = SelfCheck(arm)
    path = next(iterate_descents(arm, (0.4, 0.0, 0.05), (0.4, 0.0, 0.25), 0.0))
    (x, y, z), _ = arm.tip(path.nodes[0])
    ends = np.array([[a, b, c] for a in (-0.5, 0.5) for b in (-0.5, 0.5) for c in (-0.5, 0.5)])
    for length_m, hits in ((0.1, False), (0.78, True)):
        bar = ConvexPiece(ends * (length_m, 0.02, 0.02) + (x, y, z))
        hit = check.first_hit(path, ([("bar", (bar,))], path.nodes[0]))
        assert (hit is not None) is hits
        if hit is not None:
            assert hit.mover == "bar"
            assert hit.other in ("the base of the arm", "link 1 of the arm")
