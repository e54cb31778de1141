"""Solids in space as they are seen on paper: from where, in which order, and how light falls."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from skillplan.task.pose import Point as Point3
from skillplan.task.pose import Pose
from skillplan.task.scene import Body
from skillplan.views.pictures.drawing import Item, Look, Point, Shape, hull
from skillplan.views.pictures.outlines import corners_of, faces_of

_ELEVATION = math.radians(26)
# A shape with more faces is drawn by its outline.
_MOST_FACES = 300
# With fewer, its edges are drawn.
_FEW_FACES = 24
# Where the light is: towards the eye, to its right, and up.
_LIGHT = (0.5, -0.3, 0.81)


@dataclass(frozen=True, slots=True)
class View:
    """From where it is looked at: an angle about the vertical [rad]."""

    azimuth: float

    def seen(self, point: Point3) -> Point:
        """Return a point on paper [m], x to the right and y up."""
        x, y, z = point
        right = y * math.cos(self.azimuth) - x * math.sin(self.azimuth)
        return (right, z * math.cos(_ELEVATION) - self.near(point) * math.sin(_ELEVATION))

    def near(self, point: Point3) -> float:
        """Return how near to the eye a point is in the plan [m]."""
        return point[0] * math.cos(self.azimuth) + point[1] * math.sin(self.azimuth)

    def depth(self, point: Point3) -> float:
        """Return how near to the eye a point is [m]."""
        return self.near(point) * math.cos(_ELEVATION) + point[2] * math.sin(_ELEVATION)

    def lit(self, normal: Point3) -> float:
        """Return how much light falls on a face, up to 1."""
        right = normal[1] * math.cos(self.azimuth) - normal[0] * math.sin(self.azimuth)
        along = (self.near(normal), right, normal[2])
        return sum(a * b for a, b in zip(along, _LIGHT, strict=True))

    def outline(self, corners: Sequence[Point3]) -> tuple[Point, ...]:
        """Return the outline of corners on paper [m]."""
        return hull([self.seen(corner) for corner in corners])

    def back_to_front(self, solids: Sequence[Sequence[Point3]]) -> list[int]:
        """Return solids, by their corners, in the order in which they are drawn."""
        spans = [(_span(one, lambda p: p[2]), _span(one, self.near)) for one in solids]
        depths = [max(self.depth(corner) for corner in one) for one in solids]
        left = sorted(range(len(solids)), key=lambda index: depths[index])
        found = []
        while left:
            free = (
                one
                for one in left
                if not any(_hides(spans[one], spans[other]) for other in left if other != one)
            )
            found.append(next(free, left[0]))
            left.remove(found[-1])
        return found


def body_items(
    view: View,
    pixels: Callable[[Point3], Point],
    body: Body,
    pose: Pose,
    look: Look,
    title: str,
) -> Iterator[Item]:
    """Yield the faces of a body that are seen, from the back to the front.

    Parameters
    ----------
    view
        From where it is looked at.
    pixels
        Where a point of the world is in the picture.
    body, pose
        What stands where.
    look
        Fill and opacity; faces away from the light are darker.
    title
        What a page says where the pointer rests on it.
    """
    shapes = body.exact_shapes
    solids = [[pose.apply(corner) for corner in corners_of(one)] for one in shapes]
    for index in view.back_to_front(solids):
        shape, corners = shapes[index], solids[index]
        if len(faces_of(shape)) > _MOST_FACES:
            outline = hull([pixels(corner) for corner in corners])
            edge = Look(look.fill, "ink", 0.8, opacity=min(look.opacity, 0.9))
            yield Shape(outline, edge, title=title)
            continue
        faces = [[corners[index] for index in face] for face in faces_of(shape)]
        seen = [(face, normal_of(face)) for face in faces]
        towards = [(face, normal) for face, normal in seen if view.depth(normal) > 1e-9]
        stroke = "ink" if len(faces) < _FEW_FACES else None
        for face, normal in sorted(towards, key=lambda one: _mean_depth(view, one[0])):
            shade = round(0.5 * (1 - max(0.0, view.lit(normal))), 1)
            sealed = look.opacity == 1
            lit = Look(look.fill, stroke, 0.5, opacity=look.opacity, shade=shade, sealed=sealed)
            yield Shape(tuple(map(pixels, face)), lit, title=title)


def _mean_depth(view: View, face: Sequence[Point3]) -> float:
    return sum(view.depth(point) for point in face) / len(face)


_Span = tuple[float, float]


def _span(corners: Sequence[Point3], along: Callable[[Point3], float]) -> _Span:
    """Return the least and greatest value of a coordinate."""
    values = [along(corner) for corner in corners]
    return min(values), max(values)


def _hides(one: tuple[_Span, _Span], other: tuple[_Span, _Span]) -> bool:
    """Whether a solid is in front of another one for sure, by its heights and nearness."""
    (low, high), (near, _) = one
    (floor, top), (_, far) = other
    if top <= low + 1e-6 or high <= floor + 1e-6:
        return top <= low + 1e-6
    return far <= near + 1e-6


def inside(point: Sequence[float], outline: Sequence[Point]) -> bool:
    """Whether a point is within a convex outline, whose corners go round anticlockwise."""
    ends = zip(outline, [*outline[1:], *outline[:1]], strict=True)
    x, y = point
    return all((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) > 1e-12 for a, b in ends)


def normal_of(face: Sequence[Point3]) -> Point3:
    """Return the unit normal of a face by its first three corners, outward."""
    a, b, c = face[0], face[1], face[2]
    u, v = [q - p for p, q in zip(a, b, strict=True)], [q - p for p, q in zip(a, c, strict=True)]
    n = (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])
    length = math.hypot(*n) or 1.0
    return (n[0] / length, n[1] / length, n[2] / length)
