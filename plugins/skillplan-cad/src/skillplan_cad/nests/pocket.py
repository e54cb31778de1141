"""The room that bodies sweep on their way down into a pocket, as layers of outlines.

A body that comes from above passes every point above its lowest surface. In a layer, this room is
the projection of all surfaces below the layer's top. Layers begin at level faces and at the lowest
edges of slopes, which therefore rest on material. On slopes, the pocket is wider than the body by
up to the slope of one layer.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon
from shapely.geometry.base import BaseGeometry

Floats = NDArray[np.float64]

# Extent along the axis up to which a triangle is level, and distance of distinct levels [mm].
_LEVEL_MM, _LEVELS_APART_MM = 1e-3, 2e-3
# Decimals of coordinates by which triangles share corners [mm].
_DECIMALS = 5
# Grid of coordinates, and distance by which outlines are simplified [mm].
_GRID_MM, _SIMPLER_MM = 1e-5, 2e-3
# Arcs have this many segments a quarter, around the true circle.
_SEGMENTS = 8
_OUTSIDE = 1 / math.cos(math.pi / (4 * _SEGMENTS))
# Widening by draft up to which a layer has one outline [mm].
_DRAFT_STEP_MM = 0.05
_CORNER_LIMIT = 5.0


@dataclass(frozen=True, slots=True, eq=False)
class Layer:
    """A slice of a pocket.

    Parameters
    ----------
    low_mm, high_mm
        Heights of its ends.
    outline
        The pocket in it, holes filled.
    """

    low_mm: float
    high_mm: float
    outline: BaseGeometry


class LowerSurface:
    """The triangles of bodies that face down, in millimetres, z upwards.

    Parameters
    ----------
    corners
        Corners of all triangles, shape (n, 3, 3).

    Attributes
    ----------
    levels
        Heights of the level ones, ascending.
    lowest
        Heights of these, and of edges and corners without a lower neighbour.
    extent_mm
        Largest extent of the bodies.
    """

    def __init__(self, corners: Floats) -> None:
        self.extent_mm = float(np.ptp(corners, axis=(0, 1)).max())
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(normals, axis=1)
        # Walls are the edges of other triangles' projections.
        down = normals[:, 2] < -1e-7 * np.maximum(lengths, 1e-30)
        order = np.argsort(corners[down][:, :, 2], axis=1)
        self._corners = np.take_along_axis(corners[down], order[:, :, None], axis=1)
        self._low, self._high = self._corners[:, 0, 2], self._corners[:, 2, 2]
        self._is_level = self._high - self._low < _LEVEL_MM
        self.levels = _list_apart(self._low[self._is_level])
        self.lowest = _list_apart(np.r_[self._low[self._is_level], _find_minima(corners[down])])

    def find_level_faces(self, height_mm: float) -> BaseGeometry:
        """Return the outline of the level faces at a height."""
        chosen = self._is_level & (self._low >= height_mm - 1e-9)
        chosen &= self._low <= height_mm + _LEVELS_APART_MM
        return unite(shapely.polygons(self._corners[chosen][:, :, :2]))

    def has_slope(self, low_mm: float, high_mm: float) -> bool:
        """Return whether a triangle that is not level lies between two heights."""
        return bool((~self._is_level & (self._low < high_mm) & (self._high > low_mm)).any())

    def project_slice(self, low_mm: float, high_mm: float) -> BaseGeometry:
        """Return the projection of a slice, and of what lies below it on the same triangles."""
        chosen = self._low < high_mm - 1e-9
        chosen &= (self._high > low_mm) | (self._is_level & (self._low >= low_mm - 1e-9))
        corners = self._corners[chosen]
        whole = (corners[:, 2, 2] <= high_mm) | self._is_level[chosen]
        faces = [*shapely.polygons(corners[whole][:, :, :2])]
        for low, middle, top in corners[~whole]:
            cut = [_cut(low, top, high_mm)]
            if middle[2] > high_mm:
                points = [low, *cut, _cut(low, middle, high_mm)]
            else:
                points = [low, middle, _cut(middle, top, high_mm), *cut]
            faces.append(Polygon([point[:2] for point in points]))
        return unite(np.array(faces, dtype=object))


def _list_apart(heights: Floats) -> list[float]:
    """Return heights in ascending order, without those too near to a lower one."""
    apart: list[float] = []
    for height in np.unique(heights).tolist():
        if not apart or height > apart[-1] + _LEVELS_APART_MM:
            apart.append(height)
    return apart


def _find_minima(corners: Floats) -> Floats:
    """Return the heights of the corners of triangles that have no lower neighbour."""
    points, which = np.unique(
        np.round(corners.reshape(-1, 3), _DECIMALS), axis=0, return_inverse=True
    )
    triangles = which.reshape(-1, 3)
    is_lowest = np.ones(len(points), dtype=bool)
    for a, b in ((0, 1), (1, 2), (2, 0), (1, 0), (2, 1), (0, 2)):
        higher = points[triangles[:, a], 2] > points[triangles[:, b], 2] + _LEVEL_MM
        is_lowest[triangles[higher, a]] = False
    return np.asarray(points[is_lowest, 2])


def _cut(low: Floats, high: Floats, height_mm: float) -> Floats:
    share = (height_mm - low[2]) / (high[2] - low[2])
    return np.asarray(low + share * (high - low))


def unite(shapes: NDArray[np.object_]) -> BaseGeometry:
    """Return the union of polygons, which may be degenerate."""
    if not len(shapes):
        return Polygon()
    return keep_areas(shapely.union_all(shapely.make_valid(shapes), grid_size=_GRID_MM))


def keep_areas(shape: BaseGeometry) -> BaseGeometry:
    """Return the polygons of a shape, without points and lines."""
    return MultiPolygon(
        [part for part in _list_parts(shape) if isinstance(part, Polygon) and part.area > 0]
    )


def _list_parts(shape: BaseGeometry) -> Iterator[BaseGeometry]:
    for part in shapely.get_parts(shape):
        if shapely.get_type_id(part) >= 4:
            yield from _list_parts(part)
        else:
            yield part


def widen(shape: BaseGeometry, distance_mm: float) -> BaseGeometry:
    """Return a shape that contains all points within a distance of it, with few corners."""
    radius_mm = distance_mm * _OUTSIDE + 2 * _SIMPLER_MM
    wide = shape.buffer(radius_mm, quad_segs=_SEGMENTS)
    return wide.simplify(_SIMPLER_MM)


def fill_holes(shape: BaseGeometry) -> BaseGeometry:
    """Return a shape without its holes."""
    return unite(np.array([Polygon(part.exterior) for part in _list_parts(shape)], dtype=object))


def sweep_pocket(
    surface: LowerSurface,
    low_mm: float,
    high_mm: float,
    clearance_mm: float,
    draft_rad: float,
    step_mm: float,
) -> list[Layer]:
    """Return the room that bodies need on their way down, with a clearance.

    Parameters
    ----------
    low_mm, high_mm
        Lowest point of the bodies, and top of the pocket.
    clearance_mm
        Distance of the walls from the bodies, at least.
    draft_rad
        Angle by which walls lean outwards.
    step_mm
        Height of layers on slopes, at most.
    """
    layers: list[Layer] = []
    room: BaseGeometry = Polygon()
    slope = math.tan(draft_rad)
    for low, high in _list_slices(surface, low_mm, high_mm, step_mm, slope):
        fresh = surface.project_slice(low, high)
        if layers and slope > 0:
            grown_mm = slope * (low - layers[-1].low_mm)
            room = room.buffer(grown_mm, join_style="mitre", mitre_limit=_CORNER_LIMIT)
        if not fresh.is_empty:
            room = _extend(room, widen(fresh, clearance_mm))
        room = fill_holes(keep_areas(room))
        previous = layers[-1] if layers else None
        if previous is not None and room.symmetric_difference(previous.outline).area < 1e-9:
            layers[-1] = Layer(previous.low_mm, high, previous.outline)
        else:
            layers.append(Layer(low, high, room))
    return layers


def _extend(room: BaseGeometry, outline: BaseGeometry) -> BaseGeometry:
    """Return the union of two outlines, except strips that the margin of outlines covers."""
    growth = shapely.get_parts(keep_areas(outline.difference(room)))
    covered = shapely.covered_by(growth, room.buffer(_SIMPLER_MM))
    return room.union(shapely.union_all(growth[~covered]), grid_size=_GRID_MM)


def _list_slices(
    surface: LowerSurface, low_mm: float, high_mm: float, step_mm: float, slope: float
) -> Iterator[tuple[float, float]]:
    """Yield the ends of slices: at level faces, and between them as fine as slopes and draft."""
    apart = _LEVELS_APART_MM
    levels = [level for level in surface.lowest if low_mm + apart < level < high_mm - apart]
    ends = [low_mm, *levels, high_mm]
    drafted_mm = _DRAFT_STEP_MM / slope if slope > 0 else math.inf
    for low, high in pairwise(ends):
        count = max(1, math.ceil((high - low) / step_mm - 1e-9))
        edges = np.linspace(low, high, count + 1).tolist()
        begin = low
        for index in range(count):
            end = edges[index + 1]
            later = end < high and not surface.has_slope(begin, edges[index + 2])
            if later and edges[index + 2] - begin <= drafted_mm:
                continue
            yield begin, end
            begin = end
