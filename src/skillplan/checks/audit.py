"""Verdicts held against fresh ones: a back end that names too few facts contradicts itself.

A verdict is reused wherever the facts that it rests on are the same. One that rests on more than it
says is therefore used where it does not hold, and nothing in a search tells. Asked again there, the
back end says otherwise.
"""

from __future__ import annotations

import random
from collections.abc import Iterator

from skillplan.checks.feasibility import Feasibility
from skillplan.checks.reuse_sample import Reuse
from skillplan.checks.single_check import check
from skillplan.checks.ways import asked_about
from skillplan.errors import BackEndError
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import Verdict, VerdictStatus

# What a back end says that is asked the same so often is what it always says.
_TIMES = 3
# Of verdicts that were never reused, so many are looked at.
_MOST_KEPT = 1_000
_MOST_NAMED = 12


def audit(feasibility: Feasibility, size: int, seed: int, *, expensive: bool) -> int:
    """Ask back ends again about a sample of what verdicts have answered for them.

    Parameters
    ----------
    feasibility
        With which a search was done.
    size
        How many verdicts are put to the test, >= 0.
    seed
        Governs the choice.
    expensive
        Whether expensive back ends are asked, too.

    Returns
    -------
    int
        How many were.

    Raises
    ------
    BackEndError
        If a back end contradicts itself, or fails.
    """
    if not size:
        return 0
    draw = random.Random(seed)
    chosen = _drawn(feasibility, size, draw, expensive=expensive)
    if len(chosen) < size:
        # What was never reused can at least be asked a second time.
        kept = list(_kept(feasibility, expensive=expensive))
        chosen += draw.sample(kept, min(size - len(chosen), len(kept)))
    for one in chosen:
        made_in = feasibility.cache.made_in(one.back_end, one.skill, one.verdict)
        hold(one.back_end, one.skill, one.verdict, one.state if made_in is None else made_in, one)
    return len(chosen)


def hold(back_end: BackEnd, skill: Skill, verdict: Verdict, made_in: State, reuse: Reuse) -> None:
    """Ask a back end about a kept verdict, where it was made and where it was reused.

    Parameters
    ----------
    back_end, skill, verdict
        Who said what about which skill.
    made_in
        The state in which it was asked.
    reuse
        Where the verdict stood in for it.

    Raises
    ------
    BackEndError
        If it says otherwise, or fails.
    """
    for state in dict.fromkeys((reuse.state, made_in)):
        fresh = check(back_end, skill, state).verdict
        if contradicts(verdict, fresh):
            raise contradiction(back_end, skill, verdict, made_in, fresh, state)


def contradicts(kept: Verdict, fresh: Verdict) -> bool:
    """Whether two verdicts cannot both be right; what is unknown contradicts nothing."""
    return VerdictStatus.UNKNOWN not in (kept.status, fresh.status) and kept.status != fresh.status


def contradiction(
    back_end: BackEnd, skill: Skill, kept: Verdict, made_in: State, fresh: Verdict, state: State
) -> BackEndError:
    """Return the error that says how a back end contradicts itself.

    Parameters
    ----------
    back_end, skill
        Who, and about what.
    kept, made_in
        What it said, and where.
    fresh, state
        What it says where the facts are the same that the kept verdict rests on.
    """
    name = f"Back end {back_end.name!r}"
    for asked, said in ((made_in, kept), (state, fresh)):
        others = {check(back_end, skill, asked).verdict.status for _ in range(_TIMES)}
        if others != {said.status}:
            now = next(one for one in sorted(others) if one != said.status)
            return BackEndError(
                f"{name} answers differently the second time: {skill.name} was {said.status}, "
                f"then {now}, both in {asked}. Its verdicts cannot be reused."
            )
    facts = ", ".join(kept.facts) or "no fact"
    missing = _missing(back_end, skill, made_in, state, kept.status)
    return BackEndError(
        f"{name} contradicts itself about {skill.name}: {_said(kept)} in {made_in}, resting on "
        f"{facts}, and {_said(fresh)} in {state}, where the same holds. {missing}"
    )


def _said(verdict: Verdict) -> str:
    return f"{verdict.status} ({verdict.reason})" if verdict.reason else str(verdict.status)


def _missing(
    back_end: BackEnd, skill: Skill, made_in: State, state: State, was: VerdictStatus
) -> str:
    """Return in words which fact a verdict should have named: the one that turns the answer."""
    current, since = made_in.bits, 0
    facts = back_end.task.facts
    for unit in _steps(back_end, made_in, state):
        current ^= unit
        since |= unit
        between = facts.state(current)
        if not skill.applicable(between):
            continue
        try:
            said = check(back_end, skill, between).verdict.status
        except BackEndError:
            # Between two states that can be reached there may be some that cannot.
            continue
        if said not in (was, VerdictStatus.UNKNOWN):
            # Of facts that exclude each other any tells which one holds.
            named = list(facts.state(since))
            return (
                f"The first verdict should have named {' or '.join(named[:_MOST_NAMED])}: with "
                f"{'that' if len(named) == 1 else 'those'} alone changed the answer is the other "
                "one."
            )
        if said is was:
            since = 0
    differing = list(facts.state(made_in.bits ^ state.bits))
    return f"The first verdict should have named one of {_listed(differing)}, in which they differ."


def _steps(back_end: BackEnd, made_in: State, state: State) -> Iterator[int]:
    """Yield what to change to come from one state to the other, as little as possible at a time.

    Of facts that exclude each other one goes where another comes.
    """
    task = back_end.task
    left = made_in.bits ^ state.bits
    for group in task.facts.exclusive:
        together = left & sum(task.facts.bit(name) for name in group)
        if together:
            left &= ~together
            yield together
    while left:
        lowest = left & -left
        left ^= lowest
        yield lowest


def _listed(names: list[str]) -> str:
    shown = names if len(names) <= _MOST_NAMED else [*names[:_MOST_NAMED], "..."]
    return ", ".join(shown) or "a fact"


def _drawn(
    feasibility: Feasibility, size: int, draw: random.Random, *, expensive: bool
) -> list[Reuse]:
    """Return some of the reuses: of every skill one, then of every skill another."""
    rows = [
        draw.sample(row, len(row))
        for row in feasibility.reused.by_skill()
        if expensive or not row[0].back_end.expensive
    ]
    draw.shuffle(rows)
    depth = max(map(len, rows), default=0)
    order = [row[level] for level in range(depth) for row in rows if level < len(row)]
    return order[:size]


def _kept(feasibility: Feasibility, *, expensive: bool) -> Iterator[Reuse]:
    """Yield verdicts that were made, as if they had been reused where they were made."""
    left = _MOST_KEPT
    for back_end in feasibility.back_ends:
        if back_end.expensive and not expensive:
            continue
        for skill in asked_about(feasibility.task):
            for verdict, state in feasibility.cache.made(back_end, skill):
                if not left:
                    return
                left -= 1
                yield Reuse(back_end, skill, state, verdict)
