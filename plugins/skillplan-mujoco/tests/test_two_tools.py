"""Two tools on one hand, and a nut in its socket, executed by both engines."""

from pathlib import Path

import pytest

from situations import assembly
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


@pytest.mark.slow(reason="executions by the grippers of the catalogue")
@pytest.mark.parametrize("gripper", ["robotiq_2f85", "robotiq_2f140", "long_jaws", "wide_jaws"])
def test_a_gripper_of_the_catalogue_picks_a_block_after_a_tool_change(gripper):
    """Jaws of another hand met nothing: MuJoCo looked for their contacts beside them."""
    block = {"mass_kg": 0.1, "start_m": [0.5, 0.1], "goal_m": [0.5, -0.1]}
    task = assembly(
        {
            "kind": "assembly",
            "name": "grippers",
            "robot": {"model": "ur10e", "home_m": [0.6, -0.1], "safe_height_m": 0.2},
            "tools": {
                "hand": {"type": "gripper", "holder_m": [0.4, 0.6]},
                gripper: {"model": gripper, "holder_m": [0.9, 0.4], "force_n": 10.0},
            },
            "initial_tool": "hand",
            "parts": {"block": {**block, "tool": gripper, "size_m": [0.04, 0.012, 0.05]}},
        }
    )
    model = make_model(task, Setup("mujoco", ()))
    state = task.facts.of(f"tool({gripper})", "hand_free", "at_start(block)", "at(home)")
    verdict = model.verdict(state, task.skill("pick(block)"))
    assert verdict.is_feasible, verdict.reason
