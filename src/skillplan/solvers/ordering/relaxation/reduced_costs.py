"""A lower bound and what orders cost beyond it: for their arcs, and for what comes before what."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from skillplan.solvers.ordering.instance import Floats, Integers


@dataclass
class PairPrices:
    """What orders cost beyond a bound for the order of two nodes, or of three.

    Parameters
    ----------
    pairs, pair_prices
        Nodes of which the first costs so much if it comes before the second, shape (p, 2), (p,).
    triples, triple_prices
        Nodes j, k and i, shape (t, 3), (t,): j, i, k and k, j, i cost so much unless j comes right
        before i, and i, k, j does, in these orders with others between or not.
    """

    pairs: Integers
    pair_prices: Floats
    triples: Integers
    triple_prices: Floats

    def mirrored(self, n: int) -> PairPrices:
        """Return the prices of orders read backwards, nodes named n - 1 - i for i."""
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
    bound
        No order costs less.
    reduced
        Every order costs at least `bound` plus the reduced costs of its arcs, shape (n, n), >= 0;
        inf where no order takes an arc.
    prices
        What it costs on top of both.
    """

    bound: float
    reduced: Floats
    prices: PairPrices = field(default_factory=_no_prices)

    def mirrored(self) -> Duals:
        """Return the same of orders read backwards, nodes named n - 1 - i for i."""
        return Duals(
            self.bound,
            np.ascontiguousarray(self.reduced[::-1, ::-1].T),
            self.prices.mirrored(len(self.reduced)),
        )

    def without(self, cutoff: float) -> Duals:
        """Return the same with all arcs left out that no order below a cutoff takes."""
        reduced = self.reduced.copy()
        reduced[self.bound + reduced >= cutoff] = np.inf
        return Duals(self.bound, reduced, self.prices)


class Charges(NamedTuple):
    """What a way spends on its next node beside the arc, by what it has visited.

    Parameters
    ----------
    first
        Where the charges of a node begin, shape (n + 1,).
    has, lacks, after
        The node that has to be visited already, and the one that must not be (-1 for none); not
        charged where the way ends at `after` (-1 for none), shape (c,) each.
    amounts
        Shape (c,), > 0.
    """

    first: Integers
    has: Integers
    lacks: Integers
    after: Integers
    amounts: Floats


def charges_of(duals: Duals) -> Charges:
    """Return the charges on ways from the start.

    An order spends at least what is charged on its first part from the start, and on the rest from
    the end in the mirror: a pair is charged where both lie in one part, a triple with its middle
    node. That holds of two parts without a common node; a node that ends the one and begins the
    other would be charged twice.
    """
    prices = duals.prices
    first, second = prices.pairs.T
    j, k, i = prices.triples.T
    # Here k, j, i is charged for sure where j cannot come right before i; else in the mirror.
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


def repaired(bound: float, reduced: Floats) -> Duals:
    """Return valid duals from any: what is negative in a row or column is taken off the bound."""
    finite = reduced[:-1, 1:]
    rows = np.minimum(finite.min(axis=1), 0.0)
    rows[~np.isfinite(rows)] = 0.0
    finite -= rows[:, None]
    return Duals(bound + float(rows.sum()), np.maximum(reduced, 0.0))
