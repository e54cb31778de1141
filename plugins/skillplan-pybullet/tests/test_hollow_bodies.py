"""Bodies that are not convex: exact where they stand, of convex pieces where they move."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from concave_shapes import as_obj
from situations import assembly
from skillplan.checks import introduce
from skillplan.cli import main
from skillplan.task import Body, Box, Event, Mesh, Motion, Pose, Route, Task, Visit
from skillplan_pybullet import PybulletEngine, World
from skillplan_simulation import STEPS_PER_S, ContactPairsDetector

OUTER_M, INNER_M, HEIGHT_M, FLOOR_M = 0.1, 0.09, 0.04, 0.01


def case_mesh(
    outer_m: float = OUTER_M,
    inner_m: float = INNER_M,
    height_m: float = HEIGHT_M,
    floor_m: float = FLOOR_M,
) -> Mesh:
    """Return a case with four walls and a floor, open above; in and out by half its width."""
    corners: list[tuple[float, float, float]] = []
    for half_m, z_m in (
        (outer_m, 0.0),
        (outer_m, height_m),
        (inner_m, height_m),
        (inner_m, floor_m),
    ):
        corners += [(x * half_m, y * half_m, z_m) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    sides = [(3, 2, 1, 0), (12, 13, 14, 15)]
    for ring in (0, 4, 8):
        sides += [
            (ring + a, ring + b, ring + 4 + b, ring + 4 + a)
            for a, b in ((0, 1), (1, 2), (2, 3), (3, 0))
        ]
    faces = tuple(face for a, b, c, d in sides for face in ((a, b, c), (a, c, d)))
    return Mesh(tuple(corners), faces, convex=False)


def pieces() -> tuple[Box, ...]:
    """Return its floor and walls, the floor half a millimetre too high."""
    walls = [Box((0.01, 0.2, HEIGHT_M), (side * 0.095, 0.0, HEIGHT_M / 2)) for side in (-1, 1)] + [
        Box((0.2, 0.01, HEIGHT_M), (0.0, side * 0.095, HEIGHT_M / 2)) for side in (-1, 1)
    ]
    return (Box((0.2, 0.2, FLOOR_M + 0.0005), (0.0, 0.0, (FLOOR_M + 0.0005) / 2)), *walls)


CASE = Body("case", pieces(), (), 0.5, surfaces=(case_mesh(),))
PART = Body("part", (Box((0.04, 0.06, 0.02), (0.0, 0.0, 0.01)),), (), 0.1)
LID = Body("lid", (Box((0.2, 0.2, 0.004), (0.0, 0.0, 0.002)),), (), 0.1)


def settle(world: World) -> None:
    for _ in range(STEPS_PER_S // 2):
        world.step()


def test_a_part_lies_on_the_floor_of_a_case_that_stands():
    with World(0.6) as world:
        world.add(CASE, Pose((0.4, 0.1, 0.0)), stands=True)
        world.add(PART, Pose.upright((0.42, 0.08, FLOOR_M + 0.001), 0.3))
        settle(world)
        assert world.pose("part").position == pytest.approx((0.42, 0.08, FLOOR_M), abs=5e-5)
        assert world.fixed == {"case"}


def test_a_lid_lies_on_its_walls():
    with World(0.6) as world:
        world.add(CASE, Pose((0.4, 0.1, 0.0)), stands=True)
        world.add(LID, Pose((0.4, 0.1, HEIGHT_M + 0.001)))
        settle(world)
        assert world.pose("lid").position == pytest.approx((0.4, 0.1, HEIGHT_M), abs=5e-5)


def test_a_case_that_is_to_be_moved_is_made_of_pieces_and_falls():
    with World(0.6) as world:
        world.add(CASE, Pose.turned((0.4, 0.1, 0.2), (0.1, 0.2, 0.3)), stands=True)
        settle(world)
        before = world.pose("case")
        world.stand({"case"})
        assert np.allclose(world.pose("case").position, before.position, atol=1e-9)
        assert world.fixed == frozenset()
        settle(world)
        assert world.pose("case").position[2] < 0.1


def test_what_is_fastened_to_a_case_stays_fastened_to_it():
    screw = Body("screw", (Box((0.01, 0.01, 0.005), (0.0, 0.0, 0.0025)),), (), 0.01)
    with World(0.6) as world:
        world.add(CASE, Pose((0.4, 0.1, 0.0)), stands=True)
        beside = Pose.turned((0.4 - OUTER_M, 0.1, 0.02), (0.0, -np.pi / 2, 0.0))
        world.add(screw, beside)
        bearing = world.nearest("screw")
        assert bearing == "case"
        world.fasten("screw", bearing)
        world.stand({"case"})
        world.stand(())
        settle(world)
        assert world.pose("screw").position == pytest.approx(beside.position, abs=1e-4)


def boxed_task() -> Task:
    """Return the task of a chip that is put into a case."""
    parts = {
        "case": {"size_m": [0.2, 0.2, HEIGHT_M], "start_m": [0.45, -0.25], "goal_m": [0.45, 0.2]},
        "chip": {"size_m": [0.02, 0.03, 0.015], "start_m": [0.6, 0.0], "goal_m": [0.7, 0.0]},
    }
    for part in parts.values():
        part |= {"tool": "gripper", "mass_kg": 0.05}
    parts["case"]["grasp"] = {"type": "suction"}
    task = assembly(
        {
            "kind": "assembly",
            "name": "boxed",
            "robot": {"home_m": [0.4, 0.0], "safe_height_m": 0.2},
            "tools": {"gripper": {"holder_m": [0.6, 0.4]}},
            "initial_tool": "gripper",
            "parts": parts,
        }
    )
    case, chip = task.scene.bodies
    goal = Pose((0.45, 0.2, FLOOR_M))
    placements = tuple(
        replace(placement, pose=goal) if placement.fact == "placed(chip)" else placement
        for placement in chip.placements
    )
    bodies = (
        replace(case, shapes=pieces(), surfaces=(case_mesh(),)),
        replace(chip, placements=placements),
    )
    skills = tuple(
        replace(skill, motion=Motion("robot", (Route(task.facts.none, (visit,)),), "chip"))
        if skill.name == "place(chip)"
        else skill
        for skill in task.skills
        for visit in [Visit(goal, Event.RELEASE, "chip")]
    )
    return replace(task, scene=replace(task.scene, bodies=bodies), skills=skills)


@pytest.mark.slow(reason="executes; a drawer is pushed in in every run")
def test_a_chip_is_put_into_a_case_and_the_case_holds_it():
    task = boxed_task()
    engine, detector = PybulletEngine(task), ContactPairsDetector(task)
    introduce([engine, detector])
    state = task.facts.of("placed(case)", "held(chip)", "tool(gripper)", "at(chip.start)")
    for back_end in (engine, detector):
        verdict = back_end.check(task.skill("place(chip)"), state)
        assert verdict.is_feasible, verdict.reason
        assert "placed(case)" in verdict.facts
    empty = task.facts.of("at_start(case)", "held(chip)", "tool(gripper)", "at(chip.start)")
    assert not engine.check(task.skill("place(chip)"), empty).is_feasible


@pytest.mark.slow(reason="four skills; a chip that is put into a case in every run")
def test_a_case_is_moved_and_filled_in_one_plan():
    task = boxed_task()
    engine = PybulletEngine(task)
    introduce([engine, ContactPairsDetector(task)])
    names = ("pick(case)", "place(case)", "pick(chip)", "place(chip)")
    performance = engine.perform([task.skill(name) for name in names])
    assert performance.failed is None, performance.failed.verdict.reason
    for arrival in performance.arrivals:
        # The pieces of the case are half a millimetre off where it stands.
        assert arrival.offset_m < 0.0006, arrival


TUB = """
kind: assembly
name: tub
robot: {model: ur5e, home_m: [0.45, -0.05], safe_height_m: 0.15}
tools: {gripper: {type: gripper, opening_m: 0.080, holder_m: [0.20, 0.45]}}
initial_tool: gripper
parts:
  tub:
    tool: gripper
    mass_kg: 0.12
    meshes: [{file: tub.obj}]
    grasp: {closing_axis: x, depth_m: 0.02}
    start_m: [0.45, -0.10]
    goal_m: [0.50, 0.05]
  core:
    tool: gripper
    mass_kg: 0.05
    size_m: [0.030, 0.030, 0.040]
    grasp: {closing_axis: x, depth_m: 0.01}
    start_m: [0.35, -0.05]
    goal_m: [0.50, 0.05]
    goal_on: tub
