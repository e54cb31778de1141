"""Relations as bit sets."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.compiled import compiled


@compiled
def words_of(relation: NDArray[np.bool_]) -> NDArray[np.uint64]:
    """Return the columns of a relation as bit sets, shape (n, words)."""
    n = len(relation)
    words = np.zeros((n, (n + 63) // 64), dtype=np.uint64)
    for j in range(n):
        for i in range(n):
            if relation[i, j]:
                words[j, i >> 6] |= np.uint64(1) << np.uint64(i & 63)
    return words
