"""What moves with an arm: its links, its hand and its load, each fixed to one of the joints."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from skillplan_pinocchio.arm_model import ArmModel
from skillplan_pinocchio.kinematics.fixed_order import length, times
from skillplan_pinocchio.link_pieces import LinkPiece
from skillplan_pinocchio.shapes import ConvexPiece

Vector = NDArray[np.float64]

# Boxes are not cut thinner than twice this [m], nor into more parts along an edge.
_LEAST_HALF_M: Final = 0.02
_MOST_BALLS: Final = 5


@dataclass(frozen=True, eq=False)
class MovingSolid:
    """A convex solid that is fixed to a joint.

    Parameters
    ----------
    name
        In words, as ``link 4 of the arm``.
    joint
        Number of the joint that moves it, counted from 1; 0 for what stands still.
    geometry
        Of coal.
    frame
        Of the geometry in the frame of the joint, as `pinocchio.SE3`.
    centre
        Of a sphere about the solid, in the frame of the joint [m], shape (3,).
    radius_m
        Of that sphere, > 0.
    balls
        Smaller spheres that it lies within: their centres, in the frame of the joint [m], shape
        (balls, 3), and their common radius [m].
    of_arm
        Whether it is a link of the arm; else it is at the arm's end.
    """

    name: str
    joint: int
    geometry: Any
    frame: Any
    centre: Vector
    radius_m: float
    balls: tuple[Vector, float]
    of_arm: bool = False


def arm_solids(arm: ArmModel) -> tuple[MovingSolid, ...]:
    """Return the base of an arm, which stands still, and its links."""
    turned = pin.SE3(np.array(arm.mount.rotation), np.array(arm.mount.position))
    base = arm.description.shapes[0] if arm.description.shapes else ()
    found = []
    for piece in (*(LinkPiece(0, shape) for shape in base), *arm.pieces):
        centre, half = piece.box
        placed = turned if piece.link == 0 else pin.SE3.Identity()
        centres, radius_m = balls_of_box(centre, half)
        name = f"link {piece.link} of the arm" if piece.link else "the base of the arm"
        found.append(
            MovingSolid(
                name,
                piece.link,
                piece.geometry,
                placed * piece.frame,
                placed.act(centre),
                length(half),
                (times(centres, placed.rotation.T) + placed.translation, radius_m),
                of_arm=True,
            )
        )
    return tuple(found)


def held_solid(name: str, joint: int, piece: ConvexPiece, back: Any) -> MovingSolid:
    """Return a piece that is in the hand.

    Parameters
    ----------
    name
        In words.
    joint
        Number of the last joint, counted from 1.
    piece
        Where it is in the world at some posture.
    back
        Of the world in the frame of the joint at that posture, as `pinocchio.SE3`.
    """
    corners = times(piece.corners, back.rotation.T) + back.translation
    low, high = corners.min(axis=0), corners.max(axis=0)
    centre = (low + high) / 2
    radius_m = float(np.linalg.norm(corners - centre, axis=1).max())
    balls = balls_of_box(centre, (high - low) / 2)
    return MovingSolid(name, joint, piece.hull, back, centre, radius_m, balls)


def balls_of_box(centre: Vector, half: Vector) -> tuple[Vector, float]:
    """Return spheres that a box lies within, one for each near-cube of it.

    Parameters
    ----------
    centre, half
        Of the box, and half its extents [m], each of shape (3,).

    Returns
    -------
    tuple
        Their centres [m], shape (balls, 3), and their common radius [m].
    """
    x, y, z = half.tolist()
    least = max(min(x, y, z), _LEAST_HALF_M)
    counts = tuple(min(max(round(one / least), 1), _MOST_BALLS) for one in (x, y, z))
    radius_m = math.hypot(x / counts[0], y / counts[1], z / counts[2])
    return centre + _middles(counts) * half, radius_m


@cache
def _middles(counts: tuple[int, ...]) -> Vector:
    """Return the middles of a box from -1 to 1 that is cut so often along each axis."""
    steps = [(2 * np.arange(count) + 1) / count - 1 for count in counts]
    return np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
