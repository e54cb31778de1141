"""Parts that nobody handles lie still in MuJoCo, and distances between them are exact."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import skillplan_simulation as simulation
from situations import assembly
from skillplan.pipeline import load_problem
from skillplan.task import Pose, Task
from skillplan_mujoco import MujocoSimulator, World
from skillplan_simulation import STEPS_PER_S, ExecutionSettings, get_hand

GEAR_UNIT = Path(__file__).parents[3] / "configs" / "gear_unit.yaml"


def placed(task: Task, *names: str) -> World:
    """Return a world with parts where they belong."""
    world = MujocoSimulator(task, ExecutionSettings()).world()
    for name in names:
        goal = task.skill(f"place({name})").motion.routes[0].visits[-1].pose
        world.add(task.scene.body(name), goal)
    return world


def task_of(parts: dict[str, dict[str, Any]]) -> Task:
    """Return a task of parts for a gripper."""
    return assembly(
        {
            "kind": "assembly",
            "name": "apart",
            "robot": {"home_m": [0.307, 0.0], "safe_height_m": 0.15},
            "tools": {"gripper": {"holder_m": [0.6, -0.3]}},
            "initial_tool": "gripper",
            "parts": {name: {"tool": "gripper", **part} for name, part in parts.items()},
        }
    )


def advance(world: World, duration_s: float) -> None:
    for _ in range(round(duration_s * STEPS_PER_S)):
        world.step()


def test_a_round_part_in_a_hole_does_not_creep():
    """A shaft in a bushing in a housing with a cover; without the housing it falls."""
    world = placed(load_problem(GEAR_UNIT).task, "housing", "bushing", "shaft", "cover")
    advance(world, 1.0)
    settled = {name: world.pose(name) for name in world.bodies}
    advance(world, 5.0)
    for name, before in settled.items():
        along_m = abs(world.pose(name).position[1] - before.position[1])
        assert along_m < 1e-5, name
        assert math.dist(world.pose(name).position, before.position) < 2e-4, name
    touching = {frozenset((touch.first, touch.second)) for touch in world.touches()}
    assert {frozenset(("bushing", "shaft")), frozenset(("housing", "work table"))} <= touching
    world.remove("housing")
    advance(world, 0.1)
    assert world.pose("shaft").position[2] < settled["shaft"].position[2] - 0.01


def test_a_part_far_from_the_arm_stands_on_the_table():
    block = {"size_m": [0.04, 0.04, 0.04], "start_m": [0.3, -0.2], "goal_m": [1.7, -0.2]}
    world = placed(task_of({"block": block}), "block")
    advance(world, 0.1)
    assert abs(world.pose("block").position[2]) < 1e-4


@pytest.mark.parametrize("gap_m", [0.0001, 0.0004, 0.0006, 0.003])
def test_what_is_near_is_known_to_a_micrometre(gap_m):
    """Of a cylinder on its side, beside a box."""
    rod = {"cylinder": {"diameter_m": 0.02, "height_m": 0.08}, "start_m": [0.3, 0.2]}
    block = {"size_m": [0.04, 0.04, 0.04], "start_m": [0.3, -0.2]}
    parts = {"rod": {**rod, "goal_m": [0.5, 0.2]}, "block": {**block, "goal_m": [0.5, -0.2]}}
    world = placed(task_of(parts), "rod", "block")
    half = math.sqrt(0.5)
    world.put("block", Pose((0.5, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
    world.put("rod", Pose((0.5, 0.03 + gap_m, 0.02), (0.0, half, 0.0, half)))
    assert world.is_near("rod", "block", gap_m + 1e-6)
    assert not world.is_near("rod", "block", gap_m - 1e-6)
    assert world.nearest("rod", ["block"]) == ("block" if gap_m < 0.0005 else None)


def test_a_part_of_many_pieces_stands_on_few_points_and_keeps_its_hollows():
    """A ring of 24 blocks about a post: the ring's hull touches the table, but not the post."""
    blocks = [
        {"size_m": [0.01, 0.01, 0.02], "centre_m": [x, y, 0.01]}
        for x in (-0.03, -0.02, -0.01, 0.0, 0.01, 0.02, 0.03)
        for y in (-0.03, -0.02, -0.01, 0.0, 0.01, 0.02, 0.03)
        if max(abs(x), abs(y)) > 0.025
    ]
    post = {"size_m": [0.02, 0.02, 0.03], "start_m": [0.3, -0.2], "goal_m": [0.5, 0.2]}
    ring = {
        "boxes": blocks,
        "start_m": [0.3, 0.2],
        "goal_m": [0.5, 0.2],
        "grasp": {"at_m": [0, 0.03]},
    }
    parts = {"post": post, "ring": ring}
    task = assembly(
        {
            "kind": "assembly",
            "name": "ring",
            "robot": {"home_m": [0.307, 0.0], "safe_height_m": 0.15},
            "tools": {"gripper": {"holder_m": [0.6, -0.3]}},
            "initial_tool": "gripper",
            "parts": {name: {"tool": "gripper", **part} for name, part in parts.items()},
        }
    )
    world = placed(task, "post", "ring")
    advance(world, 1.0)
    touches = world.points_on("ring")
    assert {touch.second for touch in touches} == {"work table"}
    assert len(touches) <= 8
    assert math.dist(world.pose("ring").position, (0.5, 0.2, 0.0)) < 5e-5
    assert not world.is_near("ring", "post", 0.0149)


