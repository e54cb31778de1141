"""Approach, act and retreat of a hand that goes in from any side."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from situations import assembly, config_content, fetching_board
from skillplan.physics import KinematicEngine, LinearMotion, plan_linear_motions
from skillplan.task import (
    AXES,
    DOWN,
    Grasp,
    GraspKind,
    Motion,
    Pose,
    Route,
    Task,
    Visit,
    dot,
    plus,
    unit,
)
from skillplan.testing import EngineSuite

BAR = {
    "kind": "assembly",
    "name": "bar",
    "robot": {"home_m": [0.4, 0.0], "safe_height_m": 0.2},
    "tools": {"gripper": {"holder_m": [0.6, 0.3]}},
    "initial_tool": "gripper",
    "parts": {
        "bar": {
            "tool": "gripper",
            "size_m": [0.02, 0.06, 0.02],
            "start_m": [0.4, -0.2],
            "goal_m": [0.5, 0.1],
        }
    },
}
LEVEL = Pose.turned((0.5, 0.1, 0.05), (0.0, math.pi / 2, 0.0))
BY_ITS_END = Grasp(
    GraspKind.JAWS, (0.0, 0.0, 0.015), AXES["x"], 0.02, approach=DOWN, name="by its end"
)


def task_with(visit: Visit, board: Mapping[str, Any] = BAR) -> Task:
    """Return the bar's task with another visit of its place."""
    task = assembly(board)
    place = task.skill("place(bar)")
    motion = Motion("robot", (Route(task.facts.none, (visit,)),), "bar")
    skills = tuple(
        replace(skill, motion=motion) if skill.name == place.name else skill
        for skill in task.skills
    )
    return replace(task, skills=skills)


def motion_of(
    visit: Visit, drop_height_m: float = 0.001, board: Mapping[str, Any] = BAR
) -> LinearMotion:
    task = task_with(visit, board)
    state = task.facts.of("held(bar)", "tool(gripper)", "at(home)")
    (result,) = plan_linear_motions(task, task.skill("place(bar)"), state, drop_height_m)
    return result


def place_of(**changes: object) -> Visit:
    (visit,) = assembly(BAR).skill("place(bar)").motion.routes[0].visits
    return replace(visit, **changes)


def test_straight_down_is_one_stretch_and_one_back():
    motion = motion_of(place_of())
    assert motion.is_vertical
    assert motion.approach == motion.retreat[::-1]
    assert motion.tip[2] - motion.grasp_tip[2] == pytest.approx(0.001)


def test_the_last_stretch_follows_the_direction_of_insertion_and_the_first_back_too():
    along = unit((-1.0, 0.0, 0.0))
    across = Grasp(GraspKind.JAWS, (0.0, 0.0, 0.01), AXES["y"], 0.06)
    motion = motion_of(place_of(along=along, insert_m=0.08, grasp=across))
    above, entry, tip = motion.approach
    assert plus(tip, entry, -1.0) == pytest.approx((-0.08, 0.0, 0.0))
    assert above[:2] == pytest.approx(entry[:2])
    assert motion.retreat == (tip, entry, above)


def test_what_goes_in_from_the_side_is_not_dragged_over_what_it_will_lie_on():
    """And what goes in from below is not dropped."""
    sideways = place_of(along=(-1.0, 0.0, 0.0), insert_m=0.08)
    motion = motion_of(sideways)
    assert motion.drop_m == 0.0003
    assert {point[2] for point in motion.approach[1:]} == {motion.grasp_tip[2] + 0.0003}
    assert motion_of(place_of(along=(0.0, 0.0, 1.0), insert_m=0.08)).drop_m == 0.0


def test_a_pin_from_the_side_is_lifted_no_more_than_its_hole_allows():
    block = {"size_m": [0.03, 0.03, 0.03], "goal_m": [0.3, 0.1], "fixed": True}
    fitted = {"fits": {"block": {"kind": "clearance", "drawn_m": 0.0001}}}
    board = {**BAR, "parts": {"bar": BAR["parts"]["bar"] | fitted, "block": block}}
    sideways = place_of(along=(-1.0, 0.0, 0.0), insert_m=0.08)
    assert motion_of(sideways, board=board).drop_m == 0.0001


