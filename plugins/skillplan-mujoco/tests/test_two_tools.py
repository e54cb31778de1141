"""Two tools on one hand, and a nut in its socket, executed by both engines."""

from pathlib import Path

import pytest

from skillplan import Setup, make_model
from skillplan.pipeline import load_problem

CONFIGS = Path(__file__).parents[3] / "configs"
TWO_TOOLS = ("tool(gripper)", "hand_free", "placed(base)", "at_start(chip)", "at_start(clip)")
NUT = ("tool(spindle)", "hand_free", "placed(base)", "placed(plate)")


@pytest.mark.slow(reason="executions in two engines")
@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
@pytest.mark.parametrize(
    ("cell", "facts", "names"),
    [
        ("cell_two_tools", TWO_TOOLS, ("pick(clip)", "pick(chip)")),
        ("cell_nut", NUT, ("fasten(nut)",)),
    ],
)
def test_engines_use_the_tool_that_acts(engine, cell, facts, names):
    if engine == "pybullet":
        pytest.importorskip("pybullet", reason="pybullet has no wheels for this Python")
    task = load_problem(CONFIGS / f"{cell}.yaml").task
    model = make_model(task, Setup(engine, ()))
    state = task.facts.of(*facts, "at(home)")
    for name in names:
        verdict = model.verdict(state, task.skill(name))
        assert verdict.is_feasible, verdict.reason
