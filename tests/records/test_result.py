"""The referee's row: what it refuses to hold, and its document."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import pytest

from situations import make_skill, make_task
from skillplan.cli import as_json, exit_code
from skillplan.model import Step, replay
from skillplan.pipeline import Setup, make_model, solve
from skillplan.records import Evaluation, Origin, Result, SimulationOutcome, Status, tolerance
from skillplan.solvers import Plan, Solution, Solver, Stop
from skillplan.task import Facts, Task
from skillplan.views import format_number, format_percent
from skillplan.views.tables import tabulate_comparison, tabulate_evaluation, tabulate_plan
from sop_instances import instance

STEP = Step(0, "pick(a)", 3, (0.0, 0.0, 0.1), None, 2.0, 4.5, None)


@pytest.fixture
def optimal():
    """One step of 2 m, proved to be the best."""
    return Result(
        task="lid",
        kind="assembly",
        sha256="0" * 64,
        solver="exact",
        seed=0,
        physics="kinematic",
        collision="aabb",
        status=Status.OPTIMAL,
        cost=2.0,
        cost_unit="m",
        lower_bound=2.0,
        steps=(STEP,),
        makespan_s=4.5,
    )


@pytest.fixture
def unsolved(optimal):
    """Nothing found."""
    nothing: dict[str, Any] = {"cost": None, "lower_bound": None, "steps": (), "makespan_s": None}
    return replace(optimal, status=Status.UNSOLVED, **nothing)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"cost": None}, "A result optimal must have a cost"),
        ({"status": Status.INFEASIBLE}, "A result infeasible must not have a cost"),
        ({"status": Status.WRONG}, "must not have a cost"),
        ({"wall_s": -0.1}, "must be >= 0"),
        ({"makespan_s": -1.0}, "must be >= 0"),
        ({"cost": -2.0, "lower_bound": None}, "must be >= 0"),
        ({"lower_bound": 2.1}, "Bound 2.1 exceeds cost 2.0"),
        ({"lower_bound": 1.9}, "must not have a gap"),
        ({"lower_bound": None}, "must not have a gap"),
    ],
)
def test_a_result_that_contradicts_itself_is_refused(optimal, changes, message):
    """Each check trips."""
    with pytest.raises(ValueError, match=message):
        replace(optimal, **changes)


def test_rounding_is_no_contradiction(optimal):
    """A bound above the cost by less than the tolerance is the cost."""
    assert 0.0 == replace(optimal, lower_bound=2.0 + tolerance(2.0) / 2).gap


@pytest.mark.parametrize(
    ("cost", "bound", "gap"),
    [(2.0, 1.5, 0.25), (2.0, 0.0, 1.0), (0.0, 0.0, 0.0), (2.0, -math.inf, None), (2.0, None, None)],
)
def test_the_gap_is_a_fraction_of_the_cost(optimal, cost, bound, gap):
    """None where either is missing."""
    solved = replace(optimal, status=Status.SOLVED, cost=cost, lower_bound=bound)
    assert gap == solved.gap


def test_a_result_without_a_plan_has_neither_gap_nor_makespan(unsolved):
    """A bound alone is no gap."""
    bounded = replace(unsolved, lower_bound=1.0)
    assert (None, None) == (bounded.gap, bounded.makespan)


def test_the_document_is_json_whatever_the_bound(unsolved):
    """An infinite bound, proof that there is no plan, becomes null."""
    infeasible = replace(unsolved, status=Status.INFEASIBLE, lower_bound=math.inf)
    document = json.loads(as_json(infeasible.document()))
    assert ("infeasible", None, None) == (
        document["status"],
        document["lower_bound"],
        document["cost"],
    )


def test_the_document_has_the_steps(optimal):
    """As lists and numbers, a place that there is not as null."""
    document = optimal.document()
    assert "skillplan.result/1" == document["schema"]
    assert (["pick(a)"], [3], 1) == (document["skills"], document["actions"], document["makespan"])
    (step,) = document["steps"]
    assert ([0.0, 0.0, 0.1], None) == (step["start"], step["goal"])


def test_a_bound_goes_with_the_method_that_proved_it(optimal, unsolved):
    """And without a finite bound there is none to name."""
    named = replace(optimal, bound_method="counting")
    assert "counting" == named.document()["bound_method"]
    for bound in (None, -math.inf):
        empty = replace(unsolved, lower_bound=bound, bound_method="counting")
        assert "" == empty.document()["bound_method"]


@pytest.mark.parametrize(
    ("status", "names"),
    [
        (Status.OPTIMAL, ["kinematic", "swept", "precedence"]),
        (Status.INFEASIBLE, ["kinematic", "swept", "precedence"]),
        (Status.UNSOLVED, []),
        (Status.REFUSED, []),
    ],
)
def test_a_claim_names_the_back_ends_that_it_was_checked_under(optimal, unsolved, status, names):
    row = optimal if status is Status.OPTIMAL else unsolved
    row = replace(row, status=status, collision="swept,precedence")
    assert names == row.document()["proved_by"]
    assert row.document()["simulation"] is None


def test_a_simulation_of_the_plan_stands_in_the_document(optimal):
    failed = SimulationOutcome("mujoco", False, 9, "place(gear)", "it rests 6 mm off")
    assert {
        "engine": "mujoco",
        "complete": False,
        "failed_step": 9,
        "skill": "place(gear)",
        "reason": "it rests 6 mm off",
    } == replace(optimal, simulation=failed).document()["simulation"]


def test_the_table_names_what_was_checked_and_what_was_not(optimal, board_task):
    row = replace(optimal, collision="swept", not_checked=("torque limit of joint_3: unknown",))
    notes = tabulate_plan(row, board_task).notes
    assert "proved by  kinematic, swept" in notes
    assert "not checked  torque limit of joint_3: unknown" in notes


def test_the_table_says_whether_the_plan_was_simulated(optimal, board_task):
    assert "simulation  not run" in tabulate_plan(optimal, board_task).notes
    failed = SimulationOutcome("mujoco", False, 9, "place(gear)", "it rests 6 mm off")
    (note,) = [
        note
        for note in tabulate_plan(replace(optimal, simulation=failed), board_task).notes
        if note.startswith("simulation")
    ]
    assert note == "simulation  by mujoco fails at step 9 of 1, place(gear): it rests 6 mm off"


def test_the_document_says_where_the_task_is_from(optimal):
    """A task that was made by hand is from nowhere."""
    assert optimal.document()["origin"] is None
    origin = Origin("lid.yaml", None, {"step_limit": "9"}, "kinematic", ("aabb",), {"aabb": {}})
    assert {
        "file": "lid.yaml",
        "part": None,
        "set": {"step_limit": "9"},
        "physics": "kinematic",
        "collision": ["aabb"],
        "options": {"aabb": {}},
        "screening": False,
    } == replace(optimal, origin=origin).document()["origin"]


def test_the_table_tells_of_bound_choice_and_start(optimal, unsolved, board_task):
    """Each in a line; without a plan the bound says what it means."""
    trace = {"choice": "exact, as the task is small", "start": "from a plan of 3 m"}
    notes = tabulate_plan(replace(optimal, bound_method="counting", trace=trace), board_task).notes
    for line in (
        "bound      2.00000 m by counting",
        "choice     exact, as the task is small",
        "start      from a plan of 3 m",
    ):
        assert line in notes
    notes = tabulate_plan(replace(unsolved, lower_bound=1.0), board_task).notes
    assert "bound      no plan costs less than 1.00000 m, by exact" in notes
    notes = tabulate_plan(unsolved, board_task).notes
    assert not [line for line in notes if line.startswith(("bound", "choice", "start"))]


def test_a_number_that_is_not_finite_never_reaches_a_document():
    """NaN is no JSON."""
    with pytest.raises(ValueError, match="JSON"):
        as_json({"cost": math.nan})


def test_the_exit_code_is_that_of_the_most_telling_row(optimal, unsolved):
    """Interrupted before wrong before solved before the rest."""
    wrong = replace(unsolved, status=Status.WRONG)
    refused = replace(unsolved, status=Status.REFUSED)
    interrupted = replace(unsolved, interrupted=True)
    assert 0 == exit_code([optimal, unsolved, refused])
    assert 1 == exit_code([unsolved, refused])
    assert 2 == exit_code([refused])
    assert 2 == exit_code([optimal, wrong])
    assert 130 == exit_code([optimal, wrong, interrupted])
    assert 1 == exit_code([])


def test_a_comparison_has_a_row_for_each_result(optimal, unsolved):
    """A dash where there is no figure; reasons stand below."""
    table = tabulate_comparison([optimal, replace(unsolved, reason="time limit")], "side by side")
    assert ["2.00000", "-"] == [row[2] for row in table.rows]
    assert ["exact: time limit"] == list(table.notes)


def test_figures_are_shown_in_fixed_digits():
    """0.0070 is 0.70 %."""
    assert ("0.70 %", "-") == (format_percent(0.0070), format_percent(None))
    assert ("1.50", "-") == (format_number(1.5, 2), format_number(None, 2))


# A sequence beside what is known of the optimum.


BARE = Setup()


@pytest.fixture
def roads():
    """A short road of 4 to the goal, and a long one of 10."""
    facts = Facts(["here", "there"])
    short = make_skill(facts, "short", requires=["here"], add=["there"], cost=4.0)
    long = make_skill(facts, "long", requires=["here"], add=["there"], cost=10.0)
    return make_task(facts, [short, long], initial=["here"], goal=["there"])


def evaluation(task: Task, skill: str, **claim: Any) -> Evaluation:
    """Return the evaluation of one skill beside what a solver claims."""

    class Claims(Solver):
        name = "claims"

        def solve(self, model: Any, *, seed: int = 0) -> Solution:
            return Solution(**claim, trace={"bound_method": "counting"})

    best: Result | None = solve(task, Claims(), BARE) if claim else None
    walked = replay(make_model(task), [task.skill(skill)])
    return Evaluation(task, [task.skill(skill)], walked, best)


def test_an_optimum_gives_a_deviation_and_no_further_words(roads):
    proved = evaluation(roads, "long", found=Plan(("short",)), lower_bound=4.0, proved=True)
    assert (4.0, pytest.approx(1.5)) == (proved.optimum, proved.deviation)
    notes = "\n".join(tabulate_evaluation(proved).notes)
    assert "deviation  150.00 % of the proved optimum" in notes
    assert "bound" not in notes


def test_a_bound_gives_a_gap_and_what_was_found_is_told(roads):
    open_ = evaluation(roads, "long", found=Plan(("short",)), lower_bound=3.0)
    document = open_.document()
    assert (None, None) == (document["optimum"], document["deviation"])
    assert (3.0, "counting", 0.7) == (
        document["lower_bound"],
        document["bound_method"],
        pytest.approx(document["gap"]),
    )
    notes = "\n".join(tabulate_evaluation(open_).notes)
    assert "deviation  unknown: the optimum was not proved in time" in notes
    assert "by counting, gap 70.00 %" in notes
    assert "found      a plan of 4.00000" in notes


def test_a_plan_that_is_no_better_is_not_mentioned(roads):
    open_ = evaluation(roads, "short", found=Plan(("short",)), lower_bound=3.0)
    notes = tabulate_evaluation(open_).notes
    assert not any(note.startswith("found") for note in notes)
    assert any(note.endswith("gap 25.00 %") for note in notes)


@pytest.mark.parametrize("claim", [{}, {"lower_bound": None}])
def test_without_a_bound_there_is_no_gap(roads, claim):
    """Whether nothing was asked, or nothing answered."""
    unknown = evaluation(roads, "short", **claim)
    assert (None, None) == (unknown.document()["lower_bound"], unknown.document()["gap"])
    assert not any(note.startswith("bound") for note in tabulate_evaluation(unknown).notes)


def test_what_nobody_has_proved_nobody_is_named_for():
    """Stopped before anything was bounded."""
    task = instance("ESC07").task
    stop = Stop()
    stop.interrupt()
    best = solve(task, "portfolio", stop=stop)
    assert (None, "") == (best.lower_bound, best.bound_method)


def test_a_sequence_that_is_no_plan_has_no_gap(roads):
    nothing = Evaluation(roads, [], replay(make_model(roads), []), None)
    assert (None, None) == (nothing.gap, nothing.deviation)
