"""Partial states of a task, completed by its exclusive groups of facts.

A vocabulary promises at most one fact of a group. Of most groups the skills keep exactly one: the
arm always stands somewhere. That is proved here by induction over the skills, so that a fact can be
inferred if all others of its group are ruled out.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain

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
        several = (number for number, groups in self._groups_of.items() if len(groups) > 1)
        # Only through these facts does one group tell anything about another.
        self._shared = sum(1 << (number - 1) for number in several)

    def choices(self, group: int, region: Region) -> list[Region]:
        """Return regions that split `region` by the facts of a group, or by one fact.

        Parameters
        ----------
        group
            Bits of an exclusive group, or of one fact that belongs to none.
        region
            The region that is split.
        """
        cases = [(bit, group & ~bit) for bit in each_bit(group)]
        cases += [] if self.is_exact(group) else [(0, group)]
        split = ((region[0] | true, region[1] | false) for true, false in cases)
        return [part for part in split if self.member(part) is not None]

    def is_exact(self, group: int) -> bool:
        """Whether exactly one fact of a group holds in every state."""
        return any(mask == group and exact for mask, exact in self._groups)

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
        closed = self.close(region)
        todo: list[Iterator[Region]] = [iter([] if closed is None else [closed])]
        while todo:
            smaller = next(todo[-1], None)
            if smaller is None:
                todo.pop()
                continue
            group = self._open_group(*smaller)
            if group is None:
                known = smaller[0] | smaller[1]
                return self.task.facts.state(smaller[0] | self.task.initial.bits & ~known)
            todo.append(self._branches(smaller, group))
        return None

    def _open_group(self, true: int, false: int) -> int | None:
        """Return the number of a group of which it is open what holds."""
        for number, (mask, _) in enumerate(self._groups):
            if not mask & true and mask & ~false:
                return number
        return None

    def _branches(self, region: Region, number: int) -> Iterator[Region]:
        """Yield a region by the facts of a group that it leaves open, the initial one first."""
        true, false = region
        mask, exact = self._groups[number]
        left = mask & ~false
        first = left & self.task.initial.bits
        bits = chain(each_bit(first), each_bit(left & ~first), () if exact else (0,))
        for bit in bits:
            case = (true | bit, false if bit else false | left)
            closed = self._propagate(*case, [number, *self._around(bit or left)])
            if closed is not None:
                yield closed

    def _around(self, changed: int) -> Iterator[int]:
        """Yield the numbers of the groups that share facts that have changed with other groups."""
        for bit in each_bit(changed & self._shared):
            yield from self._groups_of[bit.bit_length()]

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
