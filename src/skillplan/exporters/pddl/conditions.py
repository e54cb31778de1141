"""Verdicts of back ends as conditions on facts.

A verdict holds in every state with the same values of the facts that it names. Such regions cover
all states in which a skill is applicable, with one query each. Feasible regions are then widened to
prime implicants, as in two-level logic minimisation (Brayton et al., "Logic minimization algorithms
for VLSI synthesis", 1984). A partial order yields one condition, a choice of supports several.

Some groups of facts are exclusive. For most of them the skills keep exactly one fact true: the arm
is always somewhere. This is proved by induction over the skills and used to complete states.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import reduce
from itertools import chain
from operator import or_

from skillplan.chart.precedence_query import CheckSteps, run_queries
from skillplan.model.fact_analysis import iterate_bits
from skillplan.model.skill_model import SkillModel
from skillplan.task.skill import Outcome, Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict, VerdictStatus

Region = tuple[int, int]
"""States in which the first facts hold and the second do not, as bits."""


class ConsistentStates:
    """States of a task that respect its exclusive groups; they need not be reachable."""

    def __init__(self, task: Task) -> None:
        self.task = task
        masks = [task.facts.of(*group).bits for group in task.facts.exclusive]
        self._groups = [(mask, _is_always_exact(task, mask)) for mask in masks]
        self._groups_of: dict[int, list[int]] = {}
        for number, mask in enumerate(masks):
            for bit in iterate_bits(mask):
                self._groups_of.setdefault(bit.bit_length(), []).append(number)
        several = (number for number, groups in self._groups_of.items() if len(groups) > 1)
        # Only these facts link groups with each other.
        self._shared = sum(1 << (number - 1) for number in several)

    def choices(self, group: int, region: Region) -> list[Region]:
        """Return a region split by the facts of a group.

        Parameters
        ----------
        group
            Bits of an exclusive group, or of one fact without a group.
        """
        cases = [(bit, group & ~bit) for bit in iterate_bits(group)]
        cases += [] if self.is_exact(group) else [(0, group)]
        split = ((region[0] | true, region[1] | false) for true, false in cases)
        return [part for part in split if self.member(part) is not None]

    def is_exact(self, group: int) -> bool:
        """Return True if exactly one fact of a group holds in every state."""
        return any(mask == group and exact for mask, exact in self._groups)

    def groups(self, bits: int) -> list[int]:
        """Return the groups of facts as bits; a fact without a group is its own group."""
        masks: dict[int, None] = {}
        for bit in iterate_bits(bits):
            numbers = self._groups_of.get(bit.bit_length(), ())
            masks.update(dict.fromkeys(self._groups[number][0] for number in numbers))
            if not numbers:
                masks[bit] = None
        return [*masks]

    def close(self, region: Region) -> Region | None:
        """Return a region with all implied facts; None if it is empty."""
        return self._propagate(*region, range(len(self._groups)))

    def member(self, region: Region) -> State | None:
        """Return a state of a region, similar to the initial state; None if the region is empty."""
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
        """Return the number of a group without a known fact."""
        for number, (mask, _) in enumerate(self._groups):
            if not mask & true and mask & ~false:
                return number
        return None

    def _branches(self, region: Region, number: int) -> Iterator[Region]:
        """Yield parts of a region by the open facts of a group, the initial fact first."""
        true, false = region
        mask, exact = self._groups[number]
        left = mask & ~false
        first = left & self.task.initial.bits
        bits = chain(iterate_bits(first), iterate_bits(left & ~first), () if exact else (0,))
        for bit in bits:
            case = (true | bit, false if bit else false | left)
            closed = self._propagate(*case, [number, *self._around(bit or left)])
            if closed is not None:
                yield closed

    def _around(self, changed: int) -> Iterator[int]:
        """Yield the numbers of the groups that share changed facts."""
        for bit in iterate_bits(changed & self._shared):
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


def _is_always_exact(task: Task, mask: int) -> bool:
    """Return True if exactly one fact of a group holds initially and after every skill."""
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
        if not all(_is_kept_exact(mask, *case) for case in cases):
            return False
    return True


def _is_kept_exact(mask: int, requires: int, forbids: int, outcome: Outcome) -> bool:
    """Return True if an outcome keeps exactly one fact of a group."""
    known_false = forbids | (mask & ~requires if mask & requires else 0)
    may_hold = mask & ~known_false
    added, deleted = outcome.add.bits & mask, outcome.delete.bits & mask
    if not added:
        return not may_hold & deleted
    return not added & (added - 1) and not may_hold & ~deleted & ~added


# Greatest number of queries for one skill.
_MOST_QUERIES = 5_000


@dataclass(frozen=True, slots=True)
class Case:
    """A skill, or one of its conditional effects.

    Parameters
    ----------
    label
        Fact that selects the case; empty for skills without cases.
    """

    skill: Skill
    label: str
    requires: State
    forbids: State
    outcome: Outcome


@dataclass
class Cover:
    """Regions that cover all states in which a case is applicable.

    Parameters
    ----------
    feasible
        Feasible regions by variant of execution; one empty variant unless costs depend on it.
    left_out
        Reason of an unknown verdict; its region counts as infeasible.
    """

    feasible: dict[str, list[Region]] = field(default_factory=dict)
    infeasible: list[Region] = field(default_factory=list)
    refusal: str = ""
    left_out: str = ""


@dataclass(frozen=True, slots=True)
class FeasibleRegion:
    """States in which a case is feasible.

    Parameters
    ----------
    true, false
        Bits of required and forbidden facts beyond the precondition, places excluded.
    places
        Bits of the possible places of the robot; 0 if they do not matter.
    """

    true: int
    false: int
    places: int

    def contains(self, other: FeasibleRegion) -> bool:
        """Return True if another region is part of this one."""
        return not (
            self.true & ~other.true or self.false & ~other.false or other.places & ~self.places
        )


def list_cases(skill: Skill) -> Iterator[Case]:
    """Yield the cases of a skill; the skill itself if it has none."""
    condition = skill.precondition
    if not skill.cases:
        yield Case(skill, "", condition.requires, condition.forbids, skill.outcomes[0])
    for case in skill.cases:
        requires, forbids = condition.requires | case.fact, condition.forbids | case.forbids
        yield Case(skill, str(*case.fact), requires, forbids, case.outcomes[0])


def find_covers(
    model: SkillModel, states: ConsistentStates, cases: Sequence[Case]
) -> dict[tuple[str, str], Cover]:
    """Query back ends and return the cover of every case by skill and label.

    Raises
    ------
    BackEndError
        If a back end fails.
    SearchStopped
        If the time of the model is over.
    """
    queries = run_queries(model, [_explore(model, states, case) for case in cases])
    return {
        (case.skill.name, case.label): cover
        for case, cover in zip(cases, queries, strict=True)
        if cover is not None
    }


def _explore(model: SkillModel, states: ConsistentStates, case: Case) -> CheckSteps[Cover]:
    """Cover the states of a case by regions of verdicts."""
    facts = model.task.facts
    robots = model.task.scene.robots
    by_way = model.asks_costs and bool(case.skill.ways)
    # Facts that an unknown verdict without named facts is assumed to depend on.
    seen = facts.of(*{fact for robot in robots for fact in robot.places}).bits
    cover = Cover()
    todo = [(case.requires.bits, case.forbids.bits)]
    queries = 0
    while todo:
        true, false = todo.pop()
        state = states.member((true, false))
        if state is None:
            continue
        queries += 1
        if queries > _MOST_QUERIES:
            cover.left_out = f"more than {_MOST_QUERIES:,} queries do not cover its states"
            cover.infeasible += [(true, false), *todo]
            break
        verdict = yield case.skill, state
        rests = _get_facts(verdict, facts.all_bits)
        if rests != facts.all_bits:
            seen |= rests
        elif verdict.status is VerdictStatus.UNKNOWN:
            rests = seen
        here = state.bits
        region = (true | rests & here, false | rests & ~here)
        if verdict.is_feasible:
            way = str(verdict.evidence.get("way", "")) if by_way else ""
            cover.feasible.setdefault(way, []).append(region)
        else:
            cover.infeasible.append(region)
            words = f"{verdict.stage}: {verdict.reason}"
            cover.refusal = cover.refusal or words
            if verdict.status is VerdictStatus.UNKNOWN:
                cover.left_out = cover.left_out or words
        for bit in iterate_bits(rests & ~true & ~false):
            todo.append((true, false | bit) if bit & here else (true | bit, false))
            true, false = (true | bit, false) if bit & here else (true, false | bit)
    return cover


def _get_facts(verdict: Verdict, all_bits: int) -> int:
    if verdict.present is None or verdict.absent is None:
        return all_bits
    return verdict.present.bits | verdict.absent.bits


def simplify(
    states: ConsistentStates, case: Case, cover: Cover, way: str, where: int
) -> list[FeasibleRegion]:
    """Return few wide regions that contain exactly the feasible states of a variant.

    Parameters
    ----------
    where
        Bits of the places that a region distinguishes; 0 for none.
    """
    other_ways = [regions for name, regions in cover.feasible.items() if name != way]
    others = chain(cover.infeasible, *other_ways)
    barred = [closed for region in others if (closed := states.close(region)) is not None]
    widening = _Widening(states, case, barred, where)
    kept: list[FeasibleRegion] = []
    for region in cover.feasible.get(way, ()):
        closed = states.close(region)
        if closed is None:
            continue
        start = widening.region(closed, region)
        if not any(other.contains(start) for other in kept):
            wide = widening.widest(start)
            kept = [other for other in kept if not wide.contains(other)] + [wide]
    return kept


class _Widening:
    """Widens regions without overlapping barred ones."""

    def __init__(
        self, states: ConsistentStates, case: Case, barred: list[Region], where: int
    ) -> None:
        self._states = states
        self._requires, self._forbids = case.requires.bits, case.forbids.bits
        self._barred = barred
        self._where = where
        closed = states.close((self._requires, self._forbids))
        self._open = 0 if closed is None else self._places(closed)

    def region(self, closed: Region, named: Region) -> FeasibleRegion:
        """Return a region beyond the precondition, with separate places."""
        known = self._requires | self._forbids | self._where
        return FeasibleRegion(named[0] & ~known, named[1] & ~known, self._places(closed))

    def widest(self, region: FeasibleRegion) -> FeasibleRegion:
        """Return a maximal region, widened literal by literal and then place by place."""
        true, false, places = region.true, region.false, region.places
        for bit in iterate_bits(false | true):
            if self._is_free(true & ~bit, false & ~bit, places):
                true, false = true & ~bit, false & ~bit
        for bit in iterate_bits(self._open & ~places):
            if self._is_free(true, false, bit):
                places |= bit
        return FeasibleRegion(true, false, places)

    def _is_free(self, true: int, false: int, places: int) -> bool:
        """Return True if a region has no state in a barred one."""
        true, false = true | self._requires, false | self._forbids
        if self._where:
            false |= self._where & ~places
        closed = self._states.close((true, false))
        if closed is None:
            return True
        for barred in self._barred:
            if closed[0] & barred[1] or closed[1] & barred[0]:
                continue
            if self._states.member((closed[0] | barred[0], closed[1] | barred[1])) is not None:
                return False
        return True

    def _places(self, closed: Region) -> int:
        """Return the possible places of a closed region."""
        held = closed[0] & self._where
        return held or self._where & ~closed[1]


def collect_named_bits(cover: Cover) -> int:
    """Return the bits of all facts that the verdicts on a case depend on."""
    regions = [region for parts in cover.feasible.values() for region in parts]
    return reduce(or_, (true | false for true, false in (*regions, *cover.infeasible)), 0)
