"""What hand and tools look like: every tool ends where the fingers of the hand do.

The paper gives no measures of its tools; these are plausible, not measured.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from skillplan.physics import panda
from skillplan.task.scene import Body, Box, Grasp, GraspKind, Tool, ToolKind
from skillplan.task.shape import Cylinder, Shape

# A screwdriver: a shank below the flange, and a bit [m].
_SHANK_DIAMETER_M = 0.036
_BIT_DIAMETER_M = 0.005
_BIT_LENGTH_M = 0.040
# A suction cup: a pad at the end of a tube [m].
_PAD_DIAMETER_M = 0.016
_PAD_HEIGHT_M = 0.006
_TOOL_KG = 0.3


def tool_body(tool: Tool) -> Body | None:
    """Return a tool as a body whose origin is its tip; None for the hand itself."""
    shapes = _shapes(tool)
    return Body(tool.name, shapes, (), _TOOL_KG) if shapes else None


def tool_boxes(tool: Tool | None) -> Sequence[Box]:
    """Return boxes about a tool, from its tip; of the gripper those of the closed hand."""
    if tool is None:
        return ()
    shapes = _shapes(tool)
    if shapes:
        return [shape.box for shape in shapes]
    return list(hand_boxes(panda.OPENING_M))


def jaw_opening_m(grasp: Grasp, clearance_m: float) -> float:
    """Return how far the jaws open about a part [m]: closed for suction."""
    if grasp.kind is GraspKind.SUCTION:
        return 0.0
    return min(grasp.width_m + 2 * clearance_m, panda.OPENING_M)


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


def _shapes(tool: Tool) -> tuple[Shape, ...]:
    if tool.kind is ToolKind.GRIPPER:
        return ()
    pad, height = (
        (_BIT_DIAMETER_M, _BIT_LENGTH_M)
        if tool.kind is ToolKind.SCREWDRIVER
        else (_PAD_DIAMETER_M, _PAD_HEIGHT_M)
    )
    shank = panda.TIP_M - height
    return (
        Cylinder(pad, height, (0.0, 0.0, height / 2)),
        Cylinder(_SHANK_DIAMETER_M, shank, (0.0, 0.0, height + shank / 2)),
    )
