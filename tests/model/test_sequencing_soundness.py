"""The best order of the jobs is the best plan of the model, or the model is refused."""

import pytest
from hypothesis import assume, event, given, settings
from hypothesis import strategies as st

from example_count import examples
from sequencing_cases import changed_board, cheapest_order, sound, strict_back_end
from situations import FakeSetup, assembly, crowded_assemblies, small_assemblies
from skillplan.errors import NotASequencing
from skillplan.model import SequencingProblem, replay
from skillplan.pipeline import Setup, make_model, solve
from skillplan.records import Status


def check_against_exact_search(task, setup):
    """Compare the best order with what exact search proves, and replay its plan."""
    model = make_model(task, setup)
    try:
        problem = SequencingProblem.from_model(model)
    except NotASequencing as error:
        event("refused: " + str(error).partition("problem: ")[2][:60])
        return
    proved = solve(task, "exact", setup)
    best = cheapest_order(problem)
    event(f"recognised, {proved.status}")
    if best is None:
        assert proved.status is Status.INFEASIBLE
        return
    cost, order = best
    if not problem.fits(order):
        # The bound holds all the same.
        assert proved.cost is None or proved.cost >= cost - 1e-9
        return
    assert proved.status is Status.OPTIMAL
    assert proved.cost == pytest.approx(cost, abs=1e-6)
    plan = problem.plan(order)
    walked = replay(model, [task.skill(name) for name in plan])
    assert walked.complete
    assert walked.cost == pytest.approx(problem.cost(order), abs=1e-9)
    assert problem.order(plan) == order
    assert problem.order([step.skill for step in proved.steps]) is not None


@settings(max_examples=examples(100))
@given(
    content=st.one_of(small_assemblies(), crowded_assemblies(odd_turns=False)),
    detectors=st.sampled_from([("aabb",), ("precedence", "aabb"), ("precedence",)]),
)
def test_the_best_order_of_a_board_is_its_best_plan(content, detectors):
    """Boards with feeders, stacks, any tool change, collisions and tight step limits."""
    assume(len(content["parts"]) + len(content["screws"]) <= 5)
    task = assembly(content)
    check_against_exact_search(task, Setup(collision=detectors if task.chart else ("aabb",)))


@settings(max_examples=examples(200))
@given(content=small_assemblies(), seed=st.integers(0, 2**32), changes=st.integers(1, 3))
def test_what_is_almost_a_board_is_refused_or_its_best_order_is_its_best_plan(
    content, seed, changes
):
    """Skills that undo, repeat or stand in for others, odd costs, elements left out of the goal."""
    task = changed_board(content, seed, changes)
    assume(sound(task))
    check_against_exact_search(task, FakeSetup(make=lambda task: []))


@settings(max_examples=examples(200))
@given(content=small_assemblies(), seed=st.integers(0, 2**32), changes=st.integers(0, 1))
def test_whatever_back_ends_rule_the_best_order_is_the_best_plan(content, seed, changes):
    """Verdicts that rest on any facts, also on such as no order decides about."""
    task = changed_board(content, seed, changes)
    assume(sound(task))
    check_against_exact_search(task, FakeSetup(make=lambda task: [strict_back_end(task, seed)]))
