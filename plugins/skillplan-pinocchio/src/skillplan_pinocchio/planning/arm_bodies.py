"""Solids that move with an arm: bounds on their motion, and pairs that may collide."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from skillplan_pinocchio.arm_model import ArmModel, LinkPiece
from skillplan_pinocchio.kinematics.fixed_order import length, times
from skillplan_pinocchio.shapes import ConvexPiece

Vector = NDArray[np.float64]

# Minimum half thickness of a part of a box [m], and maximum number of parts along an edge.
_LEAST_HALF_M: Final = 0.02
_MOST_BALLS: Final = 5


@dataclass(frozen=True, eq=False)
class MovingSolid:
    """A convex solid that is fixed to a joint.

    Parameters
    ----------
    name
        Name in words, such as ``link 4 of the arm``.
    joint
        Number of its joint, counted from 1; 0 for a fixed solid.
    frame
        Pose of the geometry in the frame of the joint, as `pinocchio.SE3`.
    centre
        Centre of the bounding sphere in the frame of the joint [m], shape (3,).
    radius_m
        Radius of that sphere, > 0.
    balls
        Centres of smaller covering spheres in the frame of the joint [m], shape (balls, 3), and
        their common radius [m].
    of_arm
        True if it is a link; otherwise it is at the arm's end.
    is_load
        True for the carried body.
    overlaps
        Pairs of bodies of the arm that are not checked; see `ArmDescription`.
    """

    name: str
    joint: int
    geometry: Any
    frame: Any
    centre: Vector
    radius_m: float
    balls: tuple[Vector, float]
    of_arm: bool = False
    is_load: bool = False
    overlaps: tuple[tuple[int, int], ...] = ()


def build_arm_solids(arm: ArmModel) -> tuple[MovingSolid, ...]:
    """Return the fixed base of an arm, and its links."""
    turned = pin.SE3(np.array(arm.mount.rotation), np.array(arm.mount.position))
    base = arm.description.shapes[0] if arm.description.shapes else ()
    solids = []
    for piece in (*(LinkPiece(0, shape) for shape in base), *arm.pieces):
        centre, half = piece.box
        placed = turned if piece.link == 0 else pin.SE3.Identity()
        centres, radius_m = cover_box(centre, half)
        name = f"link {piece.link} of the arm" if piece.link else "the base of the arm"
        solids.append(
            MovingSolid(
                name,
                piece.link,
                piece.geometry,
                placed * piece.frame,
                placed.act(centre),
                length(half),
                (times(centres, placed.rotation.T) + placed.translation, radius_m),
                of_arm=True,
                overlaps=arm.description.overlaps,
            )
        )
    return tuple(solids)


def build_held_solid(
    name: str, joint: int, piece: ConvexPiece, back: Any, *, is_load: bool = False
) -> MovingSolid:
    """Return a piece in the hand as a solid.

    Parameters
    ----------
    joint
        Number of the last joint, counted from 1.
    piece
        Piece in the world in some posture.
    back
        Pose of the world in the frame of the joint in that posture, as `pinocchio.SE3`.
    """
    corners = times(piece.corners, back.rotation.T) + back.translation
    low, high = corners.min(axis=0), corners.max(axis=0)
    centre = (low + high) / 2
    radius_m = float(np.linalg.norm(corners - centre, axis=1).max())
    balls = cover_box(centre, (high - low) / 2)
    return MovingSolid(name, joint, piece.hull, back, centre, radius_m, balls, is_load=is_load)


def cover_box(centre: Vector, half: Vector) -> tuple[Vector, float]:
    """Return spheres that cover a box, one per near-cube of it.

    Parameters
    ----------
    centre, half
        Centre of the box and half its extents [m], each of shape (3,).

    Returns
    -------
    tuple
        Centres [m], shape (balls, 3), and common radius [m].
    """
    x, y, z = half.tolist()
    edge_half = max(min(x, y, z), _LEAST_HALF_M)
    counts = tuple(min(max(round(extent / edge_half), 1), _MOST_BALLS) for extent in (x, y, z))
    radius_m = math.hypot(x / counts[0], y / counts[1], z / counts[2])
    return centre + _compute_middles(counts) * half, radius_m


@cache
def _compute_middles(counts: tuple[int, ...]) -> Vector:
    """Return the centres of the parts of a box from -1 to 1."""
    steps = [(2 * np.arange(count) + 1) / count - 1 for count in counts]
    return np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)


class ArmFrames:
    """Joint frames of an arm, computed for many postures at once.

    Parameters
    ----------
    model
        The arm's `pinocchio.Model`.

    Attributes
    ----------
    axes
        Unit vectors of the joint axes in their own frames, shape (joints, 3).
    spans_m
        Greatest distances of each joint's origin from the previous joint's axis and from its
        origin [m].
    slides
        Mask of the prismatic joints, shape (joints,).
    strokes_m
        How far a prismatic joint moves from 0 at most [m], 0 for others, shape (joints,).
    """

    def __init__(self, model: Any) -> None:
        data = model.createData()
        turned = []
        for angle_rad in (0.0, np.pi / 2, np.pi):
            pin.forwardKinematics(model, data, np.full(model.nv, angle_rad))
            turned.append(np.array([placement.rotation for placement in data.liMi][1:]))
        # For any axis, a joint's rotation is still + sin q quarter + (1 - cos q) half.
        self._still, quarter, half = turned
        self._half = (half - self._still) / 2
        self._quarter = quarter - self._still - self._half
        cross = times(np.swapaxes(self._still, 1, 2), self._quarter)
        self.axes = np.stack([cross[:, 2, 1], cross[:, 0, 2], cross[:, 1, 0]], axis=1)
        placements = list(model.jointPlacements)[1:]
        self._offsets_m = np.array([placement.translation for placement in placements])
        # At pi, after a prismatic joint has moved by as many metres.
        shifts = np.array([placement.translation for placement in data.liMi][1:]) - self._offsets_m
        self.slides: NDArray[np.bool_] = np.abs(shifts).max(axis=1) > 1e-6
        # In the frame before the joint, per metre.
        self._slides = np.where(self.slides[:, np.newaxis], shifts / np.pi, 0.0)
        own_slides = times(np.swapaxes(self._still, 1, 2), self._slides[:, :, np.newaxis])[..., 0]
        self.axes = np.where(self.slides[:, np.newaxis], own_slides, self.axes)
        limits_m = np.maximum(np.abs(model.lowerPositionLimit), np.abs(model.upperPositionLimit))
        self.strokes_m = np.where(self.slides, limits_m, 0.0)
        # The first joint has no predecessor.
        beside = np.cross(self._offsets_m, np.concatenate([np.zeros((1, 3)), self.axes[:-1]]))
        self.spans_m: list[tuple[float, float]] = [
            (float(from_axis_m), float(from_origin_m))
            for from_axis_m, from_origin_m in zip(
                np.linalg.norm(beside, axis=1) + self.strokes_m,
                np.linalg.norm(self._offsets_m, axis=1) + self.strokes_m,
                strict=True,
            )
        ]

    def at(self, joints_rad: Vector) -> tuple[Vector, Vector]:
        """Return rotations and origins [m] of the base's and the joints' frames.

        Parameters
        ----------
        joints_rad
            Joint angles [rad], shape (postures, joints).

        Returns
        -------
        tuple
            Shapes (postures, 1 + joints, 3, 3) and (postures, 1 + joints, 3).
        """
        sines = np.sin(joints_rad)[:, :, np.newaxis, np.newaxis]
        cosines = np.cos(joints_rad)[:, :, np.newaxis, np.newaxis]
        turns = self._still + sines * self._quarter + (1 - cosines) * self._half
        count, joints = joints_rad.shape
        rotations = np.empty((count, joints + 1, 3, 3))
        origins = np.empty((count, joints + 1, 3))
        rotations[:, 0], origins[:, 0] = np.eye(3), 0.0
        for joint in range(joints):
            rotations[:, joint + 1] = times(rotations[:, joint], turns[:, joint])
            if self.slides[joint]:
                strokes = joints_rad[:, joint, np.newaxis] * self._slides[joint]
                shift = (self._offsets_m[joint] + strokes)[:, :, np.newaxis]
                moved = times(rotations[:, joint], shift)[..., 0]
            else:
                moved = times(rotations[:, joint], self._offsets_m[joint])
            origins[:, joint + 1] = origins[:, joint] + moved
        return rotations, origins


Numbers = NDArray[np.intp]

# Solids nearer than this at home overlap because shapes are larger than links [m].
_HOME_GAP_M: Final = 0.001


class ArmBodies:
    """All solids that move with an arm.

    Parameters
    ----------
    model
        The arm's `pinocchio.Model`.
    solids
        Solids, fixed ones first.
    home_rad
        Posture without self-collision, shape (joints,).
    alone
        The arm without its load, if already built: `solids` starts with its solids.
    checks_itself
        False if the solids may touch each other.

    Attributes
    ----------
    still
        Number of fixed solids.
    reach_m
        Maximum distance of each solid's points from each joint axis in any posture [m]; 0 for
        joints that do not move it, and 1 for prismatic joints. Shape (solids, joints). A path
        whose joints move by at most some steps moves no point of a solid by more than the sum of
        its reaches times these steps.
    pairs
        Numbers of solids that may collide, the one nearer to the base first. Neighbours and solids
        that overlap at home are left out.
    pair_numbers
        The pairs as an array, shape (pairs, 2).
    pair_reach_m
        Like `reach_m`, for the motion of the second solid relative to the first, shape (pairs,
        joints).
    """

    def __init__(
        self,
        model: Any,
        solids: Sequence[MovingSolid],
        home_rad: Vector,
        alone: ArmBodies | None = None,
        *,
        checks_itself: bool = True,
    ) -> None:
        self.model = model
        self.solids = tuple(solids)
        self.frames: ArmFrames = ArmFrames(model) if alone is None else alone.frames
        self.still = sum(solid.joint == 0 for solid in solids)
        known = 0 if alone is None else len(alone.solids)
        reach_m = [_compute_reach_m(self.frames, solid) for solid in self.solids[known:]]
        self.reach_m = np.array(reach_m).reshape(-1, model.nv)
        candidates = [
            (a, b)
            for b, outer in enumerate(self.solids[known:] if checks_itself else (), known)
            for a, inner in enumerate(self.solids)
            if outer.joint - inner.joint >= 2
            and not (outer.of_arm and inner.of_arm and (inner.joint, outer.joint) in outer.overlaps)
        ]
        self.pairs = _select_apart(self, candidates, home_rad)
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
        """Return a new `pinocchio.GeometryModel` of the solids, with the same numbers."""
        geometry = pin.GeometryModel()
        for number, solid in enumerate(self.solids):
            geometry.addGeometryObject(
                pin.GeometryObject(f"solid {number}", solid.joint, solid.frame, solid.geometry)
            )
        for pair in pairs:
            geometry.addCollisionPair(pin.CollisionPair(*pair))
        return geometry


class SolidSpheres:
    """Spheres about solids: one bounding sphere each, and covering balls.

    Attributes
    ----------
    joints, centres_m, radii_m
        Bounding spheres, shapes (solids,), (solids, 3) and (solids,); centres in joint frames.
    ball_joints, ball_centres_m, ball_radii_m
        The same for all balls.
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
            Numbers of solids, at least one.

        Returns
        -------
        tuple
            Numbers of the balls, grouped by solid; index into `solids` for each ball; and the first
            index of each group.
        """
        rows = [self._balls[solid] for solid in solids.tolist()]
        counts = [len(row) for row in rows]
        owners = np.repeat(np.arange(len(rows)), counts)
        return np.concatenate(rows), owners, np.cumsum([0, *counts[:-1]])

    def ball_pairs(self, pairs: Sequence[tuple[int, int]]) -> tuple[Numbers, Numbers, Numbers]:
        """Return all pairs of balls for pairs of solids.

        Parameters
        ----------
        pairs
            Pairs of solids, at least one.

        Returns
        -------
        tuple
            Numbers of the first and of the second balls, and the first index of each pair.
        """
        ones = [np.repeat(self._balls[a], len(self._balls[b])) for a, b in pairs]
        others = [np.tile(self._balls[b], len(self._balls[a])) for a, b in pairs]
        firsts = np.cumsum([0, *(len(row) for row in ones[:-1])])
        return np.concatenate(ones), np.concatenate(others), firsts


def _select_apart(
    bodies: ArmBodies, pairs: Sequence[tuple[int, int]], home_rad: Vector
) -> tuple[tuple[int, int], ...]:
    """Return the pairs that do not overlap at home."""
    geometry = bodies.geometry(pairs)
    nearness = geometry.createData()
    pin.computeDistances(bodies.model, bodies.model.createData(), geometry, nearness, home_rad)
    gaps_m = [distance.min_distance for distance in nearness.distanceResults]
    return tuple(pair for pair, gap_m in zip(pairs, gaps_m, strict=True) if gap_m >= _HOME_GAP_M)


def _compute_reach_m(frames: ArmFrames, solid: MovingSolid) -> Vector:
    """Return the maximum distance of a solid's points from each joint axis [m].

    The bound adds the distances from axis to next origin along the chain (triangle inequality).
    """
    centres, radius_m = solid.balls
    reaches_m = np.zeros(len(frames.axes))
    if not solid.joint:
        return reaches_m
    # Distances from the axis of its own joint and from the origin of that joint's frame.
    squares = (centres**2).sum(axis=1)
    from_axis = squares - (centres @ frames.axes[solid.joint - 1]) ** 2
    from_axis_m = math.sqrt(max(float(from_axis.max()), 0.0)) + radius_m
    away_m = math.sqrt(float(squares.max())) + radius_m
    for joint in range(solid.joint, 0, -1):
        reaches_m[joint - 1] = 1.0 if frames.slides[joint - 1] else from_axis_m
        beside_m, offset_m = frames.spans_m[joint - 1]
        from_axis_m = away_m + beside_m
        away_m += offset_m
    return reaches_m
