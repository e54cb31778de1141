"""Arms with strokes, missing joints and followers: the same kinematics, checks and plans."""

import math

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from example_count import examples
from skillplan.pipeline import Setup, load_problem, solve
from skillplan.robots import STANDARD_HAND, compute_link_frames, read_urdf
from skillplan.task import Pose
from skillplan_pinocchio import (
    ArmBodies,
    ArmModel,
    NumericInverse,
    SerialArm,
    TravelHeights,
    Unreachable,
    Unreached,
    build_arm_solids,
    iterate_elbows,
    make_pose_down,
)
from urdf_text import joint, urdf

BOX = '<collision><origin xyz="{0}"/><geometry><box size="{1}"/></geometry></collision>'


def scara():
    """Return a SCARA: two turns, a stroke downwards, and a turn."""
    shapes = [
        ("base", BOX.format("0 0 0.2", "0.16 0.16 0.4")),
        ("inner", BOX.format("0.15 0 0.04", "0.4 0.1 0.08")),
        ("outer", BOX.format("0.13 0 0.04", "0.36 0.1 0.1")),
        ("quill", BOX.format("0 0 -0.05", "0.03 0.03 0.2")),
        ("shaft", ""),
        ("tool", ""),
    ]
    joints = [
        ("inner", "revolute", "0 0 0.45", "-2.4", "2.4"),
        ("outer", "revolute", "0.325 0 0.09", "-2.5", "2.5"),
        ("quill", "prismatic", "0.275 0 0", "-0.3", "0"),
        ("shaft", "revolute", "0 0 -0.02", "-6", "6"),
    ]
    text = "<robot name='own scara'>" + "".join(
        f'<link name="{name}">{shape}</link>' for name, shape in shapes
    )
    for (parent, _), (child, kind, xyz, low, high) in zip(shapes, joints, strict=False):
        text += (
            f'<joint name="to_{child}" type="{kind}"><parent link="{parent}"/>'
            f'<child link="{child}"/><origin xyz="{xyz}"/><axis xyz="0 0 1"/>'
            f'<limit lower="{low}" upper="{high}" effort="100" velocity="3"/></joint>'
        )
    text += (
        '<joint name="mount" type="fixed"><parent link="shaft"/><child link="tool"/>'
        '<origin xyz="0 0 -0.15" rpy="3.141592653589793 0 0"/></joint></robot>'
    )
    return text


def arm_without_roll(wrist_rad):
    """Return an arm of a turn and three nods, the last one of `wrist_rad` at most either way."""
    joints = [
        ("z", "0 0 0.2", 3),
        ("y", "0 0 0.1", 3),
        ("y", "0.3 0 0", 3),
        ("y", "0.3 0 0", wrist_rad),
    ]
    text = "<robot name='no roll'><link name='l0'/>"
    for n, (axis, xyz, most) in enumerate(joints, 1):
        text += (
            f'<link name="l{n}"/><joint name="j{n}" type="revolute"><parent link="l{n - 1}"/>'
            f'<child link="l{n}"/><origin xyz="{xyz}"/><axis xyz="0 {int(axis == "y")} '
            f'{int(axis == "z")}"/><limit lower="{-most}" upper="{most}" velocity="3"/></joint>'
        )
    return text + (
        '<link name="tool"/><joint name="mount" type="fixed"><parent link="l4"/>'
        '<child link="tool"/>'
        '<origin xyz="0 0 -0.1" rpy="3.141592653589793 0 0"/></joint></robot>'
    )


def described(text, tip="tool"):
    return read_urdf(text.encode(), tip, None, lambda name, scale: [])


ARMS = {
    "scara": described(scara()),
    "rail": described(urdf({1: joint(1, kind="prismatic")}), "flange"),
    "follower": described(
        urdf({3: joint(3, more='<mimic joint="joint_2" multiplier="-0.8" offset="0.2"/>')}),
        "flange",
    ),
}


def draw_posture(arm, shares):
    """Return a posture within the limits, followers where their leaders put them."""
    low, high = np.array(arm.low_rad), np.array(arm.high_rad)
    return np.array(arm.follow(low + np.array(shares[: len(low)]) * (high - low)))


SHARES = st.lists(st.floats(0, 1), min_size=7, max_size=7)


