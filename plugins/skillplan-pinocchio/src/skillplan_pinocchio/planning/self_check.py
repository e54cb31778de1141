"""Where an arm runs into itself or its base, alone or with what it holds, on a stroke."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, Final

import numpy as np
import pinocchio as pin

from skillplan_pinocchio.arm_model import ArmModel
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.planning.arm_bodies import ArmBodies
from skillplan_pinocchio.planning.continuous_check import LEAST_CLEARANCE_M, ContinuousCheck, Hit
from skillplan_pinocchio.planning.moving_solids import Vector, arm_solids, held_solid
from skillplan_pinocchio.shapes import ConvexPiece

Held = Sequence[tuple[str, tuple[ConvexPiece, ...]]]
"""What is at the end of the arm: names, and pieces in the world."""

# By so many decimals corners of what is held are told apart [m].
_DECIMALS: Final = 6


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
        self._known: dict[tuple[str, bytes], ContinuousCheck] = {}

    def of_links(self, path: JointPath) -> Hit | None:
        """Return which links touch each other, or the base, first on a path; None if none do."""
        return next(iter(self._links.hits(path)), None)

    def of_held(self, path: JointPath, held: Held, joints_rad: Vector) -> Hit | None:
        """Return what is held and touches a link or the base first on a path; None if nothing does.

        Parameters
        ----------
        path
            Of the joints.
        held
            At the end of the arm.
        joints_rad
            Where the joints are while it is where its pieces say, shape (joints,).
        """
        pin.forwardKinematics(self.arm.model, self._data, joints_rad)
        back = self._data.oMi[self.arm.joints].inverse()
        hits = [
            hit
            for name, pieces in held
            for piece in self._near([*pieces], path, back)
            for hit in self._with(name, piece, back).hits(path)
        ]
        return min(hits, key=lambda hit: hit.place, default=None)

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

    def _near(self, pieces: list[ConvexPiece], path: JointPath, back: Any) -> list[ConvexPiece]:
        """Return the pieces whose spheres come near the balls about links on a path.

        From any node until midway to the next no point moves farther, seen from any link, than
        the joints turn times its reach.
        """
        if not pieces:
            return []
        bodies = self._links.bodies
        last = self.arm.joints
        low, high = (np.array([getattr(one, end) for one in pieces]) for end in ("low", "high"))
        radii_m = np.linalg.norm(high - low, axis=1) / 2
        centres = (low + high) / 2 @ back.rotation.T + back.translation
        others = np.flatnonzero(bodies.spheres.ball_joints <= last - 2)
        joints = bodies.spheres.ball_joints[others]
        rotations, origins = bodies.frames.at(path.nodes)
        balls = np.einsum(
            "nbij,bj->nbi", rotations[:, joints], bodies.spheres.ball_centres_m[others]
        )
        balls += origins[:, joints]
        placed = centres @ np.swapaxes(rotations[:, last], 1, 2) + origins[:, last, np.newaxis]
        away_m = np.linalg.norm(placed[:, :, np.newaxis] - balls[:, np.newaxis], axis=3)
        away_m -= bodies.spheres.ball_radii_m[others]
        turns = path.steepest / (2 * (len(path.nodes) - 1))
        reach_m = np.linalg.norm(centres, axis=1) + radii_m
        moves_m = turns @ self._chain_m + turns.sum() * reach_m
        near = away_m.min(axis=(0, 2)) < radii_m + moves_m + LEAST_CLEARANCE_M
        return [pieces[number] for number in np.flatnonzero(near).tolist()]

    def _with(self, name: str, piece: ConvexPiece, back: Any) -> ContinuousCheck:
        """Return the check of a piece that is held against the links."""
        corners = piece.corners @ back.rotation.T + back.translation
        key = (name, np.round(corners, _DECIMALS).tobytes())
        if key not in self._known:
            solids = (*self._solids, held_solid(name, self.arm.joints, piece, back))
            bodies = ArmBodies(self.arm.model, solids, self.arm.home_rad, len(self._solids))
            self._known[key] = ContinuousCheck(bodies, ())
        return self._known[key]
