"""Branch and cut: branch and bound on arcs, with precedence cuts in every subproblem.

A subproblem contains the orders that avoid some arcs. It is branched on an arc: one child forbids
the arc, the other fixes it, so no other arc leaves its tail or enters its head. Reliability
branching chooses the arc (Achterberg, Koch and Martin, "Branching rules revisited", 2005): by
pseudocosts, the gains of earlier branchings, and by strong branching before these are reliable.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.ordering.instance import Booleans, Floats, Integers, OrderingInstance
from skillplan.solvers.ordering.relaxation.cut_relaxation import CutRelaxation, Duals
from skillplan.solvers.ordering.relaxation.precedence_cuts import propagate

_CANDIDATES = 10
# Least gain of a round of cuts, as a fraction of the gap.
_ENOUGH = 1e-4
_RELIABLE = 4
_ROUNDS = 6


@dataclass(order=True)
class Subproblem:
    """Orders over a subset of the arcs with a bound; `packed` holds the arcs."""

    bound: float
    number: int
    packed: NDArray[np.uint8] = field(compare=False)
    depth: int = field(compare=False)

    @classmethod
    def of(cls, bound: float, number: int, arcs: Booleans, depth: int) -> Subproblem:
        """Return a subproblem with packed arcs, as many subproblems wait in the queue."""
        return cls(bound, number, np.packbits(arcs), depth)

    def arcs(self, n: int) -> Booleans:
        """Return the allowed arcs, shape (n, n)."""
        return np.unpackbits(self.packed, count=n * n).reshape(n, n).astype(np.bool_)


class BranchAndCut:
    """The search tree of an instance.

    Parameters
    ----------
    cost
        Cost of the best known order, or inf.
    on_bound
        Called with the bound and the number of solved subproblems.
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
        self.subproblems = 0
        n = self.instance.n
        # Pseudocosts: gains of forbidding (0) or fixing (1) an arc, and their number.
        self._gains = np.zeros((2, n, n))
        self._trials = np.zeros((2, n, n))
        self._heap: list[Subproblem] = []
        self._made = 1
        self._open: Subproblem | None = Subproblem.of(-np.inf, 0, relaxation.arcs, 0)
        self.root: Duals | None = None
        # Least bound of the subproblems of other processes.
        self.elsewhere = np.inf

    @property
    def cutoff(self) -> float:
        """Bound at which a subproblem cannot contain a better order."""
        return self.instance.cutoff(self.cost)

    @property
    def done(self) -> bool:
        """True if no subproblem is left in this process."""
        return self._open is None and not self._heap

    @property
    def open(self) -> int:
        """Number of subproblems left in this process."""
        return len(self._heap) + (self._open is not None)

    @property
    def pseudocosts(self) -> tuple[Floats, Floats]:
        """Sums of gains and their numbers, by branch and arc, shape (2, n, n) each."""
        return self._gains, self._trials

    def learn(self, gains: Floats, trials: Floats) -> None:
        """Continue with pseudocosts of another tree."""
        self._gains, self._trials = gains.copy(), trials.copy()

    def give_all(self) -> list[Subproblem]:
        """Return and remove all subproblems, the least bound first."""
        left = sorted([*self._heap, *([] if self._open is None else [self._open])])
        self._heap, self._open = [], None
        return [subproblem for subproblem in left if subproblem.bound < self.cutoff]

    def deal(self, others: int) -> list[list[Subproblem]]:
        """Return about equal shares of the subproblems for other processes, and keep one share."""
        going_on, self._open = self._open, None
        left = self.give_all()
        self._open = going_on
        self.take(left[:: others + 1])
        return [left[i :: others + 1] for i in range(1, others + 1)]

    def take(self, subproblems: Iterable[Subproblem]) -> None:
        """Add subproblems; their order breaks ties of bounds."""
        for subproblem in subproblems:
            self._made += 1
            heapq.heappush(self._heap, replace(subproblem, number=self._made))

    @property
    def bound(self) -> float:
        """Lower bound on all orders."""
        lows = [
            subproblem.bound
            for subproblem in (self._open, *self._heap[:1])
            if subproblem is not None
        ]
        return min([self.cost, self.elsewhere, *lows])

    def run(self, work: int) -> None:
        """Search until the tree is done, the search is stopped, or the work is used up."""
        most = self.relaxation.work + work
        while not self.done and self.relaxation.work < most and not self.stop():
            if self._open is None:
                self._open = heapq.heappop(self._heap)
                if self._open.bound >= self.cutoff:
                    self._open = None
                    self._heap.clear()
                    break
            if self.subproblems % 8 == 0:
                self.on_bound(self.bound, self.subproblems)
            self._open = self._process(self._open)

    def _process(self, subproblem: Subproblem) -> Subproblem | None:
        """Bound and branch a subproblem; return the child to process next."""
        self.subproblems += 1
        relaxation = self.relaxation
        arcs = subproblem.arcs(self.instance.n) & relaxation.arcs
        if not propagate(arcs, self.instance.before.copy()):
            return None
        relaxation.restrict(arcs)
        duals: Duals | None = None
        last = -np.inf
        for round_ in range(_ROUNDS if subproblem.depth else 1000):
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
        if not subproblem.depth:
            self.root = duals
        subproblem.bound = max(subproblem.bound, duals.bound)
        if subproblem.depth % 4 == 0:
            relaxation.drop()
            relaxation.solve()
        if self.stop():
            return subproblem
        arcs &= duals.bound + duals.reduced < self.cutoff
        return self._branch(subproblem, arcs, relaxation.values(), duals)

    def _order(self, values: Floats) -> Integers | None:
        """Return the order of the chosen arcs, or None if they do not form one."""
        taken = values > 0.999
        relaxation = self.relaxation
        if taken.sum() != self.instance.n - 1:
            return None
        following = np.full(self.instance.n, -1)
        following[relaxation.tails[taken]] = relaxation.heads[taken]
        order = [0]
        while following[order[-1]] >= 0 and len(order) <= self.instance.n:
            order.append(int(following[order[-1]]))
        array = np.array(order)
        return array if self.instance.feasible(array) else None

    def _keep(self, order: Integers) -> None:
        cost = self.instance.cost(order)
        if cost < self.cost:
            self.cost = cost
            self.on_order(order)

    def _branch(
        self, subproblem: Subproblem, arcs: Booleans, values: Floats, duals: Duals
    ) -> Subproblem | None:
        relaxation = self.relaxation
        apart = np.abs(values - 0.5)
        candidates = np.nonzero(apart < 0.499)[0]
        if not len(candidates):
            return self._branch_integral(subproblem, arcs, values)
        tails, heads = relaxation.tails[candidates], relaxation.heads[candidates]
        fraction = values[candidates]
        score = self._score(tails, heads, fraction)
        ranked = np.argsort(-score, kind="stable")[:_CANDIDATES]
        best, chosen, bounds = -np.inf, int(ranked[0]), [subproblem.bound, subproblem.bound]
        unsure = 0
        basis = relaxation.basis()
        for k in ranked:
            i, j = int(tails[k]), int(heads[k])
            if min(self._trials[:, i, j]) < _RELIABLE and unsure < _CANDIDATES:
                unsure += 1
                tried = []
                for branch in (0, 1):
                    child = _restrict_child(arcs, i, j, branch)
                    bound = relaxation.trial(child, arcs, basis, duals)
                    gain = min(bound, self.cutoff) - subproblem.bound
                    step = fraction[k] if branch == 0 else 1 - fraction[k]
                    self._gains[branch, i, j] += max(0.0, gain) / step
                    self._trials[branch, i, j] += 1
                    tried.append(max(subproblem.bound, bound))
                value = max(tried[0] - subproblem.bound, 1e-6) * max(
                    tried[1] - subproblem.bound, 1e-6
                )
            else:
                tried = [subproblem.bound, subproblem.bound]
                value = float(score[k])
            if value > best:
                best, chosen, bounds = value, int(k), tried
        relaxation.set_basis(basis)
        return self._push_children(subproblem, arcs, int(tails[chosen]), int(heads[chosen]), bounds)

    def _branch_integral(
        self, subproblem: Subproblem, arcs: Booleans, values: Floats
    ) -> Subproblem | None:
        """Branch a subproblem of integral arcs without violated cut.

        If the arcs form an order, it is the cheapest of the subproblem except for rounding.
        """
        if self.stop():
            return subproblem
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
        return self._push_children(subproblem, arcs, i, j, [subproblem.bound, subproblem.bound])

    def _keep_only(self, arcs: Booleans) -> None:
        """Keep the order of a subproblem with at most one arc out of every node, if feasible."""
        order = [0]
        while len(order) < self.instance.n and arcs[order[-1]].any():
            order.append(int(np.argmax(arcs[order[-1]])))
        array = np.array(order)
        if self.instance.feasible(array):
            self._keep(array)

    def _push_children(
        self, subproblem: Subproblem, arcs: Booleans, i: int, j: int, bounds: list[float]
    ) -> Subproblem | None:
        """Create the children of a branching; return the next one and queue the other."""
        children = []
        for branch in (0, 1):
            if bounds[branch] < self.cutoff:
                self._made += 1
                child = _restrict_child(arcs, i, j, branch)
                children.append(
                    Subproblem.of(bounds[branch], self._made, child, subproblem.depth + 1)
                )
        if not children:
            return None
        # Depth first into the child with the fixed arc.
        following = children.pop()
        for other in children:
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
        mean = [
            self._gains[branch].sum() / max(1.0, self._trials[branch].sum()) or 1.0
            for branch in (0, 1)
        ]
        down = np.where(trials[0] > 0, gains[0] / np.maximum(trials[0], 1), mean[0]) * fraction
        up = np.where(trials[1] > 0, gains[1] / np.maximum(trials[1], 1), mean[1]) * (1 - fraction)
        lowest = 1e-6
        score: Floats = np.maximum(down, lowest) * np.maximum(up, lowest)
        return score


