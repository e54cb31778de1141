"""Joint angles for any pose of any serial arm, by damped least squares from several starts."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from skillplan.robots.link_frames import follow
from skillplan_pinocchio.kinematics.fixed_order import dot, length, solve_linear, times
from skillplan_pinocchio.kinematics.serial_arm import SerialArm, Vector

# Accuracy of a solution in position [m] and rotation [rad].
ACCURACY: Final = 1e-8

# Number of postures from which starts are chosen, and number of starts tried.
_SAMPLES = 1024
_STARTS = 64
_MOST_ITERATIONS = 40
# A start is given up if this many iterations do not reduce the error by this factor.
_PATIENCE = 4
_GAIN = 0.7
_MOST_STEP_RAD = 0.6
_DAMPING = 0.1
# Postures that differ by less are the same [rad].
_SAME_RAD = 0.2
# Weight of a radian relative to a metre when starts are compared [m].
_RADIAN_M = 0.3


@dataclass(frozen=True, slots=True)
class Unreached:
    """No posture was found for a pose; distance to the nearest one found.

    Parameters
    ----------
    distance_m
        Distance from the pose [m].
    angle_rad
        Angle from its rotation [rad].
    """

    distance_m: float
    angle_rad: float

    @property
    def reason(self) -> str:
        """The reason as one clause."""
        return (
            "no posture within the joints' limits was found; the nearest one is "
            f"{1e3 * self.distance_m:.3g} mm and {self.angle_rad:.3g} rad away"
        )


class NumericInverse:
    """Joint angles for poses of an arm.

    Results do not depend on earlier calls.

    Parameters
    ----------
    arm
        Arm with any number of joints; fewer than six reach few poses.

    Examples
    --------
    >>> from skillplan.robots.catalogue import PANDA
    >>> arm = SerialArm(PANDA)
    >>> joints_rad = NumericInverse(arm).solve(arm.tip(arm.home_rad))
    >>> bool(np.abs(arm.error(joints_rad, arm.tip(arm.home_rad))[0]).max() < 1e-6)
    True
    """

    def __init__(self, arm: SerialArm) -> None:
        self.arm = arm
        low, high = arm.low_rad, arm.high_rad
        # Angles beyond one turn give no other poses; strokes do.
        turns = [math.inf if joint.is_prismatic else math.pi for joint in arm.description.joints]
        half = np.minimum((high - low) / 2, turns)
        middle = (low + high) / 2
        self._starts = follow(
            arm.description, middle + half * (2 * _even_points(_SAMPLES, len(low)) - 1)
        )
        self._features = np.array([_feature(arm.tip(start)) for start in self._starts])

    def solve(self, target: Any, near: Vector | None = None) -> Vector | Unreached:
        """Return joint angles for a pose.

        Parameters
        ----------
        target
            Target pose of the tip in the world, as `pinocchio.SE3`.
        near
            Posture tried first as a start [rad], shape (joints,); clipped to the limits.

        Returns
        -------
        Vector or Unreached
            Joint angles [rad] within their limits, shape (joints,), with the tip within 1e-8 m and
            1e-8 rad of the pose; or the nearest miss, which does not prove that there are none.

        Raises
        ------
        ValueError
            If the pose is not finite.
        """
        feature = _feature(target)
        if not np.isfinite(feature).all():
            raise ValueError(f"Pose must be finite, not {target}.")
        nearest = (math.inf, math.inf)
        if near is not None:
            start = np.clip(near, self.arm.low_rad, self.arm.high_rad)
            joints, twist = self._descend(start, target)
            if joints is not None:
                return joints
            nearest = _size(twist)
        for index in self._nearest_first(feature)[:_STARTS]:
            joints, twist = self._descend(self._starts[index], target)
            if joints is not None:
                return joints
            nearest = min(nearest, _size(twist))
        return Unreached(*nearest)

    def several(self, target: Any, most: int, tries: int = _STARTS) -> list[Vector]:
        """Return distinct joint angles for a pose, in the order of the starts.

        Parameters
        ----------
        target
            Target pose of the tip in the world, as `pinocchio.SE3`.
        most
            Number of postures after which the search stops, >= 1.
        tries
            Maximum number of starts, >= 1.

        Returns
        -------
        list of Vector
            Postures as from `solve`; empty if none were found.
        """
        postures: list[Vector] = []
        for index in self._nearest_first(_feature(target))[:tries]:
            joints, _ = self._descend(self._starts[index], target)
            if joints is None or any(
                np.abs(joints - posture).max() < _SAME_RAD for posture in postures
            ):
                continue
            postures.append(joints)
            if len(postures) == most:
                break
        return postures

    def _nearest_first(self, feature: Vector) -> NDArray[np.intp]:
        """Return the numbers of the starts, sorted by distance of their tips from a pose."""
        away = self._features - feature
        return np.argsort(np.einsum("ij,ij->i", away, away), kind="stable")

    def solve_from(self, start: Vector, target: Any) -> Vector | None:
        """Return the joint angles that one start leads to, or None.

        Parameters
        ----------
        start
            Posture [rad], shape (joints,); clipped to the limits.
        target
            Target pose of the tip in the world, as `pinocchio.SE3`.
        """
        return self._descend(np.clip(start, self.arm.low_rad, self.arm.high_rad), target)[0]

    def _descend(self, start: Vector, target: Any) -> tuple[Vector | None, Vector]:
        """Return the joint angles that a start leads to, if any, and the remaining error."""
        low, high = self.arm.low_rad, self.arm.high_rad
        joints = start
        best, waited = math.inf, 0
        for _ in range(_MOST_ITERATIONS):
            twist, jacobian = self.arm.error(joints, target)
            square = dot(twist, twist)
            if square < ACCURACY**2:
                return joints, twist
            if square < _GAIN * best:
                best, waited = square, 0
            else:
                waited += 1
                if waited > _PATIENCE:
                    break
            step = self._step(jacobian, twist, square)
            moved = joints + step
            stuck = (moved < low) | (moved > high)
            if stuck.any():
                # A joint that would leave its limits stays at them; the others compensate.
                held = np.where(stuck, np.clip(moved, low, high) - joints, 0.0)
                free = jacobian * ~stuck
                step = held + self._step(free, twist - times(jacobian, held), square)
                moved = np.minimum(np.maximum(joints + step, low), high)
            joints = moved
        return None, twist

    def _step(self, jacobian: Vector, twist: Vector, square: float) -> Vector:
        """Return the joint step [rad], with less damping near the solution (Sugihara 2011)."""
        coupling = self.arm.coupling
        if coupling is not None:
            jacobian = times(jacobian, coupling)
        rows, joints = jacobian.shape
        if joints < rows:
            # The smaller system: the other one is singular for arms with missing joints.
            inner = times(jacobian.T, jacobian)
            inner.flat[:: joints + 1] += _DAMPING * square + 1e-12
            step = solve_linear(inner, times(jacobian.T, twist))
        else:
            inner = times(jacobian, jacobian.T)
            inner.flat[:: rows + 1] += _DAMPING * square + 1e-12
            step = times(jacobian.T, solve_linear(inner, twist))
        if coupling is not None:
            step = times(coupling, step)
        size = float(np.abs(step).max())
        return step if size <= _MOST_STEP_RAD else step * (_MOST_STEP_RAD / size)


def _feature(pose: Any) -> Vector:
    """Return coordinates whose distances compare poses."""
    return np.concatenate([pose.translation, _RADIAN_M * pose.rotation.ravel()])


def _size(twist: Vector) -> tuple[float, float]:
    return length(twist[:3]), length(twist[3:])


def _even_points(count: int, dimensions: int) -> Vector:
    """Return points that fill the unit cube evenly, shape (count, dimensions) (Roberts 2018)."""
    # Root of x^(d + 1) = x + 1, by fixed-point iteration.
    root = 2.0
    for _ in range(64):
        root = (1 + root) ** (1 / (dimensions + 1))
    shares = np.array([root ** -(number + 1) for number in range(dimensions)])
    return np.asarray((0.5 + np.outer(np.arange(1, count + 1), shares)) % 1.0)