def test_a_light_part_settles_on_many_pieces_and_bears_its_weight_once():
    """A spacer of 1 g, tilted by 2 degrees, falls 0.5 mm on a plate of 64 tiles."""
    tiles = [
        {"size_m": [0.01, 0.01, 0.002], "centre_m": [x / 100, y / 100, 0.001]}
        for x in range(-4, 4)
        for y in range(-4, 4)
    ]
    sides = [
        {"size_m": size, "centre_m": [x, y, 0.006]}
        for x, y, size in (
            (-0.002, 0.0, [0.001, 0.005, 0.012]),
            (0.002, 0.0, [0.001, 0.005, 0.012]),
            (0.0, -0.002, [0.003, 0.001, 0.012]),
            (0.0, 0.002, [0.003, 0.001, 0.012]),
        )
    ]
    parts = {
        "plate": {"boxes": tiles, "mass_kg": 0.05, "start_m": [0.3, 0.2], "goal_m": [0.5, 0.2]},
        "spacer": {
            "boxes": sides,
            "mass_kg": 0.001,
            "start_m": [0.3, -0.2],
            "goal_m": [0.5, 0.2, 0.002],
            "goal_on": ["plate"],
            "grasp": {"at_m": [0.002, 0]},
        },
    }
    task = assembly(
        {
            "kind": "assembly",
            "name": "spacer",
            "robot": {"home_m": [0.307, 0.0], "safe_height_m": 0.15},
            "tools": {"gripper": {"holder_m": [0.6, -0.3]}},
            "initial_tool": "gripper",
            "parts": {name: {"tool": "gripper", **part} for name, part in parts.items()},
        }
    )
    world = placed(task, "plate", "spacer")
    turned = math.radians(2) / 2
    world.put("spacer", Pose((0.5, 0.2, 0.0025), (0.0, math.sin(turned), 0.0, math.cos(turned))))
    advance(world, 0.5)
    for _ in range(8):
        here = world.pose("spacer")
        assert math.dist(here.position, (0.5, 0.2, 0.002)) < 2e-4
        assert abs(here.orientation[3]) > math.cos(math.radians(0.05))
        advance(world, 0.1)
    lift_n = sum(touch.force_n[2] for touch in world.points_on("spacer"))
    assert lift_n == pytest.approx(0.001 * 9.81, rel=0.02)


