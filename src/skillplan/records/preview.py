"""What is known of a valid task file before anything is solved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from skillplan.domains.domain import Overview


@dataclass(frozen=True)
class DerivedOrder:
    """The precedence relation that back ends leave to a task.

    Parameters
    ----------
    task
        The task's name.
    back_ends
        Names of those that were queried; empty where none was.
    pairs
        How many pairs of components have an order.
    cycle
        Components that would have to come before each other, ending with the first; empty where
        there is an order.
    never
        Skills that are feasible in no state, with the reason.
    lines
        Why there is no order, in words; empty where there is one, or a skill is never feasible.
    not_derived
        Of what no order is derived by itself, where no back end was queried.
    contradictions
        Pairs of the hand-made chart that contradict the derived order, in words.
    """

    task: str
    back_ends: tuple[str, ...]
    pairs: int = 0
    cycle: tuple[str, ...] = ()
    never: Mapping[str, str] = field(default_factory=dict)
    lines: tuple[str, ...] = ()
    not_derived: str = ""
    contradictions: tuple[str, ...] = ()

    def document(self) -> dict[str, Any]:
        """Return it as JSON values."""
        return {
            "task": self.task,
            "back_ends": list(self.back_ends),
            "pairs": self.pairs,
            "cycle": list(self.cycle),
            "never_feasible": dict(self.never),
            "contradictions": list(self.contradictions),
        }


@dataclass(frozen=True)
class Preview:
    """What ``check`` reports of a valid file besides its tasks.

    Parameters
    ----------
    warnings
        What is valid, but hardly meant or found out late, with its place in the file.
    orders
        For each task of which a relation can be derived.
    overview
        What its kind has to show.
    """

    warnings: tuple[str, ...] = ()
    orders: tuple[DerivedOrder, ...] = ()
    overview: Overview = field(default_factory=Overview)

    def document(self) -> dict[str, Any]:
        """Return the keys that it adds to ``skillplan.check/1``."""
        return {
            **self.overview.document,
            "precedence": [order.document() for order in self.orders if order.back_ends],
            "warnings": list(self.warnings),
        }
