"""Several grippers in one task, each with jaws of its own, and a suction cup beside them."""

from __future__ import annotations

import math
from typing import Any

import pytest

from situations import assembly
from skillplan.checks import introduce
from skillplan.task import Task
from skillplan_pybullet import PybulletEngine, SimulatedArm, SimulationSettings, World
from skillplan_simulation import HAND, ContactPairsDetector, get_hand

# Thin jaws, and jaws that would meet the walls beside the pin.
SLIM_M = [[0.0, 0.004, 0.0, 0.005], [0.05, 0.004, 0.0, 0.005]]
BROAD_M = [[0.0, 0.012, 0.0, 0.014], [0.05, 0.012, 0.0, 0.014]]
PLAN = (
    *("pick(tray)", "place(tray)", "load(tweezers)", "pick(pin)", "place(pin)"),
    *("load(clamp)", "pick(block)", "place(block)"),
)


def board(pin_tool: str = "tweezers") -> Task:
    """Return the task of a tray with walls, a pin that goes between them, and a block."""
    tray: dict[str, Any] = {
        "tool": "cup",
        "mass_kg": 0.2,
        "boxes": [
            {"size_m": [0.12, 0.08, 0.004], "centre_m": [0.0, 0.0, 0.002]},
            {"size_m": [0.01, 0.08, 0.03], "centre_m": [-0.025, 0.0, 0.019]},
            {"size_m": [0.01, 0.08, 0.03], "centre_m": [0.025, 0.0, 0.019]},
        ],
        "start_m": [0.45, -0.2],
        "goal_m": [0.5, 0.0],
    }
    pin = {
        "tool": pin_tool,
        "mass_kg": 0.02,
        "size_m": [0.012, 0.012, 0.03],
        "grasp": {"closing_axis": "x"},
        "start_m": [0.4, 0.2],
        "goal_m": [0.5, 0.0],
        "goal_on": "tray",
    }
    block = {
        "tool": "clamp",
        "mass_kg": 0.3,
        "size_m": [0.07, 0.04, 0.04],
        "grasp": {"closing_axis": "x"},
        "start_m": [0.55, 0.25],
        "goal_m": [0.5, 0.16],
    }
    return assembly(
        {
            "kind": "assembly",
            "name": "three-hands",
            "robot": {"home_m": [0.4, 0.0], "safe_height_m": 0.2},
            "tools": {
                "cup": {"type": "suction", "holder_m": [0.3, 0.42]},
                "tweezers": {
                    "type": "gripper",
                    "opening_m": 0.022,
                    "force_n": 15.0,
                    "jaw_profile_m": SLIM_M,
                    "holder_m": [0.4, 0.42],
                },
                "clamp": {
                    "type": "gripper",
                    "opening_m": 0.09,
                    "force_n": 60.0,
                    "jaw_profile_m": BROAD_M,
                    "holder_m": [0.5, 0.42],
                },
            },
            "initial_tool": "cup",
            "tool_change": {"style": "swap"},
            "parts": {"tray": tray, "pin": pin, "block": block},
        }
    )


def test_an_arm_takes_the_jaws_of_the_gripper_that_it_couples():
    (robot,) = board().scene.robots
    cup, tweezers, clamp = robot.tools
    assert get_hand(robot, cup) == get_hand(robot, tweezers) != get_hand(robot, clamp)
    with World(0.6) as world:
        arm = SimulatedArm(world, robot, SimulationSettings(), get_hand(robot, tweezers))
        arm.stand(arm.kinematics.home_rad, 0.02)
        before, stood = arm.joints_rad(), arm.tip().position
        arm.fit(get_hand(robot, clamp))
        assert arm.joints_rad() == before
        assert arm.tip().position == pytest.approx(stood, abs=1e-9)
        assert arm.jaw_width_m() == pytest.approx(0.09)
        assert HAND in arm.link_names.values()
        assert world.names[arm.number] == "robot arm"


@pytest.mark.slow(reason="eight skills; jaws are changed in every run")
def test_each_part_is_handled_by_the_jaws_of_its_own_gripper():
    task = board()
    engine = PybulletEngine(task)
    introduce([engine, ContactPairsDetector(task)])
    perform = engine.perform([task.skill(name) for name in PLAN])
    assert perform.failed is None, perform.failed.verdict.reason
    for arrival in perform.arrivals:
        assert arrival.offset_m < 0.0005, arrival
        assert arrival.tilt_rad < math.radians(1), arrival


@pytest.mark.slow(reason="two skills; jaws are changed in every run")
@pytest.mark.parametrize("tool", ["tweezers", "clamp"])
def test_jaws_fit_between_walls_or_meet_them(tool):
    task = board(tool)
    engine, detector = PybulletEngine(task), ContactPairsDetector(task)
    introduce([engine, detector])
    skill = task.skill("place(pin)")
    state = task.facts.of(
        "placed(tray)", "held(pin)", f"tool({tool})", "at(pin.start)", "at_start(block)"
    )
    granted = [item.check(skill, state).is_feasible for item in (engine, detector)]
    assert all(granted) == (tool == "tweezers")
