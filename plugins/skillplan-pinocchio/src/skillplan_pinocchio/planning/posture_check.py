"""Whether postures of an arm are free, by the thousand: what a planner asks.

It is as good as coal's margins are. Ways that it lets pass are checked by `ContinuousCheck`.
"""

from __future__ import annotations

from collections.abc import Sequence

import pinocchio as pin

from skillplan_pinocchio.obstacles import Obstacle
from skillplan_pinocchio.planning.arm_bodies import ArmBodies
from skillplan_pinocchio.planning.moving_solids import Vector


class PostureCheck:
    """Checks postures of an arm among obstacles.

    Boxes about all that there is are compared first: at most places only few of them overlap.

    Parameters
    ----------
    bodies
        What moves.
    obstacles
        What stands.
    ends_rad
        Free postures of the arm, each of shape (joints,).
    margin_m
        So far everything keeps from what stands, or half as far as it does at the ends [m]; from
        itself the arm keeps clear.
    """

    def __init__(
        self,
        bodies: ArmBodies,
        obstacles: Sequence[Obstacle],
        ends_rad: Sequence[Vector],
        margin_m: float,
    ) -> None:
        self._model, self._data = bodies.model, bodies.model.createData()
        geometry = bodies.geometry()
        pieces = [piece for one in obstacles for piece in one.pieces]
        for number, piece in enumerate(pieces):
            geometry.addGeometryObject(
                pin.GeometryObject(f"piece {number}", 0, pin.SE3.Identity(), piece.hull)
            )
        # The base of the arm stands where it is put.
        solids = len(bodies.solids)
        for solid in range(bodies.still, solids):
            for number in range(solids, solids + len(pieces)):
                geometry.addCollisionPair(pin.CollisionPair(solid, number))
        nearness = geometry.createData()
        for end_rad in ends_rad:
            pin.computeDistances(self._model, self._data, geometry, nearness, end_rad)
            for found in nearness.distanceResults:
                margin_m = min(margin_m, found.min_distance / 2)
        standing = len(geometry.collisionPairs)
        for pair in bodies.pairs:
            geometry.addCollisionPair(pin.CollisionPair(*pair))
        nearness = geometry.createData()
        for number in range(standing):
            nearness.collisionRequests[number].security_margin = margin_m
        # The manager looks into them.
        self._looked_into = (geometry, nearness)
        self._manager = pin.BroadPhaseManager_NaiveCollisionManager(
            bodies.model, geometry, nearness
        )

    def is_free(self, joints_rad: Vector) -> bool:
        """Whether nothing is touched at some joint angles [rad], shape (joints,)."""
        return not pin.computeCollisions(self._model, self._data, self._manager, joints_rad, True)
