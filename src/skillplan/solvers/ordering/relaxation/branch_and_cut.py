"""Branch and cut: the relaxation with cuts, on parts of the orders where it is not tight enough.

A part is the orders that avoid some arcs. It is split by an arc: taken, so that no other leaves
its tail or reaches its head, or avoided. Which arc is told by what splitting has gained before
(Achterberg, Koch and Martin, "Branching rules revisited", 2005).
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.ordering.instance import Booleans, Floats, Integers
from skillplan.solvers.ordering.relaxation.arc_propagation import propagate
from skillplan.solvers.ordering.relaxation.cut_relaxation import CutRelaxation
from skillplan.solvers.ordering.relaxation.reduced_costs import Duals

_CANDIDATES = 10
_RELIABLE = 4
_ROUNDS = 6


@dataclass(order=True)
class _Part:
    bound: float
    number: int
    packed: NDArray[np.uint8] = field(compare=False)
    depth: int = field(compare=False)

    @classmethod
    def of(cls, bound: float, number: int, arcs: Booleans, depth: int) -> _Part:
        """Return a part; many of them wait, so that their arcs are packed."""
        return cls(bound, number, np.packbits(arcs), depth)

    def arcs(self, n: int) -> Booleans:
        """Return the arcs that its orders may take, shape (n, n)."""
        return np.unpackbits(self.packed, count=n * n).reshape(n, n).astype(np.bool_)


class BranchAndCut:
    """The search.

    Parameters
    ----------
    relaxation
        The root, cut already.
    cost
        Of the best order known; inf where there is none.
    stop
        Whether to stop now.
    on_order
        Called with every better order.
    on_bound
        Called with the bound and the number of parts looked at.
    """

    def __init__(
        self,
        relaxation: CutRelaxation,
        cost: float,
        stop: Callable[[], bool],
        on_order: Callable[[Integers], None],
        on_bound: Callable[[float, int], None],
    ) -> None:
        self.relaxation = relaxation
        self.instance = relaxation.instance
        self.cost = cost
        self.stop = stop
        self.on_order = on_order
        self.on_bound = on_bound
        self.parts = 0
        n = self.instance.n
        self._gains = np.zeros((2, n, n))
        self._trials = np.zeros((2, n, n))
        self._heap: list[_Part] = []
        self._made = 1
        self._open: _Part | None = _Part.of(-np.inf, 0, relaxation.arcs, 0)
        self.root: Duals | None = None

    @property
    def cutoff(self) -> float:
        """The bound from which on a part holds nothing better."""
        return self.instance.cutoff(self.cost)

    @property
    def done(self) -> bool:
        """Whether the best order is proved."""
        return self._open is None and not self._heap

    @property
    def bound(self) -> float:
        """No order costs less."""
        lows = [part.bound for part in (self._open, *self._heap[:1]) if part is not None]
        return min([self.cost, *lows])

    def run(self, work: int) -> None:
        """Search until it is done, was stopped, or the relaxation has done so much more work."""
        most = self.relaxation.work + work
        while not self.done and self.relaxation.work < most and not self.stop():
            if self._open is None:
                self._open = heapq.heappop(self._heap)
                if self._open.bound >= self.cutoff:
                    self._open = None
                    self._heap.clear()
                    break
            if self.parts % 8 == 0:
                self.on_bound(self.bound, self.parts)
            self._open = self._treat(self._open)

    def _treat(self, part: _Part) -> _Part | None:
        """Bound a part; return the half of it that is to be looked at next."""
        self.parts += 1
        relaxation = self.relaxation
        arcs = part.arcs(self.instance.n) & relaxation.arcs
        if not propagate(arcs, self.instance.before.copy()):
            return None
        relaxation.restrict(arcs)
        duals: Duals | None = None
        last = -np.inf
        for round_ in range(_ROUNDS if part.depth else 1000):
            if not relaxation.settle(arcs, self.stop):
                return None
            duals = relaxation.duals(arcs)
            if duals.bound >= self.cutoff:
                return None
            values = relaxation.values()
            order = self._order(values)
            if order is not None:
                self._keep(order)
                if duals.bound >= self.cutoff:
                    return None
            if self.stop() or (round_ >= 2 and duals.bound - last < 1e-3 * (self.cutoff - last)):
                break
            last = duals.bound
            if not relaxation.cut(60, 0.02 if order is None else 0.001, 600):
                break
        assert duals is not None
        if not part.depth:
            self.root = duals
        part.bound = max(part.bound, duals.bound)
        if part.depth % 4 == 0:
            relaxation.drop()
            relaxation.solve()
        if self.stop():
            return part
        arcs &= duals.bound + duals.reduced < self.cutoff
        return self._split(part, arcs, relaxation.values(), duals)

    def _order(self, values: Floats) -> Integers | None:
        """Return the order that the arcs taken make, or None where they make none."""
        taken = values > 0.999
        relaxation = self.relaxation
        if taken.sum() != self.instance.n - 1:
            return None
        following = np.full(self.instance.n, -1)
        following[relaxation.tails[taken]] = relaxation.heads[taken]
        order = [0]
        while following[order[-1]] >= 0 and len(order) <= self.instance.n:
            order.append(int(following[order[-1]]))
        found = np.array(order)
        return found if self.instance.feasible(found) else None

    def _keep(self, order: Integers) -> None:
        cost = self.instance.cost(order)
        if cost < self.cost:
            self.cost = cost
            self.on_order(order)

    def _split(self, part: _Part, arcs: Booleans, values: Floats, duals: Duals) -> _Part | None:
        relaxation = self.relaxation
        apart = np.abs(values - 0.5)
        candidates = np.nonzero(apart < 0.499)[0]
        if not len(candidates):
            return self._split_whole(part, arcs, values)
        tails, heads = relaxation.tails[candidates], relaxation.heads[candidates]
        fraction = values[candidates]
        score = self._score(tails, heads, fraction)
        ranked = np.argsort(-score, kind="stable")[:_CANDIDATES]
        best, chosen, bounds = -np.inf, int(ranked[0]), [part.bound, part.bound]
        unsure = 0
        basis = relaxation.basis()
        for k in ranked:
            i, j = int(tails[k]), int(heads[k])
            if min(self._trials[:, i, j]) < _RELIABLE and unsure < _CANDIDATES:
                unsure += 1
                tried = []
                for way in (0, 1):
                    half = _half(arcs, i, j, way)
                    bound = relaxation.trial(half, arcs, basis, duals)
                    gain = min(bound, self.cutoff) - part.bound
                    step = fraction[k] if way == 0 else 1 - fraction[k]
                    self._gains[way, i, j] += max(0.0, gain) / step
                    self._trials[way, i, j] += 1
                    tried.append(max(part.bound, bound))
                value = max(tried[0] - part.bound, 1e-6) * max(tried[1] - part.bound, 1e-6)
            else:
                tried = [part.bound, part.bound]
                value = float(score[k])
            if value > best:
                best, chosen, bounds = value, int(k), tried
        relaxation.set_basis(basis)
        return self._halves(part, arcs, int(tails[chosen]), int(heads[chosen]), bounds)

    def _split_whole(self, part: _Part, arcs: Booleans, values: Floats) -> _Part | None:
        """Split a part whose arcs are taken wholly, though no cut was found and it may hold more.

        Where they make an order, that is the cheapest of the part but for rounding.
        """
        if self.stop():
            return part
        if self._order(values) is not None:
            return None
        open_tails = np.nonzero(arcs.sum(axis=1) > 1)[0]
        if not len(open_tails):
            self._keep_only(arcs)
            return None
        taken = np.zeros(arcs.shape)
        taken[self.relaxation.tails, self.relaxation.heads] = values
        i = int(open_tails[0])
        j = int(np.argmax(np.where(arcs[i], taken[i], -1.0)))
        return self._halves(part, arcs, i, j, [part.bound, part.bound])

    def _keep_only(self, arcs: Booleans) -> None:
        """Keep the order of a part in which every node leaves at most one arc, if it is one."""
        order = [0]
        while len(order) < self.instance.n and arcs[order[-1]].any():
            order.append(int(np.argmax(arcs[order[-1]])))
        found = np.array(order)
        if self.instance.feasible(found):
            self._keep(found)

    def _halves(
        self, part: _Part, arcs: Booleans, i: int, j: int, bounds: list[float]
    ) -> _Part | None:
        """Split a part by an arc; return the half that is to be looked at next."""
        halves = []
        for way in (0, 1):
            if bounds[way] < self.cutoff:
                self._made += 1
                half = _half(arcs, i, j, way)
                halves.append(_Part.of(bounds[way], self._made, half, part.depth + 1))
        if not halves:
            return None
        # The half with the arc taken goes deeper first.
        following = halves.pop()
        for other in halves:
            heapq.heappush(self._heap, other)
        if self._heap and following.bound > self._heap[0].bound + 0.5 * (
            self.cutoff - self._heap[0].bound
        ):
            heapq.heappush(self._heap, following)
            return None
        return following

    def _score(self, tails: Integers, heads: Integers, fraction: Floats) -> Floats:
        trials = self._trials[:, tails, heads]
        gains = self._gains[:, tails, heads]
        mean = [self._gains[way].sum() / max(1.0, self._trials[way].sum()) or 1.0 for way in (0, 1)]
        down = np.where(trials[0] > 0, gains[0] / np.maximum(trials[0], 1), mean[0]) * fraction
        up = np.where(trials[1] > 0, gains[1] / np.maximum(trials[1], 1), mean[1]) * (1 - fraction)
        least = 1e-6
        score: Floats = np.maximum(down, least) * np.maximum(up, least)
        return score


def _half(arcs: Booleans, i: int, j: int, way: int) -> Booleans:
    """Return the arcs of the half that avoids an arc (0) or takes it (1)."""
    half = arcs.copy()
    if way == 0:
        half[i, j] = False
    else:
        half[i, :] = False
        half[:, j] = False
        half[i, j] = True
    return half
