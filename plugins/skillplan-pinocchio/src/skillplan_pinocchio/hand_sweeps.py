"""What hand, tool and load sweep along a stroke."""

from __future__ import annotations

from collections.abc import Iterator

from skillplan.physics.jaws import jaw_opening_m
from skillplan.physics.linear_motions import Stroke, grasp_of, tool_after
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
    """Sweeps of everything that the arm holds, by stroke.

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

    def travel(self, stroke: Stroke, start: Point) -> Iterator[Sweep]:
        """Yield the sweeps from above one target to above the next.

        Parameters
        ----------
        stroke
            The one that follows.
        start
            Where the tip comes from [m]; it is taken at the height at which the travel ends.
        """
        by = (stroke.above[0] - start[0], stroke.above[1] - start[1], 0.0)
        offset = (-by[0], -by[1], self._safe_m(stroke) - stroke.visit.position[2])
        label = "the travel"
        spares = spared(stroke)
        for pieces in self._load(stroke, stroke.carries, offset):
            yield Sweep(label, str(stroke.carries), pieces, by, spares)
        tip = (start[0], start[1], stroke.above[2])
        for part in self._hand(stroke, before=True):
            yield Sweep(label, part.name, part.at(tip, stroke.closing_yaw_rad), by, spares)

    def approach(self, stroke: Stroke) -> Iterator[Sweep]:
        """Yield the sweeps down to the target."""
        fall_m = self._safe_m(stroke) - stroke.visit.position[2]
        label = "the approach"
        spares = spared(stroke)
        for pieces in self._load(stroke, stroke.carries, (0.0, 0.0, fall_m)):
            yield Sweep(label, str(stroke.carries), pieces, (0.0, 0.0, -fall_m), spares)
        by = (0.0, 0.0, stroke.tip[2] - stroke.above[2])
        for part in self._hand(stroke, before=True):
            pieces = part.at(stroke.above, stroke.closing_yaw_rad)
            yield Sweep(label, part.name, pieces, by, spares)

    def retreat(self, stroke: Stroke) -> Iterator[Sweep]:
        """Yield the sweeps up again."""
        label = "the retreat"
        spares = spared(stroke)
        if stroke.visit.event is Event.GRASP:
            rise_m = self._safe_m(stroke) - stroke.visit.position[2]
            for pieces in self._load(stroke, stroke.leaves_with, (0.0, 0.0, 0.0)):
                by = (0.0, 0.0, rise_m)
                yield Sweep(label, str(stroke.leaves_with), pieces, by, spares)
        by = (0.0, 0.0, stroke.above[2] - stroke.tip[2])
        for part in self._hand(stroke, before=False):
            pieces = part.at(stroke.tip, stroke.closing_yaw_rad)
            yield Sweep(label, part.name, pieces, by, spares)

    def clash(self, stroke: Stroke, tolerance_m: float) -> tuple[str, Touch] | None:
        """Return which part of the hand runs into the very body it handles, and where, or None.

        Parameters
        ----------
        stroke
            The stroke.
        tolerance_m
            Depth that still counts as touching without harm [m], >= 0.
        """
        visit = stroke.visit
        if visit.event not in _HANDLING:
            return None
        body = self.scene.body(visit.subject)
        pieces = pieces_of(body, Pose.upright(visit.position, visit.yaw_rad))
        target = Obstacle(body.name, None, pieces)
        # Where it is held, not a drop height above.
        tip = (stroke.tip[0], stroke.tip[1], visit.position[2] + grasp_of(body).tip[2])
        for part in self._hand(stroke, before=visit.event is Event.GRASP):
            sweep = Sweep("", part.name, part.at(tip, stroke.closing_yaw_rad), _STILL, frozenset())
            touch = sweep.touch(target, tolerance_m, 1)
            if touch is not None:
                return part.name, touch
        return None

    def _safe_m(self, stroke: Stroke) -> float:
        """Return the height at which the lowest point of the load travels [m]."""
        return max(self.robot.safe_height_m, stroke.visit.position[2])

    def _load(
        self, stroke: Stroke, carried: str | None, offset: Point
    ) -> Iterator[tuple[ConvexPiece, ...]]:
        """Yield the pieces of what is carried, displaced from where it is put or taken."""
        if carried is None or carried != stroke.visit.subject:
            return
        x, y, z = (a + b for a, b in zip(stroke.visit.position, offset, strict=True))
        yield pieces_of(self.scene.body(carried), Pose.upright((x, y, z), stroke.visit.yaw_rad))

    def _hand(self, stroke: Stroke, *, before: bool) -> tuple[HandPart, ...]:
        """Return what is at the end of the arm before, or after, it acts."""
        tool = stroke.tool if before else tool_after(self.robot, stroke.visit, stroke.tool)
        opening_m = 0.0
        if stroke.visit.event in _HANDLING:
            grasp = grasp_of(self.scene.body(stroke.visit.subject))
            is_open = before is (stroke.visit.event is Event.GRASP)
            opening_m = jaw_opening_m(grasp, self.clearance_m if is_open else 0.0, tool)
        return hand_parts(self.robot, tool, opening_m)
