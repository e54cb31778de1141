"""Bodies that can matter to a skill, and the facts that decide whether they are present.

A body matters if its box comes near a box of a moving part, or if it supports a body that matters.
The simulated world contains only these, so an execution is a function of the skill and of those
facts.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise, permutations, product

import numpy as np

from skillplan.collision.boxes import (
    WorldBox,
    box_at,
    contact_area,
    shank_boxes,
    sweep_hits,
    world_box,
    world_boxes,
)
from skillplan.physics.linear_motions import (
    LinearMotion,
    build_tool_shapes,
    choose_opening_m,
    choose_visit_grasp,
)
from skillplan.robots.arm_description import Hull, LinkShape
from skillplan.task.motion import AXES, Event, Point
from skillplan.task.pose import Pose, plus
from skillplan.task.scene import WORLD, Body, Box, Placement
from skillplan.task.skill import Skill
from skillplan.task.state import AND, State
from skillplan.task.task import Task
from skillplan_pinocchio.kinematics.fixed_order import times
from skillplan_simulation.execution.fastenings import Turn
from skillplan_simulation.kinematics import ArmKinematics, Vector, get_kinematics
from skillplan_simulation.motions import ArmMotion
from skillplan_simulation.robot_shapes import (
    get_hand,
    make_hand_boxes,
    make_tool_boxes,
    make_wrist_box,
)

# Assumed radius of a link without a known shape about the line between its joints [m].
_RADIUS_M = 0.15


class LinkBounds:
    """Bounding boxes of the links of an arm."""

    def __init__(self, kinematics: ArmKinematics) -> None:
        self._kinematics = kinematics
        shapes = kinematics.arm.description.shapes
        # The base is fixed, and so are its neighbours.
        self._links = [_collect_points(pieces) for pieces in shapes[1:]]

    def at(self, joints_rad: Vector) -> Vector:
        """Return the lower and upper corners of all links' boxes [m], shape (links, 2, 3).

        Parameters
        ----------
        joints_rad
            Joint angles [rad], shape (joints,).
        """
        frames = self._kinematics.frames(joints_rad)
        if not self._links:
            ends = np.array([frame.translation for frame in frames])
            pairs = np.stack([ends[:-1], ends[1:]], axis=1)
            return np.stack([pairs.min(axis=1) - _RADIUS_M, pairs.max(axis=1) + _RADIUS_M], axis=1)
        boxes = []
        for (points, radius), frame in zip(self._links, frames, strict=False):
            placed = times(points, frame.rotation.T) + frame.translation
            boxes.append(((placed - radius).min(axis=0), (placed + radius).max(axis=0)))
        return np.array(boxes)


def _collect_points(pieces: Sequence[LinkShape]) -> tuple[Vector, Vector]:
    """Return points of a link and their distance from its surface [m], shape (n, 3) and (n, 1)."""
    if not pieces:
        # Nothing of it can touch; the origin keeps one box per link.
        return np.zeros((1, 3)), np.zeros((1, 1))
    points: list[tuple[float, float, float]] = []
    radii: list[float] = []
    for piece in pieces:
        here = piece.corners_m if isinstance(piece, Hull) else (piece.start_m, piece.end_m)
        points += here
        radii += [0.0 if isinstance(piece, Hull) else piece.radius_m] * len(here)
    return np.array(points), np.array(radii).reshape(-1, 1)


# A box and its displacement [m].
Sweep = tuple[WorldBox, Point]

_STILL = (0.0, 0.0, 0.0)
# Number of pieces of a path that share the boxes about links.
_LINK_PIECES = 4


class Sweeps:
    """Swept boxes of a task's motions.

    Parameters
    ----------
    task
        Task with one robot.
    clearance_m
        Clearance of open jaws on either side of a part [m].
    press_travel_m
        Distance beyond its mouth up to which a hole is searched [m].
    """

    def __init__(self, task: Task, clearance_m: float, press_travel_m: float) -> None:
        self.task = task
        self.clearance_m, self.press_travel_m = clearance_m, press_travel_m
        self.kinematics: ArmKinematics = get_kinematics(task.scene.robots[0])
        self.links = LinkBounds(self.kinematics)
        self.robot = task.scene.robots[0]

    def of_skill(self, planned: Sequence[ArmMotion]) -> list[Sweep]:
        """Return the swept boxes of a skill's motions and simulated travels."""
        sweeps = [sweep for motion in planned for sweep in self._of_motion(motion)]
        for motion in planned:
            if motion.matters:
                sweeps += self._of_travel(motion)
        return sweeps

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
        """Return boxes about hand, tool, load and wrist at the target of a motion."""
        event, visit = motion.visit.event, motion.visit
        upright = _make_tool_pose(motion)
        boxes = [box_at(box, upright) for box in self._hand(motion)]
        if motion.points_down:
            boxes.append(world_box(make_wrist_box(get_hand(self.robot, motion.tool)), motion.tip))
        if event in (Event.GRASP, Event.RELEASE, Event.FETCH):
            # Down to its goal, even if it is released above it.
            body = self.task.scene.body(visit.subject)
            boxes += (*world_boxes(body, visit.pose), *shank_boxes(body, visit.pose))
        elif event is Event.DRIVE:
            screw = self.task.scene.body(visit.subject)
            # The search for a hole goes beyond its mouth.
            deepest = visit.pose.moved(plus(_STILL, visit.along, self.press_travel_m))
            for pose in (visit.pose, deepest):
                boxes += (*world_boxes(screw, pose), *shank_boxes(screw, pose))
        return boxes

    def _hand(self, motion: LinearMotion) -> list[Box]:
        """Return boxes about hand and tools, before or after a motion acts, from the tip."""
        hand = get_hand(self.robot, motion.tool)
        others = self.robot.list_companions(motion.acting_tool)
        return [
            *self._acting_hand(motion),
            *(box for other in others for box in make_tool_boxes(other, hand)),
        ]

    def _acting_hand(self, motion: LinearMotion) -> list[Box]:
        tool, visit, hand = motion.tool, motion.visit, get_hand(self.robot, motion.tool)
        if visit.event in (Event.GRASP, Event.RELEASE):
            # The hand, or the tool in its place.
            if tool is not None and build_tool_shapes(tool, hand):
                return list(make_tool_boxes(tool, hand))
            grasp = choose_visit_grasp(self.task.scene.body(visit.subject), visit)
            return list(
                make_hand_boxes(hand, choose_opening_m(grasp, self.clearance_m, tool, hand))
            )
        boxes = list(make_tool_boxes(tool, hand))
        if visit.event is Event.LOAD:
            robots = self.task.scene.robots
            tools = (item for robot in robots for item in robot.tools)
            coupled = next(item for item in tools if item.name == visit.subject)
            boxes += make_tool_boxes(coupled, get_hand(self.robot, coupled))
        return boxes

    def _of_travel(self, planned: ArmMotion) -> Iterator[Sweep]:
        """Yield boxes about the moving bodies of a travel, piece by piece."""
        postures = planned.travel.postures()
        target = self.kinematics.tip(planned.approach[-1])
        corners = np.array([_list_corners(box) for box in self._at_target(planned.motion)])
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
        """Yield boxes about the links along some postures."""
        ways = np.array([self.links.at(joints) for joints in postures])
        lows, highs = ways[:, :, 0].min(axis=0), ways[:, :, 1].max(axis=0)
        for (ax, ay, az), (bx, by, bz) in zip(lows.tolist(), highs.tolist(), strict=True):
            yield WorldBox((ax, ay, az), (bx, by, bz)), _STILL


