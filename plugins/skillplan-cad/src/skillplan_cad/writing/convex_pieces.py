"""Decompose a solid into convex pieces by repeated cuts where its hull deviates most.

Each piece is the hull of a body between cuts, so pieces enclose the solid, except for sheets that
are thinner than the gap of a fit; cuts only reduce the excess.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import NamedTuple

import manifold3d
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from skillplan.domains.assembly import MAX_PIECES
from skillplan_cad.product import Points, Triangles, make_solid, read_solid
from skillplan_cad.writing.lanes import (
    PRESSED_GAP_M,
    Lane,
    assign_bodies,
    measure_depth_mm,
    measure_thickness,
)

Mesh = tuple[Points, Triangles]
Pieces = tuple[Mesh, ...]
Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Normal = tuple[float, float, float]

# Number of pieces after which only gaps in the way of other parts and of jaws are cut, number after
# which only gaps in the way of jaws are cut, and limit of all.
_MOST_PIECES, _MOST_FOR_PARTS, _MOST_OF_ALL = 160, MAX_PIECES - 128, MAX_PIECES
_TO_MM = 1e3
# Number of boundary planes of a gap that are tried as cuts.
_MOST_PLANES = 8
_LEAST_MM = 1e-3
# Decimals of millimetres, coarser than sheets: a face stays plane, which contacts in engines need.
_DECIMALS = 3
_LEAST_MM3 = 1e-6
# Distance of cuts from faces, inside the gap; rounding would leave a sheet of a face.
_SHEET_MM = 2e-4
# Thickness below which a gap is a rounding residue.
_FILM_MM = 1e-3
# Thickness below which a body that a cut leaves is left out: the gap of a fit is wider.
_SHEER_MM = 0.02
# Thickness below which a body goes whose hull is in the way of other parts, which have more play,
# and least volume that it takes of their way, as a share of its own.
_LID_MM, _LID_SHARE = 0.05, 0.01
# Share of a gap's volume in front of the faces that border it.
_BORDERED = 0.9
# Largest number of products of points or faces with directions in one array.
_MOST_PRODUCTS = 2_000_000
# Share of the excess volume above which gaps are halved instead.
_WORTH = 0.6
_LEAST_SHARE = 1e-3
# Weights that encode three coordinates from -1000 to 1000 as one number.
_PLACES = np.array([10**8, 10**4, 1])
# Factors by which gaps in the way of other parts, and of jaws, are cut before others.
_FIRST, _SECOND = 1e6, 1e3
# Share of a gap's corners on the wall of a round hollow above which it belongs to the hollow.
_ON_WALL = 0.3
# Range of the sines between neighbouring faces of a curved wall, share of the wall that has such
# neighbours, and length of the mean of its normals below which it surrounds the gap.
_CURVED, _MOST_CURVED, _AROUND = (1e-3, 0.5), 0.7, 0.2
# Distance of the corners' mean from the axis, in radii, below which they surround it.
_ROUND = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Hollow:
    """A round hollow of a solid."""

    point_m: Floats
    axis: Floats
    radius_m: float


class _Uncut(NamedTuple):
    """A body between cuts with its hull, its worst gap, and the lane in its hull."""

    hull: manifold3d.Manifold
    body: manifold3d.Manifold
    gap: manifold3d.Manifold
    lane: Lane | None


def decompose_convex(
    vertices_m: Points,
    triangles: Triangles,
    allowed_m: float,
    hollows: Sequence[Hollow] = (),
    lane: Lane | None = None,
) -> Pieces:
    """Return convex pieces of a solid; empty for an empty solid.

    Parameters
    ----------
    allowed_m
        Allowed excess of a piece; a gap between faces counts with its width [m].
    hollows
        Round hollows; cuts through their axes give the fewest pieces.
    lane
        Space of other parts and of jaws; None if they pass no concave part of the solid.
    """
    whole = make_solid(vertices_m, triangles)
    if whole.is_empty():
        return ()
    waiting: list[tuple[float, int, _Uncut]] = []
    done: list[manifold3d.Manifold] = []
    numbers = count()

    def add(bodies: Iterable[manifold3d.Manifold], lane: Lane | None) -> None:
        for body in bodies:
            hull = body.hull()
            own = None if lane is None else lane.crop(hull)
            # The hull of a sheet is a lid over the hole in it, however thin.
            if (
                own is not None
                and measure_thickness(body) < _LID_MM
                and own.solid.volume() > _LID_SHARE * body.volume()
            ):
                continue
            excess, gap = _find_worst_gap(hull, body, allowed_m, own)
            if excess <= 1:
                done.append(hull)
            else:
                heapq.heappush(waiting, (-excess, next(numbers), _Uncut(hull, body, gap, own)))

    add(_list_bodies(whole), lane)
    while waiting and len(done) + len(waiting) < _get_most(-waiting[0][0]):
        excess, _, (hull, body, gap, room) = heapq.heappop(waiting)
        if room is not None and -excess >= _FIRST and len(done) + len(waiting) >= _MOST_FOR_PARTS:
            add([body], replace(room, solid=manifold3d.Manifold()))
            continue
        halves = _cut(hull, body, gap, hollows)
        bodies = [
            own
            for half in halves or ()
            for own in _list_bodies(half)
            # The hull of a concave sheet reaches far beyond it, and engines push parts along it.
            if measure_thickness(own) > _SHEER_MM
        ]
        # A strip in the way of parts goes if both of its halves are sheer.
        is_cut = bool(bodies) or (halves is not None and -excess >= _FIRST)
        if is_cut and len(done) + len(waiting) + len(bodies) <= _MOST_OF_ALL:
            add(bodies, room)
        else:
            # No cut is possible, or its halves fall into more bodies than there is room for.
            done.append(hull)
    done += [uncut.hull for _, _, uncut in waiting]
    return tuple(piece for piece in map(build_mesh, done) if piece is not None)


def _get_most(excess: float) -> int:
    """Return the number of pieces after which a gap with an excess is no longer cut."""
    return _MOST_OF_ALL if excess >= _SECOND else _MOST_PIECES


def is_full(pieces: Pieces) -> bool:
    """Return whether cutting may have ended at the limit of pieces."""
    return len(pieces) >= _MOST_PIECES


def _list_bodies(solid: manifold3d.Manifold) -> list[manifold3d.Manifold]:
    """Return the separate bodies of a solid, without residues of rounding."""
    return [body for body in solid.decompose() if body.volume() >= _LEAST_MM3]


def measure_excess_m(
    pieces: Pieces,
    vertices_m: Points,
    triangles: Triangles,
    lane: Lane | None,
    enough_m: float = math.inf,
) -> float:
    """Return the greatest depth to which pieces are in the way of other parts [m].

    Parameters
    ----------
    enough_m
        Depth above which no greater one is sought [m].
    """
    if lane is None:
        return 0.0
    whole, deepest_mm = make_solid(vertices_m, triangles), 0.0
    for points, _ in pieces:
        hull = manifold3d.Manifold.hull_points(points * _TO_MM)
        space = hull ^ lane.solid
        # No gap reaches deeper than the space that a hull takes of the lane.
        if measure_depth_mm(space) > deepest_mm and measure_thickness(space) > _FILM_MM:
            own = replace(lane, solid=space)
            reaches_mm = map(own.measure_reach_mm, (hull - whole).decompose())
            deepest_mm = max(deepest_mm, *reaches_mm, 0.0)
        if deepest_mm > enough_m * _TO_MM:
            break
    return deepest_mm / _TO_MM


def build_mesh(hull: manifold3d.Manifold) -> Mesh | None:
    """Return a hull with vertices rounded as in a file, or None if rounding flattens it.

    Qhull keeps it convex where faces are nearly in one plane; manifold3d may miss a corner there.
    """
    points = np.asarray(hull.to_mesh64().vert_properties, dtype=np.float64)[:, :3]
    rounded = np.unique(np.round(points, _DECIMALS), axis=0)
    try:
        again = ConvexHull(rounded) if len(rounded) > 3 else None
    except QhullError:
        again = None
    if again is None or again.volume < _LEAST_MM3:
        return None
    corners = rounded[again.simplices]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    is_inward = np.einsum("ij,ij->i", across, again.equations[:, :3]) < 0
    triangles = np.where(is_inward[:, None], again.simplices[:, ::-1], again.simplices)
    used, numbers = np.unique(triangles, return_inverse=True)
    return rounded[used] / _TO_MM, numbers.reshape(-1, 3).astype(np.int64)


def _list_faces(solid: manifold3d.Manifold) -> tuple[Points, Points, Floats, Floats]:
    """Return points, and corners, unit normals and areas of the triangles [mm, mm2]."""
    points, triangles = read_solid(solid)
    corners = points[triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(across, axis=1)
    return points, corners, across / np.maximum(lengths, 1e-30)[:, None], lengths / 2


def _find_worst_gap(
    hull: manifold3d.Manifold,
    body: manifold3d.Manifold,
    allowed_m: float,
    lane: Lane | None,
) -> tuple[float, manifold3d.Manifold]:
    """Return the largest excess of a gap as a share of the allowed one, and the gap.

    Parameters
    ----------
    lane
        The lane in the hull.
    """
    worst, where = 0.0, body
    gaps = (hull - body).decompose()
    nothing = manifold3d.Manifold()
    is_free = lane is None or measure_thickness(lane.solid) <= _FILM_MM
    spaces = assign_bodies(nothing if lane is None or is_free else lane.solid, gaps)
    jaws = assign_bodies(nothing if lane is None else lane.jaws, gaps)
    layers = assign_bodies(nothing if lane is None else lane.pressed, gaps)
    for gap, space, *held in zip(gaps, spaces, jaws, layers, strict=True):
        excess = 0.0
        if lane is not None and space:
            reach = lane.measure_reach_mm(gap, space) / _TO_MM / min(lane.allowed_m, allowed_m)
            # No part goes into a hole that is not cut to the end.
            excess = _FIRST * reach if reach > 1 else 0.0
        for bodies, width_m in zip(held, (allowed_m, min(PRESSED_GAP_M, allowed_m)), strict=True):
            if excess < _FIRST and bodies:
                jaw = manifold3d.Manifold.compose(bodies)
                reach = 2 * measure_thickness(jaw) / _TO_MM / width_m
                excess = max(excess, _SECOND * reach if reach > 1 else 0.0)
        sides_mm = np.ptp(np.reshape(gap.bounding_box(), (2, 3)), axis=0)
        if max(excess, worst) < float(np.linalg.norm(sides_mm)) / _TO_MM / allowed_m:
            excess = max(excess, _measure_width(gap, hull) / _TO_MM / allowed_m)
        if excess > worst:
            worst, where = excess, gap
    return worst, where


def _measure_width(gap: manifold3d.Manifold, hull: manifold3d.Manifold) -> float:
    """Return the width of a gap in a hull across the faces of its body [mm]; 0 for a film.

    A slice of a hollow is as thin as the slice, but far from any wall: a width counts only across
    faces of the body that border the whole gap.
    """
    points, _, normals, areas = _list_faces(gap)
    volume = gap.volume()
    if 2 * volume < _FILM_MM * float(areas.sum()):
        return 0.0
    bordering = areas * _mask_body_faces(gap, hull)
    large = bordering > 1e-3 * areas.max()
    if not large.any():
        return float(np.ptp(points, axis=0).max())
    # One number per row, in the same order: much faster to compare than rows.
    numbers = np.round(normals[large] * 1000).astype(np.int64) @ _PLACES
    _, first = np.unique(numbers, return_index=True)
    across = normals[large][first]
    weighted = normals[bordering > 0] * bordering[bordering > 0, None]
    widths, borders = np.empty(len(across)), np.empty(len(across))
    count_at_once = max(1, _MOST_PRODUCTS // max(len(points), len(weighted)))
    for begin in range(0, len(across), count_at_once):
        some = slice(begin, begin + count_at_once)
        widths[some] = np.ptp(points @ across[some].T, axis=0)
        projected = weighted @ across[some].T
        sides = (np.maximum(sign * projected, 0).sum(axis=0) for sign in (1, -1))
        borders[some] = np.maximum(*sides)
    is_whole = borders * widths >= _BORDERED * volume
    return float(widths[is_whole].min() if is_whole.any() else widths.max())


def _mask_body_faces(gap: manifold3d.Manifold, hull: manifold3d.Manifold) -> Bools:
    """Return a mask of the triangles of a gap that come from the body, not from its hull."""
    mesh64, hull_ids = gap.to_mesh64(), set(hull.to_mesh64().run_original_id)
    counts = np.diff(mesh64.run_index) // 3
    of_body = [number not in hull_ids for number in mesh64.run_original_id]
    return np.repeat(np.array(of_body, dtype=bool), counts)


def _cut(
    hull: manifold3d.Manifold,
    body: manifold3d.Manifold,
    gap: manifold3d.Manifold,
    hollows: Sequence[Hollow],
) -> tuple[manifold3d.Manifold, manifold3d.Manifold] | None:
    """Cut a body so that the gap vanishes or is halved; None if no cut is possible."""
    points, corners, normals, areas = _list_faces(gap)
    points = np.unique(points, axis=0)
    wall = _find_wall(points, hollows)
    if wall is not None and wall.is_all:
        for normal, offset in wall.planes():
            halves = _split(body, normal, offset)
            if halves is not None:
                return halves
    wholes = hull.volume() - body.volume()
    planes = _find_largest_planes(corners, normals, areas)
    ends = [(axis, (points @ axis).min(), (points @ axis).max()) for axis in np.eye(3)]
    planes += [
        _build_plane(axis, height)
        for axis, low, high in ends
        for height in (low + _SHEET_MM, high - _SHEET_MM)
    ]
    if wall is not None and not wall.is_all:
        _, halves = _find_best_cut(body, wall.tangents())
        if halves is not None:
            return halves
    for normal, offset in _find_edge_planes(gap, hull):
        halves = _split(body, normal, offset)
        if halves is not None:
            return halves
    added, halves_best = _find_best_cut(body, planes)
    if added > _WORTH * wholes:
        middles = [_build_plane(axis, (low + high) / 2) for axis, low, high in ends]
        less, other = _find_best_cut(body, middles)
        halves_best = (
            other if other is not None and less < added * (1 - _LEAST_SHARE) else halves_best
        )
    return halves_best


def _find_edge_planes(
    gap: manifold3d.Manifold, hull: manifold3d.Manifold
) -> list[tuple[Normal, float]]:
    """Return cuts at the edges between faces of a curved wall, from its middle outwards.

    They leave its faces whole. A wall that surrounds the gap has none.
    """
    points, corners, normals, areas = _list_faces(gap)
    of_body = np.flatnonzero(_mask_body_faces(gap, hull))
    weights = areas[of_body]
    if np.linalg.norm(weights @ normals[of_body]) < _AROUND * weights.sum():
        return []
    _, numbers = np.unique(np.round(points, 6), axis=0, return_inverse=True)
    faces = numbers.reshape(-1)[np.asarray(gap.to_mesh64().tri_verts, dtype=np.int64)[of_body]]
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    owners = np.tile(of_body, 3)
    keys = edges.min(axis=1) * len(points) + edges.max(axis=1)
    order = np.argsort(keys, kind="stable")
    same = np.flatnonzero(np.diff(keys[order]) == 0)
    first, second = owners[order[same]], owners[order[same + 1]]
    across = np.cross(normals[first], normals[second])
    sines = np.linalg.norm(across, axis=1)
    curved = (sines > _CURVED[0]) & (sines < _CURVED[1])
    first, second, across = first[curved], second[curved], across[curved]
    in_wall = np.isin(of_body, np.concatenate([first, second]))
    if weights[in_wall].sum() < _MOST_CURVED * weights.sum():
        return []
    middle = weights @ corners[of_body].mean(axis=1) / weights.sum()
    cuts = np.cross(across, normals[first] + normals[second])
    cuts /= np.linalg.norm(cuts, axis=1)[:, None]
    starts = points[np.unique(numbers, return_index=True)[1]][edges[order[same[curved]], 0]]
    offsets = np.einsum("ij,ij->i", cuts, starts)
    nearest = np.argsort(np.round(np.abs(cuts @ middle - offsets), 6), kind="stable")
    return [_build_plane(cuts[number], float(offsets[number])) for number in nearest[:3]]


def _split(
    body: manifold3d.Manifold, normal: Normal, offset: float
) -> tuple[manifold3d.Manifold, manifold3d.Manifold] | None:
    """Return both sides of a plane, or None if one is only a sheet."""
    points = np.asarray(body.to_mesh64().vert_properties, dtype=np.float64)[:, :3]
    heights = points @ np.asarray(normal)
    if min(float(heights.max()) - offset, offset - float(heights.min())) < _LEAST_MM:
        return None
    upper, lower = body.split_by_plane(normal, offset)
    return None if min(upper.volume(), lower.volume()) < _LEAST_MM3 else (upper, lower)


def _find_largest_planes(
    corners: Points, normals: Floats, areas: Floats
) -> list[tuple[Normal, float]]:
    """Return the planes with the largest share of a surface."""
    offsets = np.einsum("ij,ij->i", corners[:, 0], normals)
    keys = np.round(np.column_stack([normals, offsets]), 3)
    _, first, which = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    totals = np.bincount(which.reshape(-1), weights=areas)
    order = first[np.argsort(-np.round(totals, 6), kind="stable")[:_MOST_PLANES]]
    return [
        _build_plane(normals[face], float(offsets[face]) - _SHEET_MM) for face in order.tolist()
    ]


def _find_best_cut(
    body: manifold3d.Manifold, planes: Iterable[tuple[Normal, float]]
) -> tuple[float, tuple[manifold3d.Manifold, manifold3d.Manifold] | None]:
    """Return the smallest excess of the halves' hulls over all planes, and the halves."""
    best, halves = np.inf, None
    for normal, offset in planes:
        cut = _split(body, normal, offset)
        if cut is None:
            continue
        hulls = sum(part.hull().volume() for half in cut for part in half.decompose())
        added = max(hulls - body.volume(), 0.0)
        # Rounding must not decide between equal cuts.
        if added < best * (1 - _LEAST_SHARE) - _LEAST_MM3:
            best, halves = added, cut
    return best, halves


