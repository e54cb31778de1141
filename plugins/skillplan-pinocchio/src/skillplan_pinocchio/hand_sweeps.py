"""Sweeps of hand, tool and load in a motion."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise, product

import numpy as np

from skillplan.physics.linear_motions import (
    LinearMotion,
    build_tool_shapes,
    choose_grasp,
    choose_opening_m,
    choose_visit_grasp,
    find_tool_after,
)
from skillplan.robots.arm_description import Hand
from skillplan.task.motion import AXES, Event
from skillplan.task.pose import Point, Pose, cross, dot, plus
from skillplan.task.scene import WORLD, Robot, Scene, Tool, ToolKind, name_shank
from skillplan.task.shape import Cylinder, Mesh, Shape
from skillplan_pinocchio.holds import NEAR_M
from skillplan_pinocchio.motion_plan import get_spared_bodies
from skillplan_pinocchio.shapes import (
    Array,
    ConvexPiece,
    Obstacle,
    compute_box_corners,
    compute_cylinder_corners,
    make_pieces,
    make_shank_pieces,
    make_standing_pieces,
    place_at,
    place_upright,
)
from skillplan_pinocchio.sweep import Sweep, Touch


@dataclass(frozen=True)
class HandPart:
    """A rigid part of the hand or tool.

    Parameters
    ----------
    name
        Name with article, such as ``a finger``.
    corners
        Corners of its convex pieces in the frame of the tip [m], each of shape (corners, 3).
    """

    name: str
    corners: tuple[Array, ...]

    def at(self, tip: Sequence[float], closing_yaw_rad: float) -> tuple[ConvexPiece, ...]:
        """Return its pieces in the world, for a hand that points down.

        Parameters
        ----------
        tip
            Position of the tip [m].
        closing_yaw_rad
            Closing direction of the jaws, from x about the vertical [rad].
        """
        return tuple(
            ConvexPiece(place_upright(corner, tip, closing_yaw_rad)) for corner in self.corners
        )

    def along(self, motion: LinearMotion, tip: Point) -> tuple[ConvexPiece, ...]:
        """Return its pieces in the world with the tip of a motion at a point [m]."""
        if motion.points_down:
            return self.at(tip, motion.closing_yaw_rad)
        points, closing = motion.points, motion.hand.rotate(AXES["y"])
        out = (-points[0], -points[1], -points[2])
        pose = Pose.of_axes(tip, cross(out, closing), out)
        return tuple(ConvexPiece(place_at(corner, pose)) for corner in self.corners)


def build_hand_parts(robot: Robot, tool: Tool | None, opening_m: float) -> tuple[HandPart, ...]:
    """Return the parts at the end of the arm.

    A gripper is the arm's own hand. A suction cup or screwdriver has a common size, or the envelope
    given in the task. If tools can be changed and none is attached, the arm ends at its flange.

    Parameters
    ----------
    tool
        Attached tool, or None.
    opening_m
        Opening of a gripper's jaws [m], >= 0.
    """
    if tool is None and robot.tools:
        return ()
    companions = robot.list_companions(tool)
    if tool is not None and companions:
        parts = list(build_hand_parts(replace(robot, tools=(tool,)), tool, opening_m))
        for other in companions:
            # Its jaws may be anywhere between open and closed.
            alone = replace(robot, tools=(other,))
            ends = (build_hand_parts(alone, other, m) for m in (alone.hand_of(other).opening_m, 0))
            parts += _span(*ends)
        return tuple(parts)
    hand = robot.hand_of(tool)
    if tool is None or tool.kind is ToolKind.GRIPPER:
        fingers = tuple(
            finger for side in (1, -1) for finger in _make_fingers(hand, opening_m / 2, side)
        )
        return (HandPart("a finger", fingers), HandPart("the hand", _make_body(hand)))
    shapes = build_tool_shapes(tool, robot.hand)
    if tool.mount is not None:
        # From axes of the arm's tip to axes of hand parts, and back.
        turn = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
        own, at = np.array(tool.mount.rotation), np.array(tool.mount.position)
        placed = ((_get_corners(shape) @ turn @ own.T + at) @ turn for shape in shapes)
        return (HandPart(tool.name, tuple(placed)),)
    ends_at = np.array([0.0, 0.0, -tool.beyond_m])
    return (HandPart(tool.name, tuple(_get_corners(shape) + ends_at for shape in shapes)),)


def _span(opened: Sequence[HandPart], closed: Sequence[HandPart]) -> Iterator[HandPart]:
    """Yield the parts of a hand with all places of its jaws between two openings."""
    for open_part, part in zip(opened, closed, strict=True):
        hulls = zip(open_part.corners, part.corners, strict=True)
        yield part if part is open_part else HandPart(part.name, tuple(map(np.concatenate, hulls)))


def _make_body(hand: Hand) -> tuple[Array, ...]:
    pieces = (np.array(corners).T for corners in hand.body)
    return tuple(
        np.column_stack([along, across, hand.arm_tip_m - depth_m])
        for along, across, depth_m in pieces
    )


def _make_fingers(hand: Hand, face_m: float, side: int) -> Iterator[Array]:
    """Yield the pieces of a jaw; the other side is the same, turned by half a turn."""
    pieces = hand.jaw
    if hand.jaw_corners_m and not hand.jaw_pieces_m:
        # Engines simulate the block too, which is wider than the exact corners at the end.
        (x, y, z), (far_x, far_y, far_z) = hand.jaw_block_m
        block = product((x, far_x), (y, far_y), (z, far_z))
        pieces = ((*hand.jaw_corners_m, *block),)
    for piece in pieces:
        behind, across, height_m = np.array(piece).T
        yield np.column_stack([side * (face_m + behind), side * across, height_m - hand.beyond_m])


def _get_corners(shape: Shape) -> Array:
    if isinstance(shape, Mesh):
        return np.array(shape.corners)
    return (
        compute_cylinder_corners(shape)
        if isinstance(shape, Cylinder)
        else compute_box_corners(shape.box)
    )


# Rounding of a retreat straight back [m].
_STRAIGHT_M = 1e-9
_HANDLING = (Event.GRASP, Event.RELEASE)
_STILL: Point = (0.0, 0.0, 0.0)


class HandSweeps:
    """Sweeps of hand, tool and load, by motion.

    Parameters
    ----------
    clearance_m
        Clearance of open jaws on either side of a part [m], >= 0.
    """

    def __init__(self, scene: Scene, robot: Robot, clearance_m: float) -> None:
        self.scene = scene
        self.robot = robot
        self.clearance_m = clearance_m
        self._parts: dict[tuple[str | None, float], tuple[HandPart, ...]] = {}

    @cached_property
    def width_m(self) -> float:
        """Reach of hand, tool or load from the axis of a hand that points down [m]."""
        tools: tuple[Tool | None, ...] = self.robot.tools or (None,)
        widest_m = [
            float(np.linalg.norm(corners[:, :2], axis=1).max())
            for tool in tools
            for part in build_hand_parts(self.robot, tool, self.robot.hand_of(tool).opening_m)
            for corners in part.corners
        ]
        for body in self.scene.bodies:
            if any(placement.frame != WORLD for placement in body.placements):
                corners = np.concatenate(
                    [piece.corners for piece in make_pieces(body, Pose(_STILL))]
                )
                for grasp in body.grasps or (choose_grasp(body),):
                    away = np.linalg.norm(corners - np.array(grasp.tip), axis=1)
                    widest_m.append(float(away.max()))
        # The end of a shorter tool sinks less than so far as the hand tilts.
        short_m = max((-tool.beyond_m for tool in self.robot.tools), default=0.0)
        return max(widest_m, default=0.0) + max(short_m, 0.0)

    def held(
        self, motion: LinearMotion, begin: Point
    ) -> Iterator[tuple[str, tuple[ConvexPiece, ...]]]:
        """Yield names and pieces at the end of the arm before a motion acts.

        Parameters
        ----------
        begin
            Position of the tip [m].
        """
        for sweep in self._swept("", motion, begin, _STILL, after=False):
            yield sweep.mover, sweep.pieces

    def ends(
        self, motion: LinearMotion
    ) -> tuple[
        list[tuple[str, tuple[ConvexPiece, ...]]], list[tuple[str, tuple[ConvexPiece, ...]]]
    ]:
        """Return names and pieces at the end of the arm where a motion begins and where it ends."""
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
            if motion.visit.path and number > 2:
                label = "the path"
            # Down to its goal, even if it is released above it.
            target = motion.grasp_tip if is_last else end
            loads = [*self._load(label, motion, motion.carries, begin, _subtract(begin, target))]
            if label == "the insertion" and motion.drop_m:
                loads += self._load(label, motion, motion.carries, begin, _subtract(begin, end))
            lowest = motion.grasp_tip if is_last and self._lowers_to_goal(motion) else end
            by = _subtract(begin, lowest)
            yield (*loads, *self._hands(label, motion, begin, by, after=False))

    def retreat(self, motion: LinearMotion) -> Iterator[tuple[Sweep, ...]]:
        """Yield the sweeps of each straight stretch back to safe height, in order."""
        label = "the retreat"
        first = motion.grasp_tip if self._lowers_to_goal(motion) else motion.retreat[0]
        for begin, end in pairwise((first, *motion.retreat[1:])):
            yield tuple(self._swept(label, motion, begin, _subtract(begin, end), after=True))

    def _lowers_to_goal(self, motion: LinearMotion) -> bool:
        """Return whether a part may go into a holder: the hand brings it down, it does not fall."""
        visit = motion.visit
        if visit.event is not Event.RELEASE or not visit.at_goal:
            return False
        holders = self.scene.holders
        return any(item.kind == "hold" and visit.subject in item.facts for item in holders)

    def clash(self, motion: LinearMotion, tolerance_m: float) -> tuple[str, str, Touch] | None:
        """Return the hand part that collides with the handled body, when, and the contact, or None.

        Jaws may meet it only where they hold it, not on their way from there or to there. A hand
        that goes back as it came in, past the body that it let go, may meet it there.

        Parameters
        ----------
        tolerance_m
            Penetration depth that counts as harmless touching [m], >= 0.
        """
        visit = motion.visit
        if visit.event not in _HANDLING:
            return None
        body = self.scene.body(visit.subject)
        target = Obstacle(body.name, None, make_standing_pieces(body, visit.pose))
        held_m, open_m = (
            self._choose_opening_m(motion, motion.tool, m) for m in (None, self.clearance_m)
        )
        # In a hole the way counts no further than open: the hull of a jaw flares behind its end.
        is_outer = held_m < open_m
        near_m = min(held_m + 2 * NEAR_M, open_m) if is_outer else open_m
        ends = (self._build(motion.tool, opening_m) for opening_m in (open_m, near_m))
        for part in _span(*ends):
            pieces = part.along(motion, motion.grasp_tip)
            sweep = Sweep("", part.name, pieces, _STILL, frozenset())
            touch = sweep.touch(target, tolerance_m, 1)
            if touch is not None:
                return part.name, "the approach", touch
        begin, end = motion.retreat[:2]
        by = _subtract(begin, end)
        # The retreat has no length if the hand is above safe height already.
        if visit.event is Event.GRASP or -dot(by, motion.points) >= math.hypot(*by) - _STRAIGHT_M:
            return None
        for sweep in self._hands("the retreat", motion, begin, by, after=True):
            touch = sweep.touch(target, tolerance_m, 1)
            if touch is not None:
                return sweep.mover, sweep.label, touch
        return None

    def _swept(
        self, label: str, motion: LinearMotion, begin: Point, by: Point, *, after: bool
    ) -> Iterator[Sweep]:
        """Yield the sweeps of load and hand along a straight stretch from a point."""
        taken = motion.leaves_with if motion.visit.event in (Event.GRASP, Event.FETCH) else None
        carried = taken if after else motion.carries
        yield from self._load(label, motion, carried, begin, by)
        yield from self._hands(label, motion, begin, by, after=after)

    def _load(
        self, label: str, motion: LinearMotion, carried: str | None, begin: Point, by: Point
    ) -> Iterator[Sweep]:
        """Yield the sweep of the carried body that the motion puts down or takes."""
        if carried is None or carried != motion.visit.subject:
            return
        offset = _subtract(motion.grasp_tip, begin)
        body, pose = self.scene.body(carried), motion.visit.pose.moved(offset)
        spares = get_spared_bodies(motion)
        # A fit states an overlap with its partner on the last stretch to the goal.
        is_last = math.dist(plus(begin, by, 1.0), motion.grasp_tip) <= motion.drop_m + 1e-9
        fits = body.fits if is_last and motion.visit.is_fitted else ()
        overlaps_m = {fit.into: fit.overlap_m for fit in fits if fit.overlap_m > 0}
        pieces = make_pieces(body, pose)
        yield Sweep(label, carried, pieces, by, spares, is_load=True, overlaps_m=overlaps_m)
        for into, overlap_m in overlaps_m.items():
            # The overlap is one of the sides: along the insertion it is none.
            core = tuple(piece.narrowed(motion.visit.along, overlap_m) for piece in pieces)
            others_m = {other: m for other, m in overlaps_m.items() if other != into}
            yield Sweep(label, carried, core, by, spares, is_load=True, overlaps_m=others_m)
        if body.shank is not None:
            shank = make_shank_pieces(body, pose)
            passes: tuple[str, ...] = ()
            if motion.visit.event is Event.DRIVE and is_last:
                passes = body.shank.passes
            elif motion.visit.event is Event.FETCH and math.dist(begin, motion.grasp_tip) <= 1e-9:
                passes = body.shank.stands_in
            spared = spares.union(passes)
            yield Sweep(label, f"the {name_shank(carried)}", shank, by, spared, is_load=True)

    def _hands(
        self, label: str, motion: LinearMotion, begin: Point, by: Point, *, after: bool
    ) -> Iterator[Sweep]:
        for part in self._hand(motion, before=not after):
            yield Sweep(label, part.name, part.along(motion, begin), by, get_spared_bodies(motion))

    def _hand(self, motion: LinearMotion, *, before: bool) -> tuple[HandPart, ...]:
        """Return the parts at the end of the arm before or after the action."""
        tool = motion.tool if before else find_tool_after(self.robot, motion.visit, motion.tool)
        opening_m = 0.0
        if motion.visit.event in _HANDLING:
            is_open = before is (motion.visit.event is Event.GRASP)
            clearance_m = self.clearance_m if is_open else None
            opening_m = self._choose_opening_m(motion, tool, clearance_m)
        return self._build(tool, opening_m)

    def _choose_opening_m(
        self, motion: LinearMotion, tool: Tool | None, clearance_m: float | None
    ) -> float:
        grasp = choose_visit_grasp(self.scene.body(motion.visit.subject), motion.visit)
        return choose_opening_m(grasp, clearance_m, tool, self.robot.hand)

    def _build(self, tool: Tool | None, opening_m: float) -> tuple[HandPart, ...]:
        key = (None if tool is None else tool.name, opening_m)
        if key not in self._parts:
            self._parts[key] = build_hand_parts(self.robot, tool, opening_m)
        return self._parts[key]


def _subtract(begin: Point, end: Point) -> Point:
    return plus(end, begin, -1.0)
