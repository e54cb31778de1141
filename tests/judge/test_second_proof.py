"""Least costs worked out a second time: the same as by other means, or given up in words."""

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import situations
from example_count import examples
from handovers import best
from sequencing_problems import random_problems
from skillplan.errors import NotASequencing
from skillplan.judge import (
    ORDERS,
    STATES,
    PlannerAnswer,
    check_with_planner,
    fast_downward,
    find_bound_of_orders,
    find_least_cost_of_orders,
    find_least_cost_of_states,
)
from skillplan.model import SequencingProblem
from skillplan.pipeline import make_model, solve
from skillplan.records import Claim, Outcome, Status, StoredClaims
from skillplan.task import State, Verdict


def problem_of(first, costs, precedence=(), step_limit=100):
    """Return jobs that are one skill each."""
    n = len(first)
    names = tuple(f"job_{i}" for i in range(n))
    paths = {(i, j): () for i in range(-1, n) for j in range(n) if i != j}
    matrix = np.array(costs, dtype=float).reshape(n, n)
    np.fill_diagonal(matrix, math.inf)
    return SequencingProblem(
        names,
        tuple((name,) for name in names),
        np.array(first, dtype=float),
        matrix,
        frozenset(precedence),
        paths,
        step_limit,
    )


class TestOrders:
    @given(st.data())
    def test_it_is_the_least_of_all_orders_that_respect_the_precedence(self, data):
        """As found by trying them one by one; costs may be infinite."""
        n = data.draw(st.integers(1, 6))
        figure = st.sampled_from([0.0, 0.5, 1.0, 2.0, 7.0, math.inf])
        first = data.draw(st.lists(figure, min_size=n, max_size=n))
        costs = data.draw(st.lists(figure, min_size=n * n, max_size=n * n))
        pairs = st.tuples(st.integers(0, n - 1), st.integers(0, n - 1)).filter(
            lambda p: p[0] < p[1]
        )
        precedence = data.draw(st.lists(pairs, max_size=4)) if n > 1 else []
        problem = problem_of(first, costs, precedence)
        allowed = [
            order
            for order in itertools.permutations(range(n))
            if all(order.index(i) < order.index(j) for i, j in precedence)
        ]
        least_cost = find_least_cost_of_orders(problem)
        assert least_cost.cost == min(map(problem.cost, allowed))
        if math.isfinite(least_cost.cost):
            order = [problem.jobs.index(name) for name in least_cost.skills]
            assert tuple(order) in allowed
            assert problem.cost(order) == least_cost.cost

    @settings(max_examples=10, deadline=None)
    @given(problem=random_problems())
    def test_the_relaxation_bounds_the_cheapest_order_from_below(self, problem):
        """Also with costs that differ by direction, and with precedence."""
        bound = find_bound_of_orders(problem)
        assert bound is None or bound <= find_least_cost_of_orders(problem).cost + 1e-9

    def test_the_relaxation_proves_an_order_with_too_many_sets(self):
        """The way along a line to its end, with a job that comes last."""
        places = [3, 7, 1, 9, 5, 2, 8, 4, 6, 10]
        costs = [[abs(a - b) for b in places] for a in places]
        problem = problem_of(places, costs, {(job, 0) for job in range(1, 10)})
        assert find_least_cost_of_orders(problem, most_subsets=100).cost is None
        assert find_bound_of_orders(problem) == pytest.approx(17.0)

    def test_a_circle_has_no_order(self):
        """Then there is no plan at all."""
        least_cost = find_least_cost_of_orders(problem_of([1, 1], [0, 1, 1, 0], [(0, 1), (1, 0)]))
        assert (least_cost.cost, least_cost.skills) == (math.inf, ())

    def test_nothing_to_do_costs_nothing(self):
        """Nor is there anything to be done."""
        assert find_least_cost_of_orders(problem_of([], [])).cost == 0.0

    def test_too_many_sets_are_given_up(self):
        """With the limit in words."""
        problem = problem_of([1.0] * 8, [1.0] * 64)
        least_cost = find_least_cost_of_orders(problem, most_subsets=100)
        assert (least_cost.method, least_cost.cost) == (ORDERS, None)
        assert least_cost.why_not == "too large, more than 100 sets of jobs"

    def test_time_ends_it(self):
        """At the next poll."""
        problem = problem_of([1.0] * 8, [1.0] * 64)
        assert (
            find_least_cost_of_orders(problem, lambda: True).why_not == "stopped before it was done"
        )

    def test_a_plan_beyond_the_step_limit_proves_nothing(self):
        """A costlier order might be shorter."""
        least_cost = find_least_cost_of_orders(problem_of([1.0] * 3, [1.0] * 9, step_limit=2))
        assert least_cost.cost is None
        assert least_cost.why_not == "the cheapest order takes 3 skills, the limit is 2"


