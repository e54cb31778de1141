"""Which positions serve the path between two supports: Eqs 1 to 4, and the arm's true reach.

Veeramani and Muthuswamy 2022, section 4.1.2, Fig. 4.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan_swarmitfix.bench.bench import Bench
from skillplan_swarmitfix.trajectory.plane_point import Point2, shown

# Of Eq. 3, relative to the quadrilateral: areas are sums of products, and a centroid on its
# border must not depend on how they round.
_AREA_TOLERANCE = 1e-9
_DISTANCE_TOLERANCE_M = 1e-9


@dataclass(frozen=True, slots=True)
class ReachRules:
    """Where a base may stand.

    Parameters
    ----------
    arm_length_m
        l_arm of Eqs 1 and 2, > 0 [m].
    safe_distance_m
        s_d of Eq. 4, least distance of a base and a support, >= 0 [m].
    reach_m
        Least and greatest horizontal distance of base and head that the arm allows [m].
    side
        The side of the trajectory on which bases stand: +1 left of the direction of travel, -1
        right of it.

    Raises
    ------
    ValueError
        If a figure is out of its range or not finite.
    """

    arm_length_m: float
    safe_distance_m: float
    reach_m: tuple[float, float]
    side: int

    def __post_init__(self) -> None:
        if not 0 < self.arm_length_m < math.inf:
            raise ValueError(
                f"ReachRules arm_length_m must be finite and > 0, not {self.arm_length_m}."
            )
        if not 0 <= self.safe_distance_m < math.inf:
            raise ValueError(
                f"ReachRules safe_distance_m must be finite and >= 0, not {self.safe_distance_m}."
            )
        least_m, most_m = self.reach_m
        if not 0 <= least_m < most_m < math.inf:
            raise ValueError(
                f"ReachRules reach_m must be finite and rise from 0, not {least_m, most_m}."
            )
        if self.side not in (1, -1):
            raise ValueError(f"ReachRules side must be 1 or -1, not {self.side}.")


def inward_side(clockwise: bool) -> int:
    """Return the side on which the inside of a closed trajectory is: -1, right, if clockwise."""
    return -1 if clockwise else 1


def quadrilateral(e1: Point2, e2: Point2, arm_length_m: float, side: int) -> NDArray[np.float64]:
    """Return the corners e1, e2, e3, e4 of Eqs 1 and 2, shape (4, 2) [m].

    The paper's beta is taken to be the direction from e1 to e2, turned a right angle to the side
    of the bases: for a closed trajectory the inward normal.

    Raises
    ------
    ValueError
        If e1 and e2 are one point.
    """
    if e1 == e2:
        raise ValueError(f"No direction leads from {shown(e1)} to itself.")
    beta = math.atan2(e2[1] - e1[1], e2[0] - e1[0]) + side * math.pi / 2
    out = (arm_length_m * math.cos(beta), arm_length_m * math.sin(beta))
    e3 = (e2[0] + out[0], e2[1] + out[1])
    e4 = (e1[0] + out[0], e1[1] + out[1])
    return np.array([e1, e2, e3, e4])


def candidates(bench: Bench, e1: Point2, e2: Point2, rules: ReachRules) -> tuple[int, ...]:
    """Return the positions that Eqs 3 and 4 allow, rising.

    The areas of the triangles that a centroid makes with the four sides sum to the area of the
    quadrilateral if it lies inside or on the border, and to more elsewhere.

    Raises
    ------
    ValueError
        If e1 and e2 are one point.
    """
    safe = _safe_from(bench, e1, rules) & _safe_from(bench, e2, rules)
    return _positions(_inside(bench, e1, e2, rules) & safe)


def _inside(bench: Bench, e1: Point2, e2: Point2, rules: ReachRules) -> NDArray[np.bool_]:
    """Return the positions that Eq. 3 allows, shape (positions,)."""
    corners = quadrilateral(e1, e2, rules.arm_length_m, rules.side)
    points = bench.centroids_m
    sides = np.roll(corners, -1, axis=0) - corners
    from_corners = points[:, None] - corners
    triangles: NDArray[np.float64] = np.abs(_cross(sides, from_corners)).sum(axis=1) / 2
    area = abs(float(_cross(sides[0], sides[1])))
    inside: NDArray[np.bool_] = triangles <= area * (1 + _AREA_TOLERANCE)
    return inside


def _safe_from(bench: Bench, support: Point2, rules: ReachRules) -> NDArray[np.bool_]:
    """Return the positions that Eq. 4 allows for one support, shape (positions,)."""
    safe: NDArray[np.bool_] = (
        distances_m(bench, support) >= rules.safe_distance_m - _DISTANCE_TOLERANCE_M
    )
    return safe


EQ3, SIDE, EQ4_NEXT = "Eq. 3", "side", "Eq. 4 of the next support"
"""Rules that a position within the machine's reach may break."""


