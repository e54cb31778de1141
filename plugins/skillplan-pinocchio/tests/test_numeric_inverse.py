"""Joint angles for any pose of any serial arm: accurate, within limits, always the same."""

import math
import subprocess
import sys
import time

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import skillplan_pinocchio as arm
from example_count import examples
from serial_arms import random_arm
from skillplan.robots import PANDA, UR5E, Transform
from skillplan_pinocchio import NumericInverse, SerialArm, Unreached
from thinned import release_case

ACCURACY = 1e-6
ARMS = {"panda": SerialArm(PANDA), "ur5e": SerialArm(UR5E)}
SOLVERS = {name: NumericInverse(arm) for name, arm in ARMS.items()}


def reachable(arm, count, seed=7):
    """Return poses of the tip at angles drawn evenly within the limits."""
    rng = np.random.default_rng(seed)
    return [
        arm.tip(angles) for angles in rng.uniform(arm.low_rad, arm.high_rad, (count, arm.model.nq))
    ]


def away(arm, joints, target):
    """Return how far a posture is from a pose [m], [rad]; not asked of the solver."""
    here = arm.tip(joints)
    return (
        float(np.linalg.norm(here.translation - target.translation)),
        float(np.linalg.norm(pin.log3(here.rotation.T @ target.rotation))),
    )


def assert_solves(arm, joints, target):
    """It is at the pose and within the limits."""
    assert (joints >= arm.low_rad).all()
    assert (joints <= arm.high_rad).all()
    assert max(away(arm, joints, target)) < ACCURACY


@pytest.mark.parametrize("count", [100, release_case(10_000, reason="10,000; 100 in every run")])
@pytest.mark.parametrize("name", ARMS)
def test_at_least_995_of_1000_reachable_poses_are_solved(name, count):
    """To a micrometre and a microradian, within the limits."""
    arm, solver = ARMS[name], SOLVERS[name]
    unreached = 0
    for target in reachable(arm, count):
        joints = solver.solve(target)
        if isinstance(joints, Unreached):
            unreached += 1
        else:
            assert_solves(arm, joints, target)
    assert unreached <= 0.005 * count


@pytest.mark.parametrize(
    ("name", "joint", "angle_rad"),
    [("panda", 3, -0.0698), ("panda", 0, 2.8973), ("ur5e", 2, 0.0), ("ur5e", 4, math.pi)],
    ids=["elbow at its limit", "base at its limit", "stretched", "parallel axes"],
)
def test_poses_at_limits_and_where_directions_are_lost_are_solved(name, joint, angle_rad):
    """All of twenty."""
    arm = ARMS[name]
    for angles in np.random.default_rng(1).uniform(arm.low_rad, arm.high_rad, (20, arm.model.nq)):
        angles[joint] = angle_rad
        target = arm.tip(angles)
        solution = SOLVERS[name].solve(target)
        assert not isinstance(solution, Unreached)
        assert_solves(arm, solution, target)


@pytest.mark.release(reason="a time; the benchmark shows it, too")
@pytest.mark.parametrize("name", ARMS)
def test_half_of_the_poses_take_less_than_a_millisecond(name):
    """Of one core."""
    spent_s = []
    for target in reachable(ARMS[name], 10_000):
        begin_s = time.process_time()
        SOLVERS[name].solve(target)
        spent_s.append(time.process_time() - begin_s)
    assert np.median(spent_s) < 1e-3


@settings(max_examples=examples(60))
@given(st.integers(0, 10_000), st.sampled_from([6, 7]))
def test_any_chain_of_six_or_seven_joints_is_solved(seed, joints):
    """Nine of ten poses at least, of arms whose axes point anywhere."""
    arm = SerialArm(random_arm(joints, seed), Transform((0.1, 0.2, 0.3), (0.4, 0.5, 0.6)))
    solver = NumericInverse(arm)
    solved = 0
    for target in reachable(arm, 10, seed):
        solution = solver.solve(target)
        if not isinstance(solution, Unreached):
            assert_solves(arm, solution, target)
            solved += 1
    assert solved >= 9


def test_the_same_question_has_the_same_answer_whatever_was_asked_before():
    """To the bit, also of a solver that is new."""
    arm = ARMS["panda"]
    targets = reachable(arm, 10)
    first = [SOLVERS["panda"].solve(target) for target in targets]
    again = [NumericInverse(SerialArm(PANDA)).solve(target) for target in reversed(targets)]
    for left, other in zip(first, reversed(again), strict=True):
        assert np.array_equal(left, other)


def test_another_process_gives_the_same_answer():
    """To the bit."""
    code = (
        "import numpy as np\n"
        "from skillplan.robots import PANDA\n"
        "from skillplan_pinocchio import NumericInverse\n"
        "from skillplan_pinocchio import SerialArm\n"
        "arm = SerialArm(PANDA)\n"
        "target = arm.tip(np.array([0.3, -0.5, 0.9, -2.0, 0.4, 1.9, -1.1]))\n"
        "print(NumericInverse(arm).solve(target).tobytes().hex())\n"
    )
    target = ARMS["panda"].tip(np.array([0.3, -0.5, 0.9, -2.0, 0.4, 1.9, -1.1]))
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert done.stdout.strip() == SOLVERS["panda"].solve(target).tobytes().hex()


@pytest.mark.parametrize("name", ARMS)
def test_a_posture_that_is_there_already_is_the_answer(name):
    """To the bit; so that a path can be followed."""
    arm = ARMS[name]
    near = arm.home_rad + 0.1
    assert np.array_equal(SOLVERS[name].solve(arm.tip(near), near), near)


