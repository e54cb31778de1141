"""Exact search against references that know no bound."""

import heapq
from typing import ClassVar

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from situations import (
    PatientStop,
    assembly,
    cheapest_by_length,
    config_content,
    fake_back_end,
    make_skill,
    make_task,
    model_of,
    optimum,
    retry_task,
    small_assemblies,
    small_tasks,
    two_roads_task,
)
from skillplan.collision import PrecedenceDetector
from skillplan.model import replay
from skillplan.pipeline import Setup, make_model, solve
from skillplan.solvers import ExactSolver, Stop
from skillplan.task import Facts, Verdict
from skillplan.testing import SolverSuite

CHART = Setup(collision=("precedence",))


class TestExactSolver(SolverSuite):
    solver = "exact"


class TestExactSolverWithoutDives(SolverSuite):
    solver = "exact"
    options: ClassVar = {"dives": False}


def charted(task):
    """Return a model that knows the hand-made chart only."""
    return model_of(task, PrecedenceDetector(task))


def search(model, stop=None, **options):
    return ExactSolver(ExactSolver.Options(**options), stop).solve(model)


def assert_optimal(model, expected, **options):
    """Assert that it proves a (cost, number of skills), or that there is no plan."""
    solution = search(model, **options)
    assert solution.proved
    if expected is None:
        assert solution.plan is None
        return
    walked = replay(model, [model.task.skill(name) for name in solution.plan.skills])
    assert walked.violations == ()
    assert solution.plan.cost == pytest.approx(walked.cost, abs=1e-9)
    assert solution.lower_bound == pytest.approx(walked.cost, abs=1e-9)
    assert (pytest.approx(expected[0], abs=1e-9), expected[1]) == (walked.cost, len(solution.plan))


@settings(max_examples=examples(150))
@given(content=small_assemblies(), dives=st.booleans())
def test_it_agrees_with_a_dynamic_program_on_random_assemblies(content, dives):
    """Least cost within the step limit and, of equals, the fewest skills; or that there is none."""
    task = assembly(content)
    assert_optimal(charted(task), optimum(cheapest_by_length(charted(task))), dives=dives)


@settings(max_examples=examples(400))
@given(task=small_tasks(), dives=st.booleans())
def test_it_agrees_with_a_dynamic_program_on_random_tasks(task, dives):
    """Of no structure at all: dead ends, detours, several makers of a fact, free skills."""
    assert_optimal(model_of(task), optimum(cheapest_by_length(model_of(task))), dives=dives)


@settings(max_examples=examples(40))
@given(content=small_assemblies())
def test_it_respects_every_step_limit(content):
    """From too few skills for any plan up to more than enough."""
    task = assembly(content)
    minimum = 2 * len(content["parts"]) + len(content["screws"])
    by_length = cheapest_by_length(charted(task.replace(step_limit=minimum + 8)))
    for limit in range(max(1, minimum - 1), minimum + 9):
        short = {length: cost for length, cost in by_length.items() if length <= limit}
        assert_optimal(charted(task.replace(step_limit=limit)), optimum(short))


@pytest.mark.parametrize("situation", ["lid_task", "board_task"])
@pytest.mark.parametrize("detector", ["precedence", "aabb"])
def test_it_agrees_with_a_dynamic_program_on(situation, detector, request):
    """The lid and the board, under the chart and under geometry."""
    task = request.getfixturevalue(situation)

    def model():
        return make_model(task, Setup(collision=(detector,)))

    assert_optimal(model(), optimum(cheapest_by_length(model())))


def test_the_board_has_the_optimum_that_was_computed_independently(board_task):
    """1.86709 m, by the sequence of the paper's figure, proved and granted."""
    result = solve(board_task, "exact", CHART)
    assert result.status == "optimal"
    assert round(result.cost, 5) == 1.86709
    assert [s.action for s in result.steps] == [0, 1, 2, 3, 4, 5, 8, 9, 10, 11, 6, 7, 13, 14, 15]
    assert result.gap == 0.0


@pytest.mark.slow(reason="walks the board; compare of both solvers in every run")
def test_it_expands_a_fiftieth_of_what_brute_force_visits(board_task):
    """On the board."""
    exact, brute = (solve(board_task, name, CHART) for name in ("exact", "exhaustive"))
    assert exact.expanded * 50 <= brute.expanded
    assert exact.checks <= brute.checks


def uniform_cost(task):
    """Return the least cost of a plan, and its skills, by Dijkstra's algorithm on plain bits.

    Knows skills and the chart, and nothing else of the product.
    """
    bit = {element: task.facts.bit(fact) for element, fact in task.operations.items()}
    skills = []
    for skill in task.skills:
        added = skill.prediction.add.bits
        element = next((e for e, b in bit.items() if b & added), None)
        skills.append(
            (
                skill.precondition.requires.bits
                | sum({bit[line.before] for line in task.chart if line.after == element}),
                skill.precondition.forbids.bits
                | sum({bit[line.after] for line in task.chart if line.before == element}),
                added,
                skill.prediction.delete.bits,
                skill.cost.at,
            )
        )
    goal, state = task.goal.requires.bits, task.initial.facts.state
    queue, done = [(0.0, 0, task.initial.bits)], set()
    while queue:
        cost, steps, bits = heapq.heappop(queue)
        if bits in done:
            continue
        if bits & goal == goal:
            return cost, steps
        done.add(bits)
        here = state(bits)
        for requires, forbids, add, delete, cost_at in skills:
            if bits & requires == requires and not bits & forbids:
                following = bits & ~delete | add
                if following not in done:
                    heapq.heappush(queue, (cost + cost_at(here), steps + 1, following))
    return None


