"""Swings of the base about a docked leg, in whole numbers, and the actions that are made of them.

The base stands on the three pins of a triangle. In a swing two legs let go, the base turns about
the third and docks again (Veeramani and Muthuswamy 2022, section 3 and Table 1). Points are axial
coordinates (a, b): a steps along the pin lines and b steps 60 degrees counter-clockwise of them,
so that turning by 60 degrees is an integer matrix without rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from itertools import product

Axial = tuple[int, int]

HEADINGS: tuple[Axial, ...] = ((1, 0), (0, 1), (-1, 1), (-1, 0), (0, -1), (1, -1))
"""Steps to the six neighbours of a pin, counter-clockwise from along the pin lines."""

_UP: tuple[Axial, ...] = ((0, 0), (0, 1), (1, 0))
_DOWN: tuple[Axial, ...] = ((-1, 1), (0, 0), (0, 1))

LEGS = (1, 2, 3)
ANGLES_DEG = (60, 120, 180, 240, 300)


class Direction(StrEnum):
    """Sense of a swing, seen from above."""

    CW = "CW"
    CCW = "CCW"


def corners(up: bool) -> tuple[Axial, ...]:
    """Return legs 1, 2, 3 of a triangle at the origin.

    Upwards they are bottom-left, apex, bottom-right; downwards top-left, bottom, top-right.
    """
    return _UP if up else _DOWN


def rotated(point: Axial, sixths: int) -> Axial:
    """Turn a point about the origin by a multiple of 60 degrees, counter-clockwise."""
    a, b = point
    for _ in range(sixths % 6):
        a, b = -b, a + b
    return a, b


def triangle_at(points: Sequence[Axial]) -> tuple[int, int, bool]:
    """Find the triangle of the lattice with three given pins.

    Returns
    -------
    tuple
        Its row, counted downwards, and column, both relative to the upward triangle at the
        origin, and whether it points up.

    Raises
    ------
    ValueError
        If the points are not the corners of a triangle of side 1.
    """
    sum_a, sum_b = sum(a for a, _ in points), sum(b for _, b in points)
    up = sum_a % 3 == 1
    # The triangle at the origin has the sums 1 and 1, or -1 and 2.
    a, b = (sum_a - 1 if up else sum_a + 1) // 3, sum_b // 3
    if sorted(points) != sorted((a + x, b + y) for x, y in corners(up)):
        raise ValueError(f"The points {list(points)} are not the corners of a triangle of side 1.")
    return -b, 2 * a + b - (not up), up


@dataclass(frozen=True, slots=True)
class Turn:
    """A swing of a base, independent of its position.

    Parameters
    ----------
    leg
        The leg that stays docked, 1 to 3.
    direction
        Sense of the swing.
    angle_deg
        60, 120, 180, 240 or 300 [deg].

    Raises
    ------
    ValueError
        If there is no such leg or angle.
    """

    leg: int
    direction: Direction
    angle_deg: int

    def __post_init__(self) -> None:
        if self.leg not in LEGS:
            raise ValueError(f"A base has legs 1, 2 and 3, not {self.leg}.")
        if self.angle_deg not in ANGLES_DEG:
            known = ", ".join(map(str, ANGLES_DEG))
            raise ValueError(f"A swing turns by {known} degrees, not by {self.angle_deg}.")

    def __str__(self) -> str:
        return f"leg {self.leg} {self.direction} {self.angle_deg}"

    @property
    def sixths(self) -> int:
        """The angle in units of 60 degrees, counter-clockwise positive."""
        sixths = self.angle_deg // 60
        return sixths if self.direction is Direction.CCW else -sixths

    def shift(self, up: bool) -> tuple[int, int]:
        """Return the shift of a triangle in rows (downwards) and columns."""
        return _shift(self, up)

    def swept_headings(self, up: bool) -> tuple[int, ...]:
        """Return the indices into `HEADINGS` that the two free legs pass, ends included."""
        return _swept_headings(self, up)


@cache
def _shift(turn: Turn, up: bool) -> tuple[int, int]:
    legs = corners(up)
    pivot_a, pivot_b = legs[turn.leg - 1]
    ends = [
        (pivot_a + a, pivot_b + b)
        for a, b in (rotated((x - pivot_a, y - pivot_b), turn.sixths) for x, y in legs)
    ]
    row, col, _ = triangle_at(legs)
    end_row, end_col, _ = triangle_at(ends)
    return end_row - row, end_col - col


@cache
def _swept_headings(turn: Turn, up: bool) -> tuple[int, ...]:
    legs = corners(up)
    pivot_a, pivot_b = legs[turn.leg - 1]
    free = [(a - pivot_a, b - pivot_b) for a, b in legs if (a, b) != (pivot_a, pivot_b)]
    step = 1 if turn.direction is Direction.CCW else -1
    passed = {
        HEADINGS.index(rotated(leg, step * sixths))
        for leg in free
        for sixths in range(abs(turn.sixths) + 1)
    }
    return tuple(sorted(passed))


ALL_TURNS: tuple[Turn, ...] = tuple(
    Turn(leg, direction, angle_deg)
    for angle_deg, leg, direction in product(ANGLES_DEG, LEGS, Direction)
)
"""Every swing a base can make, the smaller angles first."""


@dataclass(frozen=True, slots=True)
class SwingAction:
    """An action that swings the base: its turn in even and in odd positions.

    Parameters
    ----------
    number
        1 to 12; B0, which stays, is none of them.
    even, odd
        The swing of a downward (even) and of an upward (odd) triangle.

    Raises
    ------
    ValueError
        If the number is out of range.
    """

    number: int
    even: Turn
    odd: Turn

    def __post_init__(self) -> None:
        if not 1 <= self.number <= 12:
            raise ValueError(f"Actions that swing are B1 to B12, not B{self.number}.")

    def turn(self, up: bool) -> Turn:
        """Return the swing of an upward or downward triangle."""
        return self.odd if up else self.even


_CW, _CCW = Direction.CW, Direction.CCW

SWING_ACTIONS: tuple[SwingAction, ...] = (
    SwingAction(1, Turn(1, _CCW, 60), Turn(2, _CCW, 180)),
    SwingAction(2, Turn(3, _CW, 120), Turn(2, _CCW, 120)),
    SwingAction(3, Turn(2, _CW, 60), Turn(2, _CCW, 60)),
    SwingAction(4, Turn(2, _CW, 120), Turn(3, _CCW, 120)),
    SwingAction(5, Turn(2, _CCW, 180), Turn(1, _CW, 60)),
    SwingAction(6, Turn(2, _CCW, 120), Turn(1, _CW, 120)),
    SwingAction(7, Turn(1, _CW, 60), Turn(1, _CCW, 60)),
    SwingAction(8, Turn(1, _CCW, 120), Turn(2, _CW, 120)),
    SwingAction(9, Turn(1, _CW, 120), Turn(1, _CCW, 120)),
    SwingAction(10, Turn(3, _CCW, 120), Turn(3, _CW, 120)),
    SwingAction(11, Turn(3, _CCW, 180), Turn(1, _CCW, 180)),
    SwingAction(12, Turn(1, _CCW, 180), Turn(3, _CCW, 180)),
)
"""B1 to B12 (paper, Table 1; B9 of even positions corrected, see docs/explanation/reproduction.md).

