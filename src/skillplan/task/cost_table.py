"""What a skill costs by where one stands: a row of a matrix of whole numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

from skillplan.task.state import State

NEVER = -1
"""Stands in a table for a place from which the skill is never done."""


@dataclass(frozen=True)
class TableCost:
    """A whole number by which of some places one stands at, such as a row of a cost matrix.

    Skills share the facts of the places, so that a table is no more than a row of numbers.

    Parameters
    ----------
    places
        The facts of the places; their bits lie side by side, and one holds at a time.
    values
        Value, >= 0, or `NEVER`, of each of them, in the order of their bits.

    Raises
    ------
    ValueError
        If the bits do not lie side by side, there are not as many values, or one is below -1.
    """

    places: State
    values: tuple[int, ...] = field(hash=False, repr=False)
    _mask: int = field(init=False, repr=False, compare=False)
    _below: int = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        mask = self.places.bits
        below = (mask & -mask).bit_length()
        if not mask or mask.bit_length() - below + 1 != mask.bit_count():
            raise ValueError("The places of a TableCost must lie side by side.")
        if len(self.values) != mask.bit_count():
            raise ValueError(
                f"TableCost needs {mask.bit_count()} values, one a place, not {len(self.values)}."
            )
        if min(self.values) < NEVER:
            raise ValueError(f"Cost must be >= 0, or -1 for never, not {min(self.values)}.")
        object.__setattr__(self, "_mask", mask)
        object.__setattr__(self, "_below", below)

    def at(self, state: State) -> float:
        """Return the value of the place that holds in `state`; inf where the skill is never done.

        Raises
        ------
        ValueError
            If none of the places holds there, or several do.
        """
        held = state.bits & self._mask
        if not held or held & (held - 1):
            raise ValueError(f"The state does not say where one stands: {state}.")
        value = self.values[held.bit_length() - self._below]
        return math.inf if value < 0 else float(value)

    def least(self, true_bits: int, false_bits: int) -> float:
        """Return the least value over the places that the known facts leave open."""
        known = true_bits & self._mask
        if known & (known - 1):
            return math.inf
        if known:
            value = self.values[known.bit_length() - self._below]
            return math.inf if value < 0 else float(value)
        closed = false_bits & self._mask
        if not closed:
            return self._least
        closed >>= self._below - 1
        return float(
            min(
                (
                    value
                    for place, value in enumerate(self.values)
                    if value >= 0 and not closed >> place & 1
                ),
                default=math.inf,
            )
        )

    @cached_property
    def _least(self) -> float:
        """The least value of all."""
        return float(min((value for value in self.values if value >= 0), default=math.inf))
