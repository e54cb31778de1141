"""Exact search against references that know no bound."""

import heapq
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import situations
from example_count import examples
from skillplan.collision import PrecedenceDetector
from skillplan.errors import OptionError
from skillplan.model import replay
from skillplan.pipeline import Setup, make_model, solve
from skillplan.records import Status
from skillplan.solvers import (
    COST_UNIT,
    Conditions,
    ExactSolver,
    LandmarkBound,
    Plan,
    Policy,
    Solution,
    Solver,
    Stop,
    Words,
    convert_from_units,
    convert_to_units,
)
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
    return situations.model_of(task, PrecedenceDetector(task))


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
@given(content=situations.small_assemblies(), dives=st.booleans())
def test_it_agrees_with_a_dynamic_program_on_random_assemblies(content, dives):
    """Least cost within the step limit and, of equals, the fewest skills; or that there is none."""
    task = situations.assembly(content)
    assert_optimal(
        charted(task), situations.optimum(situations.cheapest_by_length(charted(task))), dives=dives
    )


@settings(max_examples=examples(400))
@given(task=situations.small_tasks(), dives=st.booleans())
def test_it_agrees_with_a_dynamic_program_on_random_tasks(task, dives):
    """Of no structure at all: dead ends, detours, several makers of a fact, free skills."""
    assert_optimal(
        situations.model_of(task),
        situations.optimum(situations.cheapest_by_length(situations.model_of(task))),
        dives=dives,
    )


@settings(max_examples=examples(40))
@given(content=situations.small_assemblies())
def test_it_respects_every_step_limit(content):
    """From too few skills for any plan up to more than enough."""
    task = situations.assembly(content)
    minimum = 2 * len(content["parts"]) + len(content["screws"])
    by_length = situations.cheapest_by_length(charted(task.replace(step_limit=minimum + 8)))
    for limit in range(max(1, minimum - 1), minimum + 9):
        short = {length: cost for length, cost in by_length.items() if length <= limit}
        assert_optimal(charted(task.replace(step_limit=limit)), situations.optimum(short))


@pytest.mark.parametrize("situation", ["lid_task", "board_task"])
@pytest.mark.parametrize("detector", ["precedence", "aabb"])
def test_it_agrees_with_a_dynamic_program_on(situation, detector, request):
    """The lid and the board, under the chart and under geometry."""
    task = request.getfixturevalue(situation)

    def model():
        return make_model(task, Setup(collision=(detector,)))

    assert_optimal(model(), situations.optimum(situations.cheapest_by_length(model())))


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
    assert_optimal(situations.model_of(situations.two_roads_task(step_limit=limit)), expected)


def test_a_cheap_way_to_a_state_does_not_hide_a_short_one():
    """Where the way beyond is longer than the bound can tell."""
    facts = Facts(("a", "b", "left", "right", "done"))
    skills = [
        situations.make_skill(facts, "to_a", forbids=("a", "b"), add=("a",), cost=1.0),
        situations.make_skill(
            facts, "a_to_b", requires=("a",), add=("b",), delete=("a",), cost=1.0
        ),
        situations.make_skill(facts, "to_b", forbids=("a", "b"), add=("b",), cost=3.0),
    ]
    for side in ("left", "right"):
        skills.append(situations.make_skill(facts, f"go_{side}", requires=("b",), add=(side,)))
        skills.append(situations.make_skill(facts, f"end_{side}", requires=(side,), add=("done",)))
    task = situations.make_task(facts, skills, goal=("done",), step_limit=3)
    for dives in (True, False):
        assert_optimal(situations.model_of(task), (5.0, 3), dives=dives)


def test_extra_tool_changes_that_cost_nothing_are_not_made():
    """All tools hang where the arm stands: only the number of skills tells plans apart."""
    content = situations.config_content("inverter_board")
    here = content["parts"]["pcb"]["goal_m"]
    for entry in content["tools"].values():
        entry["holder_m"] = list(here)
    content["robot"]["home_m"] = list(here)
    content["tool_change"] = {"style": "swap", "reload": True}
    for part in content["parts"].values():
        part["start_m"], part["goal_m"] = list(here), list(here)
    for screw in content["screws"].values():
        screw["hole_m"] = list(here)
    task = situations.assembly(content)
    solution = search(charted(task))
    assert solution.proved
    assert (solution.plan.cost, len(solution.plan)) == (0.0, 15)


