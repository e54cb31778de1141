"""Dynamic programming over feasible subsets from both ends, to proof.

An order below the cutoff has less than a certain sum of reduced costs. So either its first part
or its last part has little of it wherever it is cut, and it is enough to know all cheap ways from
the start and all cheap ways from the end, which are far fewer than all ways through. What either
end spends is raised where there are fewer ways (after Dantzig, 1960, and Pohl, "Bi-directional
search", 1971).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

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

_BITS = 6
# Of the growth where it is not known yet.
_POWER = 1.0
# Where so many times the states allowed are expected, no more of them are looked at.
_HOPELESS = 2
# Up to so many times the states it is tried, which ends at twice as many.
_DARING = 1.5
# Where there were too many, how many times too many there are taken to have been.
_MORE = 2
# Such a share of the states is enough to tell from how many there will be.
_SOUNDING = 2


class _End:
    """The ways from one end that spend less than so much.

    A triple is charged with its middle node, by either end. So one of them is not strict: it does
    not count the charges of the last node. Then the longest way of an order that it keeps spends,
    with the arc that follows, all that is left to it; and what comes after that arc spends less
    than is left to the other, all charges included.
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
        # Where an end has not been searched, the other has to come all the way to meet it.
        self.layers = [start]
        self.spent = 0.0
        self.count = 0
        self.known: list[tuple[float, int]] = []
        # What was too much to spend, and about how many ways that would have made.
        self.beyond: tuple[float, int] | None = None

    def expected(self, most: float) -> float:
        """Return about how many ways spend less, from the last two numbers that are known.

        They grow with a power of what is spent while there is little of it, later more slowly.
        """
        points = [*self.known[-2:], *([self.beyond] if self.beyond else [])]
        if len(points) < 2:
            return np.inf
        (before, few), (now, many) = points[-2:]
        power = _POWER
        # What spending next to nothing leads to says nothing of how it grows.
        if before > self.known[0][0]:
            power = np.log(max(many, 2) / max(few, 1)) / np.log(now / before)
        return float(many * (most / now) ** max(0.0, power))

    def spend(
        self, most: float, states: int, stop: Callable[[], bool], made: Callable[[int], None]
    ) -> bool:
        """Find all ways that spend less; return whether that came to an end within limits."""
        layers = self.layers[:1]
        left = states
        for layer in range(1, self.instance.n):
            ahead = Ahead(self.bounds.near, self.bounds.slot[layer], self.bounds.ahead)
            limits = Limits(float(most), self.strict, self.room, max(1, left), True)
            found, dropped, tried = expand(layers[-1], self.arcs, ahead, self.charges, limits)
            made(tried)
            left -= len(found.lasts)
            if np.isfinite(dropped) or left <= 0:
                self.beyond = most, max(_MORE * states, self.count + 1)
                return False
            if stop():
                return False
            if not len(found.lasts):
                break
            # What is still to be spent is not looked at again; it need not be held.
            layers.append(found._replace(ends=found.ends[:0]))
        self.layers, self.spent, self.count = layers, most, states - left
        self.beyond = None
        self.known.append((most, self.count))
        return True


@dataclass
class Meeting:
    """What came of a search from both ends.

    Parameters
    ----------
    order
        The cheapest order below the cutoff; None where there is none or it was not looked for.
    bound
        No order costs less than this or the cutoff, whichever is less.
    whole
        Whether the search came to its end.
    """

    order: Integers | None
    bound: float
    whole: bool


