"""Linear algebra whose sums have a fixed order on any processor.

numpy passes `@` and `numpy.linalg` to a BLAS whose order of summation depends on the processor, and
with it the last digits of every posture. These functions use `numpy.einsum` without a BLAS, and
Eigen for linear systems.
"""

from __future__ import annotations

import math

import eigenpy
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def times(left: Array, right: Array) -> Array:
    """Return a product of matrices, or of a matrix and a vector.

    Parameters
    ----------
    left
        Shape (..., rows, inner).
    right
        Shape (..., inner, columns), or (inner,).
    """
    if right.ndim == 1:
        return np.asarray(np.einsum("...ij,j->...i", left, right))
    return np.asarray(np.einsum("...ij,...jk->...ik", left, right))


def dot(left: Array, right: Array) -> float:
    """Return the inner product of two vectors, shape (n,) each."""
    return float(np.einsum("i,i", left, right))


def cross(left: Array, right: Array) -> Array:
    """Return the cross product of two vectors, shape (3,) each."""
    (a, b, c), (p, q, r) = left.tolist(), right.tolist()
    return np.array([b * r - c * q, c * p - a * r, a * q - b * p])


def length(vector: Array) -> float:
    """Return the Euclidean length of a vector, shape (n,)."""
    return math.hypot(*vector.tolist())


def solve_linear(matrix: Array, right: Array) -> Array:
    """Return the solution x of ``matrix x = right``.

    Parameters
    ----------
    matrix
        Shape (n, n). If it is singular, the solution is not finite.
    right
        Shape (n,) or (n, columns).
    """
    return np.asarray(eigenpy.PartialPivLU(matrix).solve(right))
