"""What is at the end of the arm, in the frame of the tip: hand, fingers, and tools as bodies."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise

from skillplan.physics.linear_motions import tool_shapes
from skillplan.robots.arm_description import Hand
from skillplan.task.scene import Body, Box, Robot, Tool, ToolKind

_TOOL_KG = 0.3
# How far the wrist and what of the forearm is near it reach from the axis of the hand, and up
# from its flange [m].
_WRIST_REACH_M = 0.20
_WRIST_HEIGHT_M = 0.60
# How far the body of a hand reaches beyond its frame [m].
_HAND_ABOVE_M = 0.03


def hand_of(robot: Robot, tool: Tool | None = None) -> Hand:
    """Return the hand that a robot has with a tool.

    Parameters
    ----------
    robot
        Whose hand it is.
    tool
        A gripper is a hand with jaws of its own. With any other tool, or none, the hand is that
        of the first gripper, or what is on the flange where there is no gripper.
    """
    if tool is not None and tool.kind is ToolKind.GRIPPER:
        return robot.hand_of(tool)
    grippers = (one for one in robot.tools if one.kind is ToolKind.GRIPPER)
    return robot.hand_of(next(grippers, None))


def hands_of(robot: Robot) -> tuple[Hand, ...]:
    """Return all hands that a robot can have; first the one without a tool, or with any other."""
    grippers = [tool for tool in robot.tools if tool.kind is ToolKind.GRIPPER]
    return tuple(dict.fromkeys([hand_of(robot), *map(robot.hand_of, grippers)]))


def tool_body(tool: Tool, hand: Hand) -> Body | None:
    """Return a tool as a body whose origin is its tip; None for the hand itself."""
    shapes = tool_shapes(tool, hand)
    return Body(tool.name, shapes, (), _TOOL_KG) if shapes else None


def tool_boxes(tool: Tool | None, hand: Hand) -> Sequence[Box]:
    """Return boxes about a tool, from its tip; of the gripper those of the open hand."""
    if tool is None:
        return ()
    shapes = tool_shapes(tool, hand)
    if shapes:
        return [shape.box for shape in shapes]
    return list(hand_boxes(hand, hand.opening_m))


def hand_boxes(hand: Hand, opening_m: float) -> Iterable[Box]:
    """Return boxes about jaws and hand, from the tip, x along the closing axis."""
    found = []
    for below, above in pairwise(hand.jaw_m):
        low_m, high_m = below[0], above[0]
        half_m = max(below[1], above[1])
        near_m, far_m = min(below[2], above[2]), max(below[3], above[3])
        if high_m <= low_m:
            continue
        for side in (-1, 1):
            centre_x = side * (opening_m / 2 + (near_m + far_m) / 2)
            size = (far_m - near_m, 2 * half_m, high_m - low_m)
            found.append(Box(size, (centre_x, 0.0, (low_m + high_m) / 2)))
    low_m = hand.tip_m - hand.underside_m
    high_m = hand.tip_m + _HAND_ABOVE_M
    size = (2 * hand.half_length_m, 2 * hand.half_width_m, high_m - low_m)
    found.append(Box(size, (0.0, 0.0, (low_m + high_m) / 2)))
    return found


def wrist_box(hand: Hand) -> Box:
    """Return a box about the last links of the arm above the hand, wherever they lead."""
    low_m, high_m = hand.tip_m, hand.tip_m + _WRIST_HEIGHT_M
    size = (2 * _WRIST_REACH_M, 2 * _WRIST_REACH_M, high_m - low_m)
    return Box(size, (0.0, 0.0, (low_m + high_m) / 2))
