"""Joint paths of a task's skills: one source for checks, execution, times and pictures.

Paths depend on the skill, the start posture and the facts they rest on, not on earlier queries;
they are equal bit for bit in any process.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from skillplan.physics.linear_motions import LinearMotion, plan_linear_motions
from skillplan.task.scene import Robot
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan_pinocchio.arm_model import ArmModel, Vector
from skillplan_pinocchio.gravity import GravityCheck
from skillplan_pinocchio.hand_sweeps import HandSweeps
from skillplan_pinocchio.inverse_kinematics import Strokes, Unreachable
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.motion_plan import ArmMotion, MotionPlanner, group_by_hold
from skillplan_pinocchio.planning.travel import Travel, Unfound
from skillplan_pinocchio.planning.travel_planner import MOST_CHECKS, TravelHeights, TravelPlanner
from skillplan_pinocchio.shapes import collect_obstacles
from skillplan_pinocchio.skill_travels import SafeTravels, SkillTravels
from skillplan_pinocchio.stands import Stands


@dataclass(frozen=True, slots=True)
class PathSettings:
    """Settings that joint paths depend on.

    Parameters
    ----------
    clearance_m
        Clearance of open jaws on either side of a part [m], >= 0.
    drop_height_m
        Height above its goal at which a part is released [m], >= 0.
    tolerance_m
        Penetration depth that counts as harmless touching [m], >= 0.
    samples
        Number of equal intervals of a path at which links are checked, >= 1.
    check_arm
        True if the links of the arm are checked.
    travel_checks
        Number of postures checked for one travel before it is given up, >= 1.
    """

    clearance_m: float = 0.004
    drop_height_m: float = 0.001
    tolerance_m: float = 2e-4
    samples: int = 40
    check_arm: bool = True
    travel_checks: int = MOST_CHECKS


@dataclass(frozen=True, eq=False)
class MotionPaths:
    """Joint paths of one approach-act-retreat motion and of the travel to it.

    Parameters
    ----------
    travel
        Travel to the motion, or the reason why none was found.
    is_checked
        True if the travel could meet an obstacle. Otherwise it is straight and above all obstacles.
    strokes
        Paths to the target and back.
    """

    motion: LinearMotion
    travel: Travel | Unfound
    is_checked: bool
    strokes: Strokes


@dataclass(frozen=True, eq=False)
class SkillPaths:
    """Joint paths of one skill.

    Parameters
    ----------
    begin_rad
        Start posture [rad], shape (joints,).
    motions
        Paths in order; they end after a travel that was not found within the budget.
    present, absent
        Facts that hold, or do not hold, on which the paths rest. Paths also depend on the tool, the
        route of the skill, and `begin_rad`.
    """

    begin_rad: Vector
    motions: tuple[MotionPaths, ...]
    present: State
    absent: State

    @property
    def unfound(self) -> Unfound | None:
        """Reason for a missing path, or None."""
        travels = (motion.travel for motion in self.motions)
        return next((travel for travel in travels if isinstance(travel, Unfound)), None)


class ArmPaths:
    """Plans the joint paths of a task's skills.

    Parameters
    ----------
    task
        Task with one robot.
    """

    def __init__(self, task: Task, settings: PathSettings | None = None) -> None:
        self.task = task
        self.settings = settings or PathSettings()
        self.robot: Robot = task.scene.robots[0]
        self._planned: dict[tuple[int, str | None], tuple[Any, tuple[ArmMotion, ...]]] = {}

    @cached_property
    def planner(self) -> MotionPlanner:
        """Planner of the paths to targets and back."""
        return MotionPlanner(
            ArmModel.of(self.robot),
            collect_obstacles(self.task.scene),
            tolerance_m=self.settings.tolerance_m,
            samples=self.settings.samples,
            check_arm=self.settings.check_arm,
            held=self.sweeps.ends,
            holds=group_by_hold(self.task, self.settings.drop_height_m),
            gravity=self.gravity,
        )

    @cached_property
    def gravity(self) -> GravityCheck:
        """Check of gravity torques against the joint limits."""
        return GravityCheck(ArmModel.of(self.robot), self.task.scene, self.robot)

    @cached_property
    def stands(self) -> Stands:
        """Postures of the arm at places."""
        return Stands(self.task, self.robot, self.planner, self.settings.drop_height_m)

    @cached_property
    def sweeps(self) -> HandSweeps:
        """Hand, tool and load at the end of the arm."""
        return HandSweeps(self.task.scene, self.robot, self.settings.clearance_m)

    @cached_property
    def travel_planner(self) -> TravelPlanner:
        """Planner of travels around obstacles."""
        return TravelPlanner(
            self.planner.arm,
            self.sweeps,
            self.planner.obstacles,
            most_checks=self.settings.travel_checks,
            check_arm=self.settings.check_arm,
        )

    @cached_property
    def safe_travels(self) -> SafeTravels:
        """Check whether a straight travel is above all obstacles."""
        return SafeTravels(
            TravelHeights(self.planner.arm, self.sweeps.width_m),
            self.robot.safe_height_m + self.settings.tolerance_m,
            max(obstacle.top_m for obstacle in self.planner.obstacles),
            self.stands.postures_at_places,
            self.stands.postures_above_targets,
        )

    def travels(self, motions: Sequence[ArmMotion]) -> SkillTravels:
        """Return the travels to several motions in order."""
        return SkillTravels(motions, self.safe_travels, self.travel_planner, self.gravity)

    def motions(self, skill: Skill, state: State) -> tuple[ArmMotion, ...]:
        """Return the planned motions of a skill; they do not depend on the start posture."""
        if skill.motion is None:
            raise ValueError(f"Skill {skill.name!r} has no motion.")
        visits = skill.motion.visits(state)
        tool = self.robot.tool(state)
        key = (id(visits), None if tool is None else tool.name)
        if key not in self._planned:
            planned = plan_linear_motions(self.task, skill, state, self.settings.drop_height_m)
            motions = tuple(self.planner.plan(motion) for motion in planned)
            # Keep the visits alive, so that their id stays unique.
            self._planned[key] = visits, motions
        return self._planned[key][1]

    def stand(self, state: State) -> tuple[str, Vector | None]:
        """Return the fact for the arm's place, and its joint angles there [rad]."""
        fact, position = self.robot.place(state)
        return fact, self.stands.at(fact, position).joints_rad

    def paths(
        self, skill: Skill, state: State, begin_rad: Vector | None = None
    ) -> SkillPaths | Unreachable:
        """Return the joint paths of a skill.

        Parameters
        ----------
        skill
            Skill with one motion.
        begin_rad
            Start posture, shape (joints,). Default: the posture at the state's place or, if the arm
            cannot stand there, above the first target.

        Returns
        -------
        SkillPaths or Unreachable
            Paths with the elbows and variants that ``swept`` chooses, or the target that is out of
            reach.
        """
        planned = self.motions(skill, state)
        for motion in planned:
            if motion.unreachable is not None:
                return motion.unreachable
        facts = _Facts(state)
        elbows = {
            number: _find_free_elbow(motion, facts.hold) for number, motion in enumerate(planned)
        }
        place, stand_rad = self.stand(state)
        if begin_rad is None:
            begin_rad = stand_rad
        if begin_rad is None:
            begin_rad = planned[0].elbows[elbows[0]].strokes.begin
        at_place = stand_rad is not None and np.array_equal(begin_rad, stand_rad)
        motion_paths = self._motion_paths(
            planned, place if at_place else None, begin_rad, elbows, facts.hold
        )
        return SkillPaths(begin_rad, tuple(motion_paths), facts.present, facts.absent)

    def _motion_paths(
        self,
        planned: Sequence[ArmMotion],
        place: str | None,
        begin_rad: Vector,
        elbows: Mapping[int, int],
        holds: Callable[[str], bool],
    ) -> list[MotionPaths]:
        paths = []
        here = begin_rad
        for number, motion in enumerate(planned):
            strokes = motion.elbows[elbows[number]].strokes
            if number == 0 and place is not None:
                is_checked = self.safe_travels.needs_check(place, strokes.begin, holds)
            else:
                is_checked = not self.safe_travels.is_safe(here, strokes.begin)
            travel: Travel | Unfound = Travel(JointPath([here, strokes.begin]))
            if is_checked:
                travel = self.travel_planner.travel(here, strokes.begin, motion.motion, holds)
            paths.append(MotionPaths(motion.motion, travel, is_checked, strokes))
            if isinstance(travel, Unfound) and not travel.is_proof:
                break
            here = strokes.end
        return paths


class _Facts:
    """Reads facts of a state and records them."""

    def __init__(self, state: State) -> None:
        self.state = state
        self.present = self.absent = state.facts.none

    def hold(self, fact: str) -> bool:
        """Return whether a fact holds; records it."""
        if fact in self.state:
            self.present |= self.state.facts.of(fact)
            return True
        self.absent |= self.state.find_missing(fact)
        return False


def _find_free_elbow(motion: ArmMotion, holds: Callable[[str], bool]) -> int:
    """Return the first elbow whose links meet no present obstacle, or else the first elbow."""
    for number, elbow in enumerate(motion.elbows):
        if elbow.itself is None and not any(
            obstacle.fact is None or holds(obstacle.fact) for obstacle, _ in elbow.meets
        ):
            return number
    return 0
