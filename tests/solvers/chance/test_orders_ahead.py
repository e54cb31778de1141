"""What is ahead in a task of jobs: exactly what a search finds, and never more."""

from __future__ import annotations

import itertools
import math
import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from situations import make_skill, make_task, model_of, retry_task
from skillplan.domains.assembly import BoardGenerator
from skillplan.errors import NotASequencing
from skillplan.model import SkillModel, evaluate_policy
from skillplan.pipeline import load_problem, make_model
from skillplan.solvers import Stop
from skillplan.solvers.chance import (
    AdaptiveSearch,
    CertainModel,
    OrdersAhead,
    ReplanSolver,
    assume_retries,
    compute_costs_to_go,
    find_orders_ahead,
    list_feasible_sets,
    relax,
)
from skillplan.task import Facts, State

BOARDS = st.builds(
    BoardGenerator,
    parts=st.integers(2, 5),
    density=st.floats(0, 0.5),
    tools=st.integers(1, 3),
    seed=st.integers(0, 10_000),
    failures=st.just((0.05, 0.6)),
    failing_share=st.floats(0.4, 1.0),
)
# By job the set of those before it, which come earlier in the list.
NEEDS = st.integers(1, 5).flatmap(
    lambda count: st.tuples(*(st.integers(0, (1 << job) - 1) for job in range(count)))
)


def model_on(board: BoardGenerator, folder: Path) -> SkillModel:
    path = folder / "board.yaml"
    path.write_text(board.text(), "utf-8")
    return make_model(load_problem(path).task)


def met_by_chance(model: SkillModel, seed: int) -> list[State]:
    """Return the states of some walks at random, what fails included."""
    chance, met = random.Random(seed), {model.initial: None}
    for _ in range(4):
        state = model.initial
        for _ in range(model.step_limit):
            arrows = model.transitions(state)
            if not arrows:
                break
            state = chance.choice(chance.choice(arrows).outcomes)[1]
            met[state] = None
    return list(met)


@settings(max_examples=examples(12))
@given(board=BOARDS, seed=st.integers(0, 100))
def test_it_knows_what_a_search_from_any_state_finds(board, seed, tmp_path_factory):
    """Also after a miss, with a part in hand, and with any tool."""
    model = model_on(board, tmp_path_factory.mktemp("board"))
    certain = assume_retries(model.task)
    ahead = OrdersAhead(CertainModel(model, certain), 1_000, Stop())
    plain = AdaptiveSearch(model, certain, Stop(), 100_000)
    for state in met_by_chance(model, seed):
        cost = plain.cost(state)
        if cost is not None:
            assert ahead(state) == pytest.approx(cost, abs=1e-9)
            assert ahead(state) <= cost + 1e-12


@settings(max_examples=examples(6))
@given(board=BOARDS)
def test_replanning_is_the_same_with_it_and_without(board, tmp_path_factory):
    """Plan, bound and expected cost, with no more searching."""
    model = model_on(board, tmp_path_factory.mktemp("board"))
    results = [
        ReplanSolver(ReplanSolver.Options(sets=sets, roll_outs=2)).solve(model)
        for sets in (0, 1_000)
    ]
    plain, ahead = results
    assert plain.trace["sets"] is None
    assert ahead.trace["sets"] >= 1
    for name in ("planned_cost",):
        assert ahead.trace[name] == pytest.approx(plain.trace[name], abs=1e-9)
    assert ahead.lower_bound == pytest.approx(plain.lower_bound, abs=1e-9)
    assert ahead.trace["expanded"] <= plain.trace["expanded"]


def test_a_board_beyond_tables_is_planned_and_bounded_in_a_moment(tmp_path):
    """20 parts, some hundred thousand states: bound, plan and replanning within 3 %."""
    board = BoardGenerator(20, 0.2, 3, 1, failures=(0.1, 0.4), failing_share=1 / 3)
    model = model_on(board, tmp_path)
    solution = ReplanSolver().solve(model)
    assert solution.policy is not None
    cost = evaluate_policy(model, solution.policy.get).cost
    assert cost is not None
    assert solution.lower_bound is not None
    assert solution.trace["expanded"] < 1_000
    assert solution.lower_bound == pytest.approx(18.12138, abs=1e-5)
    assert cost == pytest.approx(18.53500, abs=1e-5)


@given(needs=NEEDS)
def test_sets_hold_with_every_job_what_it_needs(needs):
    everything = range(1 << len(needs))
    entries = {
        item
        for item in everything
        if all(not item >> job & 1 or not need & ~item for job, need in enumerate(needs))
    }
    layers = list_feasible_sets(needs, 100, Stop())
    assert [int(node) for layer in layers for node in layer] == sorted(
        entries, key=lambda first: (first.bit_count(), first)
    )
    assert list_feasible_sets(needs, len(entries) - 1, Stop()) == []


@given(needs=NEEDS, seed=st.integers(0, 1_000))
def test_what_is_to_pay_is_the_least_of_all_orders(needs, seed):
    count = len(needs)
    costs = np.random.default_rng(seed).uniform(0, 1, (count, count))
    costs[np.random.default_rng(seed).random((count, count)) < 0.2] = np.inf
    layers = list_feasible_sets(needs, 100, Stop())
    result = compute_costs_to_go(layers, needs, costs, Stop())
    for layer, table in zip(layers[1:], result[1:], strict=True):
        for done, row in zip(layer.tolist(), table, strict=True):
            for last in range(count):
                if done >> last & 1:
                    assert row[last] == pytest.approx(least(done, last, needs, costs))


def least(done: int, last: int, needs: tuple[int, ...], costs: Any) -> float:
    """Return the least cost of all orders of what is left, one by one."""
    rest = [job for job in range(len(needs)) if not done >> job & 1]
    minimum = math.inf
    for order in itertools.permutations(rest):
        total, here, met = 0.0, last, done
        for job in order:
            total += costs[here, job] if not needs[job] & ~met else math.inf
            here, met = job, met | 1 << job
        minimum = min(minimum, total)
    return minimum


def test_where_there_are_no_jobs_or_too_many_sets_nothing_is_known(tmp_path):
    task = retry_task(0.25, 2.0)
    assert find_orders_ahead(model_of(task), assume_retries(task), 0, Stop()) is None
    facts = Facts(("one", "two"))
    skills = [
        make_skill(facts, name, forbids=(name,), outcomes=[(0.5, (name,), ()), (0.5, (), ())])
        for name in facts.names
    ]
    other = make_task(facts, skills, goal=facts.names)
    assert find_orders_ahead(model_of(other), assume_retries(other), 1_000, Stop()) is None
    model = model_on(BoardGenerator(4, 0.0, 1, 1), tmp_path)
    certain = CertainModel(model, assume_retries(model.task))
    with pytest.raises(NotASequencing, match="more than 15 sets of jobs"):
        OrdersAhead(certain, 15, Stop())
    assert OrdersAhead(certain, 16, Stop()).sets == 16


def test_what_verdicts_rest_on_is_noted_for_the_proof(tmp_path):
    """The order of jobs rests on verdicts, and so does a bound that is worked out with it."""
    board = BoardGenerator(5, 0.5, 1, 1, failures=(0.1, 0.4), failing_share=0.5)
    model = model_on(board, tmp_path)
    certain = relax(model.task)
    assert certain is not None
    certain_model = CertainModel(model, certain)
    assert not certain_model.questions
    assert OrdersAhead(certain_model, 1_000, Stop()).questions
    placed = model.task.goal.requires.bits
    assert certain_model.questions & placed
