"""Units of length of drawings, tables and programs, and doubts about them.

Units of drawings ($INSUNITS): `dxf`.
"""

from __future__ import annotations

from typing import Final, Literal

UnitName = Literal["um", "mm", "cm", "dm", "m", "mil", "in", "ft", "yd"]

UNITS_M: Final[dict[UnitName, float]] = {
    "um": 1e-6,
    "mm": 1e-3,
    "cm": 1e-2,
    "dm": 0.1,
    "m": 1.0,
    "mil": 0.0254e-3,
    "in": 0.0254,
    "ft": 0.3048,
    "yd": 0.9144,
}
"""Length of a unit [m]."""

DEFAULT_UNIT: Final[UnitName] = "mm"
"""The unit of a drawing or program that names none."""

# No sheet that heads support is smaller, and no bench larger.
_LEAST_EXTENT_M = 0.010
_MOST_EXTENT_M = 10.0


def is_doubtful(extent_m: float) -> bool:
    """Return whether the longer side of a trajectory [m] suggests a wrong unit."""
    return not _LEAST_EXTENT_M <= extent_m <= _MOST_EXTENT_M
