"""Screws at the bit: put there, felt for their hole with, and pressed in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skillplan.task.scene import Pose
from skillplan_pybullet.execution.contact_log import STEPS_PER_FRAME
from skillplan_pybullet.execution.controlled_robot import ControlledRobot
from skillplan_pybullet.simulator.world import STEP_S, TABLE

# A screw is brought so far above where it touches, and then felt for [m].
FEEL_FROM_M = 0.001

_FEEL_SPEED_M_PER_S = 0.01
_FELT_N = 0.2
_PRESS_S = 0.4
_PRESS_SPEED_M_PER_S = 0.004
# A screw of a gram between arm and workpiece would take more iterations to be pressed than
# there are: while the bit has it, it is as heavy as the bit's holder [kg].
_HELD_SCREW_KG = 0.1


def put_at_bit(robot: ControlledRobot, screw: str) -> None:
    """Put a screw at the bit, unless it is there already."""
    if robot.carried == screw:
        return
    world, body = robot.world, robot.scene.body(screw)
    x, y, z = robot.tools.upright_tip().position
    world.add(body, Pose((x, y, z - body.height_m)), len(world.bodies))
    world.weigh(screw, _HELD_SCREW_KG)
    robot.bind(screw)
    robot.carry(screw)


def drive(robot: ControlledRobot, screw: str, contact_m: float) -> None:
    """Feel for the hole's mouth and press, the force measured over the last half; let go then.

    Parameters
    ----------
    robot
        With the screw at its bit, above the hole.
    screw
        Its name.
    contact_m
        At what height of the tip the screw touches [m].

    Raises
    ------
    StuckError
        If something blocks the arm.
    """
    world, arm, settings = robot.world, robot.arm, robot.settings
    assert arm.wanted is not None
    drivers = {screw, *robot.tools.robot_parts}
    through = {name for name in (*world.bodies, TABLE) if name not in drivers}
    # It lands on whatever is there; what else the robot touches meanwhile is not meant to be.
    robot.log.free.add(screw)
    x, y, z = arm.wanted.position.tolist()
    lowest = contact_m - settings.press_travel_m
    while z > lowest and robot.log.pressing_n({screw}, through) < _FELT_N:
        z -= _FEEL_SPEED_M_PER_S * STEP_S
        arm.wanted = replace(arm.wanted, position=np.array([x, y, z]), velocity=np.zeros(3))
        robot.step()
    arm.press_n = settings.press_force_n
    readings = []
    steps = round(_PRESS_S / STEP_S)
    for step in range(steps):
        z = _pressing_height_m(robot, z, robot.log.pressing_n({screw}, through))
        arm.wanted = replace(arm.wanted, position=np.array([x, y, z]))
        robot.step()
        if step >= steps // 2 and step % STEPS_PER_FRAME == 0:
            readings.append(robot.log.pressing_n({screw}, through))
    arm.press_n = 0.0
    robot.sensed["fastening_force_n"] = float(np.mean(readings))
    robot.unbind()
    world.weigh(screw, robot.scene.body(screw).mass_kg)
    robot.carry(None)


def _pressing_height_m(robot: ControlledRobot, height_m: float, felt_n: float) -> float:
    """Return at what height the tip is to be while it presses [m].

    Under operational-space control a force is commanded, and the height yields to it;
    position control is lowered until as much is felt.
    """
    if robot.settings.control == "osc":
        return float(robot.arm.tip().position[2])
    short = felt_n < robot.settings.press_force_n
    return height_m - _PRESS_SPEED_M_PER_S * STEP_S if short else height_m
