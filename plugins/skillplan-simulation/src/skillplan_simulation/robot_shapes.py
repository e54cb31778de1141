"""Shapes at the end of the arm, in the frame of the tip: hand, fingers, and tools as bodies."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np
from numpy.typing import NDArray

from skillplan.physics.linear_motions import build_tool_shapes
from skillplan.robots.arm_description import Hand, Hull, LinkShape
from skillplan.task.pose import Point, Pose
from skillplan.task.scene import Body, Box, Robot, Tool, ToolKind

_TOOL_KG = 0.3
# Reach of wrist and forearm from the axis of the hand, and height above its flange [m].
_WRIST_REACH_M = 0.20
_WRIST_HEIGHT_M = 0.60
# Extent of the body of a hand beyond its frame [m].
_HAND_ABOVE_M = 0.03


def get_hand(robot: Robot, tool: Tool | None = None) -> Hand:
    """Return the hand of a robot with a tool.

    Parameters
    ----------
    tool
        A gripper, or a tool on the hand of one, has its own jaws. With any other tool or none, the
        hand is that of the first gripper, or the one on the flange if there is no gripper.
    """
    for item in (tool, *robot.list_companions(tool)):
        if item is not None and item.kind is ToolKind.GRIPPER:
            return robot.hand_of(item)
    grippers = (item for item in robot.tools if item.kind is ToolKind.GRIPPER)
    return robot.hand_of(next(grippers, None))


def list_hands(robot: Robot) -> tuple[Hand, ...]:
    """Return all hands that a robot can have, first the one without a gripper."""
    grippers = [tool for tool in robot.tools if tool.kind is ToolKind.GRIPPER]
    return tuple(dict.fromkeys([get_hand(robot), *map(robot.hand_of, grippers)]))


def make_tool_body(tool: Tool, hand: Hand) -> Body | None:
    """Return a tool as a body with its origin at the tip; None for the hand itself."""
    shapes = build_tool_shapes(tool, hand)
    return Body(tool.name, shapes, (), tool.mass_kg or _TOOL_KG) if shapes else None


def make_tool_boxes(tool: Tool | None, hand: Hand) -> Sequence[Box]:
    """Return boxes about a tool, from the arm's tip; for a gripper, about the open hand."""
    if tool is None:
        return ()
    shapes = build_tool_shapes(tool, hand)
    if tool.mount is not None:
        return [_mount(shape.box, tool.mount) for shape in shapes]
    if shapes:
        return [_lower(shape.box, tool.beyond_m) for shape in shapes]
    return list(make_hand_boxes(hand, hand.opening_m))


def make_hand_boxes(hand: Hand, opening_m: float) -> Iterable[Box]:
    """Return boxes about jaws and hand, from the arm's tip, x along the closing axis."""
    boxes = []
    for below, above in pairwise(hand.jaw_m):
        low_m, high_m = below[0], above[0]
        half_m = max(below[1], above[1])
        near_m, far_m = min(below[2], above[2]), max(below[3], above[3])
        if high_m <= low_m:
            continue
        for side in (-1, 1):
            centre_x = side * (opening_m / 2 + (near_m + far_m) / 2)
            size = (far_m - near_m, 2 * half_m, high_m - low_m)
            boxes.append(Box(size, (centre_x, 0.0, (low_m + high_m) / 2)))
    low_m = hand.tip_m - hand.underside_m
    high_m = hand.tip_m + _HAND_ABOVE_M
    size = (2 * hand.half_length_m, 2 * hand.half_width_m, high_m - low_m)
    boxes.append(Box(size, (0.0, 0.0, (low_m + high_m) / 2)))
    return [_lower(box, hand.beyond_m) for box in boxes]


def _lower(box: Box, by_m: float) -> Box:
    x_m, y_m, z_m = box.centre
    return Box(box.size, (x_m, y_m, z_m - by_m)) if by_m else box


def _mount(box: Box, mount: Pose) -> Box:
    """Return a box about the box of a mounted tool, from the arm's tip."""
    signs = np.array([*product((-0.5, 0.5), repeat=3)])
    corners = np.array(box.centre) + signs * np.array(box.size)
    # The axes of the arm's tip and of boxes differ by this.
    turn = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    placed = (corners @ turn @ np.array(mount.rotation).T + np.array(mount.position)) @ turn
    low, high = placed.min(axis=0), placed.max(axis=0)
    (x, y, z), (dx, dy, dz) = ((low + high) / 2).tolist(), (high - low).tolist()
    return Box((dx, dy, dz), (x, y, z))


