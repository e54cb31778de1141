"""The shapes about the links of an arm for coal: their geometry, place on the link and corners."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Final

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from skillplan.robots.arm_description import ArmDescription, Capsule, Hull, LinkShape
from skillplan_pinocchio.kinematics.fixed_order import length, times

Array = NDArray[np.float64]

# So many corners has each circle of a round shape that is drawn.
_RING: Final = 12


@dataclass(frozen=True, eq=False)
class LinkPiece:
    """A convex shape that a joint moves.

    Parameters
    ----------
    link
        Number of the joint, counted from 1.
    shape
        As it is described.
    """

    link: int
    shape: LinkShape

    @cached_property
    def geometry(self) -> Any:
        """The geometry of coal, in the frame `frame`."""
        if isinstance(self.shape, Hull):
            points = coal.StdVec_Vec3s()
            points.extend(list(np.array(self.shape.corners_m)))
            return coal.Convex.convexHull(points, True, "Qt")
        length_m = math.dist(self.shape.start_m, self.shape.end_m)
        made = coal.Capsule if isinstance(self.shape, Capsule) else coal.Cylinder
        return made(self.shape.radius_m, length_m)

    @cached_property
    def frame(self) -> Any:
        """Where the geometry is in the frame of the joint, as `pinocchio.SE3`."""
        if isinstance(self.shape, Hull):
            return pin.SE3.Identity()
        start, end = np.array(self.shape.start_m), np.array(self.shape.end_m)
        along = end - start
        turned = _turned(along) if np.any(along) else np.eye(3)
        return pin.SE3(turned, (start + end) / 2)

    @cached_property
    def corners(self) -> Array:
        """Corners that it is drawn with, in the frame of the joint [m], shape (corners, 3)."""
        if isinstance(self.shape, Hull):
            return np.array(self.shape.corners_m)
        radius_m = self.shape.radius_m
        half_m = math.dist(self.shape.start_m, self.shape.end_m) / 2
        angles = 2 * np.pi * np.arange(_RING) / _RING
        # Of a round end a circle half-way up, and its top.
        rings = [(half_m, radius_m)]
        if isinstance(self.shape, Capsule):
            rings += [(half_m + radius_m * math.sqrt(0.5), radius_m * math.sqrt(0.5))]
            rings += [(half_m + radius_m, 0.0)]
        corners = [
            (ring_m * math.cos(angle), ring_m * math.sin(angle), side * height_m)
            for side in (-1, 1)
            for height_m, ring_m in rings
            for angle in angles
        ]
        frame = self.frame
        return np.asarray(times(np.array(corners), frame.rotation.T) + frame.translation)

    @cached_property
    def box(self) -> tuple[Array, Array]:
        """Centre and half extents of the box about it in the frame of the joint [m]."""
        if isinstance(self.shape, Hull):
            low, high = self.corners.min(axis=0), self.corners.max(axis=0)
        else:
            ends = np.array([self.shape.start_m, self.shape.end_m])
            low = ends.min(axis=0) - self.shape.radius_m
            high = ends.max(axis=0) + self.shape.radius_m
        return (low + high) / 2, (high - low) / 2


# Many detectors may be of one arm.
@lru_cache(maxsize=8)
def link_pieces(arm: ArmDescription) -> tuple[LinkPiece, ...]:
    """Return the shapes of all links that move; the base stands where it is put."""
    return tuple(
        LinkPiece(link, shape) for link, shapes in enumerate(arm.shapes) if link for shape in shapes
    )


def _turned(along: Array) -> Array:
    """Return a rotation that turns z along a vector, shape (3, 3)."""
    z = along / length(along)
    # Whichever axis is farther from it.
    aside = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.7 else np.array([0.0, 1.0, 0.0])
    x = np.cross(aside, z)
    x /= length(x)
    return np.column_stack([x, np.cross(z, x), z])
