"""Bidirectional Held-Karp: dynamic programming over feasible subsets from both ends, to proof.

The reduced cost of an order below the cutoff is less than the gap. So for every cut into two parts,
one part has little reduced cost. It is enough to know all cheap labels from either end, which are
far fewer than all labels of one direction. The budget of reduced cost is split such that both ends
have about equally many labels (after Dantzig, 1960, and Pohl, "Bi-directional search", 1971).
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
from skillplan.solvers.ordering.relaxation.cut_relaxation import Duals, build_charges
from skillplan.solvers.ordering.subsets.held_karp import (
    Ahead,
    Arcs,
    Layer,
    Limits,
    expand,
    make_first_layer,
    meet,
    pack_words,
)


@compiled
def build_memory_tables(
    tails: Integers, heads: Integers, near: Integers, before: Booleans
) -> tuple[Integers, Integers]:
    """Return the memory at an arc's tail by memory at its head, and the bits that bar the arc.

    Parameters
    ----------
    tails, heads
        The arcs, shape (m,).
    near
        Neighbours that a node remembers, padded with -1, shape (n, bits).
    before
        The closed relation, shape (n, n).

    Returns
    -------
    tuple
        Memory at the tail by arc and memory at the head, shape (m, 2 ** bits), and the bits at the
        head
        that must be clear, shape (m,).
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
        Arcs ordered by their heads, shape (m,).
    first
        First arc into each node, shape (n + 1,).
    moved, bars
        See `build_memory_tables`.
    slot
        Row of a position and a node, -1 if impossible, shape (n, n).
    memories
        2 ** bits.

    Returns
    -------
    ndarray
        Shape (rows, memories); inf without a walk.
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
    """Replace every entry by the least over the subsets of its memory, in place."""
    for row in range(len(value)):
        for b in range(bits):
            bit = 1 << b
            for memory in range(1 << bits):
                if memory & bit and value[row, memory ^ bit] < value[row, memory]:
                    value[row, memory] = value[row, memory ^ bit]


# Limit on the tables: some tenths of a second, and at most as many bytes.
_MOST_STEPS = 200_000_000


class CompletionBounds:
    """The cheapest walks to the end by position, node and remaining neighbours.

    Parameters
    ----------
    duals
        Reduced costs; inf for arcs that are fixed to zero.
    bits
        Greatest number of neighbours that a node remembers, >= 0; fewer for many arcs, to save time
        and
        memory.

    Attributes
    ----------
    near
        Neighbours of a node, padded with -1, shape (n, bits).
    slot
        Row of a position and a node, -1 if impossible, shape (n, n).
    ahead
        Least reduced cost to the end by row and set of remaining neighbours, shape (rows, 2 **
        bits).
    """

    def __init__(self, instance: OrderingInstance, duals: Duals, bits: int) -> None:
        n = instance.n
        arcs = int(np.isfinite(duals.reduced).sum())
        while bits and (arcs * n) << bits > _MOST_STEPS:
            bits -= 1
        self.near = _find_neighbours(duals.reduced, min(bits, n - 1))
        before = instance.before
        positions = np.arange(n)[:, None]
        possible = (positions >= before.sum(axis=0)) & (positions < n - before.sum(axis=1))
        self.slot: Integers = np.where(
            possible, np.cumsum(possible).reshape(possible.shape) - 1, -1
        )
        heads, tails = np.array(np.nonzero(np.isfinite(duals.reduced.T)))
        moved, bars = build_memory_tables(tails, heads, self.near, before)
        first = np.searchsorted(heads, np.arange(n + 1))
        costs = duals.reduced[tails, heads]
        self.ahead: Floats = backward(tails, costs, first, moved, bars, self.slot, moved.shape[1])
        spread(self.ahead, self.near.shape[1])


def _list_arcs(instance: OrderingInstance, duals: Duals) -> Arcs:
    """Return the arcs of finite reduced cost."""
    # Rows of an array are contiguous, columns of `nonzero` only for a single arc: kernels would be
    # compiled for both.
    tails, heads = np.array(np.nonzero(np.isfinite(duals.reduced)))
    return Arcs(
        np.searchsorted(tails, np.arange(instance.n + 1)),
        heads,
        instance.costs[tails, heads],
        duals.reduced[tails, heads],
        pack_words(instance.before),
    )


def _find_neighbours(reduced: Floats, bits: int) -> Integers:
    """Return the cheapest neighbours of every node, in both directions."""
    apart = reduced + reduced.T
    np.fill_diagonal(apart, np.inf)
    ranked = np.argsort(apart, axis=1, kind="stable")[:, :bits]
    near = np.where(np.isfinite(np.take_along_axis(apart, ranked, axis=1)), ranked, -1)
    return np.ascontiguousarray(near, dtype=np.int64)


