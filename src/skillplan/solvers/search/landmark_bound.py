"""Landmark heuristic: an admissible bound on the cost to go, from a task's symbols alone.

A *landmark* is a skill that every plan from a state must contain (Hoffmann, Porteous and Sebastia,
"Ordered landmarks in planning", 2004): the only achiever of a missing goal fact, and recursively
the only achievers of its preconditions. Each landmark costs at least its cost after the cheapest
possible direct predecessor. Back ends are not queried: lower bounds replace costs that they
compute.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from skillplan.model.skill_model import SkillModel
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task


class ArrivalBound:
    """The least end of a plan in which parts are still to be taken.

    A part that every plan takes arrives, is taken, and is put down. The bound is the latest such
    end over the parts that a state has not taken.
    """

    def __init__(self, model: SkillModel) -> None:
        self._ends = sorted(_list_least_ends(model), key=lambda end: -end[1])

    def __call__(self, state: State) -> float:
        """Return the least time from the begin of the plan to its end [s]; 0 without a bound."""
        bits = state.bits
        return next((end_s for bit, end_s in self._ends if bits & bit), 0.0)


def _list_least_ends(model: SkillModel) -> Iterator[tuple[int, float]]:
    """Yield the fact that a part has not been taken, and the least end of its way [s]."""
    task = model.task
    # Facts that no skill brings about: once taken, a part does not come back to its start.
    lasting = task.facts.all_bits
    for skill in task.skills:
        for outcome in skill.effects:
            lasting &= ~outcome.add.bits
    picks_of = dict[str, list[Skill]]()
    for skill in task.skills:
        if skill.supply is not None:
            picks_of.setdefault(skill.parameters["part"], []).append(skill)
    for name, picks in picks_of.items():
        bits = lasting if _is_needed(task, name) else 0
        for pick in picks:
            bits &= pick.precondition.requires.bits & pick.prediction.delete.bits
        if bits:
            # The plan chooses one of several tools, so only the soonest end is certain.
            yield bits & -bits, min(_find_least_end_s(model, pick) for pick in picks)


def _is_needed(task: Task, name: str) -> bool:
    """Return True if every plan takes a part, as no other one serves for its operation."""
    fact = task.operations.get(name)
    return fact in set(task.goal.requires) and all(
        skill.parameters.get("part") == name
        for skill in task.skills
        if any(fact in outcome.add for outcome in skill.effects)
    )


def _find_least_end_s(model: SkillModel, pick: Skill) -> float:
    """Return the least time at which a part that a skill takes is put down [s]."""
    held = pick.prediction.add.bits
    arrives_s = 0.0 if pick.supply is None else pick.supply.arrives_s
    next_s = min(
        (_find_least_s(model, s) for s in model.task.skills if s.precondition.requires.bits & held),
        default=0.0,
    )
    return arrives_s + _find_least_s(model, pick) + next_s


def _find_least_s(model: SkillModel, skill: Skill) -> float:
    needs = skill.precondition
    return model.least_duration_s(skill, needs.requires.bits, needs.forbids.bits)


# Costs are added as integers of this unit, independent of the order of summation.
COST_UNIT = 1e-15


def convert_to_units(cost: float) -> int:
    """Return a cost as an integer of units."""
    return round(cost / COST_UNIT)


def convert_from_units(units: int) -> float:
    """Return a cost from an integer of units."""
    return units / round(1 / COST_UNIT)


@dataclass(frozen=True, slots=True)
class _Outlook:
    """The landmarks ahead, by the facts that skills can require.

    Parameters
    ----------
    landmarks
        Indices of skills, each with its least cost after another skill [units].
    total
        Sum of those costs [units].
    """

    landmarks: dict[int, int]
    total: int


class LandmarkBound:
    """Lower bounds on cost and number of skills to go.

    Parameters
    ----------
    least
        Bounds the cost of a skill for bits of facts known true and false; None for the task's
        costs.
    """

    def __init__(self, task: Task, cost: Callable[[Skill, int, int], float] | None = None) -> None:
        self._task = task
        self._bounded = cost is not None
        self._least = _find_own_least if cost is None else cost
        self._all_bits = task.facts.all_bits
        self._requires = [skill.precondition.requires.bits for skill in task.skills]
        self._forbids = [skill.precondition.forbids.bits for skill in task.skills]
        self._adds = [_unite(o.add for o in skill.effects) for skill in task.skills]
        self._makers: dict[int, list[int]] = {}
        for i, added in enumerate(self._adds):
            for name in task.facts.names_of(added):
                self._makers.setdefault(task.facts.bit(name), []).append(i)
        self._rivals = self._exclusive_rivals()
        self._relevant = task.goal.requires.bits
        for requires in self._requires:
            self._relevant |= requires
        self._predecessors = self._direct_predecessors()
        self._outlooks: dict[int, _Outlook | None] = {}

    def __call__(self, state: State) -> tuple[int, int]:
        """Return lower bounds on the cost [units] and the number of skills to go from `state`.

        The cost is -1 if the goal is out of reach.
        """
        key = state.bits & self._relevant
        if key in self._outlooks:
            outlook = self._outlooks[key]
        else:
            if len(self._outlooks) * len(self._requires) > _MOST_KEPT:
                self._outlooks.clear()
            outlook = self._outlooks[key] = self._look(key)
        if outlook is None:
            return -1, 0
        bits, total = state.bits, outlook.total
        for i, landmark in outlook.landmarks.items():
            if self._ready(i, bits):
                from_here = convert_to_units(self.from_here(state, self._task.skills[i]))
                if from_here < landmark:
                    total += from_here - landmark
        return (total, len(outlook.landmarks)) if total < _NEVER else (-1, 0)

    def from_here(self, state: State, skill: Skill) -> float:
        """Return a lower bound on the cost of a skill in `state`: its cost, if known."""
        if self._bounded:
            return self._least(skill, state.bits, self._all_bits & ~state.bits)
        return skill.cost.at(state)

    def _ready(self, i: int, bits: int) -> bool:
        requires = self._requires[i]
        if bits & requires != requires or bits & self._forbids[i]:
            return False
        return self._task.skills[i].has_case(bits)

    def _look(self, bits: int) -> _Outlook | None:
        alive, reached = self._relaxed(bits)
        if self._task.goal.requires.bits & ~reached:
            return None
        landmarks = self._landmarks(bits, alive)
        costs = {}
        for k in landmarks:
            costs[k] = next((cost for cost, j in self._predecessors[k] if j in alive), _NEVER)
        return _Outlook(costs, sum(costs.values()))

    def _relaxed(self, bits: int) -> tuple[set[int], int]:
        """Return the skills and facts reachable under the delete relaxation."""
        alive: set[int] = set()
        waiting = list(range(len(self._requires)))
        while True:
            still = []
            before = bits
            for i in waiting:
                if self._requires[i] & ~bits:
                    still.append(i)
                else:
                    alive.add(i)
                    bits |= self._adds[i]
            if bits == before:
                return alive, bits
            waiting = still

    def _landmarks(self, bits: int, alive: set[int]) -> list[int]:
        landmarks: dict[int, None] = {}
        seen = bits
        todo = self._task.goal.requires.bits & ~bits
        while todo:
            fact = todo & -todo
            todo ^= fact
            seen |= fact
            makers = [i for i in self._makers.get(fact, ()) if i in alive]
            if len(makers) == 1:
                landmarks[makers[0]] = None
            needed = -1
            for i in makers:
                needed &= self._requires[i]
            if makers:
                todo |= needed & ~seen
        return list(landmarks)

    def _exclusive_rivals(self) -> dict[int, int]:
        rivals: dict[int, int] = {}
        for group in self._task.facts.exclusive:
            bits = self._task.facts.of(*group).bits
            for name in group:
                bit = self._task.facts.bit(name)
                rivals[bit] = rivals.get(bit, 0) | bits & ~bit
        return rivals

    def _known(self, true: int, false: int) -> tuple[int, int]:
        """Return the facts known true and false, with what exclusiveness adds."""
        rest = true
        while rest:
            bit = rest & -rest
            rest ^= bit
            false |= self._rivals.get(bit, 0)
        return true, false & ~true

    def _direct_predecessors(self) -> list[list[tuple[int, int]]]:
        """Possible direct predecessors of every skill, cheapest first."""
        after = []
        for skill, added in zip(self._task.skills, self._adds, strict=True):
            # Facts that hold afterwards in every state.
            delete, add = skill.prediction.delete.bits, skill.prediction.add.bits
            may_delete = _unite(outcome.delete for outcome in skill.effects)
            true = skill.precondition.requires.bits & ~may_delete | add
            false = skill.precondition.forbids.bits & ~added | delete
            after.append(self._known(true, false))
        predecessors: list[list[tuple[int, int]]] = []
        for k, skill in enumerate(self._task.skills):
            listed = []
            needs_true, needs_false = self._known(self._requires[k], self._forbids[k])
            for j, (true, false) in enumerate(after):
                if true & needs_false or false & needs_true:
                    continue
                cost = self._least(skill, true | needs_true, false | needs_false)
                if math.isfinite(cost):
                    listed.append((convert_to_units(cost), j))
            predecessors.append(sorted(listed))
        return predecessors


def _find_own_least(skill: Skill, true_bits: int, false_bits: int) -> float:
    return skill.cost.least(true_bits, false_bits)


def _unite(sets: Iterable[State]) -> int:
    bits = 0
    for facts in sets:
        bits |= facts.bits
    return bits


# Greatest number of entries of the table of landmarks, about 100 bytes each.
_MOST_KEPT = 5_000_000
# No skill can precede it: the cost from the present state replaces this, else a dead end.
_NEVER = 1 << 80
