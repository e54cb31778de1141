"""Static support of released parts: contacts beneath them, and whether they tip."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from skillplan.collision.contact_forces import BEARS, select_spread, stays_balanced
from skillplan.task.motion import Point
from skillplan_pinocchio.shapes import ConvexPiece, Obstacle, SurfacePiece, may_touch

Array = NDArray[np.float64]
Planar = tuple[float, float]
Polygon = tuple[Planar, ...]

# Minimum area of a supporting contact [m^2].
_LEAST_AREA_M2 = 1e-10
_ROUNDING_M = 1e-9
# Maximum slope of a level face [-].
_LEVEL = 1e-3
_UP = (0.0, 0.0, 1.0)
# Points on each edge, and on all edges, at which two surfaces may touch.
_PER_EDGE, _MOST_SAMPLES = 3, 600
# Largest cosine between an edge that lies on a face and the normal of the face.
_PARALLEL = 0.05


@dataclass(frozen=True, slots=True)
class Contact:
    """A contact that supports a body.

    Parameters
    ----------
    fact
        Fact that holds while the supporting body is there; None if it is permanent.
    polygons
        Level contact areas, seen from above [m].
    pushes
        Points and unit vectors along which the body is pushed there, if no level faces bear it.
    """

    body: str
    fact: str | None
    polygons: tuple[Polygon, ...]
    pushes: tuple[tuple[Point, Point], ...] = ()


@dataclass(frozen=True)
class Supports:
    """All possible supports of a body at a place.

    Parameters
    ----------
    centre
        Centre of mass, seen from above [m].
    height_m
        Height of the centre of mass [m].
    reach_m
        Largest extent of the body [m].
    holders
        Bodies with their facts, each of which holds the body by a fit.
    """

    body: str
    centre: Planar
    contacts: tuple[Contact, ...]
    height_m: float = 0.0
    reach_m: float = 1.0
    holders: tuple[tuple[str, str | None], ...] = ()
    _known: dict[tuple[bool, ...], bool] = field(default_factory=dict, compare=False, repr=False)

    def hold(self, there: Sequence[bool]) -> bool:
        """Return whether the present contacts keep the body in place.

        The centre of mass is above the hull of level contacts, or contact forces balance it.

        Parameters
        ----------
        there
            Presence of each contact, in order.
        """
        key = tuple(there)
        if key not in self._known:
            corners = [
                corner
                for contact, holds in zip(self.contacts, key, strict=True)
                if holds
                for polygon in contact.polygons
                for corner in polygon
            ]
            level = bool(corners) and _is_within(self.centre, compute_planar_hull(corners))
            self._known[key] = level or self._is_balanced(key)
        return self._known[key]

    def _is_balanced(self, there: Sequence[bool]) -> bool:
        pushes = [
            push
            for contact, holds in zip(self.contacts, there, strict=True)
            if holds
            for push in contact.pushes
        ]
        if not pushes:
            return False
        points, normals = (np.array(column) for column in zip(*pushes, strict=True))
        centre = np.array([*self.centre, self.height_m])
        return stays_balanced(points - centre, normals, _UP, self.reach_m)


def find_supports(
    body: str,
    pieces: tuple[ConvexPiece, ...],
    obstacles: Iterable[Obstacle],
    tolerance_m: float,
) -> Supports:
    """Return the possible supports of a body with pieces at a place.

    Parameters
    ----------
    body
        Name of the body; it does not support itself.
    tolerance_m
        Gap or overlap that counts as contact [m], >= 0.
    """
    feet = [level for piece in pieces for level in _iterate_levels(piece, -1, tolerance_m)]
    heights_m = [height_m for height_m, _ in feet]
    others = tuple(obstacle for obstacle in obstacles if obstacle.body != body)
    contacts = []
    for obstacle in others if feet else ():
        polygons = tuple(
            common
            for piece in obstacle.pieces
            for top_m, top in _iterate_levels(piece, 1, tolerance_m, heights_m)
            for foot_m, foot in feet
            if abs(top_m - foot_m) <= tolerance_m
            if (common := intersect(foot, top))
        )
        if polygons:
            contacts.append(Contact(obstacle.body, obstacle.fact, polygons))
    x, y, z = _compute_centre(pieces)
    level = Supports(body, (x, y), tuple(contacts))
    if level.hold([True] * len(contacts)):
        return level
    polygons_of = {(contact.body, contact.fact): contact.polygons for contact in contacts}
    leaning = []
    for obstacle in others:
        pushes = tuple(_find_pushes(pieces, obstacle.pieces, tolerance_m))
        polygons = polygons_of.get((obstacle.body, obstacle.fact), ())
        if pushes or polygons:
            leaning.append(Contact(obstacle.body, obstacle.fact, polygons, pushes))
    if not any(push[1][2] > BEARS for contact in leaning for push in contact.pushes):
        return level
    reach_m = max(
        max(piece.high[axis] for piece in pieces) - min(piece.low[axis] for piece in pieces)
        for axis in range(3)
    )
    balanced = Supports(body, (x, y), tuple(leaning), z, reach_m)
    return balanced if balanced.hold([True] * len(leaning)) else level


def _find_pushes(
    pieces: Sequence[ConvexPiece], others: Sequence[ConvexPiece], tolerance_m: float
) -> list[tuple[Point, Point]]:
    """Return a few points at which others push some pieces, with the unit vectors of the pushes."""
    points: list[Array] = []
    normals: list[Array] = []
    for piece in pieces:
        for other in others:
            if not may_touch(piece, other, -2 * tolerance_m):
                continue
            low = np.maximum(piece.low, other.low) - tolerance_m
            high = np.minimum(piece.high, other.high) + tolerance_m
            for body, face, sign in ((piece, other, 1.0), (other, piece, -1.0)):
                there, normal = _find_touching(body, face, low, high, tolerance_m)
                points.append(there)
                normals.append(sign * normal)
    if not points:
        return []
    everywhere, directions = np.concatenate(points), np.concatenate(normals)
    chosen = select_spread(everywhere, directions)
    pairs = zip(everywhere[chosen].tolist(), directions[chosen].tolist(), strict=True)
    return [((a[0], a[1], a[2]), (b[0], b[1], b[2])) for a, b in pairs]


def _find_touching(
    body: ConvexPiece, face: ConvexPiece, low: Array, high: Array, tolerance_m: float
) -> tuple[Array, Array]:
    """Return points on edges of a body that lie on faces of another, and the faces' normals.

    Parameters
    ----------
    low, high
        Corners of the box in which both may touch [m].
    """
    points, along = _sample_edges(body, low, high)
    corners, triangles = face.surface
    places = corners[triangles]
    near = (places.max(axis=1) >= low).all(axis=1) & (places.min(axis=1) <= high).all(axis=1)
    places = places[near]
    normals = np.cross(places[:, 1] - places[:, 0], places[:, 2] - places[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    places, normals = places[lengths > 0], normals[lengths > 0] / lengths[lengths > 0, None]
    there: list[Array] = []
    pushed: list[Array] = []
    for point, direction in zip(points, along, strict=True):
        heights = np.einsum("ij,ij->i", point - places[:, 0], normals)
        # An edge that passes through a face does not touch it.
        tests = [np.abs(heights) <= tolerance_m, np.abs(normals @ direction) < _PARALLEL]
        for k in range(3):
            side = places[:, (k + 1) % 3] - places[:, k]
            inwards: Array = np.cross(normals, side)
            widths = np.maximum(np.linalg.norm(inwards, axis=1), 1e-30)
            beside = np.einsum("ij,ij->i", point - places[:, k], inwards) / widths
            tests.append(beside >= -tolerance_m)
        over = np.logical_and.reduce(tests)
        if over.any():
            number = int(np.argmin(np.where(over, np.abs(heights), np.inf)))
            there.append(point)
            pushed.append(normals[number])
    return np.array(there).reshape(-1, 3), np.array(pushed).reshape(-1, 3)


def _sample_edges(body: ConvexPiece, low: Array, high: Array) -> tuple[Array, Array]:
    """Return points on the edges of a surface within a box, and directions; corners have none."""
    corners, triangles = body.surface
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    sides = np.unique(sides, axis=0)
    start, along = corners[sides[:, 0]], corners[sides[:, 1]] - corners[sides[:, 0]]
    with np.errstate(divide="ignore", invalid="ignore"):
        bounds = np.stack([(low - start) / along, (high - start) / along])
    still = np.abs(along) < 1e-12
    inside = (start >= low) & (start <= high)
    first = np.where(still, np.where(inside, 0.0, np.inf), bounds.min(axis=0)).max(axis=1)
    last = np.where(still, np.where(inside, 1.0, -np.inf), bounds.max(axis=0)).min(axis=1)
    first, last = np.maximum(first, 0.0), np.minimum(last, 1.0)
    crosses = first <= last
    start, along, first, last = start[crosses], along[crosses], first[crosses], last[crosses]
    shares = first[:, None] + np.linspace(0.0, 1.0, _PER_EDGE) * (last - first)[:, None]
    inner = (start[:, None] + shares[..., None] * along[:, None]).reshape(-1, 3)
    lengths = np.maximum(np.linalg.norm(along, axis=1), 1e-30)
    directions = np.repeat(along / lengths[:, None], _PER_EDGE, axis=0)
    boxed = (corners >= low).all(axis=1) & (corners <= high).all(axis=1)
    ends = corners[boxed]
    points = np.concatenate([ends, inner])
    directions = np.concatenate([np.zeros_like(ends), directions])
    _, first_of = np.unique(np.round(points, 7), axis=0, return_index=True)
    points, directions = points[first_of], directions[first_of]
    step = max(1, math.ceil(len(points) / _MOST_SAMPLES))
    return points[::step], directions[::step]


def compute_planar_hull(points: Iterable[Planar]) -> Polygon:
    """Return the convex hull of points, counter-clockwise (Andrew's monotone chain)."""
    ordered = sorted(set(points))
    if len(ordered) < 3:
        return tuple(ordered)
    halves: list[list[Planar]] = []
    for direction in (ordered, ordered[::-1]):
        half: list[Planar] = []
        for point in direction:
            while len(half) > 1 and _turn(half[-2], half[-1], point) <= 0:
                half.pop()
            half.append(point)
        halves.append(half[:-1])
    return tuple(halves[0] + halves[1])


def intersect(polygon: Polygon, other: Polygon) -> Polygon:
    """Return the intersection of two convex polygons (Sutherland and Hodgman); may be empty."""
    if len(polygon) < 3 or len(other) < 3:
        return ()
    left = list(polygon)
    for begin, end in zip(other, (*other[1:], other[0]), strict=True):
        clipped: list[Planar] = []
        for here, there in zip(left, (*left[1:], *left[:1]), strict=True):
            inside, follows = _turn(begin, end, here), _turn(begin, end, there)
            if inside >= 0:
                clipped.append(here)
            if inside * follows < 0:
                share = inside / (inside - follows)
                clipped.append(
                    (
                        here[0] + share * (there[0] - here[0]),
                        here[1] + share * (there[1] - here[1]),
                    )
                )
        left = clipped
    return tuple(left) if len(left) > 2 and _compute_area_m2(left) > _LEAST_AREA_M2 else ()


def _iterate_levels(
    piece: ConvexPiece, side: int, tolerance_m: float, near: Sequence[float] = ()
) -> Iterator[tuple[float, Polygon]]:
    """Yield the level faces of a piece with their heights, upward (1) or downward (-1).

    The highest or lowest face of a convex piece, all level triangles of a surface. If `near` is
    given, only faces near one of these heights.
    """
    if not isinstance(piece, SurfacePiece):
        height_m = piece.high[2] if side > 0 else piece.low[2]
        if near and all(abs(height_m - level_m) > tolerance_m for level_m in near):
            return
        face = _find_face(piece, height_m, tolerance_m)
        if len(face) > 2:
            yield height_m, face
        return
    corners = piece.corners[piece.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    steep = np.linalg.norm(normals[:, :2], axis=1) > _LEVEL * np.abs(normals[:, 2])
    for number in np.flatnonzero(~steep & (normals[:, 2] * side > 0)):
        triangle = corners[number].tolist()
        height_m = sum(corner[2] for corner in triangle) / 3
        yield height_m, compute_planar_hull((x, y) for x, y, _ in triangle)


def _find_face(piece: ConvexPiece, height_m: float, tolerance_m: float) -> Polygon:
    return compute_planar_hull(
        (float(x), float(y))
        for x, y, z in piece.corners.tolist()
        if abs(z - height_m) <= tolerance_m
    )


def _compute_centre(pieces: Iterable[ConvexPiece]) -> Point:
    total = x = y = z = 0.0
    for piece in pieces:
        volume, middle = float(piece.hull.computeVolume()), piece.hull.computeCOM()
        total += volume
        x += volume * float(middle[0])
        y += volume * float(middle[1])
        z += volume * float(middle[2])
    return (x / total, y / total, z / total)


def _is_within(point: Planar, polygon: Polygon) -> bool:
    if len(polygon) < 3:
        return False
    for begin, end in zip(polygon, (*polygon[1:], polygon[0]), strict=True):
        length_m = ((end[0] - begin[0]) ** 2 + (end[1] - begin[1]) ** 2) ** 0.5
        if _turn(begin, end, point) < -_ROUNDING_M * length_m:
            return False
    return True


def _compute_area_m2(polygon: Sequence[Planar]) -> float:
    return sum(
        (a[0] * b[1] - b[0] * a[1]) / 2
        for a, b in zip(polygon, (*polygon[1:], polygon[0]), strict=True)
    )


def _turn(origin: Planar, a: Planar, b: Planar) -> float:
    return (a[0] - origin[0]) * (b[1] - origin[1]) - (a[1] - origin[1]) * (b[0] - origin[0])
