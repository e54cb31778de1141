"""Collisions of convex pieces along a straight line."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial

import coal
import numpy as np

from skillplan.task.motion import Point
from skillplan_pinocchio.shapes import (
    STILL,
    ConvexPiece,
    Nearness,
    Obstacle,
    bound_gap,
    is_deeper,
    may_touch,
    measure_distance,
)


@dataclass(frozen=True, eq=False)
class Touch:
    """First contact along a line.

    Parameters
    ----------
    fraction
        Fraction of the line, in [0, 1].
    measure
        Returns position and depth. Called only if they are needed, as it takes long.
    """

    fraction: float
    measure: Callable[[], Nearness]

    @cached_property
    def _nearness(self) -> Nearness:
        return self.measure()

    @property
    def position(self) -> Point:
        """Position in the world [m]."""
        return self._nearness.position

    @property
    def penetration_m(self) -> float:
        """Penetration depth, > 0 [m]."""
        return round(-self._nearness.distance_m, 6)


class Sweep:
    """A straight displacement of some pieces.

    A convex piece sweeps the hull of its two ends, so contacts between samples are not missed;
    samples only locate the first contact.

    Parameters
    ----------
    label
        Phase in words: ``the approach``.
    mover
        Name of the moving part, in words.
    by
        Displacement [m].
    spares
        Bodies that may be touched.
    is_load
        True for the carried body, False for hand and tool.
    overlaps_m
        Depths to which it may enter some bodies by its fits [m].
    """

    def __init__(
        self,
        label: str,
        mover: str,
        pieces: tuple[ConvexPiece, ...],
        by: Point,
        spares: frozenset[str],
        *,
        is_load: bool = False,
        overlaps_m: Mapping[str, float] | None = None,
    ) -> None:
        self.label = label
        self.mover = mover
        self.pieces = pieces
        self.by = by
        self.is_load = is_load
        self.overlaps_m = overlaps_m or {}
        self.spares = spares
        self._swept = tuple(piece.swept(by) for piece in pieces)

    @cached_property
    def _around(self) -> ConvexPiece:
        """Two corners of a box about the swept pieces."""
        lows, highs = [own.low for own in self._swept], [own.high for own in self._swept]
        return ConvexPiece(np.array([np.min(lows, axis=0), np.max(highs, axis=0)]))

    def touch(self, obstacle: Obstacle, tolerance_m: float, samples: int) -> Touch | None:
        """Return the first contact with an obstacle, or None.

        Parameters
        ----------
        tolerance_m
            Penetration depth that counts as harmless touching [m], >= 0.
        samples
            Number of equal intervals of the line in which the first contact is searched, >= 1.
        """
        if not self.pieces:
            return None
        near = [other for other in obstacle.pieces if may_touch(self._around, other, tolerance_m)]
        pairs = [
            (self._find_entry(piece, other), piece, swept, other)
            for piece, swept in zip(self.pieces, self._swept, strict=True)
            for other in near
            if may_touch(swept, other, tolerance_m)
        ]
        # The first in the order of the pieces, of contacts at one place.
        chosen: tuple[float, int] = (math.inf, 0)
        first: Touch | None = None
        for order in sorted(range(len(pairs)), key=lambda order: pairs[order][0]):
            entry, piece, swept, other = pairs[order]
            if entry - 1 / samples > chosen[0]:
                break
            touch = self._touch(piece, swept, other, tolerance_m, samples, entry)
            if touch is not None and (touch.fraction, order) < chosen:
                chosen, first = (touch.fraction, order), touch
        return first

    def _find_entry(self, piece: ConvexPiece, other: ConvexPiece) -> float:
        """Return the fraction of the line before which the boxes of two pieces are apart."""
        entry = 0.0
        for axis, by_m in enumerate(self.by):
            if by_m:
                gap_m = other.low[axis] - piece.high[axis]
                back_m = other.high[axis] - piece.low[axis]
                entry = max(entry, (gap_m if by_m > 0 else back_m) / by_m)
        return entry

    def _touch(
        self,
        piece: ConvexPiece,
        swept: ConvexPiece,
        other: ConvexPiece,
        tolerance_m: float,
        samples: int,
        entry: float,
    ) -> Touch | None:
        """Return the first contact of two pieces, whose boxes are apart before an entry."""
        if not is_deeper(swept.hull, STILL, other.hull, STILL, tolerance_m):
            return None
        line = _Line(piece, other, self.by, samples, tolerance_m)
        gaps_m = line.iterate(max(0, math.ceil(entry * samples) - 1))
        first = next((number for number, gap_m in gaps_m if gap_m is None), None)
        # An obstacle may be thinner than the spacing of samples: take the nearest sample.
        number = line.find_nearest() if first is None else first
        # Without the hulls, which take more memory than the corners.
        line = _Line(ConvexPiece(piece.corners), other, self.by, samples, tolerance_m)
        return Touch(number / samples, partial(line.describe, number))


class _Line:
    """Samples of a straight displacement of a piece, seen from a fixed one.

    Parameters
    ----------
    by
        Displacement [m].
    samples
        Number of equal intervals.
    tolerance_m
        Penetration depth that counts as harmless touching [m], >= 0.
    """

    def __init__(
        self, piece: ConvexPiece, other: ConvexPiece, by: Point, samples: int, tolerance_m: float
    ) -> None:
        self._piece, self._other, self._by = piece, other, by
        self._samples, self._tolerance_m = samples, tolerance_m
        self._step_m = math.hypot(*by) / samples or math.inf
        # Bounds of the distance [m] by sample; None for an overlap by more than the tolerance.
        self._bounds_m: dict[int, float | None] = {}

    def iterate(self, first: int, within_m: float = 0.0) -> Iterator[tuple[int, float | None]]:
        """Yield the samples that may be within a distance; each step moves the piece equally far.

        Yields
        ------
        tuple
            Number, and a lower bound of the distance [m] or None; see `bound_gap`.
        """
        number = first
        while number <= self._samples:
            if number not in self._bounds_m:
                at = coal.Transform3s(np.eye(3), np.array(self._displace(number)))
                self._bounds_m[number] = bound_gap(
                    self._piece.hull, at, self._other.hull, STILL, self._tolerance_m
                )
            gap_m = self._bounds_m[number]
            yield number, gap_m
            far_m = (gap_m or 0.0) - within_m
            number += 1 + max(0, int(far_m / self._step_m))

    def find_nearest(self) -> int:
        """Return the nearest sample if none overlaps by more than the tolerance."""
        known_m = {number: gap_m or 0.0 for number, gap_m in self._bounds_m.items()}
        first = min(known_m, key=lambda number: known_m[number])
        distances_m = {first: self._measure(first).distance_m}
        within_m = max(0.0, distances_m[first])
        for number, gap_m in self.iterate(0, within_m):
            if number != first and (gap_m or 0.0) <= within_m:
                distances_m[number] = self._measure(number).distance_m
        return min(sorted(distances_m), key=lambda number: distances_m[number])

    def describe(self, number: int) -> Nearness:
        """Return the position of a contact at a sample, and its depth on the whole line."""
        whole = measure_distance(self._piece.swept(self._by), self._other)
        return replace(whole, position=self._measure(number).position)

    def _measure(self, number: int) -> Nearness:
        return measure_distance(self._piece, self._other, self._displace(number))

    def _displace(self, number: int) -> list[float]:
        return [number / self._samples * extent for extent in self._by]
