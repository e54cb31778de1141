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
    found = np.zeros(matrix.shape[0])
    mujoco.mju_mulMatVec(found, np.ascontiguousarray(matrix), vector)
    return found


class Factor:
    """The Cholesky factor of a symmetric positive definite matrix.

    Parameters
    ----------
    matrix
        Shape (n, n).
    """

    def __init__(self, matrix: Vector) -> None:
        self._factor = np.array(matrix)
        mujoco.mju_cholFactor(self._factor, 0.0)

    def solve(self, vector: Vector) -> Vector:
        """Return the inverse of the matrix times a vector, shape (n,)."""
        found = np.zeros(len(vector))
        mujoco.mju_cholSolve(found, self._factor, vector)
        return found
