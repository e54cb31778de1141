"""What the links of the arm run into: capsules about them, wherever the joints go."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import coal
import numpy as np

from skillplan_pinocchio.arm_model import CAPSULES, ArmModel, Vector
from skillplan_pinocchio.joint_path import JointPath
from skillplan_pinocchio.obstacles import Obstacle
from skillplan_pinocchio.shapes import ConvexPiece, geometry_nearness
from skillplan_pinocchio.sweep import Touch

# Between the nodes of a path a link bulges out by no more than this [m].
_BULGE_M = 0.02
_STILL = coal.Transform3s()


@dataclass(frozen=True)
class LinkTouch:
    """Which link touches something first, and where.

    Parameters
    ----------
    link
        Number of the joint that moves it.
    touch
        Where.
    """

    link: int
    touch: Touch


class LinkSweep:
    """The links of the arm along a path.

    Parameters
    ----------
    arm
        The arm.
    path
        Of its joints.
    """

    def __init__(self, arm: ArmModel, path: JointPath) -> None:
        self.arm = arm
        self.path = path
        self._reach = self._boxes()
        self._sampled: dict[int, list[list[tuple[Vector, Vector]]]] = {}

    def touch(self, obstacle: Obstacle, tolerance_m: float, samples: int) -> LinkTouch | None:
        """Return which link touches an obstacle first, or None.

        Parameters
        ----------
        obstacle
            What may block the motion.
        tolerance_m
            Depth that still counts as touching without harm [m], >= 0.
        samples
            How many equally spaced intervals of the path are checked, >= 1.
        """
        near = [
            (number, piece)
            for number, (low, high) in enumerate(self._reach)
            for piece in obstacle.pieces
            if bool((low < piece.high).all()) and bool((high > piece.low).all())
        ]
        if not near:
            return None
        first: tuple[int, int] | None = None
        found = None
        depth_m = 0.0
        for sample, segments in enumerate(self._segments(samples)):
            for number, piece in near:
                distance_m, position = self._nearness(number, segments[number], piece)
                if distance_m >= -tolerance_m:
                    continue
                depth_m = max(depth_m, -distance_m)
                if first is None:
                    first, found = (sample, number), position
        if first is None or found is None:
            return None
        sample, number = first
        touch = Touch(sample / samples, found, round(depth_m, 6))
        return LinkTouch(CAPSULES[number].link, touch)

    def _nearness(
        self, number: int, segment: tuple[Vector, Vector], piece: ConvexPiece
    ) -> tuple[float, tuple[float, float, float]]:
        start, end = segment
        placement = coal.Transform3s(self._turns(end - start), (start + end) / 2)
        found = geometry_nearness(self._capsules[number], placement, piece.hull, _STILL)
        return found.distance_m, found.position

    @cached_property
    def _capsules(self) -> list[object]:
        return [
            coal.Capsule(
                capsule.radius_m,
                float(np.linalg.norm(np.array(capsule.end) - np.array(capsule.start))),
            )
            for capsule in CAPSULES
        ]

    def _segments(self, samples: int) -> list[list[tuple[Vector, Vector]]]:
        if samples not in self._sampled:
            self._sampled[samples] = [
                self.arm.segments(self.path.at(number / samples)) for number in range(samples + 1)
            ]
        return self._sampled[samples]

    def _boxes(self) -> list[tuple[Vector, Vector]]:
        """Return the boxes in which each link stays [m]."""
        ends = np.array([self.arm.segments(joints) for joints in self.path.nodes])
        return [
            (
                ends[:, number].min(axis=(0, 1)) - capsule.radius_m - _BULGE_M,
                ends[:, number].max(axis=(0, 1)) + capsule.radius_m + _BULGE_M,
            )
            for number, capsule in enumerate(CAPSULES)
        ]

    @staticmethod
    def _turns(along: Vector) -> Vector:
        """Return a rotation that turns z along a vector, shape (3, 3)."""
        z = along / np.linalg.norm(along)
        # Whichever axis is farther from it.
        aside = np.array([1.0, 0.0, 0.0]) if abs(z[0]) < 0.7 else np.array([0.0, 1.0, 0.0])
        x = np.cross(aside, z)
        x /= np.linalg.norm(x)
        return np.column_stack([x, np.cross(z, x), z])
