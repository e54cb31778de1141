"""Geometry before physics: what a screen refuses is not executed, and it hides nothing."""

from __future__ import annotations

from typing import Any

import pytest

from situations import FakeSetup, fake_back_end, two_roads_task
from skillplan.physics import Engine
from skillplan.pipeline import solve
from skillplan.records import Result, Status
from skillplan.task import BackEnd, Skill, State, Task, Verdict


def refusing(task: Task, *names: str) -> Any:
    """Return what a back end answers that refuses the skills of some names."""
    nothing = task.facts.none

    def answer(skill: Skill, state: State) -> Verdict:
        if skill.name in names:
            return Verdict.infeasible(f"{skill.name} is blocked", nothing, nothing)
        return Verdict.feasible(nothing, nothing)

    return answer


class Screened:
    """Two roads, a screen and an engine that each refuse some skills."""

    def __init__(self, screened: tuple[str, ...], executed: tuple[str, ...] = ()) -> None:
        self.task = two_roads_task()
        self.screen = fake_back_end(
            self.task, refusing(self.task, *screened), name="screen", expected_s=0.01
        )
        self.screen.screens = True
        self.engine = fake_back_end(
            self.task,
            refusing(self.task, *executed),
            name="engine",
            base=Engine,
            expensive=True,
            expected_s=0.5,
        )

    def solve(self, solver: str = "exact", **more: Any) -> Result:
        """Solve the task."""
        back_ends: list[BackEnd] = [self.engine, self.screen]
        return solve(self.task, solver, FakeSetup(make=lambda task: back_ends), **more)

    @property
    def executed(self) -> list[str]:
        """The skills that the engine was asked about."""
        return [name for name, _ in self.engine.asked]


BLOCKED = ("a_to_b",)
ALL_WAYS = ("finish",)


def test_what_a_screen_refuses_is_not_executed():
    screened = Screened(BLOCKED, BLOCKED)
    assert screened.solve(audit=0).status is Status.OPTIMAL
    assert screened.executed
    assert not set(BLOCKED) & set(screened.executed)


def test_a_sample_of_it_is_executed_after_the_search():
    screened = Screened(BLOCKED, BLOCKED)
    result = screened.solve()
    assert result.status is Status.OPTIMAL
    assert {"refused": 1, "executed": 1} == result.trace["screening"]
    assert screened.executed[-1:] == list(BLOCKED)


def test_where_geometry_leaves_no_plan_only_a_sample_is_executed():
    screened = Screened(ALL_WAYS, ALL_WAYS)
    result = screened.solve()
    assert result.status is Status.INFEASIBLE
    assert result.checks > 0
    assert set(ALL_WAYS) == set(screened.executed)
    assert len(screened.executed) <= 2


@pytest.mark.parametrize(
    ("screened", "status"), [(BLOCKED, Status.SOLVED), (ALL_WAYS, Status.UNSOLVED)]
)
def test_what_an_engine_grants_takes_the_proof_of_a_search(screened, status):
    """The screen, the skill and the remedy are named."""
    result = Screened(screened).solve()
    assert (result.status, result.lower_bound) == (status, None)
    assert f"the screen 'screen' refuses {screened[0]}" in result.reason
    assert "which engine grants" in result.reason
    assert "--no-screening leaves it to engine" in result.reason


def test_how_long_skills_take_is_left_to_the_engine():
    outcome = Screened(())
    type(outcome.screen).duration_s = lambda self, skill, state: 100.0
    result = outcome.solve()
    del type(outcome.screen).duration_s
    assert result.makespan_s is not None
    assert result.makespan_s < 100.0


def test_without_a_screen_nothing_is_executed_twice():
    count = Screened(())
    count.screen.screens = False
    result = count.solve()
    assert "screening" not in result.trace
    assert len(count.executed) == len(set(count.engine.asked))
