"""All joint angles for a pose of an arm of Universal Robots' family, in closed form.

Such an arm has a vertical first joint, then three parallel ones, then two more, each at a right
angle to the previous one. The rotation of the flange gives, up to signs, the last two joints and
the sum of the parallel ones; upper arm and forearm then form a triangle (Hawkins 2013, "Analytic
Inverse Kinematics for the Universal Robots UR-5/UR-10 Arms").

Angles come from two sides of a triangle instead of a cosine, which would lose digits if the arm is
nearly stretched or its last joint nearly parallel.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from skillplan.robots.arm_description import ArmDescription, Transform
from skillplan_pinocchio.kinematics.serial_arm import SerialArm, Vector

# Angles this near to 0 or half a turn are rounded to it [rad]; a cosine cannot resolve them.
_SAME_RAD: Final = 1e-7
# Up to this sine the fourth and sixth axes coincide.
_PARALLEL: Final = 1e-10
# Tolerance of a cosine beyond 1, for an arm stretched exactly.
_ROUNDING: Final = 1e-12
# Excess of the elbow's cosine of a stretched arm: where the wrist is nearly parallel, its angles
# are rounded more. It is less than a nanometre at the tip.
_STRETCHED: Final = 1e-9


@dataclass(frozen=True, slots=True)
class UrLengths:
    """Standard Denavit-Hartenberg parameters in which arms of the family differ.

    Parameters
    ----------
    d1_m
        Height of the second joint [m].
    a2_m, a3_m
        Lengths of upper arm and forearm, negative by the manufacturer's convention [m].
    d4_m, d5_m, d6_m
        Offsets of the wrist [m].
    """

    d1_m: float
    a2_m: float
    a3_m: float
    d4_m: float
    d5_m: float
    d6_m: float

    @classmethod
    def of(cls, description: ArmDescription) -> UrLengths | None:
        """Return the lengths of an arm, or None if it is not of the family."""
        if len(description.joints) != 6:
            return None
        ends = [joint.placement for joint in description.joints[1:]] + [description.tip]
        lengths = cls(
            ends[0].xyz_m[2],
            ends[1].xyz_m[0],
            ends[2].xyz_m[0],
            ends[3].xyz_m[2],
            ends[4].xyz_m[2],
            ends[5].xyz_m[2],
        )
        upright = all(
            joint.axis == (0.0, 0.0, 1.0) and not joint.is_prismatic for joint in description.joints
        )
        placed = (description.joints[0].placement, *ends)
        # If one of these is zero, some joints turn freely.
        whole = all((lengths.a2_m, lengths.a3_m, lengths.d4_m))
        return lengths if whole and upright and placed == lengths.placements() else None

    def placements(self) -> tuple[Transform, ...]:
        """Return the poses of the six joints and the tip, each in the previous frame."""
        right = math.pi / 2
        return (
            Transform(),
            Transform.from_standard_dh(0.0, self.d1_m, right),
            Transform.from_standard_dh(self.a2_m, 0.0, 0.0),
            Transform.from_standard_dh(self.a3_m, 0.0, 0.0),
            Transform.from_standard_dh(0.0, self.d4_m, right),
            Transform.from_standard_dh(0.0, self.d5_m, -right),
            Transform.from_standard_dh(0.0, self.d6_m, 0.0),
        )


class UrInverse:
    """All joint angles for poses of an arm of the family.

    Parameters
    ----------
    arm
        Arm of the family, with any lengths.

    Raises
    ------
    ValueError
        If the arm is not of the family.

    Examples
    --------
    >>> from skillplan.robots.catalogue import UR5E
    >>> arm = SerialArm(UR5E)
    >>> len(UrInverse(arm).solve(arm.tip(np.array([0.3, -1.2, 1.4, -1.7, -1.5, 0.2]))))
    8
    """

    def __init__(self, arm: SerialArm) -> None:
        lengths = UrLengths.of(arm.description)
        if lengths is None:
            raise ValueError(
                f"{arm.description.name} is not built like the arms of Universal Robots: "
                "use NumericInverse."
            )
        self.arm = arm
        self._lengths = lengths
        self._from_world = arm.base.inverse()
        self._from_tip = arm.flange_to_tip.inverse()
        self._limits = tuple(zip(arm.description.low_rad, arm.description.high_rad, strict=True))

    def solve(self, target: Any) -> list[Vector]:
        """Return all joint angles for a pose.

        Parameters
        ----------
        target
            Target pose of the tip in the world, as `pinocchio.SE3`.

        Returns
        -------
        list of Vector
            Up to eight postures [rad], each of shape (6,), within the limits, each joint at its
            full turn nearest to 0. The side of the elbow changes first, then the wrist's, then the
            shoulder's. If the fourth and sixth axes coincide, postures exist at many angles of the
            sixth joint: the list holds the ones at 0 or else the ones with the wrist nearest to the
            shoulder, or farthest.

        Raises
        ------
        ValueError
            If the pose is not finite.
        """
        flange = self._from_world * target * self._from_tip
        if not np.isfinite(flange.homogeneous).all():
            raise ValueError(f"Pose must be finite, not {target}.")
        postures = []
        for angles in self._branches(flange.translation.tolist(), flange.rotation.tolist()):
            turned = [
                _find_turn(angle, low, high)
                for angle, (low, high) in zip(angles, self._limits, strict=True)
            ]
            if None not in turned:
                postures.append(np.array(turned, dtype=float))
        return postures

    def _branches(
        self, position: list[float], rotation: list[list[float]]
    ) -> Iterator[tuple[float, ...]]:
        """Yield the joint angles for all sides of shoulder, wrist and elbow [rad]."""
        lengths = self._lengths
        wx, wy, wz = (position[row] - lengths.d6_m * rotation[row][2] for row in range(3))
        for shoulder in _find_shoulders(wx, wy, lengths.d4_m):
            # Frame after the first joint: along the plane of the arm, up, and across.
            cos, sin = math.cos(shoulder), math.sin(shoulder)
            turned = _Turned(
                [cos * rotation[0][n] + sin * rotation[1][n] for n in range(3)],
                rotation[2],
                [sin * rotation[0][n] - cos * rotation[1][n] for n in range(3)],
            )
            wrist = (cos * wx + sin * wy, wz - lengths.d1_m)
            sides = turned.parallel(wrist) if turned.is_parallel else turned.sides()
            for total, wrist_2, wrist_3 in sides:
                pairs = self._triangle(wrist, total)
                for lift, elbow in pairs:
                    yield shoulder, lift, elbow, total - lift - elbow, wrist_2, wrist_3
                if pairs and turned.is_parallel:
                    break

    def _triangle(self, wrist: tuple[float, float], total: float) -> list[tuple[float, float]]:
        """Return the second and third joint for a wrist and the sum of the parallel joints."""
        a2, a3, d5 = self._lengths.a2_m, self._lengths.a3_m, self._lengths.d5_m
        u, v = wrist[0] - d5 * math.sin(total), wrist[1] + d5 * math.cos(total)
        cosine = (u * u + v * v - a2 * a2 - a3 * a3) / (2 * a2 * a3)
        if abs(cosine) > 1 + _STRETCHED:
            return []
        pairs = []
        for elbow in _both_signs(cosine):
            inner = math.atan2(a3 * math.sin(elbow), a2 + a3 * math.cos(elbow))
            pairs.append((math.atan2(v, u) - inner, elbow))
        return pairs


class _Turned:
    """Rotation of the flange in the frame after the first joint, by rows."""

    def __init__(self, along: list[float], up: list[float], across: list[float]) -> None:
        self._along, self._up, self._across = along, up, across
        self._sine = math.hypot(across[0], across[1])

    @property
    def is_parallel(self) -> bool:
        """Return whether the fourth and sixth axes coincide."""
        return self._sine <= _PARALLEL

    def sides(self) -> Iterator[tuple[float, float, float]]:
        """Yield the sum of joints two to four, and joints five and six, for both sides."""
        along, up, across = self._along, self._up, self._across
        for side in (1.0, -1.0):
            wrist_2 = math.atan2(side * self._sine, across[2])
            wrist_3 = math.atan2(-side * across[1], side * across[0])
            c5, s5 = math.cos(wrist_2), math.sin(wrist_2)
            c6, s6 = math.cos(wrist_3), math.sin(wrist_3)
            cos_sum = c5 * (along[0] * c6 - along[1] * s6) - s5 * along[2]
            sin_sum = c5 * (up[0] * c6 - up[1] * s6) - s5 * up[2]
            yield math.atan2(sin_sum, cos_sum), wrist_2, wrist_3

    def parallel(self, wrist: tuple[float, float]) -> Iterator[tuple[float, float, float]]:
        """Yield the same for coinciding axes: at 0, then with the wrist near and far.

        If the arm is stretched or folded completely, only the last two may exist.
        """
        turn = math.atan2(self._up[0], self._along[0])
        flipped = self._across[2] < 0
        bearing = math.atan2(wrist[1], wrist[0])
        at_zero = turn - math.pi if flipped else turn
        for total in (at_zero, bearing + math.pi / 2, bearing - math.pi / 2):
            rest = math.pi + total - turn if flipped else turn - total
            yield total, math.pi if flipped else 0.0, rest


def _find_shoulders(wx: float, wy: float, d4_m: float) -> tuple[float, ...]:
    """Return the first joint's angles [rad] that put the wrist at its offset from the plane."""
    away = math.hypot(wx, wy)
    if away < abs(d4_m) * (1 - _ROUNDING) or away == 0.0:
        return ()
    bearing = math.atan2(wy, wx) + math.pi / 2
    return tuple(bearing + swing for swing in _both_signs(d4_m / away))


def _both_signs(cosine: float) -> tuple[float, ...]:
    """Return the angles with a cosine [rad]; one angle if both agree up to rounding."""
    angle = math.acos(max(-1.0, min(1.0, cosine)))
    if angle < _SAME_RAD:
        return (0.0,)
    if math.pi - angle < _SAME_RAD:
        return (math.pi,)
    return (angle, -angle)


def _find_turn(angle_rad: float, low_rad: float, high_rad: float) -> float | None:
    """Return the full turn of an angle nearest to 0 within limits, or None."""
    turn = 2 * math.pi
    nearest = math.remainder(angle_rad, turn)
    if nearest < low_rad:
        nearest += turn * math.ceil((low_rad - nearest) / turn)
    elif nearest > high_rad:
        nearest -= turn * math.ceil((nearest - high_rad) / turn)
    return nearest if low_rad <= nearest <= high_rad else None