R = TypeVar("R")

_EVERY_S = 0.01

Stop = Callable[[], bool]


class _Strand(Generic[R]):
    """A task in its own daemon thread."""

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


def run_in_parallel(tasks: Sequence[Callable[[Stop], R]], stop: Stop) -> list[R]:
    """Run tasks in threads; return their results in the order of the tasks.

    Parameters
    ----------
    tasks
        Functions that are called with a poll for stops.
    stop
        Polled in this thread alone, so it may do anything.

    Raises
    ------
    BaseException
        The exception of the first failed task.
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
        # If `stop` raises, the threads must end as well.
        stopped.set()
    for strand in strands:
        if strand.error is not None:
            raise strand.error
    return [strand.results[0] for strand in strands]


_BITS = 6
# Assumed exponent of the growth.
_POWER = 1.0
# The search does not start if it expects more than this multiple of the allowed labels.
_HOPELESS = 2
# It is tried up to this multiple of the allowed labels, and stops at twice as many.
_DARING = 1.5
# Assumed excess of an aborted search.
_MORE = 2
# Share of the allowed labels that is enough to extrapolate from.
_SAMPLE = 2


class _End:
    """The labels from one end whose reduced cost is within a budget.

    A triple is charged with its middle node, by either end. So one end is not strict: it ignores
    the
    charges of the last node. Then the longest kept label of an order uses up its budget with the
    next
    arc, and the rest of the order after that arc stays below the budget of the other end, all
    charges
    included.
    """

    def __init__(
        self, instance: OrderingInstance, duals: Duals, cutoff: float, *, strict: bool
    ) -> None:
        self.strict = strict
        self.instance = instance
        self.room = cutoff - duals.bound
        self.bounds = CompletionBounds(instance, duals, _BITS)
        self.arcs = _list_arcs(instance, duals)
        self.charges = build_charges(duals)
        start = make_first_layer(self.arcs.preds.shape[1])
        # If one end was not searched, the other has to search all layers.
        self.layers = [start]
        self.budget = 0.0
        self.count = 0
        self.known: list[tuple[float, int]] = []
        self.generated = 0
        # Budget that was too large, and its estimated number of labels.
        self.beyond: tuple[float, int] | None = None

    def expected(self, most: float) -> float:
        """Return the estimated number of labels of a budget, from the last two known counts.

        The count grows with a power of a small budget, later more slowly.
        """
        points = [*self.known[-2:], *([self.beyond] if self.beyond else [])]
        if len(points) < 2:
            return np.inf
        (before, few), (now, many) = points[-2:]
        power = _POWER
        # The count of a tiny budget does not predict the growth.
        if before > self.known[0][0]:
            power = np.log(max(many, 2) / max(few, 1)) / np.log(now / before)
        return float(many * (most / now) ** max(0.0, power))

    def sample(self, labels: int, stop: Stop) -> None:
        """Count the labels of small budgets, starting with a tiny one, to extrapolate."""
        most = self.room * 1e-6 if not self.known else max(2 * self.known[-1][0], self.room / 64)
        while not stop() and most < self.room and self.count < labels // _SAMPLE:
            if not self.extend(most, labels if self.known else labels // 4, stop):
                return
            most = max(2 * most, self.room / 64)

    def extend(self, most: float, labels: int, stop: Stop) -> bool:
        """Find all labels within a budget; return True if the search ended within its limits."""
        layers = self.layers[:1]
        left = labels
        for layer in range(1, self.instance.n):
            ahead = Ahead(self.bounds.near, self.bounds.slot[layer], self.bounds.ahead)
            limits = Limits(float(most), self.strict, self.room, max(1, left), True)
            extended, dropped, tried = expand(layers[-1], self.arcs, ahead, self.charges, limits)
            self.generated += tried
            left -= len(extended.lasts)
            if np.isfinite(dropped) or left <= 0:
                self.beyond = most, max(_MORE * labels, self.count + 1)
                return False
            if stop():
                return False
            if not len(extended.lasts):
                break
            # The bounds are not needed any more, so their memory is released.
            layers.append(extended._replace(bounds=extended.bounds[:0]))
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
        Cheapest order below the cutoff, or None.
    bound
        Lower bound on all orders, up to the cutoff.
    whole
        True if the search was complete.
    """

    order: Integers | None
    bound: float
    whole: bool


