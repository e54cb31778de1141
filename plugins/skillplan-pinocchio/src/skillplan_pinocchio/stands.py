"""Postures of the arm at the places of a task: those in which skills that lead there end."""

from __future__ import annotations

from dataclasses import dataclass

from skillplan.physics.linear_motions import LinearMotion, plan_linear_motions
from skillplan.task.motion import Point
from skillplan.task.scene import Robot
from skillplan.task.task import Task
from skillplan_pinocchio.arm_model import Vector
from skillplan_pinocchio.motion_plan import MotionPlanner


@dataclass(frozen=True)
class Stand:
    """Posture of the arm while a fact holds.

    Parameters
    ----------
    above
        Position of the tip [m].
    joints_rad
        Joint angles there, shape (joints,); None if the arm cannot stand there.
    came_from_rad
        Posture before a path that belongs to no skill, such as the look for a part whose grasp
        failed, shape (joints,). The next skill includes the time of that path.
    """

    above: Point
    joints_rad: Vector | None
    came_from_rad: Vector | None = None


class Stands:
    """Computes postures at places and above targets.

    Parameters
    ----------
    drop_height_m
        Height above its goal at which a part is released [m], >= 0.
    """

    def __init__(
        self, task: Task, robot: Robot, planner: MotionPlanner, drop_height_m: float
    ) -> None:
        self.task = task
        self.robot = robot
        self.planner = planner
        self.drop_height_m = drop_height_m
        self._stands: dict[str, Stand] = {}
        self._last, self._failed = self._last_motions()

    def at(self, fact: str, position: Point) -> Stand:
        """Return the posture at a place: the end of the skill that leads there.

        Parameters
        ----------
        position
            Position of the lowest point of tool and load [m]; used if no skill leads there.
        """
        if fact not in self._stands:
            self._stands[fact] = self._compute(fact, position)
        return self._stands[fact]

    def postures_at_places(self) -> dict[str, Vector]:
        """Return the posture at every reachable place [rad], by fact."""
        height_m = self.robot.safe_height_m
        postures = {
            fact: self.at(fact, (place[0], place[1], height_m)).joints_rad
            for fact, place in self.robot.places.items()
        }
        return {fact: posture for fact, posture in postures.items() if posture is not None}

    def postures_above_targets(self) -> list[Vector]:
        """Return the start postures of all skills' motions [rad]."""
        return [
            elbow.strokes.begin
            for skill in self.task.skills
            if skill.motion is not None and skill.motion.robot == self.robot.name
            for motion in plan_linear_motions(
                self.task,
                skill,
                skill.motion.routes[0].when | skill.precondition.requires,
                self.drop_height_m,
            )
            for elbow in self.planner.plan(motion).elbows[:1]
        ]

    def _compute(self, fact: str, position: Point) -> Stand:
        motion = self._last.get(fact)
        tool = self.robot.tool(self.task.initial)
        if motion is None and tool is not None and tool.beyond_m:
            x_m, y_m, z_m = position
            position = (x_m, y_m, z_m + tool.beyond_m)
        if motion is not None:
            position = motion.ends_at
            elbows = self.planner.plan(motion).elbows
        else:
            elbows = self.planner.descents(position, position, 0.0, frozenset()).elbows
        before = self._failed.get(fact) if motion is None else None
        came_from = () if before is None else self.planner.plan(before).elbows
        return Stand(
            position,
            elbows[0].strokes.end if elbows else None,
            came_from[0].strokes.end if came_from else None,
        )

    def _last_motions(self) -> tuple[dict[str, LinearMotion], dict[str, LinearMotion]]:
        """Return the last motion of the first skill that ends at each place, or may fail there.

        A skill that fails and leaves the arm elsewhere has made its motions, too.
        """
        ends: dict[str, LinearMotion] = {}
        failed: dict[str, LinearMotion] = {}
        for skill in self.task.skills:
            if skill.motion is None or skill.motion.robot != self.robot.name:
                continue
            nominal = [fact for fact in skill.prediction.add if fact in self.robot.places]
            others = [
                fact
                for outcome in skill.effects
                for fact in outcome.add
                if fact in self.robot.places and fact not in nominal
            ]
            if not (nominal or others):
                continue
            # A state in which the first route applies.
            state = skill.motion.routes[0].when | skill.precondition.requires
            motion = plan_linear_motions(self.task, skill, state, self.drop_height_m)[-1]
            for fact in nominal:
                ends.setdefault(fact, motion)
            for fact in others:
                failed.setdefault(fact, motion)
        return ends, failed
