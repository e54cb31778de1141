"""Transitivity cuts on precedence variables, which also forbid a node between neighbours.

Where j comes before k and k before i, j comes before i, but not right before (Sarin, Sherali
and Bhootra, "New tighter polynomial length formulations for the asymmetric traveling salesman
problem with and without precedence constraints", 2005).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.compiled import compiled

Integers = NDArray[np.int64]
Floats = NDArray[np.float64]


@compiled
def violated_triples(
    earlier: Floats, taken: Floats, violation: float
) -> tuple[Integers, Integers, Integers, Floats]:
    """Return for every pair the most violated transitivity cut, if any.

    Parameters
    ----------
    earlier
        Fraction by which one node comes before another, in [0, 1], shape (n, n).
    taken
        Value of each arc, shape (n, n).
    violation
        Least violation of a cut.

    Returns
    -------
    tuple
        Nodes j, k and i of which ``earlier[j, i] - taken[j, i]`` is less than
        ``earlier[j, k] + earlier[k, i] - 1``, and by how much, shape (t,) each.
    """
    n = len(earlier)
    ones = np.empty(n * n, dtype=np.int64)
    betweens = np.empty(n * n, dtype=np.int64)
    others = np.empty(n * n, dtype=np.int64)
    amounts = np.empty(n * n)
    count = 0
    for j in range(1, n - 1):
        for i in range(1, n - 1):
            if i == j:
                continue
            most, between = violation, -1
            allowed = earlier[j, i] - taken[j, i] + 1.0
            for k in range(1, n - 1):
                if k in (i, j):
                    continue
                beyond = earlier[j, k] + earlier[k, i] - allowed
                if beyond > most:
                    most, between = beyond, k
            if between >= 0:
                ones[count], betweens[count], others[count] = j, between, i
                amounts[count] = most
                count += 1
    return ones[:count], betweens[:count], others[:count], amounts[:count]
