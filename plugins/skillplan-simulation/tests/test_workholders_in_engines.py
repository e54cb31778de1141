"""Products that are held, turned over, let go and put together, in both engines."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import pytest
import yaml

from skillplan.pipeline import load_problem, registry
from skillplan_pinocchio import SweptDetector
from thinned import slow_case

CONFIGS = Path(__file__).parents[3] / "configs"
ENGINES = [slow_case("mujoco", reason="an engine"), slow_case("pybullet", reason="an engine")]


def make_engine(engine, path, *facts):
    """Return an engine and a task that begins with some facts, the arm at home.

    Back ends are not queried about faults of the file, which takes longer than the simulation.
    """
    task = load_problem(path, {"physics": (), "collision": ()}).task
    known = [fact for fact in ("fixed", "at(home)") if fact in task.facts]
    task = task.replace(initial=task.facts.of(*known, *facts))
    return registry.load("physics", engine)(task), task


def perform(engine, task, *names):
    """Return the performance of some skills, and its rows."""
    rows = []
    return engine.perform([task.skill(name) for name in names], note=rows.append), rows


@pytest.mark.parametrize("engine", ENGINES)
def test_a_turn_moves_what_is_fixed_and_names_what_is_loose(engine, tmp_path):
    """Halfway the chassis stands on edge beside the pivot; the screw keeps the cover on it."""
    cell = yaml.safe_load((CONFIGS / "cell_turn.yaml").read_text())
    jaw = {"size_m": [0.008, 0.02, 0.018], "centre_m": [0.0642, 0.0, 0.009]}
    cell["fixtures"]["jaw"] = {"boxes": [jaw], "at_m": [0.50, 0.0, 0.162]}
    cell["holders"]["vise"]["fixtures"] = "jaw"
    del cell["parts"]["foot"], cell["screws"]["bottom"], cell["expect"]
    path = tmp_path / "cell.yaml"
    path.write_text(yaml.safe_dump(cell, sort_keys=False))
    loose = ("hand_free", "tool(driver)", "turned(flip.up)", "placed(chassis)", "placed(cover)")
    fixed = (*loose, "holds(vise.chassis)", "fastened(top)")
    physics, task = make_engine(engine, path, *loose, "fastened(top)", "open(vise)")
    done, rows = perform(physics, task, "clamp(chassis)", "turn(flip.down)")
    assert done.failed is None
    assert {arrival.body for arrival in done.arrivals} >= {"chassis", "cover", "top", "jaw"}
    assert max(arrival.offset_m for arrival in done.arrivals) < 2e-4
    poses = [row.bodies["chassis"] for row in rows if row.skill == "turn(flip.down)"]
    away_m = [math.dist(pose.position, (0.5, 0.0, 0.17)) for pose in poses]
    assert max(away_m) - min(away_m) < 1e-4
    edge = min(poses, key=lambda pose: abs(pose.rotate((0.0, 0.0, 1.0))[2]))
    assert math.dist(edge.position, poses[0].position) == pytest.approx(
        0.01 * math.sqrt(2), abs=1e-3
    )
    assert max(math.dist(a.position, b.position) for a, b in pairwise(poses)) < 4e-4
    turn = task.skill("turn(flip.down)")
    unscrewed = physics.check(turn, task.facts.of("at(home)", "fixed", *fixed[:-1]))
    assert unscrewed.reason.startswith("cover came to rest 15")
    assert "where the turn to flip.down takes it" in unscrewed.reason
    assert "fastened(top)" in unscrewed.absent
    assert "holds(vise.chassis)" in unscrewed.present
    unheld = physics.check(turn, task.facts.of("at(home)", "fixed", *loose))
    assert unheld.reason.startswith("chassis came to rest 1")


@pytest.mark.parametrize("engine", ENGINES)
def test_a_holder_keeps_a_part_that_comes_later_until_it_must_stand(engine):
    """Without holder and screw, the arm tips off its column."""
    placed = ("tool(gripper)", "placed(column)", "hand_free", "placed(arm)", "holds(fork.arm)")
    physics, task = make_engine(engine, CONFIGS / "cell_hold.yaml", *placed)
    known = ("at(home)", "tool(gripper)", "placed(column)")
    comes = task.facts.of("held(arm)", *known)
    set_early = task.facts.of("at_start(arm)", "hand_free", "holds(fork.arm)", *known)
    assert physics.check(task.skill("pick(arm)"), set_early).is_feasible
    place = task.skill("place(arm)")
    assert physics.check(place, comes | task.facts.of("holds(fork.arm)")).is_feasible
    assert "arm came to rest" in physics.check(place, comes).reason
    release = task.skill("release(arm)")
    assert physics.check(release, task.initial | task.facts.of("fastened(screw)")).is_feasible
    assert "arm came to rest 20" in physics.check(release, task.initial).reason
    fallen = perform(physics, task, "release(arm)")[0].failed
    assert "where it stood" in fallen.verdict.reason


@pytest.mark.parametrize("engine", ENGINES)
def test_a_joined_part_is_where_its_members_were(engine):
    members = ("block", "coil", "lid", "lid_screw")
    placed = [f"placed({name})" for name in members[:-1]]
    single = [f"single({name})" for name in members]
    known = ("hand_free", "tool(gripper)", "apart(valve)", "fastened(lid_screw)")
    path = CONFIGS / "cell_subassembly.yaml"
    physics, task = make_engine(engine, path, *known, *placed, *single)
    done, rows = perform(physics, task, "join(valve)")
    assert done.failed is None
    assert not set(members) & rows[-1].bodies.keys()
    stood, joined = rows[0].bodies["block"], rows[-1].bodies["valve"]
    assert math.dist(joined.position, stood.position) < 1e-4
    keeps = "whether the members of valve keep together while they are carried: "
    for back_end in (physics, SweptDetector(task)):
        assert any(sentence.startswith(keeps) for sentence in back_end.not_checked())


# A shelf of 20.5 mm, open along x, and a board of 20 mm that a cup pushes in.
DRAWER = """
kind: assembly
name: drawer
robot: {name: panda, model: panda, home_m: [0.4, 0.0], safe_height_m: 0.25}
tools: {cup: {type: suction, holder_m: [0.3, -0.4], cup_diameter_m: 0.02}}
initial_tool: cup
parts:
  shelf:
    fixed: true
    mass_kg: 1.0
    goal_m: [0.5, 0.1]
    boxes:
    - {size_m: [0.04, 0.08, 0.02], centre_m: [0.0, 0.0, 0.01]}
    - {size_m: [0.04, 0.08, 0.02], centre_m: [0.0, 0.0, 0.0505]}
    - {size_m: [0.04, 0.01, 0.0205], centre_m: [0.0, -0.035, 0.03025]}
    - {size_m: [0.04, 0.01, 0.0205], centre_m: [0.0, 0.035, 0.03025]}
  board:
    tool: cup
    grasp: {at_m: [0.055, 0.0]}
    mass_kg: 0.3
    boxes: [{size_m: [0.15, 0.0596, 0.02], centre_m: [0.0, 0.0, 0.01]}]
    start_m: [0.5, -0.2]
    goal_m: [0.512, 0.1, 0.02]
    goal_on: [shelf]
    insert_along: [[-1.0, 0.0, 0.0]]
holders: {fork: {kind: hold, parts: board, stays: true}}
"""


@pytest.mark.parametrize("engine", ENGINES)
def test_a_cup_brings_a_part_level_and_to_its_holder(engine, tmp_path):
    """The gap of the lip is there all the way, and when the holder takes the part."""
    path = tmp_path / "drawer.yaml"
    path.write_text(DRAWER)
    start = load_problem(path, {"physics": (), "collision": ()}).task.initial
    physics, task = make_engine(engine, path, *start)
    done, _ = perform(physics, task, "pick(board)", "place(board)")
    assert done.failed is None
    assert max(arrival.offset_m for arrival in done.arrivals) < 2e-4
