"""Where the joints go in a skill: the very paths that ``swept`` checks, timed.

This is the only place where the planner of `skillplan-pinocchio` is asked. What comes out is the
simulation's own: postures, and timed travels to be tracked.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from skillplan.physics.linear_motions import LinearMotion, visited_grasp
from skillplan.task.motion import Event, GraspKind
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan_pinocchio.arm_paths import ArmPaths, MotionPaths, PathSettings, SkillPaths
from skillplan_pinocchio.inverse_kinematics import Unreachable
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.planning.travel import Travel, Unfound
from skillplan_pinocchio.skill_travels import TravelTo
from skillplan_pinocchio.timing.trajectory import JointLimits, fastest_trajectory
from skillplan_simulation.execution_settings import ExecutionSettings
from skillplan_simulation.kinematics import UnreachableError, Vector, kinematics_of, points_down
from skillplan_simulation.motions import ArmMotion, JointMotion, JointRun, SlowedRun

# Of the acceleration of what jaws hold, where it is turned in space: it creeps in them.
_TURNED_SHARE = 1 / 3


@dataclass(frozen=True, slots=True, eq=False)
class PlannedSkill:
    """How the arm makes a skill.

    Parameters
    ----------
    motions
        In turn; empty where no way was found.
    begin_rad
        How the arm stands before the first travel [rad], shape (joints,).
    present, absent
        The facts that decide the paths, by their truth.
    travels
        The travels that go round something, as JSON values: the same as in evidence of ``swept``.
    unfound
        Why no way was found within the planner's budget; None where one was.
    """

    motions: tuple[ArmMotion, ...]
    begin_rad: Vector
    present: State
    absent: State
    travels: tuple[dict[str, Any], ...]
    unfound: str | None = None

    @property
    def travels_first(self) -> bool:
        """Whether the travel to the skill is part of it; else it is the same from anywhere."""
        return self.motions[0].matters


class PlannedPaths:
    """Knows the paths of a task's skills.

    Parameters
    ----------
    task
        With one robot.
    settings
        How the robot moves.
    """

    def __init__(self, task: Task, settings: ExecutionSettings) -> None:
        self.task = task
        self.kinematics = kinematics_of(task.scene.robots[0])
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
        self.gripped_m_per_s2 = settings.acceleration_m_per_s2
        self._runs: dict[tuple[bytes, bool], JointRun] = {}

    def stand(self, state: State) -> Vector:
        """Return how the arm stands at a state's place [rad], shape (joints,).

        Raises
        ------
        UnreachableError
            If it cannot.
        """
        fact, found = self.paths.stand(state)
        if found is None:
            raise UnreachableError(f"the arm cannot stand where {fact} has it")
        return found

    def of(self, skill: Skill, state: State, begin_rad: Vector | None = None) -> PlannedSkill:
        """Return how the arm makes a skill.

        Parameters
        ----------
        skill
            With one motion.
        state
            Where it starts.
        begin_rad
            How the arm stands then [rad], shape (joints,); as at the state's place by default.

        Raises
        ------
        UnreachableError
            If it cannot follow.
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

    def _motions(self, found: SkillPaths) -> Iterator[ArmMotion]:
        here = found.begin_rad
        for motion in found.motions:
            yield self._motion(motion, here)
            here = motion.strokes.end

    def _motion(self, one: MotionPaths, here: Vector) -> ArmMotion:
        strokes = one.strokes
        travel = one.travel
        if isinstance(travel, Unfound):
            # Whatever the way, something is run into: the simulation says with what force.
            travel = Travel(JointPath([here, strokes.begin]))
        rotation = self.kinematics.tip(strokes.down[-1].nodes[-1]).rotation
        turns = not (points_down(rotation) and points_down(self.kinematics.tip(here).rotation))
        return ArmMotion(
            one.motion,
            rotation,
            strokes.down,
            strokes.up,
            JointMotion(
                self.kinematics, travel.path.nodes, self._run(travel.path, one.motion, turns=turns)
            ),
            one.is_checked or turns,
            travel.around,
        )

    def _run(self, path: JointPath, motion: LinearMotion, *, turns: bool) -> JointRun:
        """Return the fastest run along a path, slowed where a part might slip in the jaws."""
        is_gripped = motion.visit.event is Event.RELEASE and (
            visited_grasp(self.task.scene.body(motion.visit.subject), motion.visit).kind
            is GraspKind.JAWS
        )
        key = path.nodes.tobytes(), is_gripped
        if key not in self._runs:
            run: JointRun = fastest_trajectory(path, self.limits)
            if is_gripped:
                share = _TURNED_SHARE if turns else 1.0
                run = SlowedRun.within(run, self.kinematics, share * self.gripped_m_per_s2)
            self._runs[key] = run
        return self._runs[key]
