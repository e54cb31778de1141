"""Orders that have a choice: a part that may be placed while one of its directions is free."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from situations import cheapest_by_length, model_of, optimum
from skillplan.chart import derive_chart, simplify_conditions
from skillplan.checks import Feasibility
from skillplan.errors import NotASequencing
from skillplan.model import SequencingProblem
from skillplan.records import make_chart_document
from skillplan.solvers import AutoSolver, ExactSolver
from skillplan.views.tables import tabulate_chart
from way_boards import CLOSED, closing, drawer_task

ALONG = ("place(drawer) along +x", "place(drawer) along -x")


def chart_of(closed=CLOSED, **changes):
    """Return what is derived of the drawer."""
    task = drawer_task(**changes)
    return derive_chart(Feasibility(task, [closing(task, closed)]))


def test_a_part_with_two_directions_may_be_placed_while_one_is_free():
    """Neither stop has to come after it, but one of them."""
    chart = chart_of()
    assert chart.relations == ()
    (choice,) = chart.alternatives
    assert (choice.component, choice.skill) == ("drawer", "place(drawer)")
    assert choice.any_of == ((("drawer", "left"),), (("drawer", "right"),))
    assert str(choice) == "drawer before left, or drawer before right"


def test_the_chart_prints_the_alternatives():
    """In the table and in the document."""
    task = drawer_task()
    chart = chart_of()
    table = tabulate_chart(chart, task, ["closing"])
    expected = "place(drawer) leaves a choice: drawer before left, or drawer before right"
    assert expected in table.notes
    assert not any("which no order of parts" in note for note in table.notes)
    (choice,) = make_chart_document(chart, task, ["closing"])["alternatives"]
    assert choice["any_of"] == [
        [{"before": "drawer", "after": "left"}],
        [{"before": "drawer", "after": "right"}],
    ]


def test_a_choice_of_several_skills_is_told_once():
    """A pick that is only done where the place after it can be has the same choice."""
    grasps = [{"closing_axis": "y"}, {"closing_axis": "x"}]
    task = drawer_task(grasp=grasps)
    closed = {
        f"{name}, grasp top closing along {axis}": facts
        for name, facts in CLOSED.items()
        for axis in "xy"
    }
    chart = derive_chart(Feasibility(task, [closing(task, closed)]))
    assert [alternative.skill for alternative in chart.alternatives] == [
        "pick(drawer)",
        "place(drawer)",
    ]
    expected = (
        "pick(drawer) and place(drawer) leave a choice: drawer before left, or drawer before right"
    )
    assert expected in tabulate_chart(chart, task, ["closing"]).notes


def test_what_closes_both_directions_is_a_relation():
    """No choice is left; and where a stop closes one only, there is nothing to be ordered."""
    chart = chart_of(dict.fromkeys(ALONG, ("placed(left)",)))
    assert [(relation.before, relation.after) for relation in chart.relations] == [
        ("drawer", "left")
    ]
    assert chart.alternatives == ()
    assert chart_of({ALONG[0]: ("placed(left)",)}).alternatives == ()


def test_a_relation_beside_a_choice_is_told_once():
    """What all alternatives have in common is no alternative."""
    closed = {name: (*facts, "placed(left)") for name, facts in CLOSED.items()}
    assert [(r.before, r.after) for r in chart_of(closed).relations] == [("drawer", "left")]
    assert chart_of(closed).alternatives == ()


def test_order_solvers_refuse_in_words_and_exact_search_proves():
    """An order of jobs cannot say it; search finds the cheapest of both."""
    task = drawer_task()
    with pytest.raises(
        NotASequencing, match=r"place\(drawer\) depends on more than the order of parts"
    ):
        SequencingProblem.from_model(model_of(task, closing(task)))
    solution = AutoSolver().solve(model_of(task, closing(task)))
    assert solution.proved
    best = optimum(cheapest_by_length(model_of(task, closing(task))))
    assert solution.plan.cost == pytest.approx(best[0])


@given(seed=st.integers(0, 2**32))
@settings(max_examples=examples(40), deadline=None)
def test_exact_search_agrees_with_brute_force_whatever_closes_what(seed):
    """Disjunctions, conjunctions, cycles: proved, with the cost of the enumeration."""
    rng = random.Random(seed)
    task = drawer_task()
    parts = list(task.operations)
    queries = [*ALONG, "place(left)", "place(right)", "pick(drawer)"]
    closed = {
        name: tuple(f"placed({other})" for other in parts if rng.random() < 0.3) for name in queries
    }
    model = model_of(task, closing(task, closed))
    solution = ExactSolver().solve(model)
    assert solution.proved
    best = optimum(cheapest_by_length(model_of(task, closing(task, closed))))
    if solution.plan is None:
        assert best is None
    else:
        assert solution.plan.cost == pytest.approx(best[0])


@given(seed=st.integers(0, 2**32))
@settings(max_examples=examples(60), deadline=None)
def test_orders_that_can_be_carried_out_are_those_that_chart_and_choices_allow(seed):
    """Where nothing but the order matters, relations and alternatives together are the truth."""
    rng = random.Random(seed)
    task = drawer_task()
    others = ["left", "right"]
    closed = {
        name: tuple(f"placed({other})" for other in others if rng.random() < 0.6) for name in ALONG
    }
    chart = derive_chart(Feasibility(task, [closing(task, closed)]))
    for order in ([0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]):
        parts = ["drawer", *others]
        names = [parts[index] for index in order]
        done = set(names[: names.index("drawer")])
        possible = any(not done & {fact[7:-1] for fact in facts} for facts in closed.values())

        def holds(pair, names=names):
            return names.index(pair[0]) < names.index(pair[1])

        allowed = all(holds((relation.before, relation.after)) for relation in chart.relations)
        allowed &= all(
            any(all(holds(pair) for pair in group) for group in choice.any_of)
            for choice in chart.alternatives
        )
        assert possible == allowed


def test_conditions_are_made_as_weak_as_they_can_be():
    """A choice that was found by cases is told without them."""
    cases = [frozenset({("left", False)}), frozenset({("left", True), ("right", False)})]
    assert set(simplify_conditions(cases)) == {
        frozenset({("left", False)}),
        frozenset({("right", False)}),
    }
