"""The assignment program: each node but the last is left once, each but the first reached once."""

from __future__ import annotations

import highspy
import numpy as np

from skillplan.solvers.ordering.instance import Floats


def assignment_program(n: int, sums: Floats | None = None) -> highspy.Highs:
    """Return a program without columns.

    Rows 0 to n - 2 leave a node, the next n - 1 reach one, and the others are sums that are no less
    than some numbers.
    """
    highs = highspy.Highs()
    for key, value in (
        ("output_flag", False),
        ("threads", 1),
        ("presolve", "off"),
        ("solver", "simplex"),
        ("simplex_strategy", 1),
        ("random_seed", 0),
        ("dual_feasibility_tolerance", 1e-9),
        ("primal_feasibility_tolerance", 1e-9),
    ):
        highs.setOptionValue(key, value)
    rows = 2 * (n - 1)
    ones = np.ones(rows)
    none = np.zeros(0, dtype=np.int32)
    highs.addRows(rows, ones, ones, 0, np.zeros(rows, dtype=np.int32), none, np.zeros(0))
    if sums is not None:
        many = len(sums)
        starts = np.zeros(many, dtype=np.int32)
        highs.addRows(many, sums, np.full(many, np.inf), 0, starts, none, np.zeros(0))
    return highs
