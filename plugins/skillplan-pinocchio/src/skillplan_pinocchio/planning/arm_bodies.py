"""An arm with what it holds: how far it moves when its joints turn, and which of it may collide."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from skillplan_pinocchio.planning.arm_frames import ArmFrames
from skillplan_pinocchio.planning.moving_solids import MovingSolid, Vector

Numbers = NDArray[np.intp]

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
    alone
        The arm without what it holds, if that is known already: `solids` begin with its own.

    Attributes
    ----------
    model, solids
        As given.
    frames
        Of the joints.
    still
        How many solids stand still.
    reach_m
        How far from the axis of each joint any point of each solid can be, wherever the joints are
        [m]; 0 for joints that do not move it. Shape (solids, joints). A path whose joints turn by
        no more than some steps moves no point of a solid by more than the sum of its reaches times
        these steps.
    pairs
        Solids that may run into each other, by number, the one nearer to the base first.
        Neighbours are left out, as their joint keeps them apart, and so is what overlaps at home.
    pair_numbers
        The same, shape (pairs, 2).
    pair_reach_m
        The same as `reach_m` for the motion of the second solid seen from the first, shape
        (pairs, joints).
    """

    def __init__(
        self,
        model: Any,
        solids: Sequence[MovingSolid],
        home_rad: Vector,
        alone: ArmBodies | None = None,
    ) -> None:
        self.model = model
        self.solids = tuple(solids)
        self.frames: ArmFrames = ArmFrames(model) if alone is None else alone.frames
        self.still = sum(solid.joint == 0 for solid in solids)
        known = 0 if alone is None else len(alone.solids)
        reach_m = [_reach_m(self.frames, solid) for solid in self.solids[known:]]
        self.reach_m = np.array(reach_m).reshape(-1, model.nv)
        candidates = [
            (a, b)
            for b, outer in enumerate(self.solids[known:], known)
            for a, inner in enumerate(self.solids)
            if outer.joint - inner.joint >= 2
        ]
        self.pairs = _apart(self, candidates, home_rad)
        if alone is not None:
            self.reach_m = np.asarray(np.concatenate([alone.reach_m, self.reach_m]))
            self.pairs = (*alone.pairs, *self.pairs)
        self.pair_numbers: Numbers = np.array(self.pairs, dtype=np.intp).reshape(-1, 2)
        joints = np.arange(1, model.nv + 1)
        self.pair_reach_m = np.array(
            [self.reach_m[b] * (joints > self.solids[a].joint) for a, b in self.pairs]
        ).reshape(-1, model.nv)
        self.spheres = SolidSpheres(self.solids)

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


class SolidSpheres:
    """Spheres about solids: one about each, and the balls that each lies within.

    Parameters
    ----------
    solids
        The solids.

    Attributes
    ----------
    joints, centres_m, radii_m
        Of the spheres, shapes (solids,), (solids, 3) and (solids,); centres in the frames of the
        joints.
    ball_joints, ball_centres_m, ball_radii_m
        The same of all balls.
    """

    def __init__(self, solids: Sequence[MovingSolid]) -> None:
        self.joints: Numbers = np.array([solid.joint for solid in solids], dtype=np.intp)
        self.centres_m = np.array([solid.centre for solid in solids]).reshape(-1, 3)
        self.radii_m = np.array([solid.radius_m for solid in solids])
        counts = [len(solid.balls[0]) for solid in solids]
        firsts = np.cumsum([0, *counts])
        self._balls = np.split(np.arange(firsts[-1]), firsts[1:-1])
        self.ball_joints: Numbers = np.repeat(self.joints, counts)
        self.ball_centres_m = np.concatenate(
            [np.zeros((0, 3)), *(solid.balls[0] for solid in solids)]
        )
        self.ball_radii_m = np.repeat([solid.balls[1] for solid in solids], counts)

    def balls_of(self, solids: Numbers) -> tuple[Numbers, Numbers, Numbers]:
        """Return the balls of solids.

        Parameters
        ----------
        solids
            Numbers of some, at least one.

        Returns
        -------
        tuple
            Numbers of balls, those of each solid in turn; of which of `solids` each is; and where
            those of each begin.
        """
        rows = [self._balls[solid] for solid in solids.tolist()]
        counts = [len(row) for row in rows]
        owners = np.repeat(np.arange(len(rows)), counts)
        return np.concatenate(rows), owners, np.cumsum([0, *counts[:-1]])

    def ball_pairs(self, pairs: Sequence[tuple[int, int]]) -> tuple[Numbers, Numbers, Numbers]:
        """Return every ball of one solid with every ball of another.

        Parameters
        ----------
        pairs
            Of solids, at least one.

        Returns
        -------
        tuple
            Numbers of the ones and of the others; and where those of each pair begin.
        """
        ones = [np.repeat(self._balls[a], len(self._balls[b])) for a, b in pairs]
        others = [np.tile(self._balls[b], len(self._balls[a])) for a, b in pairs]
        firsts = np.cumsum([0, *(len(row) for row in ones[:-1])])
        return np.concatenate(ones), np.concatenate(others), firsts


def _apart(
    bodies: ArmBodies, pairs: Sequence[tuple[int, int]], home_rad: Vector
) -> tuple[tuple[int, int], ...]:
    """Return the pairs that do not overlap at home."""
    geometry = bodies.geometry(pairs)
    nearness = geometry.createData()
    pin.computeDistances(bodies.model, bodies.model.createData(), geometry, nearness, home_rad)
    gaps_m = [found.min_distance for found in nearness.distanceResults]
    return tuple(pair for pair, gap_m in zip(pairs, gaps_m, strict=True) if gap_m >= _HOME_GAP_M)


def _reach_m(frames: ArmFrames, solid: MovingSolid) -> Vector:
    """Return how far from the axis of each joint any point of a solid can be [m].

    From the axis to the next joint's origin, and from there on by the triangle inequality along
    the chain of joints in between.
    """
    centres, radius_m = solid.balls
    found = np.zeros(len(frames.axes))
    if not solid.joint:
        return found
    # From the axis of its own joint, and from the origin of that joint's frame.
    squares = (centres**2).sum(axis=1)
    from_axis = squares - (centres @ frames.axes[solid.joint - 1]) ** 2
    from_axis_m = math.sqrt(max(float(from_axis.max()), 0.0)) + radius_m
    away_m = math.sqrt(float(squares.max())) + radius_m
    for joint in range(solid.joint, 0, -1):
        found[joint - 1] = from_axis_m
        beside_m, offset_m = frames.spans_m[joint - 1]
        from_axis_m = away_m + beside_m
        away_m += offset_m
    return found
