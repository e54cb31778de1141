"""How long skills take: transfer motions, linear motions down and up, and what the hand does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from skillplan.physics.linear_motions import LinearMotion, linear_motions
from skillplan.task.motion import Event, Point
from skillplan.task.scene import Robot
from skillplan.task.task import Task
from skillplan_pinocchio.arm_model import Vector
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.motion_plan import ArmMotion, MotionPlanner
from skillplan_pinocchio.timing.trajectory import JointLimits, fastest_trajectory


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


class SkillTimes:
    """Times of linear motions and of the transfer motions between them.

    Parameters
    ----------
    task
        The task.
    robot
        Its arm.
    planner
        Finds the paths of the joints.
    limits
        Of the joints.
    dwells_s
        How long the hand stays at a target [s], by what it does there.
    drop_height_m
        From how high above its goal a part is let go [m], >= 0.
    """

    def __init__(
        self,
        task: Task,
        robot: Robot,
        planner: MotionPlanner,
        limits: JointLimits,
        dwells_s: Mapping[Event, float],
        drop_height_m: float,
    ) -> None:
        self.task = task
        self.robot = robot
        self.planner = planner
        self.limits = limits
        self.dwells_s = dwells_s
        self.drop_height_m = drop_height_m
        self._stands: dict[str, Stand] = {}
        self._transfers: dict[tuple[bytes, bytes], JointPath] = {}
        self._paths_s: dict[bytes, float] = {}
        self._last, self._failed = self._last_motions()

    def duration_s(self, planned: tuple[ArmMotion, ...], stand: Stand) -> float | None:
        """Return how long some motions take in turn [s]; None where the arm cannot make them.

        Parameters
        ----------
        planned
            One at least.
        stand
            Where the arm stands before.
        """
        here = stand.joints_rad
        total_s = 0.0
        if stand.came_from_rad is not None and here is not None:
            total_s = self._path_s(self.transfer(stand.came_from_rad, here))
        for one in planned:
            if not one.elbows or here is None:
                return None
            strokes = one.elbows[0].strokes
            total_s += self._path_s(self.transfer(here, strokes.begin))
            stretches_s = sum(self._path_s(path) for path in strokes.distinct)
            if strokes.mirrored:
                # Up as down: the same speeds, and the opposite accelerations.
                stretches_s *= 2
            total_s += stretches_s + self.dwells_s[one.motion.visit.event]
            here = strokes.end
        # A nanosecond is beyond what the limits mean, and the same on every machine.
        return round(total_s, 9)

    def _path_s(self, path: JointPath) -> float:
        """Return how long a path takes from rest to rest [s]."""
        key = path.nodes.tobytes()
        if key not in self._paths_s:
            self._paths_s[key] = fastest_trajectory(path, self.limits).duration_s
        return self._paths_s[key]

    def transfer(self, start: Vector, end: Vector) -> JointPath:
        """Return the straight travel in joint space between two postures above targets.

        Also where something stands in it: how long a skill takes depends on places, not on that.
        """
        key = (start.tobytes(), end.tobytes())
        if key not in self._transfers:
            self._transfers[key] = JointPath([start, end])
        return self._transfers[key]

    def stand(self, fact: str, position: Point) -> Stand:
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

    def all_stands(self) -> dict[str, Vector]:
        """Return how the arm stands at every place where it can [rad], by fact."""
        height_m = self.robot.safe_height_m
        found = {
            fact: self.stand(fact, (place[0], place[1], height_m)).joints_rad
            for fact, place in self.robot.places.items()
        }
        return {fact: posture for fact, posture in found.items() if posture is not None}

    def all_begins(self) -> list[Vector]:
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
