"""Decide whether one part blocks another along a direction, by a lattice of rays through both.

A ray is blocked if material of one part lies ahead of material of the other. A pair is blocked if a
whole disc of rays is, with the tolerance as radius. Parts that only touch, or whose tessellated
walls cut into each other, block no disc.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from skillplan_cad.blocking.ray_mesh import Floats, Heights, RayMesh, RayView

# Largest cosine between a direction and the normal of a face along it.
_ALONG = 1e-6


class Outline:
    """Silhouette edges of a part along a direction.

    Parameters
    ----------
    edges
        Vertices and triangles of each edge, as in `list_mesh_edges`.
    """

    def __init__(self, mesh: RayMesh, view: RayView, edges: NDArray[np.int64]) -> None:
        facing, flat = view.facing, view.flat
        side = np.where(np.abs(facing) < _ALONG, 0, np.sign(facing)).astype(np.int64)
        first, second = edges[:, 2], edges[:, 3]
        turned = edges[side[first] != side[second]]
        self.start, self.end = flat[turned[:, 0]], flat[turned[:, 1]]
        along = self.end - self.start
        length = np.linalg.norm(along, axis=1)
        kept = length > 1e-9
        turned, along, length = turned[kept], along[kept], length[kept]
        self.start, self.end, self.length = self.start[kept], self.end[kept], length
        normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / length[:, None]
        # The triangle that faces the direction more lies inside the outline.
        inner = np.where(
            np.abs(facing[turned[:, 2]]) >= np.abs(facing[turned[:, 3]]), turned[:, 2], turned[:, 3]
        )
        middle = flat[mesh.triangles[inner]].mean(axis=1)
        inwards = np.einsum("ij,ij->i", middle - self.start, normal) >= 0
        self.inwards = np.where(inwards[:, None], normal, -normal)

    def points(self, inset: float, low: Floats, high: Floats, most: int) -> Floats:
        """Return points inside the outline.

        Parameters
        ----------
        inset
            Distance from the outline [mm].
        most
            Largest number of points, spread by edge length.
        """
        near = (np.minimum(self.start, self.end) <= high + inset).all(axis=1) & (
            np.maximum(self.start, self.end) >= low - inset
        ).all(axis=1)
        if not near.any():
            return np.zeros((0, 2))
        start, end, inwards = self.start[near], self.end[near], self.inwards[near]
        # Only edges that meet the rectangle count.
        length = self.length[near]
        ends = np.cumsum(length)
        count = min(most, max(len(length), 16))
        at = (np.arange(count) + 0.5137) * ends[-1] / count
        which = np.minimum(np.searchsorted(ends, at), len(length) - 1)
        share = 1 - (ends[which] - at) / length[which]
        chosen = start[which] + share[:, None] * (end - start)[which] + inset * inwards[which]
        inside = (chosen >= low).all(axis=1) & (chosen <= high).all(axis=1)
        return np.asarray(chosen[inside])


def list_mesh_edges(triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return each edge once: its two vertices and its two triangles."""
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(triangles)), 3)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    same = np.flatnonzero((edges[order[1:]] == edges[order[:-1]]).all(axis=1))
    return np.column_stack([edges[order[same]], owner[order[same]], owner[order[same + 1]]])


# Rays per side, first few, then many; outline points per part.
_COARSE, _FINE, _OUTLINE_POINTS = 16, 64, 192
# Keeps rays off edges and diagonals, which lie at round fractions of a part.
_OFF = 0.5 + 0.0137
_RING, _GROWN = 8, 12
_ABOVE_MM = 1e-4
_CHUNKS = (4, 20, 160, 1 << 30)


class Side(NamedTuple):
    """One part of a pair along a direction.

    Parameters
    ----------
    low, high
        Corners of its rectangle across the direction.
    """

    view: RayView
    outline: Outline
    low: Floats
    high: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Block:
    """A blocked disc.

    Parameters
    ----------
    radius_mm
        Largest of the requested radii with a blocked disc.
    points
        Blocked points across the direction, the centre of the disc first.
    """

    radius_mm: float
    points: Floats
    width_mm: float


