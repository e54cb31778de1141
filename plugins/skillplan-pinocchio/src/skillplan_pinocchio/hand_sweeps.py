"""What hand, tool and load sweep in a motion."""

from __future__ import annotations

from collections.abc import Iterator

from skillplan.physics.jaws import jaw_opening_m
from skillplan.physics.linear_motions import LinearMotion, grasp_of, tool_after
from skillplan.task.motion import Event, Point
from skillplan.task.scene import Pose, Robot, Scene
from skillplan_pinocchio.hulls import HandPart, hand_parts
from skillplan_pinocchio.motion_plan import spared
from skillplan_pinocchio.obstacles import Obstacle
from skillplan_pinocchio.shapes import ConvexPiece, pieces_of
from skillplan_pinocchio.sweep import Sweep, Touch

_HANDLING = (Event.GRASP, Event.RELEASE)
_STILL: Point = (0.0, 0.0, 0.0)


class HandSweeps:
    """Sweeps of everything that the arm holds, by motion.

    Parameters
    ----------
    scene
        The task's scene.
    robot
        Whose hand it is.
    clearance_m
        How far open jaws are from the part on either side [m], >= 0.
    """

    def __init__(self, scene: Scene, robot: Robot, clearance_m: float) -> None:
        self.scene = scene
        self.robot = robot
        self.clearance_m = clearance_m

    def transfer(self, motion: LinearMotion, start: Point) -> Iterator[Sweep]:
        """Yield the sweeps from above one target to above the next.

        Parameters
        ----------
        motion
            The one that follows.
        start
            Where the tip comes from [m]; it is taken at the height at which the motion ends.
        """
        by = (motion.above[0] - start[0], motion.above[1] - start[1], 0.0)
        offset = (-by[0], -by[1], self._safe_m(motion) - motion.visit.position[2])
        label = "the travel"
        spares = spared(motion)
        for pieces in self._load(motion, motion.carries, offset):
            yield Sweep(label, str(motion.carries), pieces, by, spares)
        tip = (start[0], start[1], motion.above[2])
        for part in self._hand(motion, before=True):
            yield Sweep(label, part.name, part.at(tip, motion.closing_yaw_rad), by, spares)

    def approach(self, motion: LinearMotion) -> Iterator[Sweep]:
        """Yield the sweeps down to the target."""
        fall_m = self._safe_m(motion) - motion.visit.position[2]
        label = "the approach"
        spares = spared(motion)
        for pieces in self._load(motion, motion.carries, (0.0, 0.0, fall_m)):
            yield Sweep(label, str(motion.carries), pieces, (0.0, 0.0, -fall_m), spares)
        by = (0.0, 0.0, motion.tip[2] - motion.above[2])
        for part in self._hand(motion, before=True):
            pieces = part.at(motion.above, motion.closing_yaw_rad)
            yield Sweep(label, part.name, pieces, by, spares)

    def retreat(self, motion: LinearMotion) -> Iterator[Sweep]:
        """Yield the sweeps up again."""
        label = "the retreat"
        spares = spared(motion)
        if motion.visit.event is Event.GRASP:
            rise_m = self._safe_m(motion) - motion.visit.position[2]
            for pieces in self._load(motion, motion.leaves_with, (0.0, 0.0, 0.0)):
                by = (0.0, 0.0, rise_m)
                yield Sweep(label, str(motion.leaves_with), pieces, by, spares)
        by = (0.0, 0.0, motion.above[2] - motion.tip[2])
        for part in self._hand(motion, before=False):
            pieces = part.at(motion.tip, motion.closing_yaw_rad)
            yield Sweep(label, part.name, pieces, by, spares)

    def clash(self, motion: LinearMotion, tolerance_m: float) -> tuple[str, Touch] | None:
        """Return which part of the hand runs into the very body it handles, and where, or None.

        Parameters
        ----------
        motion
            The motion.
        tolerance_m
            Depth that still counts as touching without harm [m], >= 0.
        """
        visit = motion.visit
        if visit.event not in _HANDLING:
            return None
        body = self.scene.body(visit.subject)
        pieces = pieces_of(body, Pose.upright(visit.position, visit.yaw_rad))
        target = Obstacle(body.name, None, pieces)
        # Where it is held, not a drop height above.
        tip = (motion.tip[0], motion.tip[1], visit.position[2] + grasp_of(body).tip[2])
        for part in self._hand(motion, before=visit.event is Event.GRASP):
            sweep = Sweep("", part.name, part.at(tip, motion.closing_yaw_rad), _STILL, frozenset())
            touch = sweep.touch(target, tolerance_m, 1)
            if touch is not None:
                return part.name, touch
        return None

    def _safe_m(self, motion: LinearMotion) -> float:
        """Return the height at which the lowest point of the load is transferred [m]."""
        return max(self.robot.safe_height_m, motion.visit.position[2])

    def _load(
        self, motion: LinearMotion, carried: str | None, offset: Point
    ) -> Iterator[tuple[ConvexPiece, ...]]:
        """Yield the pieces of what is carried, displaced from where it is put or taken."""
        if carried is None or carried != motion.visit.subject:
            return
        x, y, z = (a + b for a, b in zip(motion.visit.position, offset, strict=True))
        yield pieces_of(self.scene.body(carried), Pose.upright((x, y, z), motion.visit.yaw_rad))

    def _hand(self, motion: LinearMotion, *, before: bool) -> tuple[HandPart, ...]:
        """Return what is at the end of the arm before, or after, it acts."""
        tool = motion.tool if before else tool_after(self.robot, motion.visit, motion.tool)
        opening_m = 0.0
        if motion.visit.event in _HANDLING:
            grasp = grasp_of(self.scene.body(motion.visit.subject))
            is_open = before is (motion.visit.event is Event.GRASP)
            opening_m = jaw_opening_m(grasp, self.clearance_m if is_open else 0.0, tool)
        return hand_parts(self.robot, tool, opening_m)
