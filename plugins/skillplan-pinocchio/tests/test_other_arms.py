"""Any arm that is described, mounted anywhere: the same detector, no word of the Panda."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial import ConvexHull

from skillplan.pipeline import Setup, load_problem, solve
from skillplan.robots import ARMS, PANDA, PANDA_HAND, STANDARD_HAND, UR5E, Capsule, Rod
from skillplan.task import Pose, Robot
from skillplan_pinocchio import (
    ArmModel,
    LinkPiece,
    Unreachable,
    iterate_elbows,
    iterate_postures,
    make_hand_pose,
    make_pose_down,
)
from urdf_text import CAPSULE, urdf

CONFIGS = Path(__file__).parents[3] / "configs"
SWEPT = Setup(collision=("swept",))
# Hanging from the ceiling, and on a wall.
MOUNTS = [
    Pose((0.0, 0.0, 0.0)),
    Pose.upright((0.3, -0.2, 0.1), 2.0),
    Pose.turned((0.0, 0.0, 1.2), (math.pi, 0.0, 0.4)),
    Pose.turned((-0.6, 0.0, 0.5), (0.0, math.pi / 2, 0.0)),
]


def robot(model: str, mount: Pose) -> Robot:
    arm, hand = ARMS[model]
    return Robot(
        "arm",
        mount.position,
        0.85,
        0.15,
        {},
        model=arm,
        base_orientation=mount.orientation,
        hand=hand,
    )


@pytest.mark.slow(reason="plans and times the board twice; a URDF's arm in every run")
def test_swept_proves_the_inverter_board_by_a_ur5e():
    """The parts' geometry decides, so that order and cost are those of the Panda."""
    results = [
        solve(load_problem(CONFIGS / f"{name}.yaml").task, "exact", SWEPT)
        for name in ("inverter_board", "inverter_ur5e")
    ]
    panda, ur5e = results
    assert (panda.status, ur5e.status) == ("optimal", "optimal")
    assert ur5e.cost == pytest.approx(1.86709, abs=5e-6)
    assert [step.skill for step in ur5e.steps] == [step.skill for step in panda.steps]
    assert panda.makespan_s is not None
    assert ur5e.makespan_s is not None
    # Its joints gain speed more slowly.
    assert panda.makespan_s < ur5e.makespan_s < 2 * panda.makespan_s


def box_task(folder: Path, collisions: dict[int, str]) -> Path:
    """Write a task of one box for an arm with such shapes of its links."""
    (folder / "arm.urdf").write_text(urdf(collisions=collisions), "utf-8")
    task = folder / "task.yaml"
    task.write_text(
        """kind: assembly
name: box
robot: {model: arm.urdf, tip: flange, base_m: [0, 0, 0.1], base_rpy_rad: [0, 0, 0.5],
  home_m: [0.4, 0.0], home_rad: [0, 0.4, 1.4, 1.3, 0, 0], reach_m: 1.1}
tools: {gripper: {type: gripper, opening_m: 0.12, force_n: 20, holder_m: [0.5, 0.3],
  jaw_profile_m: [[0, 0.008, 0, 0.01], [0.05, 0.008, 0, 0.01]]}}
initial_tool: gripper
parts:
  box: {tool: gripper, size_m: [0.09, 0.1, 0.1], start_m: [0.4, 0.2], goal_m: [0.5, 0.0]}
step_limit: 2
""",
        "utf-8",
    )
    return task


@pytest.mark.parametrize(
    ("collisions", "links"),
    [
        ({0: "", 6: CAPSULE}, "the base"),
        (dict.fromkeys(range(7), ""), "the base, " + ", ".join(f"link {n}" for n in range(1, 7))),
    ],
    ids=["some", "none"],
)
def test_swept_plans_for_an_arm_from_a_urdf(tmp_path, collisions, links):
    """One part from here to there, the arm turned; links without shapes are not checked."""
    solution = solve(load_problem(box_task(tmp_path, collisions)).task, "exact", SWEPT)
    assert solution.status == "optimal"
    assert [step.skill for step in solution.steps] == ["pick(box)", "place(box)"]
    assert any(
        sentence.startswith(f"contacts of {links} of six: its description has no collision shape")
        for sentence in solution.not_checked
    )


def test_arms_that_ship_have_shapes_for_all_links():
    assert [arm.without_shape for arm, _ in ARMS.values()] == [()] * len(ARMS)


def test_arms_whose_makers_publish_no_masses_say_what_is_not_checked():
    """KUKA publishes torques of the LBR iiwa; of the others neither is published."""
    words = {name: " ".join(arm.not_checked) for name, (arm, _) in ARMS.items() if arm.not_checked}
    large = ["m710ic_45m", "m710ic_50"]
    assert sorted(words) == ["iiwa14", "iiwa7", "irb1200_5_90", "kr6_r900", *large]
    assert all("weight of the links after" in text for text in words.values())
    assert [name for name in words if "torques of" in words[name]] == [
        "irb1200_5_90",
        "kr6_r900",
        *large,
    ]