"""


@pytest.mark.slow(
    reason="a mesh in pieces and a search by physics; bodies by themselves in every run"
)
def test_a_ur5e_carries_a_hollow_mesh_and_fills_it(tmp_path, capfd, monkeypatch):
    """As a user describes it: the tub is held by its walls, and the core goes between them."""
    pytest.importorskip("coacd", reason="pieces of what moves come from CoACD")
    monkeypatch.setenv("SKILLPLAN_CACHE_DIR", str(tmp_path / "cache"))
    (tmp_path / "tub.obj").write_text(as_obj(case_mesh(0.03, 0.025, 0.035, 0.005)), "utf-8")
    (tmp_path / "tub.yaml").write_text(TUB, "utf-8")
    file, out = str(tmp_path / "tub.yaml"), str(tmp_path / "out")
    chosen = ("--physics", "pybullet", "--collision", "contact-pairs")
    documents = []
    for words in (("search-optimal", file, *chosen, "--out", out), ("simulate", out)):
        with pytest.raises(SystemExit) as ended:
            main([*words, "--format", "json"])
        printed, error = capfd.readouterr()
        assert ended.value.code == 0, error or printed[-2000:]
        documents.append(json.loads(printed))
    result, done = documents
    assert result["status"] == "optimal"
    assert done["complete"]
    assert done["largest_offset_mm"] < 0.5
    assert done["largest_tilt_deg"] < 1.0
