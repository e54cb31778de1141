"""Verdicts held against fresh ones: a back end that names too few facts contradicts itself.

A verdict is reused wherever the facts that it rests on are the same. One that rests on more than it
says is therefore used where it does not hold, and nothing in a search tells. Asked again there, the
back end says otherwise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from skillplan.checks.feasibility import Feasibility
from skillplan.checks.single_check import check
from skillplan.checks.verdict_sample import DrawnVerdict, draw_reused
from skillplan.checks.ways import asked_by_name
from skillplan.errors import BackEndError
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import Verdict, VerdictStatus

# What a back end says that is asked the same so often is what it always says.
_TIMES = 3
_MOST_NAMED = 12


def audit(feasibility: Feasibility, size: int, seed: int, *, expensive: bool) -> int:
    """Ask back ends again about a sample of what verdicts have answered for them.

    Parameters
    ----------
    feasibility, size, seed, expensive
        As in `draw_reused`.

    Returns
    -------
    int
        How many verdicts were put to the test.

    Raises
    ------
    BackEndError
        If a back end contradicts itself, or fails.
    """
    drawn = draw_reused(feasibility, size, seed, expensive=expensive)
    ask_again(feasibility.back_ends, drawn)
    return len(drawn)


def ask_again(
    back_ends: Sequence[BackEnd], drawn: Sequence[DrawnVerdict], *, times: int = 1
) -> None:
    """Ask back ends about verdicts, where these were made and where they were reused.

    Parameters
    ----------
    back_ends
        In the order of the chain in which the verdicts were given.
    drawn
        The verdicts.
    times
        How often each is asked, >= 1. One that was never asked before, as the verdicts are from
        another process, may say the first time what it says no second time.

    Raises
    ------
    BackEndError
        If one says otherwise, or fails.
    """
    skills = asked_by_name(back_ends[0].task) if drawn else {}
    for one in drawn:
        back_end, skill = back_ends[one.back_end], skills[one.skill]
        task, kept = back_end.task, one.verdict(back_end)
        made_in = one.made_in(task)
        for state in dict.fromkeys((one.used_in(task), made_in)):
            for _ in range(times):
                fresh = check(back_end, skill, state).verdict
                if contradicts(kept, fresh):
                    raise contradiction(back_end, skill, kept, made_in, fresh, state)


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