def test_the_hand_is_turned_with_the_part():
    motion = motion_of(place_of(pose=LEVEL, grasp=BY_ITS_END))
    assert motion.points == pytest.approx((-1.0, 0.0, 0.0), abs=1e-9)
    assert not motion.points_down
    assert motion.grasp_tip == pytest.approx(LEVEL.apply(BY_ITS_END.tip))


def test_jaws_that_close_along_the_insertion_go_back_as_they_point():
    """Else one of them would take the part along."""
    sideways = place_of(along=(-1.0, 0.0, 0.0), insert_m=0.08)
    crossing = replace(sideways, grasp=replace(BY_ITS_END, closing=AXES["y"], width_m=0.06))
    assert motion_of(crossing).retreat[1][0] == pytest.approx(motion_of(crossing).tip[0] + 0.08)
    along = replace(sideways, grasp=BY_ITS_END)
    assert motion_of(along).retreat[1][:2] == pytest.approx(motion_of(along).tip[:2])
    assert motion_of(along).retreat[1][2] > motion_of(along).tip[2]


def test_jaws_that_held_a_wall_of_a_frame_go_back_as_they_point():
    """Else the one inside would take the frame along."""
    walls = [
        {"size_m": size_m, "centre_m": [side * x_m, side * y_m, 0.01]}
        for side in (-1, 1)
        for size_m, x_m, y_m in (
            ([0.01, 0.06, 0.02], 0.025, 0.0),
            ([0.04, 0.01, 0.02], 0.0, 0.025),
        )
    ]
    bar = {key: value for key, value in BAR["parts"]["bar"].items() if key != "size_m"}
    frame = {**BAR, "parts": {"bar": {**bar, "boxes": walls}}}
    across = Grasp(GraspKind.JAWS, (0.0, -0.025, 0.01), AXES["y"], 0.01)
    for grasp, goes_back in (
        (across, False),
        (replace(across, tip=(0, 0, 0.01), width_m=0.06), True),
    ):
        sideways = place_of(along=(-1.0, 0.0, 0.0), insert_m=0.08, grasp=grasp)
        motion = motion_of(sideways, board=frame)
        assert (motion.retreat[1] == motion.approach[1]) == goes_back
        assert (motion.retreat[1][:2] == motion.tip[:2]) != goes_back


def test_a_cup_before_a_wall_of_its_part_goes_up():
    """Else it would push the part out again."""
    bar = {key: value for key, value in BAR["parts"]["bar"].items() if key != "size_m"}
    foot = {"size_m": [0.06, 0.06, 0.01], "centre_m": [0.0, 0.0, 0.005]}
    for x_m, goes_back in ((0.025, False), (-0.025, True)):
        wall = {"size_m": [0.01, 0.06, 0.05], "centre_m": [x_m, 0.0, 0.035]}
        bracket = {**BAR, "parts": {"bar": {**bar, "boxes": [foot, wall]}}}
        cup = Grasp(GraspKind.SUCTION, (0.0, 0.0, 0.01), AXES["y"])
        sideways = place_of(along=(-1.0, 0.0, 0.0), insert_m=0.08, grasp=cup)
        motion = motion_of(sideways, board=bracket)
        assert (motion.retreat[1] == motion.approach[1]) == goes_back
        assert (motion.retreat[1][:2] == motion.tip[:2]) != goes_back


directions = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 0.2)).filter(
    lambda v: math.hypot(*v) > 0.1
)
turns = st.tuples(*[st.floats(-math.pi, math.pi)] * 3)


@given(directions, turns, st.floats(0.01, 0.3))
def test_from_any_side_the_tip_ends_where_the_part_is_held_at_its_goal(
    direction, rpy_rad, insert_m
):
    along = unit(direction)
    pose = Pose.turned((0.5, 0.1, 0.05), rpy_rad)
    motion = motion_of(place_of(pose=pose, along=along, insert_m=insert_m, grasp=BY_ITS_END))
    assert motion.grasp_tip == pytest.approx(pose.apply(BY_ITS_END.tip), abs=1e-9)
    assert motion.approach[-1] == motion.tip == motion.retreat[0]
    y, z = motion.hand.rotate(AXES["y"]), motion.points
    assert z == pytest.approx(pose.rotate(DOWN), abs=1e-6)
    assert y == pytest.approx(pose.rotate(AXES["x"]), abs=1e-6)
    if len(motion.approach) == 3:
        stretch = plus(motion.tip, motion.approach[1], -1.0)
        assert dot(stretch, along) == pytest.approx(insert_m, abs=1e-9)
        assert math.hypot(*stretch) == pytest.approx(insert_m, abs=1e-9)


