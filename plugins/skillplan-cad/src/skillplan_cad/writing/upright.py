"""The pose of a product on the table."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan_cad.product import Part, Points, Vector

Array = NDArray[np.float64]
_DECIMALS = 7


@dataclass(frozen=True, eq=False)
class Upright:
    """Pose of the product on the table.

    Parameters
    ----------
    matrix
        Rotation from the product's frame to the world.
    offset_m
        Translation after the rotation [m].
    """

    matrix: Array
    offset_m: Array

    def point(self, point_m: Vector) -> tuple[float, float, float]:
        """Return a point of the product in the world, rounded to 0.1 micrometres."""
        return _round(self.matrix @ np.asarray(point_m) + self.offset_m)

    def vector(self, vector: Vector) -> tuple[float, float, float]:
        """Return a direction of the product in the world."""
        return _round(self.matrix @ np.asarray(vector))

    def vertices(self, part: Part) -> Points:
        """Return the vertices of a part in the world."""
        return part.vertices_m @ self.matrix.T + self.offset_m

    def bottom(self, part: Part) -> tuple[float, float, float]:
        """Return the centre of the bottom face of a part's bounding box."""
        points = self.vertices(part)
        low, high = points.min(axis=0), points.max(axis=0)
        return _round(np.array([*((low + high) / 2)[:2], low[2]]))

    def size(self, part: Part) -> Array:
        """Return the extents of a part's bounding box."""
        return np.asarray(np.ptp(self.vertices(part), axis=0))


def place_upright(parts: Iterable[Part], up: Vector, place_m: tuple[float, float]) -> Upright:
    """Return the pose that puts parts on the table, centred on a place.

    Parameters
    ----------
    up
        Vector that points up, in the product's frame.
    place_m
        Centre of their bounding box on the table, x y [m].
    """
    matrix = compute_rotation_to_z(up)
    points = np.concatenate([part.vertices_m for part in parts]) @ matrix.T
    low, high = points.min(axis=0), points.max(axis=0)
    middle = (low + high) / 2
    return Upright(matrix, np.array([place_m[0] - middle[0], place_m[1] - middle[1], -low[2]]))


def compute_rotation_to_z(up: Vector) -> Array:
    """Return the smallest rotation that turns a unit vector upwards."""
    z = np.asarray(up) / np.linalg.norm(up)
    if abs(z[2]) > 1 - 1e-12:
        return np.diag([1.0, z[2], z[2]])
    axis = np.cross(z, [0.0, 0.0, 1.0])
    sine, cosine = float(np.linalg.norm(axis)), float(z[2])
    x, y, w = axis / sine
    across = np.array([[0.0, -w, y], [w, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + sine * across + (1 - cosine) * across @ across)


def _round(values: Array) -> tuple[float, float, float]:
    x, y, z = (round(float(value), _DECIMALS) + 0.0 for value in values)
    return x, y, z
