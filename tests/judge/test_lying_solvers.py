"""The referee believes no claim, and a solution that cannot be read is a failure of its solver."""

from __future__ import annotations

import math

import numpy as np
import pytest

from situations import solver_that, two_roads_task
from skillplan.pipeline import solve
from skillplan.solvers import Plan, Solution


def cheapest() -> tuple[tuple[str, ...], float]:
    """Return the best plan of the task of two roads and what it costs."""
    result = solve(two_roads_task(), "exact")
    assert result.cost is not None
    return tuple(step.skill for step in result.steps), result.cost


class TestPlainValues:
    @pytest.mark.parametrize("claimed", [0.0, math.nan, math.inf, -1.0])
    def test_a_wrong_cost_is_refuted(self, claimed):
        """The referee replays the plan and adds its costs up itself."""
        skills, _ = cheapest()
        lie = solver_that(lambda solver, model: Solution(Plan(skills, claimed)))
        result = solve(two_roads_task(), lie)
        assert "wrong" == result.status
        assert "the solver says its plan costs" in result.reason

    def test_a_false_bound_proves_nothing(self):
        """A bound below the cost of the plan does not prove it to be the best."""
        skills, cost = cheapest()
        lie = solver_that(lambda solver, model: Solution(Plan(skills, cost), cost / 2, True))
        result = solve(two_roads_task(), lie)
        assert "wrong" == result.status
        assert f"with the bound {cost / 2!r}" in result.reason

    def test_numbers_of_numpy_become_those_of_python(self):
        """The messages and the JSON document show plain figures."""
        skills, cost = cheapest()
        honest = solver_that(
            lambda solver, model: Solution(Plan(skills, np.float64(cost)), np.float64(cost), True)
        )
        result = solve(two_roads_task(), honest)
        assert ("optimal", cost) == (result.status, result.cost)
        assert float is type(result.lower_bound)

    @pytest.mark.parametrize(
        ("solution", "words"),
        [
            (lambda: Solution(Plan(("a",), "cheap")), "its cost is a str, not a number"),
            (lambda: Solution(lower_bound=[1]), "cannot be read|must be a number|real number"),
            (lambda: Solution(None, None, "yes"), "its claim of a proof is 'yes'"),
            (lambda: Solution(trace={"figure": math.nan}), "its trace is not JSON"),
        ],
    )
    def test_what_is_no_claim_is_a_failure(self, solution, words):
        """The solver has failed, in words."""
        from skillplan.errors import SolverError

        with pytest.raises(SolverError, match=words):
            solve(two_roads_task(), solver_that(lambda solver, model: solution()))
