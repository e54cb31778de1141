"""What convex pieces run into along a straight line, and where first."""

from __future__ import annotations

import math
from dataclasses import dataclass

from skillplan.task.motion import Point
from skillplan_pinocchio.shapes import ConvexPiece, Obstacle, may_touch, nearness


@dataclass(frozen=True)
class Touch:
    """Where something is touched first.

    Parameters
    ----------
    fraction
        Of the line, in [0, 1].
    position
        In the world [m].
    penetration_m
        How deep the line leads into it, > 0 [m].
    """

    fraction: float
    position: Point
    penetration_m: float


class Sweep:
    """A straight displacement of some pieces.

    What a convex piece sweeps along a straight line is the hull of its two ends, so that nothing is
    missed between samples; samples only say where it is touched first.

    Parameters
    ----------
    label
        When, in words: ``the approach``.
    mover
        What moves, in words.
    pieces
        Where they start.
    by
        The displacement [m].
    spares
        Bodies that may be touched.
    """

    def __init__(
        self,
        label: str,
        mover: str,
        pieces: tuple[ConvexPiece, ...],
        by: Point,
        spares: frozenset[str],
    ) -> None:
        self.label = label
        self.mover = mover
        self.pieces = pieces
        self.by = by
        self.spares = spares
        self._swept = tuple(piece.swept(by) for piece in pieces)

    def touch(self, obstacle: Obstacle, tolerance_m: float, samples: int) -> Touch | None:
        """Return where an obstacle is touched first, or None.

        Parameters
        ----------
        obstacle
            What may block the motion.
        tolerance_m
            Depth that still counts as touching without harm [m], >= 0.
        samples
            How many equally spaced intervals of the line the first is searched at, >= 1.
        """
        found = [
            touch
            for piece, swept in zip(self.pieces, self._swept, strict=True)
            for other in obstacle.pieces
            if may_touch(swept, other, tolerance_m)
            and (touch := self._touch(piece, swept, other, tolerance_m, samples)) is not None
        ]
        return min(found, key=lambda touch: touch.fraction, default=None)

    def _touch(
        self,
        piece: ConvexPiece,
        swept: ConvexPiece,
        other: ConvexPiece,
        tolerance_m: float,
        samples: int,
    ) -> Touch | None:
        whole = nearness(swept, other)
        if whole.distance_m >= -tolerance_m:
            return None
        depth_m = round(-whole.distance_m, 6)
        nearest, nearest_m = Touch(0.0, whole.position, depth_m), math.inf
        for number in range(samples + 1):
            fraction = number / samples
            here = nearness(piece, other, [fraction * step for step in self.by])
            if here.distance_m < nearest_m:
                nearest, nearest_m = Touch(fraction, here.position, depth_m), here.distance_m
            if here.distance_m < -tolerance_m:
                return nearest
        # What is thinner than the distance between two samples: the nearer of them.
        return nearest
