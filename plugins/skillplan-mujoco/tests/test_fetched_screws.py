"""Screws run into what is near: at their feeders once fetched, and with the shank below a part."""

from __future__ import annotations

import copy
import sys
from collections.abc import Mapping
from typing import Any

import pytest

from situations import assembly, config_content, fetching_board
from skillplan.collision import AabbDetector
from skillplan.pipeline import Setup, make_model
from skillplan.task import Verdict

BACK_ENDS = {
    "aabb": Setup(collision=("aabb",)),
    "swept": Setup(collision=("swept",)),
    "pybullet": Setup("pybullet", ("contact-pairs",)),
    "mujoco": Setup("mujoco", ("contact-pairs",)),
}


@pytest.fixture(params=BACK_ENDS)
def setup(request):
    """Each of the back ends that know geometry."""
    if request.param == "pybullet" and sys.version_info >= (3, 12):
        pytest.importorskip("pybullet", reason="pybullet has no wheels for this Python")
    return BACK_ENDS[request.param]


def verdict_of(content: dict[str, Any], setup: Setup) -> Verdict:
    """Return the verdict on driving the screw into the plate, all fixtures in place."""
    task = assembly(content)
    fixtures = [f"at_start({name})" for name in content["parts"] if name != "plate"]
    facts = ("placed(plate)", "hand_free", "tool(screwdriver)", "at(home)", *fixtures)
    return make_model(task, setup).verdict(task.facts.of(*facts), task.skill("fasten(screw)"))


@pytest.mark.parametrize(
    "content",
    [
        pytest.param(fetching_board(), id="on the table"),
        pytest.param(fetching_board(head_mm=(10.0, 12.0)), id="a tall head on the table"),
        pytest.param(fetching_board(0.02, beneath_m=0.02), id="on a tray"),
        pytest.param(fetching_board(wall_m=0.008), id="beside a low wall"),
        pytest.param(fetching_board(head_mm=(10.0, 0.1)), id="a head lower than it is pressed in"),
    ],
)
def test_a_screw_does_not_collide_with_what_bears_its_feeder(content, setup):
    verdict = verdict_of(content, setup)
    assert verdict.is_feasible, verdict.reason


@pytest.mark.parametrize(
    ("content", "obstacle"),
    [
        pytest.param(
            fetching_board(wall_m=0.008, head_mm=(20.0, 2.0), envelope_m=[0.006, 0.006, 0.1]),
            "wall",
            id="a wide head beside a wall",
        ),
        pytest.param(
            fetching_board(0.01, beneath_m=0.02, envelope_m=[0.006, 0.006, 0.1]),
            "tray",
            id="inside a tray",
        ),
    ],
)
def test_what_a_screw_runs_into_at_its_feeder_is_named(content, obstacle, setup):
    verdict = verdict_of(content, setup)
    assert verdict.is_infeasible
    assert obstacle in verdict.reason.split(), verdict.reason


def bridge(height_m: float) -> dict[str, Any]:
    """Return a plate on two blocks, and a block of some height below the hole of a screw."""
    leg = {"size_m": [0.06, 0.02, 0.03]}
    block = {"tool": "gripper", "size_m": [0.1, 0.03, height_m]}
    return {
        "kind": "assembly",
        "name": "bridge",
        "robot": {"home_m": [0.4, -0.3]},
        "tools": {
            "gripper": {"type": "gripper", "holder_m": [0.25, 0.4]},
            "screwdriver": {"type": "screwdriver", "holder_m": [0.4, 0.4]},
        },
        "initial_tool": "gripper",
        "fixtures": {"left": {**leg, "at_m": [0.5, 0.04]}, "right": {**leg, "at_m": [0.5, -0.04]}},
        "parts": {
            "plate": {
                "fixed": True,
                "size_m": [0.06, 0.1, 0.008],
                "goal_m": [0.5, 0.0],
                "goal_on": ["left", "right"],
            },
            "block": {**block, "start_m": [0.55, 0.0], "goal_m": [0.45, -0.25]},
        },
        "screws": {
            "screw": {
                "tool": "screwdriver",
                "through": "plate",
                "hole_m": [0.515, 0.0],
                "size": "M4",
                "length_m": 0.02,
            }
        },
    }


