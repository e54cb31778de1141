"""A plan's cost against a proved lower bound, and against the optimum."""

from __future__ import annotations

import math
from typing import Final

# A proof of optimality may leave this share of the optimum open.
_PROOF_GAP: Final = 1e-6


def relative_gap(cost: float | None, lower_bound: float | None) -> float | None:
    """Return (cost - lower bound) / cost, never below 0; None where either is missing."""
    if cost is None or lower_bound is None or not math.isfinite(lower_bound):
        return None
    if cost <= lower_bound or cost == 0:
        return 0.0
    return (cost - lower_bound) / cost


def deviation(cost: float | None, optimum: float | None) -> float | None:
    """Return the excess over the optimum as a fraction of it; None if either is missing.

    An excess within the gap of a proof, 1e-6 of the optimum, is 0.
    """
    if cost is None or optimum is None:
        return None
    if abs(cost - optimum) <= _PROOF_GAP * max(1e-3, optimum):
        return 0.0
    return cost / optimum - 1 if optimum > 0 else None
