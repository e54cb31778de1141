"""An extended formulation: a linear relaxation with a precedence variable for every open pair.

It is stronger than `cut_relaxation` for dense precedence, and costlier: it has a variable for every
arc, and one for every pair of nodes that may come in either order. Cuts by maximum flow then hold
between any two nodes, weighted by their precedence variable (after Gouveia and Pesneau, "On
extended formulations for the precedence constrained asymmetric traveling salesman problem", 2006).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import highspy
import numpy as np

from skillplan.solvers.kernels import compiled
from skillplan.solvers.ordering.instance import Booleans, Floats, Integers, OrderingInstance
from skillplan.solvers.ordering.relaxation.cut_relaxation import (
    CutRelaxation,
    Duals,
    PairPrices,
    build_assignment,
    repair,
)
from skillplan.solvers.ordering.relaxation.precedence_cuts import select_pairs, separate_between

# Rounds of slack after which rows are dropped, some at a time.
_SLACK_ROUNDS = 2
_FEW = 50
# Steps of the simplex method between two polls of `stop`.
_STEPS = 2000


@dataclass
class _Rows:
    """Cuts: row, column and value of their entries, shape (entries,); right-hand sides, by row.

    A transitivity cut has its nodes in `triple`, shape (rows, 3), which is -1 for other cuts.
    """

    row: Integers
    column: Integers
    value: Floats
    bounds: Floats
    triple: Integers

    def kept(self, keep: Booleans) -> _Rows:
        """Return some of the rows, renumbered."""
        number = np.cumsum(keep) - 1
        stays = keep[self.row]
        return _Rows(
            number[self.row[stays]],
            self.column[stays],
            self.value[stays],
            self.bounds[keep],
            self.triple[keep],
        )

    def followed_by(self, other: _Rows) -> _Rows:
        """Return these rows followed by others."""
        return _Rows(
            np.concatenate((self.row, other.row + len(self.bounds))),
            np.concatenate((self.column, other.column)),
            np.concatenate((self.value, other.value)),
            np.concatenate((self.bounds, other.bounds)),
            np.concatenate((self.triple, other.triple)),
        )


Terms = tuple[Integers, Integers, Integers, Floats]


def find_open_pairs(instance: OrderingInstance) -> Booleans:
    """Return True for pairs of nodes that may come in either order, shape (n, n)."""
    either: Booleans = ~(instance.before | instance.before.T)
    np.fill_diagonal(either, False)
    return either


def join_terms(*several: tuple[Integers, Integers, Integers, float]) -> Terms:
    """Join terms: rows, nodes, their successors, and weights."""
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
    arcs
        Allowed arcs, shape (n, n).

    Attributes
    ----------
    tails, heads
        Ends of the arcs, shape (m,).
    arc
        Index of an arc, -1 if forbidden, shape (n, n).
    varies
        True if two nodes may come in either order, shape (n, n).
    """

    def __init__(self, instance: OrderingInstance, arcs: Booleans, scale: float) -> None:
        self.instance = instance
        n = instance.n
        self._scale = scale
        self.tails, self.heads = np.nonzero(arcs)
        self.arc = np.full((n, n), -1, dtype=np.int64)
        self.arc[self.tails, self.heads] = np.arange(len(self.tails))
        self.varies = find_open_pairs(instance)
        self._open = np.argwhere(np.triu(self.varies))
        first, second = self._open.T
        # Fraction by which i comes before j: `fixed + sign * variable`.
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
        """Number of cuts."""
        return len(self._rows.bounds)

    def _model(self) -> highspy.Highs:
        n, arcs = self.instance.n, len(self.tails)
        highs = build_assignment(n)
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
        """Return the value of every column; None if the program failed."""
        while True:
            self._highs.run()
            steps = max(0, self._highs.getInfo().simplex_iteration_count)
            rows = 2 * (self.instance.n - 1) + len(self._rows.bounds)
            self.work += (steps + 30) * (self._columns + rows)
            status = self._highs.getModelStatus()
            if status != highspy.HighsModelStatus.kIterationLimit or stop():
                break
        solution = self._highs.getSolution()
        if status not in (
            highspy.HighsModelStatus.kOptimal,
            highspy.HighsModelStatus.kIterationLimit,
        ):
            # Also if no order is left below the cutoff; other methods have to prove that.
            return None
        tight = np.asarray(solution.row_value)[2 * (self.instance.n - 1) :]
        self._slack = np.where(tight < self._rows.bounds + 1e-6, 0, self._slack + 1)
        return np.asarray(solution.col_value)

    def taken(self, values: Floats) -> Floats:
        """Return the fraction taken of every arc, shape (n, n)."""
        taken = np.zeros(self.arc.shape)
        taken[self.tails, self.heads] = values[: len(self.tails)]
        return taken

    def earlier(self, values: Floats) -> Floats:
        """Return the fraction by which a node comes before another, in [0, 1], shape (n, n)."""
        variable = np.where(self._pair < 0, 0.0, values[self._pair])
        earlier: Floats = np.clip(self._fixed + self._sign * variable, 0.0, 1.0)
        return earlier

    def proved(self) -> Duals:
        """Return the bound and reduced costs of the present dual values, valid despite errors."""
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
        bound = leaving.sum() + reaching.sum() + cuts @ rows.bounds
        # The variable of a pair is in [0, 1]: at a negative reduced cost it is at its upper bound.
        priced = -weights[arcs:]
        bound += np.minimum(priced, 0.0).sum()
        duals = repair(float(bound), reduced)
        used = (cuts > 0) & (rows.triple[:, 0] >= 0)
        costly = np.nonzero(priced)[0]
        turned = priced[costly] < 0
        pairs = np.where(turned[:, None], self._open[costly, ::-1], self._open[costly])
        duals.prices = PairPrices(pairs, np.abs(priced[costly]), rows.triple[used], cuts[used])
        return duals

    def forbid(self, duals: Duals, cutoff: float) -> None:
        """Forbid arcs that no order below the cutoff takes (reduced-cost fixing)."""
        gone = self.arc[(self.arc >= 0) & (duals.bound + duals.reduced >= cutoff)]
        if len(gone):
            self.arc[self.tails[gone], self.heads[gone]] = -1
            nothing = np.zeros(len(gone))
            self._highs.changeColsBounds(
                len(gone), np.sort(gone).astype(np.int32), nothing, nothing
            )

    def drop(self) -> None:
        """Drop cuts that were slack for some rounds."""
        gone = self._slack >= _SLACK_ROUNDS
        many = int(gone.sum())
        if many > _FEW:
            numbers = (2 * (self.instance.n - 1) + np.nonzero(gone)[0]).astype(np.int32)
            self._highs.deleteRows(many, numbers)
            self._rows = self._rows.kept(~gone)
            self._slack = self._slack[~gone]

    def add_cuts(self, leave: Booleans, reach: Booleans, bounds: Floats, terms: Terms) -> None:
        """Add cuts: rows of the arcs between two sets."""
        crossing = leave[:, self.tails] & reach[:, self.heads]
        row, column = np.nonzero(crossing)
        self.add(bounds, (row, column, np.ones(len(row))), terms)

    def add_sum(self, arcs: Booleans, bound: int) -> None:
        """Add a cut: a lower bound on the sum of some arcs, shape (n, n)."""
        column = self.arc[arcs & (self.arc >= 0)]
        many = len(column)
        row = np.zeros(many, dtype=np.int64)
        self.add(np.array([float(bound)]), (row, column, np.ones(many)), join_terms())

    def add(
        self,
        bounds: Floats,
        arcs: tuple[Integers, Integers, Floats],
        terms: Terms,
        triple: Integers | None = None,
    ) -> None:
        """Add rows of arcs and of pairs.

        Parameters
        ----------
        least
            Right-hand sides, shape (rows,).
        triple
            Nodes of transitivity cuts, shape (rows, 3); None for other rows.
        """
        many = len(bounds)
        if not many:
            return
        row, entry, other, weight = terms
        column = self._pair[entry, other]
        bounds = bounds - np.bincount(row, weight * self._fixed[entry, other], many)
        varies = column >= 0
        rows = np.concatenate((arcs[0], row[varies]))
        columns = np.concatenate((arcs[1], column[varies]))
        values = np.concatenate((arcs[2], (weight * self._sign[entry, other])[varies]))
        by_row = np.argsort(rows, kind="stable")
        if triple is None:
            triple = np.full((many, 3), -1)
        added = _Rows(rows[by_row], columns[by_row], values[by_row], bounds, triple)
        self._highs.addRows(
            many,
            bounds,
            np.full(many, np.inf),
            len(rows),
            np.searchsorted(added.row, np.arange(many)).astype(np.int32),
            added.column.astype(np.int32),
            added.value,
        )
        self._rows = self._rows.followed_by(added)
        self._slack = np.concatenate((self._slack, np.zeros(many, dtype=np.int64)))


