"""Linear algebra whose sums have one order, whatever processor they are worked out on.

numpy hands `@` and `numpy.linalg` to a BLAS, which adds up as suits the processor: the last digits
of a posture would depend on it, and so would those of all that follows from it. What is here is
compiled once for all: sums of products by `numpy.einsum`, without a BLAS, and systems by Eigen.
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


def dot(one: Array, other: Array) -> float:
    """Return the inner product of two vectors, shape (n,) each."""
    return float(np.einsum("i,i", one, other))


def cross(one: Array, other: Array) -> Array:
    """Return the cross product of two vectors, shape (3,) each."""
    (a, b, c), (p, q, r) = one.tolist(), other.tolist()
    return np.array([b * r - c * q, c * p - a * r, a * q - b * p])


def length(vector: Array) -> float:
    """Return the Euclidean length of a vector, shape (n,)."""
    return math.hypot(*vector.tolist())


def solved(matrix: Array, right: Array) -> Array:
    """Return what a matrix has to be multiplied by to become the right side.

    Parameters
    ----------
    matrix
        Shape (n, n); where it has no inverse, what is returned is not finite.
    right
        Shape (n,) or (n, columns).
    """
    return np.asarray(eigenpy.PartialPivLU(matrix).solve(right))