def _restrict_child(arcs: Booleans, i: int, j: int, branch: int) -> Booleans:
    """Return the arcs of the child that forbids an arc (0) or fixes it (1)."""
    child = arcs.copy()
    if branch == 0:
        child[i, j] = False
    else:
        child[i, :] = False
        child[:, j] = False
        child[i, j] = True
    return child


@dataclass(frozen=True)
class Seedling:
    """Data of the root node for the trees of other processes.

    Parameters
    ----------
    arcs
        Arcs that a better order may take, shape (n, n).
    leave, reach
        Cuts, shape (cuts, n) each.
    start
        Order whose arcs are initial columns, or None.
    gains, trials
        Pseudocosts, shape (2, n, n) each.
    """

    arcs: Booleans
    leave: Booleans
    reach: Booleans
    start: Integers | None
    gains: Floats
    trials: Floats

    @classmethod
    def of(cls, tree: BranchAndCut, start: Integers | None) -> Seedling:
        """Return the data of a tree; `start` is the best order, or None."""
        relaxation = tree.relaxation
        cuts = relaxation.leave, relaxation.reach
        return cls(relaxation.arcs, *cuts, start, *tree.pseudocosts)

    def grown(
        self, instance: OrderingInstance, cost: float, on_order: Callable[[Integers], None]
    ) -> BranchAndCut:
        """Return a tree without subproblems; `cost` is that of the best known order."""
        relaxation = CutRelaxation(instance, self.arcs, self.start)
        relaxation.add_cuts(self.leave, self.reach)
        tree = BranchAndCut(relaxation, cost, lambda: False, on_order, lambda bound, parts: None)
        tree.give_all()
        tree.learn(self.gains, self.trials)
        return tree


def tighten(
    relaxation: CutRelaxation,
    cutoff: float,
    stop: Callable[[], bool],
    on_bound: Callable[[Duals], None],
) -> Duals:
    """Add cuts until they gain nothing, the bound reaches the cutoff or `stop` returns True.

    Parameters
    ----------
    relaxation
        Relaxation, whose cuts and fixed arcs are changed in place.
    cutoff
        Cost at which orders are not of interest.
    """
    best: Duals | None = None
    stalled = 0
    while True:
        if not relaxation.settle(relaxation.arcs, stop):
            return Duals(np.inf, np.full_like(relaxation.instance.costs, np.inf))
        duals = relaxation.duals()
        if best is None or duals.bound > best.bound:
            gained = np.inf if best is None else duals.bound - best.bound
            is_enough = gained > _ENOUGH * max(1.0, abs(cutoff - duals.bound))
            stalled = 0 if is_enough else stalled + 1
            best = duals
            on_bound(duals)
        else:
            stalled += 1
        if duals.bound >= cutoff or stop() or stalled >= 8:
            return best
        relaxation.fix(duals, cutoff)
        relaxation.drop()
        if not relaxation.cut(100):
            return best
