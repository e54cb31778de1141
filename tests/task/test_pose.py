"""Poses: how they are turned, put together and undone."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skillplan.task import DOWN, Point, Pose, cross, dot, plus, unit

angles = st.floats(-math.pi, math.pi)
lengths = st.floats(-2, 2)
points = st.tuples(lengths, lengths, lengths)
poses = st.builds(Pose.turned, points, st.tuples(angles, angles, angles))


def close(point: Point) -> object:
    return pytest.approx(point, abs=1e-9)


def test_roll_pitch_and_yaw_turn_about_fixed_axes_in_this_order():
    quarter = math.pi / 2
    assert Pose.turned((0, 0, 0), (quarter, 0, 0)).rotate((0, 1, 0)) == close((0, 0, 1))
    assert Pose.turned((0, 0, 0), (0, quarter, 0)).rotate((1, 0, 0)) == close((0, 0, -1))
    assert Pose.turned((0, 0, 0), (0, 0, quarter)).rotate((1, 0, 0)) == close((0, 1, 0))
    rolled_then_yawed = Pose.turned((0, 0, 0), (quarter, 0, quarter))
    assert rolled_then_yawed.rotate((0, 1, 0)) == close((0, 0, 1))
    assert rolled_then_yawed.rotate((0, 0, 1)) == close((1, 0, 0))


def test_without_roll_and_pitch_a_pose_is_upright():
    assert Pose.turned((1, 2, 3), (0, 0, 0.7)) == Pose.upright((1, 2, 3), 0.7)
    assert Pose.upright((1, 2, 3), 0.7).is_upright
    assert not Pose.turned((1, 2, 3), (0.01, 0, 0)).is_upright


@given(poses, points)
def test_the_inverse_undoes_a_pose(pose, point):
    assert pose.inverse().apply(pose.apply(point)) == close(point)
    assert pose.then(pose.inverse()).apply(point) == close(point)


@given(poses, poses, points)
def test_one_pose_in_another_is_both_in_turn(one, other, point):
    assert one.then(other).apply(point) == close(one.apply(other.apply(point)))


@given(poses, points, points)
def test_turning_keeps_lengths_and_angles(pose, a, b):
    assert dot(pose.rotate(a), pose.rotate(b)) == pytest.approx(dot(a, b), abs=1e-9)
    assert pose.rotate(cross(a, b)) == close(cross(pose.rotate(a), pose.rotate(b)))


@given(poses)
def test_a_pose_is_found_again_from_its_axes(pose):
    y, z = pose.rotate((0, 1, 0)), pose.rotate((0, 0, 1))
    again = Pose.of_axes(pose.position, unit(y), unit(z))
    assert again.rotate((1, 2, 3)) == pytest.approx(pose.rotate((1, 2, 3)), abs=1e-6)


def test_what_has_no_direction_is_refused():
    with pytest.raises(ValueError, match="no direction"):
        unit((0, 0, 0))


def test_vectors_are_added():
    assert plus((1, 2, 3), DOWN, 2.0) == (1, 2, 1)