Of B11 and B12 the paper gives only where they lead: on 13 columns +11 and +15 from odd positions,
-11 and -15 from even ones. Each of these shares one pin with the start and lies opposite across
it, so that 180 degrees about that pin lead there and no lesser angle does. Either direction will
do; it is counter-clockwise as in the table's other swings by 180 degrees.
"""


@dataclass(frozen=True, slots=True)
class Swing:
    """One swing on a bench; positions and pins are counted from 0.

    Parameters
    ----------
    action
        1 to 12: the action that leads from start to end. `Bench.swing` gives its own swing,
        `Bench.swings_between` also others that end alike.
    leg
        The leg that stays docked, 1 to 3, as numbered at the start.
    pivot
        The pin that it stays docked on.
    direction, angle_deg
        Sense and angle [deg], as in `Turn`.
    start, end
        Positions.

    Raises
    ------
    ValueError
        If the action is none of these, the leg or angle is none of a `Turn`, a number is negative,
        or the swing ends where it starts.
    """

    action: int
    leg: int
    pivot: int
    direction: Direction
    angle_deg: int
    start: int
    end: int

    def __post_init__(self) -> None:
        if not 1 <= self.action <= 12:
            raise ValueError(f"Swings are actions B1 to B12, not B{self.action}.")
        Turn(self.leg, self.direction, self.angle_deg)
        if min(self.pivot, self.start, self.end) < 0:
            raise ValueError(f"Pins and positions are counted from 0: {self}.")
        if self.start == self.end:
            raise ValueError(f"A swing leads to another position: {self}.")

    @property
    def turn(self) -> Turn:
        """The swing without its position."""
        return Turn(self.leg, self.direction, self.angle_deg)