class PairLattice:
    """Rays through a pair of parts, along a direction and against it.

    Parameters
    ----------
    chord_mm
        Greatest distance of triangles from the true surfaces.
    """

    def __init__(self, first: Side, second: Side, chord_mm: float) -> None:
        self._first, self._second = first, second
        self._chord = chord_mm
        self.low = np.maximum(first.low, second.low)
        self.high = np.minimum(first.high, second.high)
        self._grids: dict[int, tuple[Floats, Heights, Heights]] = {}
        # True if any ray of a lattice is blocked by the smallest disc, by sign and side.
        self._hopes: dict[tuple[int, int], bool] = {}

    def find_block(self, sign: int, radii_mm: tuple[float, ...]) -> Block | None:
        """Return the disc that blocks the first part along the direction or against it, or None.

        Parameters
        ----------
        sign
            1 along the direction, -1 against it.
        radii_mm
            Radii of discs, descending; the first blocked one ends the search.
        """
        mover, other = (self._first, self._second)[::sign]
        if mover.view.bottom >= other.view.top - _ABOVE_MM:
            # The other part lies behind.
            return None
        fitting = [radius for radius in radii_mm if ((self.high - self.low) >= 2 * radius).all()]
        block = None
        for radius in fitting:
            for side in (_COARSE, _FINE):
                if block is None and self._is_hopeful(sign, fitting[-1], side):
                    block = self._search_lattice(sign, radius, side)
            if block is not None:
                break
        # Outlines may have larger blocked discs than the lattice.
        for radius in reversed(fitting):
            if block is None or radius > block.radius_mm:
                wider = self._search_outlines(sign, radius)
                if wider is None:
                    break
                block = wider
        return block

    def _trace_grid(self, side: int) -> tuple[Floats, Heights, Heights]:
        if side not in self._grids:
            share = (np.arange(side) + _OFF) / (side + 0.0411)
            x = self.low[0] + share * (self.high[0] - self.low[0])
            y = self.low[1] + share * (self.high[1] - self.low[1])
            points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
            self._grids[side] = (points, *self._trace_heights(points))
        return self._grids[side]

    def _is_hopeful(self, sign: int, radius: float, side: int) -> bool:
        """Return whether any ray of a lattice is blocked; larger discs block no more rays."""
        key = (sign, side)
        if key not in self._hopes:
            _, first, second = self._trace_grid(side)
            self._hopes[key] = bool(self._mask_blocked(sign, radius, first, second).any())
        return self._hopes[key]

    def _trace_heights(self, points: Floats) -> tuple[Heights, Heights]:
        first = self._first.view.trace_heights(points)
        hit = np.isfinite(first.low)
        if hit.all():
            return first, self._second.view.trace_heights(points)
        # Rays that miss one part need no heights of the other.
        some = self._second.view.trace_heights(points[hit])
        return first, Heights(*(_scatter(value, hit) for value in _values(some)))

    def _search_lattice(self, sign: int, radius: float, side: int) -> Block | None:
        points, first, second = self._trace_grid(side)
        blocked = self._mask_blocked(sign, radius, first, second)
        if not blocked.any():
            return None
        step = (self.high - self.low) / side
        framed = np.pad(blocked.reshape(side, side), 1)
        depths: Any = distance_transform_edt(framed, sampling=tuple(step))
        depth: Floats = depths[1:-1, 1:-1].reshape(-1)
        candidates = np.flatnonzero(blocked)
        order = candidates[np.argsort(-depth[candidates], kind="stable")]
        centre = self._find_disc(sign, radius, points[order], are_blocked=True)
        if centre is None:
            return None
        inner = order[depth[order] >= radius][:40]
        shown = np.concatenate([centre[None], points[inner]])
        width = max(self._measure_width(sign, radius, centre), 2 * float(depth.max() - step.max()))
        return Block(radius, shown, width)

    def _search_outlines(self, sign: int, radius: float) -> Block | None:
        for side in (self._first, self._second):
            points = side.outline.points(radius * 1.02, self.low, self.high, _OUTLINE_POINTS)
            if len(points):
                centre = self._find_disc(sign, radius, points)
                if centre is not None:
                    return Block(radius, centre[None], self._measure_width(sign, radius, centre))
        return None

    def _measure_width(self, sign: int, radius: float, centre: Floats) -> float:
        """Return a lower bound on the diameter of the largest blocked disc around a point."""
        largest = float((self.high - self.low).min()) / 2
        if largest <= radius:
            return 2 * radius
        radii = np.append(radius, np.geomspace(radius, largest, _GROWN + 1)[1:])
        ring = (radii[:, None, None] * _build_ring(2 * _RING)).reshape(-1, 2)
        whole = self._mask_blocked(sign, radius, *self._trace_heights(centre + ring))
        held = np.asarray(whole.reshape(len(radii), -1).all(axis=1))
        failed = np.flatnonzero(~held[1:])
        return float(2 * radii[failed[0] if len(failed) else -1])

    def _find_disc(
        self, sign: int, radius: float, centres: Floats, *, are_blocked: bool = False
    ) -> Floats | None:
        """Return the first of the points with a blocked disc around it, or None."""
        begin = 0
        ring = radius * _build_ring(_RING)
        for size in _CHUNKS:
            some = centres[begin : begin + size]
            if not len(some):
                return None
            if not are_blocked:
                some = some[self._mask_blocked(sign, radius, *self._trace_heights(some))]
            if len(some):
                around = (some[:, None] + ring).reshape(-1, 2)
                whole = self._mask_blocked(sign, radius, *self._trace_heights(around))
                good = np.flatnonzero(whole.reshape(-1, _RING).all(axis=1))
                if len(good):
                    return np.asarray(some[good[0]])
            begin += size
        return None

    def _mask_blocked(
        self, sign: int, radius: float, first: Heights, second: Heights
    ) -> NDArray[np.bool_]:
        """Return a mask of the rays blocked by more than the tolerance, square to the surfaces."""
        mover, other = (first, second) if sign > 0 else (second, first)
        deep = max(radius, 2 * self._chord)
        slope = np.minimum(mover.low_slope, other.high_slope)
        with np.errstate(invalid="ignore"):
            return ((other.high - mover.low) * slope > deep) | (
                (other.low >= mover.high - _ABOVE_MM) & (other.high > mover.high + _ABOVE_MM)
            )


