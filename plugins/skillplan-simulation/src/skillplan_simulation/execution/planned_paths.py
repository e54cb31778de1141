"""Timed joint paths of skills, the same that ``swept`` checks.

Only this module uses the planner of `skillplan-pinocchio`. It returns postures and timed travels.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from skillplan.physics.linear_motions import LinearMotion, choose_visit_grasp
from skillplan.task.motion import Event, GraspKind
from skillplan.task.pose import Point
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan_pinocchio.arm_paths import ArmPaths, MotionPaths, PathSettings, SkillPaths
from skillplan_pinocchio.inverse_kinematics import Unreachable
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.planning.travel import Travel, Unfound
from skillplan_pinocchio.skill_travels import TravelTo
from skillplan_pinocchio.timing.slow_zones import SlowZones
from skillplan_pinocchio.timing.trajectory import JointLimits, find_fastest_trajectory
from skillplan_simulation.execution_settings import ExecutionSettings
from skillplan_simulation.kinematics import UnreachableError, Vector, get_kinematics, points_down
from skillplan_simulation.motions import ArmMotion, JointMotion, JointRun, SlowedRun

# Share of the acceleration limit for a gripped part that is turned in space, where it creeps.
_TURNED_SHARE = 1 / 3
# Share of the payload from which a travel with a part takes longer, and the factor: at the limits
# of the joints, the torques of the drives accelerate the arm alone.
_HEAVY_SHARE, _HEAVY_FACTOR = 0.5, 2.0


_STILL: Point = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class PlannedSkill:
    """Joint paths of a skill.

    Parameters
    ----------
    motions
        Motions in order; empty if no path was found.
    begin_rad
        Posture before the first travel [rad], shape (joints,).
    present, absent
        Facts that hold, or do not hold, on which the paths rest.
    travels
        Travels around obstacles as JSON values, equal to those in evidence of ``swept``.
    unfound
        Reason why no path was found within the planner's budget, or None.
    """

    motions: tuple[ArmMotion, ...]
    begin_rad: Vector
    present: State
    absent: State
    travels: tuple[dict[str, Any], ...]
    unfound: str | None = None

    @property
    def travels_first(self) -> bool:
        """Return whether the travel to the skill is simulated as part of it."""
        return self.motions[0].matters


class PlannedPaths:
    """Plans the joint paths of a task's skills.

    Parameters
    ----------
    task
        Task with one robot.
    """

    def __init__(self, task: Task, settings: ExecutionSettings) -> None:
        self.task = task
        self.kinematics = get_kinematics(task.scene.robots[0])
        self.paths = ArmPaths(
            task,
            PathSettings(
                clearance_m=settings.clearance_m,
                drop_height_m=settings.drop_height_m,
                travel_checks=settings.travel_checks,
            ),
        )
        limits = JointLimits.of(task.scene.robots[0].model)
        self.limits = limits.scaled(settings.speed_fraction)
        self.slow_zones = SlowZones.of(task.scene, task.scene.robots[0])
        self.gripped_m_per_s2 = settings.acceleration_m_per_s2
        self._runs: dict[tuple[bytes, bool, bool, Point], JointRun] = {}

    def stand(self, state: State) -> Vector:
        """Return the posture at a state's place [rad], shape (joints,).

        Raises
        ------
        UnreachableError
            If the arm cannot stand there.
        """
        fact, joints_rad = self.paths.stand(state)
        if joints_rad is None:
            raise UnreachableError(f"the arm cannot stand where {fact} has it")
        return joints_rad

    def of(self, skill: Skill, state: State, begin_rad: Vector | None = None) -> PlannedSkill:
        """Return the joint paths of a skill.

        Parameters
        ----------
        skill
            Skill with one motion.
        begin_rad
            Start posture [rad], shape (joints,). Default: the posture at the state's place.

        Raises
        ------
        UnreachableError
            If the arm cannot follow.
        """
        paths = self.paths.paths(skill, state, begin_rad)
        if isinstance(paths, Unreachable):
            raise UnreachableError(paths.reason)
        basis = (paths.begin_rad, paths.present, paths.absent)
        unfound = paths.unfound
        if unfound is not None and not unfound.is_proof:
            return PlannedSkill((), *basis, (), unfound.reason)
        travels = (
            TravelTo(motion.motion.visit, motion.travel).evidence for motion in paths.motions
        )
        planned = tuple(travel for travel in travels if travel is not None)
        return PlannedSkill(tuple(self._motions(paths)), *basis, planned)

    def _motions(self, paths: SkillPaths) -> Iterator[ArmMotion]:
        here = paths.begin_rad
        for motion in paths.motions:
            yield self._motion(motion, here)
            here = motion.strokes.end

    def _motion(self, paths: MotionPaths, here: Vector) -> ArmMotion:
        strokes = paths.strokes
        travel = paths.travel
        if isinstance(travel, Unfound):
            # Every path collides: the simulation measures the force.
            travel = Travel(JointPath([here, strokes.begin]))
        rotation = self.kinematics.tip(strokes.down[-1].nodes[-1]).rotation
        turns = not (points_down(rotation) and points_down(self.kinematics.tip(here).rotation))
        return ArmMotion(
            paths.motion,
            rotation,
            strokes.down,
            strokes.up,
            JointMotion(
                self.kinematics,
                travel.path.nodes,
                self._run(travel.path, paths.motion, turns=turns),
            ),
            paths.is_checked or turns,
            travel.around,
        )

    def _run(self, path: JointPath, motion: LinearMotion, *, turns: bool) -> JointRun:
        """Return the fastest run along a path, slowed down if a gripped part might slip."""
        is_gripped = motion.visit.event is Event.RELEASE and (
            choose_visit_grasp(self.task.scene.body(motion.visit.subject), motion.visit).kind
            is GraspKind.JAWS
        )
        zones = None if self.slow_zones is None else self.slow_zones.with_tool(motion.tool)
        is_heavy = self._is_heavy(motion)
        beyond_m = _STILL if zones is None else zones.beyond_m
        key = path.nodes.tobytes(), is_gripped, is_heavy, beyond_m
        if key not in self._runs:
            limits = self.limits.stretched(_HEAVY_FACTOR) if is_heavy else self.limits
            run: JointRun = find_fastest_trajectory(path, limits)
            if is_gripped:
                share = _TURNED_SHARE if turns else 1.0
                run = SlowedRun.within(run, self.kinematics, share * self.gripped_m_per_s2)
                if isinstance(run, SlowedRun):
                    limits = limits.stretched(run.factor)
            if zones is not None:
                # Slow outside of zones as before, and inside no slower than they require.
                run = find_fastest_trajectory(path, limits, zones)
            self._runs[key] = run
        return self._runs[key]

    def _is_heavy(self, motion: LinearMotion) -> bool:
        """Return True if the drives have to accelerate a load near the arm's payload."""
        if motion.visit.event is not Event.RELEASE:
            return False
        scene = self.task.scene
        payload_kg = scene.robots[0].carries_kg
        mass_kg = scene.body(motion.visit.subject).mass_kg
        return payload_kg is not None and mass_kg > _HEAVY_SHARE * payload_kg