def test_of_equal_costs_it_takes_the_fewest_skills():
    """One expensive skill rather than two that cost the same together."""
    facts = Facts(("half", "done"))
    skills = [
        situations.make_skill(facts, "first", forbids=("half",), add=("half",), cost=0.1),
        situations.make_skill(facts, "second", requires=("half",), add=("done",), cost=0.2),
        # 0.1 + 0.2 exceeds 0.3 as a sum of binary fractions.
        situations.make_skill(facts, "at_once", forbids=("half",), add=("done",), cost=0.3),
    ]
    solution = search(situations.model_of(situations.make_task(facts, skills, goal=("done",))))
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
    stop = situations.PatientStop(polls)
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
@given(content=situations.small_assemblies(), polls=st.integers(1, 60))
def test_what_a_stopped_search_claims_holds(content, polls):
    """On random assemblies with step limits that bind: bound <= optimum <= cost."""
    task = situations.assembly(content)
    best = situations.optimum(situations.cheapest_by_length(charted(task)))
    solution = search(charted(task), situations.PatientStop(polls))
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
    result = solve(motor_drive_task, "exact", CHART, stop=situations.PatientStop(500))
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
        stop = situations.PatientStop(200)
        solution = search(charted(motor_drive_task), stop, dives=dives)
        assert not solution.proved
        if dives:
            plan = [motor_drive_task.skill(name) for name in solution.plan.skills]
            assert replay(charted(motor_drive_task), plan).complete
        else:
            assert solution.plan is None


def test_a_plan_is_found_though_all_near_parts_bar_far_ones_for_good():
    """Dives place the near part of each of eight pairs first, and end before the far ones."""
    task = situations.assembly(paired_parts(8))

    def answer(skill, state):
        if skill.name.startswith("place(far_"):
            near = skill.name.replace("place(far", "placed(near")
            if near in state:
                return Verdict.infeasible("barred", task.facts.of(near), task.facts.none)
        return Verdict.feasible(task.facts.none, task.facts.none)

    model = situations.model_of(task, situations.fake_back_end(task, answer))
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
    counting = situations.fake_back_end(board_task, Verdict.feasible())
    model = situations.model_of(board_task, PrecedenceDetector(board_task), counting)
    solution = search(model, dives=False)
    assert solution.proved
    assert len(counting.asked) < solution.trace["generated"]


def test_it_refuses_tasks_with_chance_in_words():
    """It looks for one sequence."""
    model = situations.model_of(situations.retry_task(0.5))
    assert "needs skills with one outcome each" in ExactSolver().refuses(model)
    assert solve(situations.retry_task(0.5), "exact").status == "refused"


def test_it_leaves_out_what_is_unknown():
    """A plan around it is valid, though nothing is proved."""
    task = situations.two_roads_task()

    def answer(skill, state):
        return Verdict.unknown("too slow") if skill.name == "to_a" else Verdict.feasible()

    model = situations.model_of(task, situations.fake_back_end(task, answer))
    assert search(model).plan.skills == ("to_b", "finish")
    assert model.stats.unknown > 0


# What actions ask for, learned as conjunctions of literals.


BITS = 12
ASKED = st.sets(st.integers(0, 2 * BITS - 1), max_size=4)
OBSERVATIONS = st.lists(st.integers(0, 2**BITS - 1), min_size=1, max_size=40)


def literals(bits: int) -> Words:
    """Return what holds: bits that are set, and in a second word those that are not."""
    return np.array([bits, ~bits & (2**64 - 1)], dtype=np.uint64)


def holds(queries: set[int], bits: int) -> bool:
    """Whether all literals asked for hold."""
    return all(
        bool(bits >> query & 1) if query < BITS else not bits >> query - BITS & 1
        for query in queries
    )


