"""The path of a plan over the table."""

import math
from itertools import pairwise
from pathlib import Path

import pytest

from skillplan import load_problem, solve_problem
from skillplan.pipeline import Setup
from skillplan.views.figures import list_path_steps

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.mark.parametrize("config", ["inverter_board", "battery_module"])
def test_arrows_are_as_long_as_the_plan_costs(config):
    """They call at every feeder and holder that the cost counts."""
    problem = load_problem(CONFIGS / f"{config}.yaml")
    result = solve_problem(problem, setup=Setup(collision=("precedence",)))
    steps = list_path_steps(problem.task, [step.skill for step in result.steps])
    length_m = sum(math.dist(*leg) for step in steps for leg in pairwise(step.stops))
    assert length_m == pytest.approx(result.cost, rel=1e-9)