@pytest.mark.parametrize("name", sorted(ARMS))
@given(shares=SHARES)
@settings(max_examples=examples(20), deadline=None)
def test_all_kinematics_agree(name, shares):
    """pinocchio's, the frames of collision checks, and those of pictures."""
    arm = ARMS[name]
    posture = draw_posture(arm, shares)
    serial = SerialArm(arm)
    drawn = compute_link_frames(arm, posture[np.newaxis])
    assert serial.tip(posture).homogeneous == pytest.approx(drawn[-1][0], abs=1e-12)
    frames = ArmBodies(serial.model, (), posture).frames
    rotations, origins = frames.at(posture[np.newaxis])
    for number, frame in enumerate(drawn[:-1]):
        assert rotations[0, number] == pytest.approx(frame[0, :3, :3], abs=1e-12)
        assert origins[0, number] == pytest.approx(frame[0, :3, 3], abs=1e-12)


@pytest.mark.parametrize("name", sorted(ARMS))
@given(begin=SHARES, end=SHARES)
@settings(max_examples=examples(20), deadline=None)
def test_no_point_moves_farther_than_its_reach(name, begin, end):
    """The bound on which continuous checks rest, for strokes as well."""
    model = ArmModel(description=ARMS[name])
    bodies = ArmBodies(model.model, build_arm_solids(model), model.home_rad)
    first, last = draw_posture(ARMS[name], begin), draw_posture(ARMS[name], end)
    rotations, origins = bodies.frames.at(np.array([first, last]))
    bounds_m = bodies.reach_m @ np.abs(last - first)
    for solid, bound_m in zip(bodies.solids, bounds_m, strict=True):
        places = rotations[:, solid.joint] @ solid.centre + origins[:, solid.joint]
        assert np.linalg.norm(places[1] - places[0]) <= bound_m + 1e-12


@pytest.mark.parametrize("name", sorted(ARMS))
@given(begin=SHARES, end=SHARES)
@settings(max_examples=examples(15), deadline=None)
def test_travels_are_never_lower_than_their_bound(name, begin, end):
    model = ArmModel(description=ARMS[name])
    first, last = draw_posture(ARMS[name], begin), draw_posture(ARMS[name], end)
    heights = [model.tip(first + share * (last - first))[0][2] for share in np.linspace(0, 1, 101)]
    safe_m = float(min(heights[0], heights[-1]))
    assert TravelHeights(model, 0.1).lowest_m(first, last, safe_m) <= min(heights) + 1e-9


@pytest.mark.parametrize("name", sorted(ARMS))
def test_poses_that_the_chain_reaches_are_found(name):
    """To 1e-8, within the limits, and followers with their leaders."""
    arm = ARMS[name]
    serial, numbers = SerialArm(arm), np.random.default_rng(4)
    inverse = NumericInverse(serial)
    for _ in range(20):
        target = serial.tip(draw_posture(arm, numbers.uniform(0.05, 0.95, 7)))
        joints = inverse.solve(target)
        assert not isinstance(joints, Unreached)
        assert np.abs(serial.error(joints, target)[0]).max() < 1e-7
        assert np.array(arm.follow(joints)) == pytest.approx(joints, abs=1e-9)
        assert (joints >= serial.low_rad - 1e-12).all()
        assert (joints <= serial.high_rad + 1e-12).all()


def test_a_scara_closes_its_jaws_in_any_direction_and_tilts_in_none():
    model = ArmModel(description=ARMS["scara"])
    for yaw_rad in (0.0, 0.7, 1.5):
        joints = next(iterate_elbows(model, (0.4, 0.1, 0.1), yaw_rad))
        assert not isinstance(joints, Unreachable)
        target = make_pose_down((0.4, 0.1, 0.1), yaw_rad)
        at, rotation = model.tip(joints)
        assert at == pytest.approx(target.translation, abs=1e-6)
        assert abs(rotation[:, 1] @ target.rotation[:, 1]) == pytest.approx(1.0, abs=1e-6)
    tilted = make_pose_down((0.4, 0.1, 0.1), 0.0) * pin.SE3(
        pin.rpy.rpyToMatrix(0.3, 0.0, 0.0), np.zeros(3)
    )
    assert isinstance(model.inverse.solve(tilted), Unreached)
    beyond = next(iterate_elbows(model, (0.9, 0.0, 0.1), 0.0))
    assert isinstance(beyond, Unreachable)
    assert "no posture within the joints' limits" in beyond.reason