class TwoEndedSearch:
    """The search; may go on with more states than before.

    Parameters
    ----------
    instance
        The ordering.
    duals
        A bound and reduced costs; inf where no order below the cutoff takes an arc.
    cutoff
        Orders that cost as much are not looked for.
    """

    def __init__(self, instance: OrderingInstance, duals: Duals, cutoff: float) -> None:
        self.instance = instance
        self.duals = duals
        self.cutoff = cutoff
        # While no order is known, what none can cost stands for it: spending has to end somewhere.
        self.most = min(cutoff, max(_beyond(instance), duals.bound + 1.0))
        self.room = self.most - duals.bound
        self.ends = (
            _End(instance, duals, self.most, strict=False),
            _End(_mirror(instance), duals.mirrored(), self.most, strict=True),
        )
        self.made = 0
        self.expected = np.inf

    def run(self, states: int, stop: Callable[[], bool]) -> Meeting:
        """Search if no more than about so many states have to be kept for either end."""

        def count(tried: int) -> None:
            self.made += tried

        if np.isfinite(self.expected) and self.expected > _HOPELESS * states:
            return Meeting(None, self._proved(self.cutoff, whole=False), whole=False)
        for end in self.ends:
            self._sound(end, states // 2, stop, count)
        grid = np.linspace(0.0, 1.0, 33)[1:-1] * self.room
        ahead, behind = (
            np.array([max(end.expected(most), end.count) for most in spending])
            for end, spending in zip(self.ends, (grid, self.room - grid), strict=True)
        )
        worst = np.maximum(ahead, behind)
        chosen = int(np.argmin(worst))
        self.expected = float(worst[chosen])
        if self.expected > _DARING * states:
            return self._meet(whole=False)
        for end, most in zip(self.ends, (grid[chosen], self.room - grid[chosen]), strict=True):
            if stop():
                return self._meet(whole=False)
            if end.spent < most and not end.spend(float(most), 2 * states, stop, count):
                return self._meet(whole=False)
        return self._meet(whole=True)

    def _sound(
        self, end: _End, states: int, stop: Callable[[], bool], count: Callable[[int], None]
    ) -> None:
        """Find out how many ways there are that spend little, beginning with next to nothing."""
        most = self.room * 1e-6 if not end.known else max(2 * end.known[-1][0], self.room / 64)
        while not stop() and most < self.room and end.count < states // _SOUNDING:
            if not end.spend(most, states if end.known else states // 4, stop, count):
                return
            most = max(2 * most, self.room / 64)

    def _meet(self, *, whole: bool) -> Meeting:
        ahead, behind = self.ends
        n = self.instance.n
        least, at = self.most, (-1, -1, -1)
        for layer, one in enumerate(ahead.layers[: n - 1]):
            opposite = n - 2 - layer
            if opposite >= len(behind.layers):
                continue
            # The end itself is reached by whatever way is left.
            most = ahead.spent if opposite else -np.inf
            other = behind.layers[opposite]
            cost, first, second = meet(one, ahead.arcs, most, other, least)
            if first >= 0:
                least, at = cost, (layer, first, second)
        if at[0] < 0:
            return Meeting(None, self._proved(self.cutoff, whole=whole), whole)
        layer, first, second = at
        start = _walk_back(ahead.layers, layer, first)[::-1]
        end = [n - 1 - node for node in _walk_back(behind.layers, n - 2 - layer, second)]
        return Meeting(np.array(start + end), self._proved(least, whole=whole), whole)

    def _proved(self, least: float, *, whole: bool) -> float:
        """Return the bound: what both ends have spent together, nothing cheaper having been met."""
        spent = sum(end.spent for end in self.ends)
        return least if whole else min(least, self.duals.bound + spent)


def _beyond(instance: OrderingInstance) -> float:
    """Return more than any order costs."""
    used = np.where(instance.costs < NO_ARC, instance.costs, 0.0)
    return 1.0 + 1.001 * float(used.max(axis=1).sum())


def _walk_back(layers: list[Layer], layer: int, at: int) -> list[int]:
    nodes = []
    for here in range(layer, -1, -1):
        nodes.append(int(layers[here].lasts[at]))
        at = int(layers[here].parents[at])
    return nodes


def _mirror(instance: OrderingInstance) -> OrderingInstance:
    """Return the same orderings read backwards."""
    costs = np.where(instance.costs >= NO_ARC, np.inf, instance.costs)
    return OrderingInstance(
        np.ascontiguousarray(costs[::-1, ::-1].T),
        np.ascontiguousarray(instance.before[::-1, ::-1].T),
    )
