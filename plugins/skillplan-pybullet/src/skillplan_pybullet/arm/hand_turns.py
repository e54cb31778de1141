"""How the hand is turned at every target: jaws close alike when it is turned by half.

A part keeps the turn that it was picked up with, so that one turn is chosen for all that is done
with it, as near as can be to the posture in which the wrist has most room. It depends on the
task alone: a check of one skill and a whole plan agree on it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from skillplan.physics.linear_motions import LinearMotion, linear_motions
from skillplan.robots import panda
from skillplan.task.scene import Robot
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan_pybullet.arm.panda_kinematics import UnreachableError, Vector, reach

_READY = np.array(panda.READY_RAD)


@dataclass(frozen=True, slots=True)
class Posture:
    """How the arm is: its joint angles, shape (7,), and how the hand is turned [rad].

    Turns are counted beyond half a circle, as the wrist does.
    """

    joints: Vector
    yaw_rad: float


class HandTurns:
    """Knows the turns of a task's targets.

    Parameters
    ----------
    task
        With one robot.
    drop_height_m
        From how high parts are let go [m].
    """

    def __init__(self, task: Task, drop_height_m: float) -> None:
        self.robot: Robot = task.scene.robots[0]
        self._motions: dict[str, list[LinearMotion]] = {}
        self._heights: dict[str, float] = {}
        for skill in task.skills:
            for route in skill.motion.routes if skill.motion is not None else ():
                state: State = skill.precondition.requires | route.when
                motions = linear_motions(task, skill, state, drop_height_m)
                for motion in motions:
                    self._motions.setdefault(motion.visit.subject, []).append(motion)
                for fact in skill.prediction.add:
                    if fact in self.robot.places:
                        height_m = max(self._heights.get(fact, 0.0), motions[-1].above[2])
                        self._heights[fact] = height_m
        self._turns: dict[str, float] = {}

    def yaw_rad(self, motion: LinearMotion) -> float:
        """Return how the hand is turned in a motion [rad]."""
        subject = motion.visit.subject
        if subject not in self._turns:
            self._turns[subject] = min((0.0, math.pi), key=lambda turn: self._effort(subject, turn))
        return motion.closing_yaw_rad + self._turns[subject]

    def towards(self, motion: LinearMotion, now: Posture | None = None) -> Posture:
        """Return the posture above a motion's target, its turn counted as the wrist can get there.

        Parameters
        ----------
        motion
            One of the task.
        now
            The posture that it is reached from; None where the arm begins there.

        Raises
        ------
        UnreachableError
            If either end of the motion is out of reach.
        """
        yaw_rad = self.yaw_rad(motion)
        reach(motion.tip, yaw_rad, self.robot.base)
        joints = reach(motion.above, yaw_rad, self.robot.base)
        return Posture(joints, yaw_rad if now is None else unwound(yaw_rad, joints, now))

    def height_m(self, place_fact: str, least_m: float) -> float:
        """Return how high the tip is above a place after what ends there [m]."""
        return max(self._heights.get(place_fact, 0.0), least_m)

    def _effort(self, subject: str, turn_rad: float) -> float:
        """Return how far a turn takes the wrist from its middle at worst; infinite if too far."""
        worst = 0.0
        for motion in self._motions[subject]:
            yaw_rad = motion.closing_yaw_rad + turn_rad
            try:
                joints: Vector = reach(motion.tip, yaw_rad, self.robot.base)
                reach(motion.above, yaw_rad, self.robot.base, joints)
            except UnreachableError:
                return math.inf
            worst = max(worst, float(np.abs(joints - _READY).max()))
        return worst


def unwound(yaw_rad: float, joints: Vector, now: Posture) -> float:
    """Return the same turn of the hand, counted so that the wrist can get there.

    A hand that points down turns with its first joint and against its last.

    Parameters
    ----------
    yaw_rad, joints
        The turn that is to be reached, and the joint angles there [rad].
    now
        The posture at present.
    """
    wrist = (joints[0] - joints[6]) - (now.joints[0] - now.joints[6])
    turns = round((now.yaw_rad + float(wrist) - yaw_rad) / (2 * math.pi))
    return yaw_rad + 2 * math.pi * turns
