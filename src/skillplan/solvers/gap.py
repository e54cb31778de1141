"""The relative gap between what a plan costs and what is proved that every plan costs."""

from __future__ import annotations

import math


def relative_gap(cost: float | None, lower_bound: float | None) -> float | None:
    """Return (cost - lower bound) / cost, never below 0; None where either is missing."""
    if cost is None or lower_bound is None or not math.isfinite(lower_bound):
        return None
    if cost <= lower_bound or cost == 0:
        return 0.0
    return (cost - lower_bound) / cost
