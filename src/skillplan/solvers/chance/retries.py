"""Tasks in which failed skills are tried again at once, and the states that policies reach.

A failure that only changes facts that the skill sets anyway, such as the arm's place, leaves the
skill applicable, and its success leads to the same state. So a skill that succeeds with probability
q is tried 1/q times on average.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

from skillplan.model.skill_model import SkillModel
from skillplan.solvers.stop import Stop
from skillplan.task.cost import Cost, DerivedCost
from skillplan.task.skill import Outcome, Skill
from skillplan.task.state import Facts, State
from skillplan.task.task import Task

# Relative difference of sums of costs.
_ROUNDING = 1e-12


@dataclass(frozen=True, slots=True)
class RetryCost(DerivedCost):
    """The expected cost of a skill that is tried until it succeeds.

    With probabilities p_j of ending in state f_j and q of succeeding, the first try costs c(s), and
    all
    later ones together the sum of p_j c(f_j), divided by q.
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
    """A cost increased by a constant.

    Parameters
    ----------
    extra
        Constant, >= 0.
    """

    cost: Cost
    extra: float

    def at(self, state: State) -> float:
        """Return the cost in `state`."""
        return self.cost.at(state) + self.extra

    def least(self, true_bits: int, false_bits: int) -> float:
        """Return a lower bound over the states with these facts known true and false."""
        return self.cost.least(true_bits, false_bits) + self.extra


def refuse_retries(task: Task) -> str | None:
    """Return the reason why a failed skill of a task cannot be tried again, or None.

    It can be tried again if no skill and no goal depends on the facts that a failure changes, and
    every
    skill sets them anew. The next success then removes all traces of the failure.
    """
    changed = collect_touched(task)
    if changed & (task.goal.requires.bits | task.goal.forbids.bits):
        return "a failure changes what the goal asks for"
    for skill in task.skills:
        needed = skill.precondition.requires.bits | skill.precondition.forbids.bits
        if skill.cases and not skill.deterministic:
            return f"the outcomes of {skill.name} depend on the state"
        needed |= sum(case.fact.bits | case.forbids.bits for case in skill.cases)
        if changed & needed:
            fact = task.facts.names_of(changed & needed)[0]
            return f"a failure changes {fact}, which {skill.name} asks for"
        for outcome in skill.effects:
            left = changed & ~(outcome.add.bits | outcome.delete.bits)
            if left:
                fact = task.facts.names_of(left)[0]
                return f"a failure changes {fact}, which {skill.name} leaves as it is"
    return None


def collect_touched(task: Task) -> int:
    """Return the bits of the facts that failures of a task may change."""
    bits = 0
    for skill in task.skills:
        for failure in list_failures(skill):
            bits |= failure.add.bits | failure.delete.bits
    return bits


def list_failures(skill: Skill) -> tuple[Outcome, ...]:
    """Return the outcomes of a skill that are not the nominal one."""
    return skill.outcomes[1:]


def assume_retries(task: Task) -> Task:
    """Return a task with certain skills at the average cost of all their tries."""
    costs: dict[str, Cost] = {}
    for skill in task.skills:
        lost = list_failures(skill)
        if lost:
            costs[skill.name] = RetryCost(
                skill.cost, lost, skill.precondition.requires.bits, task.facts
            )
    return _make_certain(task, costs)


def relax(task: Task) -> Task | None:
    """Return a task with certain skills that costs no more than any policy.

    A skill that fails with probability p and succeeds with q gets p/q times its least detour added:
    the
    least extra cost of a failed try over having gone on at once. Let L be the least cost to go with
    these costs. It differs between the state s of a try and the state f after its failure by at
    most
    the cost of the next skill. So L(s) <= cost + q L(success) + p L(f): L is a lower bound on the
    cost
    of every policy that is certain to arrive.

    Returns
    -------
    Task or None
        None if a failure may save cost, or its cost is unknown: then there is no bound.
    """
    costs: dict[str, Cost] = {}
    detours = _Detours(task)
    for skill in task.skills:
        lost = list_failures(skill)
        least_detours = [detours.least(skill, failure) for failure in lost]
        if any(detour < -_ROUNDING for detour in least_detours):
            return None
        extra = math.fsum(
            failure.probability * max(0.0, detour)
            for failure, detour in zip(lost, least_detours, strict=True)
            if math.isfinite(detour)
        )
        if extra:
            success = 1.0 - math.fsum(failure.probability for failure in lost)
            costs[skill.name] = RaisedCost(skill.cost, extra / success)
    return _make_certain(task, costs)


class _Detours:
    """Least extra costs of a failed try over going on at once."""

    def __init__(self, task: Task) -> None:
        self._task = task
        self._changed = collect_touched(task)
        self._groups = [task.facts.of(*group).bits for group in task.facts.exclusive]
        self._before = self._left()

    def least(self, skill: Skill, failure: Outcome) -> float:
        """Return the least of cost(s, skill) + cost(f, next) - cost(s, next), over s and next.

        Minus infinity if the known facts do not determine a cost.

        Parameters
        ----------
        skill, failure
            Skill in state s, and outcome that leads to f.
        """
        lowest = math.inf
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
                lowest = min(lowest, detour)
        return lowest

    def _together(self, skill: Skill, other: Skill) -> bool:
        """Return True if two skills may be applicable in one state."""
        first, two = skill.precondition, other.precondition
        if first.requires.bits & two.forbids.bits or two.requires.bits & first.forbids.bits:
            return False
        both = first.requires.bits | two.requires.bits
        return all((both & group).bit_count() <= 1 for group in self._groups)

    def _left(self) -> dict[int, int]:
        """Return the touched facts that may hold after a skill, with the facts it has ended.

        For skills with equal facts, the common ended facts.
        """
        changed, start = self._changed, self._task.initial.bits
        left = {start & changed: self._task.facts.all_bits & ~start & ~changed}
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
                left[held] = left[held] & ended if held in left else ended
        return left


def _make_certain(task: Task, costs: Mapping[str, Cost]) -> Task:
    """Return a task with certain skills, some at other costs."""
    skills = []
    for skill in task.skills:
        nominal = tuple(replace(outcome, probability=1.0) for outcome in skill.outcomes[:1])
        cost = costs.get(skill.name, skill.cost)
        skills.append(replace(skill, outcomes=nominal, cost=cost))
    return replace(task, skills=tuple(skills))


def query_everywhere(
    model: SkillModel, policy: Mapping[State, Skill], most: int, stop: Stop
) -> bool:
    """Query a policy in its reachable states; return True if all were visited."""
    todo, seen = [model.initial], {model.initial}
    while todo:
        if stop() or len(policy) >= most:
            return False
        state = todo.pop()
        skill = None if model.is_goal(state) else policy.get(state)
        for outcome in () if skill is None else skill.outcomes_in(state):
            following = outcome.apply(state)
            if following not in seen:
                seen.add(following)
                todo.append(following)
    return True
