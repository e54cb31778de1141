"""The strokes of a skill as the arm makes them: with which elbow, and what its links may meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from skillplan.physics.linear_motions import Stroke
from skillplan.task.motion import Point
from skillplan_pinocchio.arm_clearance import LinkSweep, LinkTouch
from skillplan_pinocchio.arm_model import ArmModel
from skillplan_pinocchio.arm_motion import stroke_paths
from skillplan_pinocchio.inverse_kinematics import Unreachable
from skillplan_pinocchio.obstacles import Obstacle
from skillplan_pinocchio.timing import JointPath


@dataclass(frozen=True)
class Elbow:
    """One way of the joints along a stroke.

    Parameters
    ----------
    path
        Down to the target.
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
class Ways:
    """The ways of the joints straight down to a place.

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
class ArmStroke:
    """A stroke and the ways of the joints along it.

    Parameters
    ----------
    stroke
        What the hand does.
    elbows, unreachable
        See :class:`Ways`.
    """

    stroke: Stroke
    elbows: tuple[Elbow, ...]
    unreachable: Unreachable | None = None


class MotionPlanner:
    """Finds the ways of the arm, once for each stroke.

    Which way is preferred depends on what may be in the way in any state, never on what is in
    the way in one: so that a verdict rests on the facts of the obstacles met, and the time of
    a skill on none of them.

    Parameters
    ----------
    arm
        The arm.
    obstacles
        Everything that may be in the way.
    tolerance_m
        Depth that still counts as touching without harm [m], >= 0.
    samples
        At so many places of a stroke the links are looked at, >= 1.
    check_arm
        Whether the links are looked at.
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
        self._known: dict[tuple[Point, Point, float, frozenset[str]], Ways] = {}

    def plan(self, stroke: Stroke) -> ArmStroke:
        """Return how the arm makes a stroke."""
        spares = spared(stroke)
        ways = self.ways(stroke.tip, stroke.above, stroke.closing_yaw_rad, spares)
        return ArmStroke(stroke, ways.elbows, ways.unreachable)

    def ways(self, tip: Point, above: Point, closing_yaw: float, spares: frozenset[str]) -> Ways:
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

    def _found(self, tip: Point, above: Point, closing_yaw: float, spares: frozenset[str]) -> Ways:
        elbows: list[Elbow] = []
        failures: list[Unreachable] = []
        for path in stroke_paths(self.arm, tip, above, closing_yaw):
            if isinstance(path, Unreachable):
                failures.append(path)
                continue
            elbow = Elbow(path, self.met(path, spares))
            if not elbow.meets:
                return Ways((elbow,))
            elbows.append(elbow)
        if not elbows:
            return Ways((), min(failures, key=lambda failure: failure.distance_m))
        # Sorting keeps the order of those that meet equally much.
        return Ways(tuple(sorted(elbows, key=lambda elbow: (elbow.blocked, len(elbow.meets)))))


def spared(stroke: Stroke) -> frozenset[str]:
    """Return the bodies that a stroke may touch: its target and what is carried."""
    carried = {stroke.carries} if stroke.carries is not None else set()
    return frozenset({stroke.visit.subject} | carried)
