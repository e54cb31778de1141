"""Conditions on states: the preconditions and postconditions of skills, and goals."""

from __future__ import annotations

from dataclasses import dataclass

from skillplan.task.state import State


@dataclass(frozen=True, slots=True)
class Condition:
    """Holds where all required facts and no forbidden fact do.

    Parameters
    ----------
    requires
        Facts that must hold.
    forbids
        Facts that must not.

    Raises
    ------
    ValueError
        If a fact is both required and forbidden.
    """

    requires: State
    forbids: State

    def __post_init__(self) -> None:
        if self.requires.bits & self.forbids.bits:
            both = self.requires & self.forbids
            raise ValueError(f"Condition requires and forbids the same facts: {both}.")

    def holds(self, state: State) -> bool:
        """Whether the condition holds in `state`."""
        bits = state.bits
        return bits & self.requires.bits == self.requires.bits and not bits & self.forbids.bits

    def why_not(self, state: State) -> list[str]:
        """Return what is amiss: missing facts by name, forbidden ones as ``not NAME``."""
        missing = self.requires - state
        forbidden = self.forbids & state
        return [*missing, *(f"not {name}" for name in forbidden)]

    def __str__(self) -> str:
        terms = [*self.requires, *(f"not {name}" for name in self.forbids)]
        return " and ".join(terms) or "always"
