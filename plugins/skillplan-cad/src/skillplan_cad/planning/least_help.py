"""The least help that keeps parts where they are, beside forces that cost next to nothing."""

from __future__ import annotations

from collections.abc import Sequence

import highspy
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Column = Sequence[tuple[int, float]]

_FAR = 1e6
_PER_FORCE = 1e-9
_SETTLED = highspy.HighsModelStatus.kOptimal


def least_help(columns: Sequence[Column], wanted: Array, scale: Array) -> Array | None:
    """Return the help that each row needs; None where the program has no solution.

    Parameters
    ----------
    columns
        Of each force, which may push but not pull, the rows that it acts on, and how much.
    wanted
        What forces and help have to add up to, shape (rows,).
    scale
        What a help of 1 does to each row, in either direction, shape (rows,).

    Returns
    -------
    numpy.ndarray or None
        Shape (rows,), of no unit: shares of the scale.
    """
    rows, forces = len(wanted), len(columns)
    helps = np.arange(rows)
    counts = [len(column) for column in columns]
    program = highspy.HighsLp()
    program.num_row_, program.num_col_ = rows, forces + 2 * rows
    program.col_cost_ = np.concatenate([np.full(forces, _PER_FORCE), np.ones(2 * rows)])
    program.col_lower_, program.col_upper_ = (
        np.zeros(forces + 2 * rows),
        np.full(forces + 2 * rows, _FAR),
    )
    program.row_lower_ = program.row_upper_ = wanted
    matrix = program.a_matrix_
    matrix.format_ = highspy.MatrixFormat.kColwise
    matrix.start_ = np.cumsum([0, *counts, *[1] * (2 * rows)])
    matrix.index_ = np.concatenate([[row for one in columns for row, _ in one], helps, helps])
    matrix.value_ = np.concatenate([[by for one in columns for _, by in one], scale, -scale])
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
    found = np.array(highs.getSolution().col_value[forces:])
    return np.asarray(found.reshape(2, rows).sum(axis=0))
