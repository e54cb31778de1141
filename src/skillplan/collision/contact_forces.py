"""Contact forces: whether pushes and friction keep a body in place, by linear programs.

A released body stays if forces at its contacts balance its weight, and a small sideways push in any
direction (Mason: Mechanics of Robotic Manipulation, chapter 5). Forces push only. Faces that bear
weight have friction. Upright walls have none: whether a clamped wall carries anything depends on a
preload that geometry does not state, so a pin that nothing bears falls through its hole.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import highspy
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Vector = tuple[float, float, float]
Column = Sequence[tuple[int, float]]

FRICTION = 0.3
"""Coefficient of friction between parts [-]."""

BEARS = 0.1
"""Least cosine between the upwards direction and the normal of a face that bears weight [-]."""

_FAR = 1e6
_PER_FORCE = 1e-9
_SETTLED = highspy.HighsModelStatus.kOptimal
_PUSH = 0.02  # sideways push, as a share of the weight
_HELP = 2e-3  # share of the weight that the program may miss
_MOST_POINTS = 12


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
    program = highspy.HighsLp()
    program.num_row_, program.num_col_ = rows, forces + 2 * rows
    program.col_cost_ = np.concatenate([np.full(forces, _PER_FORCE), np.ones(2 * rows)])
    program.col_lower_, program.col_upper_ = (
        np.zeros(forces + 2 * rows),
        np.full(forces + 2 * rows, _FAR),
    )
    program.row_lower_ = program.row_upper_ = loads
    matrix = program.a_matrix_
    matrix.format_ = highspy.MatrixFormat.kColwise
    matrix.start_ = np.cumsum([0, *counts, *[1] * (2 * rows)])
    matrix.index_ = np.concatenate([[row for column in columns for row, _ in column], helps, helps])
    matrix.value_ = np.concatenate([[by for column in columns for _, by in column], scale, -scale])
    highs = highspy.Highs()
    for key, value in (
        ("output_flag", False),
        ("threads", 1),
        ("random_seed", 0),
        ("presolve", "off"),
        ("solver", "simplex"),
    ):
        highs.setOptionValue(key, value)
    highs.passModel(program)
    highs.run()
    if highs.getModelStatus() != _SETTLED:
        return None
    help_values = np.array(highs.getSolution().col_value[forces:])
    return np.asarray(help_values.reshape(2, rows).sum(axis=0))


def stays_balanced(offsets_m: Array, normals: Array, up: Vector, reach_m: float) -> bool:
    """Return whether contact forces balance the weight of a body and small sideways pushes.

    Parameters
    ----------
    offsets_m
        Contact points from the centre of mass, shape (points, 3) [m].
    normals
        Unit vectors along which the contacts push the body, shape (points, 3).
    reach_m
        Largest extent of the body, > 0 [m].
    """
    upwards = np.asarray(up)
    if not len(normals) or not (normals @ upwards > BEARS).any():
        return False
    across = find_axes_across(up)
    columns = [
        list(enumerate(force)) for force in _span_forces(offsets_m, normals, upwards).tolist()
    ]
    scale = np.array([1.0] * 3 + [reach_m] * 3)
    for push in (across[0], -across[0], across[1], -across[1]):
        loads = np.concatenate([upwards + _PUSH * push, np.zeros(3)])
        help_values = minimize_help(columns, loads, scale)
        if help_values is None or float(help_values.sum()) > _HELP:
            return False
    return True


def _span_forces(offsets_m: Array, normals: Array, up: Array) -> Array:
    """Return forces and torques that span those of the contacts, shape (forces, 6)."""
    bears = normals @ up > BEARS
    forces, points = [normals[~bears]], [offsets_m[~bears]]
    for normal, offset in zip(normals[bears], offsets_m[bears], strict=True):
        across = find_axes_across((float(normal[0]), float(normal[1]), float(normal[2])))
        sides = FRICTION * np.concatenate([across, -across])
        forces.append(normal + sides)
        points.append(np.tile(offset, (4, 1)))
    force, point = np.concatenate(forces), np.concatenate(points)
    return np.hstack([force, np.cross(point, force)])


def select_spread(points_m: Array, normals: Array) -> list[int]:
    """Return the numbers of a few contacts that are far apart, or push in other directions."""
    if len(points_m) <= _MOST_POINTS:
        return list(range(len(points_m)))
    extent = max(float(np.ptp(points_m, axis=0).max()), 1e-9)
    keys = np.hstack([points_m / extent, normals])
    chosen = [int(np.argmax(np.linalg.norm(keys - keys.mean(axis=0), axis=1)))]
    gaps = np.linalg.norm(keys - keys[chosen[0]], axis=1)
    while len(chosen) < _MOST_POINTS:
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
