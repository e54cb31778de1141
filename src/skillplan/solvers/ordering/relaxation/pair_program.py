"""The linear program over arcs and pairs of nodes, with cuts that are added and dropped.

A variable for every arc, and one for every pair of nodes that may come in either order: how much
the first comes before the second. Bounds are computed from the dual values, whatever their
errors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import highspy
import numpy as np

from skillplan.solvers.ordering.instance import (
    Booleans,
    Floats,
    Integers,
    OrderingInstance,
)
from skillplan.solvers.ordering.relaxation.assignment_program import assignment_program
from skillplan.solvers.ordering.relaxation.reduced_costs import Duals, PairPrices, repaired

# Rows that were slack so many times are dropped, some at a time.
_SLACK_ROUNDS = 2
_FEW = 50
# Steps of the simplex method between two polls of `stop`.
_STEPS = 2000


@dataclass
class _Rows:
    """Cuts: row, column and value of their entries, shape (entries,); right-hand sides, by row.

    A transitivity cut names its nodes in `triple`, shape (rows, 3), which is -1 for others.
    """

    row: Integers
    column: Integers
    value: Floats
    least: Floats
    triple: Integers

    def kept(self, keep: Booleans) -> _Rows:
        """Return some of the rows, renumbered."""
        number = np.cumsum(keep) - 1
        stays = keep[self.row]
        return _Rows(
            number[self.row[stays]],
            self.column[stays],
            self.value[stays],
            self.least[keep],
            self.triple[keep],
        )

    def followed_by(self, other: _Rows) -> _Rows:
        """Return these rows and others after them."""
        return _Rows(
            np.concatenate((self.row, other.row + len(self.least))),
            np.concatenate((self.column, other.column)),
            np.concatenate((self.value, other.value)),
            np.concatenate((self.least, other.least)),
            np.concatenate((self.triple, other.triple)),
        )


Terms = tuple[Integers, Integers, Integers, Floats]


def open_pairs(instance: OrderingInstance) -> Booleans:
    """Return whether two nodes may come in either order, shape (n, n)."""
    either: Booleans = ~(instance.before | instance.before.T)
    np.fill_diagonal(either, False)
    return either


def terms_of(*several: tuple[Integers, Integers, Integers, float]) -> Terms:
    """Join terms: rows, nodes, the nodes that they come before, and the weights of that."""
    nothing = np.zeros(0, dtype=np.int64)
    rows, ones, others = (
        np.concatenate([nothing, *(term[k] for term in several)]) for k in range(3)
    )
    weights = [np.full(len(row), weight) for row, _, _, weight in several]
    return rows, ones, others, np.concatenate([np.zeros(0), *weights])


class PairProgram:
    """The linear program of an instance.

    Parameters
    ----------
    instance
        The ordering.
    arcs
        The arcs that may be taken, shape (n, n).
    scale
        Factor on costs in the program, for numerical range.

    Attributes
    ----------
    tails, heads
        The arcs, shape (m,).
    arc
        Index of an arc, -1 where it is forbidden, shape (n, n).
    varies
        Whether two nodes may come in either order, shape (n, n).
    work
        Simplex steps times size.
    """

    def __init__(self, instance: OrderingInstance, arcs: Booleans, scale: float) -> None:
        self.instance = instance
        n = instance.n
        self._scale = scale
        self.tails, self.heads = np.nonzero(arcs)
        self.arc = np.full((n, n), -1, dtype=np.int64)
        self.arc[self.tails, self.heads] = np.arange(len(self.tails))
        self.varies = open_pairs(instance)
        self._open = np.argwhere(np.triu(self.varies))
        first, second = self._open.T
        # How much i comes before j: `fixed + sign * variable`.
        self._fixed = instance.before.astype(np.float64)
        self._fixed[second, first] = 1.0
        self._sign = np.zeros((n, n))
        self._sign[first, second], self._sign[second, first] = 1.0, -1.0
        self._pair = np.full((n, n), -1, dtype=np.int64)
        self._pair[first, second] = len(self.tails) + np.arange(len(first))
        self._pair[second, first] = self._pair[first, second]
        self._columns = len(self.tails) + len(first)
        nothing = np.zeros(0, dtype=np.int64)
        self._rows = _Rows(nothing, nothing, np.zeros(0), np.zeros(0), nothing.reshape(0, 3))
        self._slack = nothing
        self.work = 0
        self._highs = self._model()

    @property
    def rows(self) -> int:
        """How many cuts there are."""
        return len(self._rows.least)

    def _model(self) -> highspy.Highs:
        n, arcs = self.instance.n, len(self.tails)
        highs = assignment_program(n)
        highs.setOptionValue("simplex_iteration_limit", _STEPS)
        ends = np.stack((self.tails, n - 1 + self.heads - 1), axis=1).astype(np.int32)
        highs.addCols(
            arcs,
            self.instance.costs[self.tails, self.heads] * self._scale,
            np.zeros(arcs),
            np.full(arcs, np.inf),
            2 * arcs,
            np.arange(0, 2 * arcs, 2, dtype=np.int32),
            ends.ravel(),
            np.ones(2 * arcs),
        )
        pairs = self._columns - arcs
        none = np.zeros(0, dtype=np.int32)
        highs.addCols(
            pairs,
            np.zeros(pairs),
            np.zeros(pairs),
            np.ones(pairs),
            0,
            np.zeros(pairs, dtype=np.int32),
            none,
            np.zeros(0),
        )
        return highs

    def solve(self, stop: Callable[[], bool]) -> Floats | None:
        """Return the value of every column; None where the program failed."""
        while True:
            self._highs.run()
            steps = max(0, self._highs.getInfo().simplex_iteration_count)
            rows = 2 * (self.instance.n - 1) + len(self._rows.least)
            self.work += (steps + 30) * (self._columns + rows)
            status = self._highs.getModelStatus()
            if status != highspy.HighsModelStatus.kIterationLimit or stop():
                break
        solution = self._highs.getSolution()
        if status not in (
            highspy.HighsModelStatus.kOptimal,
            highspy.HighsModelStatus.kIterationLimit,
        ):
            # Also where no order is left below the cutoff; other methods have to prove that.
            return None
        tight = np.asarray(solution.row_value)[2 * (self.instance.n - 1) :]
        self._slack = np.where(tight < self._rows.least + 1e-6, 0, self._slack + 1)
        return np.asarray(solution.col_value)

    def taken(self, values: Floats) -> Floats:
        """Return how much of every arc is taken, shape (n, n)."""
        taken = np.zeros(self.arc.shape)
        taken[self.tails, self.heads] = values[: len(self.tails)]
        return taken

    def earlier(self, values: Floats) -> Floats:
        """Return how much one node comes before another, in [0, 1], shape (n, n)."""
        variable = np.where(self._pair < 0, 0.0, values[self._pair])
        earlier: Floats = np.clip(self._fixed + self._sign * variable, 0.0, 1.0)
        return earlier

    def proved(self) -> Duals:
        """Return the bound and reduced costs of the present dual values, whatever their errors."""
        n, arcs = self.instance.n, len(self.tails)
        prices = np.asarray(self._highs.getSolution().row_dual) / self._scale
        leaving, reaching = prices[: n - 1], prices[n - 1 : 2 * (n - 1)]
        cuts = np.maximum(prices[2 * (n - 1) :], 0.0)
        rows = self._rows
        weights = np.bincount(rows.column, rows.value * cuts[rows.row], self._columns)
        reduced = np.full((n, n), np.inf)
        reduced[self.tails, self.heads] = (
            self.instance.costs[self.tails, self.heads]
            - weights[:arcs]
            - leaving[self.tails]
            - reaching[self.heads - 1]
        )
        reduced[self.arc < 0] = np.inf
        bound = leaving.sum() + reaching.sum() + cuts @ rows.least
        # A pair is between 0 and 1: at a negative reduced cost it is at its upper bound.
        priced = -weights[arcs:]
        bound += np.minimum(priced, 0.0).sum()
        duals = repaired(float(bound), reduced)
        used = (cuts > 0) & (rows.triple[:, 0] >= 0)
        costly = np.nonzero(priced)[0]
        turned = priced[costly] < 0
        pairs = np.where(turned[:, None], self._open[costly, ::-1], self._open[costly])
        duals.prices = PairPrices(pairs, np.abs(priced[costly]), rows.triple[used], cuts[used])
        return duals

    def forbid(self, duals: Duals, cutoff: float) -> None:
        """Fix arcs by reduced cost: forbid those that no order below the cutoff takes."""
        gone = self.arc[(self.arc >= 0) & (duals.bound + duals.reduced >= cutoff)]
        if len(gone):
            self.arc[self.tails[gone], self.heads[gone]] = -1
            nothing = np.zeros(len(gone))
            self._highs.changeColsBounds(
                len(gone), np.sort(gone).astype(np.int32), nothing, nothing
            )

    def drop(self) -> None:
        """Drop cuts that have not been tight for some rounds."""
        gone = self._slack >= _SLACK_ROUNDS
        many = int(gone.sum())
        if many > _FEW:
            numbers = (2 * (self.instance.n - 1) + np.nonzero(gone)[0]).astype(np.int32)
            self._highs.deleteRows(many, numbers)
            self._rows = self._rows.kept(~gone)
            self._slack = self._slack[~gone]

    def add_cuts(self, leave: Booleans, reach: Booleans, least: Floats, terms: Terms) -> None:
        """Add cuts: rows of the arcs that go between two sets."""
        crossing = leave[:, self.tails] & reach[:, self.heads]
        row, column = np.nonzero(crossing)
        self.add(least, (row, column, np.ones(len(row))), terms)

    def add_sum(self, arcs: Booleans, least: int) -> None:
        """Add a cut: the sum of some arcs, shape (n, n), is no less than this."""
        column = self.arc[arcs & (self.arc >= 0)]
        many = len(column)
        row = np.zeros(many, dtype=np.int64)
        self.add(np.array([float(least)]), (row, column, np.ones(many)), terms_of())

    def add(
        self,
        least: Floats,
        arcs: tuple[Integers, Integers, Floats],
        terms: Terms,
        triple: Integers | None = None,
    ) -> None:
        """Add rows of arcs and of pairs.

        Parameters
        ----------
        least
            Right-hand sides, shape (rows,).
        arcs
            Row, column and value of every arc's entry.
        terms
            Entries of pairs, as from `terms_of`.
        triple
            Nodes of transitivity cuts, shape (rows, 3); None for other rows.
        """
        many = len(least)
        if not many:
            return
        row, one, other, weight = terms
        column = self._pair[one, other]
        least = least - np.bincount(row, weight * self._fixed[one, other], many)
        varies = column >= 0
        rows = np.concatenate((arcs[0], row[varies]))
        columns = np.concatenate((arcs[1], column[varies]))
        values = np.concatenate((arcs[2], (weight * self._sign[one, other])[varies]))
        by_row = np.argsort(rows, kind="stable")
        if triple is None:
            triple = np.full((many, 3), -1)
        added = _Rows(rows[by_row], columns[by_row], values[by_row], least, triple)
        self._highs.addRows(
            many,
            least,
            np.full(many, np.inf),
            len(rows),
            np.searchsorted(added.row, np.arange(many)).astype(np.int32),
            added.column.astype(np.int32),
            added.value,
        )
        self._rows = self._rows.followed_by(added)
        self._slack = np.concatenate((self._slack, np.zeros(many, dtype=np.int64)))
