"""What is at the end of the arm, in the frame of the tip: hand, fingers, and tools as bodies."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from skillplan.physics.tool_shapes import tool_shapes
from skillplan.robots import panda
from skillplan.task.scene import Body, Box, Tool

_TOOL_KG = 0.3
# How far the wrist and what of the forearm is near it reach from the axis of the hand, and up
# from its flange [m].
_WRIST_REACH_M = 0.20
_WRIST_HEIGHT_M = 0.60


def tool_body(tool: Tool) -> Body | None:
    """Return a tool as a body whose origin is its tip; None for the hand itself."""
    shapes = tool_shapes(tool)
    return Body(tool.name, shapes, (), _TOOL_KG) if shapes else None


def tool_boxes(tool: Tool | None) -> Sequence[Box]:
    """Return boxes about a tool, from its tip; of the gripper those of the closed hand."""
    if tool is None:
        return ()
    shapes = tool_shapes(tool)
    if shapes:
        return [shape.box for shape in shapes]
    return list(hand_boxes(panda.OPENING_M))


def hand_boxes(opening_m: float) -> Iterable[Box]:
    """Return boxes about fingers and hand, from the tip, x along the closing axis."""
    found = []
    for (low_m, _, _, _), (high_m, half_m, near_m, far_m) in zip(
        panda.FINGER_PROFILE_M, panda.FINGER_PROFILE_M[1:], strict=False
    ):
        for side in (-1, 1):
            centre_x = side * (opening_m / 2 + (near_m + far_m) / 2)
            size = (far_m - near_m, 2 * half_m, high_m - low_m)
            found.append(Box(size, (centre_x, 0.0, (low_m + high_m) / 2)))
    low_m = panda.TIP_M - panda.HAND_UNDERSIDE_M
    high_m = panda.TIP_M + 0.03
    size = (2 * panda.HAND_HALF_LENGTH_M, 2 * panda.HAND_HALF_WIDTH_M, high_m - low_m)
    found.append(Box(size, (0.0, 0.0, (low_m + high_m) / 2)))
    return found


def wrist_box() -> Box:
    """Return a box about the last links of the arm above the hand, wherever they lead."""
    low_m, high_m = panda.TIP_M, panda.TIP_M + _WRIST_HEIGHT_M
    size = (2 * _WRIST_REACH_M, 2 * _WRIST_REACH_M, high_m - low_m)
    return Box(size, (0.0, 0.0, (low_m + high_m) / 2))