@pytest.mark.parametrize(
    ("wrist_rad", "yaw_rad", "reason"),
    [
        (3, 0.3 - math.pi, None),
        (
            3,
            0.5,
            "the jaws cannot close as they should at (0.382, 0.118, 0.100): they are 11 deg off",
        ),
        (
            0.2,
            0.3,
            "straight down at (0.382, 0.118, 0.100): 4 joints move; the nearest posture there",
        ),
    ],
)
def test_an_arm_without_roll_tells_yaw_tilt_and_place_apart(wrist_rad, yaw_rad, reason):
    """Half a turn of the jaws does not matter."""
    arm = described(arm_without_roll(wrist_rad))
    model = ArmModel(description=arm, hand=STANDARD_HAND)
    at = (0.4 * math.cos(0.3), 0.4 * math.sin(0.3), 0.1)
    results = list(iterate_elbows(model, at, yaw_rad + math.pi / 2))
    if reason is None:
        assert not isinstance(results[0], Unreachable)
    else:
        assert reason in results[-1].reason


def write_task(folder):
    """Write a task of one block on another for the SCARA."""
    (folder / "arm.urdf").write_text(scara(), "utf-8")
    task = folder / "task.yaml"
    task.write_text(
        """kind: assembly
name: blocks
robot: {model: arm.urdf, tip: tool, home_m: [0.35, 0.0], reach_m: 0.8}
tools: {gripper: {type: gripper, opening_m: 0.08, holder_m: [0.3, -0.35]}}
initial_tool: gripper
parts:
  lower: {tool: gripper, size_m: [0.08, 0.05, 0.02], start_m: [0.4, -0.2], goal_m: [0.45, 0.05]}
  upper: {tool: gripper, size_m: [0.04, 0.03, 0.02], start_m: [0.4, 0.25], goal_m: [0.45, 0.05],
    goal_on: lower}
""",
        "utf-8",
    )
    return task


def test_swept_plans_for_a_scara(tmp_path):
    solution = solve(load_problem(write_task(tmp_path)).task, "exact", Setup(collision=("swept",)))
    assert solution.status == "optimal"
    assert [step.skill for step in solution.steps][-1] == "place(upper)"
    assert solution.makespan_s is not None


@pytest.mark.slow(reason="simulates four skills; a plan by geometry in every run")
@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
def test_both_engines_execute_a_scara(tmp_path, engine):
    """Its links have no mass, so the density is assumed."""
    pytest.importorskip(f"skillplan_{engine}")
    task = load_problem(write_task(tmp_path)).task
    solution = solve(task, "exact", Setup(physics=engine, collision=("swept",)))
    assert solution.status == "optimal"


@pytest.mark.slow(reason="simulates five skills; verdicts of engines in every run")
def test_drives_that_cannot_follow_prove_nothing(tmp_path):
    """They bear the arm, but not its acceleration; masses that are made up they must bear."""
    pytest.importorskip("skillplan_pybullet")
    path = write_task(tmp_path)
    path.write_text(path.read_text("utf-8").replace("tip: tool", "tip: flange"), "utf-8")
    weak = urdf().replace('effort="100"', 'effort="18"')
    (tmp_path / "arm.urdf").write_text(weak, "utf-8")
    setup = Setup(physics="pybullet", collision=("swept",))
    solution = solve(load_problem(path).task, "exact", setup)
    assert solution.status == "unsolved"
    assert "and touches nothing: its drives cannot follow there" in solution.reason
    massless = weak.replace('<mass value="1.0"/>', "")
    (tmp_path / "arm.urdf").write_text(massless, "utf-8")
    assert solve(load_problem(path).task, "exact", setup).status == "optimal"


def test_a_mounted_scara_reaches_where_its_base_is_turned():
    """Hanging from the ceiling its tool points up, so nothing is reached from above."""
    hanging = Pose.turned((0.0, 0.0, 1.2), (np.pi, 0.0, 0.0))
    model = ArmModel(hanging.position, ARMS["scara"], hanging.orientation)
    assert isinstance(next(iterate_elbows(model, (0.4, 0.1, 0.6), 0.0)), Unreachable)
