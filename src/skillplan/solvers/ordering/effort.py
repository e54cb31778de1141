"""The effort of a search."""

from __future__ import annotations

from dataclasses import dataclass


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