@compiled
def find_violated_triples(
    earlier: Floats, taken: Floats, violation: float
) -> tuple[Integers, Integers, Integers, Floats]:
    """Return the most violated transitivity cut of every pair.

    Parameters
    ----------
    earlier
        Fraction by which one node comes before another, in [0, 1], shape (n, n).
    taken
        Value of each arc, shape (n, n).

    Returns
    -------
    tuple
        Nodes j, k and i for which ``earlier[j, i] - taken[j, i]`` is less than
        ``earlier[j, k] + earlier[k, i] - 1``, and the violation, shape (t,) each.
    """
    n = len(earlier)
    ones = np.empty(n * n, dtype=np.int64)
    betweens = np.empty(n * n, dtype=np.int64)
    others = np.empty(n * n, dtype=np.int64)
    amounts = np.empty(n * n)
    count = 0
    for j in range(1, n - 1):
        for i in range(1, n - 1):
            if i == j:
                continue
            most, between = violation, -1
            allowed = earlier[j, i] - taken[j, i] + 1.0
            for k in range(1, n - 1):
                if k in (i, j):
                    continue
                beyond = earlier[j, k] + earlier[k, i] - allowed
                if beyond > most:
                    most, between = beyond, k
            if between >= 0:
                ones[count], betweens[count], others[count] = j, between, i
                amounts[count] = most
                count += 1
    return ones[:count], betweens[:count], others[:count], amounts[:count]