class TestStates:
    @given(situations.small_tasks())
    def test_it_is_the_least_of_all_plans_within_the_step_limit(self, task):
        """As found by walking all of them; the plan holds and costs as much."""
        least_cost = find_least_cost_of_states(situations.model_of(task))
        best = situations.optimum(situations.cheapest_by_length(situations.model_of(task)))
        if best is None:
            assert (least_cost.cost, least_cost.skills) == (math.inf, ())
        else:
            assert least_cost.cost == pytest.approx(best[0], abs=1e-9)
            assert len(least_cost.skills) <= task.step_limit

    def test_a_step_limit_may_need_the_dearer_of_two_ways(self):
        """To a state as well as to the goal."""
        assert (
            find_least_cost_of_states(situations.model_of(situations.two_roads_task())).cost == 3.0
        )
        least_cost = find_least_cost_of_states(
            situations.model_of(situations.two_roads_task(step_limit=2))
        )
        assert (least_cost.cost, least_cost.skills) == (4.0, ("to_b", "finish"))

    def test_too_many_states_are_given_up(self, board_task):
        """With the limit in words."""
        least_cost = find_least_cost_of_states(make_model(board_task), most_states=10)
        assert (least_cost.method, least_cost.cost) == (STATES, None)
        assert least_cost.why_not == "too large, more than 10 states"

    def test_time_ends_it(self, motor_drive_task):
        """Also where the model itself says so."""
        model = make_model(motor_drive_task)
        assert (
            find_least_cost_of_states(model, lambda: True).why_not == "stopped before it was done"
        )
        model = make_model(motor_drive_task, overdue=lambda: True)
        assert find_least_cost_of_states(model).why_not == "stopped before it was done"

    def test_what_no_back_end_can_decide_proves_nothing(self):
        """A skill left out might be on the best way."""
        task = situations.two_roads_task()
        unsure = situations.fake_back_end(task, lambda skill, state: Verdict.unknown("cannot tell"))
        least_cost = find_least_cost_of_states(situations.model_of(task, unsure))
        assert (least_cost.cost, least_cost.why_not) == (None, "some verdicts are unknown")


@settings(max_examples=examples(100))
@given(situations.small_assemblies())
@pytest.mark.slow(reason="many boards; single proofs in every run")
def test_both_agree_with_exact_search(content):
    """On small boards, also those without a plan."""
    task = situations.assembly(content)
    exact = solve(task, "exact")
    states = find_least_cost_of_states(make_model(task))
    expected = exact.cost if exact.status is Status.OPTIMAL else math.inf
    assert states.cost == pytest.approx(expected, abs=1e-9)
    try:
        problem = SequencingProblem.from_model(make_model(task))
    except NotASequencing:
        return
    orders = find_least_cost_of_orders(problem)
    assert orders.cost is None or orders.cost == pytest.approx(expected, abs=1e-9)


def test_a_task_that_is_done_costs_nothing():
    """In no step."""
    facts = situations.two_roads_task().facts
    skills = situations.two_roads_task().skills
    task = situations.make_task(facts, skills, initial=("done",), goal=("done",))
    assert find_least_cost_of_states(situations.model_of(task)).cost == 0.0


# Claims of all plans before a planner of others, which adds up rounded costs.


MICROMETRES = 1_867_086


def judged(monkeypatch: pytest.MonkeyPatch, answer: PlannerAnswer, **claims: Any) -> Claim:
    """Return what a planner that answers so makes of claims on the inverter board."""
    monkeypatch.setattr(fast_downward, "find_driver", lambda: Path())
    monkeypatch.setattr(fast_downward, "run_planner", lambda made, limit_s: answer)
    model = best("inverter_board").model
    (claim,) = check_with_planner(stored(**claims), model, 1.0, charted=True)
    return claim


