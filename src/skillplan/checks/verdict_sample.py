"""Verdicts drawn after a search to be asked again.

The search may have been in another process than the one that asks.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass

from skillplan.checks.feasibility import Feasibility
from skillplan.checks.ways import asked_about
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict, VerdictStatus

DEFAULT_AUDIT = 4
"""So many reused verdicts are asked again after a search, where that costs nothing to speak of."""
DEFAULT_REFUSED = 2
"""So many refusals of screens are executed after a search."""
# Of verdicts that were never reused, so many are looked at.
_MOST_KEPT = 1_000


@dataclass(frozen=True, slots=True)
class DrawnVerdict:
    """What a back end said of a skill, where it was asked, and where the answer was used again.

    Plain values only, which mean the same in another process.

    Parameters
    ----------
    back_end
        Its index in the chain of checks.
    skill
        The name of what was asked about; by one of its ways where it has several.
    status, reason
        What was said.
    present_bits, absent_bits
        The facts on which it rests.
    made_in_bits, used_in_bits
        The states in which it was asked, and in which the answer stood in for it.
    """

    back_end: int
    skill: str
    status: str
    reason: str
    present_bits: int
    absent_bits: int
    made_in_bits: int
    used_in_bits: int

    @classmethod
    def of(
        cls, back_end: int, skill: Skill, verdict: Verdict, made_in: State, used_in: State
    ) -> DrawnVerdict:
        """Return the record of a verdict that names the facts it rests on."""
        assert verdict.present is not None
        assert verdict.absent is not None
        return cls(
            back_end,
            skill.name,
            verdict.status.value,
            verdict.reason,
            verdict.present.bits,
            verdict.absent.bits,
            made_in.bits,
            used_in.bits,
        )

    def verdict(self, back_end: BackEnd) -> Verdict:
        """Return what the back end said, without what it measured."""
        facts = back_end.task.facts
        present, absent = facts.state(self.present_bits), facts.state(self.absent_bits)
        status = VerdictStatus(self.status)
        return Verdict(status, self.reason, back_end.name, present, absent)

    def made_in(self, task: Task) -> State:
        """Return the state in which the back end was asked."""
        return task.facts.state(self.made_in_bits)

    def used_in(self, task: Task) -> State:
        """Return the state in which the answer was used again."""
        return task.facts.state(self.used_in_bits)


@dataclass(frozen=True, slots=True)
class SampleSize:
    """How many verdicts are drawn, and which.

    Parameters
    ----------
    seed
        Governs the choice.
    reused
        How many that were reused, >= 0.
    expensive
        Whether those of expensive back ends are among them.
    refused
        How many refusals of screens, >= 0.
    """

    seed: int = 0
    reused: int = DEFAULT_AUDIT
    expensive: bool = False
    refused: int = DEFAULT_REFUSED

    @classmethod
    def of(cls, audit: int | None, seed: int) -> SampleSize:
        """Return what ``--audit`` stands for: a number of all kinds, or None for a handful."""
        return cls(seed) if audit is None else cls(seed, audit, True, audit)


@dataclass(frozen=True, slots=True)
class VerdictSample:
    """What was drawn.

    Parameters
    ----------
    reused
        Verdicts that were reused.
    refused
        Refusals of screens.
    refusals
        How many of these there are in all.
    elsewhere
        Whether the verdicts were given in another process than this.
    """

    reused: tuple[DrawnVerdict, ...] = ()
    refused: tuple[DrawnVerdict, ...] = ()
    refusals: int = 0
    elsewhere: bool = False


def draw_sample(feasibility: Feasibility, size: SampleSize) -> VerdictSample:
    """Return a sample of what was reused and refused in a search, or derivation, that is over.

    Parameters
    ----------
    feasibility
        With which it was done.
    size
        How much is drawn.
    """
    reused = draw_reused(feasibility, size.reused, size.seed, expensive=size.expensive)
    refusals = list(_refusals(feasibility))
    drawn = random.Random(size.seed).sample(refusals, min(size.refused, len(refusals)))
    return VerdictSample(tuple(reused), tuple(drawn), len(refusals))


def draw_reused(
    feasibility: Feasibility, size: int, seed: int, *, expensive: bool, going_on: bool = False
) -> list[DrawnVerdict]:
    """Return a sample of what verdicts have answered for back ends.

    Parameters
    ----------
    feasibility
        With which a search was done.
    size
        How many verdicts, >= 0.
    seed
        Governs the choice.
    expensive
        Whether those of expensive back ends are drawn, too.
    going_on
        Whether the search goes on in another thread: then only what was reused is looked at.
    """
    if not size:
        return []
    random_ = random.Random(seed)
    chosen = _reused(feasibility, size, random_, expensive=expensive)
    if len(chosen) < size and not going_on:
        # What was never reused can at least be asked a second time.
        kept = list(_kept(feasibility, expensive=expensive))
        chosen += random_.sample(kept, min(size - len(chosen), len(kept)))
    return chosen


def _reused(
    feasibility: Feasibility, size: int, random_: random.Random, *, expensive: bool
) -> list[DrawnVerdict]:
    """Return some of the reuses: of every skill one, then of every skill another."""
    rows = [
        random_.sample(row, len(row))
        for row in feasibility.reused.by_skill()
        if expensive or not feasibility.back_ends[row[0].back_end].expensive
    ]
    random_.shuffle(rows)
    depth = max(map(len, rows), default=0)
    order = [row[level] for level in range(depth) for row in rows if level < len(row)]
    chosen = []
    for one in order[:size]:
        back_end = feasibility.back_ends[one.back_end]
        made_in = feasibility.cache.made_in(back_end, one.skill, one.verdict)
        made_in = one.state if made_in is None else made_in
        chosen.append(DrawnVerdict.of(one.back_end, one.skill, one.verdict, made_in, one.state))
    return chosen


def _kept(feasibility: Feasibility, *, expensive: bool) -> Iterator[DrawnVerdict]:
    """Yield verdicts that were made, as if they had been reused where they were made."""
    left = _MOST_KEPT
    for index, back_end in enumerate(feasibility.back_ends):
        if back_end.expensive and not expensive:
            continue
        for skill in asked_about(feasibility.task):
            for verdict, state in feasibility.cache.made(back_end, skill):
                if not left:
                    return
                left -= 1
                yield DrawnVerdict.of(index, skill, verdict, state, state)


def _refusals(feasibility: Feasibility) -> Iterator[DrawnVerdict]:
    for index, screen in enumerate(feasibility.back_ends):
        if not screen.screens:
            continue
        for skill in asked_about(feasibility.task):
            for verdict, state in feasibility.cache.made(screen, skill):
                if verdict.status is VerdictStatus.INFEASIBLE:
                    yield DrawnVerdict.of(index, skill, verdict, state, state)
