"""Hands that point anywhere, and parts and screws that go in from the side."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from situations import assembly
from skillplan.physics import plan_linear_motions
from skillplan.task import Pose, Task, Verdict, cross, unit
from skillplan_pinocchio import (
    ArmModel,
    Strokes,
    SweptDetector,
    Unreachable,
    iterate_postures,
    iterate_strokes,
    make_hand_pose,
)

# A drawer with a knob at its front, which the hand pushes onto a cabinet by.
DRAWER: dict[str, Any] = {
    "kind": "assembly",
    "name": "drawer",
    "robot": {"home_m": [0.35, 0.0], "safe_height_m": 0.28},
    "tools": {
        "gripper": {"type": "gripper", "holder_m": [0.3, 0.4]},
        "driver": {"type": "screwdriver", "holder_m": [0.3, 0.5]},
    },
    "initial_tool": "gripper",
    "feeders": {"tray": {"position_m": [0.4, -0.25], "height_m": 0.12}},
    "parts": {
        "cabinet": {
            "tool": "gripper",
            "mass_kg": 0.6,
            "size_m": [0.09, 0.11, 0.12],
            "grasp": {"type": "suction"},
            "start_m": [0.6, -0.1],
            "goal_m": [0.55, 0.2],
        },
        "drawer": {
            "tool": "gripper",
            "boxes": [
                {"size_m": [0.06, 0.09, 0.03], "centre_m": [0.0, 0.0, 0.015]},
                {"size_m": [0.024, 0.02, 0.016], "centre_m": [-0.042, 0.0, 0.016]},
            ],
            "grasp": {"type": "jaws", "approach": [1, 0, 0], "closing_axis": "y"},
            "feeder": "tray",
            "goal_m": [0.545, 0.2],
            "goal_on": "cabinet",
            "insert_along": [1, 0, 0],
            "insert_m": 0.1,
        },
    },
    "screws": {
        "screw": {
            "tool": "driver",
            "hole_m": [0.505, 0.2, 0.1],
            "through": "cabinet",
            "axis": [1, 0, 0],
        }
    },
}
PLACED = ("placed(cabinet)", "held(drawer)", "tool(gripper)", "at(home)")


def task_with(**parts: Any) -> Task:
    content = copy.deepcopy(DRAWER)
    content["parts"].update(parts)
    return assembly(content)


def verdict_on(task: Task, skill: str, *facts: str) -> Verdict:
    return SweptDetector(task).check(task.skill(skill), task.facts.of(*facts))


def test_a_drawer_is_pushed_in_from_the_side():
    assert verdict_on(task_with(), "place(drawer)", *PLACED).is_feasible


def test_a_hand_does_not_go_back_through_a_wall_of_the_part_that_it_let_go():
    boxes = [
        {"size_m": [0.12, 0.03, 0.02], "centre_m": [0.0, 0.0, 0.01]},
        {"size_m": [0.01, 0.03, 0.1], "centre_m": [0.055, 0.0, 0.05]},
    ]
    grasp = {"type": "jaws", "closing_axis": "y", "at_m": [-0.02, 0.0], "depth_m": 0.09}
    for along, passes in ((1, True), (-1, False)):
        part = {"tool": "gripper", "boxes": boxes, "grasp": grasp, "feeder": "tray"}
        part |= {"goal_m": [0.45, 0.0], "insert_along": [along, 0, 0], "insert_m": 0.1}
        task = task_with(drawer=part)
        verdict = verdict_on(task, "place(drawer)", *PLACED)
        assert verdict.is_feasible is passes
        assert passes or verdict.reason == "the hand runs into drawer on the retreat"


def test_a_hand_that_is_above_safe_height_already_has_no_retreat_to_check():
    content = copy.deepcopy(DRAWER)
    content["feeders"]["tray"]["height_m"] = 0.35
    verdict = verdict_on(
        assembly(content), "pick(drawer)", "hand_free", "tool(gripper)", "at(home)"
    )
    assert verdict.is_feasible


@pytest.mark.slow(reason="a scene more; the drawer itself in every run")
def test_what_stands_where_the_drawer_goes_in_blocks_the_insertion():
    """Straight down beside it, it would have passed."""
    box = {
        "tool": "gripper",
        "size_m": [0.03, 0.03, 0.14],
        "start_m": [0.6, -0.3],
        "goal_m": [0.47, 0.2],
    }
    task = task_with(post=box)
    verdict = verdict_on(task, "place(drawer)", *PLACED, "placed(post)")
    assert verdict.is_infeasible
    assert "post" in verdict.evidence["bodies"]
    assert "placed(post)" in verdict.facts
    assert verdict_on(task, "place(drawer)", *PLACED, "at_start(post)").is_feasible


@pytest.mark.slow(reason="a scene more; by physics in every run")
def test_a_screw_is_driven_along_its_axis_into_what_is_there():
    """Its head lies against the cabinet's side, which supports it along the axis."""
    task = task_with()
    there = ("placed(cabinet)", "tool(driver)", "hand_free", "at(home)")
    assert verdict_on(task, "fasten(screw)", *there).is_feasible
    away = ("at_start(cabinet)", "tool(driver)", "hand_free", "at(home)")
    verdict = verdict_on(task, "fasten(screw)", *away)
    assert verdict.is_infeasible
    assert "screw has nothing beneath it" in verdict.reason


