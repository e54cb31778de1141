"""Which bodies can matter to a skill, and the facts that say whether they are there.

A body matters where a box about it comes near a box about what moves, or where it supports one
that does. Nothing else is put into the simulated world, so that an execution is a function of
the skill and of those facts.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from skillplan.collision.boxes import WorldBox, contact_area, sweep_hits, world_box, world_boxes
from skillplan.physics.jaws import jaw_opening_m
from skillplan.physics.linear_motions import LinearMotion, grasp_of
from skillplan.physics.tool_shapes import tool_shapes
from skillplan.task.motion import Event, Point
from skillplan.task.scene import WORLD, Body, Grasp, Placement, Pose
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan_pybullet.arm.hand_shapes import hand_boxes, tool_boxes, wrist_box

# Two bodies that are this close may touch when the hand is off its path [m].
MARGIN_M = 0.003
_TOUCH_M = 2e-4


@dataclass(frozen=True, slots=True)
class Located:
    """A body at one of its places, and the boxes about it."""

    body: Body
    placement: Placement
    boxes: tuple[WorldBox, ...]


@dataclass(frozen=True, slots=True)
class Neighbourhood:
    """What may be in the world of an execution.

    Parameters
    ----------
    bodies
        Those that are, with the poses they have, in the order of the task.
    present, absent
        The facts that decide it.
    near
        The places near what moves, whether anything is there or not; a support is in the world
        because of the body on it.
    """

    bodies: tuple[Located, ...]
    present: State
    absent: State
    near: tuple[Located, ...]

    def resting_on(self, facts: State) -> Neighbourhood:
        """Return the same, resting on facts that hold besides."""
        return replace(self, present=self.present | facts)


class Surroundings:
    """Knows what is near the motions of a task.

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
        self._located = tuple(
            Located(body, placement, world_boxes(body, placement.pose))
            for body in task.scene.bodies
            for placement in body.placements
            if placement.solid and placement.frame == WORLD
        )
        self._supports = {
            (one.body.name, one.placement.fact): tuple(self._beneath(one)) for one in self._located
        }
        self._near: dict[
            tuple[str, tuple[LinearMotion, ...], Point | None], tuple[Located, ...]
        ] = {}
        lowest_m = min(robot.safe_height_m for robot in task.scene.robots) - MARGIN_M
        # Nothing that the arm moves hangs below the safe height between two places.
        self.transfer_matters = any(
            box.high[2] > lowest_m for one in self._located for box in one.boxes
        )

    def around(
        self, skill: Skill, motions: Sequence[LinearMotion], state: State, here: Point | None = None
    ) -> Neighbourhood:
        """Return what may matter to a skill in a state.

        Parameters
        ----------
        skill
            With a motion.
        motions
            Of the skill.
        state
            Where it starts.
        here
            Where the transfer motion begins [m]; None where nothing can block one.
        """
        key = (skill.name, tuple(motions), here)
        if key not in self._near:
            self._near[key] = tuple(self._close_to(motions, here))
        handled = {motion.visit.subject for motion in motions}
        own = [
            one for one in self._located if one.body.name in handled and one.placement.fact in state
        ]
        return self._reaching_down([*own, *self._near[key]], state)

    def support(self, body: Located, state: State) -> Neighbourhood:
        """Return a body and its supports, direct or not."""
        return self._reaching_down([body], state)

    def stands_on_table(self, body: Located) -> bool:
        """Whether a body's bottom is on the table."""
        return min(box.low[2] for box in body.boxes) <= _TOUCH_M

    def _reaching_down(self, above: Sequence[Located], state: State) -> Neighbourhood:
        """Return bodies and the supports of those that are there, direct or not."""
        todo = sorted(above, key=self._located.index)
        looked_at: list[Located] = []
        while todo:
            one = todo.pop(0)
            if one not in looked_at:
                looked_at.append(one)
                if one.placement.fact in state:
                    todo += self._supports[one.body.name, one.placement.fact]
        looked_at.sort(key=self._located.index)
        there = tuple(one for one in looked_at if one.placement.fact in state)
        missing = [one.placement.fact for one in looked_at if one not in there]
        facts = self.task.facts
        present = facts.of(*(one.placement.fact for one in there))
        return Neighbourhood(there, present, facts.of(*missing), tuple(above))

    def _beneath(self, one: Located) -> Iterator[Located]:
        floor_m = min(box.low[2] for box in one.boxes)
        feet = [box for box in one.boxes if box.low[2] - floor_m <= _TOUCH_M]
        for other in self._located:
            if other.body.name != one.body.name and any(
                contact_area(foot, top, _TOUCH_M) is not None
                for foot in feet
                for top in other.boxes
            ):
                yield other

    def _close_to(self, motions: Sequence[LinearMotion], here: Point | None) -> list[Located]:
        near: list[Located] = []
        moving = [item for motion in motions for item in self._moving(motion)]
        if here is not None:
            for begin, motion in zip(
                [here, *(one.above for one in motions)], motions, strict=False
            ):
                moving += self._transferred(begin, motion)
        spared = {
            motion.visit.subject for motion in motions if motion.visit.event is not Event.DRIVE
        }
        for one in self._located:
            if one.body.name in spared:
                continue
            if any(
                sweep_hits(box, by, obstacle, -MARGIN_M)
                for box, by in moving
                for obstacle in one.boxes
            ):
                near.append(one)
        if any(motion.visit.event is Event.DRIVE for motion in motions):
            # What is pressed may tip, and what stands on it then counts.
            pressed = list(near)
            near += [
                one
                for one in self._located
                if one not in near
                and any(
                    support in pressed
                    for support in self._supports[one.body.name, one.placement.fact]
                )
            ]
        return near

    def _moving(self, motion: LinearMotion) -> Iterator[tuple[WorldBox, Point]]:
        """Yield what moves in a motion, at its lowest, and the displacement up from there."""
        low_m = motion.tip[2]
        by: Point = (0.0, 0.0, motion.above[2] - low_m)
        tip: Point = motion.tip
        yield world_box(wrist_box(), tip), by
        if motion.visit.event in (Event.GRASP, Event.RELEASE):
            body = self.task.scene.body(motion.visit.subject)
            grasp = grasp_of(body)
            yield from ((box, by) for box in self._hand(motion, grasp))
            # Down to its goal, also where it is let go from above.
            held = Pose.upright(motion.visit.position, motion.visit.yaw_rad)
            yield from ((box, by) for box in world_boxes(body, held))
            return
        tool = motion.tool
        for box in tool_boxes(tool):
            yield world_box(box, tip, motion.closing_yaw_rad), by
        if motion.visit.event is Event.LOAD:
            loaded = next(
                item
                for robot in self.task.scene.robots
                for item in robot.tools
                if item.name == motion.visit.subject
            )
            for box in tool_boxes(loaded):
                yield world_box(box, tip, motion.closing_yaw_rad), by
        if motion.visit.event is Event.DRIVE:
            screw = self.task.scene.body(motion.visit.subject)
            # A hole is felt for beyond its mouth.
            x_m, y_m, z_m = motion.visit.position
            deepest: Point = (x_m, y_m, z_m - self.press_travel_m)
            for box in screw.boxes:
                yield world_box(box, deepest), (0.0, 0.0, by[2] + self.press_travel_m)

    def _transferred(self, begin: Point, motion: LinearMotion) -> Iterator[tuple[WorldBox, Point]]:
        """Yield what the transfer motion to a motion moves, however turned, and how far."""
        x, y, z = motion.tip
        by: Point = (motion.above[0] - begin[0], motion.above[1] - begin[1], 0.0)
        lift_m = min(begin[2], motion.above[2]) - z
        rise_m = abs(begin[2] - motion.above[2])
        for box, _ in self._moving(motion):
            radius_m = max(
                math.hypot(corner_x - x, corner_y - y)
                for corner_x in (box.low[0], box.high[0])
                for corner_y in (box.low[1], box.high[1])
            )
            low = (begin[0] - radius_m, begin[1] - radius_m, box.low[2] + lift_m)
            high = (begin[0] + radius_m, begin[1] + radius_m, box.high[2] + lift_m + rise_m)
            yield WorldBox(low, high), by

    def _hand(self, motion: LinearMotion, grasp: Grasp) -> Iterator[WorldBox]:
        """Yield what takes or leaves a part: the hand, or the tool that is there instead."""
        if motion.tool is not None and tool_shapes(motion.tool):
            for box in tool_boxes(motion.tool):
                yield world_box(box, motion.tip, motion.closing_yaw_rad)
            return
        opening_m = jaw_opening_m(grasp, self.clearance_m, motion.tool)
        for box in hand_boxes(opening_m):
            yield world_box(box, motion.tip, motion.closing_yaw_rad)
