"""Names of the pieces of an exploded view beside it, or numbers with a legend below it."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from skillplan.views.figures.picture import SMALL_PX, Picture, make_rectangle, measure_text_px
from skillplan.views.figures.solids import OVERSAMPLING, Point

MOST_NAMED = 32
"""Largest number of pieces with names beside the picture."""

MARGIN_PX, NAMES_PX, PITCH_PX = 20.0, 210.0, 21.0
LEGEND_PX, LEGEND_PITCH_PX = 270.0, 16.0
"""Width of a column of the legend, and distance of its rows [px]."""

LEGEND_NAME_PX = LEGEND_PX - 46
"""Width of a name in the legend [px]."""

_NUMBER_PX, _HALF_PX = 8.5, 6.5
# Places that are tried for a number: distance between neighbours, and reach from the piece [px].
_STEP_PX, _REACH_PX = 3, 330
# Cost of a pixel of another piece under a number, in pixels of distance.
_COVERED = 0.35


def write_names(picture: Picture, names: Mapping[int, str], anchors: Mapping[int, Point]) -> None:
    """Write numbers and names on the right, each with a line to its piece.

    Parameters
    ----------
    names, anchors
        Name and rightmost visible point of each piece [px], by number.
    """
    ordered = sorted(names, key=lambda number: anchors[number][1])
    ys: list[float] = []
    for number in ordered:
        y = anchors[number][1]
        ys.append(max(y, ys[-1] + PITCH_PX) if ys else max(y, MARGIN_PX))
    lowest = picture.height_px - MARGIN_PX
    for index in reversed(range(len(ys))):
        ys[index] = min(ys[index], lowest)
        lowest = ys[index] - PITCH_PX
    x = picture.width_px - NAMES_PX
    for number, y in zip(ordered, ys, strict=True):
        anchor = anchors[number]
        picture.line((anchor, (x - 26, y), (x - 10, y)), "faint", 0.9)
        picture.disc(anchor, 1.8, "ink")
        picture.disc((x, y), 9.5, "paper", "ink", 1.1)
        picture.label((x, y), str(number), size_px=SMALL_PX, bold=True)
        picture.label((x + 16, y), names[number], anchor="start")


def measure_legend_px(count: int, width_px: float) -> float:
    """Return the height of a legend with a number of entries."""
    return LEGEND_PITCH_PX * math.ceil(count / _count_columns(width_px)) + MARGIN_PX


def _count_columns(width_px: float) -> int:
    return max(1, int((width_px - MARGIN_PX) / LEGEND_PX))


def write_legend(
    picture: Picture, names: Mapping[int, str], roles: Mapping[int, str], top_px: float
) -> None:
    """Write the numbers and names of pieces in columns, each with its colour."""
    columns = _count_columns(picture.width_px)
    rows = math.ceil(len(names) / columns)
    width_px = (picture.width_px - MARGIN_PX) / columns
    for place, (number, name) in enumerate(names.items()):
        x = MARGIN_PX + width_px * (place // rows)
        y = top_px + LEGEND_PITCH_PX * (place % rows + 0.5)
        picture.label((x + 20, y), str(number), size_px=SMALL_PX, anchor="end", bold=True)
        picture.disc((x + 28, y), 4.0, roles[number])
        picture.label((x + 36, y), name, size_px=SMALL_PX, anchor="start")


def write_numbers(
    picture: Picture, anchors: Mapping[int, Point], bodies: NDArray[np.int64], height_px: float
) -> None:
    """Write the number of each piece on it or near it; no number covers another.

    Parameters
    ----------
    anchors
        A visible point of each piece [px], by number.
    bodies
        Number of the piece at each painted pixel, -1 for none, shape (h, w).
    height_px
        Height of the area for numbers.
    """
    placer = _NumberPlacer(bodies[::OVERSAMPLING, ::OVERSAMPLING], picture.width_px, height_px)
    halves = {number: _measure_half_px(number) for number in anchors}
    # Small pieces have the fewest places.
    areas = np.bincount(placer.bodies.reshape(-1) + 1, minlength=max(anchors, default=0) + 2)[1:]
    centres = {
        number: placer.place(number, anchors[number], halves[number])
        for number in sorted(anchors, key=lambda number: (int(areas[number]), number))
    }
    for number, centre in centres.items():
        if not placer.lies_on(number, centre):
            picture.line((anchors[number], centre), "ink", 0.7)
            picture.disc(anchors[number], 1.4, "ink")
    for number, (x, y) in centres.items():
        half = halves[number]
        box = make_rectangle(x - half, y - _HALF_PX, x + half, y + _HALF_PX)
        picture.polygon(box, "paper", "ink", 0.7, opacity=0.9)
        picture.label((x, y), str(number), size_px=_NUMBER_PX, bold=True)


def _measure_half_px(number: int) -> float:
    return 1.15 * measure_text_px(str(number), _NUMBER_PX) / 2 + 2.5


class _NumberPlacer:
    """Finds places for numbers, near their pieces and off other pieces.

    Parameters
    ----------
    bodies
        Number of the piece at each pixel, -1 for none, shape (h, w).
    """

    def __init__(self, bodies: NDArray[np.int64], width_px: float, height_px: float) -> None:
        self.bodies = bodies
        self.width_px, self.height_px = width_px, height_px
        self._drawn = _sum_areas(bodies >= 0)
        self._boxes: list[tuple[float, float, float]] = []

    def lies_on(self, number: int, centre: Point) -> bool:
        """Return whether a point lies on a piece."""
        row, column = int(centre[1]), int(centre[0])
        height, width = self.bodies.shape
        return row < height and column < width and int(self.bodies[row, column]) == number

    def place(self, number: int, anchor: Point, half_px: float) -> Point:
        """Return the centre of the best free place for a number, and reserve it."""
        offsets = np.arange(-_REACH_PX, _REACH_PX + 1, _STEP_PX, dtype=np.float64)
        x, y = np.meshgrid(anchor[0] + offsets, anchor[1] + offsets)
        inside = (x >= half_px + 1) & (x <= self.width_px - half_px - 1)
        inside &= (y >= _HALF_PX + 1) & (y <= self.height_px - _HALF_PX - 1)
        for left, middle, half in self._boxes:
            inside &= (np.abs(x - left) >= half + half_px + 2) | (
                np.abs(y - middle) >= 2 * _HALF_PX + 2
            )
        own = _sum_areas(self.bodies == number)
        covered = _count(self._drawn, x, y, half_px) - _count(own, x, y, half_px)
        cost = np.hypot(x - anchor[0], y - anchor[1]) + _COVERED * covered
        cost[~inside] = np.inf
        best = np.unravel_index(int(np.argmin(cost)), cost.shape)
        centre = (float(x[best]), float(y[best]))
        self._boxes.append((*centre, half_px))
        return centre


def _sum_areas(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the summed-area table of a mask, with a first row and column of zeros."""
    sums = np.zeros((mask.shape[0] + 1, mask.shape[1] + 1), dtype=np.int64)
    sums[1:, 1:] = mask.cumsum(axis=0).cumsum(axis=1)
    return sums


def _count(
    sums: NDArray[np.int64], x: NDArray[np.float64], y: NDArray[np.float64], half_px: float
) -> NDArray[np.int64]:
    """Return the number of set pixels under a number at each centre."""
    height, width = sums.shape[0] - 1, sums.shape[1] - 1
    left, right = (np.clip(np.rint(x + side).astype(int), 0, width) for side in (-half_px, half_px))
    top, bottom = (
        np.clip(np.rint(y + side).astype(int), 0, height) for side in (-_HALF_PX, _HALF_PX)
    )
    return np.asarray(sums[bottom, right] - sums[top, right] - sums[bottom, left] + sums[top, left])
