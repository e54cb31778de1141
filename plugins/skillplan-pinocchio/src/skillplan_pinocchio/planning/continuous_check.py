"""What an arm runs into along a path of its joints, checked continuously.

Conservative advancement, two solids at a time: from a posture at which their distance is computed,
they touch nowhere as far as no point moves by more than that, on either side, whatever the joints
do in between; see :class:`ArmBodies`. What is left is halved. Nothing is missed between postures.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pinocchio as pin

from skillplan.task.motion import Point
from skillplan_pinocchio.kinematics.fixed_order import times
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.obstacles import Obstacle
from skillplan_pinocchio.planning.arm_bodies import ArmBodies
from skillplan_pinocchio.planning.moving_solids import Vector
from skillplan_pinocchio.planning.outlook import NearPair, Outlook

LEAST_CLEARANCE_M: Final = 2e-4
"""What is nearer than this counts as touched [m]: so much is gone at least in a step."""
ITSELF: Final = "the arm itself"

# Distances that coal computes are right to less than this [m].
_ROUNDING_M: Final = 1e-5
# The first place where something is touched is told to what moves anything by so much [m].
_SHARPNESS_M: Final = 1e-3


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
    other
        Which solid of the arm is touched, in words; empty for a body.
    """

    body: str
    fact: str | None
    mover: str
    of_arm: bool
    place: float
    position: Point
    other: str = ""


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
        found = [(number, piece) for number, one in enumerate(obstacles) for piece in one.pieces]
        self.pieces = tuple(piece for _, piece in found)
        self.owners = tuple(number for number, _ in found)
        low = np.array([piece.low for piece in self.pieces]).reshape(-1, 3)
        high = np.array([piece.high for piece in self.pieces]).reshape(-1, 3)
        self.boxes = (low, high)

    def hits(self, path: JointPath) -> tuple[Hit, ...]:
        """Return everything that is touched on a path, in its order; each where it is first."""
        return _Run(self, path).hits()

    def hits_and_ends(
        self, path: JointPath
    ) -> tuple[tuple[Hit, ...], tuple[Hit, ...], tuple[Hit, ...]]:
        """Return what is touched where a path begins, all along it, and where it ends."""
        run = _Run(self, path)
        return run.touched(0.0), run.hits(), run.touched(1.0)

    def touched(self, joints_rad: Vector) -> tuple[Hit, ...]:
        """Return everything that is touched at some joint angles [rad], shape (joints,)."""
        return self.hits(JointPath([joints_rad, joints_rad]))

    def is_clear(self, path: JointPath) -> bool:
        """Whether nothing is touched on a path."""
        return _Run(self, path).is_clear()


