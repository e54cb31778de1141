"""Continuous collision checks of an arm along a joint path, with obstacles and with itself.

Conservative advancement for two solids at a time: from a posture with a known distance, they cannot
touch until a point has moved by that distance, to either side, for any motion of the joints in
between; see :class:`ArmBodies`. The remaining stretches are halved. No contact between postures is
missed.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from skillplan.task.motion import Point
from skillplan_pinocchio.arm_model import ArmModel
from skillplan_pinocchio.kinematics.fixed_order import times
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.planning.arm_bodies import (
    ArmBodies,
    MovingSolid,
    Vector,
    build_arm_solids,
    build_held_solid,
    cover_box,
)
from skillplan_pinocchio.planning.near_pairs import NearPair, NearPairs
from skillplan_pinocchio.shapes import ConvexPiece, Obstacle

LEAST_CLEARANCE_M: Final = 2e-4
"""Solids nearer than this count as touching [m]; it is also the minimum step."""
ITSELF: Final = "the arm itself"

# Error bound of distances from coal [m].
_ROUNDING_M: Final = 1e-5
# Accuracy of the first contact, as motion of a point [m].
_SHARPNESS_M: Final = 1e-3


@dataclass(frozen=True)
class Hit:
    """A contact on a path.

    Parameters
    ----------
    body
        Name of the touched body; `ITSELF` if the arm touches itself.
    fact
        Fact that holds while the body is there; None for a permanent body.
    mover
        Name of the moving solid, in words.
    of_arm
        True if that solid is a link; otherwise it is at the arm's end.
    place
        Parameter of the path, in [0, 1].
    position
        Position of the contact [m].
    other
        Name of the touched solid of the arm; empty for a body.
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
    obstacles
        Fixed obstacles.
    """

    def __init__(self, bodies: ArmBodies, obstacles: Sequence[Obstacle]) -> None:
        self.bodies = bodies
        self.obstacles = tuple(obstacles)
        numbered = [
            (number, piece)
            for number, obstacle in enumerate(obstacles)
            for piece in obstacle.pieces
        ]
        self.pieces = tuple(piece for _, piece in numbered)
        self.owners = tuple(number for number, _ in numbered)
        low = np.array([piece.low for piece in self.pieces]).reshape(-1, 3)
        high = np.array([piece.high for piece in self.pieces]).reshape(-1, 3)
        self.boxes = (low, high)
        self.spared = find_spared_pairs(bodies, [self.obstacles[owner] for owner in self.owners])

    def hits(self, path: JointPath) -> tuple[Hit, ...]:
        """Return all contacts on a path in order, the first one of each obstacle."""
        return _Run(self, path).hits()

    def hits_and_ends(
        self, path: JointPath
    ) -> tuple[tuple[Hit, ...], tuple[Hit, ...], tuple[Hit, ...]]:
        """Return the contacts at the start of a path, all along it, and at its end."""
        run = _Run(self, path)
        return run.touched(0.0), run.hits(), run.touched(1.0)

    def touched(self, joints_rad: Vector) -> tuple[Hit, ...]:
        """Return all contacts at some joint angles [rad], shape (joints,)."""
        return self.hits(JointPath([joints_rad, joints_rad]))

    def is_clear(self, path: JointPath) -> bool:
        """Return whether a path is free of contacts."""
        return _Run(self, path).is_clear()


def find_spared_pairs(bodies: ArmBodies, owners: Sequence[Obstacle]) -> NDArray[np.bool_] | None:
    """Return the pairs of solids and fixed pieces that may touch, or None if there is none.

    Parameters
    ----------
    owners
        Obstacle of each piece. Only a zone may keep out the arm alone, or its load.

    Returns
    -------
    ndarray
        Shape (solids, pieces).
    """
    if all(obstacle.zone is None for obstacle in owners):
        return None
    return np.array(
        [[not obstacle.stops(load=solid.is_load) for obstacle in owners] for solid in bodies.solids]
    ).reshape(len(bodies.solids), len(owners))


class _Run:
    """Check of one path."""

    def __init__(self, check: ContinuousCheck, path: JointPath) -> None:
        self._check, self._path = check, path
        touching_m = LEAST_CLEARANCE_M + _ROUNDING_M
        near_pairs = NearPairs(check.bodies, path, check.boxes, touching_m, check.spared)
        self._places = near_pairs.places
        self._intervals = len(path.nodes) - 1
        self._cubics = [tuple(cubic) for cubic in np.swapaxes(path.cubics, 0, 1)]
        self._standing, self._own = near_pairs.standing, near_pairs.own
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
        """Return the contacts in the order of the path."""
        return self._hits(self._first_touch)

    def touched(self, end: float) -> tuple[Hit, ...]:
        """Return the contacts at one end of the path, 0 or 1."""

        def touch(index: int, pair: NearPair, until: float) -> float | None:
            # Solids with disjoint spheres cannot touch.
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
        hits = [
            self._hit(check.obstacles[owner], *first) for owner, first in sorted(firsts.items())
        ]
        for index, pair in enumerate(self._own):
            place = first_touch(index, pair, 1.0)
            if place is not None:
                hits.append(self._own_hit(pair, place))
        return tuple(sorted(hits, key=lambda hit: hit.place))

    def is_clear(self) -> bool:
        """Return whether the path is free of contacts."""
        pairs = list(enumerate([*self._own, *self._standing]))
        # The nearest pairs are the likeliest to touch.
        pairs.sort(key=lambda numbered: numbered[1].gap_m)
        return all(self._first_touch(index, pair, 1.0) is None for index, pair in pairs)

    def _first_touch(self, index: int, pair: NearPair, until: float) -> float | None:
        """Return the first place up to a limit where two solids touch."""
        end_m = self._length_m(pair, until)
        left = [(begin, min(end, end_m)) for begin, end in reversed(pair.stretches_m)]
        first = None
        while left:
            begin, end = left.pop()
            if begin > end:
                continue
            middle = (begin + end) / 2
            place = self._place(pair, middle)
            distance_m = self._distance_m(index, place)
            if distance_m < LEAST_CLEARANCE_M:
                first = place
                left = [(begin, middle)] if middle - begin > _SHARPNESS_M else []
            else:
                left += [(middle + distance_m, end), (begin, middle - distance_m)]
        return first

    def _place(self, pair: NearPair, length_m: float) -> float:
        """Return the first place up to which a point may have moved by a length."""
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
        """Return the distance of a pair, by number, at a place of the path."""
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
        solid = self._check.bodies.solids[self._standing[index - len(self._own)].solid]
        where = round(place, 6)
        return Hit(obstacle.body, obstacle.fact, solid.name, solid.of_arm, where, (x, y, z))

    def _own_hit(self, pair: NearPair, place: float) -> Hit:
        solid, other = (self._check.bodies.solids[number] for number in (pair.solid, pair.other))
        rotations, origins = self._check.bodies.frames.at(self._path.at(place)[np.newaxis])
        centre = times(rotations[0, solid.joint], solid.centre) + origins[0, solid.joint]
        x, y, z = (round(float(value), 6) for value in centre)
        where = round(place, 6)
        return Hit(ITSELF, None, solid.name, solid.of_arm, where, (x, y, z), other.name)


Held = Sequence[tuple[str, tuple[ConvexPiece, ...]]]
"""Names and pieces in the world of hand, tool and load."""

# Decimals to which corners of held pieces are compared [m].
_DECIMALS: Final = 6
_Key = tuple[str, bytes]


@dataclass(frozen=True, eq=False)
class _End:
    """A piece at the end of the arm.

    Parameters
    ----------
    name
        Name of the part it belongs to.
    back
        Transform from the world to the frame of the last joint.
    """

    name: str
    piece: ConvexPiece
    back: Any

    @cached_property
    def corners(self) -> Vector:
        """Corners in the frame of the last joint [m], shape (corners, 3)."""
        return np.asarray(times(self.piece.corners, self.back.rotation.T) + self.back.translation)

    @property
    def ball(self) -> tuple[Vector, float]:
        """Centre of a sphere around it in the frame of the last joint, and its radius [m]."""
        low, high = np.array(self.piece.low), np.array(self.piece.high)
        centre = self.back.rotation @ ((low + high) / 2) + self.back.translation
        return centre, math.dist(low, high) / 2

    @property
    def balls(self) -> tuple[Vector, float]:
        """Centres of covering spheres in the frame of the last joint, and their radius [m]."""
        low, high = self.corners.min(axis=0), self.corners.max(axis=0)
        return cover_box((low + high) / 2, (high - low) / 2)

    @property
    def key(self) -> _Key:
        """Key that equal pieces in the same grasp share."""
        return self.name, np.round(self.corners, _DECIMALS).tobytes()


class SelfCheck:
    """Checks paths of an arm for self-collisions, continuously.

    Travels use the same solids and pairs; see :class:`ArmBodies`. Held pieces are checked only if
    their spheres come near spheres of links; the check is cached per set of held pieces.
    """

    def __init__(self, arm: ArmModel) -> None:
        self.arm = arm
        self._solids = build_arm_solids(arm)
        self._data = arm.model.createData()
        self._known: dict[tuple[_Key, ...], ContinuousCheck] = {}
        # Hands are held alike in most motions, and hulls take long.
        self._held: dict[_Key, MovingSolid] = {}

    def first_hit(self, path: JointPath, *held: tuple[Held, Vector]) -> Hit | None:
        """Return the first contact of links or held pieces with a link or the base, or None.

        Parameters
        ----------
        held
            Pieces at the end of the arm, each group with the posture in which it is at the given
            place [rad], shape (joints,). Duplicates count once.
        """
        ends: dict[_Key, _End] = {}
        for near in self._near([end for some, at in held for end in self._ends(some, at)], path):
            ends.setdefault(near.key, near)
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
        """Maximum distance of the last joint's origin from every joint's [m]; 1 if prismatic."""
        frames = self._links.bodies.frames
        lengths_m = [
            float(np.linalg.norm(placement.translation)) + stroke_m
            for placement, stroke_m in zip(
                self.arm.model.jointPlacements, (0.0, *frames.strokes_m), strict=True
            )
        ]
        chain_m = np.cumsum([0.0, *lengths_m[:1:-1]])[::-1]
        return np.where(frames.slides, 1.0, chain_m)

    def _near(self, ends: list[_End], path: JointPath) -> list[_End]:
        """Return the pieces that come near the balls of links on a path.

        Compares covering spheres. From a node to midway to the next, no point moves farther,
        relative to any link, than its reach times the joints' turn.
        """
        # An arm described without shapes has no links to touch.
        if not ends or not self._solids:
            return []
        near = _Nearness(self._links.bodies, self._chain_m, path)
        # One sphere each first: most pieces are far from all links.
        around = [end.ball for end in ends]
        is_near = near.of(
            np.array([centre for centre, _ in around]), np.array([m for _, m in around])
        )
        ends = [ends[number] for number in np.flatnonzero(is_near).tolist()]
        if not ends:
            return []
        balls = [end.balls for end in ends]
        counts = [len(centres) for centres, _ in balls]
        centres = np.concatenate([centres for centres, _ in balls])
        is_near = near.of(centres, np.repeat([radius_m for _, radius_m in balls], counts))
        some = np.logical_or.reduceat(is_near, np.cumsum([0, *counts[:-1]]))
        return [ends[number] for number in np.flatnonzero(some).tolist()]

    def _with(self, ends: dict[_Key, _End]) -> ContinuousCheck:
        """Return the check of the links with held pieces."""
        if not ends:
            return self._links
        key = tuple(ends)
        if key not in self._known:
            for own_key, end in ends.items():
                if own_key not in self._held:
                    solid = build_held_solid(end.name, self.arm.joints, end.piece, end.back)
                    self._held[own_key] = solid
            solids = (*self._solids, *(self._held[own_key] for own_key in key))
            self._known[key] = ContinuousCheck(
                ArmBodies(self.arm.model, solids, self.arm.home_rad, self._links.bodies), ()
            )
        return self._known[key]


class _Nearness:
    """Separates spheres at the end of the arm that come near a link from the others."""

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
        turned = turns[~bodies.frames.slides]
        self._chain_m, self._turn_rad = float(turns @ chain_m), float(turned.sum())

    def of(self, centres: Vector, radii_m: Vector) -> NDArray[np.bool_]:
        """Return a mask of the spheres that come near; centres are in the last joint's frame."""
        placed = centres @ self._rotations + self._origins[:, np.newaxis]
        squares = (placed**2).sum(axis=2)[:, :, np.newaxis] + self._squares
        squares -= 2 * placed @ np.swapaxes(self._balls, 1, 2)
        away_m = np.sqrt(np.maximum(squares, 0.0)) - self._radii_m
        reach_m = np.linalg.norm(centres, axis=1) + radii_m
        moves_m = self._chain_m + self._turn_rad * reach_m
        return np.asarray(away_m.min(axis=(0, 2)) < radii_m + moves_m + LEAST_CLEARANCE_M)
