"""What jaws hold does not creep while friction can hold it, and slips where it cannot."""

from __future__ import annotations

import math

import numpy as np
import pytest

import skillplan_simulation as simulation
from simulated import ACROSS, Swing
from situations import assembly
from skillplan import Setup
from skillplan.task import Body, Box, Cylinder, Scene
from skillplan_pybullet import SimulatedArm, SimulationSettings, World
from thinned import slow_case

SETTINGS = SimulationSettings()
ROD = Cylinder(0.02, 0.08, (0.0, 0.0, 0.04))
BLOCK = Box((0.02, 0.02, 0.08), (0.0, 0.0, 0.04))
PADS = simulation.Pads((5.0, 10.0), np.zeros(3), np.array([0.0, 1.0, 0.0]), 0.02, 0.01)


def share(force_n: list[float], moment_nm: list[float], pads: simulation.Pads = PADS) -> float:
    return simulation.compute_utilisation(
        pads, np.array(force_n), np.array(moment_nm), friction=0.6, spinning_m=0.006
    )


class TestLimits:
    def test_along_the_jaws_friction_bears_its_coefficient_times_both_normal_forces(self):
        assert share([0.0, 0.0, 6.0], [0.0, 0.0, 0.0]) == pytest.approx(1.0)
        assert share([4.8, 0.0, 3.6], [0.0, 0.0, 0.0]) == pytest.approx(1.0)

    def test_across_them_a_load_opens_a_jaw_beyond_its_own_force(self):
        assert share([0.0, 5.0, 0.0], [0.0, 0.0, 0.0]) == pytest.approx(1.0)

    def test_the_wider_the_patches_the_more_moment_they_bear(self):
        wide = simulation.Pads((5.0, 10.0), np.zeros(3), np.array([0.0, 1.0, 0.0]), 0.02, 0.02)
        for moment_nm in ([0.0, 0.1, 0.0], [0.1, 0.0, 0.0]):
            assert share([0.0] * 3, moment_nm, wide) < share([0.0] * 3, moment_nm) < 1.0

    def test_force_and_moment_together_slip_before_either(self):
        assert share([0.0, 0.0, 5.0], [0.0, 0.0, 0.0]) < 1.0
        assert share([0.0, 0.0, 0.0], [0.0, 0.1, 0.0]) < 1.0
        assert share([0.0, 0.0, 5.0], [0.0, 0.1, 0.0]) > 1.0

    def test_what_no_jaw_presses_on_is_not_held(self):
        slack = simulation.Pads((0.0, 5.0), np.zeros(3), np.array([0.0, 1.0, 0.0]), 0.02, 0.01)
        assert share([0.0, 0.0, 0.1], [0.0, 0.0, 0.0], slack) > 1.0


@pytest.fixture(scope="module")
def scene():
    """Return a scene of a UR5e with a gripper."""
    part = {"tool": "gripper", "size_m": [0.02] * 3, "start_m": [0.5, 0.0], "goal_m": [0.5, 0.2]}
    return assembly(
        {
            "kind": "assembly",
            "name": "held",
            "robot": {"model": "ur5e", "home_m": [0.4, -0.1], "safe_height_m": 0.3},
            "tools": {"gripper": {"holder_m": [0.3, 0.42]}},
            "initial_tool": "gripper",
            "parts": {"part": part},
        }
    ).scene


def slip_of(
    scene: Scene, body: Body, *, swing_rad: float, held_m: float = 0.06
) -> tuple[float, float]:
    """Swing a body in the jaws for 4 s; return how far it slips [mm] and turns [deg]."""
    (robot,) = scene.robots
    with World(SETTINGS.friction) as world:
        arm = SimulatedArm(world, robot, SETTINGS)
        begin = np.array(arm.kinematics.home_rad)
        arm.stand(begin, 0.04)
        tip = arm.tip()
        turned = tip.rotation @ ACROSS
        world.add(body, simulation.make_pose(tip.position - held_m * turned[:, 2], turned))
        at_work = simulation.ControlledRobot(world, arm, scene, SETTINGS, robot.tools[0])
        at_work.carry(body.name)
        helping = arm.grip(body.name)
        arm.close(SETTINGS.grip_force_n)
        at_work.wait(0.5)
        world.release(helping)
        at_work.clasp(body.name)

        def in_hand() -> tuple[simulation.Vector, simulation.Vector]:
            hand, pose = arm.tip(), world.pose(body.name)
            away = hand.rotation.T @ (np.array(pose.position) - hand.position)
            return away, hand.rotation.T @ simulation.convert_quaternion(pose.orientation)

        before = in_hand()
        run = Swing(begin, swing_rad, 4.0)
        travel = simulation.JointMotion(arm.kinematics, np.array([begin, begin]), run)
        at_work.follow(travel)
        after = in_hand()
        slip_mm = 1000 * float(np.linalg.norm(after[0] - before[0]))
        return slip_mm, math.degrees(
            float(np.linalg.norm(simulation.compute_turn(before[1], after[1])))
        )


@pytest.mark.parametrize(
    "shape",
    [
        pytest.param(ROD, id="rod"),
        slow_case(BLOCK, id="block", reason="4 s simulated; a rod in every run"),
    ],
)
def test_a_part_that_is_swung_to_and_fro_ends_where_it_was_in_the_hand(scene, shape):
    slip_mm, turn_deg = slip_of(scene, Body("part", (shape,), (), 0.1), swing_rad=1.6)
    assert slip_mm < 0.1
    assert turn_deg < 0.2


@pytest.mark.parametrize(
    ("mass_kg", "held_m", "mm", "deg"),
    [
        pytest.param(1.0, 0.06, 10.0, 0.0, id="heavy"),
        slow_case(
            *(0.2, 0.3, 0.0, 2.0), id="long", reason="4 s simulated; a heavy part in every run"
        ),
    ],
)
def test_what_friction_cannot_hold_slips(scene, mass_kg, held_m, mm, deg):
    height_m = held_m + 0.02
    bar = Box((0.02, 0.02, height_m), (0.0, 0.0, height_m / 2))
    body = Body("part", (bar,), (), mass_kg)
    slip_mm, turn_deg = slip_of(scene, body, swing_rad=1.6, held_m=held_m)
    assert slip_mm > mm
    assert turn_deg > deg


def test_a_bar_beside_whose_middle_jaws_close_is_lifted_from_its_feeder_level():
    """That the feeder lets go of it takes nothing from what friction holds."""
    bar = {
        "tool": "gripper",
        "mass_kg": 0.15,
        "size_m": [0.16, 0.02, 0.02],
        "grasp": {"at_m": [0.06, 0.0], "closing_axis": "y"},
        "feeder": "tray",
        "goal_m": [0.5, 0.2],
    }
    task = assembly(
        {
            "kind": "assembly",
            "name": "fed",
            "robot": {"home_m": [0.4, -0.1], "safe_height_m": 0.3},
            "tools": {"gripper": {"holder_m": [0.3, 0.42]}},
            "initial_tool": "gripper",
            "feeders": {"tray": {"position_m": [0.5, -0.2]}},
            "parts": {"bar": bar},
        }
    )
    (engine, *_) = Setup("pybullet", ("contact-pairs",)).back_ends(task)
    (pick,) = (skill for skill in task.skills if skill.name == "pick(bar)")
    verdict = engine.check(pick, task.initial)
    assert verdict.is_feasible, verdict.reason
    assert verdict.evidence["tilt_deg"] < 0.1
