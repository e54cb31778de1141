"""Screws at the bit: put there, felt for their hole with, and pressed in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from skillplan.physics.linear_motions import LinearMotion
from skillplan.task.pose import DOWN, same_direction
from skillplan_pinocchio.kinematics.fixed_order import dot, times
from skillplan_simulation.arm.rotations import Vector, of_quaternion, pose_of
from skillplan_simulation.execution.contact_log import STEPS_PER_FRAME
from skillplan_simulation.execution.controlled_robot import ControlledRobot
from skillplan_simulation.simulator import STEP_S, TABLE

# A screw is brought so far above where it touches, and then felt for [m].
FEEL_FROM_M = 0.001

_FEEL_SPEED_M_PER_S = 0.01
_FELT_N = 0.2
_PRESS_S = 0.4
_PRESS_SPEED_M_PER_S = 0.004
# A screw of a gram between arm and workpiece would take more iterations to be pressed than
# there are: while the bit has it, it is as heavy as the bit's holder [kg].
_HELD_SCREW_KG = 0.1


def put_at_bit(robot: ControlledRobot, driven: LinearMotion, turned: Vector) -> None:
    """Put a screw at the bit, unless it is there already.

    Parameters
    ----------
    robot
        With a screwdriver.
    driven
        The motion that drives the screw, now or later.
    turned
        How the hand is turned in that, shape (3, 3).
    """
    screw = driven.visit.subject
    if robot.carried == screw:
        return
    world, body, tip = robot.world, robot.scene.body(screw), robot.arm.tip()
    # As it will be in its hole once it is driven.
    in_hand = times(turned.T, of_quaternion(driven.visit.pose.orientation))
    rotation = times(tip.rotation, in_hand)
    end = tip.position - body.height_m * rotation[:, 2]
    world.add(body, pose_of(end, rotation))
    world.weigh(screw, _HELD_SCREW_KG)
    robot.bind(screw)
    robot.carry(screw)


def drive(robot: ControlledRobot, motion: LinearMotion) -> None:
    """Feel for the hole's mouth and press, the force measured over the last half; let go then.

    Parameters
    ----------
    robot
        With the screw at its bit, outside the hole.
    motion
        The one that drives it; at its tip the screw touches.

    Raises
    ------
    StuckError
        If something blocks the arm.
    """
    world, arm, settings = robot.world, robot.arm, robot.settings
    assert arm.wanted is not None
    screw, along = motion.visit.subject, np.array(motion.visit.along)
    drivers = {screw, *robot.tools.robot_parts}
    through = {name for name in (*world.bodies, TABLE) if name not in drivers}
    # It lands on whatever is there; what else the robot touches meanwhile is not meant to be.
    robot.log.free.add(screw)
    contact = np.array(motion.tip)
    depth = dot(along, arm.wanted.position - contact)
    while depth < settings.press_travel_m and robot.log.pressing_n({screw}, through) < _FELT_N:
        depth += _FEEL_SPEED_M_PER_S * STEP_S
        _hold(robot, contact + depth * along)
        robot.step()
    arm.press_n = settings.press_force_n * along
    readings = []
    steps = round(_PRESS_S / STEP_S)
    for step in range(steps):
        if settings.control == "osc":
            # A force is commanded, and the depth yields to it.
            depth = dot(along, arm.tip().position - contact)
        elif robot.log.pressing_n({screw}, through) < settings.press_force_n:
            depth += _PRESS_SPEED_M_PER_S * STEP_S
        _hold(robot, contact + depth * along)
        robot.step()
        if step >= steps // 2 and step % STEPS_PER_FRAME == 0:
            readings.append(robot.log.pressing_n({screw}, through))
    arm.press_n = np.zeros(3)
    robot.sensed["fastening_force_n"] = float(np.mean(readings))
    robot.unbind()
    if not same_direction(motion.visit.along, DOWN):
        # Its thread holds it, where it would otherwise fall.
        bearing = world.nearest(screw, through)
        if bearing is not None:
            world.fasten(screw, bearing)
    world.weigh(screw, robot.scene.body(screw).mass_kg)
    robot.carry(None)


def _hold(robot: ControlledRobot, position: Vector) -> None:
    """Have the tip be at a point, not moving."""
    wanted = robot.arm.wanted
    assert wanted is not None
    robot.arm.wanted = replace(wanted, position=position, velocity=np.zeros(3))
