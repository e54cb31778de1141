"""The chain of checks behind a verdict: cheapest first, and the first that fails names itself."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from skillplan.errors import BackEndError, SkillplanError
from skillplan.model.verdict_cache import VerdictCache
from skillplan.task.back_end import BackEnd
from skillplan.task.plain_json import json_fault
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict, VerdictStatus

PRECONDITION = "precondition"

# Of the facts that would do, a message names so many.
_MOST_NAMED = 12


class Feasibility:
    """Rules on skills by asking back ends, each only for what is not known yet.

    Parameters
    ----------
    task
        The task whose skills are asked about.
    back_ends
        Asked in ascending order of their `expected_s`.
    cache
        Where verdicts are kept; a fresh one in memory by default.

    Attributes
    ----------
    checks
        Questions for which at least one back end had to work.
    hits
        Questions answered from kept verdicts alone.
    asked
        How often each back end was asked.
    """

    def __init__(
        self,
        task: Task,
        back_ends: Iterable[BackEnd] = (),
        cache: VerdictCache | None = None,
    ) -> None:
        self.task = task
        self.back_ends = tuple(sorted(back_ends, key=lambda back_end: back_end.expected_s))
        self.cache = VerdictCache() if cache is None else cache
        self.checks = 0
        self.hits = 0
        self.asked: Counter[str] = Counter({back_end.name: 0 for back_end in self.back_ends})

    def rule(self, skill: Skill, state: State) -> Verdict:
        """Return the verdict on `skill` in `state`.

        Raises
        ------
        BackEndError
            If a back end raises instead of ruling, or returns something else than a verdict.
        """
        if not skill.applicable(state):
            return self._inapplicable(skill, state)
        asked_before = self.asked.total()
        verdict = self._rule(skill, state)
        if self.asked.total() > asked_before:
            self.checks += 1
        else:
            self.hits += 1
        return verdict

    def stages(self, skill: Skill, state: State) -> list[Verdict]:
        """Return the verdict of every stage, also beyond the first that fails."""
        if not skill.applicable(state):
            return [self._inapplicable(skill, state)]
        condition = skill.condition(state)
        first = Verdict.feasible(condition.requires, condition.forbids)
        return [
            first.grounded(state, PRECONDITION),
            *(self._ask(back_end, skill, state) for back_end in self.back_ends),
        ]

    def _inapplicable(self, skill: Skill, state: State) -> Verdict:
        amiss = skill.why_not(state)
        names = [*amiss.requires, *(f"not {name}" for name in amiss.forbids)]
        one_of = "one of " if len(amiss.requires) > len(skill.condition(state).requires) else ""
        shown = names if len(names) <= _MOST_NAMED else [*names[:_MOST_NAMED], "..."]
        reason = f"needs {one_of}{', '.join(shown)}"
        wrong = [self.task.places[fact].name for fact in amiss.forbids if fact in self.task.places]
        if len(wrong) == len(names):
            reason = f"cannot be done at {', '.join(wrong)}"
        return Verdict(
            VerdictStatus.INFEASIBLE,
            reason,
            PRECONDITION,
            amiss.forbids,
            amiss.requires,
            {"amiss": names},
        )

    def _rule(self, skill: Skill, state: State) -> Verdict:
        facts = self.task.facts
        condition = skill.condition(state)
        present, absent = condition.requires, condition.forbids
        unknown: Verdict | None = None
        for back_end in self.back_ends:
            verdict = self._ask(back_end, skill, state)
            if verdict.is_infeasible:
                return verdict
            if verdict.status is VerdictStatus.UNKNOWN:
                unknown = unknown or verdict
            present |= verdict.present or facts.none
            absent |= verdict.absent or facts.none
        if unknown is not None:
            return unknown
        return Verdict(VerdictStatus.FEASIBLE, "", "", present, absent)

    def _ask(self, back_end: BackEnd, skill: Skill, state: State) -> Verdict:
        known = self.cache.find(back_end, skill, state)
        if known is not None:
            return known
        self.asked[back_end.name] += 1
        try:
            verdict = back_end.check(skill, state)
        except BackEndError:
            raise
        except SkillplanError as error:
            raise BackEndError(
                f"Back end {back_end.name!r} failed on {skill.name} in {state}: {error}"
            ) from error
        except Exception as error:
            raise BackEndError(
                f"Back end {back_end.name!r} failed on {skill.name} in {state}: "
                f"{type(error).__name__}: {error}"
            ) from error
        if not isinstance(verdict, Verdict):
            raise BackEndError(
                f"Back end {back_end.name!r} returned {type(verdict).__name__} for "
                f"{skill.name}, not a Verdict."
            )
        fault = json_fault(verdict.evidence)
        if fault is not None:
            raise BackEndError(
                f"The evidence of back end {back_end.name!r} for {skill.name} is not JSON: {fault}."
            )
        verdict = verdict.grounded(state, back_end.name)
        if not verdict.applies_in(state):
            raise BackEndError(
                f"Back end {back_end.name!r} says its verdict on {skill.name} rests on facts "
                f"that do not hold in {state}: {', '.join(verdict.facts)}."
            )
        self.cache.keep(back_end, skill, verdict)
        return verdict
