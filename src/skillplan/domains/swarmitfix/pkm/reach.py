"""Which places the PKM can hold the head at from where the mobile base stands.

The harmonic drive of the base turns the PKM towards the head, so that only the horizontal
distance of the two matters, and the head's turn about the vertical is the wrist's alone.

How the PKM stands on the base and how high the sheet lies is not published; the defaults of
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

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from skillplan.domains.swarmitfix.pkm.kinematics import LEGS, OutsideWorkspace, PkmGeometry, inverse
from skillplan.domains.swarmitfix.pkm.pose6 import Point3, Pose6, zyz_matrix
from skillplan.task.verdict import Verdict

Range = tuple[float, float]

_STEP_M = 1e-3


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
    """How the PKM stands on the mobile base, and how high the sheet lies; calibrated.

    Parameters
    ----------
    tilt_rad
        How far the PKM's z axis leans outward from the vertical [rad], 0 to less than pi/2.
    offset_m
        From the base's centre outward to the PKM's base frame [m].
    height_m
        Of the PKM's base frame above the bench [m], >= 0. Nominal: only the sheet's height
        above it counts.
    sheet_m
        Of the sheet's underside, where the head's origin comes to lie, above the bench [m];
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


def horizontal_reach_m(geometry: PkmGeometry, limits: PkmLimits, mount: Mount) -> Range:
    """Return the least and the greatest distance from base centre to head within the limits [m].

    Where the limits leave several intervals, the widest; found on a grid of 1 mm and refined
    by bisection, so that a narrower interval may be missed.

    Raises
    ------
    ValueError
        If no distance on the grid is within the limits.
    """

    def within(distance_m: float) -> bool:
        try:
            joints = inverse(geometry, mount.head_pose(distance_m))
        except OutsideWorkspace:
            return False
        return _worst(limits, joints.legs_m)[0] <= 0

    # No longer arm than leg A stretched, with the wrist behind it.
    far_m = limits.leg_a_m[1] + geometry.wrist_offset_m + geometry.base_half_m
    steps = math.ceil(max(0.0, mount.offset_m + far_m) / _STEP_M) + 2
    runs: list[tuple[int, int]] = []
    for index in range(steps):
        if within(index * _STEP_M):
            start = runs.pop()[0] if runs and runs[-1][1] == index - 1 else index
            runs.append((start, index))
    if not runs:
        raise ValueError(
            f"The PKM cannot hold a level head {mount.sheet_m - mount.height_m:.3f} m above its "
            "base at any distance: its legs' limits and its mount do not fit."
        )
    first, last = max(runs, key=lambda run: run[1] - run[0])

    def edge(inside_m: float, outside_m: float) -> float:
        for _ in range(40):
            middle_m = (inside_m + outside_m) / 2
            if within(middle_m):
                inside_m = middle_m
            else:
                outside_m = middle_m
        return inside_m

    least_m = edge(first * _STEP_M, (first - 1) * _STEP_M) if first else 0.0
    return least_m, edge(last * _STEP_M, (last + 1) * _STEP_M)


def _worst(limits: PkmLimits, legs_m: Point3) -> tuple[float, str, float, float]:
    """Return how far the worst leg is out of its limits [m], its name, length and that limit."""
    faults = [
        (excess_m, name, length_m, limit_m)
        for name, length_m, (least_m, most_m) in zip(LEGS, legs_m, limits.ranges_m, strict=True)
        for excess_m, limit_m in ((length_m - most_m, most_m), (least_m - length_m, least_m))
    ]
    # Legs A and C are equal here but for rounding; then A is named.
    return max(faults, key=lambda fault: round(fault[0], 12))


def _millimetres(length_m: float) -> str:
    return f"{length_m * 1e3:.0f} mm" if length_m >= 1e-3 else f"{length_m * 1e3:.2g} mm"