@given(turns)
def test_above_a_target_nothing_of_the_load_is_below_the_safe_height(rpy_rad):
    pose = Pose.turned((0.5, 0.1, 0.05), rpy_rad)
    motion = motion_of(place_of(pose=pose, grasp=BY_ITS_END), drop_height_m=0.0)
    body = assembly(BAR).scene.body("bar")
    lifted = pose.moved(plus(motion.above, motion.tip, -1.0))
    assert -body.reach_m(lifted, DOWN) >= 0.2 - 1e-9


@given(height_m=st.floats(0, 0.1), head_mm=st.floats(0.5, 20))
def test_a_bit_fetches_a_screw_by_its_head_that_stands_on_the_feeder(height_m, head_mm):
    """As parts stand on theirs: otherwise the head would be in whatever bears the feeder."""
    task = assembly(fetching_board(height_m, head_mm=(6.0, head_mm)))
    state = task.facts.of("placed(plate)", "hand_free", "tool(screwdriver)", "at(home)")
    fetching, _ = plan_linear_motions(task, task.skill("fasten(screw)"), state)
    assert fetching.tip == pytest.approx((0.45, 0.25, height_m + head_mm / 1000))
    assert fetching.leaves_with == "screw"


# The reference engine: reach.


class TestKinematicEngine(EngineSuite):
    engine = "kinematic"


def test_a_part_beyond_reach_cannot_be_picked():
    """The verdict gives the figures, and rests on no fact: it is so in every state."""
    content = config_content("inverter_board")
    content["robot"]["reach_m"] = 0.5
    task = assembly(content)
    verdict = KinematicEngine(task).check(task.skill("pick(brace)"), task.initial)
    assert verdict.is_infeasible
    assert verdict.evidence["reach_m"] == 0.5
    # At safe height, gripped at the top: the farther of the two via points.
    assert verdict.evidence["distance_m"] == pytest.approx((0.58**2 + 0.006**2 + 0.196**2) ** 0.5)
    assert verdict.facts == []
    assert KinematicEngine(task).check(task.skill("pick(pcb)"), task.initial).is_feasible


def test_reach_is_measured_from_the_base():
    """A base beside the part reaches it."""
    content = config_content("inverter_board")
    content["robot"] |= {"reach_m": 0.5, "base_m": [0.4, 0.0, 0.0]}
    task = assembly(content)
    assert KinematicEngine(task).check(task.skill("pick(brace)"), task.initial).is_feasible
    content["robot"] |= {"base_m": [-0.4, 0.0, 0.0]}
    task = assembly(content)
    assert KinematicEngine(task).check(task.skill("pick(brace)"), task.initial).is_infeasible


def test_a_holder_beyond_reach_matters_only_on_the_way_that_visits_it():
    """What is put back depends on the tool in hand: that is the fact it rests on."""
    content = config_content("inverter_board")
    content["tools"]["far"] = {"holder_m": [0.9, 0.0]}
    task = assembly(content)
    engine, load = KinematicEngine(task), task.replace(skills=task.skills).skill("load(gripper)")
    far = task.facts.of("tool(far)", "hand_free", "at(home)")
    near = task.facts.of("tool(screwdriver)", "hand_free", "at(home)")
    assert engine.check(load, far).facts == ["tool(far)"]
    assert engine.check(load, far).is_infeasible
    assert engine.check(load, near).is_feasible


def test_a_hand_from_the_side_has_to_reach_where_it_begins_to_go_in():
    """Half a metre beside the goal, on the far side from the base."""
    content = config_content("inverter_board")
    content["parts"]["clock"]["goal_m"] = [0.56, 0.06]
    task = assembly(content)
    place = task.skill("place(clock)")
    (visit,) = place.motion.routes[0].visits
    from_afar = replace(visit, along=(-1.0, 0.0, 0.0), insert_m=0.5)
    motion = replace(place.motion, routes=(replace(place.motion.routes[0], visits=(from_afar,)),))
    state = task.facts.of("held(clock)", "tool(gripper)", "at(home)")
    assert KinematicEngine(task).check(place, state).is_feasible
    verdict = KinematicEngine(task).check(replace(place, motion=motion), state)
    assert verdict.is_infeasible
    assert verdict.evidence["via_point_m"][0] == pytest.approx(0.56 + 0.5)
