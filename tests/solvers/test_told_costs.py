"""Costs that back ends tell: proofs hold with any bound, and no more is asked than has to be."""

from itertools import pairwise, permutations
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import assume, event, given, settings
from hypothesis import strategies as st

from example_count import examples
from situations import assembly, config_content, fake_back_end, model_of, small_assemblies
from skillplan.errors import NotASequencing
from skillplan.judge import find_least_cost_of_orders, find_least_cost_of_states
from skillplan.model import SequencingProblem, replay
from skillplan.physics import Engine
from skillplan.solvers import ExactSolver, ExhaustiveSolver
from skillplan.task import Verdict
from skillplan.testing import reachable_states
from timed_back_end import clock


def timed_task(content):
    """Return the task of an assembly's content with time as its cost."""
    return assembly({**content, "cost": "time"})


@pytest.fixture(scope="module")
def board():
    return timed_task(config_content("inverter_board"))


@settings(max_examples=examples(100))
@given(
    content=small_assemblies(),
    seed=st.integers(0, 2**32),
    tightness=st.sampled_from([0.0, 0.5, 0.9, 1.0]),
)
def test_exact_search_and_the_best_order_cost_what_plain_search_finds(content, seed, tightness):
    """By a search without any bound; what is asked for lazily is what is asked for eagerly."""
    assume(len(content["parts"]) + len(content["screws"]) <= 4)
    task = timed_task(content)
    plain = find_least_cost_of_states(model_of(task, clock(task, 0.0, seed)))
    solution = ExactSolver().solve(model_of(task, clock(task, tightness, seed)))
    assert solution.proved
    if solution.plan is None:
        assert plain.cost == float("inf")
    else:
        assert solution.plan.cost == pytest.approx(plain.cost, abs=1e-9)
        assert solution.lower_bound == solution.plan.cost
    try:
        problem = SequencingProblem.from_model(model_of(task, clock(task, tightness, seed)))
    except NotASequencing as error:
        event("refused: " + str(error).partition("problem: ")[2][:60])
        return
    by_orders = find_least_cost_of_orders(problem)
    event("by orders" if by_orders.cost is not None else by_orders.why_not[:30])
    if by_orders.cost is not None:
        assert by_orders.cost == pytest.approx(plain.cost, abs=1e-9)


@pytest.mark.parametrize("tightness", [0.0, 0.8, 1.0])
def test_a_plan_costs_what_its_trajectories_take(board, tightness):
    """Step by step, in a fresh model."""
    solution = ExactSolver().solve(model_of(board, clock(board, tightness)))
    walked = replay(
        model_of(board, clock(board)), [board.skill(name) for name in solution.plan.skills]
    )
    assert walked.complete
    assert solution.plan.cost == pytest.approx(walked.cost, abs=1e-9)
    assert walked.cost == walked.duration_s


def test_the_tighter_the_bound_the_fewer_trajectories(board):
    """None is computed twice, and without any bound no more than by brute force."""
    everything = model_of(board, clock(board))
    reachable_states(everything)
    counts = [everything.stats.trajectories]
    for tightness in (0.0, 0.9, 1.0):
        teller = clock(board, tightness)
        model = model_of(board, teller)
        ExactSolver().solve(model)
        assert len(teller.asked) == len(set(teller.asked)) == model.stats.trajectories
        counts.append(model.stats.trajectories)
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] < counts[1] < counts[0]


def test_no_bound_asks_for_a_trajectory(board):
    """A search that ends before the first node has asked for none."""
    teller = clock(board)
    model = model_of(board, teller)
    solver = ExactSolver()
    with patch.object(type(solver.stop), "__call__", return_value=True):
        solver.solve(model)
    assert teller.asked == []


def test_orders_know_the_costs_of_what_may_follow_each_other(board):
    """In some order, and of nothing else."""
    problem = SequencingProblem.from_model(model_of(board, clock(board, 0.9)))
    neighbours, first = set(), set()
    for order in permutations(range(len(problem.jobs))):
        place = {job: position for position, job in enumerate(order)}
        if all(place[left] < place[other] for left, other in problem.precedence):
            first.add(order[0])
            neighbours |= set(pairwise(order))
    assert neighbours == {(int(i), int(j)) for i, j in np.argwhere(np.isfinite(problem.costs))}
    assert first == set(np.flatnonzero(np.isfinite(problem.first)).tolist())


def test_orders_ask_for_fewer_trajectories_than_there_are(board):
    """What precedence rules out is not asked, nor a tool change that cannot pay."""
    teller, everything = clock(board, 1.0), model_of(board, clock(board))
    SequencingProblem.from_model(model_of(board, teller))
    reachable_states(everything)
    assert len(teller.asked) == len(set(teller.asked)) < everything.stats.trajectories


@pytest.mark.slow(reason="walks the board; every run compares with plain search on small boards")
def test_brute_force_finds_the_optimum_that_exact_search_proves(board):
    """All 12,420 sequences with the same times."""
    seed = 5
    solution = ExactSolver().solve(model_of(board, clock(board, 0.8, seed)))
    every = ExhaustiveSolver().solve(model_of(board, clock(board, 0.8, seed)))
    assert every.trace["sequences"] == 12_420
    assert solution.plan.cost == pytest.approx(every.plan.cost, abs=1e-9)


def test_where_checks_are_expensive_a_skill_is_timed_before_it_is_executed(board):
    """What is dropped for its time is never executed; the optimum is the same."""
    teller = clock(board, 0.8)

    def executed(skill, state):
        assert (skill.name, state.bits & teller.stands) in teller.asked
        return Verdict.feasible(board.facts.none, board.facts.none)

    engine = fake_back_end(board, executed, name="engine", base=Engine, expensive=True)
    solution = ExactSolver().solve(model_of(board, teller, engine))
    assert solution.proved
    assert engine.asked
    plain = ExactSolver().solve(model_of(board, clock(board, 0.8)))
    assert solution.plan.cost == pytest.approx(plain.plan.cost, abs=1e-9)


def board_of_two_ways():
    """Return a board whose last part may go in by two ways."""
    content = config_content("inverter_board")
    content["parts"]["clock"]["insert_along"] = [[0, 0, -1], [1, 0, 0]]
    return timed_task(content)


@pytest.mark.parametrize("tightness", [0.0, 1.0])
def test_of_a_skill_with_several_ways_the_time_of_the_one_taken_counts(tightness):
    """The bound is that of the quickest."""
    task = board_of_two_ways()
    skill = task.skill("place(clock)")
    assert len(skill.ways) == 2
    model, plain = model_of(task, clock(task, tightness)), model_of(task, clock(task))
    solution, minimum = ExactSolver().solve(model), find_least_cost_of_states(plain)
    assert solution.plan.cost == pytest.approx(minimum.cost, abs=1e-9)
    bits = skill.precondition.requires.bits
    by_way = [clock(task).duration_s(skill.by(way), task.initial) for way in skill.ways]
    assert model.cost(task.initial, skill) == by_way[0]
    assert model.least_cost(skill, bits, 0) <= min(by_way)


def test_orders_are_not_recognised_where_a_time_depends_on_the_way():
    """Which way is free depends on what stands; exact search knows."""
    task = board_of_two_ways()
    with pytest.raises(NotASequencing, match=r"how long place\(clock\) takes depends on the way"):
        SequencingProblem.from_model(model_of(task, clock(task)))
