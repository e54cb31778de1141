"""What a skill needs of the order where that is no partial order: this, or that.

A drawer that goes in from two sides has to be placed before the one stop or before the other: an
AND/OR precedence constraint (De Fazio and Whitney, "Simplified generation of all mechanical
assembly sequences", 1987; Mohring, Skutella and Stork, 2004). It is read from verdicts: each holds
wherever the components that it names are as they are, so that a search over those covers all
orders.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations

from skillplan.chart.partial_order import ClosedRelation
from skillplan.chart.precedence_query import CheckSteps, PrecedenceQuery, Undecided

# So many states are considered for one skill before its alternatives are left unsaid.
_MOST_STATES = 256
# More conditions than this nobody reads.
_MOST_CONDITIONS = 64

Condition = frozenset[tuple[str, bool]]
"""Components, each with whether it is done."""


@dataclass(frozen=True, slots=True)
class Alternatives:
    """Pairs of which at least one group has to hold.

    Parameters
    ----------
    component
        The component that is ordered.
    skill
        Its skill that needs it.
    any_of
        At least two groups of pairs: the first before the second.
    """

    component: str
    skill: str
    any_of: tuple[tuple[tuple[str, str], ...], ...]

    def __str__(self) -> str:
        groups = (
            " and ".join(f"{one} before {other}" for one, other in pairs) for pairs in self.any_of
        )
        return ", or ".join(groups)


def alternatives(
    query: PrecedenceQuery, derived: ClosedRelation
) -> CheckSteps[Alternatives | None]:
    """Return between what an order may choose for a skill, or None where it has no choice.

    Parameters
    ----------
    query
        About the skill.
    derived
        What holds in every order, closed by transitivity.
    """
    search = _Search(query, derived)
    try:
        yield from search.explore(frozenset(), frozenset())
    except Undecided:
        return None
    found = simplest(search.conditions)
    common = frozenset.intersection(*found) if found else frozenset()
    choices = sorted((sorted(one - common) for one in found), key=lambda one: (len(one), one))
    if len(choices) < 2 or not all(choices) or len(choices) > _MOST_CONDITIONS:
        return None
    component = query.component
    groups = (
        tuple((other, component) if done else (component, other) for other, done in one)
        for one in choices
    )
    return Alternatives(component, query.skill.name, tuple(groups))


class _Search:
    """Covers the sets of components that an order may have done when a skill is begun."""

    def __init__(self, query: PrecedenceQuery, derived: ClosedRelation) -> None:
        self.query = query
        self.derived = derived
        self.conditions: list[Condition] = []
        self._before = derived.before(query.component)
        self._never = derived.after(query.component) | {query.component}
        self._left = _MOST_STATES

    def explore(self, done: frozenset[str], undone: frozenset[str]) -> CheckSteps[None]:
        """Note when the skill is feasible with some done and others not.

        The verdict where no more is done than must be holds for all sets that agree on what it
        names; the others differ in a first of those.
        """
        here = self._closed(done)
        if here & (undone | self._never):
            return
        self._left -= 1
        if self._left < 0:
            raise Undecided
        verdict = yield from self.query.check(here)
        named = self.query.hypothetical.components(verdict) - self._never
        if verdict.is_feasible:
            self.conditions.append(frozenset((one, one in here) for one in named))
        passed = undone
        for other in self.query.order:
            if other in named and other not in here and other not in undone:
                yield from self.explore(here | {other}, passed)
                passed |= {other}

    def _closed(self, done: frozenset[str]) -> frozenset[str]:
        """Return what is done where some are: all that must come before them or the component."""
        return frozenset(self._before | done).union(*(self.derived.before(one) for one in done))


def simplest(conditions: Iterable[Condition]) -> tuple[Condition, ...]:
    """Return the weakest conditions of which one holds wherever one of some holds.

    By consensus and absorption (Quine 1955): of two that contradict each other in one component
    the rest of both together is one, too.
    """
    found = _weakest(conditions)
    while True:
        more = {
            made
            for one, other in combinations(found, 2)
            if (made := _consensus(dict(one), dict(other))) is not None
            if not any(weaker <= made for weaker in found)
        }
        if not more or len(found) > _MOST_STATES:
            return tuple(found)
        found = _weakest([*found, *more])


def _weakest(conditions: Iterable[Condition]) -> list[Condition]:
    unique = list(dict.fromkeys(conditions))
    return [one for one in unique if not any(other < one for other in unique)]


def _consensus(one: Mapping[str, bool], other: Mapping[str, bool]) -> Condition | None:
    opposed = [name for name in one if other.get(name, one[name]) != one[name]]
    if len(opposed) != 1:
        return None
    both = {**one, **other}
    del both[opposed[0]]
    return frozenset(both.items())
