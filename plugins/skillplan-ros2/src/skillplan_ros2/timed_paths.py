"""The timed paths of a plan's skills, of the same source as those that are checked and simulated.

This is the only place where the planner of `skillplan-pinocchio` is asked.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skillplan.exporters.exporter import Handover, PlannedSkill
from skillplan_pinocchio.arm_paths import MotionPaths, SkillPaths
from skillplan_pinocchio.inverse_kinematics import Unreachable
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.planning.travel import Unfound
from skillplan_pinocchio.swept import SweptDetector
from skillplan_pinocchio.timing.trajectory import JointLimits, fastest_trajectory
from skillplan_ros2.skill_trajectory import Array, SkillTrajectory, TrajectoryPoints


class NoTrajectory(Exception):
    """That a skill of a plan has no trajectory; says why in a clause."""


@dataclass(frozen=True, slots=True, eq=False)
class TimedPlan:
    """The trajectories of a plan.

    Parameters
    ----------
    joints
        Their names, from the base to the hand.
    skills
        In the order of the plan; each begins where and when the one before ends.
    """

    joints: tuple[str, ...]
    skills: tuple[SkillTrajectory, ...]


def timed_plan(handover: Handover, speed_fraction: float | None) -> TimedPlan:
    """Return the trajectories of a plan.

    Parameters
    ----------
    handover
        With a plan.
    speed_fraction
        Share of the joints' limits of speed and acceleration, in (0, 1]; None for that of `swept`.

    Raises
    ------
    NoTrajectory
        If the task has no arm, or `swept` refuses a skill or finds no path for it.
    """
    robots = len(handover.task.scene.robots)
    if robots != 1:
        raise NoTrajectory(
            f"a joint trajectory is of one arm, and the task has {robots or 'none'}: export to csv"
        )
    for one in handover.skills:
        if one.skill.motion is None:
            raise NoTrajectory(f"{one.skill.name} is no motion of the arm: export to csv")
    timing = _Timing(handover, speed_fraction)
    found: list[SkillTrajectory] = []
    for skill in handover.skills:
        found.append(timing.trajectory(skill, found[-1] if found else None))
    names = tuple(joint.name for joint in handover.task.scene.robots[0].model.joints)
    return TimedPlan(names, tuple(found))


class _Timing:
    def __init__(self, handover: Handover, speed_fraction: float | None) -> None:
        self.feasibility = handover.model.feasibility
        # Where `swept` judges the plan, with the options that it judges by.
        judges = (
            back_end
            for back_end in self.feasibility.back_ends
            if isinstance(back_end, SweptDetector)
        )
        self.detector = next(judges, None) or SweptDetector(handover.task)
        fraction = speed_fraction or self.detector.options.speed_fraction
        self.limits = JointLimits.of(handover.task.scene.robots[0].model).scaled(fraction)

    def trajectory(self, one: PlannedSkill, before: SkillTrajectory | None) -> SkillTrajectory:
        """Return the trajectory of a skill from where and when the one before ends."""
        begin_rad = None if before is None else before.positions_rad[-1]
        paths = self._paths(one, begin_rad)
        points = TrajectoryPoints(paths.begin_rad)
        for motion in paths.motions:
            self._move(motion, points, one.skill.name)
        return points.of(one.skill.name, 0 if before is None else before.end_ns)

    def _paths(self, one: PlannedSkill, begin_rad: Array | None) -> SkillPaths:
        name = one.skill.name
        taken = self.feasibility.taken(one.skill, one.before)
        verdict = self.detector.check(taken, one.before)
        if not verdict.is_feasible:
            raise NoTrajectory(f"swept does not grant {name}: {verdict.reason}")
        paths = self.detector.paths.paths(taken, one.before, begin_rad)
        if isinstance(paths, Unreachable):
            raise NoTrajectory(f"swept finds no path for {name}: {paths.reason}")
        if paths.unfound is not None:
            raise NoTrajectory(f"swept finds no path for {name}: {paths.unfound.reason}")
        return paths

    def _move(self, one: MotionPaths, points: TrajectoryPoints, name: str) -> None:
        assert not isinstance(one.travel, Unfound)
        visit = one.motion.visit
        try:
            for path in (one.travel.path, *one.strokes.down):
                points.move(*self._run(path))
            points.act(visit.dwell_s, f"{visit.event.value} {visit.subject}")
            for path in one.strokes.up:
                points.move(*self._run(path))
        except ArithmeticError as error:
            raise NoTrajectory(
                f"no run along the path of {name} keeps the limits: {error}"
            ) from None

    def _run(self, path: JointPath) -> tuple[Array, Array, Array]:
        """Return times, positions and speeds at all places where a run changes how it gains speed.

        Between two of them it does so evenly, so that cubics through them are the run.
        """
        run = fastest_trajectory(path, self.limits)
        positions = path.along(run.places)
        # At its ends to the bit, and at rest.
        positions[0] = path.nodes[0]
        if len(run.places) > 1:
            positions[-1] = path.nodes[-1]
        slopes, _ = path.derivatives(run.places)
        return run.times_s, positions, np.asarray(slopes * run.rates_per_s[:, np.newaxis])
