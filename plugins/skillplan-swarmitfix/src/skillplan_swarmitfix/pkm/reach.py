"""Places at which the PKM can hold the head from a position of the mobile base.

The harmonic drive of the base turns the PKM towards the head, so that only the horizontal
distance of the two matters, and the head's turn about the vertical is the wrist's alone.

The mount of the PKM on the base and the height of the sheet are not published; the defaults of
`Mount` are *calibrated*, not measured:

- `tilt_rad` is that of the head against the PKM's base in half of the poses away from parking
  in the machine's own plans (0.762 rad; 0.801 rad in the other half): it makes that head level.
- The sheet's height above the PKM's base is the one with the widest reach at that tilt,
  0.348 m. Under that tilt those poses of the plans lie at 0.30 to 0.35 m.
- `offset_m` puts the middle of the reach on the middle of the 0.333 to 0.451 m between base
  centre and head in the plans. The reach is then 2 mm wider than that on either side.

The limits of the legs are those within which the machine's plans stay; the stricter ones of
one machine's set-up are `SAFE_LIMITS`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan.task.verdict import Verdict
from skillplan_swarmitfix.pkm.kinematics import (
    LEGS,
    OutsideWorkspace,
    PkmGeometry,
    Point3,
    Pose6,
    forward,
    inverse,
    zyz_matrix,
)

Range = tuple[float, float]
Point2 = tuple[float, float]

_STEP_M = 1e-3
_TOLERANCE_M = 1e-9
_SAME_POSE_M = 1e-6
# The middle of the reach of the calibrated machine; only the order of trials depends on it.
_LIKELY_M = 0.39


@dataclass(frozen=True, slots=True)
class PkmLimits:
    """The least and the greatest length of each leg [m].

    The defaults hold every leg of the machine's plans (0.2416 to 0.3209 m), to the millimetre.

    Raises
    ------
    ValueError
        If a range is not finite, starts at or below 0, or ends before it starts.
    """

    leg_a_m: Range = (0.241, 0.322)
    leg_b_m: Range = (0.241, 0.322)
    leg_c_m: Range = (0.241, 0.322)

    def __post_init__(self) -> None:
        for name, (least_m, most_m) in zip(LEGS, self.ranges_m, strict=True):
            if not (0 < least_m <= most_m < math.inf):
                raise ValueError(
                    f"PkmLimits of leg {name} must be finite with 0 < least <= greatest, "
                    f"not {least_m} to {most_m}."
                )

    @property
    def ranges_m(self) -> tuple[Range, Range, Range]:
        """The ranges of the legs A, B, C [m]."""
        return self.leg_a_m, self.leg_b_m, self.leg_c_m


SAFE_LIMITS = PkmLimits(leg_a_m=(0.242, 0.280), leg_b_m=(0.242, 0.287), leg_c_m=(0.242, 0.280))


@dataclass(frozen=True, slots=True)
class Mount:
    """Mount of the PKM on the mobile base, and height of the sheet; calibrated.

    Parameters
    ----------
    tilt_rad
        Outward tilt of the PKM's z axis from the vertical [rad], 0 to less than pi/2.
    offset_m
        From the base's centre outward to the PKM's base frame [m].
    height_m
        Height of the PKM's base frame above the bench [m], >= 0. Nominal: only the sheet's height
        above it counts.
    sheet_m
        Height of the sheet's underside, at the head's origin, above the bench [m];
        greater than `height_m`.

    Raises
    ------
    ValueError
        If a value is out of range or not finite.
    """

    tilt_rad: float = 0.762
    offset_m: float = 0.1464
    height_m: float = 0.5
    sheet_m: float = 0.848

    def __post_init__(self) -> None:
        for item in fields(self):
            if not math.isfinite(value := getattr(self, item.name)):
                raise ValueError(f"Mount {item.name} must be finite, not {value}.")
        if not 0 <= self.tilt_rad < math.pi / 2:
            raise ValueError(f"Mount tilt_rad must be >= 0 and < pi/2, not {self.tilt_rad}.")
        if not 0 <= self.height_m < self.sheet_m:
            raise ValueError(
                f"Mount height_m must be >= 0 and below sheet_m = {self.sheet_m}, "
                f"not {self.height_m}."
            )

    def head_pose(self, distance_m: float, turn_rad: float = 0.0) -> Pose6:
        """Return the pose of a level head under the sheet in the PKM's base frame.

        Parameters
        ----------
        distance_m
            Horizontal distance from the base's centre [m], >= 0.
        turn_rad
            The head's turn about the vertical against the PKM's azimuth [rad].
        """
        level = zyz_matrix(0.0, -self.tilt_rad, 0.0)
        place = np.array([distance_m - self.offset_m, 0.0, self.sheet_m - self.height_m])
        return Pose6.of(level @ place, level @ zyz_matrix(turn_rad, 0.0, 0.0))


def rule(
    geometry: PkmGeometry,
    limits: PkmLimits,
    mount: Mount,
    base_centre_m: tuple[float, float],
    head_m: tuple[float, float],
    head_yaw_rad: float = 0.0,
) -> Verdict:
    """Return whether the PKM can hold the head at a place, and which leg keeps it from there.

    Parameters
    ----------
    geometry, limits, mount
        The PKM.
    base_centre_m, head_m
        Centres of the mobile base and of the head on the bench (x, y) [m].
    head_yaw_rad
        The head's turn about the vertical [rad].

    Returns
    -------
    Verdict
        Feasible, with the evidence `distance_m`, `azimuth_rad`, `legs_m` by name and
        `wrist_rad`. Infeasible with, in addition, the `leg` that is furthest out of its
        limits, its `length_m`, the `limit_m` and the `excess_m` over or short of it, > 0; or
        without legs where no platform pose leads there at all.

    Raises
    ------
    ValueError
        If a coordinate or the yaw is not finite.
    """
    if not all(map(math.isfinite, (*base_centre_m, *head_m, head_yaw_rad))):
        raise ValueError(
            f"Base, head and yaw must be finite, not {base_centre_m}, {head_m}, {head_yaw_rad}."
        )
    along_m, across_m = head_m[0] - base_centre_m[0], head_m[1] - base_centre_m[1]
    distance_m, azimuth_rad = math.hypot(along_m, across_m), math.atan2(across_m, along_m)
    evidence: dict[str, Any] = {"distance_m": distance_m, "azimuth_rad": azimuth_rad}
    try:
        joints = inverse(geometry, mount.head_pose(distance_m, head_yaw_rad - azimuth_rad))
    except OutsideWorkspace as error:
        reason = f"the head is {distance_m:.3f} m from the base's centre: {error}"
        return Verdict.infeasible(reason, evidence=evidence)
    evidence |= {
        "legs_m": dict(zip(LEGS, joints.legs_m, strict=True)),
        "wrist_rad": list(joints.wrist_rad),
    }
    excess_m, leg, length_m, limit_m = _worst(limits, joints.legs_m)
    if excess_m <= 0:
        return Verdict.feasible(evidence=evidence)
    side = "more" if length_m > limit_m else "less"
    return Verdict.infeasible(
        f"leg {leg} must be {length_m:.3f} m long, {_millimetres(excess_m)} {side} than its limit "
        f"of {limit_m:.3f} m",
        evidence=evidence
        | {"leg": leg, "length_m": length_m, "limit_m": limit_m, "excess_m": excess_m},
    )


def hold_fault(
    geometry: PkmGeometry, limits: PkmLimits, mount: Mount, base_centre_m: Point2, head_m: Point2
) -> str:
    """Return why the PKM cannot hold the head at a place; empty if it can.

    Other than `rule`, it solves the joints' constraints for the head's pose and compares.

    Parameters
    ----------
    geometry, limits, mount
        The PKM.
    base_centre_m, head_m
        Centres of base and head on the bench (x, y) [m].
    """
    pose = mount.head_pose(math.dist(base_centre_m, head_m))
    try:
        joints = inverse(geometry, pose)
        excess_m, leg, length_m, limit_m = _worst(limits, joints.legs_m)
        if excess_m > 0:
            return f"leg {leg} is {length_m:.4f} m long, and its limit is {limit_m:.4f} m"
        back = forward(geometry, joints)
    except OutsideWorkspace as error:
        return str(error)
    if not np.allclose(back.position_m, pose.position_m, rtol=0.0, atol=_SAME_POSE_M):
        return "the legs' lengths lead to another pose of the head"
    return ""


def horizontal_reach_m(geometry: PkmGeometry, limits: PkmLimits, mount: Mount) -> Range:
    """Return the least and the greatest distance from base centre to head within the limits [m].

    If the limits leave several intervals, the widest that holds a point of a grid of 1 mm, refined
    by bisection; if none does, one around the distance of least excess.

    Raises
    ------
    ValueError
        If no distance is within the limits.
    """

    def excess_m(distance_m: float) -> float:
        try:
            joints = inverse(geometry, mount.head_pose(distance_m))
        except OutsideWorkspace:
            return math.inf
        return _worst(limits, joints.legs_m)[0]

    steps = math.ceil(max(0.0, _farthest_m(geometry, limits, mount)) / _STEP_M) + 2
    grid_m = [index * _STEP_M for index in range(steps)]
    excesses_m = [excess_m(distance_m) for distance_m in grid_m]
    inside = [index for index, off_m in enumerate(excesses_m) if off_m <= 0]
    if not inside:
        best_m = grid_m[int(np.argmin(excesses_m))]
        near_m = _least_point(excess_m, max(0.0, best_m - _STEP_M), best_m + _STEP_M)
        if excess_m(near_m) > 0:
            raise ValueError(
                f"The PKM cannot hold a level head {mount.sheet_m - mount.height_m:.3f} m above "
                "its base at any distance: its legs' limits and its mount do not fit."
            )
        first_m = last_m = near_m
    else:
        cuts = [0, *(np.flatnonzero(np.diff(inside) > 1) + 1).tolist(), len(inside)]
        runs = [inside[low:high] for low, high in itertools.pairwise(cuts)]
        widest = max(runs, key=len)
        first_m, last_m = grid_m[widest[0]], grid_m[widest[-1]]

    def edge(inside_m: float, outside_m: float) -> float:
        for _ in range(40):
            middle_m = (inside_m + outside_m) / 2
            if excess_m(middle_m) <= 0:
                inside_m = middle_m
            else:
                outside_m = middle_m
        return inside_m

    least_m = edge(first_m, first_m - _STEP_M) if first_m > 0 else 0.0
    return least_m, edge(last_m, last_m + _STEP_M)


def _least_point(function: Callable[[float], float], low: float, high: float) -> float:
    """Find the minimum of a unimodal function between two points by ternary search."""
    for _ in range(60):
        third = (high - low) / 3
        if function(low + third) <= function(high - third):
            high -= third
        else:
            low += third
    return (low + high) / 2


class ReachableCentres:
    """Base centres from which the PKM holds a level head at a point, by inverse kinematics.

    Parameters
    ----------
    geometry, limits, mount
        The PKM.
    centres_m
        Base centres on the bench, shape (n, 2) [m].
    distances_m
        Ranges of the horizontal distance of base and head that are allowed in addition to the
        legs' limits [m], by the key of the task file.
    """

    def __init__(
        self,
        geometry: PkmGeometry,
        limits: PkmLimits,
        mount: Mount,
        centres_m: NDArray[np.float64],
        distances_m: Mapping[str, Range] | None = None,
    ) -> None:
        self._pkm = geometry, limits, mount
        self._centres_m = centres_m
        self._distances_m = distances_m or {}
        self._farthest_m = _farthest_m(geometry, limits, mount)
        self._known: dict[Point2, NDArray[np.intp]] = {}

    def positions(self, head_m: Point2) -> NDArray[np.intp]:
        """Return the numbers of the centres that reach a point, rising."""
        if head_m not in self._known:
            near = self._near(head_m)
            holds = [self.verdict(index, head_m).is_feasible for index in near.tolist()]
            self._known[head_m] = near[np.array(holds, dtype=np.bool_)]
        return self._known[head_m]

    def reach(self, head_m: Point2) -> bool:
        """Return whether any centre reaches a point; the most likely ones are tried first."""
        if head_m in self._known:
            return bool(len(self._known[head_m]))
        near = self._near(head_m)
        away_m = self._away_m(head_m)[near]
        likely = near[np.argsort(np.abs(away_m - _LIKELY_M), kind="stable")]
        return any(self.verdict(index, head_m).is_feasible for index in likely.tolist())

    def verdict(self, index: int, head_m: Point2) -> Verdict:
        """Return the ruling on one centre: on the distance, then on the legs by `rule`."""
        x_m, y_m = self._centres_m[index].tolist()
        away_m = math.dist((x_m, y_m), head_m)
        for key, (least_m, most_m) in self._distances_m.items():
            limit_m = least_m if away_m < least_m else most_m
            excess_m = max(least_m - away_m, away_m - most_m)
            if excess_m > _TOLERANCE_M:
                side = "more" if away_m > limit_m else "less"
                return Verdict.infeasible(
                    f"the head is {away_m:.3f} m away, {_millimetres(excess_m)} {side} than "
                    f"{key} allows, {limit_m:g} m",
                    evidence={"distance_m": away_m, "limit_m": limit_m, "excess_m": excess_m},
                )
        return rule(*self._pkm, (x_m, y_m), head_m)

    def nearest(self, head_m: Point2) -> tuple[int, Verdict]:
        """Return the centre that misses a point by the least excess, and the ruling on it.

        If no centre has a pose of the platform there, it is the nearest centre.
        """
        verdicts = [(index, self.verdict(index, head_m)) for index in self._near(head_m).tolist()]
        posed = [entry for entry in verdicts if "excess_m" in entry[1].evidence]
        if posed:
            return min(posed, key=lambda entry: float(entry[1].evidence["excess_m"]))
        index = int(self._away_m(head_m).argmin())
        return index, self.verdict(index, head_m)

    def _near(self, head_m: Point2) -> NDArray[np.intp]:
        """Return the centres no farther away than the stretched PKM."""
        return np.flatnonzero(self._away_m(head_m) <= self._farthest_m)

    def _away_m(self, head_m: Point2) -> NDArray[np.float64]:
        offsets = self._centres_m - np.array(head_m)
        away_m: NDArray[np.float64] = np.hypot(offsets[:, 0], offsets[:, 1])
        return away_m


def _farthest_m(geometry: PkmGeometry, limits: PkmLimits, mount: Mount) -> float:
    """Return a distance of base and head that the PKM never exceeds [m].

    No arm is longer than leg A stretched, with the wrist behind it.
    """
    far_m = limits.leg_a_m[1] + geometry.wrist_offset_m + geometry.base_half_m
    return mount.offset_m + far_m


def _worst(limits: PkmLimits, legs_m: Point3) -> tuple[float, str, float, float]:
    """Return the excess of the worst leg [m], its name, its length and the limit."""
    faults = [
        (excess_m, name, length_m, limit_m)
        for name, length_m, (least_m, most_m) in zip(LEGS, legs_m, limits.ranges_m, strict=True)
        for excess_m, limit_m in ((length_m - most_m, most_m), (least_m - length_m, least_m))
    ]
    # Legs A and C are equal here but for rounding; then A is named.
    return max(faults, key=lambda fault: round(fault[0], 12))


def _millimetres(length_m: float) -> str:
    return f"{length_m * 1e3:.0f} mm" if length_m >= 1e-3 else f"{length_m * 1e3:.2g} mm"
