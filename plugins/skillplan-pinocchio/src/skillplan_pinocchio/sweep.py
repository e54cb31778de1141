"""Collisions of convex pieces along a straight line."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from skillplan.task.motion import Point
from skillplan_pinocchio.shapes import (
    STILL,
    ConvexPiece,
    Nearness,
    Obstacle,
    may_touch,
    measure_distance,
    measure_overlap,
)

# Accuracy of a measured distance [m].
_ACCURACY_M = 1e-5


@dataclass(frozen=True)
class Touch:
    """First contact along a line.

    Parameters
    ----------
    fraction
        Fraction of the line, in [0, 1].
    position
        Position in the world [m].
    penetration_m
        Penetration depth, > 0 [m].
    """

    fraction: float
    position: Point
    penetration_m: float


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

    def touch(self, obstacle: Obstacle, tolerance_m: float, samples: int) -> Touch | None:
        """Return the first contact with an obstacle, or None.

        Parameters
        ----------
        tolerance_m
            Penetration depth that counts as harmless touching [m], >= 0.
        samples
            Number of equal intervals of the line in which the first contact is searched, >= 1.
        """
        pairs = [
            (self._find_entry(piece, other), piece, swept, other)
            for piece, swept in zip(self.pieces, self._swept, strict=True)
            for other in obstacle.pieces
            if may_touch(swept, other, tolerance_m)
        ]
        # The first in the order of the pieces, of contacts at one place.
        chosen: tuple[float, int] = (math.inf, 0)
        first: Touch | None = None
        for order in sorted(range(len(pairs)), key=lambda order: pairs[order][0]):
            entry, piece, swept, other = pairs[order]
            if entry - 1 / samples > chosen[0]:
                break
            touch = self._touch(piece, swept, other, tolerance_m, samples)
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
    ) -> Touch | None:
        whole = measure_overlap(swept.hull, STILL, other.hull, STILL)
        if whole is None or whole.distance_m >= -tolerance_m:
            return None
        depth_m = round(-whole.distance_m, 6)
        known: dict[int, Nearness] = {}
        for number, here in self._sample(piece, other, samples, 0.0, known):
            if here.distance_m < -tolerance_m:
                return Touch(number / samples, here.position, depth_m)
        # An obstacle thinner than the spacing of samples: take the nearest sample.
        nearest_m = max(0.0, min(here.distance_m for here in known.values()))
        number, here = min(
            self._sample(piece, other, samples, nearest_m, known),
            key=lambda sample: sample[1].distance_m,
        )
        return Touch(number / samples, here.position, depth_m)

    def _sample(
        self,
        piece: ConvexPiece,
        other: ConvexPiece,
        samples: int,
        within_m: float,
        known: dict[int, Nearness],
    ) -> Iterator[tuple[int, Nearness]]:
        """Yield the samples that may be so near, as no step is longer than its displacement.

        Parameters
        ----------
        within_m
            Distance [m], >= 0.
        known
            Distances that were measured, by sample.
        """
        step_m = max(math.hypot(*self.by) / samples, _ACCURACY_M)
        number = 0
        while number <= samples:
            if number not in known:
                by = [number / samples * extent for extent in self.by]
                known[number] = measure_distance(piece, other, by)
            yield number, known[number]
            far_m = known[number].distance_m - within_m - _ACCURACY_M
            number += 1 + max(0, int(far_m / step_m))
