"""Learned policies on layouts that they have not seen, held against the exact solver and its time.

A policy that was learned on a family of layouts answers on a new one at once; the exact solver
searches, but proves what it finds.
"""

from __future__ import annotations

import statistics
from dataclasses import dataclass
from typing import Any

from skillplan.records.interval import Estimate, interquartile_mean, share
from skillplan.records.optimum import Optimum
from skillplan.records.training.outcome import GreedyRollOut
from skillplan.solvers.gap import deviation


@dataclass(frozen=True, slots=True)
class LayoutOutcome:
    """What became of one layout.

    Parameters
    ----------
    name
        The layout's name, such as ``inverter-board/40``.
    optimum
        What it costs at least, and how long proving that took.
    answers
        What the policy of every run does, greedily.
    answer_s
        How long each of them took [s], the model's verdicts included.

    Raises
    ------
    ValueError
        If there are not as many times as answers.
    """

    name: str
    optimum: Optimum
    answers: tuple[GreedyRollOut, ...]
    answer_s: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.answers) != len(self.answer_s):
            raise ValueError(f"Layout {self.name!r} has answers without a time.")

    @property
    def completed(self) -> int:
        """How many policies complete it."""
        return sum(one.complete for one in self.answers)

    @property
    def deviations(self) -> list[float]:
        """Deviations of those that complete it; empty where no optimum is proved."""
        found = [deviation(one.cost, self.optimum.cost) for one in self.answers]
        return [one for one in found if one is not None]

    def document(self) -> dict[str, Any]:
        """Return the layout as JSON values."""
        return {
            "name": self.name,
            "optimum": self.optimum.cost,
            "optimum_reason": self.optimum.reason,
            "optimum_wall_s": self.optimum.wall_s,
            "completed": self.completed,
            "costs": [one.cost for one in self.answers],
            "deviations": [deviation(one.cost, self.optimum.cost) for one in self.answers],
            "actions": [list(one.actions) for one in self.answers],
            "answer_s": list(self.answer_s),
        }


@dataclass(frozen=True)
class LayoutsResult:
    """Several layouts of a family that no policy has learned on.

    Parameters
    ----------
    rows
        One for every layout, at least one.
    learned_on
        On how many layouts of the family the policies were learned; 0 on the file's own alone.
    training_s
        How long the training of all runs took [s]; None where nobody knows.
    """

    rows: tuple[LayoutOutcome, ...]
    learned_on: int
    training_s: float | None = None

    @property
    def complete_share(self) -> Estimate | None:
        """The share of answers that complete their layout."""
        answers = sum(len(row.answers) for row in self.rows)
        return share(sum(row.completed for row in self.rows), answers)

    @property
    def deviation_iqm(self) -> Estimate | None:
        """Interquartile mean over the layouts of the mean deviation of answers that complete."""
        means = [statistics.fmean(row.deviations) for row in self.rows if row.deviations]
        return interquartile_mean(means)

    @property
    def answer_s(self) -> float | None:
        """Median time of an answer [s]."""
        times = [one for row in self.rows for one in row.answer_s]
        return statistics.median(times) if times else None

    @property
    def proof_s(self) -> float | None:
        """Median time in which an optimum was proved [s]; None where none was."""
        times = [
            row.optimum.wall_s
            for row in self.rows
            if row.optimum.cost is not None and row.optimum.wall_s is not None
        ]
        return statistics.median(times) if times else None

    def at_most(self, excess: float) -> int:
        """Return how many answers deviate by no more."""
        return sum(one <= excess for row in self.rows for one in row.deviations)

    def document(self) -> dict[str, Any]:
        """Return the layouts as JSON values."""
        complete, off = self.complete_share, self.deviation_iqm
        return {
            "learned_on": self.learned_on,
            "answers": sum(len(row.answers) for row in self.rows),
            "complete_share": None if complete is None else complete.document(),
            "deviation_iqm": None if off is None else off.document(),
            "one_percent_answers": self.at_most(0.01),
            "answer_s": self.answer_s,
            "proof_s": self.proof_s,
            "training_s": self.training_s,
            "rows": [row.document() for row in self.rows],
        }
