"""Solvers that claim what is not so, and back ends that answer as none may."""

from __future__ import annotations

import math
import random
from collections import Counter
from collections.abc import Callable
from typing import Any

import pytest
from tally import Tally

import situations
from skillplan.errors import BackEndError, SkillplanError
from skillplan.pipeline import solve
from skillplan.solvers import Plan, Solution
from skillplan.task import Facts, Task, Verdict
from skillplan.testing import lid_task

Act = Callable[[Any, Any], Any]


def _solved() -> tuple[tuple[str, ...], float]:
    result = solve(situations.two_roads_task(), "exact")
    assert result.cost is not None
    return tuple(step.skill for step in result.steps), result.cost


def _leaving(solver: Any, model: Any) -> Solution:
    raise SystemExit(0)


def _interrupting(solver: Any, model: Any) -> Solution:
    raise GeneratorExit


def solvers() -> dict[str, Act]:
    """Return sixteen liars: they make false claims or end the program."""
    plan, cost = _solved()
    # Valid, and its cost is true: only the proof is false.
    dear, dear_cost = ("to_b", "finish"), cost + 1
    claims: dict[str, Callable[[], Any]] = {
        "a plan that is free": lambda: Solution(Plan(plan, 0.0), 0.0, True),
        "a plan that is dearer": lambda: Solution(Plan(plan, cost + 1), cost + 1, True),
        "a cost that is no number": lambda: Solution(Plan(plan, math.nan), math.nan, True),
        "an infinite bound": lambda: Solution(Plan(plan, cost), math.inf, True),
        "a bound above its cost": lambda: Solution(Plan(plan, cost), cost * 2, False),
        "a skill that is none": lambda: Solution(Plan(("fly",), 0.0), 0.0, True),
        "no skill at all": lambda: Solution(Plan((), 0.0), 0.0, True),
        "half a plan": lambda: Solution(Plan(plan[:-1], cost), cost, True),
        "a plan backwards": lambda: Solution(Plan(plan[::-1], cost), cost, True),
        "no solution": lambda: None,
        "a dearer plan and a false proof": lambda: Solution(Plan(dear, dear_cost), dear_cost, True),
        "a dearer plan and a false bound": lambda: Solution(
            Plan(dear, dear_cost), cost + 0.5, False
        ),
        "a proof that there is no plan": lambda: Solution(None, None, True),
        "no plan and a false bound": lambda: Solution(None, cost + 0.5, False),
    }
    acts: dict[str, Act] = {
        name: (lambda solver, model, make=make: make()) for name, make in claims.items()
    }
    return {**acts, "the end of the program": _leaving, "the end of a generator": _interrupting}


def _solver_is_caught(act: Act) -> None:
    """Assert that a liar is not believed and ends nothing."""
    task = situations.two_roads_task()
    _, cost = _solved()
    try:
        result = solve(task, situations.solver_that(act))
    except SkillplanError:
        pass
    else:
        believed = result.status in ("optimal", "solved")
        assert not believed or result.cost == cost, f"believed: {result.status} at {result.cost}"
        assert result.status != "infeasible", "believed that there is no plan"
        bound = result.lower_bound
        assert bound is None or bound <= cost, f"believed the bound {bound}"
        assert result.status != "optimal" or bound == cost, "believed its bound"


def chance_claims(task: Task) -> dict[str, Solution]:
    """Return claims about a task with chance whose best policy costs 2."""
    sure, again = task.skill("sure"), task.skill("again")
    dear, best = {task.initial: sure}, {task.initial: again}
    return {
        "a dearer policy and a false proof": Solution(dear, 3.0, True),
        "a dearer policy and a false bound": Solution(dear, 2.5, False),
        "the best policy and a bound above it": Solution(best, 2.5, False),
        "a fixed sequence": Solution(Plan(("again",), 1.0), 1.0, True),
    }