def test_a_part_of_a_milligram_may_be_thinner_than_a_hair():
    """MuJoCo refuses its moments of inertia, below 1e-15 kg m2."""
    chip = {"size_m": [7e-5, 7e-5, 7e-5], "mass_kg": 1e-6, "start_m": [0.3, 0.2]}
    parts = {"chip": {**chip, "tool": "gripper", "goal_m": [0.5, 0.2]}}
    task = assembly(
        {
            "kind": "assembly",
            "name": "chip",
            "robot": {"home_m": [0.307, 0.0], "safe_height_m": 0.15},
            "tools": {"gripper": {"holder_m": [0.6, -0.3]}},
            "initial_tool": "gripper",
            "parts": parts,
        }
    )
    world = placed(task, "chip")
    advance(world, 0.1)
    assert math.dist(world.pose("chip").position, (0.5, 0.2, 0.0)) < 5e-5


def test_a_released_part_sinks_less_than_a_tenth_of_a_millimetre_into_what_it_lands_on():
    """A post falls a millimetre; in whole steps of 1/240 s it is 0.7 mm deep at once."""
    task = assembly(
        {
            "kind": "assembly",
            "name": "landing",
            "robot": {"home_m": [0.307, 0.0], "safe_height_m": 0.15},
            "tools": {"gripper": {"holder_m": [0.6, -0.3]}},
            "initial_tool": "gripper",
            "parts": {
                "post": {
                    "tool": "gripper",
                    "size_m": [0.015, 0.015, 0.09],
                    "start_m": [0.3, 0.2],
                    "goal_m": [0.5, 0.2],
                }
            },
        }
    )
    (robot,) = task.scene.robots
    world, arm = MujocoSimulator(task, ExecutionSettings()).cell(get_hand(robot))
    arm.stand(arm.kinematics.home_rad, 0.04)
    world.add(task.scene.body("post"), Pose((0.5, 0.2, 0.00103), (0.0, 0.0, 0.0, 1.0)))
    world.stand(["post"])
    heights_m = []
    for _ in range(60):
        arm.actuate()
        world.step()
        heights_m.append(world.pose("post").position[2])
    assert -0.0001 < min(heights_m) < 0.0
    assert heights_m[-1] == pytest.approx(0.0, abs=5e-5)


def test_a_thin_part_lies_still_on_one_that_gives_way_by_hundredths_of_a_millimetre():
    """Two sheets of nine pieces: in a step of 1/240 s the upper one falls by 0.17 mm."""
    pitch_m = 0.005 / 3
    middles_m = [(number - 1) * pitch_m for number in range(3)]

    def sheet(thick_m: float, z_m: float) -> dict[str, Any]:
        boxes = [
            {"size_m": [pitch_m, pitch_m, thick_m], "centre_m": [x, y, thick_m / 2]}
            for x in middles_m
            for y in middles_m
        ]
        places = {"start_m": [0.4, 0.1 * z_m], "goal_m": [0.502, 0.2, z_m]}
        return {"boxes": boxes, "mass_kg": 4e-5, **places}

    block = {"size_m": [0.012, 0.008, 0.003], "mass_kg": 0.002, "start_m": [0.4, -0.2]}
    sheets = {"low": sheet(0.0003, 0.003), "high": sheet(0.0005, 0.0033)}
    task = task_of({"plate": {**block, "goal_m": [0.5, 0.2]}, **sheets})
    settings = ExecutionSettings()
    (robot,) = task.scene.robots
    world, arm = MujocoSimulator(task, settings).cell(get_hand(robot))
    arm.stand(np.array(arm.kinematics.home_rad), 0.04)
    for name in ("plate", "low", "high"):
        goal = task.skill(f"place({name})").motion.routes[0].visits[-1].pose
        world.add(task.scene.body(name), goal)
    at_work = simulation.ControlledRobot(world, arm, task.scene, settings, robot.tools[0])
    at_work.wait(0.5)
    before = world.pose("high").position
    for _ in range(10):
        for name in ("plate", "low"):
            x_m, y_m, z_m = world.pose(name).position
            world.put(name, Pose((x_m, y_m, z_m - 2e-5)))
        at_work.wait(0.1)
    assert math.dist(world.pose("high").position, before) < 1e-4