def broken_rules(
    bench: Bench, e1: Point2, e2: Point2, rules: ReachRules, *, last: bool = False
) -> dict[str, NDArray[np.bool_]]:
    """Return the positions that break each rule, shape (positions,) each.

    Parameters
    ----------
    bench
        The lattice.
    e1, e2
        The support that is held and the next one [m]. If `last`, the one before and the last
        support, which is held and has no next one.
    rules
        Rules of the file.
    last
        Whether `e2` is held.
    """
    everywhere = np.ones(bench.n_positions, dtype=np.bool_)
    return {
        EQ3: everywhere if e1 == e2 else ~_inside(bench, e1, e2, rules),
        SIDE: ~_on_side(bench, e1, e2, rules),
        EQ4_NEXT: ~everywhere if last else ~_safe_from(bench, e2, rules),
    }


def within_reach(bench: Bench, e1: Point2, e2: Point2, rules: ReachRules) -> tuple[int, ...]:
    """Return the positions from which the arm truly reaches both supports, rising.

    The base turns the arm to any side, so that only the distance counts. Positions on the side of
    the bases are preferred: others are returned only where there are none of those.
    """
    found = _reaching(bench, e1, e2, rules)
    preferred = found & _on_side(bench, e1, e2, rules)
    return _positions(preferred if preferred.any() else found)


def on_the_other_side(
    bench: Bench, e1: Point2, e2: Point2, rules: ReachRules, positions: Sequence[int]
) -> bool:
    """Whether all of some positions lie beyond the trajectory, where bases are not meant to be.

    Parameters
    ----------
    bench
        The lattice.
    e1, e2
        Two consecutive supports [m].
    rules
        With the side of the trajectory on which bases stand.
    positions
        Their numbers.
    """
    return not _on_side(bench, e1, e2, rules)[list(positions)].any()


def _reaching(bench: Bench, e1: Point2, e2: Point2, rules: ReachRules) -> NDArray[np.bool_]:
    found = np.ones(bench.n_positions, dtype=np.bool_)
    for point in (e1, e2):
        found &= in_reach(distances_m(bench, point), rules)
    return found


def _on_side(bench: Bench, e1: Point2, e2: Point2, rules: ReachRules) -> NDArray[np.bool_]:
    normal = (-(e2[1] - e1[1]) * rules.side, (e2[0] - e1[0]) * rules.side)
    side: NDArray[np.bool_] = (bench.centroids_m - np.array(e1)) @ np.array(normal) >= 0
    return side


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    product: NDArray[np.float64] = a[..., 0] * b[..., 1]
    product -= a[..., 1] * b[..., 0]
    return product


def distances_m(bench: Bench, point: Point2) -> NDArray[np.float64]:
    """Return how far the centroid of every position is from a point, shape (positions,) [m]."""
    offsets = bench.centroids_m - np.array(point)
    away_m: NDArray[np.float64] = np.hypot(offsets[:, 0], offsets[:, 1])
    return away_m


def in_reach(away_m: NDArray[np.float64], rules: ReachRules) -> NDArray[np.bool_]:
    """Return which distances [m] the arm truly reaches, shape as given."""
    least_m, most_m = rules.reach_m
    near = away_m <= most_m + _DISTANCE_TOLERANCE_M
    return near & (away_m >= least_m - _DISTANCE_TOLERANCE_M)


def _positions(mask: NDArray[np.bool_]) -> tuple[int, ...]:
    return tuple(np.flatnonzero(mask).tolist())