def test_from_near_a_posture_the_joints_move_little():
    """Where the tip moves by a centimetre, they move by a tenth of a radian at most."""
    arm = ARMS["panda"]
    moved = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.01])) * arm.tip(arm.home_rad)
    solution = SOLVERS["panda"].solve(moved, arm.home_rad)
    assert_solves(arm, solution, moved)
    assert np.abs(solution - arm.home_rad).max() < 0.1


def test_a_start_beyond_the_limits_is_moved_into_them():
    """And the answer is within them."""
    arm = ARMS["panda"]
    target = reachable(arm, 1)[0]
    assert_solves(arm, SOLVERS["panda"].solve(target, np.full(7, 9.0)), target)


def test_what_is_out_of_reach_is_said_with_how_far_the_nearest_posture_is():
    """In words, and no exception."""
    target = pin.SE3(np.eye(3), np.array([2.0, 0.0, 0.5]))
    solution = SOLVERS["ur5e"].solve(target)
    assert isinstance(solution, Unreached)
    assert 0.9 < solution.distance_m < 1.3
    assert solution.reason.startswith("no posture within the joints' limits was found; the nearest")


def test_a_pose_that_is_no_pose_is_refused():
    """It has numbers that are none."""
    target = pin.SE3(np.eye(3), np.array([math.nan, 0.0, 0.5]))
    with pytest.raises(ValueError, match="Pose must be finite"):
        SOLVERS["panda"].solve(target)


# Joint angles for a hand that points down: accurate, within limits, or why not.


ARM = arm.ArmModel()
ANGLES = st.floats(-math.pi, math.pi)


@settings(max_examples=examples(100))
@given(st.floats(0.35, 0.65), st.floats(-0.9, 0.9), st.floats(0.0, 0.3), ANGLES)
def test_what_is_found_is_accurate_and_within_limits(away_m, bearing_rad, z_m, yaw_rad):
    """To a micrometre and a microradian, for every elbow; and the first one always leads there."""
    position = (away_m * math.cos(bearing_rad), away_m * math.sin(bearing_rad), z_m)
    items = list(arm.iterate_elbows(ARM, position, yaw_rad))
    assert not isinstance(items[0], arm.Unreachable)
    for joints in items:
        if isinstance(joints, arm.Unreachable):
            continue
        assert (joints >= ARM.low_rad).all()
        assert (joints <= ARM.high_rad).all()
        reached, rotation = ARM.tip(joints)
        assert np.abs(reached - position).max() < 1e-6
        assert rotation[2, 2] == pytest.approx(-1.0, abs=1e-12)
        # With the hand turned by half a turn jaws close the same way.
        assert math.sin(arm.get_closing_yaw_rad(rotation) - yaw_rad) == pytest.approx(0.0, abs=1e-6)


def test_the_elbow_swings_while_the_hand_stays():
    """One pose, several postures."""
    results = [
        joints
        for joints in arm.iterate_elbows(ARM, (0.5, 0.0, 0.1), 0.0)
        if not isinstance(joints, arm.Unreachable)
    ]
    heights_m = {round(float(ARM.frames([joints])[1][0, 3, 1]), 2) for joints in results}
    assert len(results) > 4
    assert max(heights_m) - min(heights_m) > 0.1


def test_the_same_question_has_the_same_answer_bit_for_bit():
    """Whatever was asked between."""
    first = list(arm.iterate_elbows(ARM, (0.5, 0.1, 0.05), 0.3))
    list(arm.iterate_elbows(ARM, (0.3, -0.3, 0.2), -1.0))
    for left, other in zip(first, arm.iterate_elbows(ARM, (0.5, 0.1, 0.05), 0.3), strict=True):
        assert np.array_equal(left, other)


def test_what_is_too_far_is_said_with_its_distance():
    """And how far off the nearest posture is."""
    result = next(iter(arm.iterate_elbows(ARM, (0.95, 0.0, 0.0), 0.0)))
    assert isinstance(result, arm.Unreachable)
    assert result.reason == (
        "the hand cannot point straight down at (0.950, 0.000, 0.000): it is 1.007 m from the "
        "shoulder, beyond what the arm spans"
    )
    assert 0.1 < result.distance_m < 0.25


def test_what_is_too_near_is_said_with_the_joints_that_stop_it():
    """They cannot bend any further."""
    result = next(iter(arm.iterate_elbows(ARM, (0.2, 0.0, 0.15), 0.0)))
    assert isinstance(result, arm.Unreachable)
    assert "joint" in result.why
    assert "4" in result.why
    assert result.why.endswith("limits") or result.why.endswith("limit")


def test_a_start_of_the_closed_form_beyond_the_limits_is_moved_into_them():
    """A bearing behind the arm."""
    start = np.array([3.1, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8])
    joints = arm.solve(ARM, arm.make_pose_down((-0.4, 0.15, 0.2), 0.0), start)
    assert not isinstance(joints, arm.Unreachable)
    assert joints[0] <= ARM.high_rad[0]


def test_without_a_pull_joints_move_as_little_as_they_can():
    """From where the tip is already, not at all."""
    (start, *_) = arm.iterate_elbows(ARM, (0.5, 0.1, 0.05), 0.3)
    position, rotation = ARM.tip(start)
    same = arm.solve(
        ARM, arm.make_pose_down(tuple(position), arm.get_closing_yaw_rad(rotation)), start
    )
    assert same == pytest.approx(start, abs=1e-6)