def stored(**claims: Any) -> StoredClaims:
    """Return claims of a result; those not given are not made."""
    none = dict.fromkeys(("cost", "lower_bound", "gap", "makespan", "makespan_s"))
    stated = {"solver": "exact", "cost_unit": "m", "skills": [], "actions": [], "steps": []}
    return StoredClaims.model_validate(
        {**none, **stated, **claims, "status": Status(claims["status"])}
    )


def answer(cost: int = MICROMETRES) -> PlannerAnswer:
    """Return the answer of a planner that finds the optimum."""
    return PlannerAnswer(cost, tuple(skill.skill.name for skill in best("inverter_board").skills))


def test_an_optimum_within_the_rounding_holds(monkeypatch):
    """Half a micrometre a skill."""
    plan = best("inverter_board").plan
    assert plan is not None
    claim = judged(monkeypatch, answer(MICROMETRES + 7), status="optimal", cost=plan.cost)
    assert (Outcome.HOLDS, True) == (claim.outcome, "rounded by at most 7.5e-06" in claim.detail)


def test_rounding_hides_no_better_plan(monkeypatch):
    """An optimum that is 5 um too dear is within the rounding, and the planner's plan is not."""
    claim = judged(monkeypatch, answer(), status="optimal", cost=MICROMETRES / 1e6 + 5e-6)
    assert (Outcome.FAILS, True) == (claim.outcome, claim.contradiction)
    assert "its plan costs 1.86708" in claim.detail


def test_a_cost_that_no_plan_has_fails(monkeypatch):
    claim = judged(monkeypatch, answer(), status="optimal", cost=MICROMETRES / 1e6 - 1e-5)
    assert (Outcome.FAILS, True) == (claim.outcome, "no plan costs so little" in claim.detail)


@pytest.mark.parametrize(
    ("bound", "outcome"), [(1.8, Outcome.HOLDS), (1.9, Outcome.FAILS), (None, Outcome.HOLDS)]
)
def test_a_search_that_was_ended_answers_for_its_bound_alone(monkeypatch, bound, outcome):
    """That the planner finds a plan and the search did not is no contradiction."""
    assert outcome is judged(monkeypatch, answer(), status="unsolved", lower_bound=bound).outcome


def test_a_plan_refutes_that_there_is_none(monkeypatch):
    claim = judged(monkeypatch, answer(), status="infeasible")
    assert Outcome.FAILS is claim.outcome


def test_a_lower_proved_cost_is_a_contradiction_even_if_the_plan_behind_it_does_not_hold(
    monkeypatch,
):
    """The files state the task as the model does, so that one of the two is wrong."""
    wrong = PlannerAnswer(MICROMETRES - 1000, answer().skills[::-1])
    claim = judged(monkeypatch, wrong, status="optimal", cost=MICROMETRES / 1e6)
    assert (Outcome.FAILS, True) == (claim.outcome, claim.contradiction)
    assert "its plan fails at fasten(screw_2): needs tool(screwdriver)" in claim.detail


def test_what_pddl_cannot_say_is_not_checked_and_no_planner_is_asked(monkeypatch):
    """A verdict that is not known may be either."""
    queries: list[object] = []
    monkeypatch.setattr(fast_downward, "find_driver", lambda: Path())
    monkeypatch.setattr(fast_downward, "run_planner", lambda *words: queries.append(words))
    task = best("inverter_board").task

    feasible = Verdict.feasible(task.facts.none, task.facts.none)

    def answer_pick(skill: Any, state: State) -> Verdict:
        return Verdict.unknown("no path in time") if skill.name == "pick(pcb)" else feasible

    claims = stored(status="optimal", cost=1.0)
    model = situations.model_of(task, situations.fake_back_end(task, answer_pick))
    (claim,) = check_with_planner(claims, model, 1.0, charted=False)
    assert (Outcome.NOT_CHECKED, []) == (claim.outcome, queries)
    assert claim.detail.startswith("PDDL cannot say it: verdicts are not known: pick(pcb) (fake:")
