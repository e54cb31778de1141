"""Contacts between surfaces: a few points with the directions of their pushes, and least help.

`skillplan.collision.standing` decides with them whether bodies stand.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
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
# Largest cosine between an edge that lies on a face and the normal of the face.
_PARALLEL = 0.05
# Largest cosine between the normals of two surfaces that touch.
_AWAY = 0.5
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
    points, along, outward = _sample_edges(body, low, high)
    corners, triangles = face
    places = corners[triangles]
    near = (places.max(axis=1) >= low).all(axis=1) & (places.min(axis=1) <= high).all(axis=1)
    places = places[near]
    normals = np.cross(places[:, 1] - places[:, 0], places[:, 2] - places[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    places, normals = places[lengths > 0], normals[lengths > 0] / lengths[lengths > 0, None]
    if not len(points) or not len(places):
        return np.empty((0, 3)), np.empty((0, 3))
    inwards = np.cross(normals[:, None], np.roll(places, -1, axis=1) - places)
    inwards /= np.maximum(np.linalg.norm(inwards, axis=2), 1e-30)[..., None]
    levels = np.einsum("fi,fi->f", places[:, 0], normals)
    there: list[Array] = []
    pushed: list[Array] = []
    lowest, highest = places.min(axis=1) - 4 * tolerance_m, places.max(axis=1) + 4 * tolerance_m
    step = max(_LEAST_POINTS, _MOST_PAIRS // len(places))
    for first in range(0, len(points), step):
        some = points[first : first + step]
        # Points come in order of x, so few faces of a fine mesh are near those of one array.
        near = (highest >= some.min(axis=0)).all(axis=1) & (lowest <= some.max(axis=0)).all(axis=1)
        faces = np.flatnonzero(near)
        distances = np.abs(some @ normals[faces].T - levels[faces])
        close = distances <= tolerance_m
        # An edge that passes through a face does not touch it.
        close &= np.abs(along[first : first + step] @ normals[faces].T) < _PARALLEL
        # A face pushes only what lies before it, such as the foot of a pin, not the wall above it.
        close &= outward[first : first + step] @ normals[faces].T < _AWAY
        point, number = np.nonzero(close)
        beneath = faces[number]
        beside = np.einsum("qki,qki->qk", some[point, None] - places[beneath], inwards[beneath])
        over = (beside >= -tolerance_m).all(axis=1)
        point, number = point[over], number[over]
        nearest = np.lexsort((distances[point, number], point))
        touching, first_of = np.unique(point[nearest], return_index=True)
        there.append(some[touching])
        pushed.append(normals[faces[number[nearest[first_of]]]])
    return np.concatenate(there), np.concatenate(pushed)


def _sample_edges(body: Surface, low: Array, high: Array) -> tuple[Array, Array, Array]:
    """Return points on the edges of a surface within a box, directions and outward normals.

    Directions are unit vectors along the edges, zero for corners.
    """
    corners, triangles = body
    places = corners[triangles]
    normals = np.cross(places[:, 1] - places[:, 0], places[:, 2] - places[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-30)[:, None]
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    sides, edge_of = np.unique(sides, axis=0, return_inverse=True)
    outward = _sum_normals(edge_of.reshape(-1), np.repeat(normals, 3, axis=0), len(sides))
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
    boxed = ((corners >= low) & (corners <= high)).all(axis=1)
    ends = corners[boxed]
    at_ends = _sum_normals(triangles.reshape(-1), np.repeat(normals, 3, axis=0), len(corners))
    points = np.concatenate([ends, inner])
    directions = np.repeat(along / lengths[:, None], _PER_EDGE, axis=0)
    directions = np.concatenate([np.zeros_like(ends), directions])
    outward = np.concatenate([at_ends[boxed], np.repeat(outward[crosses], _PER_EDGE, axis=0)])
    # Points are thinned by `select_spread` only when it is known which of them touch.
    _, chosen = np.unique(np.round(points, 7), axis=0, return_index=True)
    return points[chosen], directions[chosen], outward[chosen]


def _sum_normals(numbers: NDArray[np.int64], normals: Array, count: int) -> Array:
    """Return the unit vectors of the sums of normals with the same number."""
    sums = np.stack([np.bincount(numbers, column, count) for column in normals.T], axis=1)
    return np.asarray(sums / np.maximum(np.linalg.norm(sums, axis=1), 1e-30)[:, None])
