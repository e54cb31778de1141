"""What hand, tool and load sweep in a motion."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from itertools import pairwise

import numpy as np

from skillplan.physics.linear_motions import (
    LinearMotion,
    grasp_of,
    jaw_opening_m,
    tool_after,
    visited_grasp,
)
from skillplan.task.motion import Event, Point
from skillplan.task.pose import Pose, plus
from skillplan.task.scene import WORLD, Robot, Scene, Tool
from skillplan_pinocchio.hulls import HandPart, hand_parts
from skillplan_pinocchio.motion_plan import spared
from skillplan_pinocchio.obstacles import Obstacle
from skillplan_pinocchio.shapes import ConvexPiece, pieces_of, standing_pieces_of
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
        self._parts: dict[tuple[str | None, float], tuple[HandPart, ...]] = {}

    @cached_property
    def width_m(self) -> float:
        """How far hand, tool or load reaches from the axis of a hand that points down [m]."""
        tools: tuple[Tool | None, ...] = self.robot.tools or (None,)
        widest_m = [
            float(np.linalg.norm(corners[:, :2], axis=1).max())
            for tool in tools
            for part in hand_parts(self.robot, tool, self.robot.hand_of(tool).opening_m)
            for corners in part.corners
        ]
        for body in self.scene.bodies:
            if any(placement.frame != WORLD for placement in body.placements):
                corners = np.concatenate([piece.corners for piece in pieces_of(body, Pose(_STILL))])
                for grasp in body.grasps or (grasp_of(body),):
                    away = np.linalg.norm(corners - np.array(grasp.tip), axis=1)
                    widest_m.append(float(away.max()))
        return max(widest_m, default=0.0)

    def held(
        self, motion: LinearMotion, begin: Point
    ) -> Iterator[tuple[str, tuple[ConvexPiece, ...]]]:
        """Yield what is at the end of the arm before a motion acts: names, and pieces in the world.

        Parameters
        ----------
        motion
            The motion.
        begin
            Where the tip is [m].
        """
        for sweep in self._swept("", motion, begin, _STILL, after=False):
            yield sweep.mover, sweep.pieces

    def ends(
        self, motion: LinearMotion
    ) -> tuple[
        list[tuple[str, tuple[ConvexPiece, ...]]], list[tuple[str, tuple[ConvexPiece, ...]]]
    ]:
        """Return what is at the end of the arm where a motion begins, and where it ends."""
        after = self._swept("", motion, motion.ends_at, _STILL, after=True)
        return (
            list(self.held(motion, motion.above)),
            [(sweep.mover, sweep.pieces) for sweep in after],
        )

    def approach(self, motion: LinearMotion) -> Iterator[tuple[Sweep, ...]]:
        """Yield the sweeps of each straight stretch to the target, in order."""
        for number, (begin, end) in enumerate(pairwise(motion.approach), start=2):
            is_last = number == len(motion.approach)
            label = "the insertion" if is_last and number > 2 else "the approach"
            # Down to its goal, also where it is let go from above.
            target = motion.grasp_tip if is_last else end
            loads = [*self._load(label, motion, motion.carries, begin, _difference(begin, target))]
            if label == "the insertion" and motion.drop_m:
                loads += self._load(label, motion, motion.carries, begin, _difference(begin, end))
            yield (
                *loads,
                *self._hands(label, motion, begin, _difference(begin, end), after=False),
            )

    def retreat(self, motion: LinearMotion) -> Iterator[tuple[Sweep, ...]]:
        """Yield the sweeps of each straight stretch back to safe height, in order."""
        label = "the retreat"
        for begin, end in pairwise(motion.retreat):
            yield tuple(self._swept(label, motion, begin, _difference(begin, end), after=True))

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
        target = Obstacle(body.name, None, standing_pieces_of(body, visit.pose))
        for part in self._hand(motion, before=visit.event is Event.GRASP):
            pieces = part.along(motion, motion.grasp_tip)
            sweep = Sweep("", part.name, pieces, _STILL, frozenset())
            touch = sweep.touch(target, tolerance_m, 1)
            if touch is not None:
                return part.name, touch
        return None

    def _swept(
        self, label: str, motion: LinearMotion, begin: Point, by: Point, *, after: bool
    ) -> Iterator[Sweep]:
        """Yield the sweeps of load and hand while the tip goes straight from a point."""
        taken = motion.leaves_with if motion.visit.event in (Event.GRASP, Event.FETCH) else None
        carried = taken if after else motion.carries
        yield from self._load(label, motion, carried, begin, by)
        yield from self._hands(label, motion, begin, by, after=after)

    def _load(
        self, label: str, motion: LinearMotion, carried: str | None, begin: Point, by: Point
    ) -> Iterator[Sweep]:
        """Yield the sweep of what is carried, which the motion puts down or takes."""
        if carried is None or carried != motion.visit.subject:
            return
        offset = _difference(motion.grasp_tip, begin)
        pieces = pieces_of(self.scene.body(carried), motion.visit.pose.moved(offset))
        yield Sweep(label, carried, pieces, by, spared(motion))

    def _hands(
        self, label: str, motion: LinearMotion, begin: Point, by: Point, *, after: bool
    ) -> Iterator[Sweep]:
        for part in self._hand(motion, before=not after):
            yield Sweep(label, part.name, part.along(motion, begin), by, spared(motion))

    def _hand(self, motion: LinearMotion, *, before: bool) -> tuple[HandPart, ...]:
        """Return what is at the end of the arm before, or after, it acts."""
        tool = motion.tool if before else tool_after(self.robot, motion.visit, motion.tool)
        opening_m = 0.0
        if motion.visit.event in _HANDLING:
            grasp = visited_grasp(self.scene.body(motion.visit.subject), motion.visit)
            is_open = before is (motion.visit.event is Event.GRASP)
            clearance_m = self.clearance_m if is_open else 0.0
            opening_m = jaw_opening_m(grasp, clearance_m, tool, self.robot.hand)
        key = (None if tool is None else tool.name, opening_m)
        if key not in self._parts:
            self._parts[key] = hand_parts(self.robot, tool, opening_m)
        return self._parts[key]


def _difference(begin: Point, end: Point) -> Point:
    return plus(end, begin, -1.0)
