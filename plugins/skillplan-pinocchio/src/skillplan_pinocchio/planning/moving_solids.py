"""What moves with an arm: its links, its hand and its load, each fixed to one of the joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from skillplan_pinocchio.arm_model import ArmModel
from skillplan_pinocchio.link_pieces import LinkPiece

Vector = NDArray[np.float64]


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
    of_arm
        Whether it is a link of the arm; else it is at the arm's end.
    """

    name: str
    joint: int
    geometry: Any
    frame: Any
    centre: Vector
    radius_m: float
    of_arm: bool = False


def arm_solids(arm: ArmModel) -> tuple[MovingSolid, ...]:
    """Return the base of an arm, which stands still, and its links."""
    turned = pin.SE3(np.array(arm.mount.rotation), np.array(arm.mount.position))
    base = arm.description.shapes[0] if arm.description.shapes else ()
    found = []
    for piece in (*(LinkPiece(0, shape) for shape in base), *arm.pieces):
        centre, half = piece.box
        placed = turned if piece.link == 0 else pin.SE3.Identity()
        name = f"link {piece.link} of the arm" if piece.link else "the base of the arm"
        found.append(
            MovingSolid(
                name,
                piece.link,
                piece.geometry,
                placed * piece.frame,
                placed.act(centre),
                float(np.linalg.norm(half)),
                of_arm=True,
            )
        )
    return tuple(found)


def convex_solid(name: str, joint: int, corners: Vector) -> MovingSolid:
    """Return the convex hull of corners, fixed to a joint.

    Parameters
    ----------
    name
        In words.
    joint
        Counted from 1.
    corners
        In the frame of the joint [m], shape (corners, 3).
    """
    points = coal.StdVec_Vec3s()
    points.extend(list(corners))
    centre = (corners.min(axis=0) + corners.max(axis=0)) / 2
    radius_m = float(np.linalg.norm(corners - centre, axis=1).max())
    hull = coal.Convex.convexHull(points, True, "Qt")
    return MovingSolid(name, joint, hull, pin.SE3.Identity(), centre, radius_m)
