"""Static support of released parts: contacts beneath them, and whether they tip."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from skillplan_pinocchio.shapes import ConvexPiece, Obstacle, SurfacePiece

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
        Contact areas, seen from above [m].
    """

    body: str
    fact: str | None
    polygons: tuple[Polygon, ...]


@dataclass(frozen=True)
class Supports:
    """All possible supports of a body at a place.

    Parameters
    ----------
    centre
        Centre of mass, seen from above [m].
    """

    body: str
    centre: Planar
    contacts: tuple[Contact, ...]
    _known: dict[tuple[bool, ...], bool] = field(default_factory=dict, compare=False, repr=False)

    def hold(self, there: Sequence[bool]) -> bool:
        """Return whether the centre of mass is above the hull of the present contacts.

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
            self._known[key] = bool(corners) and _is_within(
                self.centre, compute_planar_hull(corners)
            )
        return self._known[key]


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
    contacts = []
    for obstacle in obstacles if feet else ():
        if obstacle.body == body:
            continue
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
    return Supports(body, _compute_centre(pieces), tuple(contacts))


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


def _compute_centre(pieces: Iterable[ConvexPiece]) -> Planar:
    total = x = y = 0.0
    for piece in pieces:
        volume, middle = float(piece.hull.computeVolume()), piece.hull.computeCOM()
        total += volume
        x += volume * float(middle[0])
        y += volume * float(middle[1])
    return (x / total, y / total)


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
