"""What back ends say of one skill in states that need not be reachable."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

from skillplan.model.feasibility import PRECONDITION, Feasibility
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict, VerdictStatus

# So many states are imagined for one skill before it is given up as undecided.
_MOST_QUESTIONS = 5_000

_T = TypeVar("_T")

# Yields what is asked and is sent the verdict.
Questions = Generator[tuple[Skill, State], Verdict, _T]


@dataclass(frozen=True)
class Relation:
    """One element before another, and the evidence for it."""

    before: str
    after: str
    reason: str
    evidence: Mapping[str, Any] = field(default_factory=dict, hash=False)


class Undecided(Exception):
    """Raised where a back end does not know, or an inquiry does not come to an end."""


def inquire(feasibility: Feasibility, inquiries: Sequence[Questions[_T]]) -> list[_T | None]:
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
        said = dict(zip(asked, feasibility.rule_all(list(asked.values())), strict=True))
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
            return done
        blamed = self.imagination.elements(verdict) - {self.element} - done - undone
        for other in sorted(blamed, key=self.order.index):
            found = yield from self.feasible_set(done | {other}, undone)
            if found is not None:
                return found
            undone |= {other}
        return None

    def relations(self, needed: frozenset[str]) -> Questions[None]:
        """Find what must precede and follow the element, given a feasible set."""
        for fact in self.skill.precondition.forbids:
            other = self.imagination.owner(fact)
            if other not in (None, self.element):
                # Another element's untouched start, such as a part lying on this one.
                name = self.skill.name
                evidence = {"skill": name, "stage": PRECONDITION, "facts": [f"not {fact}"]}
                reason = f"{name} needs not {fact}"
                self.found.append(Relation(str(other), self.element, reason, evidence))
        for other in self.order:
            if other == self.element:
                continue
            single = frozenset({other})
            if other in needed:
                verdict = yield from self.ask(needed - single)
                pair, exception = (other, self.element), (frozenset[str](), single)
            else:
                verdict = yield from self.ask(needed | single)
                pair, exception = (self.element, other), (single, frozenset[str]())
            if not verdict.is_feasible:
                possible = yield from self.feasible_set(*exception)
                if possible is None:
                    self.found.append(self._relation(*pair, verdict))

    def beyond(self, derived: set[tuple[str, str]]) -> Questions[tuple[str, ...]]:
        """Return the facts that matter to the skill beyond a relation, closed under transitivity.

        Where exactly what must precede the element is done, the skill has to be feasible, and
        to stay so whatever else is done in an order that respects the relation. What a verdict
        rests on need not change it: every element that it names is tried both ways.
        """
        before = frozenset(one for one, other in derived if other == self.element)
        after = {other for one, other in derived if one == self.element}
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
        derived: set[tuple[str, str]],
        matter: dict[str, None],
    ) -> Questions[None]:
        """Try each element that a feasible verdict names the other way; note what changes it."""
        open_facts = self._open_facts(verdict, settled)
        for fact in open_facts:
            if self.imagination.owner(fact.removeprefix("not ")) is None:
                matter.setdefault(fact)
        for other in sorted(
            self.imagination.elements(verdict) - tried - done - {self.element},
            key=self.order.index,
        ):
            named = [
                fact
                for fact in open_facts
                if self.imagination.owner(fact.removeprefix("not ")) == other
            ]
            if not named:
                continue
            tried |= {other}
            first = {one for one, another in derived if another == other}
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
        return Relation(before, after, verdict.reason, {**evidence, **verdict.evidence})


class Imagination:
    """States that need not be reachable: chosen elements done, the others untouched.

    Attributes
    ----------
    stands
        The facts that say where an arm stands.
    """

    def __init__(self, task: Task) -> None:
        self.task = task
        self.stands = {fact for robot in task.scene.robots for fact in robot.places}
        self._owner = self._own_facts()
        self._makers: dict[str, list[Skill]] = {}
        for skill in task.skills:
            for fact in skill.prediction.add:
                self._makers.setdefault(fact, []).append(skill)
        self._finished = self._finished_facts()

    def chain(self, element: str) -> list[Skill]:
        """Return the skills that bring one element, and no other, to its goal, in order."""
        fact = self.task.operations[element]
        skills: list[Skill] = []
        self._bring(self.task.initial, fact, skills)
        return [skill for skill in skills if element in skill.parameters.values()]

    def before(self, skill: Skill, done: Iterable[str]) -> State:
        """Return a state in which `skill` is applicable and the elements in `done` are done."""
        bits = self.task.initial.bits
        for element in done:
            own, after = self._finished[element]
            bits = bits & ~own | after
        state = self.task.facts.state(bits)
        for name in skill.precondition.requires:
            state = self._bring(state, name, [])
        # What the skill forbids, such as a part lying on it, is taken away.
        return state - skill.precondition.forbids

    def settled(self, skill: Skill, before: Iterable[str], after: Iterable[str]) -> set[str]:
        """Return the facts that are certain where a skill is applicable in a good order."""
        certain = {*skill.precondition.requires, *skill.precondition.forbids}
        elements = {*before, *after}
        return certain | {fact for fact, owner in self._owner.items() if owner in elements}

    def owner(self, fact: str) -> str | None:
        """Return the element that a fact is about, or None."""
        return self._owner.get(fact)

    def elements(self, verdict: Verdict) -> set[str]:
        """Return the elements that the facts of a verdict are about."""
        facts = [*(verdict.present or ()), *(verdict.absent or ())]
        return {self._owner[fact] for fact in facts if fact in self._owner}

    def _own_facts(self) -> dict[str, str]:
        """Return the element of every fact named after one; not where the arm stands."""
        found = {}
        for fact in self.task.facts.names:
            element = fact.rpartition("(")[2].rstrip(")")
            if element in self.task.operations and fact not in self.stands:
                found[fact] = element
        return found

    def _finished_facts(self) -> dict[str, tuple[int, int]]:
        """Return, by element, the bits of its own facts and those of them that hold when done."""
        own = dict.fromkeys(self.task.operations, 0)
        for fact, element in self._owner.items():
            own[element] |= self.task.facts.bit(fact)
        return {
            element: (mask, self._bring(self.task.initial, goal, []).bits & mask)
            for (element, goal), mask in zip(
                self.task.operations.items(), own.values(), strict=True
            )
        }

    def _bring(self, state: State, fact: str, skills: list[Skill], depth: int = 0) -> State:
        """Apply predicted outcomes until `fact` holds, noting the skills used."""
        if fact in state or depth > 8:
            return state
        makers = self._makers.get(fact)
        if not makers:
            return state
        # Of several, as for an empty tool holder, the one that lacks the least here.
        maker = min(makers, key=lambda s: len(s.precondition.requires - state))
        for name in maker.precondition.requires:
            state = self._bring(state, name, skills, depth + 1)
        skills.append(maker)
        return maker.prediction.apply(state)