def _chance_task() -> Task:
    facts = Facts(("done",))
    tried = [(0.5, ("done",), ()), (0.5, (), ())]
    skills = [
        situations.make_skill(facts, "again", forbids=("done",), outcomes=tried, cost=1.0),
        situations.make_skill(facts, "sure", forbids=("done",), add=("done",), cost=3.0),
    ]
    return situations.make_task(facts, skills, goal=("done",))


def _claim_under_chance_is_caught(name: str) -> None:
    """Assert that no false claim about expected costs is believed."""
    task = _chance_task()
    solution = chance_claims(task)[name]
    result = solve(task, situations.solver_that(lambda solver, model: solution))
    assert result.status != "optimal", f"believed: optimal at {result.cost}"
    bound = result.lower_bound
    assert bound is None or bound <= 2.0, f"believed the bound {bound}"


def _raising(error: BaseException) -> Callable[[Any, Any], Any]:
    def check(skill: Any, state: Any) -> Any:
        raise error

    return check


def _resting_on_nothing(task: Task) -> Any:
    """Return answers that depend on the state, and say that they do not."""
    nothing = task.facts.none

    def answer(skill: Any, state: Any) -> Verdict:
        if skill.name == "load(screwdriver)" and "placed(fuse)" not in state:
            return Verdict.infeasible("a rule that it keeps to itself", nothing, nothing)
        return Verdict.feasible(nothing, nothing)

    return answer


def _fickle(task: Task) -> Any:
    """Return answers that change whenever the same is asked again."""
    nothing, queries = task.facts.none, Counter[tuple[str, Any]]()

    def answer(skill: Any, state: Any) -> Verdict:
        queries[skill.name, state] += 1
        if queries[skill.name, state] % 2:
            return Verdict.feasible(nothing, nothing)
        return Verdict.infeasible("not any more", nothing, nothing)

    return answer


INCONSISTENT = {
    "a verdict that names too few facts": _resting_on_nothing,
    "another verdict every time": _fickle,
}


def _inconsistency_is_caught(make: Callable[[Task], Any]) -> None:
    """Assert that a search with an audit of all that it reused names the back end."""
    task = lid_task()
    setup = situations.FakeSetup(
        make=lambda task: [situations.fake_back_end(task, make(task), name="liar")]
    )
    with pytest.raises(BackEndError, match="liar"):
        solve(task, "exhaustive", setup, audit=10_000)


def detectors() -> dict[str, Any]:
    """Return six answers that are none."""
    return {
        "an error": _raising(RuntimeError("gone")),
        "the end of the program": _raising(SystemExit(0)),
        "nothing": lambda skill, state: None,
        "a truth value": lambda skill, state: True,
        "a text": lambda skill, state: "feasible",
        "a class": lambda skill, state: Verdict,
    }


def _detector_is_caught(answer: Any) -> None:
    """Assert that a back end that gives no verdict is named, and nothing is planned with it."""
    task = situations.two_roads_task()
    model = situations.model_of(task, situations.fake_back_end(task, answer, name="liar"))
    with pytest.raises(BackEndError, match="liar"):
        list(model.transitions(task.initial))


def lie(tally: Tally) -> None:
    """Do a case of every liar."""
    for number, (name, act) in enumerate(solvers().items()):
        tally.case("lying-solver", number, _case(_solver_is_caught, name, act))
    for number, name in enumerate(chance_claims(_chance_task())):
        check = _claim_under_chance_is_caught
        tally.case("lying-under-chance", number, _case(check, name, name))
    for number, (name, answer) in enumerate(detectors().items()):
        tally.case("lying-detector", number, _case(_detector_is_caught, name, answer))
    for number, (name, make) in enumerate(INCONSISTENT.items()):
        tally.case("inconsistent-detector", number, _case(_inconsistency_is_caught, name, make))


def _case(check: Callable[[Any], None], name: str, liar: Any) -> Callable[[random.Random], None]:
    def case(chance: random.Random) -> None:
        try:
            check(liar)
        except AssertionError as error:
            raise AssertionError(f"{name}: {error}") from None

    return case