def test_the_tip_follows_the_stretches_of_the_motion():
    """And the hand is not turned on them."""
    task = task_with()
    arm = ArmModel((0.0, 0.0, 0.0))
    state = task.facts.of(*PLACED)
    (motion,) = plan_linear_motions(task, task.skill("place(drawer)"), state, 0.001)
    iterate_stroke = next(
        item for item in iterate_strokes(arm, motion) if isinstance(item, Strokes)
    )
    assert [len(iterate_stroke.down), len(iterate_stroke.up)] == [2, 2]
    for path, (begin, end) in zip(
        (*iterate_stroke.down, *iterate_stroke.up),
        [motion.approach[:2], motion.approach[1:], motion.retreat[:2], motion.retreat[1:]],
        strict=True,
    ):
        for share in (0.0, 0.3, 0.5, 0.9, 1.0):
            position, rotation = arm.tip(path.at(share))
            line = np.array(begin) + share * (np.array(end) - np.array(begin))
            off_m = np.linalg.norm(np.cross(position - line, unit_of(begin, end)))
            assert off_m < 1e-4
            assert rotation[:, 2] == pytest.approx(np.array(motion.points), abs=2e-3)


def unit_of(begin: Any, end: Any) -> Any:
    along = np.array(end) - np.array(begin)
    return along / np.linalg.norm(along)


def test_a_hand_that_cannot_point_there_is_said_with_its_direction():
    result = next(
        iterate_postures(ArmModel(), make_hand_pose((1.5, 0.0, 0.2), (0.0, 0.0, 0.0, 1.0)))
    )
    assert isinstance(result, Unreachable)
    assert "cannot point along (0.00, 0.00, 1.00) at (1.500, 0.000, 0.200)" in result.reason


directions = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)).filter(
    lambda v: sum(x * x for x in v) > 0.1
)


@given(directions, directions)
def test_every_posture_brings_the_hand_there_within_the_joints_limits(points, aside):
    along = unit(points)
    across = cross(along, aside)
    if sum(x * x for x in across) < 1e-4:
        return
    arm = ArmModel()
    target = make_hand_pose(
        (0.45, 0.2, 0.35), Pose.of_axes((0, 0, 0), unit(across), along).orientation
    )
    for joints in iterate_postures(arm, target):
        if isinstance(joints, Unreachable):
            continue
        position, rotation = arm.tip(joints)
        assert position == pytest.approx(np.array([0.45, 0.2, 0.35]), abs=1e-6)
        assert rotation[:, 2] == pytest.approx(np.array(along), abs=1e-6)
        assert abs(rotation[:, 1] @ np.array(unit(across))) == pytest.approx(1, abs=1e-6)
        assert (joints >= arm.low_rad).all()
        assert (joints <= arm.high_rad).all()


def test_a_shank_runs_into_its_own_part_anywhere_but_in_the_hole():
    """A ledge over the hole in the side of a post is in the way of the shank, not of the head."""
    ledge = {"size_m": [0.03, 0.06, 0.01], "centre_m": [-0.045, 0.0, 0.185]}
    boxes = [{"size_m": [0.06, 0.06, 0.2], "centre_m": [0.0, 0.0, 0.1]}, ledge]
    content: dict[str, Any] = {
        "kind": "assembly",
        "name": "side",
        "robot": {"model": "ur10e", "home_m": [0.6, -0.24], "safe_height_m": 0.35},
        "tools": {
            "driver": {
                "type": "screwdriver",
                "length_m": 0.2,
                "bit_length_m": 0.1,
                "holder_m": [0.55, 0.5],
            }
        },
        "initial_tool": "driver",
        "feeders": {"rack": {"position_m": [0.45, -0.4], "height_m": 0.06}},
        "screws": {
            "side": {
                "tool": "driver",
                "feeder": "rack",
                "through": "post",
                "hole_m": [0.72, 0.0, 0.1],
                "axis": [1, 0, 0],
                "size": "M3",
                "length_m": 0.05,
            }
        },
    }
    free = ("hand_free", "tool(driver)", "at(home)", "placed(post)")
    for shapes, hits in ((boxes, True), (boxes[:1], False)):
        content["parts"] = {"post": {"fixed": True, "goal_m": [0.75, 0.0], "boxes": shapes}}
        verdict = verdict_on(assembly(content), "fasten(side)", *free)
        assert verdict.is_infeasible == hits
        assert not hits or "the shank of side runs into post on the approach" in verdict.reason
