"""What back ends say of one skill in states that need not be reachable."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

from skillplan.chart.hypothetical_state import Imagination
from skillplan.chart.partial_order import ClosedRelation
from skillplan.checks.feasibility import PRECONDITION
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import Verdict, VerdictStatus

# So many states are imagined for one skill before it is given up as undecided.
_MOST_QUESTIONS = 5_000

_T = TypeVar("_T")

# Yields what is asked and is sent the verdict.
Questions = Generator[tuple[Skill, State], Verdict, _T]


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


class Ruler(Protocol):
    """Rules on skills in states, several at once."""

    def rule_all(self, questions: Sequence[tuple[Skill, State]], /) -> list[Verdict]:
        """Return the verdicts, in order."""


class Undecided(Exception):
    """Raised where a back end does not know, or an inquiry does not come to an end."""


def inquire(ruler: Ruler, inquiries: Sequence[Questions[_T]]) -> list[_T | None]:
    """Return what several inquiries come to, all carried on at once; None of one undecided.

    Raises
    ------
    BackEndError
        If a back end fails.
    """
    found: list[_T | None] = [None] * len(inquiries)
    said: dict[int, Verdict | None] = dict.fromkeys(range(len(inquiries)))
    while said:
        asked = {}
        for index, verdict in said.items():
            inquiry = inquiries[index]
            try:
                asked[index] = next(inquiry) if verdict is None else inquiry.send(verdict)
            except StopIteration as end:
                found[index] = end.value
            except Undecided:
                continue
        said = dict(zip(asked, ruler.rule_all(list(asked.values())), strict=True))
    return found


class Inquiry:
    """What is asked about one skill of one element.

    Attributes
    ----------
    found
        What must precede and follow the element, as far as it has been worked out.
    """

    def __init__(self, imagination: Imagination, element: str, skill: Skill) -> None:
        self.imagination = imagination
        self.element = element
        self.skill = skill
        self.order = list(imagination.task.operations)
        self.asked = 0
        self.found: list[Relation] = []
        self._rank = {element: i for i, element in enumerate(self.order)}
        self._feasible = Verdict.feasible()

    def ask(self, done: frozenset[str]) -> Questions[Verdict]:
        """Return the verdict on the skill where exactly these elements are done."""
        self.asked += 1
        if self.asked > _MOST_QUESTIONS:
            raise Undecided
        verdict = yield self.skill, self.imagination.before(self.skill, done)
        if verdict.status is VerdictStatus.UNKNOWN:
            raise Undecided
        return verdict

    def feasible_set(
        self, done: frozenset[str] = frozenset(), undone: frozenset[str] = frozenset()
    ) -> Questions[frozenset[str] | None]:
        """Return elements with which done the skill is feasible, or None.

        An infeasible verdict rules out every state that agrees on its facts, so that in any
        feasible one an element it blames differs: depth-first search over which.

        Parameters
        ----------
        done, undone
            Elements that must, and must not, be done.
        """
        verdict = yield from self.ask(done)
        if verdict.is_feasible:
            self._feasible = verdict
            return done
        blamed = self.imagination.elements(verdict) - {self.element} - done - undone
        for other in sorted(blamed, key=self._rank.__getitem__):
            found = yield from self.feasible_set(done | {other}, undone)
            if found is not None:
                return found
            undone |= {other}
        return None

    def relations(self, needed: frozenset[str]) -> Questions[None]:
        """Find what must precede and follow the element, given the feasible set just found."""
        for fact in self.skill.precondition.forbids:
            other = self.imagination.owner(fact)
            if other not in (None, self.element):
                # Another element's untouched start, such as a part lying on this one.
                self._need(str(other), f"not {fact}")
        for fact in self.skill.precondition.requires:
            other = self.imagination.owner(fact)
            goal = None if other is None else self.imagination.task.operations[other]
            if other not in (None, self.element) and fact == goal:
                # Another element, finished: every state that is imagined has it done.
                self._need(str(other), fact)
        verdicts: dict[str, Verdict] = {}
        feasible = self._feasible
        for other in self.order:
            done = needed ^ {other}
            # What the feasible verdict does not rest on cannot change it.
            if other == self.element or feasible.applies_in(
                self.imagination.before(self.skill, done)
            ):
                continue
            verdict = yield from self.ask(done)
            if not verdict.is_feasible:
                verdicts[other] = verdict
        fixed = yield from self._fixed(needed, verdicts)
        for other, verdict in verdicts.items():
            if other in fixed:
                pair = (other, self.element) if other in needed else (self.element, other)
                self.found.append(self._relation(*pair, verdict))

    def _need(self, other: str, literal: str) -> None:
        """Note what the precondition needs of another component."""
        name = self.skill.name
        evidence = {"skill": name, "stage": PRECONDITION, "facts": [literal]}
        reason = f"{name} needs {literal}"
        self.found.append(Relation(other, self.element, reason, evidence, self.element))

    def _fixed(
        self, needed: frozenset[str], verdicts: Mapping[str, Verdict]
    ) -> Questions[frozenset[str]]:
        """Return the elements that must be as they are in a feasible set for there to be any.

        Parameters
        ----------
        needed
            The feasible set.
        verdicts
            Infeasible ones where just one element is otherwise, by that element.
        """
        blamed = {
            other: self.imagination.elements(verdict) - {self.element, other}
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

    def beyond(self, derived: ClosedRelation) -> Questions[tuple[str, ...]]:
        """Return the facts that matter to the skill beyond a relation, closed under transitivity.

        Where exactly what must precede the element is done, the skill has to be feasible, and
        to stay so whatever else is done in an order that respects the relation. What a verdict
        rests on need not change it: every element that it names is tried both ways.
        """
        before, after = derived.before(self.element), derived.after(self.element)
        verdict = yield from self.ask(before)
        if not verdict.is_feasible:
            return tuple(sorted(verdict.facts))
        settled = self.imagination.settled(self.skill, before, after)
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
    ) -> Questions[None]:
        """Try each element that a feasible verdict names the other way; note what changes it."""
        open_facts = self._open_facts(verdict, settled)
        for fact in open_facts:
            if self.imagination.owner(fact.removeprefix("not ")) is None:
                matter.setdefault(fact)
        for other in sorted(
            self.imagination.elements(verdict) - tried - done - {self.element},
            key=self._rank.__getitem__,
        ):
            named = [
                fact
                for fact in open_facts
                if self.imagination.owner(fact.removeprefix("not ")) == other
            ]
            if not named:
                continue
            tried |= {other}
            first = derived.before(other)
            changed = yield from self.ask(done | {other} | first)
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
            before, after, verdict.reason, {**evidence, **verdict.evidence}, self.element
        )
