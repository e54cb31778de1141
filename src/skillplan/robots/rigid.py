"""Rigid transforms in plain Python: what follows what, and masses put together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from skillplan.robots.arm_description import Transform, Triple

Matrix = tuple[Triple, Triple, Triple]
_ONE: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True, slots=True)
class Rigid:
    """A rotation, by its rows, and an origin [m]."""

    rows: Matrix = _ONE
    origin: Triple = (0.0, 0.0, 0.0)

    @classmethod
    def of(cls, xyz_m: Triple, rpy_rad: Triple) -> Rigid:
        """Return what is moved, then turned about fixed x, y and z."""
        (cr, cp, cy), (sr, sp, sy) = (
            tuple(function(angle) for angle in rpy_rad) for function in (math.cos, math.sin)
        )
        rows = (
            (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
            (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
            (-sp, cp * sr, cp * cr),
        )
        return cls(rows, xyz_m)

    def rotate(self, vector: Triple) -> Triple:
        """Return a vector of its frame in the frame before."""
        x, y, z = (sum(a * b for a, b in zip(row, vector, strict=True)) for row in self.rows)
        return (x, y, z)

    def apply(self, point: Triple) -> Triple:
        """Return a point of its frame [m] in the frame before."""
        x, y, z = self.rotate(point)
        return (x + self.origin[0], y + self.origin[1], z + self.origin[2])

    def then(self, other: Rigid) -> Rigid:
        """Return what is given in this one's frame in the frame before."""
        columns = [self.rotate(_column(other.rows, number)) for number in range(3)]
        (a, b, c), (d, e, f), (g, h, i) = columns
        return Rigid(((a, d, g), (b, e, h), (c, f, i)), self.apply(other.origin))

    def turned(self, tensor: Matrix) -> Matrix:
        """Return a tensor of its frame along the axes of the frame before."""
        half = [self.rotate(row) for row in tensor]
        columns = [self.rotate(_column((half[0], half[1], half[2]), n)) for n in range(3)]
        return (columns[0], columns[1], columns[2])

    @property
    def transform(self) -> Transform:
        """The same by roll, pitch and yaw."""
        (xx, _, _), (yx, yy, yz), (zx, zy, zz) = self.rows
        pitch = math.atan2(-zx, math.hypot(zy, zz))
        if math.hypot(zy, zz) < 1e-9:
            # Roll and yaw turn about one axis: all of it is roll.
            return Transform(self.origin, (math.atan2(-yz, yy), pitch, 0.0))
        return Transform(self.origin, (math.atan2(zy, zz), pitch, math.atan2(yx, xx)))


@dataclass(frozen=True, slots=True)
class Mass:
    """A mass [kg], its centre [m] and its inertia about that [kg m2], in one frame."""

    kg: float
    centre: Triple
    tensor: Matrix

    def seen_from(self, frame: Rigid) -> Mass:
        """Return it in the frame that its own is given in."""
        return Mass(self.kg, frame.apply(self.centre), frame.turned(self.tensor))


def together(masses: Sequence[Mass]) -> Mass:
    """Return masses of one frame as one (Huygens and Steiner).

    Parameters
    ----------
    masses
        One at least, each > 0.
    """
    kg = sum(mass.kg for mass in masses)
    x, y, z = (sum(mass.kg * mass.centre[axis] for mass in masses) / kg for axis in range(3))
    total = [[0.0] * 3 for _ in range(3)]
    for mass in masses:
        away = (mass.centre[0] - x, mass.centre[1] - y, mass.centre[2] - z)
        square = sum(value * value for value in away)
        for i in range(3):
            for j in range(3):
                shift = (square if i == j else 0.0) - away[i] * away[j]
                total[i][j] += mass.tensor[i][j] + mass.kg * shift
    (a, b, c), (d, e, f), (g, h, i9) = total
    return Mass(kg, (x, y, z), ((a, b, c), (d, e, f), (g, h, i9)))


def _column(rows: Matrix, number: int) -> Triple:
    return (rows[0][number], rows[1][number], rows[2][number])
