"""Convex pieces and closed surfaces for coal, with bounding boxes, and obstacles made of them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Final

import coal
import numpy as np
from numpy.typing import NDArray

from skillplan.task.motion import Point
from skillplan.task.scene import WORLD, Body, Pose, Scene, Zone
from skillplan.task.shape import Box, Cylinder, Mesh, Shape
from skillplan_pinocchio.kinematics.fixed_order import times

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# Corners of a cylinder's circle; neither corners nor sides deviate by more than 0.06 % of the
# radius.
_CIRCLE: Final = 64
# Number of cells along a piece, each of which keeps one corner if it has too many.
_CELLS: Final = 40
# Half width and thickness of the table: bodies cannot pass through it [m].
_TABLE_HALF_WIDTH_M: Final = 5.0
_TABLE_THICKNESS_M: Final = 1.0
# Largest number of triangles in which the depth of an overlap is measured, and smaller numbers that
# are tried before, as one deep triangle may suffice.
_MOST_TOUCHES: Final = 2_000
_FIRST_TOUCHES: Final = (1, 8)

# Accuracy of a distance that coal measures [m].
_ACCURACY_M: Final = 1e-5

# Triangles in a tree of boxes.
_TREE: Final = coal.BVHModelOBBRSS

# Hulls and trees that are kept, of about 20 kB and 1 MB each.
_HULLS: Final = 4_096
_TREES: Final = 64

STILL: Final = coal.Transform3s()
"""The placement of a geometry that is not moved."""


# Directions across a piece in which its width is measured, and its least share afterwards.
_CALIPERS, _LEAST_SHARE = 24, 0.02


# Three of four were built before, for another grasp, skill or trial of a task.
@lru_cache(maxsize=_HULLS)
def _build_hull(coordinates: bytes) -> Any:
    points = coal.StdVec_Vec3s()
    points.extend(list(np.frombuffer(coordinates).reshape(-1, 3)))
    return coal.Convex.convexHull(points, True, "Qt")


@lru_cache(maxsize=_TREES)
def _build_tree(coordinates: bytes, indices: bytes) -> Any:
    points, triangles = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    points.extend(list(np.frombuffer(coordinates).reshape(-1, 3)))
    for a, b, c in np.frombuffer(indices, dtype=np.int64).reshape(-1, 3).tolist():
        triangles.append(coal.Triangle(a, b, c))
    tree = _TREE()
    tree.beginModel(len(triangles), len(points))
    tree.addSubModel(points, triangles)
    tree.endModel()
    return tree


def _thin_out(corners: Array) -> Array:
    """Return fewer corners, the hull of which contains all.

    coal refuses corners with more than 255 neighbours, such as the tip of a fine cone.
    """
    low, high = corners.min(axis=0), corners.max(axis=0)
    cells = np.floor((corners - low) / ((high - low).max() / _CELLS)).astype(np.int64)
    few = corners[np.unique(cells, axis=0, return_index=True)[1]]
    middle = few.mean(axis=0)
    points, triangles = ConvexPiece(few).surface
    faces = points[triangles] - middle
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    heights = np.einsum("fi,fi->f", normals, faces[:, 0])
    is_flat = np.abs(heights) < 1e-9 * np.abs(heights).max()
    shares = ((corners - middle) @ normals[~is_flat].T / heights[~is_flat]).max()
    return np.asarray(middle + max(1.0, float(shares)) * (few - middle))


@dataclass(frozen=True)
class ConvexPiece:
    """A convex polyhedron in the world.

    Parameters
    ----------
    corners
        Corners in the world [m], shape (corners, 3).
    """

    corners: Array

    @cached_property
    def low(self) -> tuple[float, float, float]:
        """Lower corner of the bounding box [m]."""
        x, y, z = self.corners.min(axis=0).tolist()
        return (x, y, z)

    @cached_property
    def high(self) -> tuple[float, float, float]:
        """Upper corner of the bounding box [m]."""
        x, y, z = self.corners.max(axis=0).tolist()
        return (x, y, z)

    @cached_property
    def hull(self) -> Any:
        """Convex hull for coal, a little wider if it has corners that coal refuses."""
        try:
            return _build_hull(self.corners.tobytes())
        except RuntimeError as error:
            if "neighbors" not in str(error):
                raise
            return _build_hull(_thin_out(self.corners).tobytes())

    @property
    def surface(self) -> tuple[Array, Indices]:
        """Corners of the surface [m], and triangles as three indices each."""
        hull = self.hull
        faces = [hull.polygons(number) for number in range(hull.num_polygons)]
        triangles = [(int(face[0]), int(face[1]), int(face[2])) for face in faces]
        return np.asarray(hull.points()), np.array(triangles, dtype=np.int64)

    def swept(self, by: Sequence[float]) -> ConvexPiece:
        """Return the exact swept volume along a straight line: the hull of both ends."""
        return ConvexPiece(np.concatenate([self.corners, self.corners + np.array(by)]))

    def narrowed(self, along: Sequence[float], by_m: float) -> ConvexPiece:
        """Return the piece with its sides at least so far inside, but not flat.

        Parameters
        ----------
        along
            Unit vector that its sides are parallel to.
        by_m
            Distance by which they are shifted [m], >= 0.
        """
        axis = np.array(along)
        first = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
        first /= np.linalg.norm(first)
        turns = np.pi * np.arange(_CALIPERS) / _CALIPERS
        across = np.outer(np.cos(turns), first) + np.outer(np.sin(turns), np.cross(axis, first))
        centre = (self.corners.min(axis=0) + self.corners.max(axis=0)) / 2
        away = self.corners - centre
        reach_m = away @ across.T
        least_m = float(np.minimum(reach_m.max(axis=0), -reach_m.min(axis=0)).min())
        share = max(1 - by_m / least_m, _LEAST_SHARE) if least_m > 0 else 1.0
        lengthwise = np.outer(away @ axis, axis)
        return ConvexPiece(centre + lengthwise + share * (away - lengthwise))

    def seen_from(self, frame: Pose) -> ConvexPiece:
        """Transform the piece into the parent frame of a pose."""
        return ConvexPiece(place_at(self.corners, frame))


@dataclass(frozen=True)
class SurfacePiece(ConvexPiece):
    """A closed surface of a fixed body; it need not be convex.

    Parameters
    ----------
    faces
        Triangles as three indices each, anticlockwise from outside.
    """

    faces: Indices

    @cached_property
    def hull(self) -> Any:
        """Triangles in a tree of boxes, for coal."""
        return _build_tree(self.corners.tobytes(), self.faces.astype(np.int64).tobytes())

    @property
    def surface(self) -> tuple[Array, Indices]:
        """Corners of the surface [m], and triangles as three indices each."""
        return self.corners, self.faces

    def seen_from(self, frame: Pose) -> SurfacePiece:
        """Transform the piece into the parent frame of a pose."""
        return SurfacePiece(place_at(self.corners, frame), self.faces)


@dataclass(frozen=True, slots=True)
class Nearness:
    """Distance between two shapes.

    Parameters
    ----------
    distance_m
        Distance; negative for the penetration depth.
    position
        Midpoint of the two nearest or deepest points [m].
    """

    distance_m: float
    position: Point


def measure_distance(
    piece: ConvexPiece, other: ConvexPiece, by: Sequence[float] | None = None
) -> Nearness:
    """Return the distance between two pieces, the first displaced by a vector [m] if given."""
    at = STILL if by is None else coal.Transform3s(np.eye(3), np.array(by))
    return measure_geometry_distance(piece.hull, at, other.hull, STILL)


def measure_geometry_distance(geometry: Any, at: Any, other: Any, other_at: Any) -> Nearness:
    """Return the distance between two geometries of coal at their placements.

    The depth of a convex body in a tree of triangles is that of the deepest triangle: no move
    shorter than this parts the two, whereas coal's distance is that of the first one it finds.
    """
    result = coal.DistanceResult()
    distance_m = measure_gap(geometry, at, other, other_at, result)
    if distance_m <= 0 and isinstance(other, _TREE) and not isinstance(geometry, _TREE):
        deepest = _measure_depth(geometry, at, other, other_at)
        if deepest is not None:
            return deepest
    middle = (result.getNearestPoint1() + result.getNearestPoint2()) / 2
    x, y, z = (round(float(value), 6) for value in middle)
    return Nearness(distance_m, (x, y, z))


def measure_gap(
    geometry: Any, at: Any, other: Any, other_at: Any, result: Any | None = None
) -> float:
    """Return the distance between two geometries of coal [m], <= 0 if they overlap.

    A value below 0 is the penetration depth only if both are convex.
    """
    result = coal.DistanceResult() if result is None else result
    return float(coal.distance(geometry, at, other, other_at, coal.DistanceRequest(), result))


def bound_gap(
    geometry: Any, at: Any, other: Any, other_at: Any, tolerance_m: float
) -> float | None:
    """Return a lower bound of the distance between two geometries of coal [m].

    Parameters
    ----------
    tolerance_m
        Depth of an overlap beyond which there is no bound, but None [m], >= 0. Bounds of smaller
        overlaps are negative.
    """
    if not isinstance(other, _TREE):
        gap_m = measure_gap(geometry, at, other, other_at)
        return gap_m - _ACCURACY_M if gap_m >= -tolerance_m else None
    # A triangle that is met first is often deep enough, and all of them take long.
    for most in (*_FIRST_TOUCHES, _MOST_TOUCHES):
        result = _collide(geometry, at, other, other_at, most)
        depths_m = [-contact.penetration_depth for contact in result.getContacts()]
        if any(depth_m > tolerance_m for depth_m in depths_m):
            return None
        if len(depths_m) < most:
            break
    gap_m = 0.0 if depths_m else max(0.0, float(result.distance_lower_bound))
    return gap_m - _ACCURACY_M


def is_deeper(geometry: Any, at: Any, other: Any, other_at: Any, tolerance_m: float) -> bool:
    """Return whether two geometries of coal overlap by more than a tolerance [m], >= 0."""
    return bound_gap(geometry, at, other, other_at, tolerance_m) is None


def _measure_depth(geometry: Any, at: Any, other: Any, other_at: Any) -> Nearness | None:
    """Return the depth of the deepest triangle, or None if none is penetrated."""
    contacts = _collide(geometry, at, other, other_at, _MOST_TOUCHES).getContacts()
    deepest = min(contacts, key=lambda contact: contact.penetration_depth, default=None)
    if deepest is None or deepest.penetration_depth >= 0:
        return None
    x, y, z = (round(float(value), 6) for value in deepest.pos)
    return Nearness(float(deepest.penetration_depth), (x, y, z))


def _collide(geometry: Any, at: Any, other: Any, other_at: Any, most: int) -> Any:
    """Return contacts with the triangles of a tree, up to a number of them."""
    request, result = coal.CollisionRequest(), coal.CollisionResult()
    request.enable_contact, request.num_max_contacts = True, most
    coal.collide(geometry, at, other, other_at, request, result)
    return result


def may_touch(piece: ConvexPiece, other: ConvexPiece, tolerance_m: float) -> bool:
    """Return whether the bounding boxes of two pieces overlap by more than the tolerance."""
    # Written out, as most pairs of an approach end here.
    (x, y, z), (to_x, to_y, to_z) = piece.low, piece.high
    (other_x, other_y, other_z), (other_to_x, other_to_y, other_to_z) = other.low, other.high
    return (
        x + tolerance_m < other_to_x
        and other_x + tolerance_m < to_x
        and y + tolerance_m < other_to_y
        and other_y + tolerance_m < to_y
        and z + tolerance_m < other_to_z
        and other_z + tolerance_m < to_z
    )


def make_pieces(body: Body, pose: Pose) -> tuple[ConvexPiece, ...]:
    """Return the convex pieces of a moving body at a pose."""
    return tuple(ConvexPiece(place_at(get_corners(shape), pose)) for shape in body.shapes)


def make_standing_pieces(body: Body, pose: Pose) -> tuple[ConvexPiece, ...]:
    """Return the exact shapes of a fixed body at a pose."""
    return tuple(
        SurfacePiece(place_at(get_corners(shape), pose), np.array(shape.faces, dtype=np.int64))
        if isinstance(shape, Mesh) and not shape.convex
        else ConvexPiece(place_at(get_corners(shape), pose))
        for shape in body.exact_shapes
    )


def make_shank_pieces(body: Body, pose: Pose) -> tuple[ConvexPiece, ...]:
    """Return the shank of a screw at a pose; empty for other bodies."""
    shank = body.shank
    return () if shank is None else (ConvexPiece(place_at(get_corners(shank.shape), pose)),)


def place_at(corners: Array, pose: Pose) -> Array:
    """Transform corners into the parent frame of a pose, shape (corners, 3)."""
    if pose.is_upright:
        return place_upright(corners, pose.position, pose.yaw_rad)
    return np.asarray(times(corners, np.array(pose.rotation).T) + np.array(pose.position))


def place_upright(corners: Array, origin: Sequence[float], yaw_rad: float) -> Array:
    """Rotate corners about the vertical and displace them, shape (corners, 3)."""
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(times(corners, turn) + np.array(origin))


def get_corners(shape: Shape) -> Array:
    """Return the corners of a shape in the frame of its body [m], shape (corners, 3)."""
    if isinstance(shape, Box):
        return compute_box_corners(shape)
    if isinstance(shape, Cylinder):
        return compute_cylinder_corners(shape)
    return np.array(shape.corners, dtype=float)


def compute_box_corners(box: Box) -> Array:
    """Return the eight corners of a box [m], shape (8, 3)."""
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    return np.asarray(np.array(box.centre) + signs * np.array(box.size) / 2)


def compute_cylinder_corners(cylinder: Cylinder) -> Array:
    """Return the corners of a prism that approximates an upright cylinder [m]."""
    half = math.pi / _CIRCLE
    radius_m = cylinder.diameter_m / (1 + math.cos(half))
    ring = [
        (radius_m * math.cos(2 * half * number), radius_m * math.sin(2 * half * number))
        for number in range(_CIRCLE)
    ]
    z_m = cylinder.height_m / 2
    rings = [(x, y, z) for z in (-z_m, z_m) for x, y in ring]
    return np.asarray(np.array(rings) + np.array(cylinder.centre))


def make_table() -> ConvexPiece:
    """Return the table as a piece."""
    size = (2 * _TABLE_HALF_WIDTH_M, 2 * _TABLE_HALF_WIDTH_M, _TABLE_THICKNESS_M)
    return ConvexPiece(compute_box_corners(Box(size, (0.0, 0.0, -_TABLE_THICKNESS_M / 2))))


TABLE: Final = "the table"


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A body at a place where a fact puts it.

    Parameters
    ----------
    fact
        Fact that holds while it is there; None for a permanent body.
    zone
        Zone that it stands for; None for a body. A zone bears nothing and may let arm or load in.
    """

    body: str
    fact: str | None
    pieces: tuple[ConvexPiece, ...]
    zone: Zone | None = None

    def stops(self, *, load: bool) -> bool:
        """Return whether the load, or otherwise the arm, must not touch it."""
        return self.zone is None or ("load" if load else "arm") in self.zone.keeps_out

    @property
    def top_m(self) -> float:
        """Height of its highest point [m]."""
        return max(piece.high[2] for piece in self.pieces)


