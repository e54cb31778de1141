"""Which bodies can matter to a skill, and the facts that say whether they are there.

A body matters where a box about it comes near a box about what moves, or where it bears one
that does. Nothing else is put into the simulated world, so that an execution is a function of
the skill and of those facts.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from skillplan.collision.boxes import WorldBox, contact_area, sweep_hits, world_box, world_boxes
from skillplan.physics.jaws import jaw_opening_m
from skillplan.physics.linear_motions import Stroke, grasp_of
from skillplan.physics.tool_shapes import tool_shapes
from skillplan.task.motion import Event, Point
from skillplan.task.scene import WORLD, Body, Grasp, Placement, Pose
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan_pybullet.hand_shapes import hand_boxes, tool_boxes, wrist_box

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
        The places near what moves, whether anything is there or not; what bears a body is
        there because of that body.
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
        self._bearers = {
            (one.body.name, one.placement.fact): tuple(self._beneath(one)) for one in self._located
        }
        self._near: dict[tuple[str, tuple[Stroke, ...], Point | None], tuple[Located, ...]] = {}
        lowest_m = min(robot.safe_height_m for robot in task.scene.robots) - MARGIN_M
        # Nothing that the arm moves hangs below the safe height between two places.
        self.travel_matters = any(
            box.high[2] > lowest_m for one in self._located for box in one.boxes
        )

    def around(
        self, skill: Skill, way: Sequence[Stroke], state: State, here: Point | None = None
    ) -> Neighbourhood:
        """Return what may matter to a skill in a state.

        Parameters
        ----------
        skill
            With a motion.
        way
            Its strokes.
        state
            Where it starts.
        here
            Where the arm travels from [m]; None where nothing can be in the way of a travel.
        """
        key = (skill.name, tuple(way), here)
        if key not in self._near:
            self._near[key] = tuple(self._close_to(way, here))
        handled = {stroke.visit.subject for stroke in way}
        own = [
            one for one in self._located if one.body.name in handled and one.placement.fact in state
        ]
        return self._reaching_down([*own, *self._near[key]], state)

    def support(self, body: Located, state: State) -> Neighbourhood:
        """Return a body and what bears it, directly or not."""
        return self._reaching_down([body], state)

    def stands_on_table(self, body: Located) -> bool:
        """Whether a body's bottom is on the table."""
        return min(box.low[2] for box in body.boxes) <= _TOUCH_M

    def _reaching_down(self, above: Sequence[Located], state: State) -> Neighbourhood:
        """Return bodies and what bears those that are there, directly or not."""
        todo = sorted(above, key=self._located.index)
        looked_at: list[Located] = []
        while todo:
            one = todo.pop(0)
            if one not in looked_at:
                looked_at.append(one)
                if one.placement.fact in state:
                    todo += self._bearers[one.body.name, one.placement.fact]
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

    def _close_to(self, way: Sequence[Stroke], here: Point | None) -> list[Located]:
        near: list[Located] = []
        moving = [item for stroke in way for item in self._moving(stroke)]
        if here is not None:
            for begin, stroke in zip([here, *(one.above for one in way)], way, strict=False):
                moving += self._travelling(begin, stroke)
        spared = {stroke.visit.subject for stroke in way if stroke.visit.event is not Event.DRIVE}
        for one in self._located:
            if one.body.name in spared:
                continue
            if any(
                sweep_hits(box, by, obstacle, -MARGIN_M)
                for box, by in moving
                for obstacle in one.boxes
            ):
                near.append(one)
        if any(stroke.visit.event is Event.DRIVE for stroke in way):
            # What is pressed may tip, and what stands on it then counts.
            pressed = list(near)
            near += [
                one
                for one in self._located
                if one not in near
                and any(
                    bearer in pressed for bearer in self._bearers[one.body.name, one.placement.fact]
                )
            ]
        return near

    def _moving(self, stroke: Stroke) -> Iterator[tuple[WorldBox, Point]]:
        """Yield what moves on a stroke, at its lowest, and the way up from there."""
        low_m = stroke.tip[2]
        by: Point = (0.0, 0.0, stroke.above[2] - low_m)
        tip: Point = stroke.tip
        yield world_box(wrist_box(), tip), by
        if stroke.visit.event in (Event.GRASP, Event.RELEASE):
            body = self.task.scene.body(stroke.visit.subject)
            grasp = grasp_of(body)
            yield from ((box, by) for box in self._hand(stroke, grasp))
            # Down to its goal, also where it is let go from above.
            held = Pose.upright(stroke.visit.position, stroke.visit.yaw_rad)
            yield from ((box, by) for box in world_boxes(body, held))
            return
        tool = stroke.tool
        for box in tool_boxes(tool):
            yield world_box(box, tip, stroke.closing_yaw_rad), by
        if stroke.visit.event is Event.LOAD:
            loaded = next(
                item
                for robot in self.task.scene.robots
                for item in robot.tools
                if item.name == stroke.visit.subject
            )
            for box in tool_boxes(loaded):
                yield world_box(box, tip, stroke.closing_yaw_rad), by
        if stroke.visit.event is Event.DRIVE:
            screw = self.task.scene.body(stroke.visit.subject)
            # A hole is felt for beyond its mouth.
            x_m, y_m, z_m = stroke.visit.position
            deepest: Point = (x_m, y_m, z_m - self.press_travel_m)
            for box in screw.boxes:
                yield world_box(box, deepest), (0.0, 0.0, by[2] + self.press_travel_m)

    def _travelling(self, begin: Point, stroke: Stroke) -> Iterator[tuple[WorldBox, Point]]:
        """Yield what moves on the travel to a stroke, however it is turned, and the way."""
        x, y, z = stroke.tip
        by: Point = (stroke.above[0] - begin[0], stroke.above[1] - begin[1], 0.0)
        lift_m = min(begin[2], stroke.above[2]) - z
        rise_m = abs(begin[2] - stroke.above[2])
        for box, _ in self._moving(stroke):
            radius_m = max(
                math.hypot(corner_x - x, corner_y - y)
                for corner_x in (box.low[0], box.high[0])
                for corner_y in (box.low[1], box.high[1])
            )
            low = (begin[0] - radius_m, begin[1] - radius_m, box.low[2] + lift_m)
            high = (begin[0] + radius_m, begin[1] + radius_m, box.high[2] + lift_m + rise_m)
            yield WorldBox(low, high), by

    def _hand(self, stroke: Stroke, grasp: Grasp) -> Iterator[WorldBox]:
        """Yield what takes or leaves a part: the hand, or the tool that is there instead."""
        if stroke.tool is not None and tool_shapes(stroke.tool):
            for box in tool_boxes(stroke.tool):
                yield world_box(box, stroke.tip, stroke.closing_yaw_rad)
            return
        opening_m = jaw_opening_m(grasp, self.clearance_m, stroke.tool)
        for box in hand_boxes(opening_m):
            yield world_box(box, stroke.tip, stroke.closing_yaw_rad)
