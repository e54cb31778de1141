"""What back ends say of one skill in states that need not be reachable."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

from skillplan.chart.hypothetical_state import HypotheticalStates
from skillplan.chart.partial_order import ClosedRelation
from skillplan.checks.feasibility import PRECONDITION
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import Verdict, VerdictStatus

# So many states are considered for one skill before it is given up as undecided.
_MOST_QUERIES = 5_000

_T = TypeVar("_T")

# Yields what is queried and is sent the verdict.
CheckSteps = Generator[tuple[Skill, State], Verdict, _T]


@dataclass(frozen=True)
class Relation:
    """One component before another, and the evidence for it.

    Parameters
    ----------
    before, after
        The two components.
    reason
        Why, in words.
    evidence
        The skill that fails otherwise, the stage at which it does, and the facts.
    component
        Which of the two the skill is of.
    """

    before: str
    after: str
    reason: str
    evidence: Mapping[str, Any] = field(default_factory=dict, hash=False)
    component: str = ""


class Checker(Protocol):
    """Decides about skills in states, several at once."""

    def verdicts(self, queries: Sequence[tuple[Skill, State]], /) -> list[Verdict]:
        """Return the verdicts, in order."""


class Undecided(Exception):
    """Raised where a back end does not know, or a query does not come to an end."""


def run_queries(checker: Checker, queries: Sequence[CheckSteps[_T]]) -> list[_T | None]:
    """Return what several queries come to, all carried on at once; None of one undecided.

    Raises
    ------
    BackEndError
        If a back end fails.
    """
    found: list[_T | None] = [None] * len(queries)
    said: dict[int, Verdict | None] = dict.fromkeys(range(len(queries)))
    while said:
        requests = {}
        for index, verdict in said.items():
            query = queries[index]
            try:
                requests[index] = next(query) if verdict is None else query.send(verdict)
            except StopIteration as end:
                found[index] = end.value
            except Undecided:
                continue
        said = dict(zip(requests, checker.verdicts(list(requests.values())), strict=True))
    return found


class PrecedenceQuery:
    """What is checked of one skill of one component.

    Attributes
    ----------
    found
        What must precede and follow the component, as far as it has been worked out.
    """

    def __init__(self, hypothetical: HypotheticalStates, component: str, skill: Skill) -> None:
        self.hypothetical = hypothetical
        self.component = component
        self.skill = skill
        self.order = list(hypothetical.task.operations)
        self.count = 0
        self.found: list[Relation] = []
        self._rank = {component: i for i, component in enumerate(self.order)}
        self._feasible = Verdict.feasible()

    def check(self, done: frozenset[str]) -> CheckSteps[Verdict]:
        """Return the verdict on the skill where exactly these components are done."""
        self.count += 1
        if self.count > _MOST_QUERIES:
            raise Undecided
        verdict = yield self.skill, self.hypothetical.before(self.skill, done)
        if verdict.status is VerdictStatus.UNKNOWN:
            raise Undecided
        return verdict

    def feasible_set(
        self, done: frozenset[str] = frozenset(), undone: frozenset[str] = frozenset()
    ) -> CheckSteps[frozenset[str] | None]:
        """Return components with which done the skill is feasible, or None.

        An infeasible verdict rules out every state that agrees on its facts, so that in any
        feasible one a component it blames differs: depth-first search over which.

        Parameters
        ----------
        done, undone
            Components that must, and must not, be done.
        """
        verdict = yield from self.check(done)
        if verdict.is_feasible:
            self._feasible = verdict
            return done
        blamed = self.hypothetical.components(verdict) - {self.component} - done - undone
        for other in sorted(blamed, key=self._rank.__getitem__):
            found = yield from self.feasible_set(done | {other}, undone)
            if found is not None:
                return found
            undone |= {other}
        return None

    def relations(self, needed: frozenset[str]) -> CheckSteps[None]:
        """Find what must precede and follow the component, given the feasible set just found."""
        for fact in self.skill.precondition.forbids:
            other = self.hypothetical.owner(fact)
            if other not in (None, self.component):
                # Another component's untouched start, such as a part lying on this one.
                self._need(str(other), f"not {fact}")
        for fact in self.skill.precondition.requires:
            other = self.hypothetical.owner(fact)
            goal = None if other is None else self.hypothetical.task.operations[other]
            if other not in (None, self.component) and fact == goal:
                # Another component, finished: every state that is considered has it done.
                self._need(str(other), fact)
        verdicts: dict[str, Verdict] = {}
        feasible = self._feasible
        for other in self.order:
            done = needed ^ {other}
            # What the feasible verdict does not rest on cannot change it.
            if other == self.component or feasible.applies_in(
                self.hypothetical.before(self.skill, done)
            ):
                continue
            verdict = yield from self.check(done)
            if not verdict.is_feasible:
                verdicts[other] = verdict
        fixed = yield from self._fixed(needed, verdicts)
        for other, verdict in verdicts.items():
            if other in fixed:
                pair = (other, self.component) if other in needed else (self.component, other)
                self.found.append(self._relation(*pair, verdict))

    def _need(self, other: str, literal: str) -> None:
        """Note what the precondition needs of another component."""
        name = self.skill.name
        evidence = {"skill": name, "stage": PRECONDITION, "facts": [literal]}
        reason = f"{name} needs {literal}"
        self.found.append(Relation(other, self.component, reason, evidence, self.component))

    def _fixed(
        self, needed: frozenset[str], verdicts: Mapping[str, Verdict]
    ) -> CheckSteps[frozenset[str]]:
        """Return the components that must be as they are in a feasible set for there to be any.

        Parameters
        ----------
        needed
            The feasible set.
        verdicts
            Infeasible ones where just one component is otherwise, by that component.
        """
        blamed = {
            other: self.hypothetical.components(verdict) - {self.component, other}
            for other, verdict in verdicts.items()
        }
        fixed: frozenset[str] = frozenset()
        while blamed:
            # Where the rest of what is blamed must be as it is, nothing is left to differ.
            sure = [other for other, rest in blamed.items() if rest <= fixed]
            if not sure:
                other = next(iter(blamed))
                single = frozenset({other})
                exception = (frozenset[str](), single) if other in needed else (single, frozenset())
                possible = yield from self.feasible_set(*exception)
                sure = [other] if possible is None else []
                del blamed[other]
            for other in sure:
                blamed.pop(other, None)
            fixed |= frozenset(sure)
        return fixed

    def beyond(self, derived: ClosedRelation) -> CheckSteps[tuple[str, ...]]:
        """Return the facts that matter to the skill beyond a relation, closed under transitivity.

        Where exactly what must precede the component is done, the skill has to be feasible, and
        to stay so whatever else is done in an order that respects the relation. What a verdict
        rests on need not change it: every component that it names is tried both done and not done.
        """
        before, after = derived.before(self.component), derived.after(self.component)
        verdict = yield from self.check(before)
        if not verdict.is_feasible:
            return tuple(sorted(verdict.facts))
        settled = self.hypothetical.settled(self.skill, before, after)
        matter: dict[str, None] = {}
        yield from self._vary(before, frozenset(), verdict, settled, derived, matter)
        return (
            *(fact for fact in matter if not fact.startswith("not ")),
            *(fact for fact in matter if fact.startswith("not ")),
        )

    def _vary(
        self,
        done: frozenset[str],
        tried: frozenset[str],
        verdict: Verdict,
        settled: set[str],
        derived: ClosedRelation,
        matter: dict[str, None],
    ) -> CheckSteps[None]:
        """Try the opposite of each component that a feasible verdict names; note what matters."""
        open_facts = self._open_facts(verdict, settled)
        for fact in open_facts:
            if self.hypothetical.owner(fact.removeprefix("not ")) is None:
                matter.setdefault(fact)
        for other in sorted(
            self.hypothetical.components(verdict) - tried - done - {self.component},
            key=self._rank.__getitem__,
        ):
            named = [
                fact
                for fact in open_facts
                if self.hypothetical.owner(fact.removeprefix("not ")) == other
            ]
            if not named:
                continue
            tried |= {other}
            first = derived.before(other)
            changed = yield from self.check(done | {other} | first)
            if not changed.is_feasible:
                matter.update(dict.fromkeys(named))
            else:
                yield from self._vary(
                    done | {other} | first, tried, changed, settled, derived, matter
                )

    def _open_facts(self, verdict: Verdict, settled: set[str]) -> list[str]:
        """Return what a verdict rests on and an order leaves open."""
        present = [fact for fact in verdict.present or () if fact not in settled]
        absent = [
            fact
            for fact in verdict.absent or ()
            if fact not in settled and not self._excluded(fact)
        ]
        return [*present, *(f"not {fact}" for fact in absent)]

    def _excluded(self, fact: str) -> bool:
        """Whether the precondition leaves no room for a fact."""
        required = self.skill.precondition.requires
        return any(
            fact in group and any(other in required for other in group if other != fact)
            for group in required.facts.exclusive
        )

    def _relation(self, before: str, after: str, verdict: Verdict) -> Relation:
        evidence = {"skill": self.skill.name, "stage": verdict.stage, "facts": verdict.facts}
        return Relation(
            before, after, verdict.reason, {**evidence, **verdict.evidence}, self.component
        )
