"""What moves with an arm: its links, its hand and its load, each fixed to one of the joints."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from skillplan_pinocchio.arm_model import CAPSULES, Capsule

Vector = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MovingSolid:
    """A convex solid that is fixed to a joint.

    Parameters
    ----------
    name
        In words, as ``link 4 of the arm``.
    joint
        Number of the joint that moves it, counted from 1.
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


def arm_solids(capsules: Iterable[Capsule] = CAPSULES) -> tuple[MovingSolid, ...]:
    """Return the links of an arm.

    Parameters
    ----------
    capsules
        About its links.
    """
    return tuple(_capsule(capsule) for capsule in capsules)


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


def _capsule(capsule: Capsule) -> MovingSolid:
    start, end = np.array(capsule.start), np.array(capsule.end)
    length_m = float(np.linalg.norm(end - start))
    centre = (start + end) / 2
    return MovingSolid(
        f"link {capsule.link} of the arm",
        capsule.link,
        coal.Capsule(capsule.radius_m, length_m),
        pin.SE3(_turns(end - start), centre),
        centre,
        length_m / 2 + capsule.radius_m,
        of_arm=True,
    )


def _turns(along: Vector) -> Vector:
    """Return a rotation that turns z along a vector, shape (3, 3)."""
    z = along / np.linalg.norm(along)
    # Whichever axis is farther from it.
    aside = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.7 else np.array([0.0, 1.0, 0.0])
    x = np.cross(aside, z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
