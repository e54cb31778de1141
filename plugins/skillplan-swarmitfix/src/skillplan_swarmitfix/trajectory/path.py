"""A tool trajectory read from a file, and the error for a file without one."""

from __future__ import annotations

import math
import sys
import time
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Self

from skillplan_swarmitfix.trajectory.path_elements import (
    Element,
    Point2,
    Spline,
    ending_at,
    measure_m,
    points_of,
)

JOIN_M = 1e-5
"""Ends of a file's elements as near as this are joined [m]: files hold rounded decimals."""


PROGRESS_S = 2.0
"""Interval of reports on a large file [s]."""


class TrajectoryFileError(ValueError):
    """A file that no trajectory can be read from: ``file: place: what, and what instead``.

    Parameters
    ----------
    path
        The file as the user named it.
    message
        The fault and its correction, in one line.
    place
        The line or the entity at fault; empty for the file as a whole.
    """

    def __init__(self, path: Path, message: str, place: str = "") -> None:
        self.path = path
        self.message = message
        self.place = place
        super().__init__(": ".join(filter(None, (str(path), place, message))))


@dataclass(frozen=True)
class TrajectoryPath:
    """The trajectory of a file.

    Parameters
    ----------
    start
        Start of the first element [m].
    elements
        At least one, in order along the trajectory. If it is closed, they lead back to the start.
    closed
        True if it ends at its start.
    places
        Origin of each element in the file, for messages: ``line 12``, or
        ``LWPOLYLINE #2F, vertex 3``.
    start_place
        Origin of the start in the file; empty if it belongs to the first element.
    unit_assumed
        True if the file has no unit, so that millimetres were assumed.
    layer
        Layer of a drawing.
    notes
        Everything that was assumed or left out, a clause each.
    holes
        Centres of drilled holes, which do not belong to the path [m].

    Raises
    ------
    ValueError
        If there is no element, or not one place per element.
    """

    start: Point2
    elements: tuple[Element, ...]
    closed: bool
    places: tuple[str, ...]
    start_place: str = ""
    unit_assumed: bool = False
    layer: str = ""
    notes: tuple[str, ...] = ()
    holes: tuple[Point2, ...] = ()

    def __post_init__(self) -> None:
        if not self.elements:
            raise ValueError("A trajectory needs an element.")
        if len(self.places) != len(self.elements):
            raise ValueError(f"{len(self.places)} places for {len(self.elements)} elements.")

    @cached_property
    def length_m(self) -> float:
        """Length of all elements, of arcs that of the arcs themselves [m]."""
        starts = [self.start, *(element.end for element in self.elements)]
        return math.fsum(map(measure_m, starts, self.elements))

    @property
    def extent_m(self) -> Point2:
        """Sides of the rectangle about its start and the points that its elements name [m]."""
        points = [self.start, *(p for element in self.elements for p in points_of(element))]
        (x_low, x_high), (y_low, y_high) = ((min(c), max(c)) for c in zip(*points, strict=True))
        return x_high - x_low, y_high - y_low

    @classmethod
    def ended(
        cls, start: Point2, elements: list[Element], places: list[str], start_place: str = ""
    ) -> Self:
        """Return the trajectory, which is closed if it ends within `JOIN_M` of its start.

        A single line or arc that does so is of no length, and stays open.
        """
        may_close = len(elements) > 1 or isinstance(elements[0], Spline)
        closed = may_close and math.dist(elements[-1].end, start) <= JOIN_M
        if closed:
            elements = [*elements[:-1], ending_at(elements[-1], start)]
        return cls(start, tuple(elements), closed, tuple(places), start_place)

    def place_of(self, path: tuple[str | int, ...]) -> str:
        """Return the place of a fault in the file, from its path in `workpiece.faults`.

        Empty where the fault is in the trajectory as a whole.
        """
        match path:
            case (int(i),):
                return self.places[i]
            case ("start",):
                return self.start_place or self.places[0]
        return ""


class Progress:
    """Reports on stderr how far a file is read, every two seconds.

    Parameters
    ----------
    path
        The file.
    """

    def __init__(self, path: Path) -> None:
        self._name = one_line(path.name, 60)
        self._due_s = time.monotonic() + PROGRESS_S

    def report(self, done: int, total: int, what: str) -> None:
        """Print how much is done, if it is time to."""
        if time.monotonic() >= self._due_s:
            self._due_s += PROGRESS_S
            sys.stderr.write(f"skillplan: reading {self._name}: {what} {done:,} of {total:,}\n")


def millimetres(length_m: float) -> str:
    """Return a length [m] in millimetres as messages show it: ``31.416``."""
    return f"{length_m * 1e3:.3f}".replace("-0.000", "0.000")


def count(number: int, noun: str) -> str:
    """Return a number with its noun: ``1 point``, ``3 points``."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def merged_note(number: int) -> str:
    """Return the note about points that repeat the one before."""
    verb = "repeats the one before is" if number == 1 else "repeat the one before are"
    return f"{count(number, 'point')} that {verb} merged"


def one_line(foreign: str, most: int = 100) -> str:
    """Return foreign text as messages show it: in one line, printable and short."""
    text = " ".join(foreign.split()).rstrip(".")
    text = "".join(char if char.isprintable() else "?" for char in text)
    return text if len(text) <= most else text[: most - 3] + "..."
