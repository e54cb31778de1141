"""The boards beyond the paper's, executed: what the files' charts allow can be done."""

from pathlib import Path

import pytest

from skillplan.pipeline import Setup, load_problem, solve
from thinned import release_case

CONFIGS = Path(__file__).parents[3] / "configs"
PHYSICS = Setup(physics="pybullet", collision=("contact-pairs",))


@pytest.mark.parametrize(
    "name",
    [
        release_case(
            "battery_module", reason="half a minute of executions; by swept hulls in every run"
        ),
        release_case("relay_rail", reason="minutes of executions"),
    ],
)
def test_physics_proves_the_optimum_of_the_chart(name):
    """Asked about what comes up on the way to the proof: 49 and 167 executions."""
    task = load_problem(CONFIGS / f"{name}.yaml").task
    simulated, drawn = solve(task, setup=PHYSICS), solve(task)
    assert simulated.status == "optimal"
    assert simulated.cost == pytest.approx(drawn.cost)
    assert [s.action for s in simulated.steps] == [s.action for s in drawn.steps]


@pytest.mark.release(reason="executions of a board with uncertain grasps")
def test_physics_gives_the_expected_cost_of_the_chart():
    """By the outcome in which the grasp holds; no proof is audited where checks are expensive."""
    task = load_problem(CONFIGS / "inverter_grasps.yaml").task
    simulated = solve(task, "value-iteration", PHYSICS)
    assert simulated.status == "solved"
    assert simulated.cost == pytest.approx(solve(task, "value-iteration").cost)
