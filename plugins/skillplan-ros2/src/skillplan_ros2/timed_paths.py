"""Timed paths of a plan's skills, from the source that detectors and engines use.

This is the only module that calls the planner of `skillplan-pinocchio`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skillplan.exporters.exporter import Handover, PlannedSkill
from skillplan.task.motion import Event, Visit
from skillplan.task.scene import Tool
from skillplan.task.skill import FeederClock
from skillplan_pinocchio.arm_paths import MotionPaths, SkillPaths
from skillplan_pinocchio.inverse_kinematics import Unreachable
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.planning.travel import Unfound
from skillplan_pinocchio.swept import SweptDetector
from skillplan_pinocchio.timing.slow_zones import SlowZones
from skillplan_pinocchio.timing.trajectory import JointLimits, find_fastest_trajectory
from skillplan_ros2.skill_trajectory import NS_PER_S, Array, SkillTrajectory, TrajectoryPoints


class NoTrajectory(Exception):
    """A skill of a plan has no trajectory; the message is a clause."""


@dataclass(frozen=True, slots=True, eq=False)
class TimedPlan:
    """The trajectories of a plan.

    Parameters
    ----------
    joints
        Names of the joints, from the base to the hand.
    skills
        In the order of the plan; each begins at the end of the one before.
    """

    joints: tuple[str, ...]
    skills: tuple[SkillTrajectory, ...]


def time_plan(handover: Handover, speed_fraction: float | None) -> TimedPlan:
    """Return the trajectories of a plan.

    Parameters
    ----------
    speed_fraction
        Share of the limits of speed and acceleration, in (0, 1]; None for the option of `swept`.

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
    timing = _Timing(handover, speed_fraction)
    trajectories: list[SkillTrajectory] = []
    for skill in handover.skills:
        trajectories.append(timing.trajectory(skill, trajectories[-1] if trajectories else None))
    names = tuple(joint.name for joint in handover.task.scene.robots[0].model.joints)
    return TimedPlan(names, tuple(trajectories))


class _Timing:
    def __init__(self, handover: Handover, speed_fraction: float | None) -> None:
        self.feasibility = handover.model.feasibility
        # Use the options of `swept` if it judges the plan.
        judges = (
            back_end
            for back_end in self.feasibility.back_ends
            if isinstance(back_end, SweptDetector)
        )
        self.detector = next(judges, None) or SweptDetector(handover.task)
        fraction = speed_fraction or self.detector.options.speed_fraction
        scene = handover.task.scene
        self.limits = JointLimits.of(scene.robots[0].model).scaled(fraction)
        self.slow_zones = SlowZones.of(scene, scene.robots[0])
        self.feeders, self.scene = FeederClock(), scene

    def trajectory(self, planned: PlannedSkill, before: SkillTrajectory | None) -> SkillTrajectory:
        """Return the trajectory of a skill from the end of the one before."""
        begin_rad = None if before is None else before.positions_rad[-1]
        end_ns = 0 if before is None else before.end_ns
        begin_ns = end_ns + round(planned.skill.compute_wait_s(end_ns / NS_PER_S) * NS_PER_S)
        if planned.skill.motion is None:
            points = TrajectoryPoints(self._stand(planned) if begin_rad is None else begin_rad)
            points.act(planned.skill.duration_s.at(planned.before), planned.skill.name)
        else:
            paths = self._paths(planned, begin_rad)
            points = TrajectoryPoints(paths.begin_rad)
            for motion in paths.motions:
                self._move(motion, points, planned, begin_ns / NS_PER_S)
        return points.of(planned.skill.name, begin_ns)

    def _stand(self, planned: PlannedSkill) -> Array:
        """Return the posture in which the arm stands before a skill without motion."""
        place, joints_rad = self.detector.paths.stand(planned.before)
        if joints_rad is None:
            raise NoTrajectory(f"the arm cannot stand where {place} has it")
        return joints_rad

    def _paths(self, planned: PlannedSkill, begin_rad: Array | None) -> SkillPaths:
        name = planned.skill.name
        taken = self.feasibility.taken(planned.skill, planned.before)
        verdict = self.detector.check(taken, planned.before)
        if not verdict.is_feasible:
            raise NoTrajectory(f"swept does not grant {name}: {verdict.reason}")
        paths = self.detector.paths.paths(taken, planned.before, begin_rad)
        if isinstance(paths, Unreachable):
            raise NoTrajectory(f"swept finds no path for {name}: {paths.reason}")
        if paths.unfound is not None:
            raise NoTrajectory(f"swept finds no path for {name}: {paths.unfound.reason}")
        return paths

    def _turn(self, planned: PlannedSkill, visit: Visit, points: TrajectoryPoints) -> None:
        """Add the turn of a workholder."""
        workholder = self.scene.find_workholder(visit.subject)
        begin, end = map(workholder.find_orientation, (planned.before, planned.after))
        points.turn(
            visit.dwell_s,
            f"turn {visit.subject}",
            workholder.name,
            lambda share: workholder.move(begin, end, share).then(workholder.orientations[begin]),
        )

    def _move(
        self, paths: MotionPaths, points: TrajectoryPoints, planned: PlannedSkill, begin_s: float
    ) -> None:
        assert not isinstance(paths.travel, Unfound)
        visit, name = paths.motion.visit, planned.skill.name
        torque = "" if visit.torque_nm is None else f" with {visit.torque_nm:g} N m"
        try:
            points.move(*self._run(paths.travel.path, paths.motion.tool))
            if visit.event is Event.GRASP:
                points.rest(self.feeders.present(planned.skill, begin_s + points.now_s))
            down = zip(paths.strokes.down, paths.motion.least_times_s, strict=True)
            for path, least_s in down:
                points.move(*self._run(path, paths.motion.tool, least_s))
            tool = paths.motion.acting_tool
            # Several tools on one hand: the controller has to know which acts.
            acting = f" by {tool.name}" if tool is not None and paths.motion.is_exact else ""
            if visit.event is Event.TURN:
                self._turn(planned, visit, points)
            else:
                action = f"{visit.event.value} {visit.subject}"
                points.act(visit.dwell_s, f"{action}{acting}{torque}")
            for path in paths.strokes.up:
                points.move(*self._run(path, paths.motion.tool_after))
        except ArithmeticError as error:
            raise NoTrajectory(
                f"no run along the path of {name} keeps the limits: {error}"
            ) from None

    def _run(
        self, path: JointPath, tool: Tool | None, least_s: float = 0.0
    ) -> tuple[Array, Array, Array]:
        """Return times, positions and speeds at all changes of acceleration.

        Slower by a constant factor if `least_s` is more than the time of the run [s].

        The acceleration is constant in between, so cubics through these points reproduce the run.
        """
        zones = None if self.slow_zones is None else self.slow_zones.with_tool(tool)
        run = find_fastest_trajectory(path, self.limits, zones)
        positions = path.along(run.places)
        # Exact positions at both ends, at rest.
        positions[0] = path.nodes[0]
        if len(run.places) > 1:
            positions[-1] = path.nodes[-1]
        slopes, _ = path.derivatives(run.places)
        slower = max(1.0, least_s / run.duration_s) if run.duration_s > 0 else 1.0
        speeds = np.asarray(slopes * run.rates_per_s[:, np.newaxis]) / slower
        return run.times_s * slower, positions, speeds