@dataclass(frozen=True, slots=True, eq=False)
class _Wall:
    """Corners of a gap that lie on the wall of a round hollow."""

    hollow: Hollow
    points: Points
    is_all: bool

    def planes(self) -> Iterator[tuple[Normal, float]]:
        """Yield cuts through the gap: at its ends, then through its axis."""
        axis, origin = self.hollow.axis, self.hollow.point_m * _TO_MM
        heights = self.points @ axis
        yield _build_plane(axis, float(heights.min()) + _SHEET_MM)
        yield _build_plane(axis, float(heights.max()) - _SHEET_MM)
        out = self.points - origin
        out = out - np.outer(out @ axis, axis)
        middle = out.mean(axis=0)
        if float(np.linalg.norm(middle)) < _ROUND * self.hollow.radius_m * _TO_MM:
            # A gap around the whole axis is boxed in first, then cut anywhere.
            yield from self.tangents()
            across = self._find_frame()[0]
            yield _build_plane(across, float(origin @ across))
            return
        middle /= np.linalg.norm(middle)
        square = np.cross(axis, middle)
        angles = np.arctan2(out @ square, out @ middle)
        half = (float(angles.min()) + float(angles.max())) / 2
        # Facets that are cut in two would double the number of pieces.
        half = float(angles[np.argmin(np.round(np.abs(angles - half), 9))])
        across = math.cos(half) * square - math.sin(half) * middle
        yield _build_plane(across, float(origin @ across))

    def tangents(self) -> Iterator[tuple[Normal, float]]:
        """Yield cuts that separate the gap from its surroundings."""
        for axis in self._find_frame():
            heights = self.points @ axis
            yield _build_plane(axis, float(heights.min()) + _SHEET_MM)
            yield _build_plane(axis, float(heights.max()) - _SHEET_MM)

    def _find_frame(self) -> tuple[Floats, Floats]:
        """Return two directions across the axis, along the frame's axes if possible."""
        axis = self.hollow.axis
        across = np.eye(3)[int(np.argmin(np.abs(axis)))]
        across = across - (across @ axis) * axis
        across /= np.linalg.norm(across)
        return across, np.cross(axis, across)


def _find_wall(points: Points, hollows: Sequence[Hollow]) -> _Wall | None:
    """Return the wall that holds most corners of a gap, if it holds enough."""
    best, wall = _ON_WALL, None
    for hollow in hollows:
        offsets = points - hollow.point_m * _TO_MM
        across = offsets - np.outer(offsets @ hollow.axis, hollow.axis)
        distances = np.linalg.norm(across, axis=1)
        on = np.abs(distances - hollow.radius_m * _TO_MM) < _LEAST_MM
        if float(on.mean()) > best:
            within = float(distances.max()) <= hollow.radius_m * _TO_MM + _LEAST_MM
            best, wall = float(on.mean()), _Wall(hollow, points[on], within)
    return wall


def _build_plane(normal: Floats, offset: float) -> tuple[Normal, float]:
    x, y, z = (float(value) for value in normal)
    return (x, y, z), float(offset)
