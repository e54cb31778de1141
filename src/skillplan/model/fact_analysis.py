"""Analysis of facts: skills that change them, and costs that depend on them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import reduce
from operator import or_

from skillplan.task.cost import (
    CaseCost,
    ConstantCost,
    Cost,
    DerivedCost,
    DistanceCost,
    TableCost,
    WeightedCost,
)
from skillplan.task.skill import Skill
from skillplan.task.task import Task


def iterate_bits(bits: int) -> Iterator[int]:
    """Yield the bits of an integer, the lowest first."""
    while bits:
        low = bits & -bits
        yield low
        bits ^= low


def effects(skill: Skill) -> int:
    """Return the bits of the facts that the nominal outcome of a skill adds or deletes."""
    return skill.prediction.add.bits | skill.prediction.delete.bits


def find_live_skills(task: Task) -> tuple[Skill, ...]:
    """Return the skills that may become applicable.

    The others never become applicable: in the delete relaxation, where facts stay true, a required
    fact is unreachable, or a forbidden fact holds from the start and no skill deletes it.
    """
    live: Sequence[Skill] = task.skills
    while True:
        deleted = reduce(or_, (skill.prediction.delete.bits for skill in live), 0)
        lasting = task.initial.bits & ~deleted
        reached = task.initial.bits
        waiting = [skill for skill in live if not skill.precondition.forbids.bits & lasting]
        reachable: set[str] = set()
        while True:
            ready: list[Skill] = []
            left: list[Skill] = []
            for skill in waiting:
                (left if skill.precondition.requires.bits & ~reached else ready).append(skill)
            if not ready:
                break
            reachable |= {skill.name for skill in ready}
            reached = reduce(or_, (skill.prediction.add.bits for skill in ready), reached)
            waiting = left
        if len(reachable) == len(live):
            return tuple(live)
        live = [skill for skill in live if skill.name in reachable]


def map_exclusive_bits(task: Task) -> dict[int, int]:
    """Return the bits of the facts that each fact excludes, by the number of its bit."""
    exclusive: dict[int, int] = {}
    for group in task.facts.exclusive:
        bits = [task.facts.bit(fact) for fact in group]
        together = reduce(or_, bits, 0)
        for bit in bits:
            # Powers of two hash badly, see `State.__hash__`.
            number = bit.bit_length()
            exclusive[number] = exclusive.get(number, 0) | together & ~bit
    return exclusive


def map_named_bits(task: Task) -> dict[str, int]:
    """Return the bits of the facts named after each component, without places of arms."""
    stands = {fact for robot in task.scene.robots for fact in robot.places}
    named = {component: task.facts.bit(fact) for component, fact in task.operations.items()}
    for fact in task.facts.names:
        component = fact.rpartition("(")[2].rstrip(")")
        if component in named and fact not in stands:
            named[component] |= task.facts.bit(fact)
    return named


class CostBasis:
    """The facts that costs depend on; shared parts are analysed once."""

    def __init__(self) -> None:
        self._places: dict[int, int] = {}

    def bits(self, cost: Cost) -> int | None:
        """Return the bits of the facts that a cost depends on, or None if they are unknown."""
        if isinstance(cost, ConstantCost):
            return 0
        if isinstance(cost, TableCost):
            return cost.places.bits
        if isinstance(cost, CaseCost):
            return sum(cost.values)
        if isinstance(cost, DistanceCost):
            shared = id(cost.places)
            if shared not in self._places:
                self._places[shared] = reduce(or_, cost.places)
            when = (route.when.bits for route in cost.motion.routes)
            return reduce(or_, when, self._places[shared])
        if isinstance(cost, WeightedCost):
            path, duration = self.bits(cost.path_m), self.bits(cost.duration_s)
            return None if path is None or duration is None else path | duration
        if isinstance(cost, DerivedCost):
            return self.bits(cost.cost)
        return None
