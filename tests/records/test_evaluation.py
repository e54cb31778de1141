"""A sequence beside what is known of the optimum."""

from __future__ import annotations

from typing import Any

import pytest

from situations import make_skill, make_task
from skillplan.model import replay
from skillplan.pipeline import Setup, make_model, solve
from skillplan.records import Evaluation, Result
from skillplan.solvers import Plan, Solution, Solver, Stop
from skillplan.task import Facts, Task
from skillplan.views.tables import tabulate_evaluation
from sop_instances import instance

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
