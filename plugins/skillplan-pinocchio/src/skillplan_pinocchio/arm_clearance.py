"""What the links of the arm run into: the shapes about them, wherever the joints go."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import coal
import numpy as np

from skillplan_pinocchio.arm_model import ArmModel, Vector
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.link_pieces import LinkPiece
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


@dataclass(frozen=True)
class _Places:
    """Where links are in some postures.

    Parameters
    ----------
    rotations, origins
        Of the joints' frames, shapes (postures, joints, 3, 3) and (postures, joints, 3) [m].
    low, high
        Corners of the upright boxes about the pieces, shape (postures, pieces, 3) [m].
    """

    rotations: Vector
    origins: Vector
    low: Vector
    high: Vector


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
        self._sampled: dict[int, _Places] = {}

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
        lows, highs = self._reach
        near = [
            (number, piece)
            for piece in obstacle.pieces
            for number in np.flatnonzero(_overlap(lows, highs, piece, 0.0)).tolist()
        ]
        if not near:
            return None
        places = self._at(samples)
        first: tuple[int, int] | None = None
        found = None
        depth_m = 0.0
        for number, piece in near:
            low, high = places.low[:, number], places.high[:, number]
            for sample in np.flatnonzero(_overlap(low, high, piece, tolerance_m)).tolist():
                distance_m, position = self._nearness(places, sample, number, piece)
                if distance_m >= -tolerance_m:
                    continue
                depth_m = max(depth_m, -distance_m)
                if first is None or (sample, number) < first:
                    first, found = (sample, number), position
        if first is None or found is None:
            return None
        sample, number = first
        touch = Touch(sample / samples, found, round(depth_m, 6))
        return LinkTouch(self._pieces[number].link, touch)

    @property
    def _pieces(self) -> tuple[LinkPiece, ...]:
        return self.arm.pieces

    def _nearness(
        self, places: _Places, sample: int, number: int, piece: ConvexPiece
    ) -> tuple[float, tuple[float, float, float]]:
        of_link = self._pieces[number]
        rotation = places.rotations[sample, of_link.link - 1]
        origin = places.origins[sample, of_link.link - 1]
        frame = of_link.frame
        placement = coal.Transform3s(
            rotation @ frame.rotation, rotation @ frame.translation + origin
        )
        found = geometry_nearness(of_link.geometry, placement, piece.hull, _STILL)
        return found.distance_m, found.position

    def _at(self, samples: int) -> _Places:
        if samples not in self._sampled:
            postures = [self.path.at(number / samples) for number in range(samples + 1)]
            self._sampled[samples] = self._placed(postures)
        return self._sampled[samples]

    @cached_property
    def _reach(self) -> tuple[Vector, Vector]:
        """The boxes in which each link stays [m], shapes (pieces, 3)."""
        places = self._placed(list(self.path.nodes))
        return places.low.min(axis=0) - _BULGE_M, places.high.max(axis=0) + _BULGE_M

    def _placed(self, postures: list[Vector]) -> _Places:
        rotations, origins = self.arm.frames(postures)
        joints, centres, halves = self.arm.boxes
        turned = rotations[:, joints]
        middle = np.einsum("spij,pj->spi", turned, centres) + origins[:, joints]
        reach = np.einsum("spij,pj->spi", np.abs(turned), halves)
        return _Places(rotations, origins, middle - reach, middle + reach)


def _overlap(low: Vector, high: Vector, piece: ConvexPiece, tolerance_m: float) -> Vector:
    """Return which boxes overlap the box about a piece by more than the tolerance."""
    inside = (low + tolerance_m < np.array(piece.high)) & (high - tolerance_m > np.array(piece.low))
    return np.asarray(inside.all(axis=1))
