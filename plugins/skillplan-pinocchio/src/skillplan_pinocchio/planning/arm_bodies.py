"""An arm with what it holds: how far it moves when its joints turn, and which of it may collide."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import pinocchio as pin

from skillplan_pinocchio.planning.moving_solids import MovingSolid, Vector

# What is nearer than this at home are shapes that are larger than links [m].
_HOME_GAP_M: Final = 0.001


class ArmBodies:
    """Everything that moves with an arm.

    Parameters
    ----------
    model
        The arm's `pinocchio.Model`.
    solids
        Those that stand still first.
    home_rad
        A posture in which the arm does not collide with itself, shape (joints,).

    Attributes
    ----------
    model, solids
        As given.
    reach_m
        How far from the axis of each joint any point of each solid can be, wherever the joints are
        [m]; 0 for joints that do not move it. Shape (solids, joints). A path whose joints turn by
        no more than some steps moves no point of a solid by more than the sum of its reaches times
        these steps.
    pairs
        Solids that may run into each other, by number, the one nearer to the base first.
        Neighbours are left out, as their joint keeps them apart, and so is what overlaps at home.
    pair_reach_m
        The same as `reach_m` for the motion of the second solid seen from the first, shape
        (pairs, joints).
    """

    def __init__(self, model: Any, solids: Sequence[MovingSolid], home_rad: Vector) -> None:
        self.model = model
        self.solids = tuple(solids)
        self.reach_m = np.array([_reach_m(model, solid) for solid in solids]).reshape(-1, model.nv)
        candidates = [
            (a, b)
            for b, outer in enumerate(self.solids)
            for a, inner in enumerate(self.solids)
            if outer.joint - inner.joint >= 2
        ]
        self.pairs = _apart(self, candidates, home_rad)
        self._data = model.createData()
        self._geometry = self.geometry(self.pairs)
        self._nearness = self._geometry.createData()
        joints = np.arange(1, model.nv + 1)
        self.pair_reach_m = np.array(
            [self.reach_m[b] * (joints > self.solids[a].joint) for a, b in self.pairs]
        ).reshape(-1, model.nv)

    def geometry(self, pairs: Sequence[tuple[int, int]] = ()) -> Any:
        """Return a new `pinocchio.GeometryModel` of the solids, numbered as they are.

        Parameters
        ----------
        pairs
            Of solids to be looked at.
        """
        geometry = pin.GeometryModel()
        for number, solid in enumerate(self.solids):
            geometry.addGeometryObject(
                pin.GeometryObject(f"solid {number}", solid.joint, solid.frame, solid.geometry)
            )
        for pair in pairs:
            geometry.addCollisionPair(pin.CollisionPair(*pair))
        return geometry

    def gaps_m(self, joints_rad: Vector) -> list[float]:
        """Return the distances between `pairs` [m], below 0 how deep they overlap.

        Parameters
        ----------
        joints_rad
            Shape (joints,).
        """
        pin.computeDistances(self.model, self._data, self._geometry, self._nearness, joints_rad)
        return [found.min_distance for found in self._nearness.distanceResults]

    def overlaps(self, joints_rad: Vector) -> bool:
        """Whether two solids of `pairs` overlap at some joint angles [rad], shape (joints,)."""
        return bool(
            pin.computeCollisions(
                self.model, self._data, self._geometry, self._nearness, joints_rad, True
            )
        )

    def centres(self, joints_rad: Vector) -> Vector:
        """Return the centres of the spheres about the solids [m], shape (solids, 3)."""
        pin.forwardKinematics(self.model, self._data, joints_rad)
        placements = self._data.oMi
        return np.array([placements[one.joint].act(one.centre) for one in self.solids])


def _apart(
    bodies: ArmBodies, pairs: Sequence[tuple[int, int]], home_rad: Vector
) -> tuple[tuple[int, int], ...]:
    """Return the pairs that do not overlap at home."""
    geometry = bodies.geometry(pairs)
    nearness = geometry.createData()
    pin.computeDistances(bodies.model, bodies.model.createData(), geometry, nearness, home_rad)
    gaps_m = [found.min_distance for found in nearness.distanceResults]
    return tuple(pair for pair, gap_m in zip(pairs, gaps_m, strict=True) if gap_m >= _HOME_GAP_M)


def _reach_m(model: Any, solid: MovingSolid) -> Vector:
    """Return how far from the axis of each joint any point of a solid can be [m].

    No farther than from the origin of the joint's frame, by the triangle inequality along the
    chain of joints in between.
    """
    found = np.zeros(model.nv)
    away_m = float(np.linalg.norm(solid.centre)) + solid.radius_m
    for joint in range(solid.joint, 0, -1):
        found[joint - 1] = away_m
        away_m += float(np.linalg.norm(model.jointPlacements[joint].translation))
    return found
