"""The solver cp-sat: what it proves, what it refuses, and how it stops."""

import itertools
import math
import os
import random
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

from example_count import examples
from sequencing_problems import SOP, problem_of, random_problems
from situations import assembly, retry_task, small_assemblies
from skillplan import Plan, Status, load_problem, make_model, solve
from skillplan.cli import handle_signals
from skillplan.pipeline import Setup
from skillplan.solvers import Stop
from skillplan.testing import SolverSuite, lid_task, shut_box_task
from skillplan.workers import measure_resident_bytes
from skillplan_ortools import START, CpSatSolver, WholeCosts
from thinned import release_case, slow_case

CONFIGS = SOP.parents[2] / "configs"


def instance(name):
    return load_problem(SOP / f"{name}.sop").task


class TestCpSatSolver(SolverSuite):
    solver = "cp-sat"


@pytest.mark.parametrize(
    ("config", "collision"),
    [
        ("inverter_board", ("precedence",)),
        ("inverter_board", ("aabb",)),
        slow_case("motor_drive", ("precedence",), reason="smaller boards in every run"),
        release_case("motor_drive", ("aabb",), reason="smaller boards in every run"),
        slow_case("relay_rail", ("precedence",), reason="smaller boards in every run"),
        slow_case("relay_rail", ("aabb",), reason="other boards by boxes in every run"),
        ("battery_module", ("precedence",)),
        ("battery_module", ("aabb",)),
    ],
)
def test_it_proves_what_exact_search_proves(config, collision):
    """Two methods that share nothing but the model."""
    task = load_problem(CONFIGS / f"{config}.yaml").task
    setup = Setup(collision=collision)
    result, exact = solve(task, "cp-sat", setup), solve(task, "exact", setup)
    assert result.status == exact.status == Status.OPTIMAL, result.reason
    assert result.cost == pytest.approx(exact.cost, abs=1e-9)
    assert result.lower_bound == pytest.approx(exact.cost, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "optimum"),
    [
        ("ESC07", 2125),
        slow_case("ESC12", 1675, reason="a smaller one in every run"),
        slow_case("br17.10", 55, reason="two others in every run"),
    ],
)
def test_it_proves_the_benchmark(name, optimum):
    """The optima that the field has published."""
    result = solve(instance(name), "cp-sat")
    assert result.status is Status.OPTIMAL, result.reason
    assert result.cost == result.lower_bound == optimum
    assert "CP-SAT" in result.trace["bound_method"]
    assert result.trace["ended"] == "proof"


@settings(max_examples=examples(60))
@given(content=small_assemblies(), spare=st.integers(0, 3))
def test_it_never_says_more_than_exact_search(content, spare):
    """Also where the step limit binds, and an order that is cheapest takes too many skills."""
    task = assembly(content)
    minimum = 2 * len(content["parts"]) + len(content["screws"])
    task = task.replace(step_limit=minimum + spare)
    result, exact = solve(task, "cp-sat"), solve(task, "exact")
    event(f"{result.status.value} where exact search says {exact.status.value}")
    if result.status is Status.REFUSED:
        return
    if exact.status is Status.INFEASIBLE:
        assert result.status is Status.UNSOLVED
        return
    assert exact.status is Status.OPTIMAL
    if result.lower_bound is not None:
        assert result.lower_bound <= exact.cost + 1e-9
    if result.cost is not None:
        assert result.cost >= exact.cost - 1e-9
    if result.status is Status.OPTIMAL:
        assert result.cost == pytest.approx(exact.cost, abs=1e-9)


@pytest.mark.slow(reason="searches; with one in every run")
@settings(max_examples=examples(60))
@given(content=small_assemblies())
def test_without_a_step_limit_that_binds_it_proves_or_refuses(content):
    """It leaves nothing open that exact search solves."""
    task = assembly(content).replace(step_limit=100)
    result, exact = solve(task, "cp-sat"), solve(task, "exact")
    event(result.status.value)
    if result.status is not Status.REFUSED and exact.status is Status.OPTIMAL:
        assert result.status is Status.OPTIMAL, result.reason
        assert result.cost == pytest.approx(exact.cost, abs=1e-9)


def test_chance_is_refused_in_words():
    """And a solver is named that serves it."""
    result = solve(retry_task(0.5), "cp-sat")
    assert result.status is Status.REFUSED
    assert "several outcomes" in result.reason
    assert "value-iteration" in result.reason


def test_what_is_no_sequencing_problem_is_refused_in_words():
    """The task is named, and what stands against it."""
    problem = load_problem(CONFIGS / "swarmitfix_polygonal.yaml")
    model = make_model(problem.part("base-1"))
    refusal = CpSatSolver().refuses(model)
    assert "is not a sequencing problem" in refusal
    assert refusal.endswith("Take exact.")


