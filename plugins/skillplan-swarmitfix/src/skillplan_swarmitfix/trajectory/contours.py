"""The contours of a file, and the choice of the trajectory among them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from skillplan_swarmitfix.trajectory.path import (
    TrajectoryFileError,
    TrajectoryPath,
    count,
    millimetres,
    one_line,
)
from skillplan_swarmitfix.trajectory.path_elements import Arc, Point2, Spline, circle_of

MOST_LISTED = 12
"""So many contours are listed in a message."""

_SAMPLES_OF_A_CURVE = 17
_POINTS_INSIDE = 8
_MOST_NESTED = 300
_ON_A_LINE_M = 1e-5

Choice = str | int | Point2 | None
"""``"outer"``, a number from 1, a point to which the contour is nearest [m], or None."""


@dataclass(frozen=True)
class FileContours:
    """Everything a file offers as a trajectory.

    Parameters
    ----------
    path
        The file, for messages.
    contours
        At least one, in the order of the file.
    notes
        Everything that was assumed or left out of the file as a whole, a clause each.
    holes
        Centres of drilled holes [m].
    unit_assumed
        True if the file has no unit, so that millimetres were assumed.
    """

    path: Path
    contours: tuple[TrajectoryPath, ...]
    notes: tuple[str, ...] = ()
    holes: tuple[Point2, ...] = ()
    unit_assumed: bool = False

    def moved(
        self, place: Callable[[TrajectoryPath], TrajectoryPath], point: Callable[[Point2], Point2]
    ) -> FileContours:
        """Return the same contours and holes elsewhere."""
        return replace(
            self,
            contours=tuple(place(contour) for contour in self.contours),
            holes=tuple(point(hole) for hole in self.holes),
        )

    @property
    def box_m(self) -> tuple[float, float, float, float]:
        """The rectangle about all contours: x low, y low, x high, y high [m]."""
        boxes = np.array([_box(contour) for contour in self.contours])
        x0, y0 = boxes[:, :2].min(axis=0).tolist()
        x1, y1 = boxes[:, 2:].max(axis=0).tolist()
        return x0, y0, x1, y1

    def choose(self, choice: Choice = None) -> TrajectoryPath:
        """Return the contour that is meant, with all notes.

        Parameters
        ----------
        choice
            The contour; None for the only one, or for `"outer"` unless it may be a frame on a
            layer of its own.

        Raises
        ------
        TrajectoryFileError
            If no contour or more than one is meant; the message lists them.
        """
        number = self._number(choice)
        contour = self.contours[number]
        notes = [*self.notes, *contour.notes]
        if len(self.contours) > 1:
            notes.append(self._choice_note(number, choice))
        return replace(
            contour, notes=tuple(notes), holes=self.holes, unit_assumed=self.unit_assumed
        )

    def _number(self, choice: Choice) -> int:
        amount = len(self.contours)
        if isinstance(choice, int):
            if choice > amount:
                self._refuse(f"There is no contour {choice}")
            return choice - 1
        if isinstance(choice, tuple):
            distances_m = [_distance_m(contour, choice) for contour in self.contours]
            return distances_m.index(min(distances_m))
        if amount == 1:
            return 0
        layers = dict.fromkeys(contour.layer for contour in self.contours)
        outermost = self._outermost()
        if choice is None and len(layers) > 1 and not self._is_part(outermost):
            self._refuse(f"There are contours on {count(len(layers), 'layer')}")
        if outermost is None:
            self._refuse(f"There are {amount} contours, and none encloses all others")
        return outermost

    def _outermost(self) -> int | None:
        """Return the closed contour that encloses all others; None if there is none."""
        boxes = [_box(contour) for contour in self.contours]
        areas = [(x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in boxes]
        number = areas.index(max(areas))
        outer = self.contours[number]
        if not outer.closed:
            return None
        x0, y0, x1, y1 = boxes[number]
        for a0, b0, a1, b1 in boxes:
            if not (x0 <= a0 and y0 <= b0 and a1 <= x1 and b1 <= y1):
                return None
        others = [_sampled(c) for i, c in enumerate(self.contours) if i != number]
        few = [points[:: 1 + len(points) // _POINTS_INSIDE] for points in others]
        return number if _encloses(_sampled(outer), np.concatenate(few)) else None

    def _is_part(self, outermost: int | None) -> bool:
        """Return whether the contour around all layers is that of a part and not a frame.

        A frame is a rectangle, or encloses a contour that encloses another one.
        """
        if outermost is None or _is_rectangle(self.contours[outermost]):
            return False
        inner = [i for i in range(len(self.contours)) if i != outermost]
        points = [_sampled(self.contours[i])[:1] for i in inner]
        for i in inner[:_MOST_NESTED]:
            others = [point for k, point in zip(inner, points, strict=True) if k != i]
            if not others or not self.contours[i].closed:
                continue
            if _inside(_sampled(self.contours[i]), np.concatenate(others)).any():
                return False
        return len(inner) <= _MOST_NESTED

    def _choice_note(self, number: int, choice: Choice) -> str:
        if isinstance(choice, int | tuple):
            return f"contour {number + 1} of {len(self.contours)}"
        return (
            f"contour {number + 1} of {len(self.contours)}, which encloses the others: "
            f"{self._listed(without=number)}"
        )

    def _listed(self, without: int | None = None) -> str:
        entries = []
        several = len({contour.layer for contour in self.contours}) > 1
        for number, contour in enumerate(self.contours):
            if number == without:
                continue
            layer = f" on layer {one_line(contour.layer, 40)!r}" if several else ""
            form = "closed" if contour.closed else "open"
            x, y = contour.start
            entries.append(
                f"{number + 1}: {form} {millimetres(contour.length_m)} mm{layer} "
                f"from [{x:.4g}, {y:.4g}]"
            )
        rest = len(entries) - MOST_LISTED
        return "; ".join(entries[:MOST_LISTED]) + (f"; and {rest} more" if rest > 0 else "")

    def _refuse(self, message: str) -> NoReturn:
        layers = len({contour.layer for contour in self.contours}) > 1
        keys = "trajectory.layer or trajectory.contour" if layers else "trajectory.contour"
        notes = f" Note: {'; '.join(self.notes)}." if self.notes else ""
        raise TrajectoryFileError(
            self.path,
            f"{message}; choose by {keys} (a number, or at_m: [x, y]). {self._listed()}.{notes}",
        )


def _sampled(contour: TrajectoryPath) -> NDArray[np.float64]:
    """Return points along a contour, shape (n, 2) [m]."""
    points = [contour.start]
    start = contour.start
    for element in contour.elements:
        if isinstance(element, Arc):
            circle = circle_of(start, element)
            points += [circle.at(i / _SAMPLES_OF_A_CURVE) for i in range(1, _SAMPLES_OF_A_CURVE)]
        elif isinstance(element, Spline):
            points += element.through[:-1]
        points.append(element.end)
        start = element.end
    return np.array(points)


def _box(contour: TrajectoryPath) -> tuple[float, float, float, float]:
    points = _sampled(contour)
    (x0, y0), (x1, y1) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    return x0, y0, x1, y1


def _is_rectangle(contour: TrajectoryPath) -> bool:
    """Return whether a contour is its own bounding box."""
    if any(isinstance(element, Arc | Spline) for element in contour.elements):
        return False
    x0, y0, x1, y1 = _box(contour)
    return (
        abs(contour.length_m - 2 * (x1 - x0 + y1 - y0)) <= _ON_A_LINE_M
        and len(contour.elements) <= 8
    )


def _encloses(polygon: NDArray[np.float64], points: NDArray[np.float64]) -> bool:
    """Return whether every point lies within a closed polygon, or on it."""
    outside = points[~_inside(polygon, points)]
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if not len(outside):
            break
        along = b - a
        square = float(along @ along)
        share = (
            np.clip((outside - a) @ along / square, 0.0, 1.0) if square else np.zeros(len(outside))
        )
        gap = outside - a - share[:, None] * along
        outside = outside[np.hypot(gap[:, 0], gap[:, 1]) > _ON_A_LINE_M]
    return not len(outside)


def _inside(polygon: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which points lie within a closed polygon (even-odd rule)."""
    ends = np.roll(polygon, -1, axis=0)
    inside = np.zeros(len(points), dtype=np.bool_)
    for (ax, ay), (bx, by) in zip(polygon.tolist(), ends.tolist(), strict=True):
        if ay == by:
            continue
        spans = (points[:, 1] < ay) != (points[:, 1] < by)
        inside ^= spans & (points[:, 0] < ax + (points[:, 1] - ay) * (bx - ax) / (by - ay))
    return inside


def _distance_m(contour: TrajectoryPath, point: Point2) -> float:
    """Return the distance of a point from a contour, to the precision of samples [m]."""
    best_m = math.inf
    for a, b in itertools.pairwise(_sampled(contour).tolist()):
        along = (b[0] - a[0], b[1] - a[1])
        square = along[0] ** 2 + along[1] ** 2
        share = 0.0
        if square:
            share = ((point[0] - a[0]) * along[0] + (point[1] - a[1]) * along[1]) / square
        share = min(1.0, max(0.0, share))
        nearest = (a[0] + share * along[0], a[1] + share * along[1])
        best_m = min(best_m, math.dist(nearest, point))
    return best_m
