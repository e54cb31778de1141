"""How the arm stands at the places of a task: as it ended the skill that leads there."""

from __future__ import annotations

from dataclasses import dataclass

from skillplan.physics.linear_motions import LinearMotion, linear_motions
from skillplan.task.motion import Point
from skillplan.task.scene import Robot
from skillplan.task.task import Task
from skillplan_pinocchio.arm_model import Vector
from skillplan_pinocchio.motion_plan import MotionPlanner


@dataclass(frozen=True)
class Stand:
    """Where the arm stands while a fact holds.

    Parameters
    ----------
    above
        Where the tip is [m].
    joints_rad
        How the arm stands there, shape (7,); None where it cannot.
    came_from_rad
        How it stood before it went there, shape (7,), where that path is no skill's own: as to look
        for a part whose grasp failed. What is done next takes the time of that path, too.
    """

    above: Point
    joints_rad: Vector | None
    came_from_rad: Vector | None = None


class Stands:
    """Knows how the arm stands at places, and above targets.

    Parameters
    ----------
    task
        The task.
    robot
        Its arm.
    planner
        Finds the paths of the joints.
    drop_height_m
        From how high above its goal a part is let go [m], >= 0.
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
        """Return how the arm stands at a place: as it ended the skill that leads there.

        Parameters
        ----------
        fact
            Says that it stands there.
        position
            Of the lowest point of tool and load [m]; counts where no skill leads.
        """
        if fact not in self._stands:
            self._stands[fact] = self._found(fact, position)
        return self._stands[fact]

    def postures_at_places(self) -> dict[str, Vector]:
        """Return how the arm stands at every place where it can [rad], by fact."""
        height_m = self.robot.safe_height_m
        found = {
            fact: self.at(fact, (place[0], place[1], height_m)).joints_rad
            for fact, place in self.robot.places.items()
        }
        return {fact: posture for fact, posture in found.items() if posture is not None}

    def postures_above_targets(self) -> list[Vector]:
        """Return how the arm stands where the motions of all skills begin [rad]."""
        return [
            elbow.strokes.begin
            for skill in self.task.skills
            if skill.motion is not None and skill.motion.robot == self.robot.name
            for motion in linear_motions(
                self.task,
                skill,
                skill.motion.routes[0].when | skill.precondition.requires,
                self.drop_height_m,
            )
            for elbow in self.planner.plan(motion).elbows[:1]
        ]

    def _found(self, fact: str, position: Point) -> Stand:
        motion = self._last.get(fact)
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
        """Return the last motion of the first skill that ends at every place, and may fail there.

        A skill that fails and leaves the arm at another place has made its motions, too.
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
            # A state in which the first route is the one that fits.
            state = skill.motion.routes[0].when | skill.precondition.requires
            motion = linear_motions(self.task, skill, state, self.drop_height_m)[-1]
            for fact in nominal:
                ends.setdefault(fact, motion)
            for fact in others:
                failed.setdefault(fact, motion)
        return ends, failed
