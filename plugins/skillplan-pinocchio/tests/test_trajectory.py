"""The fastest run along a path: within the limits everywhere, and nowhere but on the path."""

import itertools
import math
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from example_count import examples
from skillplan.robots import PANDA
from skillplan_pinocchio import (
    ArmModel,
    JointLimits,
    JointPath,
    Unreachable,
    find_fastest_trajectory,
    iterate_descents,
)

NODES = st.integers(2, 9).flatmap(
    lambda count: arrays.arrays(float, (count, 7), elements=st.floats(-2.5, 2.5, width=32))
)
PANDA_LIMITS = JointLimits.of(PANDA)
FACTORS = st.floats(0.1, 1.0)
LIMITS = st.builds(
    lambda speeds, gains: JointLimits(tuple(speeds), tuple(gains)),
    st.lists(st.floats(0.1, 5.0), min_size=7, max_size=7),
    st.lists(st.floats(0.5, 30.0), min_size=7, max_size=7),
)
# So far may what toppra finds on a grid be from the fastest run, on paths as wild as these.
GRID = 0.02


@given(NODES, LIMITS)
@pytest.mark.slow(reason="many paths; a known path keeps its limits in every run")
def test_limits_are_never_exceeded(nodes, limits):
    """Neither speed nor acceleration of any joint, at 1,000 samples."""
    trajectory = find_fastest_trajectory(JointPath(nodes), limits)
    samples = [trajectory.at(time_s) for time_s in np.linspace(0, trajectory.duration_s, 1000)]
    speeds, gains = (np.abs([sample[which] for sample in samples]) for which in (1, 2))
    assert (speeds <= np.array(limits.speed_rad_per_s) * (1 + 1e-9)).all()
    assert (gains <= np.array(limits.acceleration_rad_per_s2) * (1 + 1e-9)).all()


@pytest.mark.slow(reason="times many paths; limits kept in every run")
@given(NODES, LIMITS)
def test_it_is_no_slower_than_a_trapezoid_of_the_parameter(nodes, limits):
    """Constant acceleration, speed and deceleration within them, half for bends."""
    path = JointPath(nodes)
    # The second derivative changes evenly between nodes, so it is greatest at one.
    bends = path.derivatives(np.linspace(0, 1, len(path.nodes)))[1]
    steepest, sharpest = (
        np.maximum(path.steepest, 1e-12),
        np.maximum(np.abs(bends).max(axis=0), 1e-12),
    )
    bound = np.array(limits.acceleration_rad_per_s2) / 2
    speed = min(
        (np.array(limits.speed_rad_per_s) / steepest).min(), math.sqrt((bound / sharpest).min())
    )
    gain = (bound / steepest).min()
    slow_s = 1 / speed + speed / gain if speed**2 < gain else 2 / math.sqrt(gain)
    assert find_fastest_trajectory(path, limits).duration_s <= slow_s * (1 + GRID)


@settings(max_examples=examples(50))
@given(NODES, LIMITS, FACTORS)
@pytest.mark.slow(reason="many paths; a known path keeps its limits in every run")
def test_faster_limits_are_not_slower(nodes, limits, factor):
    """Whichever of them is tightened, but for the grid."""
    path = JointPath(nodes)
    whole_s = find_fastest_trajectory(path, limits).duration_s
    slow = limits.scaled(factor)
    for tighter in (
        slow,
        JointLimits(slow.speed_rad_per_s, limits.acceleration_rad_per_s2),
        JointLimits(limits.speed_rad_per_s, slow.acceleration_rad_per_s2),
    ):
        assert find_fastest_trajectory(path, tighter).duration_s >= whole_s * (1 - GRID)


@given(NODES, LIMITS)
@pytest.mark.slow(reason="many paths; a known path keeps its limits in every run")
def test_there_takes_as_long_as_back(nodes, limits):
    """The same path the other way round, but for the grid and for where a run has to stop."""
    there_s, back_s = (
        find_fastest_trajectory(JointPath(way), limits).duration_s for way in (nodes, nodes[::-1])
    )
    assert there_s == pytest.approx(back_s, rel=3 * GRID)


