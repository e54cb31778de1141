"""The choice of a solver: what is chosen, why, and that nothing is lost by it."""

import subprocess
import sys

import pytest
from hypothesis import given, settings

import situations
from example_count import examples
from skillplan.collision import PrecedenceDetector
from skillplan.model import replay
from skillplan.pipeline import Setup, load_problem, make_solver, solve
from skillplan.records import Status
from skillplan.solvers import Plan, Stop
from skillplan.testing import SolverSuite
from sop_instances import BEST_KNOWN, instance
from thinned import slow_case

CHART = Setup(collision=("precedence",))


class TestAutoSolver(SolverSuite):
    solver = "auto"


def choice(task, setup=CHART, **more):
    return solve(task, "auto", setup, **more).trace["choice"]


def test_what_is_small_is_left_to_exact_search(board_task):
    """It proves the board before anything else is imported."""
    assert choice(board_task) == "exact, as it is small"


@pytest.mark.slow(reason="searches twelve parts; other choices in every run")
def test_jobs_in_an_order_are_left_to_the_portfolio(motor_drive_task):
    """Where exact search has no proof after a while, or there are many jobs."""
    assert choice(motor_drive_task) == "exact, as it is small" or choice(
        motor_drive_task
    ).startswith("portfolio, as it puts jobs into an order; no proof by exact within")
    many = instance("rbg048a").task
    assert choice(many, Setup()) == "portfolio, as it puts jobs into an order; many jobs"


def test_under_chance_it_is_value_iteration():
    """As nothing else fits."""
    result = solve(situations.retry_task(0.5), "auto")
    assert result.trace["choice"] == "value-iteration, as skills may fail by chance"
    assert result.status == Status.OPTIMAL


def test_a_small_task_without_jobs_is_solved_all_the_same():
    """Two roads to one fact."""
    result = solve(situations.two_roads_task(), "auto")
    assert (result.status, result.cost) == (Status.OPTIMAL, 3.0)


@settings(max_examples=examples(60))
@given(content=situations.small_assemblies())
def test_it_proves_the_optimum_of_random_assemblies(content):
    """With step limits that bind; or that there is no plan."""
    task = situations.assembly(content)
    model = situations.model_of(task, PrecedenceDetector(task))
    assert_proved(model, situations.optimum(situations.cheapest_by_length(model)))


@settings(max_examples=examples(60))
@given(task=situations.small_tasks())
def test_it_proves_the_optimum_of_random_tasks(task):
    """Of no structure at all."""
    assert_proved(
        situations.model_of(task),
        situations.optimum(situations.cheapest_by_length(situations.model_of(task))),
    )


def assert_proved(model, expected):
    solution = make_solver("auto", {}).solve(model)
    assert solution.proved
    assert (solution.plan is None) == (expected is None)
    if expected is not None:
        walked = replay(model, [model.task.skill(name) for name in solution.plan.skills])
        assert walked.violations == ()
        assert walked.cost == pytest.approx(expected[0], abs=1e-9)


@pytest.mark.parametrize(
    "name", ["ESC07", slow_case("ESC12", reason="others in every run"), "rbg048a"]
)
def test_it_proves_what_is_published(name):
    """On instances of sequential ordering, in less than a second each."""
    result = solve(instance(name).task, "auto", stop=Stop(time_limit_s=60))
    assert (result.status, result.cost) == (Status.OPTIMAL, float(BEST_KNOWN[name]["best_known"]))


@pytest.mark.slow(reason="larger instances; smaller ones in every run")
@pytest.mark.parametrize("name", ["ESC25", "br17.10", "p43.4", "rbg109a", "rbg150a", "ry48p.4"])
def test_it_proves_what_is_published_of_larger_instances(name):
    """As above."""
    test_it_proves_what_is_published(name)


@pytest.mark.slow(reason="searches for a second; a gap ends it in every run")
def test_a_search_that_runs_out_of_time_has_a_plan_and_a_bound():
    """On an instance that takes longer to prove."""
    result = solve(instance("ry48p.1").task, "auto", stop=Stop(time_limit_s=1))
    assert (result.status, result.reason) == (Status.SOLVED, "time limit")
    assert 15805 * 0.9 < result.lower_bound <= 15805 <= result.cost
    assert result.bound_method


def test_it_stops_once_the_gap_is_small_enough():
    """At the price of the proof."""
    result = solve(instance("ry48p.1").task, "auto", stop=Stop(gap=0.5, time_limit_s=60))
    assert result.status == Status.SOLVED
    assert result.gap <= 0.5
    assert "gap reached" in result.reason


def test_a_plan_to_start_from_is_never_given_up_for_a_worse_one(board_task):
    """Whatever is chosen, and however soon it ends."""
    best = solve(board_task, "exact", CHART)
    known = Plan(tuple(step.skill for step in best.steps))
    stop = Stop()
    stop.interrupt()
    result = solve(board_task, "auto", CHART, stop=stop, start=known)
    assert result.cost == pytest.approx(best.cost, abs=1e-9)


@pytest.mark.slow(reason="a process; the board needs none in every run")
def test_a_small_board_is_solved_without_numpy():
    """As one waits for every import."""
    code = (
        "import sys; from skillplan.cli import main\n"
        "try: main(['search-optimal', 'configs/inverter_board.yaml', '--solver', 'auto'])\n"
        "except SystemExit as end: assert not end.code, end.code\n"
        "heavy = {'numpy', 'numba', 'highspy'} & set(sys.modules); assert not heavy, heavy"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (0, "") == (done.returncode, done.stderr)
    assert "1.86709" in done.stdout


@pytest.mark.parametrize(
    "config",
    [
        "battery_module",
        slow_case("relay_rail", reason="the largest of three; one in every run"),
        slow_case("sensor_stack", reason="another one in every run"),
    ],
)
def test_it_proves_what_exact_search_proves(config):
    """On the other boards."""
    task = load_problem(f"configs/{config}.yaml").task
    solution = solve(task, "auto", CHART)
    assert solution.status == Status.OPTIMAL
    assert solution.cost == pytest.approx(solve(task, "exact", CHART).cost, abs=1e-9)


@pytest.mark.slow(reason="exact search tries first; the fleet solver itself in every run")
def test_several_agents_are_left_to_the_fleet():
    """Where exact search has no proof after a while; it proves what two of them need."""
    task = load_problem("configs/swarmitfix_fleet.yaml").part("fleet")
    result = solve(task, "auto")
    assert result.trace["choice"] == "fleet, as several agents move at once"
    assert (result.status, result.cost) == (Status.OPTIMAL, 36)
