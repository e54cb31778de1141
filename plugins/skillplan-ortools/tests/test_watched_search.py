"""A watched run of CP-SAT: it ends when told to, and what it says holds."""

import itertools
import math
import threading
import time

import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st
from ortools.sat.python import cp_model

from example_count import examples
from sequencing_problems import SOP, problem_of, random_problems
from skillplan import load_problem, make_model
from skillplan.model import SequencingProblem
from skillplan.solvers import Stop
from skillplan_ortools import OrderCircuit, WatchedSearch, WholeCosts


def nothing(found):
    """Take no notice."""


def searched(network, stop=None, on_order=nothing, on_bound=nothing, **options):
    circuit = OrderCircuit(network, options.pop("most_skills", None))
    search = WatchedSearch(circuit, workers=1, seed=0)
    return search.run(stop or Stop(), on_order, on_bound)


def open_instance():
    """Return an instance of the benchmark that CP-SAT does not prove within a minute."""
    model = make_model(load_problem(SOP / "ry48p.4.sop").task)
    return WholeCosts(SequencingProblem.from_model(model))


@settings(max_examples=examples(60))
@given(random_problems())
def test_it_proves_what_enumeration_finds(problem):
    """On random problems of up to six jobs; bounds on the way never exceed the optimum."""
    network = WholeCosts(problem)
    orders = [o for o in itertools.permutations(range(network.n)) if network.allows(o)]
    minimum = min(map(problem.cost, orders))
    event(f"{network.n} jobs")
    bounds = []
    outcome = searched(network, on_bound=bounds.append)
    assert outcome.complete
    assert problem.cost(outcome.order) == pytest.approx(minimum, abs=1e-9)
    assert network.in_problem_units(outcome.bound) == pytest.approx(minimum, abs=1e-9)
    assert bounds == sorted(bounds)
    assert all(network.in_problem_units(bound) <= minimum + 1e-9 for bound in bounds)


@settings(max_examples=examples(30))
@given(random_problems(), st.integers(0, 8))
def test_a_limit_on_skills_is_kept(problem, spare):
    """The cheapest among the orders whose plans are short enough, or none."""
    network = WholeCosts(problem)
    most = sum(map(len, problem.skills)) + spare
    orders = [
        o
        for o in itertools.permutations(range(network.n))
        if network.allows(o) and len(problem.plan(o)) <= most
    ]
    outcome = searched(network, most_skills=most)
    if orders:
        assert len(problem.plan(outcome.order)) <= most
        minimum = min(map(problem.cost, orders))
        assert problem.cost(outcome.order) == pytest.approx(minimum, abs=1e-9)
    else:
        assert outcome.impossible
        assert outcome.order is None


def test_where_nothing_leads_through_all_jobs_it_says_so():
    """Both jobs can only come first."""
    network = WholeCosts(problem_of([1, 1], [[math.inf] * 2] * 2))
    outcome = searched(network)
    assert outcome.impossible
    assert not outcome.complete


@pytest.mark.slow(reason="searches for a second; CP-SAT as a solver is ended by time in every run")
def test_a_stopped_run_keeps_its_bound_and_claims_no_proof():
    """Told so once it has a plan and a bound, it ends soon; the optimum 31446 is not refuted."""
    network, stop = open_instance(), Stop(time_limit_s=60.0)
    costs, bounds, told_s = [], [], []

    def end_once_both_are_there():
        if costs and bounds and not told_s:
            told_s.append(time.monotonic())
            stop.interrupt()

    def on_order(order):
        costs.append(network.problem.cost(order))
        end_once_both_are_there()

    def on_bound(bound):
        bounds.append(bound)
        end_once_both_are_there()

    outcome = searched(network, stop, on_order, on_bound)
    assert time.monotonic() - told_s[0] < 3
    assert not outcome.complete
    assert not outcome.impossible
    assert costs
    assert costs == sorted(costs, reverse=True)
    assert outcome.bound == bounds[-1] <= 31446 <= costs[-1]


def test_all_that_is_told_is_told_from_the_calling_thread():
    """Whoever shows progress need not be prepared for threads."""
    threads = set()
    network = WholeCosts(problem_of([3, 4], [[math.inf, 7], [9, math.inf]]))
    searched(
        network,
        on_order=lambda order: threads.add(threading.current_thread()),
        on_bound=lambda bound: threads.add(threading.current_thread()),
    )
    assert threads == {threading.current_thread()}


class ClaimingSolver(cp_model.CpSolver):
    """Once stopped, says that a plan it never improved on is optimal."""

    objective_value = best_objective_bound = 10.0
    num_branches = num_conflicts = 0

    def __init__(self):
        super().__init__()
        self._told = threading.Event()

    def solve(self, model, solution_callback=None):
        self.best_bound_callback(4.0)
        self._told.wait(10)
        self.best_bound_callback(10.0)
        return cp_model.OPTIMAL

    def stop_search(self):
        self._told.set()


def test_a_stopped_run_that_calls_itself_optimal_is_not_believed(monkeypatch):
    """Only what was proved before the stop counts."""
    monkeypatch.setattr(cp_model, "CpSolver", ClaimingSolver)
    network = WholeCosts(problem_of([3, 4], [[math.inf, 7], [9, math.inf]]))
    outcome = searched(network, Stop(time_limit_s=0.2))
    assert not outcome.complete
    assert outcome.bound == 4.0


class HastySolver(ClaimingSolver):
    """Ends by itself, as optimal, with a bound below its cost."""

    best_objective_bound = 9.0

    def solve(self, model, solution_callback=None):
        return cp_model.OPTIMAL


def test_a_run_whose_bound_does_not_reach_its_cost_is_no_proof(monkeypatch):
    """Whatever it calls itself; the bound still counts."""
    monkeypatch.setattr(cp_model, "CpSolver", HastySolver)
    network = WholeCosts(problem_of([3, 4], [[math.inf, 7], [9, math.inf]]))
    outcome = searched(network)
    assert not outcome.complete
    assert outcome.bound == 9.0


class FailingSolver(ClaimingSolver):
    """Fails in its thread."""

    def solve(self, model, solution_callback=None):
        raise RuntimeError("out of order")


def test_a_failure_in_the_thread_reaches_the_caller(monkeypatch):
    """Where it is put into words."""
    monkeypatch.setattr(cp_model, "CpSolver", FailingSolver)
    network = WholeCosts(problem_of([3, 4], [[math.inf, 7], [9, math.inf]]))
    with pytest.raises(RuntimeError, match="out of order"):
        searched(network)
