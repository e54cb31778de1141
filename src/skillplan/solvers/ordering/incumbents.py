"""What a search did, and what it is told of others that search the same."""

from __future__ import annotations

from dataclasses import dataclass

from skillplan.solvers.ordering.instance import Integers


@dataclass
class Effort:
    """What the methods did, for the record.

    Parameters
    ----------
    nodes
        Ways, parts and orders looked at.
    bound_method
        In words, what proved the bound.
    """

    nodes: int = 0
    bound_method: str = ""
    states: int = 0
    parts: int = 0
    programs: int = 0
    rounds: int = 0


@dataclass(frozen=True)
class SharedIncumbent:
    """What became known elsewhere.

    Parameters
    ----------
    order
        An order, or None where there is none that is new.
    bound
        No order costs less.
    bound_method
        In words, what proved that.
    """

    order: Integers | None = None
    bound: float = 0.0
    bound_method: str = ""
