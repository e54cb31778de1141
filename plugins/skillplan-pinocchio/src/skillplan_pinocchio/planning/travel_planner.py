"""Travels of a scene's robot, in any state: what swept checks, engines track and toppra times."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import pinocchio as pin

from skillplan.physics.linear_motions import LinearMotion
from skillplan.task.scene import Robot, Scene
from skillplan_pinocchio.arm_model import ArmModel
from skillplan_pinocchio.hand_sweeps import HandSweeps
from skillplan_pinocchio.kinematics.fixed_order import length
from skillplan_pinocchio.obstacles import Obstacle, obstacles_of
from skillplan_pinocchio.planning.arm_bodies import ArmBodies
from skillplan_pinocchio.planning.moving_solids import (
    MovingSolid,
    Vector,
    arm_solids,
    held_solid,
)
from skillplan_pinocchio.planning.rrt_connect import JointSpace
from skillplan_pinocchio.planning.travel import Holds, Travel, TravelSearch, Unfound

MOST_CHECKS: Final = 5_000


class TravelPlanner:
    """Finds how the arm travels to where a motion begins, with what it holds there.

    Parameters
    ----------
    arm
        The arm.
    sweeps
        Say what is at its end.
    obstacles
        All that there may be in any state.
    most_checks
        Postures that are checked for one travel before it is given up, >= 1.
    check_arm
        Whether the links of the arm are checked.
    """

    def __init__(
        self,
        arm: ArmModel,
        sweeps: HandSweeps,
        obstacles: Sequence[Obstacle],
        *,
        most_checks: int = MOST_CHECKS,
        check_arm: bool = True,
    ) -> None:
        self.arm = arm
        self.sweeps = sweeps
        self._links = arm_solids(arm) if check_arm else ()
        space = joint_space(arm.model, arm.low_rad, arm.high_rad)
        self._search = TravelSearch(obstacles, space, most_checks)

    @classmethod
    def of(cls, scene: Scene, robot: Robot, clearance_m: float = 0.004) -> TravelPlanner:
        """Return the planner of a scene's robot, for whoever tracks the paths that it finds.

        Parameters
        ----------
        scene
            The task's scene.
        robot
            One of its robots.
        clearance_m
            How far open jaws are from the part on either side [m], >= 0.
        """
        sweeps = HandSweeps(scene, robot, clearance_m)
        return cls(ArmModel.of(robot), sweeps, obstacles_of(scene))

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """All that there may be in any state."""
        return self._search.obstacles

    def travel(
        self, start_rad: Vector, goal_rad: Vector, motion: LinearMotion, holds: Holds
    ) -> Travel | Unfound:
        """Return how the arm gets to where a motion begins.

        Parameters
        ----------
        start_rad
            Where the joints are, shape (joints,).
        goal_rad
            Where they are with the tip at the motion's first point.
        motion
            What follows; what it carries and the tool that it uses travel along.
        holds
            Says of a fact whether it holds. It is asked only for those that the answer rests on:
            in every state that agrees about them, the travel is the same. Of a state,
            ``state.__contains__`` does.

        Returns
        -------
        Travel
            With the path that `swept` checked, the same for whoever asks; or why none was found.
        """
        ends = (np.asarray(start_rad, dtype=float), np.asarray(goal_rad, dtype=float))
        spares = frozenset() if motion.carries is None else frozenset({motion.carries})
        return self._search.find(motion, lambda: self._bodies(motion, ends[1]), ends, spares, holds)

    def _bodies(self, motion: LinearMotion, goal_rad: Vector) -> ArmBodies:
        """Return what moves: what is held is fixed to the last joint as it is at the goal."""
        model = self.arm.model
        data = model.createData()
        pin.forwardKinematics(model, data, goal_rad)
        last = model.njoints - 1
        back = data.oMi[last].inverse()
        solids: list[MovingSolid] = [*self._links]
        for name, pieces in self.sweeps.held(motion, motion.above):
            solids += [held_solid(name, last, piece, back) for piece in pieces]
        return ArmBodies(model, solids, self.arm.home_rad)


def joint_space(model: Any, low_rad: Vector, high_rad: Vector) -> JointSpace:
    """Return the joints of an arm with how far each moves anything at most.

    Parameters
    ----------
    model
        The arm's `pinocchio.Model`, with a frame `tip`.
    low_rad, high_rad
        Limits of the joints, shape (joints,).
    """
    tip = model.frames[model.getFrameId("tip")].placement.translation
    links = [*(placement.translation for placement in list(model.jointPlacements)[2:]), tip]
    lengths_m = [length(link) for link in links]
    reach_m = np.cumsum(lengths_m[::-1])[::-1]
    # What is about the last joint's own axis is moved by it, too.
    return JointSpace(low_rad, high_rad, np.maximum(reach_m, 0.1))
