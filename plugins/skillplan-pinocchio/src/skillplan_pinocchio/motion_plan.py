"""The motions of a skill as the arm makes them: with which elbow, and what its links may meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from skillplan.physics.linear_motions import LinearMotion
from skillplan.task.motion import Point
from skillplan_pinocchio.arm_clearance import LinkSweep, LinkTouch
from skillplan_pinocchio.arm_model import ArmModel
from skillplan_pinocchio.arm_motion import descent_paths
from skillplan_pinocchio.inverse_kinematics import Unreachable
from skillplan_pinocchio.joint_path import JointPath
from skillplan_pinocchio.obstacles import Obstacle


@dataclass(frozen=True)
class Elbow:
    """One path of the joints down to a target.

    Parameters
    ----------
    path
        Of the joints.
    meets
        What its links run into wherever that is there, in order of the motion.
    """

    path: JointPath
    meets: tuple[tuple[Obstacle, LinkTouch], ...]

    @property
    def blocked(self) -> bool:
        """Whether it runs into what is always there."""
        return any(obstacle.fact is None for obstacle, _ in self.meets)


@dataclass(frozen=True)
class DescentPaths:
    """The paths of the joints straight down to a place.

    Parameters
    ----------
    elbows
        In the order in which they are preferred: the nearest to the ready pose of those that
        meet nothing, alone; otherwise all, those that meet the least first. Empty where there
        is none.
    unreachable
        Why there is none; None where there is one.
    """

    elbows: tuple[Elbow, ...]
    unreachable: Unreachable | None = None


@dataclass(frozen=True)
class ArmMotion:
    """A linear motion and the paths of the joints along it.

    Parameters
    ----------
    motion
        What the hand does.
    elbows, unreachable
        See :class:`DescentPaths`.
    """

    motion: LinearMotion
    elbows: tuple[Elbow, ...]
    unreachable: Unreachable | None = None


class MotionPlanner:
    """Finds the paths of the joints, once for each motion.

    Which path is preferred depends on the obstacles that there may be in any state, never on
    those that there are in one: so that a verdict rests on the facts of the obstacles met, and
    the time of a skill on none of them.

    Parameters
    ----------
    arm
        The arm.
    obstacles
        All that there may be.
    tolerance_m
        Depth that still counts as touching without harm [m], >= 0.
    samples
        How many equally spaced intervals of a path the links are checked at, >= 1.
    check_arm
        Whether the links are checked.
    """

    def __init__(
        self,
        arm: ArmModel,
        obstacles: Sequence[Obstacle],
        *,
        tolerance_m: float,
        samples: int,
        check_arm: bool,
    ) -> None:
        self.arm = arm
        self.obstacles = tuple(obstacles)
        self.tolerance_m = tolerance_m
        self.samples = samples
        self.check_arm = check_arm
        self._known: dict[tuple[Point, Point, float, frozenset[str]], DescentPaths] = {}

    def plan(self, motion: LinearMotion) -> ArmMotion:
        """Return how the arm makes a motion."""
        spares = spared(motion)
        paths = self.descents(motion.tip, motion.above, motion.closing_yaw_rad, spares)
        return ArmMotion(motion, paths.elbows, paths.unreachable)

    def descents(
        self, tip: Point, above: Point, closing_yaw: float, spares: frozenset[str]
    ) -> DescentPaths:
        """Return how the arm goes straight down to a place.

        Parameters
        ----------
        tip, above
            Where the tip of the hand ends, and begins [m].
        closing_yaw
            Direction in which the jaws are to close, from x about the vertical [rad].
        spares
            Bodies that may be touched.
        """
        key = (tip, above, closing_yaw, spares)
        if key not in self._known:
            self._known[key] = self._found(*key)
        return self._known[key]

    def met(
        self, path: JointPath, spares: frozenset[str]
    ) -> tuple[tuple[Obstacle, LinkTouch], ...]:
        """Return what the links run into on a path, in order of the motion.

        Parameters
        ----------
        path
            Of the joints.
        spares
            Bodies that may be touched.
        """
        if not self.check_arm:
            return ()
        sweep = LinkSweep(self.arm, path)
        found = [
            (obstacle, touch)
            for obstacle in self.obstacles
            if obstacle.body not in spares
            and (touch := sweep.touch(obstacle, self.tolerance_m, self.samples)) is not None
        ]
        return tuple(sorted(found, key=lambda pair: pair[1].touch.fraction))

    def _found(
        self, tip: Point, above: Point, closing_yaw: float, spares: frozenset[str]
    ) -> DescentPaths:
        elbows: list[Elbow] = []
        failures: list[Unreachable] = []
        for path in descent_paths(self.arm, tip, above, closing_yaw):
            if isinstance(path, Unreachable):
                failures.append(path)
                continue
            elbow = Elbow(path, self.met(path, spares))
            if not elbow.meets:
                return DescentPaths((elbow,))
            elbows.append(elbow)
        if not elbows:
            return DescentPaths((), min(failures, key=lambda failure: failure.distance_m))
        # Sorting keeps the order of those that meet equally much.
        return DescentPaths(
            tuple(sorted(elbows, key=lambda elbow: (elbow.blocked, len(elbow.meets))))
        )


def spared(motion: LinearMotion) -> frozenset[str]:
    """Return the bodies that a motion may touch: its target and what is carried."""
    carried = {motion.carries} if motion.carries is not None else set()
    return frozenset({motion.visit.subject} | carried)
