"""Lower bounds by a linear relaxation with precedence cuts, and reduced-cost fixing of arcs.

The assignment relaxation: every node but the last is left once, every node but the first is
entered once. Cuts include subtour elimination (see `precedence_cuts`), and least numbers of
set-ups (see `find_set_up_cuts`), which stay. Column generation solves the program with the dual
simplex method of HiGHS (Huangfu and Hall, 2018). Bounds are computed from dual values and hold
despite their errors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import highspy
import numpy as np

from skillplan.solvers.ordering.instance import NO_ARC, Booleans, Floats, Integers, OrderingInstance
from skillplan.solvers.ordering.relaxation.precedence_cuts import (
    find_set_up_cuts,
    select_pairs,
    separate,
)


def build_assignment(n: int, sums: Floats | None = None) -> highspy.Highs:
    """Return a program without columns.

    Rows 0 to n - 2 leave a node, the next n - 1 enter one, and the others are sums with lower
    bounds.
    """
    highs = highspy.Highs()
    for key, value in (
        ("output_flag", False),
        ("threads", 1),
        ("presolve", "off"),
        ("solver", "simplex"),
        ("simplex_strategy", 1),
        ("random_seed", 0),
        ("dual_feasibility_tolerance", 1e-9),
        ("primal_feasibility_tolerance", 1e-9),
    ):
        highs.setOptionValue(key, value)
    rows = 2 * (n - 1)
    ones = np.ones(rows)
    none = np.zeros(0, dtype=np.int32)
    highs.addRows(rows, ones, ones, 0, np.zeros(rows, dtype=np.int32), none, np.zeros(0))
    if sums is not None:
        many = len(sums)
        starts = np.zeros(many, dtype=np.int32)
        highs.addRows(many, sums, np.full(many, np.inf), 0, starts, none, np.zeros(0))
    return highs


@dataclass
class PairPrices:
    """Reduced costs of an order for the sequence of two or three nodes.

    Parameters
    ----------
    pairs, pair_prices
        Price if the first node comes before the second, shape (p, 2), (p,).
    triples, triple_prices
        Nodes j, k and i, shape (t, 3), (t,). The price applies to the sequences j, i, k and k, j, i
        unless j comes right before i, and to the sequence i, k, j; other nodes may come between.
    """

    pairs: Integers
    pair_prices: Floats
    triples: Integers
    triple_prices: Floats

    def mirrored(self, n: int) -> PairPrices:
        """Return the prices of reversed orders, with node n - 1 - i for i."""
        return PairPrices(
            n - 1 - self.pairs[:, ::-1],
            self.pair_prices,
            n - 1 - self.triples[:, ::-1],
            self.triple_prices,
        )


def _no_prices() -> PairPrices:
    return PairPrices(
        np.zeros((0, 2), dtype=np.int64), np.zeros(0), np.zeros((0, 3), dtype=np.int64), np.zeros(0)
    )


@dataclass
class Duals:
    """A lower bound and the prices that prove it.

    Parameters
    ----------
    reduced
        Every order costs at least `bound` plus the reduced costs of its arcs, shape (n, n), >= 0;
        inf
        for forbidden arcs.
    prices
        Additional reduced costs of pairs and triples.
    """

    bound: float
    reduced: Floats
    prices: PairPrices = field(default_factory=_no_prices)

    def mirrored(self) -> Duals:
        """Return the duals of reversed orders, with node n - 1 - i for i."""
        return Duals(
            self.bound,
            np.ascontiguousarray(self.reduced[::-1, ::-1].T),
            self.prices.mirrored(len(self.reduced)),
        )

    def without(self, cutoff: float) -> Duals:
        """Return duals with inf for arcs of no order below a cutoff (reduced-cost fixing)."""
        reduced = self.reduced.copy()
        reduced[self.bound + reduced >= cutoff] = np.inf
        return Duals(self.bound, reduced, self.prices)


class Charges(NamedTuple):
    """Additional reduced costs of a label for its next node, by its set.

    They belong to pairs and triples; see `build_charges`.

    Parameters
    ----------
    first
        First charge of each node, shape (n + 1,).
    has, lacks, after
        A charge applies if node `has` is visited, node `lacks` is not (-1 for none), and the label
        does
        not end at `after` (-1 for none), shape (c,) each.
    amounts
        Shape (c,), > 0.
    """

    first: Integers
    has: Integers
    lacks: Integers
    after: Integers
    amounts: Floats


def build_charges(duals: Duals) -> Charges:
    """Return the charges of labels from the start.

    The reduced cost of an order is at least the charges of its first part from the start plus those
    of
    the rest from the end, in the mirrored instance: a pair is charged if both nodes are in one
    part, a
    triple with its middle node. That holds for two parts without a common node; a common node would
    be
    charged twice.
    """
    prices = duals.prices
    first, second = prices.pairs.T
    j, k, i = prices.triples.T
    # The sequence k, j, i is always charged here if j cannot come right before i; else in the
    # mirrored instance.
    apart = ~np.isfinite(duals.reduced[j, i])
    none = np.full_like
    node = np.concatenate((second, i, k, j[apart]))
    has = np.concatenate((first, j, i, k[apart]))
    lacks = np.concatenate((none(first, -1), k, j, i[apart]))
    after = np.concatenate((none(first, -1), j, none(k, -1), none(j[apart], -1)))
    price = prices.triple_prices
    amounts = np.concatenate((prices.pair_prices, price, price, price[apart]))
    ranked = np.argsort(node, kind="stable")
    starts = np.searchsorted(node[ranked], np.arange(len(duals.reduced) + 1))
    return Charges(starts, has[ranked], lacks[ranked], after[ranked], amounts[ranked])


def repair(bound: float, reduced: Floats) -> Duals:
    """Return valid duals: negative reduced costs are subtracted from the bound."""
    finite = reduced[:-1, 1:]
    rows = np.minimum(finite.min(axis=1), 0.0)
    rows[~np.isfinite(rows)] = 0.0
    finite -= rows[:, None]
    return Duals(bound + float(rows.sum()), np.maximum(reduced, 0.0))


_NEAR = 8
_SLACK_ROUNDS = 4
_SETTLED = (highspy.HighsModelStatus.kOptimal, highspy.HighsModelStatus.kInfeasible)


class CutRelaxation:
    """The relaxation of an instance, tightened in rounds.

    Parameters
    ----------
    arcs
        Arcs that a better order may take, shape (n, n).
    start
        Order whose arcs are initial columns.
    """

    def __init__(
        self, instance: OrderingInstance, arcs: Booleans, start: Integers | None = None
    ) -> None:
        self.instance = instance
        self.arcs = arcs & (instance.costs < NO_ARC)
        self.scale = 1e4 / max(1.0, float(instance.costs[self.arcs].max(initial=0.0)))
        if instance.step:
            self.scale = 1.0 if instance.costs[self.arcs].max(initial=0) < 1e6 else self.scale
        self.leave = np.zeros((0, instance.n), dtype=np.bool_)
        self.reach = np.zeros((0, instance.n), dtype=np.bool_)
        self._slack = np.zeros(0, dtype=np.int64)
        self.solves = 0
        # Simplex steps and starts times the size, which is proportional to the time.
        self.work = 0
        self.tails = np.zeros(0, dtype=np.int64)
        self.heads = np.zeros(0, dtype=np.int64)
        self._upper = np.zeros(0)
        self._column = np.full((instance.n, instance.n), -1, dtype=np.int64)
        self.set_ups = find_set_up_cuts(instance)
        self._set_ups = np.array([cut.arcs for cut in self.set_ups], dtype=np.bool_)
        self._set_ups = self._set_ups.reshape(-1, *self.arcs.shape)
        self._least = np.array([cut.number for cut in self.set_ups], dtype=np.float64)
        # Number of rows before the cuts.
        self._fixed = 2 * (instance.n - 1) + len(self.set_ups)
        self._highs = build_assignment(instance.n, self._least)
        self._add(self._first_arcs(start))
        self._pairs = select_pairs(instance.before)
        self._next = 0

    def _first_arcs(self, start: Integers | None) -> Booleans:
        instance = self.instance
        chosen = np.zeros_like(self.arcs)
        for costs, put in ((instance.costs, chosen), (instance.costs.T, chosen.T)):
            ranked = np.argsort(costs, axis=1, kind="stable")[:, :_NEAR]
            np.put_along_axis(put, ranked, True, axis=1)
        chosen &= self.arcs
        if start is not None:
            chosen[start[:-1], start[1:]] = True
        else:
            chosen = self.arcs
        return chosen

    def _add(self, chosen: Booleans) -> None:
        """Add arcs as columns."""
        tails, heads = np.nonzero(chosen & (self._column < 0))
        many = len(tails)
        if not many:
            return
        n = self.instance.n
        crossing = np.concatenate(
            (self._set_ups[:, tails, heads], self.leave[:, tails] & self.reach[:, heads])
        )
        counts = 2 + crossing.sum(axis=0)
        starts = np.concatenate(([0], np.cumsum(counts)[:-1]))
        indices = np.empty(int(counts.sum()), dtype=np.int32)
        indices[starts] = tails
        indices[starts + 1] = n - 1 + heads - 1
        column, cut = np.nonzero(crossing.T)
        if len(column):
            within = np.arange(len(column)) - np.searchsorted(column, column)
            indices[starts[column] + 2 + within] = 2 * (n - 1) + cut
        self._highs.addCols(
            many,
            self.instance.costs[tails, heads] * self.scale,
            np.zeros(many),
            np.full(many, np.inf),
            len(indices),
            starts.astype(np.int32),
            indices,
            np.ones(len(indices)),
        )
        self._upper = np.concatenate((self._upper, np.full(many, np.inf)))
        self._column[tails, heads] = len(self.tails) + np.arange(many)
        self.tails = np.concatenate((self.tails, tails))
        self.heads = np.concatenate((self.heads, heads))

    def solve(self) -> bool:
        """Solve over the present columns; return False if they are proved infeasible.

        If the solver fails, it starts from scratch once; then the bound of its dual values is used.
        """
        self._run()
        if self._highs.getModelStatus() not in _SETTLED:
            self._highs.clearSolver()
            self._run()
        return bool(self._highs.getModelStatus() != highspy.HighsModelStatus.kInfeasible)

    def settle(self, arcs: Booleans, stop: Callable[[], bool]) -> bool:
        """Solve over some arcs by column generation; return True if they may contain an order."""
        while not self.solve():
            if not self.complete(arcs):
                return False
        while self.price(arcs) and not stop():
            self.solve()
        return True

    def _run(self) -> None:
        self._highs.run()
        self.solves += 1
        steps = max(0, self._highs.getInfo().simplex_iteration_count)
        rows = self._fixed + len(self.leave)
        self.work += (steps + 30) * (len(self.tails) + rows)

    def values(self) -> Floats:
        """Return the value of each column in the solution, shape (columns,)."""
        return np.asarray(self._highs.getSolution().col_value)

    def duals(self, arcs: Booleans | None = None) -> Duals:
        """Return the bound and reduced costs of the present dual values, over all arcs or some."""
        return repair(*self._priced(self.arcs if arcs is None else arcs))

    def _priced(self, arcs: Booleans) -> tuple[float, Floats]:
        """Return the bound of the present dual values, and the reduced costs of some arcs."""
        n, fixed = self.instance.n, self._fixed
        prices = np.asarray(self._highs.getSolution().row_dual) / self.scale
        leaving, reaching = prices[: n - 1], prices[n - 1 : 2 * (n - 1)]
        set_ups = np.maximum(prices[2 * (n - 1) : fixed], 0.0)
        cuts = np.maximum(prices[fixed:], 0.0)
        used = cuts > 0
        reduced = np.where(arcs, self.instance.costs, np.inf)
        if used.any():
            weights = self.leave[used].T.astype(np.float64) * cuts[used]
            reduced -= weights @ self.reach[used].astype(np.float64)
        for price, taken in zip(set_ups, self._set_ups, strict=True):
            reduced -= price * taken
        reduced[:-1] -= leaving[:, None]
        reduced[:, 1:] -= reaching
        bound = leaving.sum() + reaching.sum() + cuts.sum() + set_ups @ self._least
        return float(bound), reduced

    def price(self, arcs: Booleans | None = None) -> int:
        """Price arcs and add columns of negative reduced cost; return their number."""
        arcs = self.arcs if arcs is None else arcs
        _, reduced = self._priced(arcs & (self._column < 0))
        is_priced = reduced < -1e-7 / self.scale
        many = int(is_priced.sum())
        most = 4 * self.instance.n
        if many > most:
            is_priced &= reduced <= np.partition(reduced[is_priced], most)[most]
        self._add(is_priced)
        return many

    def cut(self, most: int, violation: float = 0.05, look: int = 2000) -> int:
        """Separate violated cuts and add them; return their number."""
        values = self.values()
        taken = values > 1e-7
        tails, heads, values = self.tails[taken], self.heads[taken], values[taken]
        leave, reach = separate(
            tails, heads, values, self.instance.before, self._window(look), violation, most
        )
        if not len(leave):
            return 0
        fresh = _select_distinct(leave, reach)
        return self.add_cuts(leave[fresh], reach[fresh])

    def add_cuts(self, leave: Booleans, reach: Booleans) -> int:
        """Add cuts: at least one arc goes from `leave` to `reach`; return their number.

        Parameters
        ----------
        leave, reach
            Nodes of every cut, shape (cuts, n) each.
        """
        if not len(leave):
            return 0
        crossing = leave[:, self.tails] & reach[:, self.heads]
        counts = crossing.sum(axis=1)
        starts = np.concatenate(([0], np.cumsum(counts)[:-1])).astype(np.int32)
        _, columns = np.nonzero(crossing)
        many = len(leave)
        self._highs.addRows(
            many,
            np.ones(many),
            np.full(many, np.inf),
            len(columns),
            starts,
            columns.astype(np.int32),
            np.ones(len(columns)),
        )
        self.leave = np.concatenate((self.leave, leave))
        self.reach = np.concatenate((self.reach, reach))
        self._slack = np.concatenate((self._slack, np.zeros(many, dtype=np.int64)))
        return many

    def _window(self, look: int) -> Integers:
        """Return pairs to separate for: pairs with the first or the last node, and some others."""
        core, rest = self._pairs
        if not len(rest):
            return core
        chosen = (self._next + np.arange(min(look, len(rest)))) % len(rest)
        self._next = int((self._next + look) % len(rest))
        return np.concatenate((core, rest[chosen]))

    def drop(self) -> int:
        """Drop cuts that were slack for some rounds; return their number."""
        duals = np.asarray(self._highs.getSolution().row_dual)[self._fixed :]
        self._slack = np.where(duals > 1e-9, 0, self._slack + 1)
        gone = self._slack >= _SLACK_ROUNDS
        many = int(gone.sum())
        if many < 20:
            return 0
        rows = (self._fixed + np.nonzero(gone)[0]).astype(np.int32)
        self._highs.deleteRows(many, rows)
        kept = ~gone
        self.leave, self.reach = self.leave[kept], self.reach[kept]
        self._slack = self._slack[kept]
        return many

    def restrict(self, arcs: Booleans) -> None:
        """Fix all but some arcs to zero, until the next call."""
        upper = np.where(arcs[self.tails, self.heads], np.inf, 0.0)
        changed = np.nonzero(upper != self._upper)[0]
        if len(changed):
            self._highs.changeColsBounds(
                len(changed), changed.astype(np.int32), np.zeros(len(changed)), upper[changed]
            )
            self._upper = upper

    def basis(self) -> highspy.HighsBasis:
        """Return the present basis."""
        return self._highs.getBasis()

    def set_basis(self, basis: highspy.HighsBasis) -> None:
        """Continue from a basis."""
        self._highs.setBasis(basis)

    def trial(
        self, arcs: Booleans, back: Booleans, basis: highspy.HighsBasis, duals: Duals
    ) -> float:
        """Return the bound after a few simplex steps with some arcs only (strong branching)."""
        self.restrict(arcs)
        self._highs.setOptionValue("simplex_iteration_limit", 15)
        self._run()
        if self._highs.getModelStatus() == highspy.HighsModelStatus.kInfeasible:
            # Arcs without columns may still form an order.
            bound = duals.bound if (arcs & (self._column < 0)).any() else np.inf
        else:
            bound = self.duals(arcs).bound
        self._highs.setOptionValue("simplex_iteration_limit", 2**31 - 1)
        self.restrict(back)
        self._highs.setBasis(basis)
        return max(bound, duals.bound)

    def complete(self, arcs: Booleans) -> int:
        """Add arcs as columns at any cost; return the number of new ones."""
        many = int((arcs & (self._column < 0)).sum())
        self._add(arcs)
        return many

    def fix(self, duals: Duals, cutoff: float) -> int:
        """Forbid arcs that no order below the cutoff takes; return their number."""
        gone = self.arcs & (duals.bound + duals.reduced >= cutoff)
        return self.forbid(gone)

    def forbid(self, gone: Booleans) -> int:
        """Forbid arcs; return the number of those allowed before."""
        gone = gone & self.arcs
        self.arcs = self.arcs & ~gone
        columns = self._column[gone & (self._column >= 0)]
        if len(columns):
            many = len(columns)
            self._upper[columns] = 0.0
            self._highs.changeColsBounds(
                many, np.sort(columns).astype(np.int32), np.zeros(many), np.zeros(many)
            )
        return int(gone.sum())


def _select_distinct(leave: Booleans, reach: Booleans) -> Integers:
    both = np.packbits(np.concatenate((leave, reach), axis=1), axis=1)
    _, first = np.unique(both, axis=0, return_index=True)
    return np.sort(first)
