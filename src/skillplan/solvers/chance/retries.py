"""What is left of chance where every skill that fails is tried again at once.

A failure that changes nothing but what the skill sets anyway, such as where the arm stands, leaves
the skill as it was: it can be tried again, and its success leads to the same state. So a skill
that succeeds with probability q is tried 1/q times on average, whatever came before.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from skillplan.task.cost import Cost, DerivedCost
from skillplan.task.skill import Outcome, Skill
from skillplan.task.state import Facts, State
from skillplan.task.task import Task

# By so much sums of costs may differ.
_ROUNDING = 1e-12


@dataclass(frozen=True, slots=True)
class RetryCost(DerivedCost):
    """The expected cost of a skill that is tried until it succeeds.

    With probabilities p_j of ending in state f_j and q of succeeding the first try costs c(s),
    and all that follow together the sum of p_j c(f_j), divided by q.

    Parameters
    ----------
    cost
        Of one try, by the state it is made from.
    failures
        The outcomes that are no success.
    requires
        Bits of the facts that hold wherever the skill is tried.
    facts
        The vocabulary.
    """

    cost: Cost
    failures: tuple[Outcome, ...]
    requires: int
    facts: Facts

    def at(self, state: State) -> float:
        """Return the expected cost from `state`, all tries together."""
        again = math.fsum(
            failure.probability * self.cost.at(failure.apply(state)) for failure in self.failures
        )
        return self.cost.at(state) + again / self._success

    def least(self, true_bits: int, false_bits: int) -> float:
        """Return a lower bound over the states with these facts known true and false."""
        again = math.fsum(
            failure.probability
            * self.cost.least(
                (true_bits | self.requires) & ~failure.delete.bits | failure.add.bits,
                false_bits & ~failure.add.bits | failure.delete.bits,
            )
            for failure in self.failures
        )
        return self.cost.least(true_bits, false_bits) + again / self._success

    @property
    def _success(self) -> float:
        return 1.0 - math.fsum(failure.probability for failure in self.failures)


@dataclass(frozen=True, slots=True)
class RaisedCost(DerivedCost):
    """A cost with something added to it in every state.

    Parameters
    ----------
    cost
        Of the skill.
    extra
        Is added, >= 0.
    """

    cost: Cost
    extra: float

    def at(self, state: State) -> float:
        """Return the cost in `state`."""
        return self.cost.at(state) + self.extra

    def least(self, true_bits: int, false_bits: int) -> float:
        """Return a lower bound over the states with these facts known true and false."""
        return self.cost.least(true_bits, false_bits) + self.extra


def why_not_retried(task: Task) -> str | None:
    """Return why a failed skill of a task cannot simply be tried again; None where all can.

    It can where what a failure changes is nothing that any skill or the goal asks for, and is set
    by every skill anew. What a failure leaves is then forgotten with the next success.
    """
    changed = touched(task)
    if changed & (task.goal.requires.bits | task.goal.forbids.bits):
        return "a failure changes what the goal asks for"
    for skill in task.skills:
        asked = skill.precondition.requires.bits | skill.precondition.forbids.bits
        if skill.cases and not skill.deterministic:
            return f"the outcomes of {skill.name} depend on the state"
        asked |= sum(case.fact.bits | case.forbids.bits for case in skill.cases)
        if changed & asked:
            fact = task.facts.names_of(changed & asked)[0]
            return f"a failure changes {fact}, which {skill.name} asks for"
        for outcome in skill.effects:
            left = changed & ~(outcome.add.bits | outcome.delete.bits)
            if left:
                fact = task.facts.names_of(left)[0]
                return f"a failure changes {fact}, which {skill.name} leaves as it is"
    return None


def touched(task: Task) -> int:
    """Return the bits of the facts that failures of a task may change."""
    bits = 0
    for skill in task.skills:
        for failure in failures(skill):
            bits |= failure.add.bits | failure.delete.bits
    return bits


def failures(skill: Skill) -> tuple[Outcome, ...]:
    """Return the outcomes of a skill that are not the nominal one."""
    return skill.outcomes[1:]


def retried(task: Task) -> Task:
    """Return a task in which every skill succeeds, at what all its tries cost on average."""
    costs: dict[str, Cost] = {}
    for skill in task.skills:
        lost = failures(skill)
        if lost:
            costs[skill.name] = RetryCost(
                skill.cost, lost, skill.precondition.requires.bits, task.facts
            )
    return _certain(task, costs)


def relaxed(task: Task) -> Task | None:
    """Return a task in which every skill succeeds, and costs no more than any policy has to pay.

    A skill that fails with probability p, and succeeds with q, costs more by p/q times its least
    detour: what a failed try costs at least more than having gone on at once. With these costs let
    L be the least cost to go. It differs between the state s of a try and the state f in which it
    fails by no more than the cost of the next skill does. So L(s) <= cost + q L(success) +
    p L(f): L bounds from below what every policy costs that is certain to arrive.

    Parameters
    ----------
    task
        One of which `why_not_retried` says nothing.

    Returns
    -------
    Task or None
        None where a failure may save something, or what it costs cannot be told: then this
        proves no bound.
    """
    costs: dict[str, Cost] = {}
    detours = _Detours(task)
    for skill in task.skills:
        lost = failures(skill)
        least = [detours.least(skill, failure) for failure in lost]
        if any(one < -_ROUNDING for one in least):
            return None
        extra = math.fsum(
            failure.probability * max(0.0, one)
            for failure, one in zip(lost, least, strict=True)
            if math.isfinite(one)
        )
        if extra:
            success = 1.0 - math.fsum(failure.probability for failure in lost)
            costs[skill.name] = RaisedCost(skill.cost, extra / success)
    return _certain(task, costs)


class _Detours:
    """How much a failed try costs at least more than going on at once.

    Parameters
    ----------
    task
        One of which `why_not_retried` says nothing.
    """

    def __init__(self, task: Task) -> None:
        self._task = task
        self._changed = touched(task)
        self._groups = [task.facts.of(*group).bits for group in task.facts.exclusive]
        self._before = self._left()

    def least(self, skill: Skill, failure: Outcome) -> float:
        """Return the least of cost(s, skill) + cost(f, next) - cost(s, next), over s and next.

        Minus infinity where the facts that both ask for do not say what one costs.

        Parameters
        ----------
        skill, failure
            What is tried, and how it fails, from s in f.
        """
        least = math.inf
        facts, requires = self._task.facts, skill.precondition.requires.bits
        followers = [other for other in self._task.skills if self._together(skill, other)]
        for held, ended in self._before.items():
            if ended & requires:
                continue
            for other in followers:
                needs = other.precondition.requires.bits
                if ended & needs:
                    continue
                here = facts.state((requires | needs) & ~self._changed | held)
                there = failure.apply(here)
                try:
                    detour = skill.cost.at(here) + other.cost.at(there) - other.cost.at(here)
                except ValueError:
                    return -math.inf
                least = min(least, detour)
        return least

    def _together(self, skill: Skill, other: Skill) -> bool:
        """Return True if two skills may be applicable in one state."""
        one, two = skill.precondition, other.precondition
        if one.requires.bits & two.forbids.bits or two.requires.bits & one.forbids.bits:
            return False
        both = one.requires.bits | two.requires.bits
        return all((both & group).bit_count() <= 1 for group in self._groups)

    def _left(self) -> dict[int, int]:
        """Return what of `touched` may hold after a skill, with what has been ended then.

        Of several skills that leave the same facts, what all of them have ended.
        """
        changed, start = self._changed, self._task.initial.bits
        found = {start & changed: self._task.facts.all_bits & ~start & ~changed}
        for skill in self._task.skills:
            requires = skill.precondition.requires.bits
            for outcome in skill.effects:
                add, delete = outcome.add.bits, outcome.delete.bits
                holds = requires & ~delete | add
                ended = delete
                for group in self._groups:
                    if holds & group:
                        ended |= group
                held, ended = add & changed, ended & ~holds & ~changed
                found[held] = found[held] & ended if held in found else ended
        return found


def _certain(task: Task, costs: Mapping[str, Cost]) -> Task:
    """Return a task whose skills always succeed, some at other costs."""
    skills = []
    for skill in task.skills:
        nominal = tuple(replace(outcome, probability=1.0) for outcome in skill.outcomes[:1])
        cost = costs.get(skill.name, skill.cost)
        skills.append(replace(skill, outcomes=nominal, cost=cost))
    return replace(task, skills=tuple(skills))
