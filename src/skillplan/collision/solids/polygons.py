"""Convex polygons in the plane: what two have in common, how deep they overlap, what some cover."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

Planar = tuple[float, float]
Polygon = tuple[Planar, ...]


def area(polygon: Sequence[Planar]) -> float:
    """Return the area of a polygon whose corners are listed anticlockwise."""
    return sum(
        (a[0] * b[1] - b[0] * a[1]) / 2
        for a, b in zip(polygon, (*polygon[1:], *polygon[:1]), strict=True)
    )


def intersection(one: Sequence[Planar], other: Sequence[Planar]) -> Polygon:
    """Return what two convex polygons have in common (Sutherland and Hodgman); or nothing.

    Parameters
    ----------
    one, other
        Their corners, anticlockwise.
    """
    left = list(one)
    for begin, end in _sides(other):
        dx, dy = end[0] - begin[0], end[1] - begin[1]
        left = below(left, (dy, -dx), dy * begin[0] - dx * begin[1])
    return tuple(left) if len(left) > 2 else ()


def below(polygon: Sequence[Planar], normal: Planar, offset: float) -> list[Planar]:
    """Return what of a convex polygon lies where normal . point <= offset."""
    beyond = [normal[0] * x + normal[1] * y - offset for x, y in polygon]
    kept: list[Planar] = []
    for i, here in enumerate(polygon):
        j = (i + 1) % len(polygon)
        if beyond[i] <= 0:
            kept.append(here)
        if beyond[i] * beyond[j] < 0:
            share = beyond[i] / (beyond[i] - beyond[j])
            there = polygon[j]
            kept.append(
                (here[0] + share * (there[0] - here[0]), here[1] + share * (there[1] - here[1]))
            )
    return kept


def overlap(one: Sequence[Planar], other: Sequence[Planar]) -> float:
    """Return how far one must move to be beside the other; below 0 where it is (separating axes).

    Parameters
    ----------
    one, other
        Corners of convex polygons, anticlockwise.
    """
    least = math.inf
    for polygon in (one, other):
        for begin, end in _sides(polygon):
            dx, dy = end[0] - begin[0], end[1] - begin[1]
            length = math.hypot(dx, dy)
            if length == 0:
                continue
            normal = (dy / length, -dx / length)
            low_1, high_1 = _extent(one, normal)
            low_2, high_2 = _extent(other, normal)
            least = min(least, high_1 - low_2, high_2 - low_1)
    return least


def inwards(polygon: Sequence[Planar], point: Planar) -> float:
    """Return how far a point lies inside a convex polygon; below 0 how far it is from it."""
    distance, inside = math.inf, True
    for begin, end in _sides(polygon):
        dx, dy = end[0] - begin[0], end[1] - begin[1]
        px, py = point[0] - begin[0], point[1] - begin[1]
        inside = inside and dx * py - dy * px >= 0
        along = min(1.0, max(0.0, (px * dx + py * dy) / (dx * dx + dy * dy)))
        distance = min(distance, math.hypot(px - along * dx, py - along * dy))
    return distance if inside else -distance


def covered(polygons: Sequence[Sequence[Planar]]) -> float:
    """Return the area that convex polygons cover together, counting what several cover once."""
    if len(polygons) < 2:
        return sum(area(polygon) for polygon in polygons)
    sides = [side for polygon in polygons for side in _sides(polygon)]
    stops = {corner[0] for polygon in polygons for corner in polygon}
    stops |= {
        x for i, one in enumerate(sides) for other in sides[:i] for x in _crossing(one, other)
    }
    ordered = sorted(stops)
    # Between two stops no sides cross, so that what is covered changes evenly.
    return sum(
        (right - left) * _covered_at(polygons, (left + right) / 2)
        for left, right in pairwise(ordered)
    )


def _covered_at(polygons: Sequence[Sequence[Planar]], x: float) -> float:
    spans = []
    for polygon in polygons:
        ys = [
            a[1] + (b[1] - a[1]) * (x - a[0]) / (b[0] - a[0])
            for a, b in _sides(polygon)
            if min(a[0], b[0]) <= x <= max(a[0], b[0]) and a[0] != b[0]
        ]
        if ys:
            spans.append((min(ys), max(ys)))
    total, reached = 0.0, -math.inf
    for low, high in sorted(spans):
        total += max(0.0, high - max(low, reached))
        reached = max(reached, high)
    return total


def _crossing(one: tuple[Planar, Planar], other: tuple[Planar, Planar]) -> Iterator[float]:
    (ax, ay), (bx, by) = one
    (cx, cy), (dx, dy) = other
    across = (bx - ax) * (dy - cy) - (by - ay) * (dx - cx)
    if across == 0:
        return
    share = ((cx - ax) * (dy - cy) - (cy - ay) * (dx - cx)) / across
    if 0 < share < 1:
        yield ax + share * (bx - ax)


def _sides(polygon: Sequence[Planar]) -> Iterator[tuple[Planar, Planar]]:
    return zip(polygon, (*polygon[1:], *polygon[:1]), strict=True)


def _extent(polygon: Sequence[Planar], normal: Planar) -> tuple[float, float]:
    along = [normal[0] * x + normal[1] * y for x, y in polygon]
    return min(along), max(along)
