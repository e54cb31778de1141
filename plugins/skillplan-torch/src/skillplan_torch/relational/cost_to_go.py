"""What is still to pay on a small board, whatever is done: exactly, by dynamic programming.

Held and Karp, "A dynamic programming approach to sequencing problems", 1962, with precedence. It
is the teacher: of every set of elements done, and the last of them, it knows the least cost of
the rest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.relational.element_view import ElementView, Sight

# Its table has 2 ** n * n entries.
MOST_ELEMENTS = 14


class CostToGo:
    """The least cost of what is left, in every order that respects the precedence.

    Parameters
    ----------
    view
        Of a board of at most `MOST_ELEMENTS` elements that leave no choices.

    Raises
    ------
    ValueError
        If there are more, or an order has to choose between precedences.
    """

    def __init__(self, view: ElementView) -> None:
        count = len(view.rest)
        if count > MOST_ELEMENTS or view.order.choices:
            raise ValueError(f"The teacher knows boards of at most {MOST_ELEMENTS} elements.")
        self._view = view
        powers = 1 << np.arange(count)
        self._before = (view.order.before * powers[:, None]).sum(axis=0)
        self._table = np.full((1 << count, count), np.inf)
        self._fill(count)

    def of_state(self, done: NDArray[np.bool_], sight: Sight) -> NDArray[np.float64]:
        """Return what is to pay if the next element is each of those seen, shape (n,).

        Parameters
        ----------
        done
            Which elements of the task are done.
        sight
            What is seen of the state.
        """
        mask = int(sum(1 << one for one in np.flatnonzero(done).tolist()))
        found = np.full(len(sight.elements), np.inf)
        for place, (one, way) in enumerate(zip(sight.elements.tolist(), sight.ways, strict=True)):
            if way is not None and not self._before[one] & ~mask:
                rest = self._view.rest[one]
                found[place] = way.cost + rest + self._table[mask | 1 << one, one]
        return found

    def _fill(self, count: int) -> None:
        sets = np.arange(1 << count)
        sizes = np.array([int(one).bit_count() for one in sets])
        self._table[-1] = 0.0
        for size in range(count - 1, 0, -1):
            here = sets[sizes == size]
            least = np.full((len(here), count), np.inf)
            for element in range(count):
                open_here = ((here >> element & 1) == 0) & ((self._before[element] & ~here) == 0)
                onward = self._table[here[open_here] | 1 << element, element]
                paid = self._view.costs[:, element] + self._view.rest[element]
                least[open_here] = np.minimum(least[open_here], onward[:, None] + paid[None])
            self._table[here] = least
