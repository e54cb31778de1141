"""The export of a model as a sequential ordering problem."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, event, given, settings
from hypothesis import strategies as st

from situations import assembly, crowded_assemblies, small_assemblies
from skillplan.errors import NotASequencing
from skillplan.model.replay import replay
from skillplan.model.sequencing import SequencingProblem
from skillplan.run import make_model, solve
from skillplan.setup import Setup, load_problem
from skillplan.task.skill import Outcome
from skillplan.testing import lid_task, shut_box_task


def model_of(config, *detectors):
    task = load_problem(f"configs/{config}.yaml").task
    return make_model(task, Setup(collision=detectors))


def cheapest_order(problem):
    """Dynamic program over down-sets of the precedence relation, independent of exact search."""
    n = len(problem.jobs)
    before = [{i for i, j in problem.precedence if j == job} for job in range(n)]
    layer = {(frozenset({j}), j): (problem.first[j], (j,)) for j in range(n) if not before[j]}
    for _ in range(n - 1):
        following = {}
        for (done, last), (cost, order) in layer.items():
            for job in range(n):
                if job not in done and before[job] <= done:
                    key = (done | {job}, job)
                    total = cost + problem.costs[last, job]
                    if key not in following or total < following[key][0]:
                        following[key] = (total, (*order, job))
        layer = following
    return min(layer.values())


@pytest.mark.parametrize("detector", ["precedence", "aabb"])
@pytest.mark.parametrize("config", ["inverter_board", "motor_drive"])
def test_its_best_order_costs_what_exact_search_proves(config, detector):
    """Two methods that share nothing but the model prove the same optimum."""
    model = model_of(config, detector)
    cost, order = cheapest_order(SequencingProblem.from_model(model))
    proved = solve(model.task, "exact", Setup(collision=(detector,)))
    assert proved.cost == pytest.approx(cost, abs=1e-9)
    assert len(order) == len(model.task.operations)


def test_the_plan_of_an_order_costs_what_the_problem_says():
    """Jobs and tool changes, replayed in the model, add up to the order's cost."""
    model = model_of("motor_drive", "precedence")
    problem = SequencingProblem.from_model(model)
    _, order = cheapest_order(problem)
    walked = replay(model, [model.task.skill(name) for name in problem.plan(order)])
    assert walked.complete
    assert walked.cost == pytest.approx(problem.cost(order), abs=1e-9)


def test_exactly_the_orders_that_respect_the_precedence_are_feasible():
    """On the lid task every order of the jobs is replayed."""
    model = make_model(lid_task(), Setup(collision=("aabb",)))
    problem = SequencingProblem.from_model(model)
    for order in itertools.permutations(range(len(problem.jobs))):
        place = {job: position for position, job in enumerate(order)}
        allowed = all(place[i] < place[j] for i, j in problem.precedence)
        walked = replay(model, [model.task.skill(name) for name in problem.plan(order)])
        assert walked.complete == allowed, order


def test_a_stack_is_part_of_the_precedence():
    """The bridge lies on the heat sink at the start and has to go first."""
    problem = SequencingProblem.from_model(model_of("motor_drive", "aabb"))
    pair = (problem.jobs.index("bridge"), problem.jobs.index("heat_sink"))
    assert pair in problem.precedence


def test_a_task_without_any_plan_is_refused_in_words():
    """The message names the elements whose order runs in a circle."""
    model = make_model(shut_box_task(), Setup(collision=("precedence", "aabb")))
    with pytest.raises(NotASequencing, match=r"no order, \w+ before \w+"):
        SequencingProblem.from_model(model)


def test_chance_is_refused_in_words():
    """A skill with two outcomes cannot be one job among others."""
    task = lid_task()
    pick = task.skills[0]
    nothing = task.facts.none
    slippery = replace(
        pick,
        outcomes=(
            Outcome(0.5, pick.prediction.add, pick.prediction.delete),
            Outcome(0.5, nothing, nothing),
        ),
    )
    model = make_model(task.replace(skills=(slippery, *task.skills[1:])))
    with pytest.raises(NotASequencing, match="several outcomes"):
        SequencingProblem.from_model(model)


def test_shapes_that_do_not_fit_are_refused():
    """Every check of the type is tripped."""
    problem = SequencingProblem.from_model(make_model(lid_task()))
    with pytest.raises(ValueError, match="costs"):
        replace(problem, first=np.zeros(1))
    with pytest.raises(ValueError, match="unknown job"):
        replace(problem, precedence=frozenset({(0, 99)}))


@settings(max_examples=150)
@given(
    content=st.one_of(small_assemblies(), crowded_assemblies()),
    detectors=st.sampled_from([("aabb",), ("precedence", "aabb"), ("precedence",)]),
)
def test_it_is_refused_or_exactly_the_orders_it_allows_are_feasible(content, detectors):
    """On random assemblies, every order of the jobs is replayed in the model."""
    task = assembly(content).replace(step_limit=100)
    if not task.chart:
        detectors = ("aabb",)
    model = make_model(task, Setup(collision=detectors))
    try:
        problem = SequencingProblem.from_model(model)
    except NotASequencing:
        event("refused")
        return
    assume(len(problem.jobs) <= 5)
    event("recognised")
    for order in itertools.permutations(range(len(problem.jobs))):
        place = {job: position for position, job in enumerate(order)}
        allowed = all(place[i] < place[j] for i, j in problem.precedence)
        walked = replay(model, [model.task.skill(name) for name in problem.plan(order)])
        assert walked.complete == allowed, order
        if allowed:
            assert walked.cost == pytest.approx(problem.cost(order), abs=1e-9)