def make_wrist_box(hand: Hand) -> Box:
    """Return a box about the last links of the arm above the hand, in any posture."""
    low_m, high_m = hand.arm_tip_m, hand.arm_tip_m + _WRIST_HEIGHT_M
    size = (2 * _WRIST_REACH_M, 2 * _WRIST_REACH_M, high_m - low_m)
    return Box(size, (0.0, 0.0, (low_m + high_m) / 2))


Vector = NDArray[np.float64]

# Margin by which pybullet enlarges hulls [m].
MARGIN_M = 0.001
# Distance of a jaw's hulls behind its face, which is a box [m].
_BEHIND_FACE_M = 0.002
# Minimum thickness of a piece [m].
_THINNEST_M = 1e-4


@dataclass(frozen=True, slots=True)
class Block:
    """A box along the axes of a link.

    Parameters
    ----------
    low_m, high_m
        Lower and upper corner [m], shape (3,).
    """

    low_m: tuple[float, float, float]
    high_m: tuple[float, float, float]


Piece = LinkShape | Block


def make_body_pieces(hand: Hand) -> tuple[Piece, ...]:
    """Return the body of a hand in the frame of the arm's tip, z out of the hand."""
    return tuple(
        _shrink(
            np.array([(across, along, depth - hand.arm_tip_m) for along, across, depth in piece])
        )
        for piece in hand.body
    )


def make_jaw_pieces(hand: Hand, side: int) -> tuple[Piece, ...]:
    """Return a jaw with its face at the origin, in the frame of the arm's tip, z out of the hand.

    Parameters
    ----------
    side
        1 for the jaw on the side of the hand's y, -1 for the other.
    """
    if hand.jaw_pieces_m:
        return tuple(_make_jaw_piece(piece, side, hand.beyond_m) for piece in hand.jaw_pieces_m)
    (near_m, right_m, low_m), (far_m, left_m, high_m) = hand.jaw_block_m
    pieces: list[Piece] = []
    if far_m - near_m > _THINNEST_M:
        low = (right_m, near_m, hand.beyond_m - high_m)
        pieces.append(_make_block(low, (left_m, far_m, hand.beyond_m - low_m), side))
    for below, above in pairwise(hand.jaw_m):
        # The block, whose face is flat, is as thick as thin tips.
        is_thin = max(below[3], above[3]) - near_m - _BEHIND_FACE_M <= _THINNEST_M
        if above[0] - below[0] <= 2 * MARGIN_M or is_thin:
            continue
        corners = [
            (x_m, side * max(y_m, near_m + _BEHIND_FACE_M), hand.beyond_m - height_m)
            for height_m, width_m, from_m, to_m in (below, above)
            for x_m in (-width_m, width_m)
            for y_m in (from_m, to_m)
        ]
        pieces.append(_shrink(np.array(corners)))
    return tuple(pieces)


def _make_jaw_piece(corners: Sequence[Point], side: int, beyond_m: float) -> Piece:
    """Return a convex piece of a jaw: a box as such, because its face has to be flat."""
    behind, across, height_m = np.array(corners).T
    (near_m, left_m, low_m), (far_m, right_m, high_m) = np.min(corners, 0), np.max(corners, 0)
    if set(corners) == set(product((near_m, far_m), (left_m, right_m), (low_m, high_m))):
        low = (float(left_m), float(near_m), float(beyond_m - high_m))
        return _make_block(low, (float(right_m), float(far_m), float(beyond_m - low_m)), side)
    return _shrink(np.column_stack([across, side * behind, beyond_m - height_m]))


def _make_block(low: Sequence[float], high: Sequence[float], side: int) -> Block:
    ys = sorted((side * low[1], side * high[1]))
    return Block((low[0], ys[0], low[2]), (high[0], ys[1], high[2]))


def _shrink(corners: Vector) -> Hull:
    """Return the hull of some corners, smaller by the margin along every axis, but not flat."""
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    away = corners - middle
    # Engines refuse flat hulls, such as that of a finger tip twice as thick as the margin.
    least_m = np.minimum(np.abs(away), _THINNEST_M)
    inner = middle + np.sign(away) * np.maximum(np.abs(away) - MARGIN_M, least_m)
    return Hull(tuple((float(x), float(y), float(z)) for x, y, z in inner))
