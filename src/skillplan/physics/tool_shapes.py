"""What tools look like that are attached instead of the hand: each ends where its fingers do.

The paper gives no measures of its tools; these are plausible, not measured, but for an envelope
that a task gives.
"""

from __future__ import annotations

from typing import Final

from skillplan.robots.catalogue import STANDARD_HAND
from skillplan.robots.hand import Hand
from skillplan.task.scene import Tool, ToolKind
from skillplan.task.shape import Cylinder, Shape

# A bit or pad and how long it is, below a shank that ends at the flange [m].
_BIT_DIAMETER_M: Final = 0.005
_BIT_LENGTH_M: Final = 0.040
_PAD_DIAMETER_M: Final = 0.016
_PAD_HEIGHT_M: Final = 0.006
_SHANK_DIAMETER_M: Final = 0.036


def tool_shapes(tool: Tool, hand: Hand = STANDARD_HAND) -> tuple[Shape, ...]:
    """Return the shapes of a tool from its tip, z up; none for the hand itself, a gripper.

    Parameters
    ----------
    tool
        What is attached.
    hand
        What is on the flange otherwise: a tool ends where its jaws do.
    """
    if tool.kind is ToolKind.GRIPPER:
        return ()
    if tool.envelope is not None:
        return (tool.envelope,)
    diameter_m, height_m = (
        (_BIT_DIAMETER_M, _BIT_LENGTH_M)
        if tool.kind is ToolKind.SCREWDRIVER
        else (_PAD_DIAMETER_M, _PAD_HEIGHT_M)
    )
    shank_m = hand.tip_m - height_m
    return (
        Cylinder(diameter_m, height_m, (0.0, 0.0, height_m / 2)),
        Cylinder(_SHANK_DIAMETER_M, shank_m, (0.0, 0.0, height_m + shank_m / 2)),
    )
