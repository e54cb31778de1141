"""Columns over one plane as a watertight mesh with corners on a grid, and as convex prisms.

Source of the division of outlines into convex polygons: S. Hertel and K. Mehlhorn, "Fast
triangulation of simple polygons" (1983): at most four times as many pieces as necessary.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import manifold3d
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from skillplan.task.shape import list_prism_faces
from skillplan_cad.nests.pocket import keep_areas
from skillplan_cad.product import Points, Triangles

Body = tuple[Points, Triangles]
"""Vertices [m] and triangles of a closed mesh."""
Floats = NDArray[np.float64]
Column = tuple[float, float, BaseGeometry]
"""Bottom, top and outline of a prism [mm]."""
_TO_MM = 1e3
# Area below which a triangle is a rounding residue [mm2]; its neighbours cover it.
_LEAST_MM2 = 1e-7
# Corners per millimetre: files in single precision keep them distinct.
_PER_MM = 1000
Corner = tuple[int, int]


def build_stepped_mesh(columns: Sequence[Column]) -> tuple[Points, Triangles]:
    """Return the surface of the union of columns on a common bottom [mm].

    The outlines divide the plane into cells, each as high as its highest column. Walls stand on the
    edges between cells, with a corner at each height that meets there.
    """
    bottom = min(low for low, _, _ in columns)
    mesh = _Mesh()
    rings_of, heights = _divide_plane(columns)
    heights_at: dict[Corner, set[float]] = {}
    sides: dict[tuple[Corner, Corner], float] = {}
    for rings, height in zip(rings_of, heights, strict=True):
        for ring in rings:
            for corner in ring:
                heights_at.setdefault(corner, {bottom}).add(height)
            for edge in zip(ring, [*ring[1:], ring[0]], strict=True):
                sides[edge] = height
        mesh.add_face(rings, height, bottom)
    for (start, end), height in sides.items():
        other = sides.get((end, start), bottom)
        if height > other:
            columns_at = (
                [level for level in sorted(heights_at[corner]) if other <= level <= height]
                for corner in (start, end)
            )
            mesh.add_wall(start, end, *columns_at)
    return mesh.finish()


def _divide_plane(columns: Sequence[Column]) -> tuple[list[list[list[Corner]]], list[float]]:
    """Return the cells of the plane that are filled, as rings of corners, and their heights."""
    grid = 1 / _PER_MM
    lines = shapely.union_all(
        [shapely.boundary(outline) for _, _, outline in columns], grid_size=grid
    )
    cells = shapely.get_parts(shapely.polygonize([*shapely.get_parts(lines)]))
    inner = shapely.point_on_surface(cells)
    tops = np.full(len(cells), -np.inf)
    for _, high, outline in columns:
        shapely.prepare(outline)
        tops = np.where(shapely.contains(outline, inner), np.maximum(tops, high), tops)
    filled = [(cell, float(top)) for cell, top in zip(cells, tops, strict=True) if np.isfinite(top)]
    return [_list_rings(cell) for cell, _ in filled], [top for _, top in filled]


def _list_rings(cell: Polygon) -> list[list[Corner]]:
    """Return the outline of a cell anticlockwise, and its holes clockwise, on the grid."""
    oriented = shapely.orient_polygons(cell)
    rings = []
    for ring in (oriented.exterior, *oriented.interiors):
        points = np.round(shapely.get_coordinates(ring)[:-1] * _PER_MM).astype(np.int64)
        rings.append([(int(x), int(y)) for x, y in points])
    return rings


class _Mesh:
    """Triangles with shared corners."""

    def __init__(self) -> None:
        self._numbers: dict[tuple[int, int, float], int] = {}
        self._triangles: list[tuple[int, int, int]] = []

    def add_face(self, rings: Iterable[list[Corner]], top: float, bottom: float) -> None:
        """Add the top and the bottom of a cell."""
        rings = [*rings]
        corners = [corner for ring in rings for corner in ring]
        flat = [np.array(ring, dtype=np.float64) / _PER_MM for ring in rings]
        for a, b, c in manifold3d.triangulate(flat, 1e-9).tolist():
            upper = [self._get_number(corners[index], top) for index in (a, b, c)]
            lower = [self._get_number(corners[index], bottom) for index in (c, b, a)]
            self._triangles += [(upper[0], upper[1], upper[2]), (lower[0], lower[1], lower[2])]

    def add_wall(
        self, start: Corner, end: Corner, at_start: list[float], at_end: list[float]
    ) -> None:
        """Add a wall whose outside is to the right, between heights at its ends."""
        left = [self._get_number(start, height) for height in at_start]
        right = [self._get_number(end, height) for height in at_end]
        i = j = 0
        while i < len(left) - 1 or j < len(right) - 1:
            climbs_left = j == len(right) - 1 or (
                i < len(left) - 1 and at_start[i + 1] <= at_end[j + 1]
            )
            if climbs_left:
                self._triangles.append((left[i], right[j], left[i + 1]))
                i += 1
            else:
                self._triangles.append((left[i], right[j], right[j + 1]))
                j += 1

    def finish(self) -> tuple[Points, Triangles]:
        """Return points [mm] and triangles."""
        points = np.array([*self._numbers], dtype=np.float64)
        points[:, :2] /= _PER_MM
        return points, np.array(self._triangles, dtype=np.int64)

    def _get_number(self, corner: Corner, height: float) -> int:
        return self._numbers.setdefault((*corner, height), len(self._numbers))


def is_watertight(triangles: Triangles) -> bool:
    """Return whether each edge of triangles is run along once in either direction."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    keys, counts = np.unique(edges, axis=0, return_counts=True)
    if not len(keys) or (counts > 1).any():
        return False
    back = keys[:, ::-1]
    return bool(np.array_equal(keys, back[np.lexsort((back[:, 1], back[:, 0]))]))


