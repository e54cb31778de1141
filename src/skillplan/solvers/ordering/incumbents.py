"""The effort of a search, and the incumbent and bound that concurrent searches share."""

from __future__ import annotations

from dataclasses import dataclass

from skillplan.solvers.ordering.instance import Integers


@dataclass
class Effort:
    """What the methods did, for the trace.

    Parameters
    ----------
    nodes
        Labels, subproblems and orders looked at.
    bound_method
        In words, what proved the bound.
    states
        Labels of the dynamic program and the beam.
    parts
        Subproblems of branch and cut.
    programs
        Linear programs solved.
    rounds
        Rounds of the portfolio.
    """

    nodes: int = 0
    bound_method: str = ""
    states: int = 0
    parts: int = 0
    programs: int = 0
    rounds: int = 0


@dataclass(frozen=True)
class SharedIncumbent:
    """The best order and bound of concurrent searches.

    Parameters
    ----------
    order
        The best order, or None where it is not new.
    bound
        No order costs less.
    bound_method
        In words, what proved that.
    """

    order: Integers | None = None
    bound: float = 0.0
    bound_method: str = ""
