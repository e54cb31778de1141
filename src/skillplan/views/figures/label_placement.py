"""Greedy placement of labels: each takes the emptiest of several places near its anchor."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from skillplan.views.figures.figure_style import measure_text_in

Point = tuple[float, float]
_SPACING_IN = 0.03
_ANGLES = 16
_OVER_LABEL = 1000.0
_OUTSIDE = 400.0


class LabelPlacer:
    """Finds places for labels among obstacles. All coordinates are in inches.

    Parameters
    ----------
    width_in, height_in
        Size of the paper from (0, 0), > 0.
    """

    def __init__(self, width_in: float, height_in: float) -> None:
        self.width_in = width_in
        self.height_in = height_in
        self._obstacles: list[NDArray[np.float64]] = []
        self._boxes: list[tuple[float, float, float, float]] = []

    def avoid_line(self, points: Sequence[Point]) -> None:
        """Keep labels off a polyline."""
        for (x0, y0), (x1, y1) in pairwise(points):
            n = max(2, int(math.hypot(x1 - x0, y1 - y0) / _SPACING_IN))
            t = np.linspace(0.0, 1.0, n)
            self._obstacles.append(np.stack([x0 + t * (x1 - x0), y0 + t * (y1 - y0)], axis=1))

    def avoid_disc(self, centre: Point, radius_in: float) -> None:
        """Keep labels off a disc."""
        radii = np.append(np.arange(0.0, radius_in, _SPACING_IN), radius_in)
        for radius in radii.tolist():
            n = max(1, math.ceil(2 * math.pi * radius / _SPACING_IN))
            angles = np.arange(n) * (2 * math.pi / n)
            around = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
            self._obstacles.append(around + centre)

    def avoid_box(self, centre: Point, width_in: float, height_in: float) -> None:
        """Keep labels off a box, such as another text."""
        x, y = centre
        half_w, half_h = width_in / 2, height_in / 2
        self._boxes.append((x - half_w, y - half_h, x + half_w, y + half_h))

    def is_free(self, centre: Point, text: str, size_pt: float) -> bool:
        """Return whether a text of a font size [pt] covers no obstacle at a place."""
        width, height = _measure_label_in(text, size_pt)
        points = np.concatenate(self._obstacles) if self._obstacles else np.empty((0, 2))
        return self._cost(centre, width, height, points) == 0

    def place(
        self,
        anchor: Point,
        text: str,
        size_pt: float,
        distances_in: Sequence[float],
        preferred_rad: float = math.pi / 2,
    ) -> Point:
        """Return the centre of the emptiest place for a text near an anchor, and reserve it.

        Parameters
        ----------
        text, size_pt
            Label and its font size [pt].
        distances_in
            Distances from the anchor to the nearest point of the label, best first.
        preferred_rad
            Direction of the label if all places are empty.
        """
        width, height = _measure_label_in(text, size_pt)
        points = np.concatenate(self._obstacles) if self._obstacles else np.empty((0, 2))
        near = np.hypot(*(points - anchor).T) <= max(distances_in) + width + height
        points = points[near]
        best, best_cost = anchor, math.inf
        for order, distance_in in enumerate(distances_in):
            for turn in range(_ANGLES):
                # To either side of the preferred direction in turn.
                away = (turn + 1) // 2 * (1 if turn % 2 else -1) * 2 * math.pi / _ANGLES
                angle = preferred_rad + away
                centre = (
                    anchor[0] + math.cos(angle) * (distance_in + width / 2),
                    anchor[1] + math.sin(angle) * (distance_in + height / 2),
                )
                cost = self._cost(centre, width, height, points)
                cost += 0.4 * abs(away) + 0.8 * order
                if cost < best_cost:
                    best, best_cost = centre, cost
        self.avoid_box(best, width, height)
        return best

    def covers_label(self, centre: Point, text: str, size_pt: float) -> bool:
        """Return whether a text of a font size [pt], placed last, covers another label."""
        return self._count_covered(centre, *_measure_label_in(text, size_pt)) > 1

    def _count_covered(self, centre: Point, width: float, height: float) -> int:
        x, y = centre
        left, right, low, high = x - width / 2, x + width / 2, y - height / 2, y + height / 2
        return sum(
            box[0] < right and left < box[2] and box[1] < high and low < box[3]
            for box in self._boxes
        )

    def _cost(
        self, centre: Point, width: float, height: float, points: NDArray[np.float64]
    ) -> float:
        x, y = centre
        left, right, low, high = x - width / 2, x + width / 2, y - height / 2, y + height / 2
        covered = (
            (points[:, 0] > left)
            & (points[:, 0] < right)
            & (points[:, 1] > low)
            & (points[:, 1] < high)
        )
        cost = 2.0 * float(np.count_nonzero(covered))
        cost += _OVER_LABEL * self._count_covered(centre, width, height)
        if left < 0 or low < 0 or right > self.width_in or high > self.height_in:
            cost += _OUTSIDE
        return cost


def _measure_label_in(text: str, size_pt: float) -> tuple[float, float]:
    """Return the size of a text with a small margin [in]."""
    return measure_text_in(text, size_pt) + 0.07, 1.35 * size_pt / 72
