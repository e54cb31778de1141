"""What a relational policy sees of a state: its elements, one by one and in pairs.

Everything is counted over elements or compared between them, never by their names or places in a
list, so that scores do not depend on the order of elements, and any number of them can be seen.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.relational.element_order import ElementOrder
from skillplan.solvers.relational.element_paths import ElementPaths, Way
from skillplan.task.state import State

Figures = NDArray[np.float32]

ELEMENT_FEATURES = (
    "its next skill is within reach of the tools",
    "by how much it costs more to come to than the cheapest",
    "something must come before it that is not done",
    "how many such there are",
    "skills come between, such as a tool change",
    "how many must come after it",
    "how many wait for it alone",
    "how many of the same tool are left",
    "how many of them can be done in a row from here",
    "share of them",
    "by how much the cheapest next one costs more than for others",
    "how many are left",
    "whether any can be done without skills between",
    "share of the attached tool's that can be done in a row",
)
PAIR_FEATURES = (
    "by how much the other costs more to come to than the cheapest after the one",
    "by how much the other costs more to come to from the one than from the best",
    "the same, the other way round: after the other",
    "the same, the other way round: from the other",
    "the one comes before the other",
    "the other comes before the one",
    "both need the same tool",
    "the other waits for the one alone",
    "they are the same",
)

# Differences beyond so many spreads are cut.
_MOST_SPREADS = 8.0


@dataclass(frozen=True)
class Sight:
    """A state as a relational network sees it; n elements are left to be done.

    Parameters
    ----------
    elements
        Their indices in the task.
    ways
        How each is come to; None where it cannot be begun here.
    features
        Of each, shape (n, len(ELEMENT_FEATURES)).
    pairs
        Of each pair, shape (n, n, len(PAIR_FEATURES)).
    """

    elements: NDArray[np.int64]
    ways: tuple[Way | None, ...]
    features: Figures
    pairs: Figures


class ElementView:
    """Sees the states of one task.

    Parameters
    ----------
    paths
        How elements are come to.
    order
        What must come before what.

    Attributes
    ----------
    costs
        Of coming from the one, done, to the other, with its first skill, shape (n, n); inf on the
        diagonal.
    rest
        Of the further skills of each, shape (n,).
    """

    def __init__(self, paths: ElementPaths, order: ElementOrder) -> None:
        self.paths, self.order = paths, order
        count, bits = len(paths.elements), paths.task.initial.bits
        firsts = [paths.first_skill(one, bits) for one in range(count)]
        self.costs = np.full((count, count), np.inf)
        self.rest = np.zeros(count)
        groups: dict[int, int] = {}
        self._groups = np.zeros(count, dtype=np.int64)
        for one, first in enumerate(firsts):
            if first is None:
                continue
            need = paths.needed_of(first)
            self._groups[one] = groups.setdefault(need, len(groups))
            self.rest[one], end = paths.finish(one, first, bits)
            for other, second in enumerate(firsts):
                way = None if second is None or other == one else paths.way(second, end)
                if way is not None:
                    self.costs[one, other] = way.cost
        self._same = self._groups[:, None] == self._groups[None]
        self._spread = _spread(self.costs, self._same)

    def done(self, state: State) -> NDArray[np.bool_]:
        """Return which elements are done in a state, shape (n,)."""
        return np.array([bool(state.bits & goal) for goal in self.paths.goals])

    def __call__(self, state: State) -> Sight:
        """Return what is seen of a state."""
        bits, paths = state.bits, self.paths
        done = self.done(state)
        left = np.flatnonzero(~done)
        ways: list[Way | None] = []
        waits = []
        for one in left.tolist():
            skill = paths.next_skill(one, bits)
            waits.append(skill is None)
            skill = skill or paths.first_skill(one, bits)
            ways.append(None if skill is None else paths.way(skill, bits))
        come = np.array([np.inf if way is None else way.cost for way in ways])
        between = np.array([0 if way is None else way.between for way in ways]) > 0
        mask = sum(1 << one for one in np.flatnonzero(done).tolist())
        before = self.order.after(mask)[np.ix_(left, left)]
        features = self._features(left, before, come, between)
        usable = tuple(None if wait else way for way, wait in zip(ways, waits, strict=True))
        features[:, 0] = [way is not None for way in usable]
        return Sight(left, usable, features, self._pairs(left, before))

    def _features(
        self,
        left: NDArray[np.int64],
        before: NDArray[np.bool_],
        come: NDArray[np.float64],
        between: NDArray[np.bool_],
    ) -> Figures:
        count = len(left)
        same = self._same[np.ix_(left, left)]
        waiting = before.sum(axis=0)
        alone = (before & (waiting[None] == 1)).sum(axis=1)
        in_row = self._in_a_row(before, same)
        group_left = same.sum(axis=1)
        share = in_row / np.maximum(group_left, 1)
        at_hand = ~between
        out = np.zeros((count, len(ELEMENT_FEATURES)), dtype=np.float32)
        free = waiting == 0
        least = come[free].min() if free.any() else come.min(initial=np.inf)
        out[:, 1] = self._spreads(come - (least if np.isfinite(least) else 0.0))
        out[:, 2] = ~free
        out[:, 3] = np.log1p(waiting)
        out[:, 4] = between
        out[:, 5] = np.log1p(before.sum(axis=1))
        out[:, 6] = np.log1p(alone)
        out[:, 7] = np.log1p(group_left)
        out[:, 8] = np.log1p(in_row)
        out[:, 9] = share
        onward = self.costs[np.ix_(left, left)].min(axis=1, initial=np.inf)
        finite = onward[np.isfinite(onward)]
        out[:, 10] = self._spreads(onward - (finite.min() if finite.size else 0.0))
        out[:, 11] = np.log1p(count)
        out[:, 12] = bool((at_hand & free).any())
        out[:, 13] = share[at_hand].max(initial=0.0)
        return out

    def _in_a_row(self, before: NDArray[np.bool_], same: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Return how many of the same tool can be done from here with nothing else between."""
        # What waits for one of another tool, however far back, cannot.
        blocked = np.asarray((before & ~same).any(axis=0))
        counted: NDArray[np.int64] = (same & ~blocked[None]).sum(axis=1)
        return counted

    def _pairs(self, left: NDArray[np.int64], before: NDArray[np.bool_]) -> Figures:
        grid = np.ix_(left, left)
        costs, same = self.costs[grid], self._same[grid]
        after = self._spreads(costs - _least(costs, 1))
        ahead = self._spreads(costs - _least(costs, 0))
        waiting = before.sum(axis=0)
        alone = before & (waiting[None] == 1)
        layers = (after, ahead, after.T, ahead.T, before, before.T, same, alone)
        out = np.zeros((len(left), len(left), len(PAIR_FEATURES)), dtype=np.float32)
        for index, layer in enumerate(layers):
            out[:, :, index] = layer
        out[:, :, len(layers)] = np.eye(len(left))
        return out

    def _spreads(self, differences: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.clip(differences / self._spread, -_MOST_SPREADS, _MOST_SPREADS)


def _least(costs: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    least = costs.min(axis=axis, keepdims=True, initial=np.inf)
    return np.where(np.isfinite(least), least, 0.0)


def _spread(costs: NDArray[np.float64], same: NDArray[np.bool_]) -> float:
    """Return by how much costs within a tool usually differ; of all where there are too few."""
    for among in (costs[same], costs.ravel()):
        finite = among[np.isfinite(among)]
        if finite.size > 2 and finite.std() > 0:
            return float(finite.std())
    return 1.0
