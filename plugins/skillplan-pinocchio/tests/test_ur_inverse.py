"""All postures for a pose of the UR family, against pinocchio's forward kinematics."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from serial_arms import ur_arm
from skillplan.robots import PANDA, UR5E, Transform
from skillplan_pinocchio import SerialArm, UrInverse, UrLengths
from thinned import release_case

ACCURACY = 1e-9
BASE = Transform((0.3, 0.2, 0.1), (0.2, 0.3, 0.4))
TOOL = Transform((0.01, 0.0, 0.12))
ARM = SerialArm(UR5E, BASE, TOOL)
INVERSE = UrInverse(ARM)
TURN = 2 * math.pi
# Angles at which axes are parallel, the arm is stretched, or the wrist is above the shoulder.
SPECIAL = (-TURN, -math.pi, -math.pi / 2, 0.0, math.pi / 2, math.pi, TURN)


def wrapped(angles):
    """Return angles in (-pi, pi]."""
    return math.pi - np.remainder(math.pi - angles, TURN)


def assert_all_solve(arm, expected, target):
    """Each is at the pose, to a nanometre and a nanoradian, and within the limits."""
    for joints in expected:
        assert (joints >= arm.low_rad).all()
        assert (joints <= arm.high_rad).all()
        assert np.abs(arm.tip(joints).homogeneous - target.homogeneous).max() < ACCURACY


@pytest.mark.parametrize("count", [200, release_case(10_000, reason="10,000; 200 in every run")])
def test_every_pose_has_the_posture_that_it_was_made_of(count):
    """Up to full turns; and up to seven others that lead there, too."""
    rng = np.random.default_rng(7)
    sizes = set()
    for angles in rng.uniform(ARM.low_rad, ARM.high_rad, (count, 6)):
        target = ARM.tip(angles)
        solution = INVERSE.solve(target)
        assert_all_solve(ARM, solution, target)
        assert min(np.abs(wrapped(joints - angles)).max() for joints in solution) < 1e-6
        sizes.add(len(solution))
    assert max(sizes) == 8


def test_the_postures_of_a_pose_differ():
    """No two of them within a hundredth of a radian, where none is near a special case."""
    solution = INVERSE.solve(ARM.tip(np.array([0.3, -1.2, 1.4, -1.7, -1.5, 0.2])))
    assert len(solution) == 8
    for first, other in itertools.combinations(solution, 2):
        assert np.abs(wrapped(first - other)).max() > 0.01


def test_the_order_is_shoulder_then_wrist_then_elbow():
    """The elbow's side changes first, the shoulder's last."""
    solution = INVERSE.solve(ARM.tip(np.array([0.3, -1.2, 1.4, -1.7, -1.5, 0.2])))
    shoulders, elbows, wrists = (np.array([joints[n] for joints in solution]) for n in (0, 2, 4))
    assert np.ptp(shoulders[:4]) < 1e-9
    assert np.ptp(shoulders[4:]) < 1e-9
    assert np.sign(wrists).tolist() == [1, 1, -1, -1] * 2
    assert np.sign(elbows).tolist() == [1, -1] * 4


@settings(max_examples=examples(300))
@given(st.tuples(*[st.sampled_from(SPECIAL) | st.floats(-3.0, 3.0)] * 6))
def test_special_postures_lose_no_accuracy(angles):
    """Stretched, folded, with parallel axes: what is found is exact, and something is found."""
    angles = np.array(angles)
    angles[2] = wrapped(angles[2])
    target = ARM.tip(angles)
    solution = INVERSE.solve(target)
    assert 1 <= len(solution) <= 8
    assert_all_solve(ARM, solution, target)


def test_where_two_axes_are_one_the_last_joint_stays_at_zero():
    """Every other angle of it would do as well."""
    solution = INVERSE.solve(ARM.tip(np.array([0.3, -1.2, 1.4, -1.7, 0.0, 0.7])))
    assert 0.0 in {float(joints[5]) for joints in solution}


@pytest.mark.parametrize("wrist_2_rad", [0.0, math.pi])
def test_where_two_axes_are_one_and_the_arm_is_stretched_its_posture_is_found(wrist_2_rad):
    """The last joint is not at zero there."""
    arm = SerialArm(UR5E)
    target = arm.tip(np.array([0.3, -1.2, 0.0, -math.pi / 2, wrist_2_rad, 0.7]))
    solution = UrInverse(arm).solve(target)
    assert_all_solve(arm, solution, target)
    assert min(abs(joints[2]) for joints in solution) < 1e-7


def test_nearly_parallel_axes_have_postures_on_both_sides_of_the_wrist():
    """A millionth of a degree is enough to tell them apart."""
    target = ARM.tip(np.array([0.3, -1.2, 1.4, -1.7, 2e-8, 0.7]))
    solution = INVERSE.solve(target)
    assert_all_solve(ARM, solution, target)
    assert {-1.0, 1.0} <= {
        float(np.sign(joints[4])) for joints in solution if abs(joints[4]) < 1e-7
    }


def test_the_same_question_has_the_same_answer_bit_for_bit():
    """Whatever was asked between."""
    left, other = (ARM.tip(np.full(6, angle)) for angle in (0.4, 1.3))
    first = INVERSE.solve(left)
    INVERSE.solve(other)
    assert np.array_equal(first, INVERSE.solve(left))


def test_a_posture_beyond_the_limits_is_left_out():
    """The others stay, in their order."""
    target = ARM.tip(np.array([0.3, -1.2, 1.4, -1.7, -1.5, 0.2]))
    joints = list(UR5E.joints)
    joints[2] = replace(joints[2], low_rad=0.0)
    arm = replace(UR5E, joints=tuple(joints))
    few = UrInverse(SerialArm(arm, BASE, TOOL)).solve(target)
    assert len(few) == 4
    assert np.array_equal(few, [result for result in INVERSE.solve(target) if result[2] >= 0])


@pytest.mark.parametrize(("low_rad", "high_rad"), [(3.5, 9.0), (-9.0, -3.5), (12.0, 19.0)])
def test_angles_are_turned_into_the_range_of_the_limits(low_rad, high_rad):
    """Also where that has no 0."""
    joints = list(UR5E.joints)
    joints[5] = replace(joints[5], low_rad=low_rad, high_rad=high_rad)
    middle = (low_rad + high_rad) / 2
    arm = SerialArm(replace(UR5E, joints=tuple(joints), home_rad=(*UR5E.home_rad[:5], middle)))
    angles = np.array([0.3, -1.2, 1.4, -1.7, -1.5, middle])
    solution = UrInverse(arm).solve(arm.tip(angles))
    assert_all_solve(arm, solution, arm.tip(angles))
    assert min(np.abs(wrapped(joints - angles)).max() for joints in solution) < 1e-9


@pytest.mark.parametrize(
    "position", [(2.0, 0.0, 0.3), (0.0, 0.0, 1.5)], ids=["too far", "above the shoulder"]
)
def test_what_is_out_of_reach_has_no_posture(position):
    """None is made up."""
    assert UrInverse(SerialArm(UR5E)).solve(pin.SE3(np.eye(3), np.array(position))) == []


def test_other_members_of_the_family_are_solved_alike():
    """By their lengths alone."""
    arm = SerialArm(ur_arm("UR10", (0.1273, -0.612, -0.5723, 0.163941, 0.1157, 0.0922)))
    angles = np.array([1.0, -0.7, -1.4, 0.3, 1.1, -2.0])
    solution = UrInverse(arm).solve(arm.tip(angles))
    assert_all_solve(arm, solution, arm.tip(angles))
    assert min(np.abs(wrapped(joints - angles)).max() for joints in solution) < 1e-9


def test_the_ur5e_is_of_the_family_by_its_lengths():
    """As its maker publishes them."""
    assert UrLengths.of(UR5E) == UrLengths(0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996)


@pytest.mark.parametrize(
    "arm",
    [
        PANDA,
        replace(UR5E, name="tilted", tip=Transform((0.0, 0.0, 0.1), (0.1, 0.0, 0.0))),
        ur_arm("no forearm", (0.1625, -0.425, 0.0, 0.1333, 0.0997, 0.0996)),
        ur_arm("no offset", (0.1625, -0.425, -0.3922, 0.0, 0.0997, 0.0996)),
    ],
    ids=lambda arm: arm.name,
)
def test_an_arm_of_another_build_is_refused(arm):
    """It is told what to use."""
    with pytest.raises(ValueError, match="not built like the arms of Universal Robots: use Num"):
        UrInverse(SerialArm(arm))


def test_a_pose_that_is_no_pose_is_refused():
    """It has numbers that are none."""
    with pytest.raises(ValueError, match="Pose must be finite"):
        INVERSE.solve(pin.SE3(np.eye(3), np.array([math.nan, 0.0, 0.5])))