def learned(queries: set[int], observations: list[int]) -> Conditions:
    """Return what is known of an action that was tried where all this was observed."""
    known = Conditions(1, 2)
    for bits in observations:
        if holds(queries, bits):
            known.succeed(np.array([0]), literals(bits))
        else:
            known.fail(0, literals(bits))
    return known


@given(asked=ASKED, observations=OBSERVATIONS, other=st.integers(0, 2**BITS - 1))
def test_an_action_that_is_refuted_fails(asked, observations, other):
    """Whatever was seen: where the action is known to fail, what it asks for does not hold."""
    if learned(asked, observations).refutes(0, literals(other)):
        assert not holds(asked, other)


@given(asked=ASKED, observations=OBSERVATIONS, other=st.integers(0, 2**BITS - 1))
def test_an_action_that_is_sure_succeeds(asked, observations, other):
    """Where all holds that held at every success, what it asks for does, too."""
    known = learned(asked, observations)
    if known.succeeded[0] and not (known.compile().sure[0] & ~literals(other)).any():
        assert holds(asked, other)


@given(asked=ASKED, observations=OBSERVATIONS)
def test_what_was_seen_to_fail_is_refuted(asked, observations):
    known = learned(asked, observations)
    for bits in observations:
        assert known.refutes(0, literals(bits)) != holds(asked, bits)


def test_without_a_conjunction_only_what_was_seen_to_fail_is_refuted():
    """An action that succeeds with either of two bits, and fails without both."""
    known = Conditions(1, 2)
    known.succeed(np.array([0]), literals(0b01))
    known.succeed(np.array([0]), literals(0b10))
    known.fail(0, literals(0b00))
    assert known.refutes(0, literals(0b00))
    assert not known.refutes(0, literals(0b100))


def test_the_failure_of_one_literal_names_it():
    known = Conditions(1, 2)
    known.succeed(np.array([0]), literals(0b011))
    known.fail(0, literals(0b010))
    assert known.needed[0].tolist() == [0b001, 0]


def test_it_goes_on_from_what_was_kept():
    known = learned({0, 3, BITS + 5}, [0b1001, 0b1000, 0b101001, 0b1, 0b11])
    twin = Conditions(1, 2)
    twin.read("one", known.arrays("one"))
    for bits in range(64):
        assert known.refutes(0, literals(bits)) == twin.refutes(0, literals(bits))


def test_arrays_of_another_shape_are_refused():
    with pytest.raises(ValueError, match=r"one\.held"):
        Conditions(2, 2).read("one", Conditions(1, 2).arrays("one") | {"one.succeeded": np.ones(2)})


# The bound: admissible and consistent in every reachable state.


def assert_admissible_and_consistent(task):
    """Hold the bound against the true costs to go, no back end asked; return its worst ratio."""
    arrows, cost, steps = situations.costs_to_go(situations.model_of(task))
    bound = LandmarkBound(task)
    # Whole units: each of the skills to go may be rounded by half of one.
    slack = len(task.skills) * 4
    for state, leaving in arrows.items():
        units, length = bound(state)
        if units < 0:
            assert cost[state] == float("inf")
            continue
        assert units <= cost[state] / COST_UNIT + slack
        assert length <= steps[state]
        for _, step_cost, target in leaving:
            further, more = bound(target)
            if further >= 0:
                assert units <= convert_to_units(step_cost) + further
                assert length <= 1 + more
    return arrows, cost, bound


@settings(max_examples=examples(150))
@given(situations.small_assemblies())
def test_it_never_exceeds_the_true_cost_to_go_and_never_jumps(content):
    """On random assemblies: swap and separate tool changes, stacks, feeders, reloading."""
    assert_admissible_and_consistent(situations.assembly(content))


@settings(max_examples=examples(400))
@given(situations.small_tasks())
def test_it_holds_on_tasks_of_any_structure(task):
    """Dead ends, detours, several makers of a fact, skills that undo others, free skills."""
    assert_admissible_and_consistent(task)


