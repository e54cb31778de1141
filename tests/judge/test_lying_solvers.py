"""The referee believes no object: neither what a solver returns, nor the task it was given."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import pytest

from situations import solver_that, two_roads_task
from skillplan.judge.plain_solution import plain_solution
from skillplan.judge.untouched import Untouched
from skillplan.pipeline.run import solve
from skillplan.solvers.solution import Plan, Solution
from skillplan.testing import lid_task


class Agreeable(float):
    """A number that every comparison pleases."""

    def __eq__(self, other: object) -> bool:
        return True

    def __lt__(self, other: object) -> bool:
        return False

    __le__ = __ge__ = __eq__
    __gt__ = __lt__
    __hash__ = float.__hash__

    def __sub__(self, other: object) -> float:
        return 0.0

    __rsub__ = __sub__

    def __float__(self) -> float:
        return 0.0

    def __abs__(self) -> float:
        return 0.0


class Chameleon(tuple[str, ...]):
    """A tuple that is another one when it is read by the loop of whoever checks it."""

    def __iter__(self) -> Iterator[str]:
        return iter(("pick(lid)",))


def cheapest() -> tuple[tuple[str, ...], float]:
    """Return the best plan of the task of two roads and what it costs."""
    result = solve(two_roads_task(), "exact")
    assert result.cost is not None
    return tuple(step.skill for step in result.steps), result.cost


class TestPlainValues:
    @pytest.mark.parametrize("claimed", [0.0, math.nan, math.inf, -1.0])
    def test_a_rigged_cost_is_compared_as_the_number_that_it_is(self, claimed: float) -> None:
        """It says that it equals everything, and is wrong all the same."""
        skills, _ = cheapest()
        lie = solver_that(lambda solver, model: Solution(Plan(skills, Agreeable(claimed))))
        result = solve(two_roads_task(), lie)
        assert "wrong" == result.status
        assert "the solver says its plan costs" in result.reason

    def test_a_rigged_bound_proves_nothing(self) -> None:
        """A plan that is not the best with a bound that is never below its cost."""
        skills, cost = cheapest()
        lie = solver_that(
            lambda solver, model: Solution(Plan(skills, cost), Agreeable(cost / 2), True)
        )
        result = solve(two_roads_task(), lie)
        assert "wrong" == result.status
        assert f"with the bound {cost / 2!r}" in result.reason

    def test_a_plan_is_read_once(self) -> None:
        """What is replayed is what is in the tuple, not what its class makes of it."""
        plan = plain_solution(Solution(Plan(Chameleon(("a", "b")), 1.0))).plan
        assert Plan(("a", "b"), 1.0) == plan
        assert plan is not None
        assert tuple is type(plan.skills)

    def test_a_policy_is_asked_once_about_a_state(self) -> None:
        """One that changes its mind is judged, and kept, as it answered first."""
        task = lid_task()

        class Fickle(Mapping[Any, Any]):
            """Take the skills in turn."""

            asked = 0

            def __getitem__(self, state: Any) -> Any:
                self.asked += 1
                return task.skills[self.asked % len(task.skills)]

            def __iter__(self) -> Iterator[Any]:
                return iter((task.initial,))

            def __len__(self) -> int:
                return 1

        policy = plain_solution(Solution(Fickle())).policy
        assert policy is not None
        assert policy[task.initial] == policy[task.initial]
        assert [(task.initial, policy[task.initial])] == list(policy.items())

    @pytest.mark.parametrize(
        ("solution", "words"),
        [
            (lambda: Solution(Plan(("a",), "cheap")), "its cost is a str, not a number"),
            (lambda: Solution(lower_bound=[1]), "cannot be read|must be a number|real number"),
            (lambda: Solution(None, None, "yes"), "its claim of a proof is 'yes'"),
            (lambda: Solution(trace={"figure": math.nan}), "its trace is not JSON"),
        ],
    )
    def test_what_is_no_claim_is_a_failure(self, solution: Any, words: str) -> None:
        """The solver has failed, in words."""
        from skillplan.errors import SolverError

        with pytest.raises(SolverError, match=words):
            solve(two_roads_task(), solver_that(lambda solver, model: solution()))


class TestTheTask:
    def test_a_solver_that_moves_the_start_to_the_goal_is_wrong(self) -> None:
        """It is judged on the task as it was, and so is everybody after it."""
        task = lid_task()
        goal = end_of_the_best_plan(task)

        def lie(solver: Any, model: Any) -> Solution:
            object.__setattr__(model.task, "initial", goal)
            return Solution(Plan((), 0.0), 0.0, True)

        result = solve(task, solver_that(lie))
        assert "wrong" == result.status
        assert result.reason.startswith("the solver changed the task, and on the task as it was")
        assert "optimal" == solve(task, "exact").status
        assert solve(lid_task(), "exact").cost == solve(task, "exact").cost

    def test_what_it_changes_deep_inside_is_undone_too(self) -> None:
        """Such as what a skill costs."""
        task = lid_task()
        honest = solve(lid_task(), "exact").cost

        def lie(solver: Any, model: Any) -> Solution:
            for skill in model.task.skills:
                object.__setattr__(skill, "duration_s", 0.0)
            return Solution(None)

        before = [skill.duration_s for skill in task.skills]
        solve(task, solver_that(lie))
        assert before == [skill.duration_s for skill in task.skills]
        assert honest == solve(task, "exact").cost

    def test_a_task_that_nobody_touched_stays_as_it_is(self) -> None:
        """Down to the objects that it holds."""
        task = lid_task()
        before, skills = Untouched(task), task.skills
        solve(task, "exact")
        assert not before.restore()
        assert skills is task.skills


def end_of_the_best_plan(task: Any) -> Any:
    """Return the state in which it leaves the task."""
    from skillplan.model.replay import replay
    from skillplan.pipeline.run import make_model

    best = solve(task, "exact")
    return replay(make_model(task), [task.skill(step.skill) for step in best.steps]).state
