"""The outline of what is at the end of the arm: hand and fingers, suction cup, screwdriver.

Every outline is made of convex pieces in the frame of the tip: x along the closing axis of the
jaws, z up, the tip at the origin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from skillplan.physics.linear_motions import LinearMotion, tool_shapes
from skillplan.robots.arm_description import Hand
from skillplan.task.motion import AXES
from skillplan.task.pose import Point, Pose, cross
from skillplan.task.scene import Robot, Tool, ToolKind
from skillplan.task.shape import Cylinder, Shape
from skillplan_pinocchio.shapes import (
    Array,
    ConvexPiece,
    box_corners,
    cylinder_corners,
    placed,
    placed_at,
)


@dataclass(frozen=True)
class HandPart:
    """A rigid part of what is at the end of the arm.

    Parameters
    ----------
    name
        In words, as ``a finger``.
    corners
        Of its convex pieces in the frame of the tip [m], each of shape (corners, 3).
    """

    name: str
    corners: tuple[Array, ...]

    def at(self, tip: Sequence[float], closing_yaw_rad: float) -> tuple[ConvexPiece, ...]:
        """Return its pieces in the world, of a hand that points down.

        Parameters
        ----------
        tip
            Where the tip is [m].
        closing_yaw_rad
            Direction in which the jaws close, from x about the vertical [rad].
        """
        return tuple(ConvexPiece(placed(one, tip, closing_yaw_rad)) for one in self.corners)

    def along(self, motion: LinearMotion, tip: Point) -> tuple[ConvexPiece, ...]:
        """Return its pieces in the world while the tip of a motion is at a point [m]."""
        if motion.points_down:
            return self.at(tip, motion.closing_yaw_rad)
        points, closing = motion.points, motion.hand.rotate(AXES["y"])
        out = (-points[0], -points[1], -points[2])
        pose = Pose.of_axes(tip, cross(out, closing), out)
        return tuple(ConvexPiece(placed_at(one, pose)) for one in self.corners)


def hand_parts(robot: Robot, tool: Tool | None, opening_m: float) -> tuple[HandPart, ...]:
    """Return what is at the end of the arm.

    A gripper is the hand of the arm itself. A suction cup or screwdriver is of common size, or
    its envelope where the task gives one. Where tools can be changed and none is attached, the
    arm ends at its flange.

    Parameters
    ----------
    robot
        Whose tool it is.
    tool
        Attached, or None.
    opening_m
        How far apart the jaws are [m], >= 0; counts for a gripper only.
    """
    if tool is None and robot.tools:
        return ()
    hand = robot.hand_of(tool)
    if tool is None or tool.kind is ToolKind.GRIPPER:
        fingers = (_finger(hand, opening_m / 2, 1), _finger(hand, opening_m / 2, -1))
        return (HandPart("a finger", fingers), HandPart("the hand", _body(hand)))
    shapes = tool_shapes(tool, robot.hand)
    return (HandPart(tool.name, tuple(_corners(shape) for shape in shapes)),)


def _body(hand: Hand) -> tuple[Array, ...]:
    pieces = (np.array(corners).T for corners in hand.body)
    return tuple(
        np.column_stack([along, across, hand.tip_m - depth_m]) for along, across, depth_m in pieces
    )


def _finger(hand: Hand, face_m: float, side: int) -> Array:
    """Return a jaw, or the other one: the same, turned by half a turn."""
    behind, across, height_m = np.array(hand.jaw).T
    return np.column_stack([side * (face_m + behind), side * across, height_m])


def _corners(shape: Shape) -> Array:
    return cylinder_corners(shape) if isinstance(shape, Cylinder) else box_corners(shape.box)
