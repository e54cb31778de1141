"""What a search has come to, in this process or in one of its own."""

from __future__ import annotations

from dataclasses import dataclass

from skillplan.checks.audit import VerdictSample
from skillplan.model.skill_model import ModelStats
from skillplan.solvers.solution import Solution


@dataclass(frozen=True, slots=True)
class Found:
    """What a solver claims, and on what that rests.

    Parameters
    ----------
    solution
        The claim.
    stats
        What was queried for it.
    sample
        Some of the verdicts that it rests on, where these were given in another process; else None.
    """

    solution: Solution
    stats: ModelStats
    sample: VerdictSample | None = None
