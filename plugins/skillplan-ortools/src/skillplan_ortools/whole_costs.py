"""A sequencing problem in integers, for constraint programming."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from skillplan.model.sequencing import SequencingProblem
from skillplan.solvers.ordering.instance import close_relation

# Largest integer that floats represent exactly; bounds are floats.
_MOST_BITS = 52
# Tolerance of a proof, as a fraction of the cost or of 1; rounding may use a tenth of it.
_TOLERANCE = 1e-9
# Index of the initial state.
START = -1


@dataclass(frozen=True)
class WholeCosts:
    """Arcs of the orders of n jobs, and their costs in integer units.

    Costs are rounded down, so a lower bound on the integer cost of an order also bounds its cost.

    Attributes
    ----------
    before
        True if job i must come before job j, shape (n, n), transitive.
    arcs
        Integer cost of every arc, by its ends; `START` is the initial state.
    exponent
        The unit is ``2 ** -exponent`` of the problem's: 0 if costs are integers already.
    """

    problem: SequencingProblem
    before: NDArray[np.bool_] = field(init=False)
    arcs: dict[tuple[int, int], int] = field(init=False)
    exponent: int = field(init=False)

    def __post_init__(self) -> None:
        before = np.zeros((self.n, self.n), dtype=np.bool_)
        for i, j in self.problem.precedence:
            before[i, j] = True
        before = close_relation(before)
        object.__setattr__(self, "before", before)
        costs = self._possible()
        exponent = _exponent(costs.values(), self.n)
        object.__setattr__(self, "exponent", exponent)
        arcs = {arc: math.floor(math.ldexp(cost, exponent)) for arc, cost in costs.items()}
        object.__setattr__(self, "arcs", arcs)

    @property
    def n(self) -> int:
        """Number of jobs."""
        return len(self.problem.jobs)

    def in_problem_units(self, bound: float) -> float:
        """Convert a bound on the integer cost to one on the cost."""
        return math.ldexp(bound, -self.exponent)

    def ranks(self, job: int) -> tuple[int, int]:
        """Return the first and the last possible position of a job, from 0."""
        return int(self.before[:, job].sum()), self.n - 1 - int(self.before[job].sum())

    def neighbours(self) -> list[tuple[int, int]]:
        """Return the pairs of the precedence relation that others do not imply."""
        direct = self.before & ~_between(self.before)
        return [(int(i), int(j)) for i, j in np.argwhere(direct)]

    def nearest_order(self) -> tuple[int, ...] | None:
        """Return the order that always continues with the cheapest possible job.

        None if it ends in a job without a successor.
        """
        order: list[int] = []
        waits_for = self.before.sum(axis=0)
        left = set(range(self.n))
        while left:
            here = order[-1] if order else START
            choices = [
                (self.arcs[here, j], j) for j in left if not waits_for[j] and (here, j) in self.arcs
            ]
            if not choices:
                return None
            _, job = min(choices)
            order.append(job)
            left.remove(job)
            waits_for = waits_for - self.before[job]
        return tuple(order)

    def allows(self, order: Sequence[int]) -> bool:
        """Return whether an order has all jobs once, in a valid sequence, along known arcs."""
        if sorted(order) != list(range(self.n)):
            return False
        place = {job: position for position, job in enumerate(order)}
        ahead = all(place[i] < place[j] for i, j in self.problem.precedence)
        return ahead and all(arc in self.arcs for arc in zip((START, *order), order, strict=False))

    def _possible(self) -> dict[tuple[int, int], float]:
        """Return the cost of every arc that an order may use."""
        between = _between(self.before)
        first = {
            (START, j): float(self.problem.first[j])
            for j in range(self.n)
            if not self.before[:, j].any()
        }
        later = {
            (i, j): float(self.problem.costs[i, j])
            for i in range(self.n)
            for j in range(self.n)
            if i != j and not self.before[j, i] and not (self.before[i, j] and between[i, j])
        }
        return {arc: cost for arc, cost in (first | later).items() if math.isfinite(cost)}


def _between(before: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the pairs of jobs that need a third one between them."""
    count = before.astype(np.float32)
    between: NDArray[np.bool_] = count @ count > 0.5
    return between


def _exponent(costs: Collection[float], n: int) -> int:
    """Return the unit that is fine enough for a proof, with exact sums."""
    most = math.ceil(max(costs, default=0.0)) * max(1, n)
    finest = _MOST_BITS - most.bit_length()
    if all(cost.is_integer() for cost in costs):
        return min(0, finest)
    return min(math.ceil(math.log2(n / (0.1 * _TOLERANCE))), finest)
