"""Contacts between surfaces: a few points with the directions of their pushes, and least help.

`skillplan.collision.standing` decides with them whether bodies stand.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import highspy
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Vector = tuple[float, float, float]
Column = Sequence[tuple[int, float]]
Surface = tuple[Array, NDArray[np.int64]]
"""Corners [m], and triangles as three indices each, anticlockwise from outside."""

FRICTION = 0.3
"""Coefficient of friction between parts [-]."""

BEARS = 0.1
"""Least cosine between the upwards direction and the normal of a face that bears weight [-]."""

_FAR = 1e6
_PER_FORCE = 1e-9
_SETTINGS = (
    ("output_flag", False),
    ("threads", 1),
    ("random_seed", 0),
    ("presolve", "off"),
    ("solver", "simplex"),
)
_SETTLED = highspy.HighsModelStatus.kOptimal
_MOST_POINTS = 12
# Points on each edge at which two surfaces may touch.
_PER_EDGE = 3
# Sine of the angle at which a surface bends away at a rim.
_BENDS = 0.3
# Largest number of pairs of points and faces in one array, unless it has the least points.
_MOST_PAIRS, _LEAST_POINTS = 20_000, 64


def minimize_help(columns: Sequence[Column], loads: Array, scale: Array) -> Array | None:
    """Return the smallest help that each row needs; None if the program has no solution.

    Parameters
    ----------
    columns
        Rows that each force acts on, with coefficients; forces are >= 0.
    loads
        Required sum of forces and help, shape (rows,).
    scale
        Effect of a help of 1 on each row, in either direction, shape (rows,).

    Returns
    -------
    numpy.ndarray or None
        Shares of the scale, shape (rows,) [-].
    """
    rows, forces = len(loads), len(columns)
    helps = np.arange(rows)
    counts = [len(column) for column in columns]
    highs = make_program(
        [*counts, *[1] * (2 * rows)],
        np.concatenate([[row for column in columns for row, _ in column], helps, helps]),
        np.concatenate([[by for column in columns for _, by in column], scale, -scale]),
        np.concatenate([np.full(forces, _PER_FORCE), np.ones(2 * rows)]),
        _FAR,
        (loads, loads),
    )
    highs.run()
    if highs.getModelStatus() != _SETTLED:
        return None
    help_values = np.array(highs.getSolution().col_value[forces:])
    return np.asarray(help_values.reshape(2, rows).sum(axis=0))


def make_program(
    counts: Sequence[int],
    indices: NDArray[np.int64],
    values: Array,
    costs: Array,
    upper: float,
    bounds: tuple[Array, Array],
) -> highspy.Highs:
    """Return a linear program over columns from 0 to an upper bound.

    Parameters
    ----------
    counts
        Number of entries of each column.
    indices, values
        Rows and coefficients of the entries, column by column.
    costs
        Cost of each column.
    bounds
        Lower and upper bounds of the rows.
    """
    program = highspy.HighsLp()
    program.num_row_, program.num_col_ = len(bounds[0]), len(counts)
    program.col_cost_ = costs
    program.col_lower_, program.col_upper_ = np.zeros(len(counts)), np.full(len(counts), upper)
    program.row_lower_, program.row_upper_ = bounds
    matrix = program.a_matrix_
    matrix.format_ = highspy.MatrixFormat.kColwise
    matrix.start_ = np.cumsum([0, *counts])
    matrix.index_, matrix.value_ = indices, values
    highs = highspy.Highs()
    for key, value in _SETTINGS:
        highs.setOptionValue(key, value)
    highs.passModel(program)
    return highs


def select_spread(points_m: Array, normals: Array, most: int = _MOST_POINTS) -> list[int]:
    """Return the numbers of a few contacts that are far apart, or push in other directions."""
    if len(points_m) <= most:
        return list(range(len(points_m)))
    extent = max(float(np.ptp(points_m, axis=0).max()), 1e-9)
    keys = np.hstack([points_m / extent, normals])
    chosen = [int(np.argmax(np.linalg.norm(keys - keys.mean(axis=0), axis=1)))]
    gaps = np.linalg.norm(keys - keys[chosen[0]], axis=1)
    while len(chosen) < most:
        chosen.append(int(np.argmax(gaps)))
        gaps = np.minimum(gaps, np.linalg.norm(keys - keys[chosen[-1]], axis=1))
    return sorted(set(chosen))


@lru_cache(maxsize=1024)
def find_axes_across(up: Vector) -> Array:
    """Return two unit vectors that form a right-handed frame with a third."""
    along = np.asarray(up)
    smallest = np.eye(3)[int(np.argmin(np.abs(along)))]
    first = np.cross(along, smallest)
    first = first / np.linalg.norm(first)
    return np.stack([first, np.cross(along, first)])


def collect_pushes(
    pairs: Iterable[tuple[Surface, Surface, Array, Array]],
    tolerance_m: float,
    most: int = _MOST_POINTS,
) -> tuple[Array, Array]:
    """Return a few points at which the second surfaces push the first ones, far from each other.

    Parameters
    ----------
    pairs
        Two surfaces each, and the corners of the box in which both may touch [m].
    most
        Largest number of points.

    Returns
    -------
    tuple of numpy.ndarray
        Points [m], and unit vectors of the pushes, shape (points, 3) each.
    """
    points: list[Array] = []
    normals: list[Array] = []
    for first, second, low, high in pairs:
        for body, face, sign in ((first, second, 1.0), (second, first, -1.0)):
            there, normal = _find_touching(body, face, low, high, tolerance_m)
            points.append(there)
            normals.append(sign * normal)
    if not points:
        return np.empty((0, 3)), np.empty((0, 3))
    everywhere, directions = np.concatenate(points), np.concatenate(normals)
    chosen = select_spread(everywhere, directions, most)
    return everywhere[chosen], directions[chosen]


def _find_touching(
    body: Surface, face: Surface, low: Array, high: Array, tolerance_m: float
) -> tuple[Array, Array]:
    """Return points on edges of a body that lie on faces of another, and the faces' normals."""
    faces, points = _Patch(face, low, high), _sample_edges(_Patch(body, low, high), low, high)
    places, normals = faces.places, faces.normals
    if not len(points.points_m) or not len(places):
        return np.empty((0, 3)), np.empty((0, 3))
    levels = np.einsum("fi,fi->f", places[:, 0], normals)
    there: list[Array] = []
    pushed: list[Array] = []
    lowest, highest = places.min(axis=1) - 4 * tolerance_m, places.max(axis=1) + 4 * tolerance_m
    step = max(_LEAST_POINTS, _MOST_PAIRS // len(places))
    for first in range(0, len(points.points_m), step):
        some = points.points_m[first : first + step]
        # Points come in order of x, so few faces of a fine mesh are near those of one array.
        near = (highest >= some.min(axis=0)).all(axis=1) & (lowest <= some.max(axis=0)).all(axis=1)
        chosen = np.flatnonzero(near)
        distances = np.abs(some @ normals[chosen].T - levels[chosen])
        # A face pushes only what lies before it, such as the foot of a pin, not the wall above it.
        before = points.outward[first : first + step] @ normals[chosen].T < 0
        point, number = np.nonzero((distances <= tolerance_m) & before)
        distances, number = distances[point, number], chosen[number]
        beside = np.einsum("qki,qki->qk", some[point, None] - places[number], faces.inwards[number])
        over = (beside >= -tolerance_m).all(axis=1)
        point, number, distances = point[over], number[over], distances[over]
        rims = faces.rims[number] & (beside[over] <= tolerance_m)
        lies = points.lie_before(first + point, faces, number, rims, tolerance_m)
        point, number, distances = point[lies], number[lies], distances[lies]
        nearest = np.lexsort((distances, point))
        touching, first_of = np.unique(point[nearest], return_index=True)
        there.append(some[touching])
        pushed.append(normals[number[nearest[first_of]]])
    return np.concatenate(there), np.concatenate(pushed)


class _Patch:
    """The triangles of a surface near a box.

    Attributes
    ----------
    places, normals
        Corners [m] and outward unit normals, shape (triangles, 3, 3) and (triangles, 3).
    inwards
        Unit vectors across the sides of each triangle, into it, shape (triangles, 3, 3).
    rims
        True for sides at which the surface bends away, shape (triangles, 3).
    corners, triangles
        Distinct corners [m], and the numbers of those of each triangle.
    sides, side_of
        Numbers of the corners of each edge, and the number of the edge at each side of a triangle.
    """

    def __init__(self, surface: Surface, low: Array, high: Array) -> None:
        places = surface[0][surface[1]]
        near = (places.max(axis=1) >= low).all(axis=1) & (places.min(axis=1) <= high).all(axis=1)
        places = places[near]
        normals = np.cross(places[:, 1] - places[:, 0], places[:, 2] - places[:, 0])
        lengths = np.linalg.norm(normals, axis=1)
        self.places, self.normals = places[lengths > 0], _scale(normals[lengths > 0])
        ways = np.roll(self.places, -1, axis=1) - self.places
        self.inwards = _scale(np.cross(self.normals[:, None], ways))
        # Faces of CAD have corners of their own.
        rounded = np.round(self.places.reshape(-1, 3), 7)
        _, kept, numbers = np.unique(rounded, axis=0, return_index=True, return_inverse=True)
        self.corners = self.places.reshape(-1, 3)[kept]
        self.triangles = numbers.reshape(-1, 3)
        pairs = np.stack([self.triangles, np.roll(self.triangles, -1, axis=1)], axis=2)
        self.sides, side_of = np.unique(
            np.sort(pairs.reshape(-1, 2), axis=1), axis=0, return_inverse=True
        )
        self.side_of = side_of.reshape(-1)
        across = _sum_by(self.side_of, self.inwards.reshape(-1, 3), len(self.sides))
        others = across[self.side_of].reshape(-1, 3, 3) - self.inwards
        self.rims = np.einsum("fki,fi->fk", others, self.normals) < -_BENDS


@dataclass(frozen=True, eq=False, slots=True)
class _EdgePoints:
    """Points on the edges of a body.

    Parameters
    ----------
    points_m
        Points in order of x, shape (points, 3) [m].
    outward
        Unit vectors out of the body, shape (points, 3).
    owners
        Number of the corner or edge on which each point is.
    begins
        Number of the first way of each corner or edge.
    ways, ends_m
        Unit vectors from it along the body, and corners of the body there [m], shape (ways, 3).
    """

    points_m: Array
    outward: Array
    owners: NDArray[np.int64]
    begins: NDArray[np.int64]
    ways: Array
    ends_m: Array

    def lie_before(
        self,
        numbers: NDArray[np.int64],
        faces: _Patch,
        under: NDArray[np.int64],
        rims: NDArray[np.bool_],
        tolerance_m: float,
    ) -> NDArray[np.bool_]:
        """Return which points can be pushed by faces.

        The body lies before the face all about the point. At a rim it reaches over the face.

        Parameters
        ----------
        numbers, under
            Number of a point, and of a triangle of the other body, shape (pairs,).
        rims
            Sides of the triangle that are a rim near the point, shape (pairs, 3).
        """
        if not len(numbers):
            return np.zeros(0, dtype=bool)
        begins = self.begins[self.owners[numbers]]
        counts = self.begins[self.owners[numbers] + 1] - begins
        first = np.cumsum(counts) - counts
        ways = np.arange(counts.sum()) + np.repeat(begins - first, counts)
        below = np.repeat(under, counts)
        heights = np.einsum("wi,wi->w", self.ways[ways], faces.normals[below])
        lies = np.minimum.reduceat(heights, first) >= -BEARS
        for side in range(3):
            reaches_m = np.einsum(
                "wi,wi->w",
                self.ends_m[ways] - faces.places[below, side],
                faces.inwards[below, side],
            )
            over = (reaches_m > tolerance_m) & (np.abs(heights) <= 2 * BEARS)
            lies &= ~rims[:, side] | np.logical_or.reduceat(over, first)
        return np.asarray(lies)


def _sample_edges(patch: _Patch, low: Array, high: Array) -> _EdgePoints:
    """Return points on the edges of a surface within a box."""
    corners, sides = patch.corners, patch.sides
    start, along = corners[sides[:, 0]], corners[sides[:, 1]] - corners[sides[:, 0]]
    with np.errstate(divide="ignore", invalid="ignore"):
        bounds = np.stack([(low - start) / along, (high - start) / along])
    still = np.abs(along) < 1e-12
    inside = (start >= low) & (start <= high)
    first = np.where(still, np.where(inside, 0.0, np.inf), bounds.min(axis=0)).max(axis=1)
    last = np.where(still, np.where(inside, 1.0, -np.inf), bounds.max(axis=0)).min(axis=1)
    first, last = np.maximum(first, 0.0), np.minimum(last, 1.0)
    crosses = np.flatnonzero(first <= last)
    shares = np.linspace(first[crosses], last[crosses], _PER_EDGE, axis=1)
    inner = (start[crosses, None] + shares[..., None] * along[crosses, None]).reshape(-1, 3)
    boxed = np.flatnonzero(((corners >= low) & (corners <= high)).all(axis=1))
    points = np.concatenate([corners[boxed], inner])
    owners = np.concatenate([boxed, np.repeat(crosses + len(corners), _PER_EDGE)])
    # Points are thinned by `select_spread` only when it is known which of them touch.
    _, chosen = np.unique(np.round(points, 7), axis=0, return_index=True)
    owners = owners[chosen]
    return _EdgePoints(points[chosen], _find_outward(patch)[owners], owners, *_list_ways(patch))


def _list_ways(patch: _Patch) -> tuple[NDArray[np.int64], Array, Array]:
    """Return the ways from the corners and edges along the surface, as `_EdgePoints` has them."""
    corners, sides = patch.corners, patch.sides
    edges = np.arange(len(sides)) + len(corners)
    along = _scale(corners[sides[:, 1]] - corners[sides[:, 0]])
    ways = np.concatenate([along, -along, along, -along, patch.inwards.reshape(-1, 3)])
    owners = np.concatenate([*sides.T, edges, edges, patch.side_of + len(corners)])
    ends = np.concatenate([sides[:, 1], sides[:, 0]])
    ends = np.concatenate([ends, ends, np.roll(patch.triangles, -2, axis=1).reshape(-1)])
    order = np.argsort(owners, kind="stable")
    counts = np.bincount(owners, minlength=len(corners) + len(sides))
    return np.concatenate([[0], np.cumsum(counts)]), ways[order], corners[ends[order]]


def _find_outward(patch: _Patch) -> Array:
    """Return vectors that point out of a body at its corners, then at its edges.

    At a corner, normals count by the angles of their faces (Baerentzen and Aanaes: Signed distance
    computation using the angle weighted pseudonormal, 2005).
    """
    ways = _scale(np.roll(patch.places, -1, axis=1) - patch.places)
    cosines = np.einsum("fki,fki->fk", ways, -np.roll(ways, 1, axis=1))
    angles_rad = np.arccos(np.clip(cosines, -1.0, 1.0)).reshape(-1, 1)
    normals = np.repeat(patch.normals, 3, axis=0)
    at_corners = _sum_by(patch.triangles.reshape(-1), angles_rad * normals, len(patch.corners))
    return np.concatenate([at_corners, _sum_by(patch.side_of, normals, len(patch.sides))])


def _sum_by(numbers: NDArray[np.int64], vectors: Array, count: int) -> Array:
    """Return the sums of the vectors with the same number."""
    return np.stack([np.bincount(numbers, column, count) for column in vectors.T], axis=1)


def _scale(vectors: Array) -> Array:
    """Return unit vectors."""
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(lengths, 1e-30))
