"""Dual bounds: a lower bound and the reduced costs that orders add to it, by arc and by pair."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from skillplan.solvers.ordering.instance import Floats, Integers


@dataclass
class PairPrices:
    """Reduced costs that an order adds to a bound for the sequence of two nodes, or of three.

    Parameters
    ----------
    pairs, pair_prices
        Pairs whose price is paid if the first comes before the second, shape (p, 2), (p,).
    triples, triple_prices
        Nodes j, k and i, shape (t, 3), (t,). The price is paid if they come in the sequence j, i,
        k or k, j, i, unless j comes right before i, and in the sequence i, k, j; other nodes
        may come between.
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
        Reduced costs of pairs and triples on top of both.
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
        """Reduced-cost fixing: return the same with inf for arcs of no order below a cutoff."""
        reduced = self.reduced.copy()
        reduced[self.bound + reduced >= cutoff] = np.inf
        return Duals(self.bound, reduced, self.prices)


class Charges(NamedTuple):
    """Reduced costs that a label is charged for its next node beside the arc's, by its set.

    They are those of pairs and triples; see `charges_of`.

    Parameters
    ----------
    first
        Where the charges of a node begin, shape (n + 1,).
    has, lacks, after
        A charge applies where the node `has` is visited, the node `lacks` is not (-1 for none),
        and the label does not end at `after` (-1 for none), shape (c,) each.
    amounts
        Shape (c,), > 0.
    """

    first: Integers
    has: Integers
    lacks: Integers
    after: Integers
    amounts: Floats


def charges_of(duals: Duals) -> Charges:
    """Return the charges of labels from the start.

    The reduced cost of an order is at least the charges of its first part from the start plus those
    of the rest from the end, in the mirrored instance: a pair is charged where both nodes lie in
    one part, a triple with its middle node. That holds for two parts without a common node; a node
    that ends the one and begins the other would be charged twice.
    """
    prices = duals.prices
    first, second = prices.pairs.T
    j, k, i = prices.triples.T
    # The sequence k, j, i is always charged here where j cannot come right before i; else in the
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


def repaired(bound: float, reduced: Floats) -> Duals:
    """Return valid duals from any: negative reduced costs are subtracted from the bound."""
    finite = reduced[:-1, 1:]
    rows = np.minimum(finite.min(axis=1), 0.0)
    rows[~np.isfinite(rows)] = 0.0
    finite -= rows[:, None]
    return Duals(bound + float(rows.sum()), np.maximum(reduced, 0.0))
