"""The engine ``kinematic``: via points within reach, without dynamics or dependencies.

Its final scene is the predicted one by construction, so the only fault is a via point out of reach.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from skillplan.physics.engine import Engine
from skillplan.physics.linear_motions import LinearMotion, plan_linear_motions
from skillplan.robots.arm_description import ArmDescription
from skillplan.robots.catalogue import PANDA, UR5E
from skillplan.task.motion import AXES, Event, Point, Visit
from skillplan.task.pose import plus
from skillplan.task.scene import Robot
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict


class KinematicEngine(Engine):
    """Check that every via point lies within the robot's reach."""

    name = "kinematic"
    expected_s = 1e-6

    def check(self, skill: Skill, state: State) -> Verdict:
        """Check the via points of `skill`; see :meth:`BackEnd.check`."""
        facts = self.task.facts
        present = facts.none
        if skill.motion is None:
            return Verdict.feasible(present, facts.none)
        robot = self.task.scene.robot(skill.motion.robot)
        if len(skill.motion.routes) > 1:
            present = next(
                route.when
                for route in skill.motion.routes
                if state.bits & route.when.bits == route.when.bits
            )
        for motion in plan_linear_motions(self.task, skill, state):
            visit = motion.visit
            vertical = motion.is_vertical
            points = self.via_points(robot, visit) if vertical else motion.approach
            tool = motion.acting_tool
            if vertical and tool is not None and tool.beyond_m:
                points = tuple(plus(point, AXES["z"], tool.beyond_m) for point in points)
            for point in points:
                distance_m = math.dist(robot.base, point)
                if distance_m > robot.reach_m:
                    return Verdict.infeasible(
                        f"{visit.subject} at {_format_point(point)} is {distance_m:.3f} m from "
                        f"the base of {robot.name}, which reaches {robot.reach_m:.3f} m",
                        present,
                        facts.none,
                        {
                            "via_point_m": list(point),
                            "distance_m": distance_m,
                            "reach_m": robot.reach_m,
                        },
                    )
        return Verdict.feasible(present, facts.none)

    def not_checked(self) -> tuple[str, ...]:
        """Return the arms with unknown payload, for which no mass is checked."""
        return tuple(
            f"payload of {robot.name}: not in the robot description; robot.payload_kg gives it"
            for robot in self.task.scene.robots
            if self.task.scene.bodies and robot.carries_kg is None
        )

    def via_points(self, robot: Robot, visit: Visit) -> tuple[Point, Point]:
        """Return the tip positions at safe height above a target, and at the target [m]."""
        x_m, y_m, z_m = visit.position
        grip_m = 0.0
        if visit.event in (Event.GRASP, Event.RELEASE):
            grip_m = self.task.scene.body(visit.subject).height_m
        above: Point = (x_m, y_m, max(robot.safe_height_m, z_m) + grip_m)
        return above, (x_m, y_m, z_m + grip_m)


def _format_point(point: Point) -> str:
    return "(" + ", ".join(f"{value:.3f}" for value in point) + ") m"


@dataclass(frozen=True)
class Annulus:
    """A ring about the axis of an arm's base, with a rectangular section.

    Parameters
    ----------
    near_m, far_m
        Distances from that axis [m], 0 <= near < far.
    low_m, high_m
        Heights above the foot of the base [m], low < high.
    """

    near_m: float
    far_m: float
    low_m: float
    high_m: float

    def holds(self, point: tuple[float, float, float]) -> bool:
        """Return True if a point in the frame of the base [m] lies in the ring."""
        distance_m = math.hypot(point[0], point[1])
        return self.near_m <= distance_m <= self.far_m and self.low_m <= point[2] <= self.high_m


# Measured with the inverse kinematics of both arms, for all rotations of the hand.
_FLANGES: Final = (
    (PANDA, Annulus(0.28, 0.75, 0.06, 0.41)),
    (UR5E, Annulus(0.28, 0.75, 0.06, 0.41)),
)


def find_downward_ring(arm: ArmDescription) -> Annulus | None:
    """Return a region in which the flange of an upright arm can point straight down.

    For every rotation about the vertical some posture within the joint limits exists there. The arm
    also reaches other points.

    Returns
    -------
    Annulus | None
        In the frame of the base; None for other arms.
    """
    return next((ring for known, ring in _FLANGES if known.joints == arm.joints), None)


# Greatest distance of a part between the fingers at which it is clear of the hand's body [m].
_MOST_DEPTH_M = 0.03


def is_surely_reached(task: Task, skill: Skill, state: State) -> bool:
    """Return True if the arm certainly reaches all visits of a skill without touching its load.

    The base must be upright and the hand must point straight down. False means that an arm model
    has to
    decide.
    """
    if skill.motion is None:
        return False
    robot = task.scene.robot(skill.motion.robot)
    return all(
        _is_near(robot, motion) and _measure_depth_m(task, motion) <= _MOST_DEPTH_M
        for motion in plan_linear_motions(task, skill, state)
    )


def _is_near(robot: Robot, motion: LinearMotion) -> bool:
    """Return True if the tip stays in the reachable region during approach and retreat."""
    ring = find_downward_ring(robot.model)
    if ring is None or not robot.mount.is_upright or not motion.points_down:
        return False
    x_m, y_m, z_m = robot.base
    up_m = robot.hand.tip_m - z_m
    return all(
        ring.holds((point[0] - x_m, point[1] - y_m, point[2] + up_m))
        for point in (*motion.approach, *motion.retreat)
    )


def _measure_depth_m(task: Task, motion: LinearMotion) -> float:
    """Return the height of the handled body above the tip of the hand [m]."""
    handled = motion.carries or motion.leaves_with
    if handled is None:
        return 0.0
    visit = motion.visit
    body = task.scene.body(visit.subject)
    return body.reach_m(visit.pose, (0.0, 0.0, 1.0)) - motion.grasp_tip[2]