@pytest.mark.parametrize(
    ("height_m", "is_free"),
    [
        (0.025, False),
        pytest.param(0.014, True, marks=pytest.mark.slow(reason="free in the cells of this page")),
    ],
)
def test_a_shank_runs_into_what_is_below_its_part(height_m, is_free, setup):
    # The shank ends 18 mm above the table.
    task = assembly(bridge(height_m))
    facts = (
        "at_start(block)",
        "placed(plate)",
        "hand_free",
        "tool(screwdriver)",
        "at(home)",
        "fixed",
    )
    verdict = make_model(task, setup).verdict(task.facts.of(*facts), task.skill("fasten(screw)"))
    assert verdict.is_feasible is is_free, verdict.reason


@pytest.mark.slow(reason="an execution")
def test_walls_of_a_recess_lead_the_head_of_a_screw():
    """They are as far apart as the head is wide; before, any touch of them was a collision."""
    content = bridge(0.014)
    for name, x_m in (("left_cheek", 0.5095), ("right_cheek", 0.5205)):
        content["fixtures"][name] = {"size_m": [0.004, 0.02, 0.003], "at_m": [x_m, 0.0, 0.038]}
    task = assembly(content)
    facts = ("at_start(block)", "placed(plate)", "hand_free", "tool(screwdriver)", "at(home)")
    state, skill = task.facts.of(*facts, "fixed"), task.skill("fasten(screw)")
    verdict = make_model(task, BACK_ENDS["mujoco"]).verdict(state, skill)
    assert verdict.is_feasible, verdict.reason


ALL_ROUND = config_content("cell_screws")
IN_PLACE = [f"placed({name})" for name in ALL_ROUND["parts"]]


def verdict_in_cell(
    skill: str, setup: Setup, holders: Mapping[str, Any] | None = None, **driver: Any
) -> Verdict:
    """Return the verdict on driving a screw of the cell, all parts in place."""
    content = copy.deepcopy(ALL_ROUND) | {"holders": dict(holders or {})}
    content["tools"]["driver"] |= driver
    task = assembly(content)
    state = task.facts.of(*IN_PLACE, "hand_free", "tool(driver)", "at(driver.holder)", "fixed")
    return make_model(task, setup).verdict(state, task.skill(skill))


SLOW = pytest.mark.slow(reason="from below by swept in every run")


@pytest.mark.parametrize(
    ("skill", "back_end"),
    [
        ("fasten(below_1)", "swept"),
        pytest.param("fasten(side)", "swept", marks=SLOW),
        pytest.param("fasten(top_1)", "swept", marks=SLOW),
        pytest.param("fasten(below_1)", "pybullet", marks=SLOW),
        pytest.param("fasten(below_1)", "mujoco", marks=SLOW),
        pytest.param("fasten(side)", "mujoco", marks=SLOW),
    ],
)
def test_screws_go_in_from_below_from_the_side_and_from_above(skill, back_end):
    if back_end == "pybullet":
        pytest.importorskip("pybullet")
    verdict = verdict_in_cell(skill, BACK_ENDS[back_end])
    assert verdict.is_feasible, verdict.reason


@pytest.mark.slow(reason="an execution")
def test_the_thread_holds_a_level_screw_at_once_if_a_holder_holds_a_part():
    """After the driver let go, it fell by 12 mm before the thread held it."""
    holder = {"kind": "hold", "parts": ["clip"], "stays": True}
    verdict = verdict_in_cell("fasten(side)", BACK_ENDS["mujoco"], {"support": holder})
    assert verdict.is_feasible, verdict.reason


def test_the_bit_is_long_enough_to_pass_a_wall():
    short = verdict_in_cell("fasten(top_1)", BACK_ENDS["swept"], bit_length_m=0.04)
    assert "driver runs into wall" in short.reason


def test_boxes_refuse_screws_from_below():
    assert "goes up from below" in AabbDetector(assembly(ALL_ROUND)).refuses()