@pytest.mark.parametrize("situation", ["lid_task", "board_task"])
def test_it_never_exceeds_the_true_cost_to_go_on(situation, request):
    """The lid and the board, in every state that can be reached without regard to collisions."""
    task = request.getfixturevalue(situation)
    arrows, _, bound = assert_admissible_and_consistent(task)
    goals = [state for state in arrows if task.goal.holds(state)]
    assert goals
    assert all(bound(state) == (0, 0) for state in goals)


def test_it_is_not_idle(board_task):
    """At the start of the board it covers four fifths of the optimum and nearly all its skills."""
    units, length = LandmarkBound(board_task)(board_task.initial)
    assert 0.8 * 1.86709 < convert_from_units(units) <= 1.86709
    assert 14 <= length <= 15


def test_a_goal_out_of_reach_is_a_dead_end():
    """Also where only its first precondition is."""
    facts = Facts(("a", "b", "done"))
    skills = [situations.make_skill(facts, "finish", requires=("a",), add=("done",))]
    task = situations.make_task(facts, skills, goal=("done",))
    assert LandmarkBound(task)(task.initial) == (-1, 0)
    assert LandmarkBound(task)(facts.of("a")) == (convert_to_units(1.0), 1)


def test_a_fact_with_several_makers_counts_what_they_have_in_common():
    """Either of two roads leads through the same gate."""
    facts = Facts(("gate", "done"))
    skills = [
        situations.make_skill(facts, "open", add=("gate",), cost=5.0),
        situations.make_skill(facts, "left", requires=("gate",), add=("done",), cost=1.0),
        situations.make_skill(facts, "right", requires=("gate",), add=("done",), cost=2.0),
    ]
    task = situations.make_task(facts, skills, goal=("done",))
    assert LandmarkBound(task)(task.initial) == (convert_to_units(5.0), 1)


def test_what_only_one_skill_brings_about_is_a_landmark():
    """On two roads: the last step and nothing else."""
    task = situations.two_roads_task()
    assert LandmarkBound(task)(task.initial) == (convert_to_units(1.0), 1)


@pytest.mark.parametrize("cost", [0.0, 1e-12, 0.1, 1.8670860141568904, 12345.678])
def test_units_keep_twelve_digits(cost):
    """A cost survives the way to whole units and back."""
    assert convert_from_units(convert_to_units(cost)) == pytest.approx(cost, rel=1e-12, abs=1e-12)
    assert isinstance(convert_to_units(cost), int)


# A search that starts from a plan: it knows of it, and is never worse.


CHEAP = Plan(("to_a", "a_to_b", "finish"), 3.0)
DEAR = Plan(("to_b", "finish"), 4.0)


class Saying(Solver):
    """Returns what it is told to, and keeps what it knew before."""

    name = "saying"

    def __init__(self, answer):
        super().__init__()
        self.answer = answer
        self.knew = None

    def solve(self, model, *, seed=0):
        self.knew = self.stop.best
        return self.answer(model) if callable(self.answer) else self.answer


def skills(result):
    return tuple(step.skill for step in result.steps)


def test_the_solver_knows_the_plan_and_what_it_costs():
    """Before it begins; what the plan itself says of its cost does not count."""
    solver = Saying(Solution(CHEAP))
    solve(situations.two_roads_task(), solver, start=Plan(DEAR.skills, 99.0))
    assert solver.knew == DEAR


@pytest.mark.parametrize(
    "answer",
    [
        Solution(DEAR),
        Solution(Plan(DEAR.skills)),
        Solution(None),
        Solution(Plan(("to_a",))),
        lambda model: Solution(Policy({})),
        lambda model: Solution(
            Policy(
                {
                    model.initial: model.task.skill("to_b"),
                    model.task.facts.of("b"): model.task.skill("finish"),
                }
            )
        ),
    ],
    ids=["costlier", "of no named cost", "nothing", "half a plan", "no policy", "costlier policy"],
)
def test_nothing_worse_is_returned(answer):
    """Whatever the solver is and however it answers."""
    result = solve(situations.two_roads_task(), Saying(answer), start=CHEAP)
    assert (result.status, result.cost, skills(result)) == (Status.SOLVED, 3.0, CHEAP.skills)
    assert result.trace["start"] == "from a plan of 3.00000 J"


