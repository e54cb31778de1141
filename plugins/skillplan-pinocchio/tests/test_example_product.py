"""The product of the examples, written from the documentation alone, has the plan it declares."""

from pathlib import Path

import pytest

from skillplan import Setup, Status, load_problem, solve
from skillplan.pipeline import preview_problem

PROBLEM = load_problem(Path(__file__).parents[3] / "examples" / "sensor_box.yaml")


@pytest.mark.slow(reason="one product more; files that ship in every run")
def test_check_has_nothing_to_say_against_it():
    """Nothing that the arm cannot reach, nothing that overlaps or floats."""
    assert preview_problem(PROBLEM).warnings == ()


@pytest.mark.slow(reason="3 s of trajectories; that the arm reaches all is left in every run")
def test_its_quickest_plan_is_proved_by_trajectories():
    """The flange before the board, as the cup is at hand, and the shaft from the side at last."""
    result = solve(PROBLEM.task, setup=Setup(collision=("swept",)))
    expected = PROBLEM.config.expect
    assert result.status is Status.OPTIMAL
    assert result.cost == pytest.approx(expected.optimal_cost, abs=1e-3)
    assert [step.action for step in result.steps] == expected.optimal_actions
