"""Geometry as a function of the state."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skillplan.pipeline import make_model
from skillplan.task import Body, Box, Facts, Placement, Pose, Robot, Scene
from skillplan.testing import reachable_states

BOX = Box((0.1, 0.2, 0.3), (0.0, 0.0, 0.15))


def test_a_pose_is_finite_and_its_quaternion_a_rotation():
    """Both checks of its constructor."""
    with pytest.raises(ValueError, match="finite"):
        Pose((0.0, math.nan, 0.0))
    with pytest.raises(ValueError, match="finite"):
        Pose((0.0, 0.0, 0.0), (0.0, 0.0, math.inf, 1.0))
    with pytest.raises(ValueError, match="unit length"):
        Pose((0.0, 0.0, 0.0), (0.0, 0.0, 1.0, 1.0))


@pytest.mark.parametrize("extent", [0.0, -0.1, math.nan, math.inf])
def test_a_box_has_positive_extents(extent):
    """Along every axis."""
    with pytest.raises(ValueError, match="extents must be > 0"):
        Box((0.1, extent, 0.1), (0.0, 0.0, 0.0))


def test_a_body_has_boxes_and_mass():
    """Both checks of its constructor."""
    with pytest.raises(ValueError, match="'a' needs at least one shape"):
        Body("a", (), (), 1.0)
    for mass_kg in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(ValueError, match="mass must be > 0 kg"):
            Body("a", (BOX,), (), mass_kg)


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_a_robot_has_reach_and_a_safe_height(value):
    """Both are positive."""
    with pytest.raises(ValueError, match="reach_m must be > 0"):
        Robot("arm", (0, 0, 0), value, 0.2, {})
    with pytest.raises(ValueError, match="safe_height_m must be > 0"):
        Robot("arm", (0, 0, 0), 0.8, value, {})


def test_a_scene_has_distinct_names():
    """Of bodies, and of robots."""
    body, robot = Body("a", (BOX,), (), 1.0), Robot("arm", (0, 0, 0), 0.8, 0.2, {})
    with pytest.raises(ValueError, match="bodies must have distinct names"):
        Scene((body, body), ())
    with pytest.raises(ValueError, match="robots must have distinct names"):
        Scene((), (robot, robot))


@given(st.floats(-math.pi + 1e-6, math.pi))
def test_an_upright_pose_keeps_its_yaw(yaw_rad):
    """Quaternions are (x, y, z, w); a quarter turn takes x to y."""
    pose = Pose.upright((1.0, 2.0, 3.0), yaw_rad)
    x, y, z, w = pose.orientation
    assert (x, y) == (0.0, 0.0)
    assert math.hypot(z, w) == pytest.approx(1.0)
    assert pose.yaw_rad == pytest.approx(yaw_rad, abs=1e-9)
    # q * (1, 0, 0) * conj(q) in the plane.
    assert (1 - 2 * z * z, 2 * w * z) == pytest.approx((math.cos(yaw_rad), math.sin(yaw_rad)))


def test_a_body_is_as_high_as_its_highest_box():
    """Above its origin."""
    bridge = Body("a", (BOX, Box((0.1, 0.1, 0.02), (0.0, 0.0, 0.4))), (), 1.0)
    assert bridge.height_m == pytest.approx(0.41)


def test_a_robot_says_where_it_stands_and_what_it_holds():
    """Or that the state does not tell."""
    facts = Facts(("at(home)", "placed(a)"))
    robot = Robot("arm", (0, 0, 0), 0.8, 0.2, {"at(home)": (0.3, 0.1, 0.9)})
    assert robot.place(facts.of("at(home)")) == ("at(home)", (0.3, 0.1, 0.2))
    assert robot.tool(facts.none) is None
    with pytest.raises(ValueError, match="gives no place of 'arm'"):
        robot.place(facts.none)


def test_a_body_of_which_no_fact_tells_is_left_out():
    """A screw in its magazine is nowhere."""
    facts = Facts(("placed(a)",))
    pose = Pose((1.0, 0.0, 0.0))
    scene = Scene((Body("a", (BOX,), (Placement("placed(a)", pose),), 1.0),), ())
    assert scene.at(facts.none) == {}
    assert scene.at(facts.of("placed(a)")) == {"a": pose}


@pytest.mark.parametrize("config", ["board_task", "motor_drive_task"])
def test_every_reachable_state_gives_every_body_one_pose(config, request):
    """At its start, at its goal, or at the tip of the arm that stands where the state says."""
    task = request.getfixturevalue(config)
    model, robot = make_model(task), task.scene.robots[0]
    screws = {s.parameters["screw"] for s in task.skills if s.kind == "fasten"}
    for state in reachable_states(model, 1_000):
        poses = task.scene.at(state)
        fastened = {name for name in screws if f"fastened({name})" in state}
        assert set(poses) == {b.name for b in task.scene.bodies} - screws | fastened
        for body in task.scene.bodies:
            if body.name not in screws and f"held({body.name})" in state:
                _, (x_m, y_m, _) = robot.place(state)
                assert poses[body.name].position == (x_m, y_m, robot.safe_height_m)
            elif body.name in poses:
                fact = next(p for p in body.placements if p.fact in state)
                assert poses[body.name] == fact.pose


def test_a_picked_part_hangs_above_its_start_and_then_lies_at_its_goal(board_task):
    """Figures of the layout, by hand."""
    state = board_task.initial
    assert board_task.scene.at(state)["pcb"] == Pose((0.345, 0.0, 0.0))
    state = board_task.skill("pick(pcb)").prediction.apply(state)
    assert board_task.scene.at(state)["pcb"].position == (0.345, 0.0, 0.15)
    state = board_task.skill("place(pcb)").prediction.apply(state)
    assert board_task.scene.at(state)["pcb"].position == (0.489, 0.0, 0.0)
    # The transformer stands on the board of 6 mm.
    for name in ("pick(transformer)", "place(transformer)"):
        state = board_task.skill(name).prediction.apply(state)
    assert board_task.scene.at(state)["transformer"].position == (0.52, -0.001, 0.006)
