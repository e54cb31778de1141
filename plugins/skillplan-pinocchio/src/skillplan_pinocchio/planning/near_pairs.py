"""Pairs of solids that may come near each other on a joint path, from spheres and boxes alone.

At sample places, distances between spheres about moving solids and boxes about fixed ones give
lower bounds for all pairs at once. Between two places no point moves farther than its reach times
the joints' turn. If the sum of both distances exceeds that, the pair does not touch in between.
Exact distances are computed only for the remaining stretches.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.planning.arm_bodies import ArmBodies, Numbers, Vector

# Target bound on the motion of a point between two places, and maximum number of cells.
_CELL_M: Final = 0.08
_MOST_CELLS: Final = 64
# Stride of the places in the first pass.
_STRIDE: Final = 4
# Stretches with a smaller gap are joined [m].
_JOINED_M: Final = 1e-3


@dataclass(frozen=True, eq=False)
class NearPair:
    """Two solids that may touch on a path, and the stretches where.

    Parameters
    ----------
    solid
        Number of the moving solid; of two moving ones, the one farther from the base.
    other
        Number of the fixed piece or of the other solid.
    lengths_m
        Bound on the relative motion of a point up to each place, shape (places,).
    stretches_m
        Stretches in which they may touch, in order, by such lengths.
    gap_m
        Lower bound on their distance, >= 0.
    """

    solid: int
    other: int
    lengths_m: list[float]
    stretches_m: tuple[tuple[float, float], ...]
    gap_m: float


class NearPairs:
    """All pairs of solids that may touch on a path.

    Parameters
    ----------
    boxes
        Lower and upper corners of the boxes about fixed pieces [m], each of shape (pieces, 3).
    touching_m
        Distance below which solids count as touching [m], > 0.
    spared
        Pairs with fixed pieces that may touch, shape (solids, pieces); None for none.

    Attributes
    ----------
    places
        Increasing path parameters from 0 to 1 at which lengths are known.
    standing, own
        Pairs with fixed pieces, and pairs of the arm's solids.
    """

    def __init__(
        self,
        bodies: ArmBodies,
        path: JointPath,
        boxes: tuple[Vector, Vector],
        touching_m: float,
        spared: NDArray[np.bool_] | None = None,
    ) -> None:
        slopes = path.steepest_by_interval
        intervals = len(slopes)
        rates_m, own_rates_m = slopes @ bodies.reach_m.T, slopes @ bodies.pair_reach_m.T
        way_m = float(rates_m.max(axis=1, initial=0.0).sum()) / intervals
        cells = max(min(way_m / _CELL_M, _MOST_CELLS), 1)
        each = int(np.ceil(cells / intervals))
        places = np.linspace(0.0, 1.0, intervals * each + 1)
        self.places: list[float] = places.tolist()
        self._bodies = bodies
        self._boxes = boxes
        self._touching_m = touching_m
        self._spared = spared
        self._rotations, self._origins = bodies.frames.at(path.along(places))
        self.standing = self._with_what_stands(_compute_lengths_m(rates_m, each))
        self.own = self._with_itself(_compute_lengths_m(own_rates_m, each))

    def _with_what_stands(self, lengths_m: Vector) -> list[NearPair]:
        bodies, (low, high) = self._bodies, self._boxes
        if not len(low):
            return []
        spheres, count = bodies.spheres, len(self.places)
        some = np.unique(np.r_[0 : count : min(_STRIDE, count - 1), count - 1])
        centres = self._placed(spheres.joints, spheres.centres_m, some)
        gaps_m = _measure_to_boxes_m(centres[:, :, np.newaxis], low, high)
        gaps_m -= spheres.radii_m[:, np.newaxis] + self._touching_m
        moved_m = np.diff(lengths_m[some], axis=0)[:, :, np.newaxis]
        near = (_add_gaps_m(gaps_m) <= moved_m).any(axis=0)
        # The base of the arm is fixed.
        near[: bodies.still] = False
        if self._spared is not None:
            near &= ~self._spared
        solids, pieces = np.nonzero(near)
        if not len(solids):
            return []
        rows, owners, firsts = spheres.balls_of(solids)
        balls = self._placed(spheres.ball_joints, spheres.ball_centres_m)[:, rows]
        gaps_m = _measure_to_boxes_m(balls, low[pieces[owners]], high[pieces[owners]])
        gaps_m -= spheres.ball_radii_m[rows] + self._touching_m
        gaps_m = np.minimum.reduceat(gaps_m, firsts, axis=1)
        chosen = list(zip(pieces.tolist(), solids.tolist(), strict=True))
        return _collect_near_pairs(chosen, gaps_m, lengths_m[:, solids])

    def _with_itself(self, lengths_m: Vector) -> list[NearPair]:
        bodies, spheres = self._bodies, self._bodies.spheres
        if not bodies.pairs:
            return []
        pairs = bodies.pair_numbers
        centres = self._placed(spheres.joints, spheres.centres_m)
        gaps_m = _measure_apart_m(centres[:, pairs[:, 0]], centres[:, pairs[:, 1]])
        gaps_m -= spheres.radii_m[pairs].sum(axis=1) + self._touching_m
        near = np.flatnonzero((_add_gaps_m(gaps_m) <= np.diff(lengths_m, axis=0)).any(axis=0))
        if not len(near):
            return []
        chosen = [bodies.pairs[number] for number in near.tolist()]
        ones, others, firsts = spheres.ball_pairs(chosen)
        balls = self._placed(spheres.ball_joints, spheres.ball_centres_m)
        gaps_m = _measure_apart_m(balls[:, ones], balls[:, others])
        gaps_m -= spheres.ball_radii_m[ones] + spheres.ball_radii_m[others] + self._touching_m
        gaps_m = np.minimum.reduceat(gaps_m, firsts, axis=1)
        return _collect_near_pairs(chosen, gaps_m, lengths_m[:, near])

    def _placed(self, joints: Numbers, points_m: Vector, places: Numbers | None = None) -> Vector:
        """Return positions at places of points fixed to joints, shape (places, points, 3)."""
        rotations, origins = self._rotations, self._origins
        if places is not None:
            rotations, origins = rotations[places], origins[places]
        turned = (rotations[:, joints] @ points_m[:, :, np.newaxis])[..., 0]
        return np.asarray(turned + origins[:, joints])


def _compute_lengths_m(rates_m: Vector, each: int) -> Vector:
    """Return the motion of points up to each place, from rates per interval of `each` cells."""
    steps = np.repeat(rates_m, each, axis=0) / (len(rates_m) * each)
    return np.concatenate([np.zeros((1, rates_m.shape[1])), np.cumsum(steps, axis=0)])


def _measure_to_boxes_m(points: Vector, low: Vector, high: Vector) -> Vector:
    squares: Vector = np.zeros(1)
    for axis in range(3):
        at = points[..., axis]
        away = np.maximum(low[..., axis] - at, at - high[..., axis])
        squares = squares + np.maximum(away, 0.0) ** 2
    return np.asarray(np.sqrt(squares))


def _measure_apart_m(ones: Vector, others: Vector) -> Vector:
    apart = ones - others
    return np.asarray(np.sqrt(apart[..., 0] ** 2 + apart[..., 1] ** 2 + apart[..., 2] ** 2))


def _add_gaps_m(gaps_m: Vector) -> Vector:
    """Return the sum of the gaps at every two neighbouring places; overlaps count as 0."""
    open_m = np.maximum(gaps_m, 0.0)
    return np.asarray(open_m[:-1] + open_m[1:])


def _collect_near_pairs(
    pairs: Sequence[tuple[int, int]], gaps_m: Vector, lengths_m: Vector
) -> list[NearPair]:
    near = []
    uncovered = _add_gaps_m(gaps_m) <= np.diff(lengths_m, axis=0)
    open_m = np.maximum(gaps_m, 0.0)
    begins, ends = lengths_m[:-1] + open_m[:-1], lengths_m[1:] - open_m[1:]
    for column in np.flatnonzero(uncovered.any(axis=0)).tolist():
        stretches: list[tuple[float, float]] = []
        for cell in np.flatnonzero(uncovered[:, column]).tolist():
            begin, end = float(begins[cell, column]), float(ends[cell, column])
            if stretches and begin <= stretches[-1][1] + _JOINED_M:
                begin, end = stretches[-1][0], max(end, stretches[-1][1])
                stretches.pop()
            stretches.append((begin, end))
        near.append(
            NearPair(
                pairs[column][1],
                pairs[column][0],
                lengths_m[:, column].tolist(),
                tuple(stretches),
                float(open_m[:, column].min()),
            )
        )
    return near