# Cuts of a kind added in a round, and pairs of nodes separated for at a time.
_MOST = 150
_LOOK = 1500
_VIOLATION = 0.03
_TIE_VIOLATION = 0.02
# Number of rounds, and share of the gap, below which the relaxation ends.
_PATIENCE = 20
_GAIN = 0.01
# Work of a separation per arc, in the unit of the program's work.
_FLOW_WORK = 4


class PairRelaxation:
    """The relaxation of an instance; it resumes with more work than before."""

    def __init__(self, relaxation: CutRelaxation) -> None:
        self.instance = instance = relaxation.instance
        self._program = PairProgram(instance, relaxation.arcs, relaxation.scale)
        ones = np.ones(len(relaxation.leave))
        self._program.add_cuts(relaxation.leave, relaxation.reach, ones, join_terms())
        for cut in relaxation.set_ups:
            self._program.add_sum(cut.arcs, cut.number)
        possible = ~instance.before.T
        np.fill_diagonal(possible, False)
        rest = np.argwhere(possible[1:-1, 1:-1]) + 1
        self._core, _ = select_pairs(instance.before)
        self._rest = np.random.default_rng(0).permutation(rest)
        self._next = 0
        self._bounds: list[float] = []
        self.duals: Duals | None = None
        self._flow_work = 0
        self.exhausted = False

    @property
    def work(self) -> int:
        """Simplex steps and flows times their sizes, which is proportional to the time."""
        return self._program.work + self._flow_work

    def run(
        self, work: int, cutoff: float, stop: Callable[[], bool], on_bound: Callable[[Duals], None]
    ) -> None:
        """Add cuts until the work is done, the bound reaches the cutoff or stops to rise."""
        most = self.work + work
        while not self.exhausted and self.work < most and not stop():
            values = self._program.solve(stop)
            if values is None or stop():
                self.exhausted = values is None
                return
            duals = self._program.proved()
            if self.duals is None or duals.bound > self.duals.bound:
                self.duals = duals
                on_bound(duals)
            if self.duals.bound >= cutoff:
                return
            self._bounds.append(self.duals.bound)
            if len(self._bounds) > _PATIENCE:
                gained = self.duals.bound - self._bounds[-1 - _PATIENCE]
                if gained < _GAIN * (cutoff - self.duals.bound):
                    self.exhausted = True
                    return
            self._program.forbid(duals, cutoff)
            self._program.drop()
            self.exhausted = not self._cut(values)

    def _cut(self, values: Floats) -> bool:
        """Separate violated cuts and add them; return True if there were any."""
        program = self._program
        before = program.rows
        taken, earlier = program.taken(values), program.earlier(values)
        self._tie(taken, earlier)
        tails, heads = np.array(np.nonzero(taken > 1e-7))
        flow = tails, heads, taken[tails, heads]
        count = self._cut_between(flow, earlier, self._core, _MOST)
        # Without other cuts, all pairs are separated for.
        most = 4 * _LOOK if program.rows > before else len(self._rest)
        looked = 0
        while count < _MOST and looked < min(most, len(self._rest)):
            chosen = (self._next + np.arange(min(_LOOK, len(self._rest)))) % len(self._rest)
            self._next = int((self._next + _LOOK) % len(self._rest))
            count += self._cut_between(flow, earlier, self._rest[chosen], _MOST - count)
            looked += len(chosen)
        return program.rows > before

    def _tie(self, taken: Floats, earlier: Floats) -> None:
        """Add rows that link arcs to pairs, and violated transitivity cuts."""
        program = self._program
        untied = (taken - earlier > _TIE_VIOLATION) & program.varies & (program.arc >= 0)
        i, j = np.nonzero(untied)
        row = np.arange(len(i))
        program.add(
            np.zeros(len(i)),
            (row, program.arc[i, j], -np.ones(len(i))),
            join_terms((row, i, j, 1.0)),
        )
        first, between, last, amount = find_violated_triples(earlier, taken, _TIE_VIOLATION)
        worst = np.argsort(-amount, kind="stable")[: 4 * _MOST]
        first, between, last = first[worst], between[worst], last[worst]
        row = np.arange(len(first))
        has = program.arc[first, last] >= 0
        program.add(
            -np.ones(len(first)),
            (row[has], program.arc[first, last][has], -np.ones(int(has.sum()))),
            join_terms(
                (row, first, last, 1.0), (row, first, between, -1.0), (row, between, last, -1.0)
            ),
            np.stack((first, between, last), axis=1),
        )

    def _cut_between(
        self, flow: tuple[Integers, Integers, Floats], earlier: Floats, pairs: Integers, most: int
    ) -> int:
        """Add the most violated cuts between pairs of nodes; return their number."""
        self._flow_work += _FLOW_WORK * len(pairs) * (len(flow[0]) + self.instance.n)
        arrive, depart, violated = separate_between(*flow, earlier, pairs, _VIOLATION)
        worst = np.argsort(-violated, kind="stable")[:most]
        worst = worst[violated[worst] > 0]
        many = len(worst)
        if not many:
            return 0
        arrive, depart = arrive[worst], depart[worst]
        i, j = pairs[worst].T
        row = np.arange(many)
        before = self.instance.before
        barred = before[:, i].T | before[j]
        leave, reach = depart & ~barred, ~arrive & ~barred
        leave[row, j] = reach[row, i] = False
        through = arrive & ~depart & ~barred
        through[row, i] = through[row, j] = False
        cut, node = np.nonzero(through)
        early = earlier[i[cut], node] <= earlier[node, j[cut]]
        late = ~early
        self._program.add_cuts(
            leave,
            reach,
            np.zeros(many),
            join_terms(
                (row, i, j, -1.0),
                (cut[early], i[cut[early]], node[early], 1.0),
                (cut[late], node[late], j[cut[late]], 1.0),
            ),
        )
        return many
