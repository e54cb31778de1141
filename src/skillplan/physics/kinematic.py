"""The dependency-free reference engine: via points within reach, and no dynamics.

Its final scene is the predicted one by construction. What it can find is a via point that the
arm cannot reach.
"""

from __future__ import annotations

import math

from skillplan.physics.engine import Engine
from skillplan.physics.linear_motions import linear_motions
from skillplan.task.motion import Event, Point, Visit
from skillplan.task.scene import Robot
from skillplan.task.skill import Skill
from skillplan.task.state import State
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
        for motion in linear_motions(self.task, skill, state):
            visit = motion.visit
            vertical = motion.is_vertical
            for point in self.via_points(robot, visit) if vertical else motion.approach:
                distance_m = math.dist(robot.base, point)
                if distance_m > robot.reach_m:
                    return Verdict.infeasible(
                        f"{visit.subject} at {_millimetres(point)} is {distance_m:.3f} m from "
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
        """Return the arms whose payload is unknown, so that no mass is held to it."""
        return tuple(
            f"payload of {robot.name}: not in the robot description; robot.payload_kg gives it"
            for robot in self.task.scene.robots
            if self.task.scene.bodies and robot.carries_kg is None
        )

    def via_points(self, robot: Robot, visit: Visit) -> tuple[Point, Point]:
        """Return the tip positions [m] straight above a target at safe height, and at it."""
        x_m, y_m, z_m = visit.position
        grip_m = 0.0
        if visit.event in (Event.GRASP, Event.RELEASE):
            grip_m = self.task.scene.body(visit.subject).height_m
        above: Point = (x_m, y_m, max(robot.safe_height_m, z_m) + grip_m)
        return above, (x_m, y_m, z_m + grip_m)


def _millimetres(point: Point) -> str:
    return "(" + ", ".join(f"{value:.3f}" for value in point) + ") m"
