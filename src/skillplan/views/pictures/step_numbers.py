"""Rows of step numbers at the places where steps end, none over another."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from skillplan.views.pictures.drawing import (
    SMALL_PX,
    Disc,
    Item,
    Label,
    Look,
    Point,
    Shape,
    text_width_px,
)

NUMBER_PX: Final = 9.5
"""Half the height of a row."""
_APART_PX = 2.0
# So much wider is text in bold.
_BOLDER = 1.15
# How far aside a row may be, in heights.
_MOST_ROWS = 5


@dataclass(frozen=True, slots=True)
class NumberRow:
    """Numbers of the steps that end at a place.

    Parameters
    ----------
    at
        The place [px].
    centre
        Where the row is: there, or aside [px].
    half_px
        Half its width.
    numbers
        In rising order.
    """

    at: Point
    centre: Point
    half_px: float
    numbers: tuple[int, ...]

    def leader(self) -> Iterator[Item]:
        """Yield a line from the place to the row where it is aside; it belongs behind all rows."""
        if self.centre != self.at:
            yield Shape((self.at, self.centre), Look(stroke="ink", width_px=0.8), closed=False)
            yield Disc(self.at, 2.5, Look("ink"))

    def items(self, title: str) -> Iterator[Item]:
        """Yield the row."""
        yield Shape(_pill(self.centre, self.half_px), Look("paper", "ink", 1.1), title=title)
        yield Label(self.centre, _words(self.numbers), size_px=SMALL_PX, bold=True)


def number_rows(ends: Mapping[Point, Sequence[int]], room_px: Point) -> list[NumberRow]:
    """Return a row of numbers a place, aside where it would cover another.

    Parameters
    ----------
    ends
        Numbers by the place where their steps end [px].
    room_px
        Width and height of where rows may be.
    """
    halves = {
        at: max(NUMBER_PX, _BOLDER * text_width_px(_words(numbers), SMALL_PX) / 2 + 4)
        for at, numbers in ends.items()
    }
    rows: list[NumberRow] = []
    # What is short stays where it is.
    for at in sorted(ends, key=halves.__getitem__):
        centre = _free(at, halves[at], rows, room_px)
        rows.append(NumberRow(at, centre, halves[at], tuple(ends[at])))
    return rows


def _free(at: Point, half_px: float, rows: Sequence[NumberRow], room_px: Point) -> Point:
    """Return where a row covers no other, as near to its place as can be."""
    high = 2 * NUMBER_PX + _APART_PX
    shifts = [
        (across * half_px, down * high)
        for across in (0, -1, 1)
        for down in range(-_MOST_ROWS, _MOST_ROWS + 1)
    ]
    for across, down in sorted(shifts, key=lambda shift: math.hypot(*shift)):
        x, y = at[0] + across, at[1] + down
        inside = half_px <= x <= room_px[0] - half_px and NUMBER_PX <= y <= room_px[1] - NUMBER_PX
        if inside and not any(
            abs(x - row.centre[0]) < half_px + row.half_px + _APART_PX
            and abs(y - row.centre[1]) < high - 1e-9
            for row in rows
        ):
            return x, y
    return at


def _words(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers))


def _pill(centre: Point, half_px: float) -> tuple[Point, ...]:
    """Return the outline of a rectangle with round ends."""
    points = []
    for turn in range(24):
        angle = -math.pi / 2 + 2 * math.pi * (turn + 0.5) / 24
        side = (half_px - NUMBER_PX) * (1 if math.cos(angle) > 0 else -1)
        x = centre[0] + side + NUMBER_PX * math.cos(angle)
        points.append((x, centre[1] + NUMBER_PX * math.sin(angle)))
    return tuple(points)