@settings(max_examples=examples(100))
@given(NODES)
@pytest.mark.slow(reason="many paths; a known path keeps its limits in every run")
def test_it_goes_from_rest_to_rest_through_all_nodes(nodes):
    """It is on the path at all times, in its order, and its speed fits its places."""
    path = JointPath(nodes)
    trajectory = find_fastest_trajectory(path, PANDA_LIMITS)
    whole_s = trajectory.duration_s
    for node, place in zip(nodes, np.linspace(0, 1, len(nodes)), strict=True):
        assert path.at(float(place)) == pytest.approx(node, abs=1e-9)
        time_s = np.interp(place, trajectory.places, trajectory.times_s)
        assert trajectory.at(float(time_s))[0] == pytest.approx(node, abs=1e-9)
    for place, time_s in zip(trajectory.places, trajectory.times_s, strict=True):
        assert trajectory.at(time_s)[0] == pytest.approx(path.at(place), abs=1e-12)
    assert (np.diff(trajectory.times_s) > 0).all()
    for time_s in (0.0, whole_s):
        assert trajectory.at(time_s)[1] == pytest.approx(np.zeros(7), abs=1e-6)
    if whole_s > 0:
        times_s = np.linspace(0, whole_s, 400)
        rows = [trajectory.at(float(time_s)) for time_s in times_s]
        for (first, other), (t0, t1) in zip(
            itertools.pairwise(rows), itertools.pairwise(times_s), strict=True
        ):
            gain = np.abs([first[2], other[2]]).max() + 1.0
            change = (other[0] - first[0]) / (t1 - t0)
            assert change == pytest.approx((first[1] + other[1]) / 2, abs=float(gain) * (t1 - t0))


@given(NODES, st.floats(1e-6, 1.0))
def test_a_short_path_takes_the_time_of_its_shape(nodes, factor):
    """Where no limit of speed counts, by the root of how much shorter it is."""
    free = JointLimits((1e6,) * 7, PANDA.acceleration_rad_per_s2)
    whole_s = find_fastest_trajectory(JointPath(nodes), free).duration_s
    short_s = find_fastest_trajectory(JointPath(factor * nodes), free).duration_s
    if short_s > 0:
        assert short_s == pytest.approx(math.sqrt(factor) * whole_s, rel=1e-6)


def test_no_way_takes_no_time():
    """Not a rounding error's either."""
    still = np.zeros((3, 7))
    trajectory = find_fastest_trajectory(JointPath(still), PANDA_LIMITS)
    assert trajectory.duration_s == 0.0
    assert trajectory.at(0.0)[0] == pytest.approx(np.zeros(7))
    still[1] += 1e-12
    assert find_fastest_trajectory(JointPath(still), PANDA_LIMITS).duration_s == 0.0


def test_a_path_that_dies_away_is_run_in_parts():
    """Toppra finds nothing on the whole of it: a joint swings to and fro, each time a quarter."""
    nodes = np.zeros((9, 7))
    nodes[0, 0] = -1.0
    trajectory = find_fastest_trajectory(JointPath(nodes), JointLimits((1.0,) * 7, (1.0,) * 7))
    assert (trajectory.rates_per_s[1:-1] == 0).any()
    assert 2.0 < trajectory.duration_s < 6.0


def test_a_slow_joint_gets_up_to_its_speed_in_a_fraction_of_the_grid():
    """At 0.1 rad/s a joint goes 5 rad, gaining that speed within 0.2 s: 50.2 s by hand."""
    nodes = np.zeros((3, 7))
    nodes[:, 3] = (-2.5, 0.0, 2.5)
    nodes[1, 5] = 0.1
    limits = JointLimits((0.1,) * 7, (0.5,) * 7)
    assert find_fastest_trajectory(JointPath(nodes), limits).duration_s == pytest.approx(
        50.2, rel=2e-3
    )


