"""Verdicts of back ends as conditions on facts: in which states each skill is feasible.

A verdict holds in every state that agrees with it on the facts that it names. The states in which
a skill is applicable are covered by such regions, one query each, until none is left. Regions in
which the skill is feasible are then widened as far as no infeasible one is touched: to prime
implicants, as in two-level logic minimisation (Brayton et al., "Logic minimization algorithms for
VLSI synthesis", 1984). A partial order comes to one condition, a choice of supports to several.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import reduce
from itertools import chain
from operator import or_

from skillplan.chart.precedence_query import CheckSteps, run_queries
from skillplan.exporters.pddl.consistent_states import ConsistentStates, Region
from skillplan.model.fact_analysis import each_bit
from skillplan.model.skill_model import SkillModel
from skillplan.task.skill import Outcome, Skill
from skillplan.task.state import State
from skillplan.task.verdict import Verdict, VerdictStatus

# More queries than this about one skill are not made.
_MOST_QUERIES = 5_000


@dataclass(frozen=True, slots=True)
class Case:
    """A skill, or one of its conditional effects, by itself.

    Parameters
    ----------
    skill
        The skill.
    label
        The fact that selects the case; empty if the skill has none.
    requires, forbids
        Facts that must hold, and that must not.
    outcome
        The nominal outcome.
    """

    skill: Skill
    label: str
    requires: State
    forbids: State
    outcome: Outcome


@dataclass
class Cover:
    """Regions that together are all states in which a case is applicable.

    Parameters
    ----------
    feasible
        Regions in which it is feasible, by the way that it is executed in; one empty way unless
        costs depend on it.
    infeasible
        All other regions.
    refusal
        Why it is infeasible in the first of them, in words.
    left_out
        Why the verdict of some regions is not known, in words; they count as infeasible.
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
        Bits of the facts that must hold, and must not, beyond the precondition; none of the
        places.
    places
        Bits of the places where the robot may stand; 0 if that does not matter.
    """

    true: int
    false: int
    places: int

    def contains(self, other: FeasibleRegion) -> bool:
        """Whether another region is part of this one."""
        return not (
            self.true & ~other.true or self.false & ~other.false or other.places & ~self.places
        )


def cases_of(skill: Skill) -> Iterator[Case]:
    """Yield the cases of a skill; the skill itself if it has none."""
    condition = skill.precondition
    if not skill.cases:
        yield Case(skill, "", condition.requires, condition.forbids, skill.outcomes[0])
    for case in skill.cases:
        requires, forbids = condition.requires | case.fact, condition.forbids | case.forbids
        yield Case(skill, str(*case.fact), requires, forbids, case.outcomes[0])


def covers_of(
    model: SkillModel, states: ConsistentStates, cases: Sequence[Case]
) -> dict[tuple[str, str], Cover]:
    """Return the cover of every case by skill and label; back ends are queried for it.

    Raises
    ------
    BackEndError
        If a back end fails.
    SearchStopped
        If the model's time is over.
    """
    found = run_queries(model, [_explore(model, states, case) for case in cases])
    return {
        (case.skill.name, case.label): cover
        for case, cover in zip(cases, found, strict=True)
        if cover is not None
    }


def _explore(model: SkillModel, states: ConsistentStates, case: Case) -> CheckSteps[Cover]:
    """Cover the states in which a case is applicable by the regions of verdicts."""
    facts = model.task.facts
    robots = model.task.scene.robots
    by_way = model.asks_costs and bool(case.skill.ways)
    # What an unknown verdict is taken to rest on if it does not say.
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
        rests = _facts_of(verdict, facts.all_bits)
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
        for bit in each_bit(rests & ~true & ~false):
            todo.append((true, false | bit) if bit & here else (true | bit, false))
            true, false = (true | bit, false) if bit & here else (true, false | bit)
    return cover


def _facts_of(verdict: Verdict, all_bits: int) -> int:
    if verdict.present is None or verdict.absent is None:
        return all_bits
    return verdict.present.bits | verdict.absent.bits


def simplified(
    states: ConsistentStates, case: Case, cover: Cover, way: str, where: int
) -> list[FeasibleRegion]:
    """Return few and wide regions in which a case is feasible by a way, and no other states.

    Parameters
    ----------
    states, case, cover, way
        The case and its cover.
    where
        Bits of the places that are told apart in one region; 0 for none.
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
        if not any(one.contains(start) for one in kept):
            wide = widening.widest(start)
            kept = [one for one in kept if not wide.contains(one)] + [wide]
    return kept


class _Widening:
    """Widens regions as far as they touch no barred one."""

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
        """Return a region beyond the precondition, with its places apart."""
        known = self._requires | self._forbids | self._where
        return FeasibleRegion(named[0] & ~known, named[1] & ~known, self._places(closed))

    def widest(self, region: FeasibleRegion) -> FeasibleRegion:
        """Return a widest region about one, literal by literal and then place by place."""
        true, false, places = region.true, region.false, region.places
        for bit in each_bit(false | true):
            if self._is_free(true & ~bit, false & ~bit, places):
                true, false = true & ~bit, false & ~bit
        for bit in each_bit(self._open & ~places):
            if self._is_free(true, false, bit):
                places |= bit
        return FeasibleRegion(true, false, places)

    def _is_free(self, true: int, false: int, places: int) -> bool:
        """Whether no state of a region is in a barred one."""
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
        """Return the places that a closed region leaves open."""
        held = closed[0] & self._where
        return held or self._where & ~closed[1]


def named_bits(cover: Cover) -> int:
    """Return the bits of all facts that the verdicts on a case rest on."""
    regions = [region for found in cover.feasible.values() for region in found]
    return reduce(or_, (true | false for true, false in (*regions, *cover.infeasible)), 0)
