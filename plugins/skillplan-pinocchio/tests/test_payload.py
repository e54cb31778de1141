"""Masses: the payload of the arm, and the torques that gravity asks of its joints."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from skillplan import Result, Setup, TaskError, load_problem, solve
from skillplan.robots import ARMS
from skillplan.task import Robot, Scene
from skillplan_pinocchio import ArmModel, GravityCheck
from urdf_text import urdf_of

SWEPT = Setup(collision=("swept",))
# Arms whose masses are known, one of each structure.
WEIGHED = ("gen3_7dof", "panda", "ur5e")


def block(
    mass_kg: float, robot: dict[str, Any] | None = None, cup_kg: float | None = None
) -> dict[str, Any]:
    """Return a task with one block that is lifted by suction."""
    cup = {} if cup_kg is None else {"mass_kg": cup_kg}
    return {
        "kind": "assembly",
        "name": "heavy",
        "robot": {"home_m": [0.4, 0.0], **(robot or {})},
        "tools": {"cup": {"type": "suction", "holder_m": [0.3, 0.3], **cup}},
        "initial_tool": "cup",
        "parts": {
            "block": {
                "tool": "cup",
                "mass_kg": mass_kg,
                "size_m": [0.25, 0.25, 0.13],
                "start_m": [0.5, -0.25],
                "goal_m": [0.5, 0.1],
            }
        },
    }


def solved(folder: Path, content: dict[str, Any]) -> Result:
    path = folder / "task.yaml"
    path.write_text(yaml.safe_dump(content), "utf-8")
    return solve(load_problem(path).task, "exact", SWEPT)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (block(60), "parts.block.mass_kg: 60 kg, with 0.73 kg of 'cup', is more than"),
        (block(2.3), "the arm carries, 3 kg (payload of panda)"),
        (block(4.5, {"model": "ur5e"}), "the arm carries, 5 kg (payload of ur5e)"),
        (block(1, {"payload_kg": 1.5}), "the arm carries, 1.5 kg (robot.payload_kg)"),
        (block(1, cup_kg=2.5), "1 kg, with 2.5 kg of 'cup', is more than"),
        (block(1, cup_kg=3.5), "tools.cup.mass_kg: 3.5 kg is more than"),
    ],
)
def test_what_is_heavier_than_the_payload_is_one_message(tmp_path, content, words):
    with pytest.raises(TaskError) as caught:
        solved(tmp_path, content)
    (message,) = str(caught.value).splitlines()
    assert words in message


@pytest.mark.parametrize("content", [block(2.2), block(4.2, {"model": "ur5e"}), block(3, cup_kg=0)])
def test_what_the_arm_carries_is_planned(tmp_path, content):
    assert solved(tmp_path, content).status == "optimal"


def test_a_payload_beyond_the_torques_is_infeasible_with_joint_torque_and_limit(tmp_path):
    """The file may say that the arm carries more; its joints do not bear it."""
    result = solved(tmp_path, block(60, {"payload_kg": 100}))
    assert result.status == "infeasible"
    assert "pick(block) is never feasible: swept: joint_" in result.reason
    assert "Nm of gravity with block, and its limit is 12 Nm" in result.reason


def test_the_arm_is_blamed_and_not_a_part_that_comes_later(tmp_path):
    """Though with everything else in place the part would also run into its neighbour."""
    content = block(60, {"payload_kg": 100})
    roof = {**content["parts"]["block"], "mass_kg": 0.1, "start_m": [0.2, 0.4], "goal_on": "block"}
    roof["size_m"] = [0.25, 0.25, 0.02]
    content["parts"]["roof"] = roof
    assert "joint_" in solved(tmp_path, content).reason.splitlines()[0]


def test_what_a_urdf_does_not_say_is_listed_as_not_checked(tmp_path):
    """Industrial files have an effort of 0. With a payload and all torques nothing is listed."""
    arm, _ = ARMS["panda"]
    text = urdf_of(arm)
    (tmp_path / "whole.urdf").write_text(text, "utf-8")
    (tmp_path / "industrial.urdf").write_text(text.replace('effort="12.0"', 'effort="0"'), "utf-8")
    home = {"home_rad": list(arm.home_rad), "tip": "flange", "reach_m": 0.85}
    unknown = solved(tmp_path, block(2, {"model": "industrial.urdf", **home}))
    assert unknown.status == "optimal"
    assert {
        "payload of robot: not in the robot description; robot.payload_kg gives it",
        f"torques of joint_5, joint_6, joint_7 of {arm.name}: its description has no limit",
    } <= set(unknown.not_checked)
    known = solved(tmp_path, block(2, {"model": "whole.urdf", "payload_kg": 3, **home}))
    assert not any("payload" in text or "torques" in text for text in known.not_checked)


def gravity_of(name: str) -> tuple[ArmModel, GravityCheck]:
    model, hand = ARMS[name]
    robot = Robot("arm", (0.0, 0.0, 0.0), 0.85, 0.15, {}, model=model, hand=hand)
    arm = ArmModel.of(robot)
    return arm, GravityCheck(arm, Scene((), (robot,)), robot)


@pytest.mark.parametrize("name", WEIGHED)
@given(
    seed=st.integers(0, 2**32 - 1),
    mass_kg=st.floats(0.01, 20),
    where=st.tuples(*[st.floats(-0.2, 0.2)] * 3),
)
def test_torques_equal_those_of_recursive_newton_euler(name, seed, mass_kg, where):
    """Featherstone's algorithm in pinocchio, with the load as a part of the last link."""
    arm, gravity = gravity_of(name)
    posture = np.random.default_rng(seed).uniform(arm.low_rad, arm.high_rad)
    loaded = arm.model.copy()
    loaded.gravity.linear = np.array([0.0, 0.0, -9.80665])
    tip = loaded.frames[loaded.getFrameId("tip")].placement
    inertia = pin.Inertia(mass_kg, np.array(where), np.zeros((3, 3)))
    loaded.appendBodyToJoint(loaded.njoints - 1, inertia, tip)
    expected = pin.computeGeneralizedGravity(loaded, loaded.createData(), posture)
    (result,) = gravity.torques_nm([posture], [(mass_kg, np.array(where))])
    assert result == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("name", WEIGHED)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_bound_on_all_postures_holds_in_each(name, seed):
    arm, gravity = gravity_of(name)
    posture = np.random.default_rng(seed).uniform(arm.low_rad, arm.high_rad)
    assert (np.abs(gravity.torques_nm([posture], [])) <= gravity.most_nm + 1e-9).all()
