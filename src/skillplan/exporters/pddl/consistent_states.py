"""Partial states of a task, completed by its exclusive groups of facts.

A vocabulary promises at most one fact of a group. Of most groups the skills keep exactly one: the
arm always stands somewhere. That is proved here by induction over the skills, so that a fact can be
inferred if all others of its group are ruled out.
"""

from __future__ import annotations

from collections.abc import Iterable

from skillplan.model.fact_analysis import each_bit
from skillplan.task.skill import Outcome
from skillplan.task.state import State
from skillplan.task.task import Task

Region = tuple[int, int]
"""States in which the facts of the first bits hold and those of the second do not."""


class ConsistentStates:
    """The states of a task that respect its exclusive groups; they need not be reachable.

    Parameters
    ----------
    task
        The task.
    """

    def __init__(self, task: Task) -> None:
        self.task = task
        masks = [task.facts.of(*group).bits for group in task.facts.exclusive]
        self._groups = [(mask, _keeps_one(task, mask)) for mask in masks]
        self._groups_of: dict[int, list[int]] = {}
        for number, mask in enumerate(masks):
            for bit in each_bit(mask):
                self._groups_of.setdefault(bit.bit_length(), []).append(number)

    def choices(self, group: int, region: Region) -> list[Region]:
        """Return regions that split `region` by the facts of a group, or by one fact.

        Parameters
        ----------
        group
            Bits of an exclusive group, or of one fact that belongs to none.
        region
            The region that is split.
        """
        exact = any(mask == group and one for mask, one in self._groups)
        cases = [(bit, group & ~bit) for bit in each_bit(group)]
        cases += [] if exact else [(0, group)]
        split = ((region[0] | true, region[1] | false) for true, false in cases)
        return [part for part in split if self.member(part) is not None]

    def groups(self, bits: int) -> list[int]:
        """Return the groups that facts belong to, as bits; facts without a group as their own."""
        found: dict[int, None] = {}
        for bit in each_bit(bits):
            numbers = self._groups_of.get(bit.bit_length(), ())
            found.update(dict.fromkeys(self._groups[number][0] for number in numbers))
            if not numbers:
                found[bit] = None
        return [*found]

    def close(self, region: Region) -> Region | None:
        """Return a region with the facts that follow from its own; None if it is empty."""
        return self._propagate(*region, range(len(self._groups)))

    def member(self, region: Region) -> State | None:
        """Return a state of a region, as similar to the initial one as found; None if empty."""
        initial = self.task.initial.bits
        closed = self.close(region)
        todo = [] if closed is None else [closed]
        while todo:
            true, false = todo.pop()
            group = next((g for g in self._groups if not g[0] & true and g[0] & ~false), None)
            if group is None:
                free = initial & ~(true | false)
                return self.task.facts.state(true | free)
            mask, exact = group
            left = mask & ~false
            # The last one is looked at first.
            order = sorted(each_bit(left), key=lambda bit: (bool(bit & initial), -bit))
            tries = [] if exact else [self._propagate(true, false | left, self._around(left))]
            tries += [self._propagate(true | bit, false, self._around(bit)) for bit in order]
            todo += [one for one in tries if one is not None]
        return None

    def _around(self, bits: int) -> list[int]:
        """Return the numbers of the groups that some facts belong to."""
        return [n for bit in each_bit(bits) for n in self._groups_of.get(bit.bit_length(), ())]

    def _propagate(self, true: int, false: int, numbers: Iterable[int]) -> Region | None:
        todo = [*numbers]
        while todo and not true & false:
            mask, exact = self._groups[todo.pop()]
            held, left = true & mask, mask & ~false
            if held & (held - 1) or (exact and not left):
                return None
            new_false = left & ~held if held else 0
            new_true = left if exact and not held and not left & (left - 1) else 0
            true, false = true | new_true, false | new_false
            todo += self._around(new_true | new_false)
        return None if true & false else (true, false)


def _keeps_one(task: Task, mask: int) -> bool:
    """Whether exactly one fact of a group holds at first and after every skill."""
    if (task.initial.bits & mask).bit_count() != 1:
        return False
    for skill in task.skills:
        condition = skill.precondition
        cases = [(condition.requires.bits, condition.forbids.bits, o) for o in skill.outcomes]
        cases += [
            (condition.requires.bits | case.fact.bits, case.forbids.bits, outcome)
            for case in skill.cases
            for outcome in case.outcomes
        ]
        if not all(_leaves_one(mask, *case) for case in cases):
            return False
    return True


def _leaves_one(mask: int, requires: int, forbids: int, outcome: Outcome) -> bool:
    """Whether one fact of a group holds after an outcome if one did before."""
    known_false = forbids | (mask & ~requires if mask & requires else 0)
    may_hold = mask & ~known_false
    added, deleted = outcome.add.bits & mask, outcome.delete.bits & mask
    if not added:
        return not may_hold & deleted
    return not added & (added - 1) and not may_hold & ~deleted & ~added
