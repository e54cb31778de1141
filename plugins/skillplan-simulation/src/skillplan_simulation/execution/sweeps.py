"""Boxes about what moves in a skill, and the straight ways that they go.

Where the hand points down, boxes turn about the vertical only. However else it is turned, boxes are
those about the turned ones, and the links of the arm count one by one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise, product

import numpy as np

from skillplan.collision.boxes import WorldBox, box_at, world_box, world_boxes
from skillplan.physics.linear_motions import LinearMotion, jaw_opening_m, tool_shapes, visited_grasp
from skillplan.task.grasp import AXES
from skillplan.task.motion import Event, Point
from skillplan.task.pose import Pose, plus
from skillplan.task.scene import Box
from skillplan.task.task import Task
from skillplan_pinocchio.kinematics.fixed_order import times
from skillplan_simulation.arm.hand_shapes import (
    hand_boxes,
    hand_of,
    tool_boxes,
    wrist_box,
)
from skillplan_simulation.arm.kinematics import ArmKinematics, Vector, kinematics_of
from skillplan_simulation.arm.link_bounds import LinkBounds
from skillplan_simulation.arm.planned_motion import ArmMotion

# A box, and the vector by which it is displaced [m].
Sweep = tuple[WorldBox, Point]

_STILL = (0.0, 0.0, 0.0)
# Boxes about links are about so many pieces of a way together.
_LINK_PIECES = 4


class Sweeps:
    """Knows what moves in the motions of a task.

    Parameters
    ----------
    task
        With one robot.
    clearance_m
        How far open jaws stand off a part on either side [m].
    press_travel_m
        How far beyond its mouth a hole is felt for [m].
    """

    def __init__(self, task: Task, clearance_m: float, press_travel_m: float) -> None:
        self.task = task
        self.clearance_m, self.press_travel_m = clearance_m, press_travel_m
        self.kinematics: ArmKinematics = kinematics_of(task.scene.robots[0])
        self.links = LinkBounds(self.kinematics)
        self.robot = task.scene.robots[0]

    def of_skill(self, planned: Sequence[ArmMotion]) -> list[Sweep]:
        """Return what moves in the motions of a skill, and on the travels that matter.

        Parameters
        ----------
        planned
            The motions.
        """
        found = [sweep for one in planned for sweep in self._of_motion(one)]
        for one in planned:
            if one.matters:
                found += self._of_travel(one)
        return found

    def _of_motion(self, planned: ArmMotion) -> Iterator[Sweep]:
        motion = planned.motion
        boxes = self._at_target(motion)
        if motion.is_vertical:
            up: Point = (0.0, 0.0, motion.above[2] - motion.tip[2])
            yield from ((box, up) for box in boxes)
            yield from self._of_links(planned.approach)
            return
        for begin, end in (*pairwise(motion.approach), *pairwise(motion.retreat)):
            offset, by = plus(begin, motion.tip, -1.0), plus(end, begin, -1.0)
            yield from ((box.moved(offset), by) for box in boxes)
        for begin_rad, end_rad in (*pairwise(planned.approach), *pairwise(planned.retreat)):
            yield from self._of_links([begin_rad, (begin_rad + end_rad) / 2, end_rad])

    def _at_target(self, motion: LinearMotion) -> list[WorldBox]:
        """Return boxes about hand, tool and load where a motion acts, and about the wrist."""
        event, visit = motion.visit.event, motion.visit
        upright = _tool_pose(motion)
        found = [box_at(box, upright) for box in self._hand(motion)]
        if motion.points_down:
            found.append(world_box(wrist_box(hand_of(self.robot, motion.tool)), motion.tip))
        if event in (Event.GRASP, Event.RELEASE, Event.FETCH):
            # Down to its goal, also where it is let go from above.
            found += world_boxes(self.task.scene.body(visit.subject), visit.pose)
        elif event is Event.DRIVE:
            screw = self.task.scene.body(visit.subject)
            # A hole is felt for beyond its mouth.
            deepest = visit.pose.moved(plus(_STILL, visit.along, self.press_travel_m))
            for pose in (visit.pose, deepest):
                found += world_boxes(screw, pose)
        return found

    def _hand(self, motion: LinearMotion) -> list[Box]:
        """Return boxes about what is on the arm, before or after a motion acts, from the tip."""
        tool, visit, hand = motion.tool, motion.visit, hand_of(self.robot, motion.tool)
        if visit.event in (Event.GRASP, Event.RELEASE):
            # The hand, or the tool that is there instead.
            if tool is not None and tool_shapes(tool, hand):
                return list(tool_boxes(tool, hand))
            grasp = visited_grasp(self.task.scene.body(visit.subject), visit)
            return list(hand_boxes(hand, jaw_opening_m(grasp, self.clearance_m, tool, hand)))
        found = list(tool_boxes(tool, hand))
        if visit.event is Event.LOAD:
            robots = self.task.scene.robots
            tools = (item for robot in robots for item in robot.tools)
            coupled = next(item for item in tools if item.name == visit.subject)
            found += tool_boxes(coupled, hand_of(self.robot, coupled))
        return found

    def _of_travel(self, planned: ArmMotion) -> Iterator[Sweep]:
        """Yield boxes about what a travel to a motion moves, piece by piece of the way."""
        postures = planned.travel.postures()
        target = self.kinematics.tip(planned.approach[-1])
        corners = np.array([_corners(box) for box in self._at_target(planned.motion)])
        held = times(corners - target.position, target.rotation)
        tips = [self.kinematics.tip(joints) for joints in postures]
        placed = [times(held, tip.rotation.T) + tip.position for tip in tips]
        for begin, end in pairwise(placed):
            lows = np.minimum(begin.min(axis=1), end.min(axis=1)).tolist()
            highs = np.maximum(begin.max(axis=1), end.max(axis=1)).tolist()
            for (ax, ay, az), (bx, by, bz) in zip(lows, highs, strict=True):
                yield WorldBox((ax, ay, az), (bx, by, bz)), _STILL
        for first in range(0, len(postures) - 1, _LINK_PIECES):
            yield from self._of_links(postures[first : first + _LINK_PIECES + 1])

    def _of_links(self, postures: Sequence[Vector]) -> Iterator[Sweep]:
        """Yield boxes about the links, on a way through some postures."""
        ways = np.array([self.links.at(joints) for joints in postures])
        lows, highs = ways[:, :, 0].min(axis=0), ways[:, :, 1].max(axis=0)
        for (ax, ay, az), (bx, by, bz) in zip(lows.tolist(), highs.tolist(), strict=True):
            yield WorldBox((ax, ay, az), (bx, by, bz)), _STILL


def _tool_pose(motion: LinearMotion) -> Pose:
    """Return the pose of a hand or tool where it acts: x along the closing axis, z backwards."""
    if motion.points_down:
        return Pose.upright(motion.tip, motion.closing_yaw_rad)
    x, y, z = motion.points
    return Pose.of_axes(motion.tip, motion.hand.rotate(AXES["x"]), (-x, -y, -z))


def _corners(box: WorldBox) -> list[Point]:
    xs, ys, zs = zip(box.low, box.high, strict=True)
    return list(product(xs, ys, zs))