def _pair_joined(task: Task) -> frozenset[tuple[str, str]]:
    """Return the pairs of bodies that screws join, if a task holds its product."""
    scene = task.scene
    if not (scene.workholders or scene.holders):
        return frozenset()
    groups = [(body.name, *body.joins) for body in scene.bodies if body.joins]
    return frozenset(pair for group in groups for pair in permutations(group, 2))


def _make_tool_pose(motion: LinearMotion) -> Pose:
    """Return the pose of a hand or tool at the target: x along the closing axis, z backwards."""
    if motion.points_down:
        return Pose.upright(motion.tip, motion.closing_yaw_rad)
    x, y, z = motion.points
    return Pose.of_axes(motion.tip, motion.hand.rotate(AXES["x"]), (-x, -y, -z))


def _list_corners(box: WorldBox) -> list[Point]:
    xs, ys, zs = zip(box.low, box.high, strict=True)
    return list(product(xs, ys, zs))


# Distance at which bodies may touch because the hand deviates from its path [m].
MARGIN_M = 0.003
_TOUCH_M = 2e-4


@dataclass(frozen=True)
class Located:
    """A body at one of its places, with its boxes."""

    body: Body
    placement: Placement
    boxes: tuple[WorldBox, ...]
    shank: tuple[WorldBox, ...] = ()

    @property
    def is_boxy(self) -> bool:
        """Return whether its boxes are accurate enough to determine supports."""
        return self.placement.pose.is_upright and not self.body.surfaces

    @cached_property
    def _corners(self) -> Vector:
        """Lower and upper corners of the boxes [m], shape (2, boxes, 3)."""
        return np.array([[box.low for box in self.boxes], [box.high for box in self.boxes]])

    def is_within(self, distance_m: float, other: Located) -> bool:
        """Return whether a box comes within a distance of one of another body [m]."""
        (lows, highs), (bottoms, tops) = self._corners, other._corners
        below = bottoms - highs[:, None] - distance_m < 0.0
        return bool((below & (tops - lows[:, None] + distance_m > 0.0)).all(axis=2).any())


