"""Screws at the bit: put there, felt for their hole with, and pressed in."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from skillplan.task.scene import Pose
from skillplan_pybullet.contact_log import STEPS_PER_FRAME
from skillplan_pybullet.world import STEP_S, TABLE

if TYPE_CHECKING:
    from skillplan_pybullet.skill_runner import SkillRunner

# A screw is brought so far above where it touches, and then felt for [m].
FEEL_FROM_M = 0.001

_FEEL_SPEED_M_PER_S = 0.01
_FELT_N = 0.2
_PRESS_S = 0.4
_PRESS_SPEED_M_PER_S = 0.004
# A screw of a gram between arm and workpiece would take more iterations to be pressed than
# there are: while the bit has it, it is as heavy as the bit's holder [kg].
_HELD_SCREW_KG = 0.1


def put_at_bit(runner: SkillRunner, screw: str) -> None:
    """Put a screw at the bit, unless it is there already."""
    if runner.carried == screw:
        return
    world, body = runner.world, runner.scene.body(screw)
    x, y, z = runner.tools.upright_tip().position
    world.add(body, Pose((x, y, z - body.height_m)), len(world.bodies))
    world.weigh(screw, _HELD_SCREW_KG)
    runner.bind(screw)
    runner.carry(screw)


def drive(runner: SkillRunner, screw: str, contact_m: float) -> None:
    """Feel for the hole's mouth and press, the force measured over the last half; let go then.

    Parameters
    ----------
    runner
        With the screw at its bit, above the hole.
    screw
        Its name.
    contact_m
        At what height of the tip the screw touches [m].

    Raises
    ------
    StuckError
        If something is in the arm's way.
    """
    world, arm, settings = runner.world, runner.arm, runner.settings
    assert arm.wanted is not None
    drivers = {screw, *runner.tools.robot_parts}
    through = {name for name in (*world.bodies, TABLE) if name not in drivers}
    # It lands on whatever is there; what else the robot touches meanwhile is not meant to be.
    runner.log.free.add(screw)
    x, y, z = arm.wanted.position.tolist()
    lowest = contact_m - settings.press_travel_m
    while z > lowest and runner.log.pressing_n({screw}, through) < _FELT_N:
        z -= _FEEL_SPEED_M_PER_S * STEP_S
        arm.wanted = replace(arm.wanted, position=np.array([x, y, z]), velocity=np.zeros(3))
        runner.step()
    arm.press_n = settings.press_force_n
    readings = []
    steps = round(_PRESS_S / STEP_S)
    for step in range(steps):
        z = _pressing_height_m(runner, z, runner.log.pressing_n({screw}, through))
        arm.wanted = replace(arm.wanted, position=np.array([x, y, z]))
        runner.step()
        if step >= steps // 2 and step % STEPS_PER_FRAME == 0:
            readings.append(runner.log.pressing_n({screw}, through))
    arm.press_n = 0.0
    runner.sensed["fastening_force_n"] = float(np.mean(readings))
    runner.unbind()
    world.weigh(screw, runner.scene.body(screw).mass_kg)
    runner.carry(None)


def _pressing_height_m(runner: SkillRunner, height_m: float, felt_n: float) -> float:
    """Return at what height the tip is to be while it presses [m].

    Under operational-space control a force is asked for, and the height gives way to it;
    position control is lowered until as much is felt.
    """
    if runner.settings.control == "osc":
        return float(runner.arm.tip().position[2])
    short = felt_n < runner.settings.press_force_n
    return height_m - _PRESS_SPEED_M_PER_S * STEP_S if short else height_m
