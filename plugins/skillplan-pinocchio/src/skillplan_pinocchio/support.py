"""Static support of released parts: contacts beneath them, and whether they tip."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from skillplan.collision.contact_forces import BEARS, collect_pushes
from skillplan.collision.standing import Touch, Weight, decide_standing
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
        weight = Weight(1.0, (*self.centre, self.height_m), self.reach_m)
        touch = Touch(self.body, "", points, normals)
        return decide_standing({self.body: weight}, [touch]).stands


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
    feet = _Levels(pieces, -1, tolerance_m)
    others = tuple(obstacle for obstacle in obstacles if obstacle.body != body)
    contacts = []
    for obstacle in others:
        near = [piece for piece in obstacle.pieces if feet.may_stand_on(piece, tolerance_m)]
        tops = _Levels(near, 1, tolerance_m)
        polygons = tuple(
            common
            for top, foot in tops.iterate_near(feet, tolerance_m)
            if (common := intersect(feet.outline(foot), tops.outline(top)))
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
    pairs = (
        (
            piece.surface,
            other.surface,
            np.maximum(piece.low, other.low) - tolerance_m,
            np.minimum(piece.high, other.high) + tolerance_m,
        )
        for piece in pieces
        for other in others
        if may_touch(piece, other, -2 * tolerance_m)
    )
    points, normals = collect_pushes(pairs, tolerance_m)
    pushes = zip(points.tolist(), normals.tolist(), strict=True)
    return [((a[0], a[1], a[2]), (b[0], b[1], b[2])) for a, b in pushes]


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


class _Levels:
    """Level faces of pieces: the highest or lowest of a convex one, level triangles of a surface.

    Parameters
    ----------
    side
        1 for faces that look upwards, -1 for downwards.
    tolerance_m
        Difference of heights within one face [m], >= 0.
    """

    def __init__(self, pieces: Iterable[ConvexPiece], side: int, tolerance_m: float) -> None:
        self._corners: list[Array] = []
        self._heights_m: list[float] = []
        boxes: list[tuple[Array, Array]] = []
        for piece in pieces:
            if isinstance(piece, SurfacePiece):
                faces = _select_level(piece, side)
                heights_m = faces[:, :, 2].sum(axis=1) / 3
            else:
                height_m = piece.high[2] if side > 0 else piece.low[2]
                level = np.abs(piece.corners[:, 2] - height_m) <= tolerance_m
                faces, heights_m = piece.corners[np.newaxis, level], np.array([height_m])
            if faces.shape[1] > 2:
                planar = faces[:, :, :2]
                self._corners += list(planar)
                self._heights_m += heights_m.tolist()
                boxes.append((planar.min(axis=1), planar.max(axis=1)))
        self._low, self._high = (
            np.concatenate([np.empty((0, 2)), *(box[end] for box in boxes)]) for end in (0, 1)
        )
        self._outlines: dict[int, Polygon] = {}

    def may_stand_on(self, piece: ConvexPiece, tolerance_m: float) -> bool:
        """Return whether the boxes of some faces and of a piece overlap."""
        if not self._corners:
            return False
        (x, y, z), (right, far, top) = piece.low, piece.high
        heights_m = self._heights_m
        return bool(
            min(heights_m) <= top + tolerance_m
            and max(heights_m) >= z - tolerance_m
            and (self._low < (right, far)).all(axis=1).any()
            and (self._high > (x, y)).all(axis=1).any()
        )

    def iterate_near(self, others: _Levels, tolerance_m: float) -> Iterator[tuple[int, int]]:
        """Yield the numbers of the pairs at one height whose boxes overlap, in order."""
        heights_m = np.array(others._heights_m)
        for number, height_m in enumerate(self._heights_m if len(heights_m) else ()):
            near = np.abs(heights_m - height_m) <= tolerance_m
            near &= (self._low[number] < others._high).all(axis=1)
            near &= (others._low < self._high[number]).all(axis=1)
            yield from ((number, other) for other in np.flatnonzero(near).tolist())

    def outline(self, number: int) -> Polygon:
        """Return the outline of a face, seen from above, counter-clockwise [m]."""
        if number not in self._outlines:
            points = self._corners[number].tolist()
            self._outlines[number] = compute_planar_hull((x, y) for x, y in points)
        return self._outlines[number]


def _select_level(piece: SurfacePiece, side: int) -> Array:
    """Return the corners of the level triangles of a surface, shape (triangles, 3, 3) [m]."""
    corners = piece.corners[piece.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    steep = np.linalg.norm(normals[:, :2], axis=1) > _LEVEL * np.abs(normals[:, 2])
    return np.asarray(corners[~steep & (normals[:, 2] * side > 0)])


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
