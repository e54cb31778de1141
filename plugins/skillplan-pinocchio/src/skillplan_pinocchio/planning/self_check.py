"""Where an arm runs into itself or its base, alone or with what it holds, on a stroke."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from skillplan_pinocchio.arm_model import ArmModel
from skillplan_pinocchio.kinematics.fixed_order import times
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.planning.arm_bodies import ArmBodies
from skillplan_pinocchio.planning.continuous_check import LEAST_CLEARANCE_M, ContinuousCheck, Hit
from skillplan_pinocchio.planning.moving_solids import (
    Vector,
    arm_solids,
    balls_of_box,
    held_solid,
)
from skillplan_pinocchio.shapes import ConvexPiece

Held = Sequence[tuple[str, tuple[ConvexPiece, ...]]]
"""What is at the end of the arm: names, and pieces in the world."""

# By so many decimals corners of what is held are told apart [m].
_DECIMALS: Final = 6
_Key = tuple[str, bytes]


@dataclass(frozen=True, eq=False)
class _End:
    """A piece at the end of the arm.

    Parameters
    ----------
    name
        Of what it is part of.
    piece
        In the world.
    back
        From the world into the frame of the last joint.
    """

    name: str
    piece: ConvexPiece
    back: Any

    @cached_property
    def corners(self) -> Vector:
        """In the frame of the last joint [m], shape (corners, 3)."""
        return np.asarray(times(self.piece.corners, self.back.rotation.T) + self.back.translation)

    @property
    def balls(self) -> tuple[Vector, float]:
        """Centres of spheres that it lies within, in the frame of the last joint; radius [m]."""
        low, high = self.corners.min(axis=0), self.corners.max(axis=0)
        return balls_of_box((low + high) / 2, (high - low) / 2)

    @property
    def key(self) -> _Key:
        """The same for whatever is held alike."""
        return self.name, np.round(self.corners, _DECIMALS).tobytes()


class SelfCheck:
    """Checks paths of an arm for collisions with itself, continuously.

    The solids, and which of them may run into each other, are those of travels; see
    :class:`ArmBodies`. What is held is looked at more closely only where the sphere about it comes
    near those about links, and what was prepared for it is kept for whatever is held alike.

    Parameters
    ----------
    arm
        The arm.
    """

    def __init__(self, arm: ArmModel) -> None:
        self.arm = arm
        self._solids = arm_solids(arm)
        self._data = arm.model.createData()
        self._known: dict[tuple[_Key, ...], ContinuousCheck] = {}

    def first_hit(self, path: JointPath, *held: tuple[Held, Vector]) -> Hit | None:
        """Return where links, or what is held, first touch a link or the base; None if nowhere.

        Parameters
        ----------
        path
            Of the joints.
        held
            At the end of the arm, each with where the joints are while it is where its pieces say
            [rad], shape (joints,). What is given twice counts once.
        """
        ends: dict[_Key, _End] = {}
        for one in self._near([end for some, at in held for end in self._ends(some, at)], path):
            ends.setdefault(one.key, one)
        return next(iter(self._with(ends).hits(path)), None)

    def _ends(self, held: Held, joints_rad: Vector) -> Iterator[_End]:
        if not held:
            return
        pin.forwardKinematics(self.arm.model, self._data, joints_rad)
        back = self._data.oMi[self.arm.joints].inverse()
        for name, pieces in held:
            for piece in pieces:
                yield _End(name, piece, back)

    @cached_property
    def _links(self) -> ContinuousCheck:
        return ContinuousCheck(ArmBodies(self.arm.model, self._solids, self.arm.home_rad), ())

    @cached_property
    def _chain_m(self) -> Vector:
        """How far the origin of the last joint's frame can be from every joint's [m]."""
        lengths_m = [
            float(np.linalg.norm(one.translation)) for one in self.arm.model.jointPlacements
        ]
        return np.cumsum([0.0, *lengths_m[:1:-1]])[::-1]

    def _near(self, ends: list[_End], path: JointPath) -> list[_End]:
        """Return the pieces that come near the balls about links on a path.

        By spheres that each lies within. From any node until midway to the next no point moves
        farther, seen from any link, than the joints turn times its reach.
        """
        # An arm whose description has no shapes has no links that anything could touch.
        if not ends or not self._solids:
            return []
        near = _Nearness(self._links.bodies, self._chain_m, path)
        balls = [end.balls for end in ends]
        counts = [len(centres) for centres, _ in balls]
        centres = np.concatenate([centres for centres, _ in balls])
        found = near.of(centres, np.repeat([radius_m for _, radius_m in balls], counts))
        some = np.logical_or.reduceat(found, np.cumsum([0, *counts[:-1]]))
        return [ends[number] for number in np.flatnonzero(some).tolist()]

    def _with(self, ends: dict[_Key, _End]) -> ContinuousCheck:
        """Return the check of links, and of pieces that are held against them."""
        if not ends:
            return self._links
        key = tuple(ends)
        if key not in self._known:
            held = [
                held_solid(one.name, self.arm.joints, one.piece, one.back) for one in ends.values()
            ]
            solids = (*self._solids, *held)
            self._known[key] = ContinuousCheck(
                ArmBodies(self.arm.model, solids, self.arm.home_rad, self._links.bodies), ()
            )
        return self._known[key]


class _Nearness:
    """Tells spheres at the end of the arm that come near a link from those that do not."""

    def __init__(self, bodies: ArmBodies, chain_m: Vector, path: JointPath) -> None:
        spheres = bodies.spheres
        last = bodies.model.nv
        others = np.flatnonzero(spheres.ball_joints <= last - 2)
        joints = spheres.ball_joints[others]
        rotations, origins = bodies.frames.at(path.nodes)
        offsets = spheres.ball_centres_m[others, :, np.newaxis]
        self._balls = (rotations[:, joints] @ offsets)[..., 0] + origins[:, joints]
        self._squares = (self._balls**2).sum(axis=2)[:, np.newaxis]
        self._radii_m = spheres.ball_radii_m[others]
        self._rotations, self._origins = np.swapaxes(rotations[:, last], 1, 2), origins[:, last]
        turns = path.steepest / (2 * (len(path.nodes) - 1))
        self._chain_m, self._turn_rad = float(turns @ chain_m), float(turns.sum())

    def of(self, centres: Vector, radii_m: Vector) -> NDArray[np.bool_]:
        """Return which spheres come near, by centres in the frame of the last joint and radii."""
        placed = centres @ self._rotations + self._origins[:, np.newaxis]
        squares = (placed**2).sum(axis=2)[:, :, np.newaxis] + self._squares
        squares -= 2 * placed @ np.swapaxes(self._balls, 1, 2)
        away_m = np.sqrt(np.maximum(squares, 0.0)) - self._radii_m
        reach_m = np.linalg.norm(centres, axis=1) + radii_m
        moves_m = self._chain_m + self._turn_rad * reach_m
        return np.asarray(away_m.min(axis=(0, 2)) < radii_m + moves_m + LEAST_CLEARANCE_M)
