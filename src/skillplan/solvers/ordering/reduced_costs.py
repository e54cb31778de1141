"""A lower bound and the reduced costs that go with it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from skillplan.solvers.ordering.ordering_instance import Floats


@dataclass
class Duals:
    """A lower bound and the arcs' reduced costs that prove it.

    Parameters
    ----------
    bound
        No order costs less.
    reduced
        Every order costs at least `bound` plus the reduced costs of its arcs, shape (n, n), >= 0;
        inf where no order takes an arc.
    """

    bound: float
    reduced: Floats


def repaired(bound: float, reduced: Floats) -> Duals:
    """Return valid duals from any: what is negative in a row or column is taken off the bound."""
    finite = reduced[:-1, 1:]
    rows = np.minimum(finite.min(axis=1), 0.0)
    rows[~np.isfinite(rows)] = 0.0
    finite -= rows[:, None]
    return Duals(bound + float(rows.sum()), np.maximum(reduced, 0.0))