def test_what_is_better_is_returned():
    """And so is the solver's own plan of the same cost."""
    result = solve(situations.two_roads_task(), Saying(Solution(CHEAP)), start=DEAR)
    assert skills(result) == CHEAP.skills
    result = solve(situations.two_roads_task(), Saying(Solution(DEAR)), start=DEAR)
    assert skills(result) == DEAR.skills


def test_the_solvers_bound_is_kept():
    """Together with the plan that was there before."""
    result = solve(situations.two_roads_task(), Saying(Solution(DEAR, 2.5)), start=CHEAP)
    assert (result.cost, result.lower_bound, result.bound_method) == (3.0, 2.5, "saying")


@pytest.mark.parametrize("claim", [Solution(DEAR, 4.0, proved=True), Solution(None, proved=True)])
def test_a_claim_that_the_plan_refutes_is_wrong(claim):
    """It is not covered up."""
    assert solve(situations.two_roads_task(), Saying(claim), start=CHEAP).status is Status.WRONG


@pytest.mark.parametrize(
    ("plan", "why"),
    [
        (("to_a", "finish"), "fails at step 2 (finish): precondition: needs b"),
        (("to_a",), "fails at the end: goal: the goal is not reached"),
        ((), "fails at the end: goal: the goal is not reached"),
    ],
)
def test_a_plan_that_does_not_hold_is_not_used(plan, why):
    """The search goes on without it, and the trace says why."""
    solver = Saying(Solution(DEAR))
    result = solve(situations.two_roads_task(), solver, start=Plan(plan))
    assert solver.knew is None
    assert result.cost == 4.0
    assert why in result.trace["start"]


def test_a_plan_of_other_skills_is_refused():
    """It cannot be meant."""
    with pytest.raises(OptionError, match="fly"):
        solve(situations.two_roads_task(), "exact", start=Plan(("fly",)))


def test_under_chance_it_is_refused():
    """No fixed sequence is a plan there."""
    with pytest.raises(OptionError, match="of no use under chance"):
        solve(situations.retry_task(0.5), "value-iteration", start=Plan(("try",)))


@pytest.mark.parametrize("start", [CHEAP, DEAR])
def test_exact_search_proves_the_same_optimum_from_any_plan(start):
    """And says so."""
    result = solve(situations.two_roads_task(), "exact", start=start)
    assert (result.status, result.cost) == (Status.OPTIMAL, 3.0)


@pytest.mark.slow(reason="searches twelve parts twice; other warm starts in every run")
def test_exact_search_looks_at_less_from_a_good_plan(motor_drive_task):
    """What costs as much as the plan is not kept."""
    cold = solve(motor_drive_task, "exact")
    plan = Plan(skills(cold), cold.cost)
    warm = solve(motor_drive_task, "exact", start=plan)
    assert (warm.status, warm.cost) == (Status.OPTIMAL, pytest.approx(cold.cost, abs=1e-12))
    assert warm.trace["generated"] < cold.trace["generated"]


@given(situations.small_tasks())
def test_a_start_changes_no_optimum(task):
    """On any task, and from the costliest plan that brute force meets first."""
    cold = solve(task, "exact")
    if cold.status is not Status.OPTIMAL:
        return
    stop = Stop()
    first = []
    keep = stop.incumbent
    # The first is all that is wanted: to enumerate the rest would take most of a minute.
    stop.incumbent = lambda plan: (first.append(plan), keep(plan), stop.interrupt())
    solve(task, "exhaustive", stop=stop)
    warm = solve(task, "exact", start=first[0])
    assert warm.status is Status.OPTIMAL
    assert warm.cost == pytest.approx(cold.cost, abs=1e-9)
    assert len(warm.steps) <= len(cold.steps)


def test_an_empty_plan_serves_a_task_that_is_done():
    """At no cost."""
    facts = situations.two_roads_task().facts
    rest = situations.make_skill(facts, "rest", add=("a",))
    task = situations.make_task(facts, [rest], initial=("done",), goal=("done",))
    assert solve(task, "exact", start=Plan(())).cost == 0.0
