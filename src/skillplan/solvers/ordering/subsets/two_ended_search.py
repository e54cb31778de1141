"""Bidirectional Held-Karp: dynamic programming over feasible subsets from both ends, to proof.

The reduced cost of an order below the cutoff is less than the gap. So wherever it is cut, its
first or its last part has little reduced cost. It is enough to know all cheap labels from the
start and all cheap labels from the end, which are far fewer than all labels of one direction. The
budget of reduced cost is split so that both ends have about equally many labels (after Dantzig,
1960, and Pohl, "Bi-directional search", 1971).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np

from skillplan.solvers.ordering.instance import NO_ARC, Integers, OrderingInstance
from skillplan.solvers.ordering.relaxation.reduced_costs import Duals, charges_of
from skillplan.solvers.ordering.subsets.bit_sets import words_of
from skillplan.solvers.ordering.subsets.completion_bounds import CompletionBounds
from skillplan.solvers.ordering.subsets.held_karp import (
    Ahead,
    Arcs,
    Layer,
    Limits,
    expand,
    first_layer,
    meet,
)
from skillplan.solvers.ordering.subsets.side_by_side import Stop, side_by_side

R = TypeVar("R")

_BITS = 6
# Exponent of the growth where it is not known yet.
_POWER = 1.0
# Where more than so many times the labels allowed are expected, the search is not begun.
_HOPELESS = 2
# Up to so many times the labels allowed it is tried; it stops at twice as many.
_DARING = 1.5
# Where there were too many labels, how many times too many are assumed.
_MORE = 2
# One label in so many of those allowed is enough to extrapolate from.
_SAMPLE = 2


class _End:
    """The labels from one end whose reduced cost is within a budget.

    A triple is charged with its middle node, by either end. So one end is not strict: it does not
    count the charges of the last node. Then the longest label of an order that it keeps uses up its
    budget with the arc that follows; and the rest of the order after that arc stays below the
    budget of the other end, all charges included.
    """

    def __init__(
        self, instance: OrderingInstance, duals: Duals, cutoff: float, *, strict: bool
    ) -> None:
        self.strict = strict
        self.instance = instance
        self.room = cutoff - duals.bound
        self.bounds = CompletionBounds(instance, duals, _BITS)
        tails, heads = np.nonzero(np.isfinite(duals.reduced))
        self.arcs = Arcs(
            np.searchsorted(tails, np.arange(instance.n + 1)),
            heads,
            np.ascontiguousarray(instance.costs[tails, heads]),
            np.ascontiguousarray(duals.reduced[tails, heads]),
            words_of(instance.before),
        )
        self.charges = charges_of(duals)
        start = first_layer(self.arcs.preds.shape[1])
        # Where one end has not been searched, the other has to search all layers.
        self.layers = [start]
        self.budget = 0.0
        self.count = 0
        self.known: list[tuple[float, int]] = []
        self.made = 0
        # The budget that was too large, and about how many labels it would have led to.
        self.beyond: tuple[float, int] | None = None

    def expected(self, most: float) -> float:
        """Return about how many labels a budget leads to, from the last two known counts.

        The count grows with a power of a small budget, later more slowly.
        """
        points = [*self.known[-2:], *([self.beyond] if self.beyond else [])]
        if len(points) < 2:
            return np.inf
        (before, few), (now, many) = points[-2:]
        power = _POWER
        # The count of a tiny budget says nothing of the growth.
        if before > self.known[0][0]:
            power = np.log(max(many, 2) / max(few, 1)) / np.log(now / before)
        return float(many * (most / now) ** max(0.0, power))

    def sample(self, labels: int, stop: Stop) -> None:
        """Count the labels of small budgets, from a tiny one on, to extrapolate from."""
        most = self.room * 1e-6 if not self.known else max(2 * self.known[-1][0], self.room / 64)
        while not stop() and most < self.room and self.count < labels // _SAMPLE:
            if not self.extend(most, labels if self.known else labels // 4, stop):
                return
            most = max(2 * most, self.room / 64)

    def extend(self, most: float, labels: int, stop: Stop) -> bool:
        """Find all labels within a budget; return whether the search ended within its limits."""
        layers = self.layers[:1]
        left = labels
        for layer in range(1, self.instance.n):
            ahead = Ahead(self.bounds.near, self.bounds.slot[layer], self.bounds.ahead)
            limits = Limits(float(most), self.strict, self.room, max(1, left), True)
            found, dropped, tried = expand(layers[-1], self.arcs, ahead, self.charges, limits)
            self.made += tried
            left -= len(found.lasts)
            if np.isfinite(dropped) or left <= 0:
                self.beyond = most, max(_MORE * labels, self.count + 1)
                return False
            if stop():
                return False
            if not len(found.lasts):
                break
            # The bounds are not needed again, so their memory is released.
            layers.append(found._replace(bounds=found.bounds[:0]))
        self.layers, self.budget, self.count = layers, most, labels - left
        self.beyond = None
        self.known.append((most, self.count))
        return True


@dataclass
class Meeting:
    """The result of a bidirectional search.

    Parameters
    ----------
    order
        The cheapest order found below the cutoff, or None.
    bound
        No order costs less than this or the cutoff, whichever is less.
    whole
        Whether the search ran to its end.
    """

    order: Integers | None
    bound: float
    whole: bool


class TwoEndedSearch:
    """The bidirectional search; it resumes with more labels than before.

    Parameters
    ----------
    instance
        The ordering.
    duals
        A bound and reduced costs; inf where no order below the cutoff takes an arc.
    cutoff
        Only orders that cost less are searched for.
    threads
        With more than one, both ends are searched at once, >= 1.
    """

    def __init__(
        self, instance: OrderingInstance, duals: Duals, cutoff: float, threads: int = 1
    ) -> None:
        self.instance = instance
        self.duals = duals
        self.cutoff = cutoff
        # While no order is known, an upper bound on all orders replaces the cutoff.
        self.most = min(cutoff, max(_beyond(instance), duals.bound + 1.0))
        self.room = self.most - duals.bound
        self.threads = threads
        ahead = partial(_End, instance, duals, self.most, strict=False)
        behind = partial(_End, _mirror(instance), duals.mirrored(), self.most, strict=True)
        self.ends = self._each([lambda _: ahead(), lambda _: behind()], lambda: False)
        self.expected = np.inf

    @property
    def made(self) -> int:
        """Labels generated."""
        return sum(end.made for end in self.ends)

    def _each(self, tasks: Sequence[Callable[[Stop], R]], stop: Stop) -> list[R]:
        """Do tasks of both ends, at once where there are threads for that; return the results."""
        if self.threads > 1:
            return side_by_side(tasks, stop)
        return [task(stop) for task in tasks]

    def run(self, labels: int, stop: Stop) -> Meeting:
        """Search if about so many labels or fewer are expected from either end."""
        if np.isfinite(self.expected) and self.expected > _HOPELESS * labels:
            return Meeting(None, self._proved(self.cutoff, whole=False), whole=False)
        self._each([partial(end.sample, labels // 2) for end in self.ends], stop)
        grid = np.linspace(0.0, 1.0, 33)[1:-1] * self.room
        ahead, behind = (
            np.array([max(end.expected(most), end.count) for most in budgets])
            for end, budgets in zip(self.ends, (grid, self.room - grid), strict=True)
        )
        worst = np.maximum(ahead, behind)
        chosen = int(np.argmin(worst))
        self.expected = float(worst[chosen])
        if self.expected > _DARING * labels or stop():
            return self._meet(whole=False)
        budgets = float(grid[chosen]), float(self.room - grid[chosen])
        return self._meet(whole=self._extend(budgets, 2 * labels, stop))

    def _extend(self, budgets: tuple[float, float], labels: int, stop: Stop) -> bool:
        """Find all labels within the budgets; return whether both ends did.

        In one thread the second end is left alone where the first was given up. In two threads
        both go on, so that what is found does not depend on which is faster.
        """
        tasks = [
            partial(end.extend, most, labels)
            for end, most in zip(self.ends, budgets, strict=True)
            if end.budget < most
        ]
        if self.threads > 1:
            return all(self._each(tasks, stop))
        return all(not stop() and task(stop) for task in tasks)

    def _meet(self, *, whole: bool) -> Meeting:
        ahead, behind = self.ends
        n = self.instance.n
        layers = [
            layer
            for layer in range(min(n - 1, len(ahead.layers)))
            if n - 2 - layer < len(behind.layers)
        ]
        shares = [layers[i :: self.threads] for i in range(self.threads)]
        found = self._each([partial(self._meet_in, share) for share in shares], lambda: False)
        least, layer, first, second = min(found)
        if first < 0:
            return Meeting(None, self._proved(self.cutoff, whole=whole), whole)
        start = _walk_back(ahead.layers, layer, first)[::-1]
        end = [n - 1 - node for node in _walk_back(behind.layers, n - 2 - layer, second)]
        return Meeting(np.array(start + end), self._proved(least, whole=whole), whole)

    def _meet_in(self, layers: Sequence[int], _stop: Stop) -> tuple[float, int, int, int]:
        """Join the ends in some layers: return the least cost, its layer and the two labels.

        In the first of the layers that have it, so that all layers may be shared out at will.
        """
        ahead, behind = self.ends
        best = (self.most, self.instance.n, -1, -1)
        for layer in layers:
            opposite = self.instance.n - 2 - layer
            # The end itself is reached by any label that is left.
            most = ahead.budget if opposite else -np.inf
            other = behind.layers[opposite]
            cost, first, second = meet(ahead.layers[layer], ahead.arcs, most, other, best[0])
            if first >= 0:
                best = (float(cost), layer, int(first), int(second))
        return best

    def _proved(self, least: float, *, whole: bool) -> float:
        """Return the bound that both budgets prove, where no cheaper order was found."""
        budget = sum(end.budget for end in self.ends)
        return least if whole else min(least, self.duals.bound + budget)


def _beyond(instance: OrderingInstance) -> float:
    """Return an upper bound on the cost of every order."""
    used = np.where(instance.costs < NO_ARC, instance.costs, 0.0)
    return 1.0 + 1.001 * float(used.max(axis=1).sum())


def _walk_back(layers: list[Layer], layer: int, at: int) -> list[int]:
    nodes = []
    for here in range(layer, -1, -1):
        nodes.append(int(layers[here].lasts[at]))
        at = int(layers[here].parents[at])
    return nodes


def _mirror(instance: OrderingInstance) -> OrderingInstance:
    """Return the same instance with orders reversed."""
    costs = np.where(instance.costs >= NO_ARC, np.inf, instance.costs)
    return OrderingInstance(
        np.ascontiguousarray(costs[::-1, ::-1].T),
        np.ascontiguousarray(instance.before[::-1, ::-1].T),
    )
