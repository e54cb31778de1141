"""What of an arm and its hand collides, as convex pieces that the simulator takes.

The simulator keeps boxes, capsules and cylinders as they are, and makes hulls larger by a margin;
so the faces between which parts are held are boxes, and the hulls of a hand are made smaller.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from skillplan.robots.arm_description import Hand, Hull, LinkShape

Vector = NDArray[np.float64]

# By so much the simulator makes hulls larger [m].
MARGIN_M = 0.001
# Hulls of a jaw begin so far behind its face, which is a box [m].
_BEHIND_FACE_M = 0.002
# Pieces that are thinner than this are left out [m].
_THINNEST_M = 1e-4


@dataclass(frozen=True, slots=True)
class Block:
    """A box along the axes of a link.

    Parameters
    ----------
    low_m, high_m
        Its corners [m], shape (3,).
    """

    low_m: tuple[float, float, float]
    high_m: tuple[float, float, float]


Piece = LinkShape | Block


def body_pieces(hand: Hand) -> tuple[Piece, ...]:
    """Return the body of a hand, from the tip, z out of the hand."""
    return tuple(
        _shrunk(np.array([(across, along, depth - hand.tip_m) for along, across, depth in piece]))
        for piece in hand.body
    )


def jaw_pieces(hand: Hand, side: int) -> tuple[Piece, ...]:
    """Return a jaw, its end and face at the origin, z out of the hand.

    Parameters
    ----------
    hand
        Whose it is.
    side
        1 for the jaw on the side of the hand's y, -1 for the other.
    """
    low_m, high_m = hand.jaw_m[0][0], hand.jaw_m[-1][0]
    half_m = min(row[1] for row in hand.jaw_m)
    near_m = max(row[2] for row in hand.jaw_m)
    far_m = min(row[3] for row in hand.jaw_m)
    found: list[Piece] = []
    if far_m - near_m > _THINNEST_M:
        found.append(_block((-half_m, near_m, -high_m), (half_m, far_m, -low_m), side))
    for below, above in pairwise(hand.jaw_m):
        if above[0] - below[0] <= 2 * MARGIN_M:
            continue
        corners = [
            (x_m, side * max(y_m, near_m + _BEHIND_FACE_M), -height_m)
            for height_m, width_m, from_m, to_m in (below, above)
            for x_m in (-width_m, width_m)
            for y_m in (from_m, to_m)
        ]
        found.append(_shrunk(np.array(corners)))
    return tuple(found)


def _block(low: Sequence[float], high: Sequence[float], side: int) -> Block:
    ys = sorted((side * low[1], side * high[1]))
    return Block((low[0], ys[0], low[2]), (high[0], ys[1], high[2]))


def _shrunk(corners: Vector) -> Hull:
    """Return the hull of some corners, smaller by the margin along every axis."""
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    away = corners - middle
    inner = middle + np.sign(away) * np.maximum(np.abs(away) - MARGIN_M, 0.0)
    return Hull(tuple((float(x), float(y), float(z)) for x, y, z in inner))
