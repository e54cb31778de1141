"""What is learned from: states of boards, and by how much each choice there is worse than best."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray

from skillplan.model.skill_model import SkillModel
from skillplan.solvers.relational.element_order import ElementOrder
from skillplan.solvers.relational.element_paths import ElementPaths
from skillplan.solvers.relational.element_view import (
    ELEMENT_FEATURES,
    PAIR_FEATURES,
    ElementView,
    Sight,
)

# Its table has 2 ** n * n entries.
MOST_ELEMENTS = 14


class CostToGo:
    """The least cost of what is left, in every order that respects the precedence.

    Parameters
    ----------
    view
        Of a board of at most `MOST_ELEMENTS` elements that leave no choices.

    Raises
    ------
    ValueError
        If there are more, or an order has to choose between precedences.
    """

    def __init__(self, view: ElementView) -> None:
        count = len(view.rest)
        if count > MOST_ELEMENTS or view.order.choices:
            raise ValueError(f"The teacher knows boards of at most {MOST_ELEMENTS} elements.")
        self._view = view
        powers = 1 << np.arange(count)
        self._before = (view.order.before * powers[:, None]).sum(axis=0)
        self._table = np.full((1 << count, count), np.inf)
        self._fill(count)

    def of_state(self, done: NDArray[np.bool_], sight: Sight) -> NDArray[np.float64]:
        """Return what is to pay if the next element is each of those seen, shape (n,).

        Parameters
        ----------
        done
            Which elements of the task are done.
        sight
            What is seen of the state.
        """
        mask = int(sum(1 << one for one in np.flatnonzero(done).tolist()))
        found = np.full(len(sight.elements), np.inf)
        for place, (one, way) in enumerate(zip(sight.elements.tolist(), sight.ways, strict=True)):
            if way is not None and not self._before[one] & ~mask:
                rest = self._view.rest[one]
                found[place] = way.cost + rest + self._table[mask | 1 << one, one]
        return found

    def _fill(self, count: int) -> None:
        sets = np.arange(1 << count)
        sizes = np.array([int(one).bit_count() for one in sets])
        self._table[-1] = 0.0
        for size in range(count - 1, 0, -1):
            here = sets[sizes == size]
            least = np.full((len(here), count), np.inf)
            for element in range(count):
                open_here = ((here >> element & 1) == 0) & ((self._before[element] & ~here) == 0)
                onward = self._table[here[open_here] | 1 << element, element]
                paid = self._view.costs[:, element] + self._view.rest[element]
                least[open_here] = np.minimum(least[open_here], onward[:, None] + paid[None])
            self._table[here] = least


# What a choice is worse by that leads nowhere, in shares of what is to pay at the start.
DEAD_END = 1.0

Choose = Callable[[Sight], int]


@dataclass(frozen=True)
class Board:
    """A board to learn on.

    Parameters
    ----------
    model, view, teacher
        The board, how it is seen, and what is still to pay there.
    least
        What the whole of it costs at least, > 0.
    """

    model: SkillModel
    view: ElementView
    teacher: CostToGo
    least: float

    @classmethod
    def of(cls, model: SkillModel) -> Board:
        """Return the board of a model.

        Raises
        ------
        OptionError
            If it has no elements that could be scored.
        ValueError
            If it is too large to be taught, or has no plan.
        """
        view = ElementView(ElementPaths(model.task), ElementOrder.of(model))
        teacher = CostToGo(view)
        least = float(teacher.of_state(view.done(model.initial), view(model.initial)).min())
        if not 0 < least < np.inf:
            raise ValueError(f"{model.task.name} has no plan to learn from.")
        return cls(model, view, teacher, least)

    def walk(
        self, choose: Choose, chance: np.random.Generator, slips: float
    ) -> list[tuple[Sight, NDArray[np.float64]]]:
        """Return what is seen on a way to the goal, and what each choice is worse by.

        Parameters
        ----------
        choose
            Which of the elements seen is gone for; where that is a dead end, the best is.
        chance
            Of slips.
        slips
            Share of choices made at random among those that are no dead ends.
        """
        found = []
        state = self.model.initial
        for _ in range(self.model.step_limit):
            if self.model.is_goal(state):
                break
            sight = self.view(state)
            regrets = self.regrets(self.view.done(state), sight)
            open_ones = np.flatnonzero(regrets < DEAD_END)
            if sum(way is not None for way in sight.ways) > 1:
                found.append((sight, regrets))
                place = choose(sight)
                if chance.random() < slips:
                    place = int(chance.choice(open_ones))
            else:
                place = int(open_ones[0])
            if regrets[place] >= DEAD_END:
                place = int(regrets.argmin())
            way = sight.ways[place]
            assert way is not None
            state = self.model.task.skill(way.first).prediction.apply(state)
        return found

    def regrets(self, done: NDArray[np.bool_], sight: Sight) -> NDArray[np.float64]:
        """Return by how much each choice is worse than the best, in shares of the whole."""
        to_pay = self.teacher.of_state(done, sight)
        regrets: NDArray[np.float64] = np.minimum((to_pay - to_pay.min()) / self.least, DEAD_END)
        return regrets


@dataclass
class Lessons:
    """States met so far, and by how much each choice there is worse than the best."""

    _sights: list[Sight] = field(default_factory=list)
    _regrets: list[NDArray[np.float64]] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self._sights)

    def __iter__(self) -> Iterator[tuple[Sight, NDArray[np.float64]]]:
        return iter(zip(self._sights, self._regrets, strict=True))

    def add(self, met: Sequence[tuple[Sight, NDArray[np.float64]]]) -> None:
        """Keep what was met."""
        for sight, regrets in met:
            self._sights.append(sight)
            self._regrets.append(regrets)

    def batch(self, places: NDArray[np.int64]) -> tuple[torch.Tensor, ...]:
        """Return features, pairs, who is present, who can be chosen, and regrets, padded."""
        count, most = len(places), max(len(self._regrets[one]) for one in places)
        features = np.zeros((count, most, len(ELEMENT_FEATURES)), dtype=np.float32)
        pairs = np.zeros((count, most, most, len(PAIR_FEATURES)), dtype=np.float32)
        present = np.zeros((count, most), dtype=np.bool_)
        usable = np.zeros((count, most), dtype=np.bool_)
        regrets = np.full((count, most), DEAD_END, dtype=np.float32)
        for row, place in enumerate(places):
            sight = self._sights[place]
            n = len(sight.elements)
            features[row, :n], pairs[row, :n, :n] = sight.features, sight.pairs
            present[row, :n] = True
            usable[row, :n] = [way is not None for way in sight.ways]
            regrets[row, :n] = self._regrets[place]
        arrays = (features, pairs, present, usable, regrets)
        return tuple(torch.from_numpy(one) for one in arrays)
