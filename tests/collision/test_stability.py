"""The detector `stability`: parts stand, or something holds them, also in a turn."""

from __future__ import annotations

import pytest

from skillplan import load_problem
from skillplan.checks import Feasibility
from skillplan.collision import AabbDetector, StabilityDetector
from skillplan.pipeline import Setup

CELL = """
kind: assembly
name: cell
robot: {name: panda, home_m: [0.35, 0.0], safe_height_m: 0.35}
tools:
  gripper: {type: gripper, opening_m: 0.08, holder_m: [0.25, 0.4]}
  driver: {type: screwdriver, holder_m: [0.33, 0.4]}
initial_tool: gripper
fixtures:
  plate: {size_m: [0.10, 0.10, 0.01], at_m: [0.55, 0.0, 0.15]}
workholders:
  flip:
    pivot_m: [0.55, 0.0, 0.18]
    orientations:
      {up: {}, turned: {rpy_rad: [0, 0, 1.5707963]}, down: {rpy_rad: [3.14159265, 0, 0]}}
    fixtures: plate
holders:
  vise: {kind: clamp, parts: block FORCE}
  fork: {kind: hold, parts: arm}
parts:
  block:
    {tool: gripper, size_m: [0.06, 0.05, 0.03], start_m: [0.5, 0.3], goal_m: [0.55, 0.0],
     goal_on: plate, mass_kg: 0.5}
  arm:
    {tool: gripper, size_m: [0.12, 0.02, 0.02], start_m: [0.4, 0.3], goal_m: [0.60, 0.0],
     goal_on: block, mass_kg: 0.2}
screws:
  screw: {tool: driver, through: arm, into: block, hole_m: [0.55, 0.0], size: M3, length_m: 0.03}
"""
PLACED = ("placed(block)", "placed(arm)")


@pytest.fixture
def cell(tmp_path):
    """Return a task with a block on a plate that turns, and an arm that overhangs on the block."""

    def load(change=("FORCE", "")):
        path = tmp_path / "cell.yaml"
        path.write_text(CELL.replace(*change).replace("FORCE", ""))
        return load_problem(path).tasks[0]

    return load


def judge(detector, skill, *facts):
    """Return the reason of a verdict in the initial state with some facts added, or None."""
    task = detector.task
    state = task.initial | task.facts.of(*facts)
    gone = [fact.replace("placed", "at_start") for fact in facts if fact.startswith("placed")]
    state -= task.facts.of(*gone)
    if skill.startswith("place"):
        state -= task.facts.of(skill.replace("place", "at_start"))
    verdict = detector.check(task.skill(skill), state)
    assert verdict.applies_in(state)
    return None if verdict.is_feasible else verdict.reason


def test_one_of_several_grasps_is_decided_before_the_turn_that_the_place_needs(cell):
    """The verdict then rests on the orientation, which is another one."""
    grasps = "grasp: [{closing_axis: y}, {closing_axis: x}], orientation: turned, goal_on: plate"
    task = cell(("goal_on: plate", grasps))
    verdict = Feasibility(task, [StabilityDetector(task)]).verdict(
        task.skill("pick(block)"), task.initial
    )
    assert verdict.is_feasible
    assert task.facts.of("turned(flip.turned)").bits & verdict.absent.bits


def test_an_overhanging_part_needs_a_holder_until_its_screw_is_in(cell):
    detector = StabilityDetector(cell())
    tips = judge(detector, "place(arm)", "placed(block)", "held(arm)")
    assert tips == "'arm' tips towards +x: nothing bears it on that side"
    assert judge(detector, "place(arm)", "placed(block)", "held(arm)", "holds(fork.arm)") is None
    assert judge(detector, "release(arm)", *PLACED, "holds(fork.arm)") == tips
    # The screw makes one body of both, whose centre is above the plate.
    fastened = (*PLACED, "holds(fork.arm)", "fastened(screw)")
    assert judge(detector, "release(arm)", *fastened) is None


def test_what_turns_over_is_held_or_fixed_to_what_is(cell):
    detector = StabilityDetector(cell())
    loose = judge(detector, "turn(flip.down)", "placed(block)")
    assert loose.startswith("'block' ")
    assert loose.endswith(" while flip turns")
    assert judge(detector, "turn(flip.down)", "placed(block)", "holds(vise.block)") is None
    both = (*PLACED, "holds(vise.block)")
    assert judge(detector, "turn(flip.down)", *both).startswith("'arm' ")
    assert judge(detector, "turn(flip.down)", *both, "fastened(screw)") is None
    assert judge(detector, "turn(flip.down)", *both, "holds(fork.arm)") is None


def test_a_part_that_stands_may_turn_about_the_vertical(cell):
    assert judge(StabilityDetector(cell()), "turn(flip.turned)", "placed(block)") is None


def test_the_force_of_a_holder_bears_so_much_by_friction(cell):
    facts = (*PLACED, "fastened(screw)", "holds(vise.block)")
    weak = judge(StabilityDetector(cell(("FORCE", ", force_n: 10"))), "turn(flip.down)", *facts)
    assert weak == (
        "vise bears 6 N by friction with its force of 10 N, and block with all on it weighs 6.87 N "
        "while flip turns"
    )
    assert (
        judge(StabilityDetector(cell(("FORCE", ", force_n: 12"))), "turn(flip.down)", *facts)
        is None
    )
    # About the vertical the plate bears it.
    assert (
        judge(StabilityDetector(cell(("FORCE", ", force_n: 1"))), "turn(flip.turned)", *facts)
        is None
    )


def test_it_is_among_the_detectors_of_files_with_workholders_or_holders(cell):
    setup = Setup(collision=("aabb",))
    assert setup.detector_names(cell()) == "aabb,stability"
    alone = StabilityDetector(cell())
    words, room = alone.not_checked()
    assert words.endswith("only the stability of parts is checked")
    assert room.startswith("the room for the supports of block, arm")


def test_boxes_ask_for_a_support_of_a_part_that_is_let_go(cell):
    detector = AabbDetector(cell())
    assert judge(detector, "release(block)", "placed(block)", "holds(vise.block)") is None
    turned = ("placed(block)", "holds(vise.block)", "turned(flip.down)")
    task = detector.task
    state = task.initial | task.facts.of(*turned)
    state -= task.facts.of("turned(flip.up)", "at_start(block)")
    verdict = detector.check(task.skill("release(block)"), state)
    assert verdict.reason == "block has nothing beneath it"
    assert verdict.applies_in(state)
    assert "collisions while flip turns" in detector.not_checked()
