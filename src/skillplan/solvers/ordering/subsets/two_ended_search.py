"""Bidirectional Held-Karp: dynamic programming over feasible subsets from both ends, to proof.

The reduced cost of an order below the cutoff is less than the gap. So wherever it is cut, its
first or its last part has little reduced cost. It is enough to know all cheap labels from the
start and all cheap labels from the end, which are far fewer than all labels of one direction. The
budget of reduced cost is split so that both ends have about equally many labels (after Dantzig,
1960, and Pohl, "Bi-directional search", 1971).
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Generic, TypeVar

import numpy as np

from skillplan.solvers.kernels import compiled
from skillplan.solvers.ordering.instance import NO_ARC, Booleans, Floats, Integers, OrderingInstance
from skillplan.solvers.ordering.relaxation.cut_relaxation import Duals, charges_of
from skillplan.solvers.ordering.subsets.held_karp import (
    Ahead,
    Arcs,
    Layer,
    Limits,
    expand,
    first_layer,
    meet,
    words_of,
)


@compiled
def memory_tables(
    tails: Integers, heads: Integers, near: Integers, before: Booleans
) -> tuple[Integers, Integers]:
    """Return what the memory at the head of an arc becomes at its tail, and what bars the arc.

    Parameters
    ----------
    tails, heads
        The arcs, shape (m,).
    near
        The neighbours that a node remembers, -1 where there are fewer, shape (n, bits).
    before
        The closed relation, shape (n, n).

    Returns
    -------
    tuple
        Memory at the tail by arc and memory at the head, shape (m, 2 ** bits), and the bits at
        the head of which none may be set, shape (m,).
    """
    bits = near.shape[1]
    moved = np.zeros((len(tails), 1 << bits), dtype=np.int64)
    bars = np.zeros(len(tails), dtype=np.int64)
    single = np.zeros(bits, dtype=np.int64)
    for a in range(len(tails)):
        i, j = tails[a], heads[a]
        base = 0
        for b in range(bits):
            if near[i, b] == j:
                base = 1 << b
        for b in range(bits):
            single[b] = 0
            node = near[j, b]
            if node < 0:
                continue
            if node == i or before[node, i]:
                bars[a] |= 1 << b
            for c in range(bits):
                if near[i, c] == node:
                    single[b] = 1 << c
        moved[a, 0] = base
        for memory in range(1, 1 << bits):
            low = memory & -memory
            b = 0
            while low >> b != 1:
                b += 1
            moved[a, memory] = moved[a, memory ^ low] | single[b]
    return moved, bars


@compiled
def backward(
    tails: Integers,
    costs: Floats,
    first: Integers,
    moved: Integers,
    bars: Integers,
    slot: Integers,
    memories: int,
) -> Floats:
    """Return the least costs to the end by position, node and memory.

    Parameters
    ----------
    tails, costs
        The arcs ordered by their heads, shape (m,).
    first
        Where the arcs into a node begin, shape (n + 1,).
    moved, bars
        From `memory_tables`.
    slot
        Row of a position and a node, -1 where the node cannot be there, shape (n, n).
    memories
        2 ** bits.

    Returns
    -------
    ndarray
        Shape (rows, memories); inf where there is no walk.
    """
    n = len(slot)
    value = np.full((slot.max() + 1, memories), np.inf)
    value[slot[n - 1, n - 1], 0] = 0.0
    for position in range(n - 1, 0, -1):
        for j in range(n):
            here = slot[position, j]
            if here < 0:
                continue
            for a in range(first[j], first[j + 1]):
                there = slot[position - 1, tails[a]]
                if there < 0:
                    continue
                cost, bar = costs[a], bars[a]
                for memory in range(memories):
                    if memory & bar:
                        continue
                    total = value[here, memory] + cost
                    kept = moved[a, memory]
                    if total < value[there, kept]:
                        value[there, kept] = total
    return value


@compiled
def spread(value: Floats, bits: int) -> None:
    """Let every entry be the least over the memories that are part of its own, in place."""
    for row in range(len(value)):
        for b in range(bits):
            bit = 1 << b
            for memory in range(1 << bits):
                if memory & bit and value[row, memory ^ bit] < value[row, memory]:
                    value[row, memory] = value[row, memory ^ bit]


# Of computing the tables: some tenths of a second, and as many bytes at the very most.
_MOST_STEPS = 200_000_000


class CompletionBounds:
    """The cheapest walks to the end by position, node and the neighbours that are left to visit.

    Parameters
    ----------
    instance
        The ordering.
    duals
        Reduced costs; inf for arcs that are fixed to zero.
    bits
        How many neighbours a node remembers at most, >= 0; fewer where there are many arcs, to
        save time and memory.

    Attributes
    ----------
    near
        The neighbours of a node, -1 where there are fewer, shape (n, bits).
    slot
        Row of a position and a node, -1 where the node cannot stand there, shape (n, n).
    ahead
        Least reduced cost to the end by row and set of neighbours left, shape (rows, 2 ** bits).
    """

    def __init__(self, instance: OrderingInstance, duals: Duals, bits: int) -> None:
        n = instance.n
        arcs = int(np.isfinite(duals.reduced).sum())
        while bits and (arcs * n) << bits > _MOST_STEPS:
            bits -= 1
        self.near = _neighbours(duals.reduced, min(bits, n - 1))
        before = instance.before
        positions = np.arange(n)[:, None]
        possible = (positions >= before.sum(axis=0)) & (positions < n - before.sum(axis=1))
        self.slot: Integers = np.where(
            possible, np.cumsum(possible).reshape(possible.shape) - 1, -1
        )
        heads, tails = np.nonzero(np.isfinite(duals.reduced.T))
        moved, bars = memory_tables(tails, heads, self.near, before)
        first = np.searchsorted(heads, np.arange(n + 1))
        costs = duals.reduced[tails, heads]
        self.ahead: Floats = backward(tails, costs, first, moved, bars, self.slot, moved.shape[1])
        spread(self.ahead, self.near.shape[1])


def _neighbours(reduced: Floats, bits: int) -> Integers:
    """Return the nodes to and from which it is cheapest to go, of every node."""
    apart = reduced + reduced.T
    np.fill_diagonal(apart, np.inf)
    ranked = np.argsort(apart, axis=1, kind="stable")[:, :bits]
    near = np.where(np.isfinite(np.take_along_axis(apart, ranked, axis=1)), ranked, -1)
    return np.ascontiguousarray(near, dtype=np.int64)


R = TypeVar("R")

_EVERY_S = 0.01

Stop = Callable[[], bool]


class _Strand(Generic[R]):
    """A task in a thread of its own, which does not outlive the program."""

    def __init__(self, task: Callable[[Stop], R], stop: Stop) -> None:
        self._task, self._stop = task, stop
        self.results: list[R] = []
        self.error: BaseException | None = None
        self.thread = threading.Thread(target=self._run, daemon=True)
        self.thread.start()

    def _run(self) -> None:
        try:
            self.results.append(self._task(self._stop))
        except BaseException as error:
            self.error = error


def side_by_side(tasks: Sequence[Callable[[Stop], R]], stop: Stop) -> list[R]:
    """Do tasks at once, each in a thread; return their results in the order of the tasks.

    Parameters
    ----------
    tasks
        Each is called with what says whether to stop now.
    stop
        Polled in this thread alone, so that it may do anything.

    Raises
    ------
    BaseException
        What the first task that failed has raised.
    """
    if len(tasks) == 1:
        return [tasks[0](stop)]
    stopped = threading.Event()
    strands = [_Strand(task, stopped.is_set) for task in tasks]
    try:
        for strand in strands:
            while strand.thread.is_alive():
                strand.thread.join(_EVERY_S)
                if strand.thread.is_alive() and not stopped.is_set() and stop():
                    stopped.set()
    finally:
        # Whatever `stop` raises: no thread goes on with work that nobody waits for.
        stopped.set()
    for strand in strands:
        if strand.error is not None:
            raise strand.error
    return [strand.results[0] for strand in strands]


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
        True if the search ran to its end.
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


_BEAM_BITS = 8


@dataclass
class Beam:
    """The result of one pass.

    Parameters
    ----------
    order
        The cheapest order found, or None.
    bound
        No order costs less than this or the cutoff, whichever is less.
    whole
        True if no label was left out for the width.
    made
        Labels generated.
    """

    order: Integers | None
    bound: float
    whole: bool
    made: int


def beam(
    instance: OrderingInstance,
    duals: Duals,
    cutoff: float,
    width: int,
    stop: Callable[[], bool],
    on_layer: Callable[[int, int], None] = lambda layer, states: None,
) -> Beam | None:
    """Run a beam search; return None where it was stopped.

    Parameters
    ----------
    instance
        The ordering.
    duals
        A bound and reduced costs; inf where no order below the cutoff takes an arc.
    cutoff
        Only orders that cost less are searched for.
    width
        At most so many labels are kept in a layer, >= 1.
    stop
        True if to stop; polled once a layer.
    on_layer
        Called with the number of a layer and how many labels it has.
    """
    n = instance.n
    bounds = CompletionBounds(instance, duals, _BEAM_BITS)
    room = cutoff - duals.bound
    tails, heads = np.nonzero(np.isfinite(duals.reduced))
    arcs = Arcs(
        np.searchsorted(tails, np.arange(n + 1)),
        heads,
        instance.costs[tails, heads],
        duals.reduced[tails, heads],
        words_of(instance.before),
    )
    charges = charges_of(duals)
    limits = Limits(room, False, room, width, False)
    labels = first_layer(arcs.preds.shape[1])
    history = []
    least, made = np.inf, 0
    for layer in range(1, n):
        ahead = Ahead(bounds.near, bounds.slot[layer], bounds.ahead)
        labels, dropped, tried = expand(labels, arcs, ahead, charges, limits)
        least = min(least, dropped)
        made += tried
        on_layer(layer, len(labels.lasts))
        if stop():
            return None
        if not len(labels.lasts):
            return Beam(None, min(cutoff, least + duals.bound), np.isinf(least), made)
        history.append((labels.lasts, labels.parents))
    at = int(np.argmin(labels.costs))
    order = [n - 1]
    for lasts, parents in reversed(history):
        at_last = int(lasts[at])
        if at_last != n - 1:
            order.append(at_last)
        at = int(parents[at])
    order.append(0)
    return Beam(
        np.array(order[::-1], dtype=np.int64),
        min(cutoff, least + duals.bound, float(labels.costs.min())),
        np.isinf(least),
        made,
    )