@pytest.mark.slow(reason="searches twelve parts; the board in every run")
def test_it_agrees_with_uniform_cost_search_on_the_motor_drive(motor_drive_task):
    """Twelve parts, five screws and three tools."""
    cost, steps = uniform_cost(motor_drive_task)
    result = solve(motor_drive_task, "exact", CHART)
    assert result.status == "optimal"
    assert result.cost == pytest.approx(cost, abs=1e-9)
    assert len(result.steps) == steps <= motor_drive_task.step_limit
    assert sum(step.skill.startswith("load(") for step in result.steps) == 6


@pytest.mark.parametrize(("limit", "expected"), [(1, None), (2, (4.0, 2)), (3, (3.0, 3))])
def test_a_cheap_plan_that_is_too_long_gives_way_to_a_shorter_one(limit, expected):
    """And where even that is too long it is proved that there is none."""
    assert_optimal(model_of(two_roads_task(step_limit=limit)), expected)


def test_a_cheap_way_to_a_state_does_not_hide_a_short_one():
    """Where the way beyond is longer than the bound can tell."""
    facts = Facts(("a", "b", "left", "right", "done"))
    skills = [
        make_skill(facts, "to_a", forbids=("a", "b"), add=("a",), cost=1.0),
        make_skill(facts, "a_to_b", requires=("a",), add=("b",), delete=("a",), cost=1.0),
        make_skill(facts, "to_b", forbids=("a", "b"), add=("b",), cost=3.0),
    ]
    for side in ("left", "right"):
        skills.append(make_skill(facts, f"go_{side}", requires=("b",), add=(side,)))
        skills.append(make_skill(facts, f"end_{side}", requires=(side,), add=("done",)))
    task = make_task(facts, skills, goal=("done",), step_limit=3)
    for dives in (True, False):
        assert_optimal(model_of(task), (5.0, 3), dives=dives)


def test_extra_tool_changes_that_cost_nothing_are_not_made():
    """All tools hang where the arm stands: only the number of skills tells plans apart."""
    content = config_content("inverter_board")
    here = content["parts"]["pcb"]["goal_m"]
    for entry in content["tools"].values():
        entry["holder_m"] = list(here)
    content["robot"]["home_m"] = list(here)
    content["tool_change"] = {"style": "swap", "reload": True}
    for part in content["parts"].values():
        part["start_m"], part["goal_m"] = list(here), list(here)
    for screw in content["screws"].values():
        screw["hole_m"] = list(here)
    task = assembly(content)
    solution = search(charted(task))
    assert solution.proved
    assert (solution.plan.cost, len(solution.plan)) == (0.0, 15)


def test_of_equal_costs_it_takes_the_fewest_skills():
    """One expensive skill rather than two that cost the same together."""
    facts = Facts(("half", "done"))
    skills = [
        make_skill(facts, "first", forbids=("half",), add=("half",), cost=0.1),
        make_skill(facts, "second", requires=("half",), add=("done",), cost=0.2),
        # 0.1 + 0.2 exceeds 0.3 as a sum of binary fractions.
        make_skill(facts, "at_once", forbids=("half",), add=("done",), cost=0.3),
    ]
    solution = search(model_of(make_task(facts, skills, goal=("done",))))
    assert solution.plan.skills == ("at_once",)


def test_it_proves_that_there_is_no_plan(shut_box_task):
    """The referee grants it."""
    result = solve(shut_box_task, "exact", Setup(collision=("precedence", "aabb")))
    assert (result.status, result.cost) == ("infeasible", None)


def test_a_task_that_is_done_needs_nothing(board_task):
    """An empty plan at no cost, proved."""
    done = board_task.replace(initial=board_task.initial | board_task.goal.requires)
    solution = search(charted(done))
    assert (solution.plan.skills, solution.plan.cost, solution.proved) == ((), 0.0, True)


@pytest.mark.parametrize("polls", [1, 2, 5, 20, 60, 150, 1_000_000])
@pytest.mark.parametrize("dives", [True, False])
def test_it_can_be_stopped_at_any_time(board_task, polls, dives):
    """What it hands over is a valid plan or none, and a bound that holds."""
    best = 1.8670860141568904
    stop = PatientStop(polls)
    solution = search(charted(board_task), stop, dives=dives)
    if solution.plan is not None:
        walked = replay(charted(board_task), [board_task.skill(n) for n in solution.plan.skills])
        assert walked.complete
        assert best <= walked.cost + 1e-9
        assert solution.lower_bound <= walked.cost + 1e-9
    assert solution.lower_bound <= best + 1e-9
    assert solution.proved == (polls == 1_000_000)
    assert (solution.trace["ended"] == "proof") == solution.proved


