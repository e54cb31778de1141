"""What scaling measures: sizes of boards, and what a solver made of those of one size."""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from dataclasses import dataclass

from fresh_process import Outcome

from skillplan.domains.assembly.board_generator import BoardGenerator
from skillplan.solvers.solution import relative_gap


@dataclass(frozen=True)
class Size:
    """Of which size boards are; there is one for every seed."""

    parts: int
    density: float
    tools: int

    def board(self, seed: int) -> BoardGenerator:
        """Return the board of a seed."""
        name = f"board-{self.parts}-parts-{100 * self.density:.0f}-of-100-{self.tools}-tools-{seed}"
        return BoardGenerator(self.parts, self.density, self.tools, seed, name)


@dataclass(frozen=True)
class Showing:
    """What a solver made of the boards of a size, one for every seed.

    Parameters
    ----------
    outcomes
        At least one.
    """

    outcomes: tuple[Outcome, ...]

    @property
    def taken_s(self) -> float | None:
        """Median time to proof [s]; None unless most of the boards were proved."""
        proved_s = sorted(found.taken_s for found in self.outcomes if found.status == "optimal")
        middle = (len(self.outcomes) + 1) // 2
        return proved_s[middle - 1] if len(proved_s) >= middle else None

    @property
    def gap(self) -> float | None:
        """Median gap, a proof's 0; None where most of the boards have no plan or no bound."""
        gaps = [relative_gap(found.cost, found.bound) for found in self.outcomes]
        worst = sorted(2.0 if gap is None else gap for gap in gaps)
        median = statistics.median_low(worst)
        return None if median > 1 else median

    @property
    def proofs(self) -> int:
        """How many boards were proved."""
        return sum(found.status == "optimal" for found in self.outcomes)

    def cell(self) -> str:
        """Return the time to proof, or the gap, or a dash; of several boards the medians."""
        if self.taken_s is not None:
            text = f"{_short(self.taken_s)} s"
        else:
            text = "-" if self.gap is None else f"{_short(100 * self.gap)} %"
        several = len(self.outcomes) > 1
        return f"{text} ({self.proofs}/{len(self.outcomes)})" if several else text

    def faults(self) -> Iterator[str]:
        """Yield what no solver should come to."""
        for found in self.outcomes:
            if found.status not in ("optimal", "solved", "unsolved"):
                yield f"{found.status}: {found.reason}"


def _short(value: float) -> str:
    """Return a figure with two digits, or all those before the point; or that it is next to 0."""
    if value < 0.001:
        return "<0.001"
    return f"{value:.0f}" if value >= 9.95 else f"{value:.2g}"
