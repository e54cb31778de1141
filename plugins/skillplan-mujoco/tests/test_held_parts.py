"""What jaws hold does not creep while friction can hold it, and slips where it cannot."""

from __future__ import annotations

import math

import numpy as np
import pytest

import skillplan_simulation as simulation
from simulated import ACROSS, Swing
from situations import assembly
from skillplan.task import Task
from skillplan_mujoco import MujocoSimulator

SETTINGS = simulation.ExecutionSettings()


def task_with(shape: dict[str, object], mass_kg: float, **gripper: object) -> Task:
    """Return a task of a UR5e with a gripper and one part."""
    part = {"tool": "gripper", "mass_kg": mass_kg, "start_m": [0.5, 0.0], "goal_m": [0.5, 0.2]}
    return assembly(
        {
            "kind": "assembly",
            "name": "held",
            "robot": {"model": "ur5e", "home_m": [0.4, -0.1], "safe_height_m": 0.3},
            "tools": {"gripper": {"holder_m": [0.3, 0.42], **gripper}},
            "initial_tool": "gripper",
            "parts": {"part": {**part, **shape}},
        }
    )


class Held:
    """A part between the jaws of an arm in a world of its own, held by what friction can."""

    def __init__(
        self, task: Task, held_m: float = 0.06, force_n: float = SETTINGS.grip_force_n
    ) -> None:
        (robot,) = task.scene.robots
        self.world, self.arm = MujocoSimulator(task, SETTINGS).cell(simulation.get_hand(robot))
        self.begin_rad = np.array(self.arm.kinematics.home_rad)
        self.arm.stand(self.begin_rad, 0.04)
        tip = self.arm.tip()
        turned = tip.rotation @ ACROSS
        self.world.add(
            task.scene.body("part"),
            simulation.make_pose(tip.position - held_m * turned[:, 2], turned),
        )
        self.at_work = simulation.ControlledRobot(
            self.world, self.arm, task.scene, SETTINGS, robot.tools[0]
        )
        self.at_work.carry("part")
        helping = self.arm.grip("part")
        self.arm.close(force_n)
        self.at_work.wait(0.5)
        self.world.release(helping)
        self.at_work.clasp("part")

    def in_hand(self) -> tuple[simulation.Vector, simulation.Vector]:
        """Return where the part is in the hand, and how it is turned there."""
        hand, pose = self.arm.tip(), self.world.pose("part")
        away = hand.rotation.T @ (np.array(pose.position) - hand.position)
        return away, hand.rotation.T @ simulation.convert_quaternion(pose.orientation)

    def swung(self) -> tuple[float, float]:
        """Swing it for 4 s; return how far it slips [mm] and turns [deg]."""
        before = self.in_hand()
        run = Swing(self.begin_rad, 1.6, 4.0)
        path = np.array([self.begin_rad, self.begin_rad])
        self.at_work.follow(simulation.JointMotion(self.arm.kinematics, path, run))
        after = self.in_hand()
        slip_mm = 1000 * float(np.linalg.norm(after[0] - before[0]))
        return slip_mm, math.degrees(
            float(np.linalg.norm(simulation.compute_turn(before[1], after[1])))
        )


ROD = {"cylinder": {"diameter_m": 0.02, "height_m": 0.08}}
BLOCK = {"size_m": [0.02, 0.02, 0.08]}


@pytest.mark.parametrize("shape", [ROD, BLOCK], ids=["rod", "block"])
def test_a_part_that_is_swung_to_and_fro_ends_where_it_was_in_the_hand(shape):
    slip_mm, turn_deg = Held(task_with(shape, 0.1)).swung()
    assert slip_mm < 0.1
    assert turn_deg < 0.2


@pytest.mark.parametrize(
    ("mass_kg", "held_m", "mm", "deg"),
    [pytest.param(1.0, 0.06, 10.0, 0.0, id="heavy"), pytest.param(0.2, 0.3, 0.0, 2.0, id="long")],
)
def test_what_friction_cannot_hold_slips(mass_kg, held_m, mm, deg):
    shape = {"size_m": [0.02, 0.02, held_m + 0.02]}
    slip_mm, turn_deg = Held(task_with(shape, mass_kg), held_m).swung()
    assert slip_mm > mm
    assert turn_deg > deg


def test_finger_tips_thinner_than_two_margins_hold_a_part():
    """Jaws are drawn smaller by a margin: tips of 4 mm were flat, and MuJoCo refused the cell."""
    tips_m = [[0.0, 0.002, 0.0, 0.0012], [0.006, 0.002, 0.0, 0.0012]]
    profile_m = [*tips_m, [0.0085, 0.003, 0.0, 0.004], [0.05, 0.003, 0.0, 0.004]]
    slip_mm, _ = Held(task_with(BLOCK, 0.1, jaw_profile_m=profile_m)).swung()
    assert slip_mm < 0.1


@pytest.mark.parametrize("thick_m", [0.004, 0.02])
def test_jaws_grip_thin_parts_with_the_force_of_their_tool(thick_m):
    held = Held(task_with({"size_m": [thick_m, 0.02, 0.08]}, 0.1), force_n=60.0)
    points = held.world.points_on("part")
    for jaw in simulation.FINGERS:
        pressed_n = sum(point.normal_n for point in points if point.second == jaw)
        assert pressed_n == pytest.approx(60.0, rel=0.05)


def test_jaws_press_alike_on_what_they_hold_and_on_what_slips():
    """Friction is done by a bond and by contacts in turn; both jaws press by what is commanded."""
    held = Held(task_with(BLOCK, 0.1))
    for grips in (True, False):
        assert (held.at_work._static is not None) == grips
        points = held.world.points_on("part")
        for jaw in simulation.FINGERS:
            pressed_n = sum(point.normal_n for point in points if point.second == jaw)
            assert pressed_n == pytest.approx(SETTINGS.grip_force_n, rel=0.05)
        along = [point.force_n - point.normal_n * point.normal for point in points]
        drawn_n = max(float(np.linalg.norm(force_n)) for force_n in along)
        assert (drawn_n > 0.05) != grips
        held.at_work.unclasp()
        held.at_work.wait(0.2)
