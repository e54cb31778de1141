"""Which values an option may take, where a sampler chooses among them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from skillplan.records.sweep.plan import Value


@dataclass(frozen=True, slots=True)
class Span:
    """All values between two ends.

    Parameters
    ----------
    option
        The option's name.
    low, high
        The ends, which belong to it; low < high, finite.
    whole
        Whether values are whole numbers.
    logarithmic
        Whether logarithms are drawn evenly; then low > 0.

    Raises
    ------
    ValueError
        If the ends do not fit.
    """

    option: str
    low: float
    high: float
    whole: bool = False
    logarithmic: bool = False

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise ValueError(f"A span of {self.option!r} needs low < high, both finite.")
        if self.logarithmic and self.low <= 0:
            raise ValueError(f"A logarithmic span of {self.option!r} begins above 0.")

    def holds(self, value: object) -> bool:
        """Whether a value is one of it."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            return False
        return self.low <= value <= self.high and not (self.whole and isinstance(value, float))

    def document(self) -> dict[str, Any]:
        """Return the span as JSON values."""
        return {
            "option": self.option,
            "low": self.low,
            "high": self.high,
            "whole": self.whole,
            "logarithmic": self.logarithmic,
        }


@dataclass(frozen=True, slots=True)
class Choice:
    """Some values.

    Parameters
    ----------
    option
        The option's name.
    values
        At least two, distinct.
    ordered
        Whether neighbours in the list are alike, as numbers that ascend are.

    Raises
    ------
    ValueError
        If there are fewer than two values.
    """

    option: str
    values: tuple[Value, ...]
    ordered: bool = False

    def __post_init__(self) -> None:
        if len(self.values) < 2:
            raise ValueError(f"A choice of {self.option!r} needs at least two values.")

    def holds(self, value: object) -> bool:
        """Whether a value is one of them, also in type."""
        return any(type(one) is type(value) and one == value for one in self.values)

    def document(self) -> dict[str, Any]:
        """Return the choice as JSON values."""
        return {"option": self.option, "values": list(self.values), "ordered": self.ordered}


Dimension = Span | Choice
