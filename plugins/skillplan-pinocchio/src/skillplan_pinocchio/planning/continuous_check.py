"""What an arm runs into along a path of its joints, checked continuously.

Conservative advancement: at a posture the smallest distance to everything is computed, and the
next one is so near that no point of the arm moves by more than that until there, whatever the
joints do in between; see :class:`ArmBodies`. Nothing is missed between postures.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import pinocchio as pin

from skillplan.task.motion import Point
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.obstacles import Obstacle
from skillplan_pinocchio.planning.arm_bodies import ArmBodies
from skillplan_pinocchio.planning.moving_solids import Vector

LEAST_CLEARANCE_M: Final = 2e-4
"""What is nearer than this counts as touched [m]: so much is gone at least in a step."""
ITSELF: Final = "the arm itself"

# Distances that coal computes are right to less than this [m].
_ROUNDING_M: Final = 1e-5
# At so many equal steps of a path it is looked at what is near it at all.
_OUTLOOKS: Final = 12


@dataclass(frozen=True)
class Hit:
    """What is touched, by what, and where on the path.

    Parameters
    ----------
    body
        Name of the body; `ITSELF` where one solid of the arm touches another.
    fact
        Holds while the body is there; None for what is there in every state.
    mover
        What touches it, in words.
    of_arm
        Whether that is a link of the arm; else it is at the arm's end.
    place
        Parameter of the path, in [0, 1].
    position
        Where they are nearest to each other [m].
    """

    body: str
    fact: str | None
    mover: str
    of_arm: bool
    place: float
    position: Point


class ContinuousCheck:
    """Checks paths and postures of an arm among obstacles.

    Parameters
    ----------
    bodies
        What moves.
    obstacles
        What stands.
    """

    def __init__(self, bodies: ArmBodies, obstacles: Sequence[Obstacle]) -> None:
        self.bodies = bodies
        self.obstacles = tuple(obstacles)
        self._data = bodies.model.createData()
        pieces = [(number, piece) for number, one in enumerate(obstacles) for piece in one.pieces]
        self._low = np.array([piece.low for _, piece in pieces]).reshape(-1, 3)
        self._high = np.array([piece.high for _, piece in pieces]).reshape(-1, 3)
        self._geometry = bodies.geometry()
        solids = len(bodies.solids)
        for index, (_, piece) in enumerate(pieces):
            self._geometry.addGeometryObject(
                pin.GeometryObject(f"piece {index}", 0, pin.SE3.Identity(), piece.hull)
            )
        # The base of the arm stands where it is put.
        still = sum(solid.joint == 0 for solid in bodies.solids)
        self._moving = range(still, solids)
        chosen = np.zeros((self._geometry.ngeoms, self._geometry.ngeoms), dtype=bool)
        chosen[still:solids, solids:] = True
        # By solid, then by piece.
        self._geometry.setCollisionPairs(chosen)
        self._pairs = [(solid, number) for solid in self._moving for number, _ in pieces]
        self._nearness = self._geometry.createData()
        self._margin_m = 0.0
        self._active: Sequence[int] = range(len(self._pairs))

    def hits(self, path: JointPath) -> tuple[Hit, ...]:
        """Return everything that is touched on a path, in its order; each where it is first."""
        return _Run(self, path).hits()

    def touched(self, joints_rad: Vector) -> tuple[Hit, ...]:
        """Return everything that is touched at some joint angles [rad], shape (joints,)."""
        return self.hits(JointPath([joints_rad, joints_rad]))

    def is_free(self, joints_rad: Vector, margin_m: float) -> bool:
        """Whether nothing that stands is nearer than a margin, and the arm is clear of itself.

        It is quick, and as good as coal's margins are: paths are checked by `hits` in the end.

        Parameters
        ----------
        joints_rad
            Shape (joints,).
        margin_m
            > 0.
        """
        if margin_m != self._margin_m:
            for request in self._nearness.collisionRequests:
                request.security_margin = margin_m
            self._margin_m = margin_m
        self.activate(range(len(self._pairs)))
        model, geometry = self.bodies.model, self._geometry
        touched = pin.computeCollisions(
            model, self._data, geometry, self._nearness, joints_rad, True
        )
        return not touched and not self.bodies.overlaps(joints_rad)

    def clearance_m(self, joints_rad: Vector) -> float:
        """Return the distance to what stands nearest at some joint angles [m], inf if nothing."""
        self.activate(range(len(self._pairs)))
        return self.nearest(joints_rad)[1]

    def near(self, path: JointPath, moves_m: Vector) -> list[int]:
        """Return the pairs of what moves and what stands that may come near on a path, by number.

        By spheres about what moves and boxes about what stands, at places from each of which no
        point moves farther than to midway between two of them.

        Parameters
        ----------
        path
            Of the joints.
        moves_m
            How far a point of each solid moves at most from start to end [m], shape (solids,).
        """
        # What does not move is looked at once.
        count = _OUTLOOKS if float(moves_m.max(initial=0.0)) > 0 else 1
        radii_m = np.array([solid.radius_m for solid in self.bodies.solids])
        reached_m = moves_m / (2 * count) + radii_m + LEAST_CLEARANCE_M + _ROUNDING_M
        found = np.zeros((len(radii_m), len(self._low)), dtype=bool)
        for number in range(count):
            centres = self.bodies.centres(path.at((number + 0.5) / count))[:, np.newaxis]
            away = np.maximum(np.maximum(self._low - centres, centres - self._high), 0.0)
            found |= (away**2).sum(axis=2) < (reached_m**2)[:, np.newaxis]
        return np.flatnonzero(found[self._moving.start :].ravel()).tolist()

    def activate(self, pairs: Sequence[int]) -> None:
        """Look at some pairs only, by number."""
        if pairs != self._active:
            self._nearness.deactivateAllCollisionPairs()
            for pair in pairs:
                self._nearness.activateCollisionPair(pair)
            self._active = pairs

    def nearest(self, joints_rad: Vector) -> tuple[int, float]:
        """Return the nearest of the active pairs and its distance [m]; inf where there is none."""
        if not len(self._active):
            return -1, np.inf
        model, nearness = self.bodies.model, self._nearness
        pair = pin.computeDistances(model, self._data, self._geometry, nearness, joints_rad)
        return pair, nearness.distanceResults[pair].min_distance - _ROUNDING_M

    def hit(self, pair: int, place: float) -> Hit:
        """Return that a pair is touched, after `nearest`."""
        result = self._nearness.distanceResults[pair]
        middle = (result.getNearestPoint1() + result.getNearestPoint2()) / 2
        x, y, z = (round(float(value), 6) for value in middle)
        solid, number = self._pairs[pair]
        one, obstacle = self.bodies.solids[solid], self.obstacles[number]
        where = round(place, 6)
        return Hit(obstacle.body, obstacle.fact, one.name, one.of_arm, where, (x, y, z))

    def others(self, pairs: Sequence[int], pair: int) -> list[int]:
        """Return the pairs that are not with the obstacle of one."""
        return [one for one in pairs if self._pairs[one][1] != self._pairs[pair][1]]


class _Run:
    """One way along a path; what was touched once is no longer looked at."""

    def __init__(self, check: ContinuousCheck, path: JointPath) -> None:
        self._check, self._path = check, path
        self._slopes = path.steepest_by_interval
        moves_m = self._slopes @ check.bodies.reach_m.T
        self._pairs = check.near(path, moves_m.max(axis=0))
        self._fastest_m = moves_m.max(axis=1, initial=0.0).tolist()
        self._own_m = (self._slopes @ check.bodies.pair_reach_m.T).tolist()
        self._own = list(range(len(check.bodies.pairs)))

    def hits(self) -> tuple[Hit, ...]:
        """Return what is touched."""
        # What stands and the arm itself have steps of their own, as long as each allows.
        found = [*self._followed(self._standing), *self._followed(self._itself)]
        return tuple(sorted(found, key=lambda hit: hit.place))

    def _followed(self, step: Callable[[float, int], tuple[list[Hit], float]]) -> Iterator[Hit]:
        """Yield what a step finds from the path's start to its end, both included."""
        intervals = len(self._slopes)
        place = 0.0
        for number in range(intervals):
            end = (number + 1) / intervals
            while place < end:
                found, length = step(place, number)
                yield from found
                # What is left of an interval by rounding is no step.
                place = end if place + length >= end - 1e-12 else place + length
        yield from step(1.0, intervals - 1)[0]

    def _standing(self, place: float, interval: int) -> tuple[list[Hit], float]:
        """Return what is touched at a place, and how far no point reaches anything else."""
        if not self._pairs:
            return [], 1.0
        joints_rad = self._path.at(place)
        self._check.activate(self._pairs)
        pair, distance_m = self._check.nearest(joints_rad)
        found = []
        while distance_m < LEAST_CLEARANCE_M:
            found.append(self._check.hit(pair, place))
            self._pairs = self._check.others(self._pairs, pair)
            self._check.activate(self._pairs)
            pair, distance_m = self._check.nearest(joints_rad)
        fastest_m = self._fastest_m[interval]
        return found, distance_m / fastest_m if fastest_m > 0 else 1.0

    def _itself(self, place: float, interval: int) -> tuple[list[Hit], float]:
        """Return what touches itself at a place, and how far no more of it does."""
        if not self._own:
            return [], 1.0
        bodies, joints_rad = self._check.bodies, self._path.at(place)
        gaps_m = bodies.gaps_m(joints_rad)
        found, length = [], 1.0
        for number in tuple(self._own):
            gap_m = gaps_m[number] - _ROUNDING_M
            move_m = self._own_m[interval][number]
            if gap_m < LEAST_CLEARANCE_M:
                self._own.remove(number)
                found.append(self._own_hit(number, joints_rad, place))
            elif move_m * length > gap_m:
                length = gap_m / move_m
        return found, length

    def _own_hit(self, number: int, joints_rad: Vector, place: float) -> Hit:
        bodies = self._check.bodies
        outer = bodies.pairs[number][1]
        x, y, z = (round(float(value), 6) for value in bodies.centres(joints_rad)[outer])
        one = bodies.solids[outer]
        return Hit(ITSELF, None, one.name, one.of_arm, round(place, 6), (x, y, z))