def test_the_structure_is_recognised_once(monkeypatch):
    """Asking physics twice would be expensive."""
    from skillplan.model import SequencingProblem

    queries = []
    recognise = SequencingProblem.from_model.__func__

    def counting(cls, model, *stop):
        queries.append(model)
        return recognise(cls, model, *stop)

    monkeypatch.setattr(SequencingProblem, "from_model", classmethod(counting))
    assert solve(lid_task(), "cp-sat").status is Status.OPTIMAL
    assert len(queries) == 1


def test_what_stands_against_every_order_is_named():
    """A circle of orders is an answer, no proof."""
    result = solve(shut_box_task(), "cp-sat", Setup(collision=("precedence", "aabb")))
    assert result.status is Status.UNSOLVED
    assert "before" in result.reason


def test_a_task_with_nothing_to_do_is_solved_by_doing_nothing():
    """The plan without skills costs nothing and is proved."""
    task = lid_task()
    done = task.replace(goal=replace(task.goal, requires=task.facts.none))
    result = solve(done, "cp-sat")
    assert result.status is Status.OPTIMAL, result.reason
    assert result.steps == ()


@pytest.mark.parametrize(
    ("name", "limit_s"),
    [
        ("ry48p.4", 0.5),
        *(
            slow_case(name, 1.5, reason="a smaller one in every run")
            for name in ("rbg253a", "kro124p.1")
        ),
    ],
)
def test_a_search_that_runs_out_of_time_has_a_plan_and_a_bound_and_no_proof(name, limit_s):
    """On instances large and small it ends within a fraction of a second."""
    task, stop = instance(name), Stop(time_limit_s=limit_s)
    begin_s = time.monotonic()
    result = solve(task, "cp-sat", stop=stop)
    assert time.monotonic() - begin_s < 3.5
    assert result.status is Status.SOLVED, result.reason
    assert result.reason == "time limit"
    assert result.trace["ended"] == "time limit"
    assert (result.lower_bound or 0) < result.cost


@pytest.mark.slow(reason="searches for half a second; the time limit ends another one in every run")
def test_ctrl_c_ends_the_search_at_once():
    """The signal is heeded while CP-SAT searches, not when it is done."""
    stop = Stop()
    task = instance("ry48p.4")
    told_s = []

    def interrupt():
        told_s.append(time.monotonic())
        os.kill(os.getpid(), signal.SIGINT)

    timer = threading.Timer(0.5, interrupt)
    with handle_signals(stop.interrupt):
        timer.start()
        solution = CpSatSolver(stop=stop).solve(make_model(task))
        ended_s = time.monotonic()
    timer.join()
    assert ended_s - told_s[0] < 1
    assert stop.interrupted
    assert solution.plan is not None
    assert not solution.proved


def test_it_stops_once_the_gap_is_small_enough():
    """Half the cost is enough here, and no proof."""
    stop = Stop(gap=0.5, time_limit_s=60)
    result = solve(instance("ry48p.4"), "cp-sat", stop=stop)
    assert result.status is Status.SOLVED
    assert result.reason == "gap reached"
    assert (result.cost - result.lower_bound) / result.cost <= 0.5


def test_it_stops_before_memory_runs_out():
    """With a tenth of the limit left it ends with what it has."""
    stop = Stop(memory_limit_bytes=int(measure_resident_bytes() * 1.05), time_limit_s=60)
    result = solve(instance("ry48p.4"), "cp-sat", stop=stop)
    assert result.status is Status.SOLVED
    assert result.reason == "memory limit"


@pytest.mark.slow(
    reason="searches twelve jobs; a plan to start from in every run for the portfolio"
)
def test_it_begins_with_the_plan_that_it_was_given():
    """A search without time to find another returns that one."""
    task = instance("ESC12")
    best = solve(task, "cp-sat")
    stop = Stop()
    stop.incumbent(Plan(tuple(step.skill for step in best.steps), best.cost))
    stop.interrupt()
    solution = CpSatSolver(CpSatSolver.Options(start=False), stop).solve(make_model(task))
    assert solution.plan.cost == best.cost
    assert not solution.proved


@pytest.mark.slow(reason="two searches of twelve jobs; it proves the small instance in every run")
def test_with_one_worker_the_same_seed_searches_in_the_same_way():
    """To the last branch."""
    first, second = (solve(instance("ESC12"), "cp-sat", seed=5) for _ in range(2))
    assert first.trace == second.trace
    assert first.steps == second.steps


def test_several_workers_prove_the_same():
    """Whatever order they find it in."""
    setup = Setup(options={"cp-sat": {"workers": 2}})
    result = solve(instance("ESC12"), "cp-sat", setup)
    assert result.status is Status.OPTIMAL
    assert result.cost == 1675
    assert result.trace["workers"] == 2


