"""Linear algebra in a fixed order, by the simulator's own routines.

A BLAS adds up in the order that suits the processor it runs on, so that the last digits of a torque
would depend on it, and a verdict on them.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


def times(matrix: Vector, vector: Vector) -> Vector:
    """Return a matrix times a vector, shapes (rows, columns) and (columns,)."""
    found = np.empty(matrix.shape[0])
    mujoco.mju_mulMatVec(found, matrix, vector)
    return found


def times_transposed(matrix: Vector, vector: Vector) -> Vector:
    """Return a transposed matrix times a vector, shapes (rows, columns) and (rows,)."""
    found = np.empty(matrix.shape[1])
    mujoco.mju_mulMatTVec(found, matrix, vector)
    return found


def product(left: Vector, right: Vector) -> Vector:
    """Return a product of matrices, shapes (rows, inner) and (inner, columns)."""
    found = np.empty((left.shape[0], right.shape[1]))
    mujoco.mju_mulMatMat(found, left, right)
    return found
