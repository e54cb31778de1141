"""Which element of a product has to come before which: what a relational policy is told.

It is what ``skillplan chart`` derives by the task's own back ends, once a task, before the first
step: the precedence relation, closed by transitivity, and choices where an order has to have one
thing or another.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan.chart.partial_order import closure
from skillplan.chart.precedence_chart import DerivedChart, derive_chart
from skillplan.model.skill_model import SkillModel


@dataclass(frozen=True)
class ElementOrder:
    """Precedence of the n elements of a task.

    Parameters
    ----------
    before
        Whether the one comes before the other in every order, shape (n, n); closed.
    choices
        By element what an order chooses from: pairs of bits over elements, of those that must be
        done when it is, and of those that must not.
    """

    before: NDArray[np.bool_]
    choices: tuple[tuple[int, tuple[tuple[int, int], ...]], ...] = ()

    @classmethod
    def of(cls, model: SkillModel) -> ElementOrder:
        """Return what the back ends of a model say.

        Raises
        ------
        BackEndError
            If a back end fails.
        """
        return cls.from_chart(tuple(model.task.operations), derive_chart(model.feasibility))

    @classmethod
    def from_chart(cls, elements: Sequence[str], chart: DerivedChart) -> ElementOrder:
        """Return what a derived chart says of elements in an order."""
        index = {name: i for i, name in enumerate(elements)}
        before = np.zeros((len(elements), len(elements)), dtype=np.bool_)
        for one, other in closure((r.before, r.after) for r in chart.relations):
            before[index[one], index[other]] = True
        choices = []
        for choice in chart.alternatives:
            own = index[choice.component]
            groups = []
            for pairs in choice.any_of:
                done = sum(1 << index[a] for a, b in pairs if index[b] == own)
                undone = sum(1 << index[b] for a, b in pairs if index[a] == own)
                groups.append((done, undone))
            choices.append((own, tuple(groups)))
        return cls(before, tuple(choices))

    def after(self, done: int) -> NDArray[np.bool_]:
        """Return what comes before what once some are done, shape (n, n).

        That is what holds in every order, and of a choice what all that is still possible have in
        common. Where something has to be done for each of them, so much is added of the one that
        takes least.

        Parameters
        ----------
        done
            Bits of the elements that are done.
        """
        if not self.choices:
            return self.before
        found = self.before.copy()
        for own, groups in self.choices:
            possible = [(must & ~done, never) for must, never in groups if not done & never]
            if done >> own & 1 or not possible:
                continue
            needed, barred = possible[0]
            for must, never in possible[1:]:
                needed, barred = needed & must, barred & never
            if not needed and all(must for must, _ in possible):
                needed = min((must for must, _ in possible), key=int.bit_count)
            found[list(each_index(needed)), own] = True
            found[own, list(each_index(barred))] = True
        return found


def each_index(bits: int) -> Iterator[int]:
    """Yield the index of every bit that is set, in ascending order."""
    while bits:
        low = bits & -bits
        yield low.bit_length() - 1
        bits ^= low
