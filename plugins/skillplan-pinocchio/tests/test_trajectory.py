"""The fastest run along a path: within the limits everywhere, and nowhere but on the path."""

import itertools
import json
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
from skillplan import load_problem
from skillplan.cli import main
from skillplan.model import replay
from skillplan.pipeline import Setup, make_model, solve
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


# The inverter board in the shortest cycle time, by the trajectories of ``swept``.


SWEPT = Setup(collision=("swept",))
BOARD = "configs/inverter_board.yaml"
BY_DISTANCE = "0,1,2,3,4,5,8,9,10,11,6,7,13,14,15"
REST = ("--collision", "swept", "--set", "cost=time")


@pytest.fixture(scope="module")
def timed_board():
    return load_problem(BOARD, changes={"cost": "time"}).task


@pytest.fixture(scope="module")
def fastest(timed_board):
    """The optimum that exact search proves."""
    return solve(timed_board, "exact", SWEPT)


def output(capsys, *args):
    """Return the exit code of a command, and what it prints as JSON."""
    with pytest.raises(SystemExit) as ended:
        main([*args, "--format", "json"])
    return ended.value.code, json.loads(capsys.readouterr().out)


def test_the_plan_costs_the_time_of_its_trajectories(timed_board, fastest):
    """The cycle time is the cost; and the order of the least distance takes longer."""
    assert fastest.status == "optimal"
    assert (fastest.cost_unit, fastest.timed_by) == ("s", "swept")
    assert fastest.cost == pytest.approx(fastest.makespan_s) == pytest.approx(96.18989, abs=1e-5)
    assert fastest.cost == fastest.lower_bound
    model = make_model(timed_board, SWEPT)
    walked = replay(model, timed_board.parse_sequence(BY_DISTANCE))
    assert fastest.cost < walked.cost < 1.0005 * fastest.cost


def test_fewer_trajectories_are_computed_than_there_are(timed_board, fastest):
    """The figure counts what the search asked for; that of the document, too."""
    assert 15 <= fastest.trajectories < 58
    assert fastest.document()["stats"]["trajectories"] == fastest.trajectories


@pytest.mark.slow(reason="a search; of the board in every run")
def test_cost_by_distance_is_as_ever(timed_board):
    """Swept tells the time of its plan, and has no say in its cost."""
    by_distance = solve(load_problem(BOARD).task, "exact", SWEPT)
    assert by_distance.cost == pytest.approx(1.86709, abs=5e-6)
    assert (by_distance.cost_unit, by_distance.timed_by) == ("m", "swept")
    assert ",".join(str(step.action) for step in by_distance.steps) == BY_DISTANCE


@pytest.mark.slow(reason="all 12,420 sequences; every run solves the board by exact search")
def test_the_optimum_is_that_of_brute_force_over_all_sequences(timed_board, fastest):
    """With the same trajectories: by enumeration without bounds."""
    every = solve(timed_board, "exhaustive", SWEPT)
    assert every.trace["sequences"] == 12_420
    assert every.cost == pytest.approx(fastest.cost, abs=1e-9)
    assert [step.skill for step in every.steps] == [step.skill for step in fastest.steps]
    assert every.trajectories == 57


@pytest.mark.slow(reason="four more solvers; every run solves the board by exact search")
@pytest.mark.parametrize("solver", ["subset-dp", "branch-and-cut", "portfolio", "value-iteration"])
def test_other_solvers_prove_the_same_time(timed_board, fastest, solver):
    """Those that put jobs into an order, and dynamic programming."""
    other = solve(timed_board, solver, SWEPT)
    assert other.status == "optimal"
    assert other.cost == pytest.approx(fastest.cost, abs=1e-9)


@pytest.mark.slow(reason="six commands; every run solves the board from Python")
def test_commands_know_of_time_as_the_cost(tmp_path, capsys):
    """A result is verified, replayed and explained; a file with the key is as `--set`."""
    out = tmp_path / "run"
    code, result = output(capsys, "search-optimal", BOARD, *REST, "--out", str(out))
    assert (code, result["cost_unit"], result["timed_by"]) == (0, "s", "swept")
    code, verified = output(capsys, "verify", str(out))
    assert (code, verified["valid"]) == (0, True)
    assert {claim["outcome"] for claim in verified["claims"]} <= {"holds", "not checked"}
    code, walked = output(capsys, "evaluate", BOARD, *REST, "--sequence", BY_DISTANCE)
    assert code == 0
    assert walked["deviation"] == pytest.approx(0.00047, abs=1e-5)
    assert walked["cost"] == walked["makespan_s"]
    code, explained = output(capsys, "explain", BOARD, "pick(brace)", *REST, "--after", "0,1")
    assert (code, explained["status"]) == (0, "feasible")
    _, of_file = output(capsys, "search-optimal", "configs/inverter_time.yaml")
    assert of_file["cost"] == result["cost"]
    stored = json.loads((out / "result.json").read_text("utf-8"))
    stored["cost"] = stored["lower_bound"] = stored["cost"] - 0.01
    (out / "result.json").write_text(json.dumps(stored), "utf-8")
    code, forged = output(capsys, "verify", str(out))
    assert (code, forged["valid"]) == (1, False)
