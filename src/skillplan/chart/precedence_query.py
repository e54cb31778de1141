"""Queries about a skill in hypothetical states."""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

from skillplan.chart.hypothetical_state import HypotheticalStates
from skillplan.chart.partial_order import ClosedRelation
from skillplan.checks.feasibility import PRECONDITION
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import Verdict, VerdictStatus

# Greatest number of states checked for a skill before it is undecided.
_MOST_QUERIES = 5_000

_T = TypeVar("_T")

# A generator that yields queries and receives their verdicts.
CheckSteps = Generator[tuple[Skill, State], Verdict, _T]


@dataclass(frozen=True)
class Relation:
    """A precedence between two components, and its evidence.

    Parameters
    ----------
    evidence
        Skill that fails otherwise, stage at which it fails, and facts.
    """

    before: str
    after: str
    reason: str
    evidence: Mapping[str, Any] = field(default_factory=dict, hash=False)
    component: str = ""


class Checker(Protocol):
    """Returns the verdicts on several skills in states."""

    def verdicts(self, queries: Sequence[tuple[Skill, State]], /) -> list[Verdict]:
        """Return the verdicts, in order."""


class Undecided(Exception):
    """Raised if a back end cannot decide, or a query takes too many checks."""


def run_queries(
    checker: Checker,
    queries: Sequence[CheckSteps[_T]],
    must_stop: Callable[[], bool] = lambda: False,
) -> list[_T | None]:
    """Return the results of several queries, run side by side; None for an undecided one.

    Queries that a stop comes before are undecided.

    Raises
    ------
    BackEndError
        If a back end fails.
    """
    results: list[_T | None] = [None] * len(queries)
    answers: dict[int, Verdict | None] = dict.fromkeys(range(len(queries)))
    while answers and not must_stop():
        requests = {}
        for index, verdict in answers.items():
            query = queries[index]
            try:
                requests[index] = next(query) if verdict is None else query.send(verdict)
            except StopIteration as end:
                results[index] = end.value
            except Undecided:
                continue
        answers = dict(zip(requests, checker.verdicts(list(requests.values())), strict=True))
    return results


class PrecedenceQuery:
    """A query about one skill of one component."""

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
        """Return the verdict on the skill if exactly some components are done."""
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
        """Return a set of done components with which the skill is feasible, or None.

        An infeasible verdict rules out all states that agree on its facts. Feasible states differ
        in a component that it names: depth-first search over them.

        Parameters
        ----------
        done, undone
            Components that are fixed as done, and as not done.
        """
        verdict = yield from self.check(done)
        if verdict.is_feasible:
            self._feasible = verdict
            return done
        blamed = self.hypothetical.components(verdict) - {self.component} - done - undone
        for other in sorted(blamed, key=self._rank.__getitem__):
            feasible = yield from self.feasible_set(done | {other}, undone)
            if feasible is not None:
                return feasible
            undone |= {other}
        return None

    def relations(self, needed: frozenset[str]) -> CheckSteps[None]:
        """Add the components that must precede and follow, given a feasible set."""
        for fact in self.skill.precondition.forbids:
            other = self.hypothetical.owner(fact)
            if other not in (None, self.component):
                # The start of another component, such as a part that lies on this one.
                self._need(str(other), f"not {fact}")
        for fact in self.skill.precondition.requires:
            other = self.hypothetical.owner(fact)
            goal = None if other is None else self.hypothetical.task.operations[other]
            if other not in (None, self.component) and fact == goal:
                # Another finished component: it is done in all states that are checked.
                self._need(str(other), fact)
        verdicts: dict[str, Verdict] = {}
        feasible = self._feasible
        for other in self.order:
            done = needed ^ {other}
            # Components that the feasible verdict does not name cannot change it.
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
        """Add the relation that a precondition imposes on another component."""
        name = self.skill.name
        evidence = {"skill": name, "stage": PRECONDITION, "facts": [literal]}
        reason = f"{name} needs {literal}"
        self.found.append(Relation(other, self.component, reason, evidence, self.component))

    def _fixed(
        self, needed: frozenset[str], verdicts: Mapping[str, Verdict]
    ) -> CheckSteps[frozenset[str]]:
        """Return the components of a feasible set that no feasible set can change.

        Parameters
        ----------
        needed
            A feasible set.
        verdicts
            Infeasible verdicts after a change of one component, by component.
        """
        blamed = {
            other: self.hypothetical.components(verdict) - {self.component, other}
            for other, verdict in verdicts.items()
        }
        fixed: frozenset[str] = frozenset()
        while blamed:
            # If all other named components are fixed, none is left to differ.
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
        """Return the facts that a skill depends on beyond a relation, which must be transitive.

        With exactly the predecessors done, the skill must be feasible, and remain so in every order
        that respects the relation. A verdict need not change with a component that it names, so
        each is checked both done and not done.
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
        """Change each component that a feasible verdict names, and collect the relevant facts."""
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
        """Return the facts of a verdict that an order leaves open."""
        present = [fact for fact in verdict.present or () if fact not in settled]
        absent = [
            fact
            for fact in verdict.absent or ()
            if fact not in settled and not self._excluded(fact)
        ]
        return [*present, *(f"not {fact}" for fact in absent)]

    def _excluded(self, fact: str) -> bool:
        """Return whether the precondition determines a fact."""
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