def find_first_contact(
    mover: RayView, other: RayView, points: Floats, frame: Floats
) -> tuple[float, Floats, Floats]:
    """Return the distance of a part's move until it meets the other, and the contact points.

    Parameters
    ----------
    points
        Points across the direction, all blocked.
    frame
        Two directions across and the direction itself, one per row.

    Returns
    -------
    tuple
        Distance [mm], point of the other part, and point of the moving part.
    """
    entries, _ = other.trace_crossings(points)
    _, exits = mover.trace_crossings(points)
    with np.errstate(invalid="ignore"):
        gaps = entries[:, :, None] - exits[:, None, :]
    gaps = np.where(np.isfinite(gaps) & (gaps > -_ABOVE_MM), np.maximum(gaps, 0.0), np.inf)
    best = np.unravel_index(int(np.argmin(gaps)), gaps.shape)
    if np.isfinite(gaps[best]):
        ray, distance = int(best[0]), float(gaps[best])
        height = float(entries[ray, best[1]])
    else:
        # They overlap on every ray; at the rim of open surfaces a ray may miss one of them.
        for heights in (entries, exits):
            crossed = np.flatnonzero(np.isfinite(heights).any(axis=1))
            if len(crossed):
                break
        ray, distance = int(crossed[0]) if len(crossed) else 0, 0.0
        met = heights[ray][np.isfinite(heights[ray])]
        height = float(met.min()) if len(met) else 0.0
    place = points[ray] @ frame[:2] + height * frame[2]
    return distance, place, place - distance * frame[2]


def _build_ring(count: int) -> Floats:
    """Return points on the unit circle."""
    turn = 2 * np.pi * (np.arange(count) + 0.137) / count
    return np.stack([np.cos(turn), np.sin(turn)], axis=1)


def _values(heights: Heights) -> tuple[Floats, Floats, Floats, Floats]:
    return heights.low, heights.high, heights.low_slope, heights.high_slope


def _scatter(values: Floats, where: NDArray[np.bool_]) -> Floats:
    spread = np.full(len(where), np.nan)
    spread[where] = values
    return spread