class _Run:
    """One way along a path.

    Parameters
    ----------
    check
        What moves, and what stands.
    path
        Of the joints.
    """

    def __init__(self, check: ContinuousCheck, path: JointPath) -> None:
        self._check, self._path = check, path
        least_m = LEAST_CLEARANCE_M + _ROUNDING_M
        outlook = Outlook(check.bodies, path, check.boxes, least_m)
        self._places = outlook.places
        self._intervals = len(path.nodes) - 1
        self._cubics = [tuple(one) for one in np.swapaxes(path.cubics, 0, 1)]
        self._standing, self._own = outlook.standing, outlook.own
        bodies = check.bodies
        self._model, self._data = bodies.model, bodies.model.createData()
        self._geometry = bodies.geometry([(pair.other, pair.solid) for pair in self._own])
        numbers: dict[int, int] = {}
        for pair in self._standing:
            if pair.other not in numbers:
                piece = pin.GeometryObject(
                    f"piece {pair.other}", 0, pin.SE3.Identity(), check.pieces[pair.other].hull
                )
                numbers[pair.other] = self._geometry.addGeometryObject(piece)
            self._geometry.addCollisionPair(pin.CollisionPair(pair.solid, numbers[pair.other]))
        self._nearness = self._geometry.createData()

    def hits(self) -> tuple[Hit, ...]:
        """Return what is touched, in the order of the path."""
        return self._hits(self._first_touch)

    def touched(self, end: float) -> tuple[Hit, ...]:
        """Return what is touched at one end of the path, 0 or 1."""

        def touch(index: int, pair: NearPair, until: float) -> float | None:
            # Where spheres are apart there is nothing to be touched.
            first, last = pair.stretches_m[0][0], pair.stretches_m[-1][1]
            near = first <= 0 if end == 0 else last >= pair.lengths_m[-1]
            return end if near and self._distance_m(index, end) < LEAST_CLEARANCE_M else None

        return self._hits(touch)

    def _hits(self, first_touch: Callable[[int, NearPair, float], float | None]) -> tuple[Hit, ...]:
        check = self._check
        firsts: dict[int, tuple[float, int]] = {}
        for index, pair in enumerate(self._standing, len(self._own)):
            owner = check.owners[pair.other]
            until = firsts[owner][0] if owner in firsts else 1.0
            place = first_touch(index, pair, until)
            if place is not None:
                firsts[owner] = (place, index)
        found = [
            self._hit(check.obstacles[owner], *first) for owner, first in sorted(firsts.items())
        ]
        for index, pair in enumerate(self._own):
            place = first_touch(index, pair, 1.0)
            if place is not None:
                found.append(self._own_hit(pair, place))
        return tuple(sorted(found, key=lambda hit: hit.place))

    def is_clear(self) -> bool:
        """Whether nothing is touched."""
        pairs = list(enumerate([*self._own, *self._standing]))
        # What comes nearest is likeliest to be touched.
        pairs.sort(key=lambda numbered: numbered[1].gap_m)
        return all(self._first_touch(index, pair, 1.0) is None for index, pair in pairs)

    def _first_touch(self, index: int, pair: NearPair, until: float) -> float | None:
        """Return the first place where two solids touch, of those up to a place."""
        end_m = self._length_m(pair, until)
        left = [(begin, min(end, end_m)) for begin, end in reversed(pair.stretches_m)]
        found = None
        while left:
            begin, end = left.pop()
            if begin > end:
                continue
            middle = (begin + end) / 2
            place = self._place(pair, middle)
            distance_m = self._distance_m(index, place)
            if distance_m < LEAST_CLEARANCE_M:
                found = place
                left = [(begin, middle)] if middle - begin > _SHARPNESS_M else []
            else:
                left += [(middle + distance_m, end), (begin, middle - distance_m)]
        return found

    def _place(self, pair: NearPair, length_m: float) -> float:
        """Return where a point of a solid may have moved by a length."""
        lengths, places = pair.lengths_m, self._places
        number = min(bisect_right(lengths, length_m), len(lengths) - 1)
        before_m, after_m = lengths[number - 1], lengths[number]
        share = (length_m - before_m) / (after_m - before_m) if after_m > before_m else 0.0
        return places[number - 1] + min(share, 1.0) * (places[number] - places[number - 1])

    def _length_m(self, pair: NearPair, place: float) -> float:
        lengths, places = pair.lengths_m, self._places
        number = min(bisect_right(places, place), len(places) - 1)
        share = (place - places[number - 1]) / (places[number] - places[number - 1])
        return lengths[number - 1] + share * (lengths[number] - lengths[number - 1])

    def _distance_m(self, index: int, place: float) -> float:
        """Return the distance of a pair, by number, somewhere on the path."""
        return float(self._nearest(index, place).min_distance) - _ROUNDING_M

    def _nearest(self, index: int, place: float) -> Any:
        nearness = self._nearness
        pin.updateGeometryPlacements(
            self._model, self._data, self._geometry, nearness, self._joints_rad(place)
        )
        return pin.computeDistance(self._geometry, nearness, index)

    def _joints_rad(self, place: float) -> Vector:
        share = place * self._intervals
        number = min(int(share), self._intervals - 1)
        none, once, twice, thrice = self._cubics[number]
        share -= number
        if self._intervals == 1:
            return np.asarray(none + share * once)
        return np.asarray(none + share * (once + share * (twice + share * thrice)))

    def _hit(self, obstacle: Obstacle, place: float, index: int) -> Hit:
        result = self._nearest(index, place)
        middle = (result.getNearestPoint1() + result.getNearestPoint2()) / 2
        x, y, z = (round(float(value), 6) for value in middle)
        one = self._check.bodies.solids[self._standing[index - len(self._own)].solid]
        where = round(place, 6)
        return Hit(obstacle.body, obstacle.fact, one.name, one.of_arm, where, (x, y, z))

    def _own_hit(self, pair: NearPair, place: float) -> Hit:
        one, other = (self._check.bodies.solids[number] for number in (pair.solid, pair.other))
        rotations, origins = self._check.bodies.frames.at(self._path.at(place)[np.newaxis])
        centre = times(rotations[0, one.joint], one.centre) + origins[0, one.joint]
        x, y, z = (round(float(value), 6) for value in centre)
        where = round(place, 6)
        return Hit(ITSELF, None, one.name, one.of_arm, where, (x, y, z), other.name)