@settings(max_examples=examples(40))
@given(content=small_assemblies(), polls=st.integers(1, 60))
def test_what_a_stopped_search_claims_holds(content, polls):
    """On random assemblies with step limits that bind: bound <= optimum <= cost."""
    task = assembly(content)
    best = optimum(cheapest_by_length(charted(task)))
    solution = search(charted(task), PatientStop(polls))
    if solution.lower_bound is not None and best is not None:
        assert solution.lower_bound <= best[0] + 1e-9
    if solution.plan is not None:
        walked = replay(charted(task), [task.skill(name) for name in solution.plan.skills])
        assert walked.violations == ()
        assert best[0] <= walked.cost + 1e-9
    if solution.proved:
        assert (solution.plan is None) == (best is None)


def test_the_gap_of_a_stopped_search_is_granted_by_the_referee(motor_drive_task):
    """Between the best plan so far and the bound so far."""
    result = solve(motor_drive_task, "exact", CHART, stop=PatientStop(500))
    assert (result.status, result.interrupted) == ("solved", True)
    assert 0 < result.gap < 1
    assert result.lower_bound <= 11.58291 <= result.cost
    assert result.gap == pytest.approx(1 - result.lower_bound / result.cost)


@pytest.mark.slow(reason="searches twelve parts; auto stops at a gap in every run")
def test_it_stops_once_the_gap_is_small_enough(motor_drive_task):
    """At the price of the proof."""
    result = solve(motor_drive_task, "exact", CHART, stop=Stop(gap=0.2))
    assert result.status == "solved"
    assert result.gap <= 0.2
    assert "gap reached" in result.reason


def test_a_limit_on_labels_ends_the_search_with_a_bound(motor_drive_task):
    """And with the best plan of its dives."""
    solution = search(charted(motor_drive_task), max_labels=300)
    assert not solution.proved
    assert solution.trace["ended"] == "limit of 300 labels"
    assert 0 < solution.lower_bound <= 11.58291
    assert solution.plan.cost >= 11.58291


def test_dives_find_a_plan_long_before_the_proof(motor_drive_task):
    """Without them there is none until the end."""
    for dives in (True, False):
        stop = PatientStop(200)
        solution = search(charted(motor_drive_task), stop, dives=dives)
        assert not solution.proved
        if dives:
            plan = [motor_drive_task.skill(name) for name in solution.plan.skills]
            assert replay(charted(motor_drive_task), plan).complete
        else:
            assert solution.plan is None


def test_a_plan_is_found_though_all_near_parts_bar_far_ones_for_good():
    """Dives place the near part of each of eight pairs first, and end before the far ones."""
    task = assembly(paired_parts(8))

    def answer(skill, state):
        if skill.name.startswith("place(far_"):
            near = skill.name.replace("place(far", "placed(near")
            if near in state:
                return Verdict.infeasible("barred", task.facts.of(near), task.facts.none)
        return Verdict.feasible(task.facts.none, task.facts.none)

    model = model_of(task, fake_back_end(task, answer))
    plan = search(model, max_labels=6_000).plan
    assert plan is not None
    assert replay(model, [task.skill(name) for name in plan.skills]).complete


def paired_parts(count):
    """Return the content of an assembly of near and far parts."""
    rows = {"near": 0.3, "far": 0.6}
    part = {"tool": "hand", "size_m": [0.02, 0.02, 0.02]}
    parts = {
        f"{row}_{i}": {**part, "start_m": [x_m, 0.03 * i], "goal_m": [x_m, -0.05 - 0.03 * i]}
        for i in range(count)
        for row, x_m in rows.items()
    }
    return {
        "kind": "assembly",
        "name": "pairs",
        "robot": {"home_m": [0.3, 0.0]},
        "tools": {"hand": {"holder_m": [0.3, 0.0]}},
        "initial_tool": "hand",
        "parts": parts,
    }


def test_it_asks_only_about_arrows_that_come_up(board_task):
    """Far fewer questions than there are applicable skills in the states it generates."""
    counting = fake_back_end(board_task, Verdict.feasible())
    model = model_of(board_task, PrecedenceDetector(board_task), counting)
    solution = search(model, dives=False)
    assert solution.proved
    assert len(counting.asked) < solution.trace["generated"]


def test_it_refuses_tasks_with_chance_in_words():
    """It looks for one sequence."""
    model = model_of(retry_task(0.5))
    assert "needs skills with one outcome each" in ExactSolver().refuses(model)
    assert solve(retry_task(0.5), "exact").status == "refused"


def test_it_leaves_out_what_is_unknown():
    """A plan around it is valid, though nothing is proved."""
    task = two_roads_task()

    def answer(skill, state):
        return Verdict.unknown("too slow") if skill.name == "to_a" else Verdict.feasible()

    model = model_of(task, fake_back_end(task, answer))
    assert search(model).plan.skills == ("to_b", "finish")
    assert model.stats.unknown > 0
