"""The chain of back ends behind a verdict: one after the other, until one refuses."""

from __future__ import annotations

from collections.abc import Generator
from typing import NamedTuple, Protocol

from skillplan.checks.single_check import Checked, CheckRequest, check
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import Verdict, VerdictStatus

# Yields what is to be checked and is sent what was said; returns the verdict.
Checking = Generator[CheckRequest, Checked, Verdict]


class Link(NamedTuple):
    """A back end of the chain.

    Parameters
    ----------
    number
        Its position, by which other processes know it.
    back_end
        The back end.
    counts
        Whether its checks are worth counting.
    apart
        Whether it checks in another process.
    """

    number: int
    back_end: BackEnd
    counts: bool
    apart: bool


class Account(Protocol):
    """What is known already, and where it is noted what else had to be checked."""

    def known(self, link: Link, skill: Skill, state: State) -> Verdict | None:
        """Return what a back end has said that holds in a state, or None."""

    def begin(self, link: Link) -> None:
        """Note that a back end is about to check."""

    def foretold(self, link: Link, skill: Skill, state: State) -> Checked | None:
        """Return what it said when that was checked ahead, or None."""

    def keep(self, link: Link, skill: Skill, state: State, checked: Checked) -> None:
        """Keep what it says."""


def deciding(chain: tuple[Link, ...], account: Account, skill: Skill, state: State) -> Checking:
    """Decide about a skill with one motion that is applicable in a state.

    Parameters
    ----------
    chain
        The back ends, the cheapest first.
    account
        Of this check.
    skill, state
        What is asked.

    Returns
    -------
    Verdict
        Infeasible by the first back end that says so, else unknown by the first that does, else
        feasible, on the facts that all of them named.
    """
    facts = state.facts
    condition = skill.condition(state)
    present, absent = condition.requires.bits, condition.forbids.bits
    unknown: Verdict | None = None
    goes_on = False
    for link in chain:
        verdict = account.known(link, skill, state)
        if verdict is None:
            account.begin(link)
            checked = account.foretold(link, skill, state)
            if checked is None and link.apart:
                checked = yield CheckRequest(link.number, skill, state, goes_on)
            elif checked is None:
                checked = check(link.back_end, skill, state)
            goes_on = goes_on or link.apart
            verdict = checked.verdict
            account.keep(link, skill, state, checked)
        if verdict.status is VerdictStatus.INFEASIBLE:
            return verdict
        if verdict.status is VerdictStatus.UNKNOWN:
            unknown = unknown or verdict
        if verdict.present is not None and verdict.absent is not None:
            present |= verdict.present.bits
            absent |= verdict.absent.bits
    return unknown or Verdict.feasible(facts.state(present), facts.state(absent))
