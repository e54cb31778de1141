"""The rule that consecutive goals share a docking pin, and where it fails."""

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from situations import make_skill, make_task, retry_task
from skillplan.pipeline import make_model, solve
from skillplan.solvers import CspSolver, Stop
from skillplan.task import Case, Condition, ConstantCost, Facts, Outcome, Skill

pins = st.frozensets(st.sampled_from("abcdef"), max_size=3)
layers_of = st.lists(
    st.lists(st.tuples(pins, st.integers(0, 5)), min_size=1, max_size=4), min_size=1, max_size=5
)


def layered_task(layers, step_limit=None):
    """Return a task of choosing one of every layer, each with what it occupies and its cost."""
    facts = Facts(("start", *(f"done({i})" for i in range(len(layers)))))
    skills = []
    for i, layer in enumerate(layers):
        here = facts.of("start" if i == 0 else f"done({i - 1})")
        outcome = Outcome(1.0, facts.of(f"done({i})"), here)
        for k, (occupied, cost) in enumerate(layer):
            skills.append(
                Skill(
                    name=f"choose({i}:{k})",
                    kind="choose",
                    agents=("base",),
                    precondition=Condition(facts.none, facts.none),
                    outcomes=(),
                    cost=ConstantCost(float(cost)),
                    duration_s=ConstantCost(1.0),
                    cases=(Case(here, (outcome,), facts.none, frozenset(occupied)),),
                )
            )
    return make_task(
        facts,
        skills,
        initial=("start",),
        goal=(f"done({len(layers) - 1})",),
        step_limit=step_limit or len(layers),
    )


def allowed(choices):
    """Whether all consecutive choices that occupy anything share something."""
    occupied = [held for held, _ in choices if held]
    return all(first & other for first, other in itertools.pairwise(occupied))


@settings(max_examples=examples(200))
@given(layers_of)
def test_a_sequence_is_found_exactly_where_one_keeps_the_rule(layers):
    task = layered_task(layers)
    model = make_model(task)
    solver = CspSolver()
    if solver.refuses(model) is not None:
        assert not any(held for layer in layers for held, _ in layer)
        return
    solution = solver.solve(model)
    possible = any(allowed(choices) for choices in itertools.product(*layers))
    assert (solution.plan is not None) == possible
    assert not solution.proved
    assert solution.lower_bound is None
    if solution.plan is None:
        assert solution.trace["failed_at"] in {skill.name for skill in task.skills}
        assert solution.trace["failed_at"] in solution.trace["reason"]
        return
    keys = [name[7:-1].split(":") for name in solution.plan.skills]
    choices = [layers[int(i)][int(k)] for i, k in keys]
    assert allowed(choices)
    assert solution.plan.cost == pytest.approx(sum(cost for _, cost in choices))


def test_where_it_fails_the_result_says_between_which_choices():
    task = layered_task([[("a", 0)], [("ab", 0), ("a", 1)], [("cd", 0), ("d", 0)]])
    result = solve(task, CspSolver())
    assert result.status == "unsolved"
    assert result.reason is not None
    assert "choose(1:0) occupies is shared by choose(2:0), choose(2:1)" in result.reason
    assert solve(task, "exact").status == "optimal"


def test_of_many_choices_in_conflict_a_few_are_named():
    task = layered_task([[("a", 0)], [("b", cost) for cost in range(6)]])
    result = solve(task, CspSolver())
    assert "choose(1:3) and 2 more" in (result.reason or "")


def test_a_choice_that_leads_nowhere_is_taken_back():
    cheap_trap = [("ab", 0), ("ac", 5)]
    task = layered_task([[("a", 0)], cheap_trap, [("b", 0), ("c", 0)], [("c", 0)]])
    result = solve(task, CspSolver())
    assert result.status == "solved"
    assert [step.skill for step in result.steps][1] == "choose(1:1)"
    assert result.trace["backtracks"] == 1


def test_the_cheapest_choice_is_tried_first():
    task = layered_task([[("a", 3), ("a", 1)], [("a", 2), ("a", 0)]])
    result = solve(task, CspSolver())
    assert [step.skill for step in result.steps] == ["choose(0:1)", "choose(1:1)"]
    assert result.trace["backtracks"] == 0


def test_many_ways_to_the_same_failure_are_walked_once():
    layers = [[("a", 0)] * 6 for _ in range(30)]
    task = layered_task([*layers, [("b", 0)]])
    solution = CspSolver().solve(make_model(task))
    assert solution.plan is None
    assert solution.trace["visited"] <= 6 * 30


def test_the_step_limit_is_kept():
    task = layered_task([[("a", 0)], [("a", 0)], [("a", 0)]], step_limit=2)
    result = solve(task, CspSolver())
    assert result.status == "unsolved"
    assert "step limit" in (result.reason or "")


def test_a_task_that_is_done_needs_no_choice():
    task = layered_task([[("a", 0)]])
    result = solve(task.replace(initial=task.facts.of("done(0)")), CspSolver())
    assert result.steps == ()
    assert result.status in ("solved", "optimal")


def test_where_nothing_can_be_done_it_says_so():
    task = layered_task([[("a", 0)], [("a", 0)]])
    result = solve(task.replace(initial=task.facts.none), CspSolver())
    assert result.status == "unsolved"
    assert "nothing is feasible at the start" in (result.reason or "")


def test_it_stops_when_told():
    task = layered_task([[("a", 0)], [("a", 0)]])
    stop = Stop()
    stop.interrupt()
    result = solve(task, CspSolver(), stop=stop)
    assert (result.status, result.reason) == ("unsolved", "interrupted: no plan was found")


def test_a_task_in_which_nothing_is_occupied_is_refused():
    facts = Facts(("done",))
    task = make_task(facts, [make_skill(facts, "finish", add=("done",))], goal=("done",))
    result = solve(task, CspSolver())
    assert result.status == "refused"
    assert "no skill of this task occupies anything" in (result.reason or "")


def test_chance_is_refused():
    result = solve(retry_task(0.5), CspSolver())
    assert result.status == "refused"
    assert "certain outcomes" in (result.reason or "")


def test_of_a_chain_it_searches_the_goals_only():
    assert CspSolver.stage == "goals"