def collect_obstacles(scene: Scene) -> tuple[Obstacle, ...]:
    """Return the table, all bodies at all their solid places, and keep-out zones."""
    return (
        Obstacle(TABLE, None, (make_table(),)),
        *(
            Obstacle(
                body.name,
                placement.fact,
                (
                    *make_standing_pieces(body, placement.pose),
                    *make_shank_pieces(body, placement.pose),
                ),
            )
            for body in scene.bodies
            for placement in body.placements
            if placement.solid and placement.frame == WORLD
        ),
        *(make_zone_obstacle(zone) for zone in scene.zones if zone.keeps_out),
    )


def make_zone_obstacle(zone: Zone) -> Obstacle:
    """Return a keep-out zone as a permanent obstacle."""
    pieces = make_zone_pieces(zone.pieces, zone.low_m, zone.high_m)
    return Obstacle(zone.label, None, pieces, zone)


def make_zone_pieces(
    outlines: Iterable[Sequence[tuple[float, float]]], low_m: float, high_m: float
) -> tuple[ConvexPiece, ...]:
    """Return prisms over convex polygons between two heights [m]."""
    return tuple(
        ConvexPiece(np.array([(x, y, z) for z in (low_m, high_m) for x, y in outline], dtype=float))
        for outline in outlines
    )
