"""A home posture for an arm without one: free of collision, with room for every joint.

Of postures spread over the joint ranges, the best points its hand down in front of the base, far
from limits and singularities, and no two links that are not neighbours touch.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from typing import Final

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from skillplan.robots.arm_description import ArmDescription, Capsule, Hull, LinkShape
from skillplan.robots.link_frames import Numbers, compute_link_frames, follow, spread_postures

_SAMPLES: Final = 3_000
_SHARE_OF_RANGE: Final = 0.85
# Number of postures tested for contacts, the best first.
_TESTED: Final = 150
# Number of them that show which shapes overlap anyway, and the share of them in which they do; of
# links with one link between them, which are rarely near each other in earnest, a smaller share.
_COUNTED: Final = 60
_SHARE, _NEAR_SHARE = 0.5, 0.2
# Height above the underside of the base at which a shape of the first link is cut [m].
_CLEAR_M: Final = 0.01
# Height up to which the underside of a shape of the base counts as a foot [m].
_FOOT_M: Final = 0.01
# Gap that counts as free, and depth that counts as an overlap [m].
_GAP_M: Final = 0.005
_DEEP_M: Final = 0.003
# Place of the tip that is preferred, as a share of the greatest distance seen.
_FAR, _HIGH = 0.6, 0.3
# Least singular value, in lengths of that distance, of a posture away from singularities.
_LEAST_SINGULAR = 0.12
# Corners that stand for a shape, and sides of a round one.
_DIRECTIONS, _SIDES = 128, 12


def find_home(arm: ArmDescription) -> ArmDescription:
    """Return an arm with a posture as home that has room for every joint.

    Pairs of links that touch in many of the best postures are noted as overlaps: their shapes are
    larger than the links. If links touch in all postures, the fewest contacts decide. Shapes of the
    first link are cut at the underside of the base, which stands on something.
    """
    arm = _cut_at_ground(arm)
    postures = spread_postures(arm, _SAMPLES, _SHARE_OF_RANGE)
    # Half of them face forwards: a joint about the vertical changes no penalty but its own.
    postures[::2, 0] = (arm.low_rad[0] + arm.high_rad[0]) / 2
    postures = follow(arm, postures)
    frames = compute_link_frames(arm, postures)
    order = np.argsort(_rate(arm, postures, frames), kind="stable")[:_TESTED]
    solids = _Solids(arm)
    touching = [
        solids.find_contacts([frame[number] for frame in frames[:-1]], -_DEEP_M)
        for number in order[:_COUNTED].tolist()
    ]
    counts = Counter(pair for pairs in touching for pair in pairs)
    overlaps = frozenset(
        pair
        for pair, count in counts.items()
        if count >= len(touching) * (_NEAR_SHARE if pair[1] - pair[0] == 2 else _SHARE)
    )
    best, fewest = int(order[0]), math.inf
    for number in order.tolist():
        pairs = solids.find_contacts([frame[number] for frame in frames[:-1]], _GAP_M)
        contacts = len(pairs - overlaps)
        if contacts < fewest:
            best, fewest = number, contacts
        if not contacts:
            break
    low, high = np.array(arm.low_rad), np.array(arm.high_rad)
    home = np.clip(np.round(postures[best], 3), low, high)
    home_rad = arm.follow([float(value) for value in home])
    return replace(arm, home_rad=home_rad, overlaps=tuple(sorted(overlaps)))


def _cut_at_ground(arm: ArmDescription) -> ArmDescription:
    """Return an arm whose first link has no shape below the base."""
    if len(arm.shapes) < 2 or not arm.shapes[0] or not arm.shapes[1]:
        return arm
    feet_m = [float(list_corners(shape)[:, 2].min()) for shape in arm.shapes[0]]
    # A base that stands at its origin may have a coarse shape that reaches deeper.
    ground_m = max((foot_m for foot_m in feet_m if foot_m <= _FOOT_M), default=min(feet_m))
    frame = compute_link_frames(arm, np.array([arm.home_rad]))[1][0]
    kept = tuple(
        piece
        for shape in arm.shapes[1]
        if (piece := _cut_below(shape, frame[2], ground_m)) is not None
    )
    if kept == arm.shapes[1]:
        return arm
    note = "shapes of the first link are cut at the underside of the base"
    shapes = (arm.shapes[0], kept, *arm.shapes[2:])
    return replace(arm, shapes=shapes, assumptions=(*arm.assumptions, note))


def _cut_below(shape: LinkShape, height: Numbers, ground_m: float) -> LinkShape | None:
    """Return the part of a shape above a plane, None if there is none.

    Parameters
    ----------
    height
        Row that gives the height of a point in the frame of the shape, shape (4,).
    """
    corners = list_corners(shape)
    # The gap keeps it clear of what the base stands on.
    above_m = corners @ height[:3] + height[3] - ground_m - _CLEAR_M
    if above_m.min() >= 0:
        return shape
    up, down = corners[above_m > 0], corners[above_m < 0]
    over_m, under_m = above_m[above_m > 0][:, None], -above_m[above_m < 0][None, :]
    shares = (over_m / (over_m + under_m))[..., None]
    crossing = (up[:, None] + shares * (down[None] - up[:, None])).reshape(-1, 3)
    points = np.concatenate([up, crossing])
    try:
        points = points[ConvexHull(points).vertices]
    except (QhullError, ValueError):
        return None
    return Hull(tuple((float(x), float(y), float(z)) for x, y, z in points))


def _rate(arm: ArmDescription, postures: Numbers, frames: list[Numbers]) -> Numbers:
    """Return penalties of postures, lower is better, shape (postures,)."""
    tips = frames[-1]
    places = tips[:, :3, 3]
    far_m = np.hypot(places[:, 0], places[:, 1])
    reach_m = max(float(np.linalg.norm(places, axis=1).max()), 1e-3)
    tilt_rad = np.arccos(np.clip(-tips[:, 2, 2], -1.0, 1.0))
    low, high = np.array(arm.low_rad), np.array(arm.high_rad)
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, 1e-9)
    crowded = (((postures - middle) / half) ** 2).mean(axis=1)
    columns = []
    for number, joint in enumerate(arm.joints):
        frame = frames[number + 1]
        axis = frame[:, :3, :3] @ np.array(joint.axis)
        along = axis if joint.is_prismatic else np.cross(axis, places - frame[:, :3, 3])
        turn = np.zeros_like(axis) if joint.is_prismatic else axis
        columns.append(np.concatenate([along / reach_m, turn], axis=1))
    singular = np.linalg.svd(np.stack(columns, axis=2), compute_uv=False)[:, -1]
    return np.asarray(
        tilt_rad
        + 1.5 * np.abs(far_m / reach_m - _FAR)
        + 0.5 * np.abs(places[:, 2] / reach_m - _HIGH)
        + 0.5 * crowded
        + 0.3 * np.abs((postures[:, 0] - middle[0]) / half[0])
        + np.maximum(1 - singular / _LEAST_SINGULAR, 0.0)
    )


class _Solids:
    """Convex solids of an arm and the pairs that may touch."""

    def __init__(self, arm: ArmDescription) -> None:
        self._solids = [
            (body, *_outline(shape)) for body, shapes in enumerate(arm.shapes) for shape in shapes
        ]
        bodies = np.array([body for body, _, _ in self._solids], dtype=np.int64)
        # Neighbours are left out, as in checks of paths.
        self._pairs = np.argwhere(bodies[np.newaxis] - bodies[:, np.newaxis] >= 2)

    def find_contacts(self, frames: list[Numbers], gap_m: float) -> frozenset[tuple[int, int]]:
        """Return the pairs of bodies nearer than a gap, 0 for the base; < 0 for a depth [m]."""
        placed = []
        for body, corners, planes in self._solids:
            rotation, origin = frames[body][:3, :3], frames[body][:3, 3]
            moved = corners @ rotation.T + origin
            normals = planes[:, :3] @ rotation.T
            centre = moved.mean(axis=0)
            radius_m = float(np.linalg.norm(moved - centre, axis=1).max())
            placed.append((moved, normals, planes[:, 3] - normals @ origin, centre, radius_m))
        touching: set[tuple[int, int]] = set()
        if not len(self._pairs):
            return frozenset()
        centres = np.array([solid[3] for solid in placed])
        radii_m = np.array([solid[4] for solid in placed])
        ones, others = self._pairs.T
        apart_m = np.linalg.norm(centres[ones] - centres[others], axis=1)
        near = apart_m <= radii_m[ones] + radii_m[others] + gap_m
        for first_solid, second_solid in self._pairs[near].tolist():
            key = (self._solids[first_solid][0], self._solids[second_solid][0])
            if key in touching:
                continue
            if not _is_apart(placed[first_solid][:3], placed[second_solid][:3], gap_m):
                touching.add(key)
        return frozenset(touching)


def _is_apart(first: tuple[Numbers, ...], second: tuple[Numbers, ...], gap_m: float) -> bool:
    """Return whether a face of one of two solids separates them; edges are not tried."""
    return any(
        bool(((corners @ normals.T + offsets).min(axis=0) > gap_m).any())
        for normals, offsets, corners in (
            (first[1], first[2], second[0]),
            (second[1], second[2], first[0]),
        )
    )


def _outline(shape: LinkShape) -> tuple[Numbers, Numbers]:
    """Return corners of a shape and planes of its faces, shapes (corners, 3) and (planes, 4)."""
    corners = list_corners(shape)
    if len(corners) > _DIRECTIONS:
        away = (corners - corners.mean(axis=0)) @ _spread_directions().T
        corners = corners[np.unique(np.argmax(away, axis=0))]
    try:
        return corners, np.asarray(ConvexHull(corners).equations)
    except QhullError:
        # A flat shape: its box, which is never thinner than a gap.
        low, high = corners.min(axis=0), corners.max(axis=0)
        return corners, np.concatenate(
            [
                np.column_stack([np.eye(3), -high - _GAP_M]),
                np.column_stack([-np.eye(3), low - _GAP_M]),
            ]
        )


def list_corners(shape: LinkShape) -> Numbers:
    """Return corners of a shape, of a round one on its surface, shape (corners, 3) [m]."""
    if isinstance(shape, Hull):
        return np.array(shape.corners_m)
    start, end = np.array(shape.start_m), np.array(shape.end_m)
    along = end - start
    size_m = float(np.linalg.norm(along))
    z = along / size_m if size_m > 0 else np.array([0.0, 0.0, 1.0])
    aside = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = np.cross(aside, z)
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    angles = 2 * np.pi * np.arange(_SIDES) / _SIDES
    ring = np.cos(angles)[:, None] * x + np.sin(angles)[:, None] * y
    # Rings of a round end: at its edge, and halfway to its top.
    rings = [(0.0, 1.0)]
    if isinstance(shape, Capsule):
        rings += [(math.sqrt(0.5), math.sqrt(0.5)), (1.0, 0.0)]
    radius_m = shape.radius_m
    return np.concatenate(
        [
            centre + side * high * radius_m * z + wide * radius_m * ring
            for centre, side in ((start, -1), (end, 1))
            for high, wide in rings
        ]
    )


def _spread_directions() -> Numbers:
    """Return evenly spread unit vectors (Fibonacci lattice)."""
    number = np.arange(_DIRECTIONS) + 0.5
    z = 1 - 2 * number / _DIRECTIONS
    angle = math.pi * (1 + math.sqrt(5)) * number
    flat = np.sqrt(1 - z * z)
    return np.column_stack([flat * np.cos(angle), flat * np.sin(angle), z])
