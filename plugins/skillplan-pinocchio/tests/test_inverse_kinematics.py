"""Joint angles for a hand that points down: accurate, within limits, or why not."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import skillplan_pinocchio as arm
from example_count import examples

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


def test_a_start_beyond_the_limits_is_moved_into_them():
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