@dataclass(frozen=True, slots=True)
class Neighbourhood:
    """Possible bodies in the world of an execution.

    Parameters
    ----------
    bodies
        Present bodies with their poses, in the order of the task.
    near
        Places near moving parts, occupied or not. A support is in the world because of the body on
        it.
    """

    bodies: tuple[Located, ...]
    present: State
    absent: State
    near: tuple[Located, ...]

    def resting_on(self, present: State, absent: State) -> Neighbourhood:
        """Return the same with additional facts, by their truth."""
        return replace(self, present=self.present | present, absent=self.absent | absent)


class Surroundings:
    """Finds the bodies near the motions of a task.

    Parameters
    ----------
    task
        Task with one robot.
    clearance_m
        Clearance of open jaws on either side of a part [m].
    press_travel_m
        Distance beyond its mouth up to which a hole is searched [m].
    """

    def __init__(self, task: Task, clearance_m: float, press_travel_m: float) -> None:
        self.task = task
        self._located = tuple(
            Located(
                body,
                placement,
                world_boxes(body, placement.pose),
                shank_boxes(body, placement.pose),
            )
            for body in task.scene.bodies
            for placement in body.placements
            if placement.solid and placement.frame == WORLD
        )
        self._joined = _pair_joined(task)
        self._turned = {
            fact: workholder.name
            for workholder in task.scene.workholders
            for fact in workholder.orientations
        }
        self._supports = {
            (body.body.name, body.placement.fact): tuple(self._beneath(body))
            for body in self._located
        }
        self._near: dict[
            tuple[str, tuple[LinearMotion, ...], tuple[bytes, ...], bytes], tuple[Located, ...]
        ] = {}
        self.sweeps = Sweeps(task, clearance_m, press_travel_m)

    def around(
        self, skill: Skill, planned: Sequence[ArmMotion], state: State, turn: Turn | None = None
    ) -> Neighbourhood:
        """Return the neighbourhood of a skill in a state, and of what a turn carries."""
        motions = tuple(planned_motion.motion for planned_motion in planned)
        ways = tuple(motion.travel.nodes_rad.tobytes() for motion in planned if motion.matters)
        key = (skill.name, motions, ways, planned[0].approach[0].tobytes())
        if key not in self._near:
            self._near[key] = tuple(self._close_to(planned))
        handled = {motion.visit.subject for motion in motions}
        own = [
            body
            for body in self._located
            if body.body.name in handled and body.placement.fact in state
        ]
        turned = [] if turn is None else self._close_to_turn(turn)
        return self._reaching_down([*own, *dict.fromkeys((*self._near[key], *turned))], state)

    def around_released(self, freed: Collection[str], state: State) -> Neighbourhood:
        """Return bodies that holders let go, the ones upon them, and their supports."""
        above = [body for body in self._located if body.body.name in freed]
        for body in above:
            above += [
                other
                for other in self._located
                if other not in above
                and body in self._supports[other.body.name, other.placement.fact]
            ]
        return self._reaching_down(above, state)

    def _close_to_turn(self, turn: Turn) -> list[Located]:
        """Return the bodies that a turn carries, and those within their reach about the pivot."""
        carried = [body for body in self._located if turn.begin in body.placement.fact.split(AND)]
        pivot = turn.pivot.position
        reach_m = max(
            (
                math.dist(corner, pivot)
                for body in carried
                for box in body.boxes
                for corner in _list_corners(box)
            ),
            default=0.0,
        )
        (ax, ay, az), (bx, by, bz) = pivot, turn.at(1.0).apply(pivot)
        low = (min(ax, bx) - reach_m, min(ay, by) - reach_m, min(az, bz) - reach_m)
        high = (max(ax, bx) + reach_m, max(ay, by) + reach_m, max(az, bz) + reach_m)
        ball = WorldBox(low, high)
        return [
            body
            for body in self._located
            if body in carried
            or (
                turn.end not in body.placement.fact.split(AND)
                and any(sweep_hits(box, _STILL, ball, -MARGIN_M) for box in body.boxes)
            )
        ]

    def support(self, body: Located, state: State) -> Neighbourhood:
        """Return a body with its direct and indirect supports."""
        return self._reaching_down([body], state)

    def stands_on_table(self, body: Located) -> bool:
        """Return whether a body's bottom is on the table."""
        return min(box.low[2] for box in body.boxes) <= _TOUCH_M

    def _reaching_down(self, above: Sequence[Located], state: State) -> Neighbourhood:
        """Return bodies with the direct and indirect supports of the present ones."""
        todo = sorted(above, key=self._located.index)
        looked_at: list[Located] = []
        while todo:
            body = todo.pop(0)
            if body not in looked_at:
                looked_at.append(body)
                if body.placement.fact in state:
                    todo += self._supports[body.body.name, body.placement.fact]
        looked_at.sort(key=self._located.index)
        there = tuple(body for body in looked_at if body.placement.fact in state)
        missing = [body.placement.fact for body in looked_at if body not in there]
        present = self.task.facts.of(*(body.placement.fact for body in there))
        return Neighbourhood(there, present, state.find_missing(*missing), tuple(above))

    def _beneath(self, body: Located) -> Iterator[Located]:
        floor_m = min(box.low[2] for box in body.boxes)
        feet = [box for box in body.boxes if box.low[2] - floor_m <= _TOUCH_M]
        for other in self._located:
            if other.body.name == body.body.name or self._excludes(body, other):
                continue
            is_joined = (body.body.name, other.body.name) in self._joined
            is_joined |= any(fit.into == other.body.name and fit.fastens for fit in body.body.fits)
            if not is_joined and body.is_boxy and other.is_boxy:
                bears = any(
                    contact_area(foot, top, _TOUCH_M) is not None
                    for foot in feet
                    for top in other.boxes
                )
            else:
                # For rotated bodies, boxes only show that the two may touch.
                bears = body.is_within(_TOUCH_M, other)
            if bears:
                yield other

    def _excludes(self, body: Located, other: Located) -> bool:
        """Return whether two places belong to different orientations of a workholder."""
        if not self._turned:
            return False
        ones, others = (
            set(it.placement.fact.split(AND)) & self._turned.keys() for it in (body, other)
        )
        return bool(ones and others and not ones & others) and any(
            self._turned[a] == self._turned[b] for a in ones for b in others
        )

    def _close_to(self, planned: Sequence[ArmMotion]) -> list[Located]:
        near: list[Located] = []
        moving = self.sweeps.of_skill(planned)
        motions = [body.motion for body in planned]
        spared = {
            motion.visit.subject for motion in motions if motion.visit.event is not Event.DRIVE
        }
        for body in self._located:
            if body.body.name in spared:
                continue
            if any(
                sweep_hits(box, by, obstacle, -MARGIN_M)
                for box, by in moving
                for obstacle in (*body.boxes, *body.shank)
            ):
                near.append(body)
        if any(motion.visit.event is Event.DRIVE for motion in motions):
            # A pressed body may tip, so bodies that stand on it count.
            pressed = list(near)
            near += [
                body
                for body in self._located
                if body not in near
                and any(
                    support in pressed
                    for support in self._supports[body.body.name, body.placement.fact]
                )
            ]
        return near