def test_a_node_twice_is_gone_through():
    """Nodes one upon another are no stop, and no error."""
    nodes = np.repeat(np.linspace(0, 1, 3), 3)[:, np.newaxis] * np.linspace(-1, 1, 7)
    assert 0.5 < find_fastest_trajectory(JointPath(nodes), PANDA_LIMITS).duration_s < 5


def test_a_single_joint_takes_the_time_of_a_trapezoid():
    """One radian: by hand from speed and acceleration."""
    nodes = np.zeros((5, 7))
    nodes[:, 0] = np.linspace(0, 1, 5)
    speed, gain = PANDA.speed_rad_per_s[0], PANDA.acceleration_rad_per_s2[0]
    best_s = 1 / speed + speed / gain
    taken_s = find_fastest_trajectory(JointPath(nodes), PANDA_LIMITS).duration_s
    assert best_s <= taken_s * (1 + 1e-9) <= best_s * 1.01


@pytest.mark.slow(reason="many paths; a known path keeps its limits in every run")
def test_every_process_finds_the_same_times_to_the_bit(tmp_path):
    """And says nothing, and loads nothing that draws: toppra would, and fail without a screen."""
    words = (
        "import numpy as np\n"
        "from skillplan_pinocchio import JointPath\n"
        "from skillplan_pinocchio import JointLimits, find_fastest_trajectory\n"
        "nodes = np.sin(np.arange(63.0)).reshape(9, 7)\n"
        "from skillplan.robots import PANDA\n"
        "limits = JointLimits.of(PANDA)\n"
        "print(find_fastest_trajectory(JointPath(nodes), limits).times_s.tobytes().hex())\n"
        "import sys\n"
        "assert 'matplotlib' not in sys.modules"
    )
    nodes = np.sin(np.arange(63.0)).reshape(9, 7)
    own = find_fastest_trajectory(JointPath(nodes), PANDA_LIMITS).times_s.tobytes().hex()
    environment = {**os.environ, "MPLBACKEND": "none", "MPLCONFIGDIR": str(tmp_path)}
    command = [sys.executable, "-W", "default", "-c", words]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    assert (own, "") == (done.stdout.strip(), done.stderr)


@pytest.mark.parametrize("values", [(0.0,) * 7, (math.inf,) * 7, (-1.0,) * 7])
def test_a_limit_that_is_none_is_refused(values):
    """Zero, infinite, negative."""
    with pytest.raises(ValueError, match="must be > 0"):
        JointLimits(values, PANDA.acceleration_rad_per_s2)


@given(NODES, st.lists(st.floats(0.0, 1.0), min_size=1, max_size=8))
@settings(max_examples=examples(25))
def test_many_places_have_the_angles_and_rates_of_each_to_the_bit(nodes, places):
    """An execution reads a whole move at once, and no digit of it may depend on that."""
    path = JointPath(nodes)
    each = [(path.at(place), *path.rates(place)) for place in places]
    for together, apart in zip(path.at_each(places), zip(*each, strict=True), strict=True):
        np.testing.assert_array_equal(together, np.array(apart))


def test_a_path_needs_two_nodes():
    """One is no way."""
    with pytest.raises(ValueError, match="at least two nodes"):
        JointPath([np.zeros(7)])


class TestWaysOfTheArm:
    arm = ArmModel()

    def test_a_stroke_goes_straight_down_with_the_hand_down(self):
        """Between its nodes within 0.05 mm, too."""
        (path, *_) = iterate_descents(self.arm, (0.5, 0.1, 0.01), (0.5, 0.1, 0.16), 0.7)
        assert not isinstance(path, Unreachable)
        for place in np.linspace(0, 1, 41):
            position, rotation = self.arm.tip(path.at(float(place)))
            assert position == pytest.approx((0.5, 0.1, 0.16 - 0.15 * place), abs=5e-5)
            assert rotation[2, 2] == pytest.approx(-1, abs=1e-6)
