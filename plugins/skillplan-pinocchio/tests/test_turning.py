"""A product that turns with its workholder, and holders, among swept paths."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from skillplan import load_problem
from skillplan.task import Pose, Workholder
from skillplan_pinocchio import SweptDetector

CELL = """
kind: assembly
name: cell
robot: {name: panda, home_m: [0.35, 0.0], safe_height_m: 0.35}
tools: {gripper: {type: gripper, opening_m: 0.08, holder_m: [0.25, 0.4]}}
initial_tool: gripper
fixtures:
  plate: {size_m: [0.10, 0.10, 0.01], at_m: [0.55, 0.0, 0.15]}
  jaws: {size_m: [0.01, 0.04, 0.02], at_m: [0.585, 0.0, 0.16]}
  POST
workholders:
  flip:
    pivot_m: PIVOT
    orientations: {up: {}, down: {rpy_rad: [3.14159265, 0, 0]}}
    carries: block
    fixtures: plate
    stand_m: STAND
holders:
  vise: {kind: clamp, parts: block, fixtures: jaws}
  fork: {kind: hold, parts: arm}
parts:
  block:
    {tool: gripper, size_m: [0.06, 0.05, 0.03], start_m: [0.5, 0.3], goal_m: [0.55, 0.0],
     goal_on: plate}
  arm:
    {tool: gripper, size_m: [0.04, 0.02, 0.02], start_m: [0.4, 0.3], goal_m: [0.45, -0.2, 0.10]}
"""


@pytest.fixture
def cell(tmp_path):
    """Return a task whose plate carries a block over, and its detector."""

    def load(pivot=(0.55, 0.0, 0.165), stand=(0.35, 0.0), post=""):
        path = tmp_path / "cell.yaml"
        text = CELL.replace("PIVOT", str(list(pivot))).replace("STAND", str(list(stand)))
        path.write_text(text.replace("POST", post))
        (task,) = load_problem(path).tasks
        return task, SweptDetector(task)

    return load


def judge(task, detector, skill, *facts, without=()):
    """Return the reason of a verdict in the initial state with some facts changed, or None."""
    facts = task.facts.of(*facts)
    state = (task.initial | facts) - task.facts.of("at_start(block)", *without)
    verdict = detector.check(task.skill(skill), state)
    assert verdict.applies_in(state)
    return None if verdict.is_feasible else verdict.reason


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({}, None),
        ({"pivot": (0.55, 0.0, 0.085)}, "plate runs into the table on the turn"),
        (
            {"post": "post: {size_m: [0.02, 0.02, 0.25], at_m: [0.55, 0.061]}"},
            "plate runs into post on the turn",
        ),
        # Only the corners of the plate reach it, half-way through the turn.
        (
            {"post": "post: {size_m: [0.02, 0.02, 0.01], at_m: [0.55, 0.0, 0.106]}"},
            "plate runs into post on the turn",
        ),
        ({"post": "post: {size_m: [0.02, 0.02, 0.01], at_m: [0.55, 0.0, 0.10]}"}, None),
        (
            {"stand": (0.55, 0.0), "pivot": (0.55, 0.0, 0.26)},
            "plate runs into a finger on the turn",
        ),
    ],
)
def test_what_turns_passes_all_that_stays(cell, changes, reason):
    task, detector = cell(**changes)
    assert judge(task, detector, "turn(flip.down)", "placed(block)") == reason


def test_a_part_at_its_start_is_in_the_way_until_it_is_gone(cell):
    task, detector = cell(pivot=(0.5, 0.15, 0.10))
    reason = judge(task, detector, "turn(flip.down)", "placed(block)")
    assert reason.endswith(" on the turn")


def test_a_holder_bears_its_part_until_it_lets_go(cell):
    task, detector = cell()
    coming = ("held(arm)",), ("at_start(arm)", "hand_free")
    alone = judge(task, detector, "place(arm)", *coming[0], without=coming[1])
    assert alone == "arm has nothing beneath it"
    held = judge(task, detector, "place(arm)", *coming[0], "holds(fork.arm)", without=coming[1])
    assert held is None
    placed = ("placed(arm)", "holds(fork.arm)")
    dropped = judge(task, detector, "release(arm)", *placed, without=("at_start(arm)",))
    assert dropped == "arm has nothing beneath it"
    empty = judge(task, detector, "release(arm)", "holds(fork.arm)")
    assert empty is None


def test_jaws_need_room_to_close_in_each_orientation(cell):
    task, detector = cell()
    assert judge(task, detector, "clamp(block)", "placed(block)") is None
    # Turned by half a turn about x, the jaws are below the plate.
    task, detector = cell(post="post: {size_m: [0.01, 0.02, 0.07], at_m: [0.585, 0.0, 0.09]}")
    assert judge(task, detector, "clamp(block)", "placed(block)") is None
    down = {"without": ("turned(flip.up)",)}
    facts = ("placed(block)", "turned(flip.down)")
    reason = judge(task, detector, "clamp(block)", *facts, **down)
    assert reason == "jaws runs into post on closing"


angles = st.lists(st.floats(-math.pi, math.pi), min_size=3, max_size=3)
places = st.tuples(*[st.floats(-1, 1)] * 3)


@settings(max_examples=examples(30))
@given(angles, angles, places, places, st.floats(0, 1))
def test_a_turn_is_rigid_and_leads_from_one_orientation_to_the_other(
    begin, end, pivot, point, share
):
    motions = {}
    for name, rpy_rad in (("a", begin), ("b", end)):
        turned = Pose.turned((0.0, 0.0, 0.0), tuple(rpy_rad))
        place = np.array(pivot) - np.array(turned.rotate(pivot))
        motions[name] = Pose(tuple(place.tolist()), turned.orientation)
    flip = Workholder("flip", pivot, motions)
    start, stop = motions["a"].apply(point), motions["b"].apply(point)
    assert np.allclose(flip.turn("a", "b", 0.0).apply(start), start, atol=1e-9)
    assert np.allclose(flip.turn("a", "b", 1.0).apply(start), stop, atol=1e-6)
    between = flip.turn("a", "b", share).apply(start)
    assert math.isclose(math.dist(between, pivot), math.dist(start, pivot), abs_tol=1e-9)
