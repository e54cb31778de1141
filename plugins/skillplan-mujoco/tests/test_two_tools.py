"""Two tools on one hand, executed by both engines."""

from pathlib import Path

import pytest

from skillplan import Setup, make_model
from skillplan.pipeline import load_problem

CELL = Path(__file__).parents[3] / "configs" / "cell_two_tools.yaml"


@pytest.mark.slow(reason="executions in two engines")
@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
def test_engines_use_either_tool_of_a_hand(engine):
    if engine == "pybullet":
        pytest.importorskip("pybullet", reason="pybullet has no wheels for this Python")
    task = load_problem(CELL).task
    model = make_model(task, Setup(engine, ()))
    facts = ("tool(gripper)", "hand_free", "placed(base)", "at_start(chip)", "at_start(clip)")
    state = task.facts.of(*facts, "at(home)")
    for name in ("pick(clip)", "pick(chip)"):
        verdict = model.verdict(state, task.skill(name))
        assert verdict.is_feasible, verdict.reason
