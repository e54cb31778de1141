"""Turns of the product and closing jaws: collisions with bodies that stay, in any state.

A turning body advances by the distance to an obstacle divided by the speed of its fastest point,
so it cannot pass an obstacle between two measurements.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import coal
import numpy as np
from numpy.typing import NDArray

from skillplan.task.pose import Pose
from skillplan.task.scene import Body, Scene, Workholder
from skillplan.task.state import AND, State
from skillplan_pinocchio.hand_sweeps import HandSweeps
from skillplan_pinocchio.motion_plan import ArmMotion, MotionPlanner
from skillplan_pinocchio.shapes import (
    ConvexPiece,
    Nearness,
    Obstacle,
    make_pieces,
    make_shank_pieces,
    make_standing_pieces,
    measure_geometry_distance,
)
from skillplan_pinocchio.support import find_supports
from skillplan_pinocchio.sweep import Touch
from skillplan_pinocchio.swept_motion import (
    Collision,
    SweptMotion,
    SweptMotionBuilder,
    make_collision,
)

# Least advance of the fastest point between two measurements [m].
_LEAST_STEP_M = 1e-4
_STILL = coal.Transform3s()

# Lower and upper corner [m].
Box = tuple[NDArray[np.float64], NDArray[np.float64]]


@dataclass(frozen=True)
class Standing:
    """A rigid geometry that does not turn.

    Parameters
    ----------
    name
        Name of the body, link or tool, in words.
    fact
        Fact that holds while it is there; None for a permanent one.
    """

    name: str
    fact: str | None
    geometries: tuple[tuple[Any, Any], ...]

    @cached_property
    def boxes(self) -> tuple[Box, ...]:
        """Boxes around the geometries."""
        return tuple(_find_box(geometry, at) for geometry, at in self.geometries)


@dataclass(frozen=True)
class Reach:
    """A piece that turns, and how far it gets.

    Parameters
    ----------
    path_m
        Length of the path of its fastest point, at most [m].
    box
        Box that it does not leave.
    """

    piece: ConvexPiece
    path_m: float
    box: Box


@dataclass(frozen=True)
class Turning:
    """A rigid motion of the product.

    Parameters
    ----------
    begin, end
        Facts of the orientations; equal for bodies that stand.
    """

    workholder: Workholder
    begin: str
    end: str

    def at(self, share: float) -> Any:
        """Return the motion over a share of the turn for coal."""
        pose = self.workholder.turn(self.begin, self.end, share)
        return coal.Transform3s(np.array(pose.rotation), np.array(pose.position))

    def find_reach(self, pieces: Sequence[ConvexPiece]) -> tuple[Reach, ...]:
        """Return how far pieces get: each corner moves on an arc about the axis, which shifts."""
        half = self.workholder.turn(self.begin, self.end, 0.5)
        whole = self.workholder.turn(self.begin, self.end, 1.0)
        x, y, z, w = half.orientation
        angle_rad = 4 * math.atan2(math.hypot(x, y, z), abs(w))
        start = self.workholder.orientations[self.begin].apply(self.workholder.pivot)
        shift = np.subtract(whole.apply(start), start)
        axis = np.array([x, y, z]) / (math.hypot(x, y, z) or 1.0)
        reaches = []
        for piece in pieces:
            away = piece.corners - start
            radii_m = np.linalg.norm(np.cross(away, axis), axis=1) * (angle_rad > 0.0)
            middles = start + np.outer(away @ axis, axis) if angle_rad > 0.0 else piece.corners
            half_m = np.outer(radii_m, np.sqrt(np.maximum(0.0, 1.0 - axis**2)))
            low = (middles - half_m).min(axis=0) + np.minimum(shift, 0.0)
            high = (middles + half_m).max(axis=0) + np.maximum(shift, 0.0)
            path_m = angle_rad * float(radii_m.max()) + float(np.linalg.norm(shift))
            reaches.append(Reach(piece, path_m, (low, high)))
        return tuple(reaches)

    def find_touch(
        self, reach: Reach, other: Any, other_at: Any, tolerance_m: float
    ) -> Touch | None:
        """Return the first contact of a piece that turns with a geometry, or None."""
        share = 0.0
        while True:
            near = measure_geometry_distance(reach.piece.hull, self.at(share), other, other_at)
            if near.distance_m < -tolerance_m:
                return Touch(share, partial(Nearness, near.distance_m, near.position))
            if share >= 1.0 or reach.path_m == 0.0:
                return None
            step_m = max(near.distance_m + tolerance_m, _LEAST_STEP_M)
            share = min(1.0, share + step_m / reach.path_m)


def _find_box(geometry: Any, at: Any) -> Box:
    """Return the box around a geometry of coal."""
    geometry.computeLocalAABB()
    low, high = geometry.aabb_local.min_, geometry.aabb_local.max_
    middle = at.transform((low + high) / 2)
    half = np.abs(at.getRotation()) @ (high - low) / 2
    return middle - half, middle + half


def _join_boxes(boxes: Sequence[Box]) -> Box:
    lows, highs = (np.array([box[end] for box in boxes]).reshape(-1, 3) for end in (0, 1))
    return lows.min(axis=0, initial=np.inf), highs.max(axis=0, initial=-np.inf)


def _may_meet(box: Box, other: Box) -> bool:
    """Return whether two boxes overlap."""
    return bool((box[0] < other[1]).all() and (other[0] < box[1]).all())


class Turns:
    """Swept motions of turns, of closing jaws, and of releases, for verdicts in any state."""

    def __init__(self, scene: Scene, planner: MotionPlanner, sweeps: HandSweeps) -> None:
        self.scene = scene
        self.planner = planner
        self.sweeps = sweeps

    def turn(self, motion: ArmMotion, state: State) -> tuple[Collision, ...]:
        """Return the collisions of a turn from the orientation in a state.

        Parameters
        ----------
        motion
            Motion of the arm to where it waits.
        """
        subject = motion.motion.visit.subject
        workholder = self.scene.find_workholder(subject)
        begin = workholder.find_orientation(state)
        turning = Turning(workholder, begin, f"turned({subject})")
        standing = [*self._list_standing(workholder), *self._list_arm(motion)]
        collisions = [
            collision
            for body, fact, pieces in self._list_turning(begin)
            for collision in self._meet(turning, body.name, fact, pieces, standing, "the turn")
        ]
        return tuple(sorted(collisions, key=lambda item: float(item.evidence["fraction"])))

    def close(self, holder: str, part: str) -> Iterator[Collision]:
        """Yield the collisions of the jaws of a holder that closes on a part."""
        closed = next(item for item in self.scene.holders if item.name == holder).facts[part]
        still = Turning(Workholder("", (0.0, 0.0, 0.0), {"": Pose((0.0, 0.0, 0.0))}), "", "")
        standing = [
            _make_standing(obstacle) for obstacle in self.planner.obstacles if obstacle.zone is None
        ]
        for body, fact, pieces in self._list_turning(closed):
            # Jaws are not there before they close.
            around = AND.join(term for term in fact.split(AND) if term != closed)
            yield from self._meet(still, body.name, around, pieces, standing, "closing")

    def release(
        self, builder: SweptMotionBuilder, holder: str, part: str, state: State
    ) -> SweptMotion:
        """Return the supports of a part that a holder lets go of, in its orientation."""
        opened = next(item for item in self.scene.holders if item.name == holder).facts[part]
        body = self.scene.body(part)
        placement = body.placement(state)
        if placement is None or not builder.check_support or not _is_built_in(placement.fact):
            # A holder that waits for its part lets go of nothing.
            return SweptMotion((), ())
        obstacles = [
            obstacle
            for obstacle in self.planner.obstacles
            if obstacle.zone is None and opened not in (obstacle.fact or "").split(AND)
        ]
        pieces = make_standing_pieces(body, placement.pose)
        supports = find_supports(part, pieces, obstacles, self.planner.tolerance_m)
        holding = [
            *((name, fact) for name, fact in builder.list_holding(part) if fact != opened),
            *((fit.into, None) for fit in body.fits if fit.holds),
            *(
                (screw.name, own.fact)
                for screw in self.scene.bodies
                if part in screw.joins and len(screw.joins) > 1
                for own in screw.placements
            ),
        ]
        return SweptMotion((), (replace(supports, holders=tuple(holding)),))

    def _list_turning(self, fact: str) -> Iterator[tuple[Body, str, tuple[ConvexPiece, ...]]]:
        """Yield the bodies at the places that a fact is a term of."""
        for body in self.scene.bodies:
            for placement in body.placements:
                if fact in placement.fact.split(AND):
                    pieces = make_pieces(body, placement.pose)
                    shank = make_shank_pieces(body, placement.pose)
                    yield body, placement.fact, (*pieces, *shank)

    def _list_standing(self, workholder: Workholder) -> Iterator[Standing]:
        """Yield the obstacles that do not turn with a workholder."""
        for obstacle in self.planner.obstacles:
            terms = set((obstacle.fact or "").split(AND))
            if obstacle.stops(load=True) and not terms & workholder.orientations.keys():
                yield _make_standing(obstacle)

    def _list_arm(self, motion: ArmMotion) -> Iterator[Standing]:
        """Yield the links of the arm where it waits, and what is on it."""
        for name, pieces in self.sweeps.held(motion.motion, motion.motion.above):
            yield Standing(name, None, tuple((piece.hull, _STILL) for piece in pieces))
        if not self.planner.check_arm or not motion.elbows:
            return
        arm = self.planner.arm
        rotations, origins = arm.frames([motion.elbows[0].strokes.end])
        for piece in arm.pieces:
            joint = coal.Transform3s(rotations[0, piece.link - 1], origins[0, piece.link - 1])
            own = coal.Transform3s(piece.frame.rotation, piece.frame.translation)
            yield Standing(f"link {piece.link} of the arm", None, ((piece.geometry, joint * own),))

    def _meet(
        self,
        turning: Turning,
        name: str,
        fact: str,
        pieces: Sequence[ConvexPiece],
        standing: Iterable[Standing],
        during: str,
    ) -> Iterator[Collision]:
        """Yield the first collisions of a body with standing ones."""
        reaches = turning.find_reach(pieces)
        box = _join_boxes([reach.box for reach in reaches])
        for other in standing:
            if other.name == name or not _may_meet(box, _join_boxes(other.boxes)):
                continue
            touches = [
                touch
                for reach in reaches
                for (geometry, at), own in zip(other.geometries, other.boxes, strict=True)
                if _may_meet(reach.box, own)
                and (touch := turning.find_touch(reach, geometry, at, self.planner.tolerance_m))
            ]
            if not touches:
                continue
            touch = min(touches, key=lambda item: item.fraction)
            facts = [term for term in (fact, other.fact) if term]
            yield make_collision(AND.join(facts) or None, name, other.name, during, touch)


def _make_standing(obstacle: Obstacle) -> Standing:
    geometries = tuple((piece.hull, _STILL) for piece in obstacle.pieces)
    return Standing(obstacle.body, obstacle.fact, geometries)


def _is_built_in(fact: str) -> bool:
    """Return True for the fact that a part is at a goal."""
    return fact.startswith(("placed(", "at_goal(", "single("))