def test_as_many_workers_search_as_jobs_are_allowed():
    """Unless an option says otherwise."""
    solver = CpSatSolver()
    solver.jobs = 2
    assert solver.solve(make_model(instance("ESC07"))).trace["workers"] == 2


def test_a_seed_of_any_size_is_taken():
    """CP-SAT's own are of 31 bits."""
    seed = random.Random(1).getrandbits(63)
    assert solve(instance("ESC07"), "cp-sat", seed=seed).status is Status.OPTIMAL


# OR-Tools and highspy both bring HiGHS, and are to live in one process.


INSTANCE = Path(__file__).parents[3] / "tests" / "instances" / "sop" / "ESC07.sop"


@pytest.mark.slow(reason="a process for each order; one comparison is a command of every CI run")
@pytest.mark.parametrize(
    "solvers",
    [
        "cp-sat,branch-and-cut",
        slow_case("branch-and-cut,cp-sat", reason="the other order in every run"),
    ],
)
def test_a_comparison_may_hold_both_in_any_order(solvers):
    """In a process of its own, as what is loaded first stays."""
    words = ["compare", str(INSTANCE), "--solvers", solvers, "--format", "csv"]
    done = subprocess.run(
        [sys.executable, "-m", "skillplan", *words], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.count(",optimal,2125,") == 2


# Costs in whole units: no order looks cheaper by rounding than a proof may ignore.


def whole_cost(network, order):
    return sum(network.arcs[arc] for arc in zip((START, *order), order, strict=False))


@settings(max_examples=examples(100))
@given(random_problems())
def test_whole_costs_bound_costs_from_below_and_closely(problem):
    """For every order that the precedence allows, within a tenth of what a proof may ignore."""
    network = WholeCosts(problem)
    for order in itertools.permutations(range(network.n)):
        if network.allows(order):
            cost = problem.cost(order)
            bound = network.in_problem_units(whole_cost(network, order))
            assert cost - 1e-10 <= bound <= cost + 1e-14


@settings(max_examples=examples(100))
@given(random_problems())
def test_an_order_takes_no_arc_that_was_left_out(problem):
    """What the precedence allows, the arcs and ranks allow, too."""
    network = WholeCosts(problem)
    for order in itertools.permutations(range(network.n)):
        place = {job: position for position, job in enumerate(order)}
        if all(place[i] < place[j] for i, j in problem.precedence):
            assert network.allows(order)
            for job in order:
                first, last = network.ranks(job)
                assert first <= place[job] <= last


def test_costs_that_are_whole_stay_as_they_are():
    """So that an integer instance is solved as it stands in its file."""
    network = WholeCosts(problem_of([3, 4], [[math.inf, 7], [9, math.inf]]))
    assert network.exponent == 0
    assert network.arcs == {(START, 0): 3, (START, 1): 4, (0, 1): 7, (1, 0): 9}


def test_costs_too_large_to_be_added_exactly_are_made_coarser():
    """Sums stay where floats hold every whole number; the bound still holds."""
    most = 2.0**52 + 2
    network = WholeCosts(problem_of([most, most], [[math.inf, most], [most, math.inf]]))
    total = whole_cost(network, (0, 1))
    assert total <= 2**52
    assert 0.999 * 2 * most < network.in_problem_units(total) <= 2 * most


def test_a_way_that_does_not_exist_is_no_arc():
    """An infinite cost says that nothing leads there."""
    network = WholeCosts(problem_of([3, math.inf], [[math.inf, 7], [9, math.inf]]))
    assert (START, 1) not in network.arcs
    assert not network.allows((1, 0))
    assert network.allows((0, 1))


def test_the_nearest_order_goes_on_to_the_cheapest_job_that_may_come_next():
    """It respects the precedence; of equals the first comes first."""
    costs = np.array([[math.inf, 5, 1], [1, math.inf, 1], [2, 1, math.inf]])
    assert WholeCosts(problem_of([2, 1, 2], costs)).nearest_order() == (1, 0, 2)
    assert WholeCosts(problem_of([2, 1, 2], costs, {(0, 1)})).nearest_order() == (0, 2, 1)


def test_where_the_nearest_order_comes_to_a_dead_end_there_is_none():
    """From the cheapest first job nothing leads on."""
    network = WholeCosts(problem_of([1, 5], [[math.inf, math.inf], [1, math.inf]]))
    assert network.nearest_order() is None


@pytest.mark.parametrize("order", [(0,), (0, 0), (0, 1, 2), (1, 0)])
def test_what_is_no_order_or_breaks_the_precedence_is_not_allowed(order):
    """Every job once, and what comes before before."""
    network = WholeCosts(problem_of([1, 1], [[math.inf, 1], [1, math.inf]], {(0, 1)}))
    assert not network.allows(order)
