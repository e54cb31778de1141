"""Where the joints go in a task's skills: one source for what checks, executes, times and draws.

Whoever asks about the same skill from the same posture, where the same facts hold, gets the same
nodes to the bit, in any process: nothing depends on what was asked before.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from skillplan.physics.linear_motions import LinearMotion, linear_motions
from skillplan.task.scene import Robot
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan_pinocchio.arm_model import ArmModel, Vector
from skillplan_pinocchio.gravity import GravityCheck
from skillplan_pinocchio.hand_sweeps import HandSweeps
from skillplan_pinocchio.inverse_kinematics import Strokes, Unreachable
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.motion_plan import ArmMotion, MotionPlanner, holds_of
from skillplan_pinocchio.planning.travel import Travel, Unfound
from skillplan_pinocchio.planning.travel_planner import MOST_CHECKS, TravelHeights, TravelPlanner
from skillplan_pinocchio.shapes import obstacles_of
from skillplan_pinocchio.skill_travels import SafeTravels, SkillTravels
from skillplan_pinocchio.stands import Stands


@dataclass(frozen=True, slots=True)
class PathSettings:
    """What paths depend on beside the task.

    Parameters
    ----------
    clearance_m
        How far open jaws keep from the part, on either side [m], >= 0.
    drop_height_m
        From how high above its goal a part is let go [m], >= 0.
    tolerance_m
        Depth that still counts as touching without harm [m], >= 0.
    samples
        At how many equal intervals of a path links are checked, >= 1.
    check_arm
        Whether the links of the arm are checked.
    travel_checks
        Postures that are checked for one travel before it is given up, >= 1.
    """

    clearance_m: float = 0.004
    drop_height_m: float = 0.001
    tolerance_m: float = 2e-4
    samples: int = 40
    check_arm: bool = True
    travel_checks: int = MOST_CHECKS


@dataclass(frozen=True, eq=False)
class MotionPaths:
    """The paths of the joints in one approach-act-retreat motion, and to where it begins.

    Parameters
    ----------
    motion
        What the hand does.
    travel
        How it gets there; or that no way was found.
    is_checked
        Whether something may be met on the travel; else it is straight, and above all there is.
    strokes
        To the target, and back.
    """

    motion: LinearMotion
    travel: Travel | Unfound
    is_checked: bool
    strokes: Strokes


@dataclass(frozen=True, eq=False)
class SkillPaths:
    """The paths of the joints in one skill.

    Parameters
    ----------
    begin_rad
        Where they begin [rad], shape (joints,).
    motions
        In turn; after a travel that was not found within the budget there is none.
    present, absent
        The facts that they rest on, by their truth. How the arm moves besides depends on the tool,
        on the skill's route, and on `begin_rad`.
    """

    begin_rad: Vector
    motions: tuple[MotionPaths, ...]
    present: State
    absent: State

    @property
    def unfound(self) -> Unfound | None:
        """Why there is no path, or None."""
        travels = (motion.travel for motion in self.motions)
        return next((travel for travel in travels if isinstance(travel, Unfound)), None)


class ArmPaths:
    """Finds the paths of the joints in a task's skills.

    Parameters
    ----------
    task
        With one robot.
    settings
        What they depend on besides.
    """

    def __init__(self, task: Task, settings: PathSettings | None = None) -> None:
        self.task = task
        self.settings = settings or PathSettings()
        self.robot: Robot = task.scene.robots[0]
        self._planned: dict[tuple[int, str | None], tuple[Any, tuple[ArmMotion, ...]]] = {}

    @cached_property
    def planner(self) -> MotionPlanner:
        """Finds the paths to targets and back."""
        return MotionPlanner(
            ArmModel.of(self.robot),
            obstacles_of(self.task.scene),
            tolerance_m=self.settings.tolerance_m,
            samples=self.settings.samples,
            check_arm=self.settings.check_arm,
            held=self.sweeps.ends,
            holds=holds_of(self.task, self.settings.drop_height_m),
            gravity=self.gravity,
        )

    @cached_property
    def gravity(self) -> GravityCheck:
        """Hold the torques of gravity to the limits of the joints."""
        return GravityCheck(ArmModel.of(self.robot), self.task.scene, self.robot)

    @cached_property
    def stands(self) -> Stands:
        """Know how the arm stands at places."""
        return Stands(self.task, self.robot, self.planner, self.settings.drop_height_m)

    @cached_property
    def sweeps(self) -> HandSweeps:
        """Say what is at the arm's end."""
        return HandSweeps(self.task.scene, self.robot, self.settings.clearance_m)

    @cached_property
    def travel_planner(self) -> TravelPlanner:
        """Finds travels past what may be met."""
        return TravelPlanner(
            self.planner.arm,
            self.sweeps,
            self.planner.obstacles,
            most_checks=self.settings.travel_checks,
            check_arm=self.settings.check_arm,
        )

    @cached_property
    def safe_travels(self) -> SafeTravels:
        """Say on which travels nothing can be met."""
        return SafeTravels(
            TravelHeights(self.planner.arm, self.sweeps.width_m),
            self.robot.safe_height_m + self.settings.tolerance_m,
            max(obstacle.top_m for obstacle in self.planner.obstacles),
            self.stands.postures_at_places,
            self.stands.postures_above_targets,
        )

    def travels(self, motions: Sequence[ArmMotion]) -> SkillTravels:
        """Return the travels to some motions in turn."""
        return SkillTravels(motions, self.safe_travels, self.travel_planner, self.gravity)

    def motions(self, skill: Skill, state: State) -> tuple[ArmMotion, ...]:
        """Return the motions as the arm makes them; they do not depend on where it stands."""
        if skill.motion is None:
            raise ValueError(f"Skill {skill.name!r} has no motion.")
        visits = skill.motion.visits(state)
        tool = self.robot.tool(state)
        key = (id(visits), None if tool is None else tool.name)
        if key not in self._planned:
            planned = linear_motions(self.task, skill, state, self.settings.drop_height_m)
            motions = tuple(self.planner.plan(motion) for motion in planned)
            # With the visits, so that no others get their identity.
            self._planned[key] = visits, motions
        return self._planned[key][1]

    def stand(self, state: State) -> tuple[str, Vector | None]:
        """Return the fact that says where the arm stands, and its joint angles there [rad]."""
        fact, position = self.robot.place(state)
        return fact, self.stands.at(fact, position).joints_rad

    def paths(
        self, skill: Skill, state: State, begin_rad: Vector | None = None
    ) -> SkillPaths | Unreachable:
        """Return the paths of the joints in a skill.

        Parameters
        ----------
        skill
            With one motion.
        state
            Where it starts.
        begin_rad
            How the arm stands then, shape (joints,); as it does at the state's place by default,
            and where it cannot stand there, above the first target.

        Returns
        -------
        SkillPaths
            Of the elbows and the ways that a check by ``swept`` chooses; or what is out of reach.
        """
        planned = self.motions(skill, state)
        for one in planned:
            if one.unreachable is not None:
                return one.unreachable
        facts = _Facts(state)
        elbows = {number: _free_elbow(one, facts.hold) for number, one in enumerate(planned)}
        place, stand_rad = self.stand(state)
        if begin_rad is None:
            begin_rad = stand_rad
        if begin_rad is None:
            begin_rad = planned[0].elbows[elbows[0]].strokes.begin
        at_place = stand_rad is not None and np.array_equal(begin_rad, stand_rad)
        found = self._found(planned, place if at_place else None, begin_rad, elbows, facts.hold)
        return SkillPaths(begin_rad, tuple(found), facts.present, facts.absent)

    def _found(
        self,
        planned: Sequence[ArmMotion],
        place: str | None,
        begin_rad: Vector,
        elbows: Mapping[int, int],
        holds: Callable[[str], bool],
    ) -> list[MotionPaths]:
        found = []
        here = begin_rad
        for number, one in enumerate(planned):
            strokes = one.elbows[elbows[number]].strokes
            if number == 0 and place is not None:
                is_checked = self.safe_travels.needs_check(place, strokes.begin, holds)
            else:
                is_checked = not self.safe_travels.is_safe(here, strokes.begin)
            travel: Travel | Unfound = Travel(JointPath([here, strokes.begin]))
            if is_checked:
                travel = self.travel_planner.travel(here, strokes.begin, one.motion, holds)
            found.append(MotionPaths(one.motion, travel, is_checked, strokes))
            if isinstance(travel, Unfound) and not travel.is_proof:
                break
            here = strokes.end
        return found


class _Facts:
    """Looks at facts of a state, and remembers which."""

    def __init__(self, state: State) -> None:
        self.state = state
        self.present = self.absent = state.facts.none

    def hold(self, fact: str) -> bool:
        """Whether a fact holds, which is noted."""
        bit = self.state.facts.of(fact)
        if fact in self.state:
            self.present |= bit
            return True
        self.absent |= bit
        return False


def _free_elbow(motion: ArmMotion, holds: Callable[[str], bool]) -> int:
    """Return the first elbow whose links meet nothing that is there; the first if all do."""
    for number, elbow in enumerate(motion.elbows):
        if elbow.itself is None and not any(
            one.fact is None or holds(one.fact) for one, _ in elbow.meets
        ):
            return number
    return 0