class TwoEndedSearch:
    """The bidirectional search; it resumes with more labels than before.

    Parameters
    ----------
    duals
        Bound and reduced costs; inf for arcs that no order below the cutoff takes.
    cutoff
        Upper bound on the cost of orders, exclusive.
    threads
        Number of threads, >= 1; with two, both ends are searched at once.
    """

    def __init__(
        self, instance: OrderingInstance, duals: Duals, cutoff: float, threads: int = 1
    ) -> None:
        self.instance = instance
        self.duals = duals
        self.cutoff = cutoff
        # Without a known order, an upper bound on all orders replaces the cutoff.
        self.most = min(cutoff, max(_bound_above(instance), duals.bound + 1.0))
        self.room = self.most - duals.bound
        self.threads = threads
        ahead = partial(_End, instance, duals, self.most, strict=False)
        behind = partial(_End, _mirror(instance), duals.mirrored(), self.most, strict=True)
        self.ends = self._each([lambda _: ahead(), lambda _: behind()], lambda: False)
        self.expected = np.inf

    @property
    def generated(self) -> int:
        """Number of generated labels."""
        return sum(end.generated for end in self.ends)

    def _each(self, tasks: Sequence[Callable[[Stop], R]], stop: Stop) -> list[R]:
        """Run tasks of both ends, in parallel if there are threads; return the results."""
        if self.threads > 1:
            return run_in_parallel(tasks, stop)
        return [task(stop) for task in tasks]

    def run(self, labels: int, stop: Stop) -> Meeting:
        """Search if either end is expected to have at most this number of labels."""
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
        """Find all labels within the budgets; return True if both ends did.

        In one thread the second end is skipped if the first was given up. In two threads both
        continue, so
        the result does not depend on their speed.
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
        joined = self._each([partial(self._meet_in, share) for share in shares], lambda: False)
        lowest, layer, first, second = min(joined)
        if first < 0:
            return Meeting(None, self._proved(self.cutoff, whole=whole), whole)
        start = _walk_back(ahead.layers, layer, first)[::-1]
        end = [n - 1 - node for node in _walk_back(behind.layers, n - 2 - layer, second)]
        return Meeting(np.array(start + end), self._proved(lowest, whole=whole), whole)

    def _meet_in(self, layers: Sequence[int], _stop: Stop) -> tuple[float, int, int, int]:
        """Join the ends in some layers: return the least cost, its layer and the two labels.

        The first layer with the least cost counts, so layers may be shared out in any way.
        """
        ahead, behind = self.ends
        best = (self.most, self.instance.n, -1, -1)
        for layer in layers:
            opposite = self.instance.n - 2 - layer
            # Any remaining label reaches the end itself.
            most = ahead.budget if opposite else -np.inf
            other = behind.layers[opposite]
            cost, first, second = meet(ahead.layers[layer], ahead.arcs, most, other, best[0])
            if first >= 0:
                best = (float(cost), layer, int(first), int(second))
        return best

    def _proved(self, lowest: float, *, whole: bool) -> float:
        """Return the bound that both budgets prove without a cheaper order."""
        budget = sum(end.budget for end in self.ends)
        return lowest if whole else min(lowest, self.duals.bound + budget)


def _bound_above(instance: OrderingInstance) -> float:
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
        Cheapest order, or None.
    bound
        Lower bound on all orders, up to the cutoff.
    whole
        True if the width excluded no label.
    """

    order: Integers | None
    bound: float
    whole: bool
    generated: int


def run_beam(
    instance: OrderingInstance, duals: Duals, cutoff: float, width: int, stop: Callable[[], bool]
) -> Beam | None:
    """Run a beam search; return None if it was stopped.

    Parameters
    ----------
    duals
        Bound and reduced costs; inf for arcs that no order below the cutoff takes.
    cutoff
        Upper bound on the cost of orders, exclusive.
    width
        Greatest number of labels in a layer, >= 1.
    stop
        Returns True to stop; polled once a layer.
    """
    n = instance.n
    bounds = CompletionBounds(instance, duals, _BEAM_BITS)
    room = cutoff - duals.bound
    arcs = _list_arcs(instance, duals)
    charges = build_charges(duals)
    limits = Limits(room, False, room, width, False)
    labels = make_first_layer(arcs.preds.shape[1])
    history = []
    lowest, generated = np.inf, 0
    for layer in range(1, n):
        ahead = Ahead(bounds.near, bounds.slot[layer], bounds.ahead)
        labels, dropped, tried = expand(labels, arcs, ahead, charges, limits)
        lowest = min(lowest, dropped)
        generated += tried
        if stop():
            return None
        if not len(labels.lasts):
            return Beam(None, min(cutoff, lowest + duals.bound), np.isinf(lowest), generated)
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
        min(cutoff, lowest + duals.bound, float(labels.costs.min())),
        np.isinf(lowest),
        generated,
    )
