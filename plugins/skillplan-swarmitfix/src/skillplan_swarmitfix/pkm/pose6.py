"""Poses as a position and Euler angles ZYZ, and the rotation matrices behind them."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

Point3 = tuple[float, float, float]
Matrix = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Pose6:
    """Where the head stands in the PKM's base frame: position and Euler angles ZYZ.

    Parameters
    ----------
    x_m, y_m, z_m
        The head's origin W [m].
    alpha_rad, beta_rad, gamma_rad
        R = Rz(alpha) Ry(beta) Rz(gamma) [rad].

    Raises
    ------
    ValueError
        If a coordinate is not finite.
    """

    x_m: float
    y_m: float
    z_m: float
    alpha_rad: float
    beta_rad: float
    gamma_rad: float

    def __post_init__(self) -> None:
        for item in fields(self):
            if not math.isfinite(value := getattr(self, item.name)):
                raise ValueError(f"Pose6 {item.name} must be finite, not {value}.")

    @classmethod
    def of(cls, position_m: Matrix, rotation: Matrix) -> Pose6:
        """Return the pose of a position [m], shape (3,), and a rotation matrix, shape (3, 3)."""
        x_m, y_m, z_m = (float(value) for value in position_m)
        return cls(x_m, y_m, z_m, *zyz_angles(rotation))

    @property
    def position_m(self) -> Matrix:
        """The head's origin [m], shape (3,)."""
        return np.array([self.x_m, self.y_m, self.z_m])

    @property
    def rotation(self) -> Matrix:
        """The head's axes as columns, shape (3, 3)."""
        return zyz_matrix(self.alpha_rad, self.beta_rad, self.gamma_rad)


def zyz_matrix(first_rad: float, second_rad: float, third_rad: float) -> Matrix:
    """Return Rz(first) Ry(second) Rz(third), shape (3, 3), of angles [rad]."""
    product: Matrix = _rz(first_rad) @ _ry(second_rad) @ _rz(third_rad)
    return product


def zyz_angles(rotation: Matrix) -> Point3:
    """Return the Euler angles ZYZ [rad] of a rotation matrix, shape (3, 3); the second >= 0.

    The third is read off what the first two leave over, so that the three give the matrix back
    to rounding, also where the second is 0 or pi and the first is arbitrary.
    """
    first = math.atan2(rotation[1, 2], rotation[0, 2])
    second = math.atan2(math.hypot(rotation[0, 2], rotation[1, 2]), rotation[2, 2])
    rest = (_rz(first) @ _ry(second)).T @ rotation
    return first, second, math.atan2(rest[1, 0], rest[0, 0])


def _rz(angle_rad: float) -> Matrix:
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _ry(angle_rad: float) -> Matrix:
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