def list_pieces(columns: Sequence[Column], allowed_mm: float) -> list[Body]:
    """Return prisms that enclose columns; each stands into a pocket by at most `allowed_mm`.

    Columns are nested, so each needs only the strip that no higher one has. No prism leaves the
    rectangle about its column, so that prisms and mesh have the same box.
    """
    pieces: list[Body] = []
    higher: BaseGeometry = Polygon()
    for low, high, outline in sorted(columns, key=lambda column: -column[1]):
        strip = keep_areas(outline.difference(higher, grid_size=1 / _PER_MM))
        higher = keep_areas(higher.union(outline, grid_size=1 / _PER_MM))
        # A strip that is narrower than the grid of outlines has no floor.
        if strip.area <= 1 / _PER_MM * strip.length:
            continue
        wide = _coarsen(strip, allowed_mm).intersection(outline.envelope)
        for ring in _divide_outline(keep_areas(wide)):
            pieces.append(_make_prism(ring, low, high))
    return pieces


def _coarsen(outline: BaseGeometry, allowed_mm: float) -> BaseGeometry:
    """Return an outline with fewer corners that contains the given one."""
    wide = outline.buffer(allowed_mm / 2, join_style="mitre")
    return keep_areas(wide.simplify(allowed_mm / 2))


def _make_prism(ring: Floats, low_mm: float, high_mm: float) -> Body:
    count = len(ring)
    points = np.vstack([np.c_[ring, np.full(count, z)] for z in (low_mm, high_mm)]) / _TO_MM
    return points, np.array(list_prism_faces(count), dtype=np.int64)


def _divide_outline(outline: BaseGeometry) -> list[Floats]:
    """Return convex polygons that cover an outline, each as anticlockwise points (n, 2)."""
    pieces: list[Floats] = []
    for part in shapely.get_parts(outline):
        triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(part))
        pieces += _merge([triangle for triangle in triangles if triangle.area > _LEAST_MM2])
    return pieces


def _merge(triangles: list[Polygon]) -> list[Floats]:
    """Join polygons over their common edges as long as they stay convex, longest edge first."""
    points: dict[tuple[float, float], int] = {}
    rings: dict[int, list[int]] = {}
    for number, triangle in enumerate(triangles):
        corners = shapely.get_coordinates(triangle.exterior.normalize())[:-1]
        if not triangle.exterior.normalize().is_ccw:
            corners = corners[::-1]
        rings[number] = [points.setdefault((x, y), len(points)) for x, y in corners.tolist()]
    places = np.array([*points]).reshape(-1, 2)
    owner: dict[tuple[int, int], int] = {}
    for number, ring in rings.items():
        for edge in zip(ring, [*ring[1:], ring[0]], strict=True):
            owner[edge] = number
    inner = [edge for edge in owner if edge[0] < edge[1] and edge[::-1] in owner]
    inner.sort(key=lambda edge: -float(np.linalg.norm(places[edge[0]] - places[edge[1]])))
    for a, b in inner:
        first, second = owner[a, b], owner[b, a]
        if first == second:
            continue
        ring = _join(rings[first], rings[second], a, b)
        # Pieces that share more than an edge would leave a spike.
        if len(set(ring)) == len(ring) and _is_convex(places[ring]):
            rings[first] = ring
            for edge in zip(ring, [*ring[1:], ring[0]], strict=True):
                owner[edge] = first
            owner[a, b] = owner[b, a] = first
            del rings[second]
    return [places[ring] for ring in rings.values()]


def _join(first: list[int], second: list[int], a: int, b: int) -> list[int]:
    """Return the ring of two polygons without their common edge from a to b."""
    at, of = first.index(b), second.index(a)
    return [*first[at:], *first[:at], *(second[of:] + second[:of])[1:-1]]


def _is_convex(ring: Floats) -> bool:
    ahead = np.roll(ring, -1, axis=0) - ring
    after = np.roll(ahead, -1, axis=0)
    turns = ahead[:, 0] * after[:, 1] - ahead[:, 1] * after[:, 0]
    return bool((turns >= -1e-12).all())
