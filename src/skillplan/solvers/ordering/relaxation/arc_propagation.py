"""Constraint propagation on arcs and precedence: forced arcs add precedence, which removes arcs.

Where j is the only successor left for i, nothing comes between the two: what comes before j comes
before i, and what comes after i comes after j. More precedence removes more arcs, until a fixed
point is reached.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.compiled import compiled

Booleans = NDArray[np.bool_]


@compiled
def _add(before: Booleans, one: int, other: int) -> bool:
    """Add a pair to a closed relation and close it again; return whether it has no cycle."""
    n = len(before)
    for i in range(n):
        if i != one and not before[i, one]:
            continue
        for j in range(n):
            if j == other or before[other, j]:
                if i == j or before[j, i]:
                    return False
                before[i, j] = True
    return True


@compiled
def _join(before: Booleans, i: int, j: int) -> int:
    """Let j come right after i; return 1 where pairs were added, 0 where not, -1 for a cycle."""
    n = len(before)
    added = 0
    if not before[i, j]:
        if not _add(before, i, j):
            return -1
        added = 1
    for k in range(n):
        if k != i and before[k, j] and not before[k, i]:
            if not _add(before, k, i):
                return -1
            added = 1
        if k != j and before[i, k] and not before[j, k]:
            if not _add(before, j, k):
                return -1
            added = 1
    return added


@compiled
def propagate(arcs: Booleans, before: Booleans) -> bool:
    """Remove arcs that no order of the remaining arcs takes, in place.

    Parameters
    ----------
    arcs
        The arcs, shape (n, n); changed in place.
    before
        The closed relation, shape (n, n); changed in place.

    Returns
    -------
    bool
        False where no order is left.
    """
    n = len(arcs)
    changed = True
    while changed:
        changed = False
        for i in range(n - 1):
            choices, only = 0, -1
            for j in range(n):
                if arcs[i, j]:
                    choices += 1
                    only = j
            if choices == 0:
                return False
            if choices == 1:
                joined = _join(before, i, only)
                if joined < 0:
                    return False
                changed = changed or joined > 0
        for j in range(1, n):
            choices, only = 0, -1
            for i in range(n):
                if arcs[i, j]:
                    choices += 1
                    only = i
            if choices == 0:
                return False
            if choices == 1:
                joined = _join(before, only, j)
                if joined < 0:
                    return False
                changed = changed or joined > 0
        for i in range(n - 1):
            for j in range(1, n):
                if not arcs[i, j]:
                    continue
                gone = before[j, i]
                if not gone and before[i, j]:
                    for k in range(n):
                        if before[i, k] and before[k, j]:
                            gone = True
                            break
                if gone:
                    arcs[i, j] = False
                    changed = True
    return True
