"""Claims of all plans before a planner of others, which adds up rounded costs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from handovers import best
from situations import fake_back_end, model_of
from skillplan.judge import PlannerAnswer, check_with_planner, fast_downward
from skillplan.records import Claim, Outcome, Status, StoredClaims
from skillplan.task import State, Verdict

MICROMETRES = 1_867_086


def judged(monkeypatch: pytest.MonkeyPatch, answer: PlannerAnswer, **claims: Any) -> Claim:
    """Return what a planner that answers so makes of claims on the inverter board."""
    monkeypatch.setattr(fast_downward, "find_driver", lambda: Path())
    monkeypatch.setattr(fast_downward, "run_planner", lambda made, limit_s: answer)
    model = best("inverter_board").model
    (claim,) = check_with_planner(stored(**claims), model, 1.0, charted=True)
    return claim


def stored(**claims: Any) -> StoredClaims:
    """Return claims of a result; those not given are not made."""
    none = dict.fromkeys(("cost", "lower_bound", "gap", "makespan", "makespan_s"))
    stated = {"solver": "exact", "cost_unit": "m", "skills": [], "actions": [], "steps": []}
    return StoredClaims.model_validate(
        {**none, **stated, **claims, "status": Status(claims["status"])}
    )


def answer(cost: int = MICROMETRES) -> PlannerAnswer:
    """Return the answer of a planner that finds the optimum."""
    return PlannerAnswer(cost, tuple(skill.skill.name for skill in best("inverter_board").skills))


def test_an_optimum_within_the_rounding_holds(monkeypatch):
    """Half a micrometre a skill."""
    plan = best("inverter_board").plan
    assert plan is not None
    claim = judged(monkeypatch, answer(MICROMETRES + 7), status="optimal", cost=plan.cost)
    assert (Outcome.HOLDS, True) == (claim.outcome, "rounded by at most 7.5e-06" in claim.detail)


def test_rounding_hides_no_better_plan(monkeypatch):
    """An optimum that is 5 um too dear is within the rounding, and the planner's plan is not."""
    claim = judged(monkeypatch, answer(), status="optimal", cost=MICROMETRES / 1e6 + 5e-6)
    assert (Outcome.FAILS, True) == (claim.outcome, claim.contradiction)
    assert "its plan costs 1.86708" in claim.detail


def test_a_cost_that_no_plan_has_fails(monkeypatch):
    claim = judged(monkeypatch, answer(), status="optimal", cost=MICROMETRES / 1e6 - 1e-5)
    assert (Outcome.FAILS, True) == (claim.outcome, "no plan costs so little" in claim.detail)


@pytest.mark.parametrize(
    ("bound", "outcome"), [(1.8, Outcome.HOLDS), (1.9, Outcome.FAILS), (None, Outcome.HOLDS)]
)
def test_a_search_that_was_ended_answers_for_its_bound_alone(monkeypatch, bound, outcome):
    """That the planner finds a plan and the search did not is no contradiction."""
    assert outcome is judged(monkeypatch, answer(), status="unsolved", lower_bound=bound).outcome


def test_a_plan_refutes_that_there_is_none(monkeypatch):
    claim = judged(monkeypatch, answer(), status="infeasible")
    assert Outcome.FAILS is claim.outcome


def test_a_lower_proved_cost_is_a_contradiction_even_if_the_plan_behind_it_does_not_hold(
    monkeypatch,
):
    """The files state the task as the model does, so that one of the two is wrong."""
    wrong = PlannerAnswer(MICROMETRES - 1000, answer().skills[::-1])
    claim = judged(monkeypatch, wrong, status="optimal", cost=MICROMETRES / 1e6)
    assert (Outcome.FAILS, True) == (claim.outcome, claim.contradiction)
    assert "its plan fails at fasten(screw_2): needs tool(screwdriver)" in claim.detail


def test_what_pddl_cannot_say_is_not_checked_and_no_planner_is_asked(monkeypatch):
    """A verdict that is not known may be either."""
    queries: list[object] = []
    monkeypatch.setattr(fast_downward, "find_driver", lambda: Path())
    monkeypatch.setattr(fast_downward, "run_planner", lambda *words: queries.append(words))
    task = best("inverter_board").task

    feasible = Verdict.feasible(task.facts.none, task.facts.none)

    def answer_pick(skill: Any, state: State) -> Verdict:
        return Verdict.unknown("no path in time") if skill.name == "pick(pcb)" else feasible

    claims = stored(status="optimal", cost=1.0)
    model = model_of(task, fake_back_end(task, answer_pick))
    (claim,) = check_with_planner(claims, model, 1.0, charted=False)
    assert (Outcome.NOT_CHECKED, []) == (claim.outcome, queries)
    assert claim.detail.startswith("PDDL cannot say it: verdicts are not known: pick(pcb) (fake:")
