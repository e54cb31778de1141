"""Names of directions."""

from __future__ import annotations

from collections.abc import Sequence


def direction_name(direction: Sequence[float]) -> str:
    """Return ``+x`` and the like, or the three numbers of any other direction."""
    for axis, value in zip("xyz", direction, strict=True):
        if abs(abs(value) - 1) < 1e-6:
            return f"{'+' if value > 0 else '-'}{axis}"
    return " ".join(f"{value:.3g}" for value in direction)
