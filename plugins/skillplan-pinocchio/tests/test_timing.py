"""Times along a path: limits hold everywhere, and laxer limits are never slower."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from example_count import examples
from skillplan.robots import panda
from skillplan_pinocchio.arm_model import ArmModel
from skillplan_pinocchio.arm_motion import descent_paths, transfer_path
from skillplan_pinocchio.inverse_kinematics import Unreachable, elbows
from skillplan_pinocchio.timing import JointLimits, JointPath

NODES = st.integers(2, 9).flatmap(
    lambda count: arrays.arrays(float, (count, 7), elements=st.floats(-2.5, 2.5, width=32))
)
FACTORS = st.floats(0.1, 1.0)
LIMITS = st.builds(
    lambda speeds, gains: JointLimits(tuple(speeds), tuple(gains)),
    st.lists(st.floats(0.1, 5.0), min_size=7, max_size=7),
    st.lists(st.floats(0.5, 30.0), min_size=7, max_size=7),
)


@given(NODES, LIMITS)
def test_limits_are_never_exceeded(nodes, limits):
    """Neither speed nor acceleration, at 200 samples."""
    trajectory = JointPath(nodes).timed(limits)
    for time_s in np.linspace(0.0, trajectory.duration_s, 200):
        _, speed, gain = trajectory.at(float(time_s))
        assert (np.abs(speed) <= np.array(limits.speed_rad_per_s) * (1 + 1e-9)).all()
        assert (np.abs(gain) <= np.array(limits.acceleration_rad_per_s2) * (1 + 1e-9)).all()


@given(NODES, LIMITS, FACTORS)
def test_faster_limits_are_never_slower(nodes, limits, factor):
    """Whichever of them is tightened."""
    path = JointPath(nodes)
    whole_s = path.timed(limits).duration_s
    slow = limits.scaled(factor)
    for tighter in (
        slow,
        JointLimits(slow.speed_rad_per_s, limits.acceleration_rad_per_s2),
        JointLimits(limits.speed_rad_per_s, slow.acceleration_rad_per_s2),
    ):
        assert path.timed(tighter).duration_s >= whole_s * (1 - 1e-12)


@given(NODES, LIMITS)
def test_there_takes_as_long_as_back(nodes, limits):
    """The same path the other way round."""
    there, back = JointPath(nodes).timed(limits), JointPath(nodes[::-1]).timed(limits)
    assert there.duration_s == pytest.approx(back.duration_s, rel=1e-9)


@settings(max_examples=examples(100))
@given(NODES)
def test_a_trajectory_goes_from_rest_to_rest_through_all_nodes(nodes):
    """It starts and ends where the path does, and its speed fits its places."""
    path = JointPath(nodes)
    trajectory = path.timed(JointLimits())
    whole_s = trajectory.duration_s
    for node, place in zip(nodes, np.linspace(0, 1, len(nodes)), strict=True):
        assert path.at(float(place))[0] == pytest.approx(node, abs=1e-9)
    begin, end = trajectory.at(0.0), trajectory.at(whole_s)
    assert begin[0] == pytest.approx(nodes[0], abs=1e-9)
    assert end[0] == pytest.approx(nodes[-1], abs=1e-9)
    if whole_s > 0:
        assert begin[1] == pytest.approx(np.zeros(7), abs=1e-9)
        assert end[1] == pytest.approx(np.zeros(7), abs=1e-6)
        times_s = np.linspace(0, whole_s, 400)
        rows = [trajectory.at(float(time_s)) for time_s in times_s]
        for (one, other), (t0, t1) in zip(
            itertools.pairwise(rows), itertools.pairwise(times_s), strict=True
        ):
            gain = np.abs([one[2], other[2]]).max() + 1.0
            change = (other[0] - one[0]) / (t1 - t0)
            assert change == pytest.approx((one[1] + other[1]) / 2, abs=float(gain) * (t1 - t0))


def test_no_way_takes_no_time():
    """Not a rounding error's either."""
    still = np.zeros((3, 7))
    trajectory = JointPath(still).timed(JointLimits())
    assert trajectory.duration_s == 0.0
    assert trajectory.at(0.0)[0] == pytest.approx(np.zeros(7))
    still[1] += 1e-12
    assert JointPath(still).timed(JointLimits()).duration_s == 0.0


def test_a_single_joint_takes_the_time_of_a_trapezoid():
    """One radian: by hand from speed and acceleration, but for the share kept for bends."""
    nodes = np.zeros((5, 7))
    nodes[:, 0] = np.linspace(0, 1, 5)
    speed, gain = panda.JOINT_SPEED_RAD_PER_S[0], panda.JOINT_ACCELERATION_RAD_PER_S2[0]
    best_s = 1 / speed + speed / gain
    assert best_s <= JointPath(nodes).timed(JointLimits()).duration_s <= best_s * 1.01


@pytest.mark.parametrize("values", [(0.0,) * 7, (math.inf,) * 7, (-1.0,) * 7])
def test_a_limit_that_is_none_is_refused(values):
    """Zero, infinite, negative."""
    with pytest.raises(ValueError, match="must be > 0"):
        JointLimits(speed_rad_per_s=values)


def test_a_path_needs_two_nodes():
    """One is no way."""
    with pytest.raises(ValueError, match="at least two nodes"):
        JointPath([np.zeros(7)])


class TestWaysOfTheArm:
    arm = ArmModel()

    def test_a_stroke_goes_straight_down_with_the_hand_down(self):
        """Between its nodes within 0.05 mm, too."""
        (path, *_) = descent_paths(self.arm, (0.5, 0.1, 0.01), (0.5, 0.1, 0.16), 0.7)
        assert not isinstance(path, Unreachable)
        for place in np.linspace(0, 1, 41):
            position, rotation = self.arm.tip(path.at(float(place))[0])
            assert position == pytest.approx((0.5, 0.1, 0.16 - 0.15 * place), abs=5e-5)
            assert rotation[2, 2] == pytest.approx(-1, abs=1e-6)

    def test_a_travel_keeps_its_height_and_a_straight_line(self):
        """While hand and elbow turn as they must."""
        start = next(iter(elbows(self.arm, (0.35, -0.15, 0.2), 0.0)))
        end = next(iter(elbows(self.arm, (0.6, 0.2, 0.2), math.pi / 2)))
        path = transfer_path(self.arm, start, end)
        for place in np.linspace(0, 1, 41):
            position, rotation = self.arm.tip(path.at(float(place))[0])
            expected = (0.35 + 0.25 * place, -0.15 + 0.35 * place, 0.2)
            assert position == pytest.approx(expected, abs=5e-4)
            assert rotation[2, 2] == pytest.approx(-1, abs=1e-4)

    def test_a_travel_across_the_base_goes_round_it(self):
        """The straight line is out of reach; the joints go to their ends all the same."""
        start = next(iter(elbows(self.arm, (0.05, -0.4, 0.2), 0.0)))
        end = next(iter(elbows(self.arm, (0.05, 0.4, 0.2), 0.0)))
        path = transfer_path(self.arm, start, end)
        assert path.nodes[0] == pytest.approx(start)
        assert path.nodes[-1] == pytest.approx(end)
        steps = np.diff(path.nodes, axis=0)
        assert steps == pytest.approx(np.tile(steps[0], (len(steps), 1)))
