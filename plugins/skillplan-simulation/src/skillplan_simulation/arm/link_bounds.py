"""Boxes about the links of an arm, wherever its joints have them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skillplan.robots.arm_description import Hull, LinkShape
from skillplan_pinocchio.kinematics.fixed_order import times
from skillplan_simulation.arm.kinematics import ArmKinematics

Vector = NDArray[np.float64]

# All of a link of which no shape is known is this near to the line between its joints [m].
_RADIUS_M = 0.15


class LinkBounds:
    """Knows where the links of an arm are.

    Parameters
    ----------
    kinematics
        Of the arm.
    """

    def __init__(self, kinematics: ArmKinematics) -> None:
        self._kinematics = kinematics
        shapes = kinematics.arm.description.shapes
        # The base stands still, and so do its neighbours.
        self._links = [_points(pieces) for pieces in shapes[1:]]

    def at(self, joints_rad: Vector) -> Vector:
        """Return the lower and upper corners of boxes about all links [m], shape (links, 2, 3).

        Parameters
        ----------
        joints_rad
            Shape (joints,).
        """
        frames = self._kinematics.frames(joints_rad)
        if not self._links:
            ends = np.array([frame.translation for frame in frames])
            pairs = np.stack([ends[:-1], ends[1:]], axis=1)
            return np.stack([pairs.min(axis=1) - _RADIUS_M, pairs.max(axis=1) + _RADIUS_M], axis=1)
        found = []
        for (points, radius), frame in zip(self._links, frames, strict=False):
            placed = times(points, frame.rotation.T) + frame.translation
            found.append(((placed - radius).min(axis=0), (placed + radius).max(axis=0)))
        return np.array(found)


def _points(pieces: Sequence[LinkShape]) -> tuple[Vector, Vector]:
    """Return points of a link and how far its surface is from each [m], shape (n, 3) and (n, 1)."""
    points: list[tuple[float, float, float]] = []
    radii: list[float] = []
    for piece in pieces:
        here = piece.corners_m if isinstance(piece, Hull) else (piece.start_m, piece.end_m)
        points += here
        radii += [0.0 if isinstance(piece, Hull) else piece.radius_m] * len(here)
    return np.array(points), np.array(radii).reshape(-1, 1)