@pytest.mark.parametrize("model", sorted(ARMS))
@pytest.mark.parametrize("mount", MOUNTS)
def test_postures_lead_to_the_pose_however_the_arm_is_mounted(model, mount):
    """Within limits; jaws close alike with the hand turned by half a turn; always the same."""
    arm = ArmModel.of(robot(model, mount))
    at, rotation = arm.tip(arm.home_rad)
    target = pin.SE3(
        rotation @ pin.rpy.rpyToMatrix(0.3, -0.2, 0.1), at + np.array((0.02, 0.03, -0.04))
    )
    items = list(iterate_postures(arm, target))
    assert len(items) > 4
    for joints in items:
        assert not isinstance(joints, Unreachable)
        assert (joints >= arm.low_rad).all()
        assert (joints <= arm.high_rad).all()
        here, turned = arm.tip(joints)
        assert here == pytest.approx(target.translation, abs=1e-7)
        assert turned[:, 2] == pytest.approx(target.rotation[:, 2], abs=1e-7)
        assert abs(turned[:, 1] @ target.rotation[:, 1]) == pytest.approx(1.0, abs=1e-7)
    away = [round(float(np.abs(joints - arm.home_rad).max()), 6) for joints in items]
    assert away == sorted(away)
    again = list(iterate_postures(ArmModel.of(robot(model, mount)), target))
    assert all(np.array_equal(first, other) for first, other in zip(items, again, strict=True))


def test_of_a_full_turn_the_angle_nearest_to_home_is_taken():
    """The wrist of a UR turns twice: a posture is not left for a full turn away."""
    turned = replace(UR5E, home_rad=(*UR5E.home_rad[:5], 6.0))
    arm = ArmModel(description=turned, hand=STANDARD_HAND)
    at, rotation = arm.tip(arm.home_rad)
    first = next(iterate_postures(arm, pin.SE3(rotation, at)))
    assert first == pytest.approx(arm.home_rad, abs=1e-9)


@pytest.mark.parametrize("yaw_rad", [-2.0, 0.0, 0.7])
def test_a_mount_that_is_turned_about_the_vertical_turns_the_postures_along(yaw_rad):
    """Seen from the arm nothing has changed."""
    mount = Pose.upright((0.2, -0.1, 0.05), yaw_rad)
    there = mount.apply((0.45, 0.1, 0.05))
    here = next(iterate_elbows(ArmModel(), (0.45, 0.1, 0.05), 0.3))
    turned = next(iterate_elbows(ArmModel.of(robot("panda", mount)), there, 0.3 + yaw_rad))
    assert turned == pytest.approx(here, abs=1e-6)


def test_what_a_ur_cannot_reach_is_said_with_its_distance():
    """And why."""
    arm = ArmModel(description=UR5E, hand=STANDARD_HAND)
    (result,) = iterate_postures(arm, make_hand_pose((1.5, 0.0, 0.2), (0.0, 0.0, 0.0, 1.0)))
    assert isinstance(result, Unreachable)
    assert result.distance_m > 0.3
    (down,) = iterate_elbows(arm, (0.0, 0.0, 2.0), 0.0)
    assert isinstance(down, Unreachable)
    assert down.reason.startswith("the hand cannot point straight down at (0.000, 0.000, 2.000): ")


def test_hands_are_mounted_where_their_data_say():
    """The ends of the jaws, along the axis of the flange."""
    arm = ArmModel(description=UR5E, hand=replace(PANDA_HAND, tip_m=0.2))
    bare = arm.serial.model.getFrameId("flange")
    data = arm.serial.model.createData()
    pin.framesForwardKinematics(arm.model, data, arm.home_rad)
    flange = data.oMf[bare]
    at, rotation = arm.tip(arm.home_rad)
    assert at == pytest.approx(flange.act(np.array((0.0, 0.0, 0.2))))
    assert rotation[:, 2] == pytest.approx(flange.rotation[:, 2])


@pytest.mark.parametrize("shape", [Capsule, Rod])
def test_round_shapes_are_where_they_are_described(shape):
    """Corners, box and geometry agree."""
    piece = LinkPiece(1, shape((0.1, 0.2, 0.3), (0.4, 0.2, 0.7), 0.05))
    centre, half = piece.box
    assert centre == pytest.approx((0.25, 0.2, 0.5))
    assert (np.abs(piece.corners - centre) <= half + 1e-9).all()
    end = piece.frame.act(np.array((0.0, 0.0, 0.25)))
    assert end == pytest.approx((0.4, 0.2, 0.7))
    assert piece.geometry.radius == 0.05


@pytest.mark.parametrize("joint", range(1, 7))
def test_at_home_no_link_of_a_ur_reaches_the_one_after_the_next(joint):
    """The shapes leave room between them."""
    arm = ArmModel(description=UR5E, hand=STANDARD_HAND)
    rotations, origins = arm.frames([arm.home_rad])
    hulls = {
        piece.link: piece.corners @ rotations[0, piece.link - 1].T + origins[0, piece.link - 1]
        for piece in arm.pieces
    }
    for other in range(joint + 2, 7):
        assert outside_m(hulls[other], hulls[joint]) > 0


def outside_m(corners, points):
    """Return how far the farthest point is outside the hull of corners [m]."""
    planes = ConvexHull(np.array(corners)).equations
    return float((np.asarray(points) @ planes[:, :3].T + planes[:, 3]).max())


def test_a_panda_points_down_as_before():
    """With the posture that kept verdicts rest on: joint for joint."""
    first = next(iterate_elbows(ArmModel(), (0.5, 0.1, 0.05), 0.3))
    at, rotation = ArmModel().tip(first)
    assert at == pytest.approx((0.5, 0.1, 0.05), abs=1e-6)
    assert rotation == pytest.approx(make_pose_down((0.5, 0.1, 0.05), 0.3).rotation, abs=1e-6)
    assert PANDA.swing == (0, 2, 6)
