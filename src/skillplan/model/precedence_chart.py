"""A precedence relation derived by asking back ends, instead of drawn by hand.

For every element of the product the operations that bring it to its goal are imagined in
states in which other elements are done or not. ``a before b`` where b's operation fails for
want of a, or a's operation fails because b is in the way.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from skillplan.model.feasibility import PRECONDITION, Feasibility
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict

# So many states are imagined for one skill before it is given up as undecided.
_MOST_QUESTIONS = 5_000


@dataclass(frozen=True)
class Relation:
    """One element before another, and the evidence for it."""

    before: str
    after: str
    reason: str
    evidence: Mapping[str, Any] = field(default_factory=dict, hash=False)


@dataclass(frozen=True)
class DerivedChart:
    """What was derived, beside what was drawn by hand.

    Parameters
    ----------
    relations
        Derived, in the order of the task's elements.
    hand_made
        The task file's chart; None where it has none.
    missing
        Hand-made pairs that do not follow from the derived ones.
    extra
        Derived pairs that do not follow from the hand-made ones.
    impossible
        Skills that are feasible in no imagined state, with the reason.
    alternatives
        Skills that need some of these elements, but none of them in particular: what is no
        precedence relation.
    undecided
        Skills that depend on the other elements in too many ways to be worked out.
    """

    relations: tuple[Relation, ...]
    hand_made: tuple[tuple[str, str], ...] | None
    missing: tuple[tuple[str, str], ...]
    extra: tuple[Relation, ...]
    impossible: Mapping[str, str]
    alternatives: Mapping[str, tuple[str, ...]]
    undecided: tuple[str, ...] = ()


def derive_chart(feasibility: Feasibility) -> DerivedChart:
    """Ask back ends for the precedence relation of their task."""
    task = feasibility.task
    found: dict[tuple[str, str], Relation] = {}
    impossible: dict[str, str] = {}
    alternatives: dict[str, tuple[str, ...]] = {}
    undecided: list[str] = []
    feasible_sets: list[tuple[str, Skill, frozenset[str]]] = []
    imagination = _Imagination(task)
    for element in task.operations:
        for skill in imagination.chain(element):
            inquiry = _Inquiry(feasibility, imagination, element, skill)
            try:
                needed = inquiry.feasible_set()
                own = [] if needed is None else list(inquiry.relations(needed))
            except _TooManyQuestions:
                undecided.append(skill.name)
                continue
            if needed is None:
                verdict = inquiry.ask(frozenset())
                impossible[skill.name] = f"{verdict.stage}: {verdict.reason}"
                continue
            for relation in own:
                found.setdefault((relation.before, relation.after), relation)
            feasible_sets.append((element, skill, needed))
    for element, skill, needed in feasible_sets:
        # Also what comes first on account of another's skills, as a support that cannot be
        # put beneath what it bears.
        single = {before for before, after in found if after == element}
        if not feasibility.rule(skill, imagination.before(skill, needed & single)).is_feasible:
            alternatives[skill.name] = tuple(sorted(needed - single))
    order = list(task.operations)
    relations = tuple(
        sorted(found.values(), key=lambda r: (order.index(r.before), order.index(r.after)))
    )
    derived = closure(found)
    if not task.chart:
        return DerivedChart(relations, None, (), (), impossible, alternatives, tuple(undecided))
    hand_made = tuple((line.before, line.after) for line in task.chart)
    by_hand = closure(hand_made)
    return DerivedChart(
        relations,
        hand_made,
        tuple(pair for pair in hand_made if pair not in derived),
        tuple(r for r in relations if (r.before, r.after) not in by_hand),
        impossible,
        alternatives,
        tuple(undecided),
    )


def closure(pairs: Iterable[tuple[str, str]]) -> set[tuple[str, str]]:
    """Return the transitive closure of a relation."""
    after: dict[str, set[str]] = {}
    for one, other in pairs:
        after.setdefault(one, set()).add(other)
    closed = set()
    for start in after:
        todo, seen = list(after[start]), set()
        while todo:
            node = todo.pop()
            if node not in seen:
                seen.add(node)
                todo += after.get(node, ())
        closed |= {(start, node) for node in seen}
    return closed


def reduction(pairs: Iterable[tuple[str, str]]) -> set[tuple[str, str]]:
    """Return the pairs that do not follow from two others of the closure."""
    closed = closure(pairs)
    nodes = {node for pair in closed for node in pair}
    return {
        (one, other)
        for one, other in pairs
        if not any((one, via) in closed and (via, other) in closed for via in nodes)
    }


class _TooManyQuestions(Exception):
    """Raised where an inquiry does not come to an end."""


class _Inquiry:
    """What is asked about one skill of one element."""

    def __init__(
        self, feasibility: Feasibility, imagination: _Imagination, element: str, skill: Skill
    ) -> None:
        self.feasibility = feasibility
        self.imagination = imagination
        self.element = element
        self.skill = skill
        self.order = list(imagination.task.operations)
        self.asked = 0

    def ask(self, done: frozenset[str]) -> Verdict:
        """Return the verdict on the skill where exactly these elements are done."""
        self.asked += 1
        if self.asked > _MOST_QUESTIONS:
            raise _TooManyQuestions
        return self.feasibility.rule(self.skill, self.imagination.before(self.skill, done))

    def feasible_set(
        self, done: frozenset[str] = frozenset(), undone: frozenset[str] = frozenset()
    ) -> frozenset[str] | None:
        """Return elements with which done the skill is feasible, or None.

        An infeasible verdict rules out every state that agrees on its facts, so that in any
        feasible one an element it blames differs: depth-first search over which.

        Parameters
        ----------
        done, undone
            Elements that must, and must not, be done.
        """
        verdict = self.ask(done)
        if verdict.is_feasible:
            return done
        blamed = self.imagination.elements(verdict) - {self.element} - done - undone
        for other in sorted(blamed, key=self.order.index):
            found = self.feasible_set(done | {other}, undone)
            if found is not None:
                return found
            undone |= {other}
        return None

    def relations(self, needed: frozenset[str]) -> Iterable[Relation]:
        """Yield what must precede and follow the element, given a feasible set."""
        for fact in self.skill.precondition.forbids:
            other = self.imagination.owner(fact)
            if other not in (None, self.element):
                # Another element's untouched start, such as a part lying on this one.
                name = self.skill.name
                evidence = {"skill": name, "stage": PRECONDITION, "facts": [f"not {fact}"]}
                yield Relation(str(other), self.element, f"{name} needs not {fact}", evidence)
        for other in self.order:
            if other == self.element:
                continue
            single = frozenset({other})
            if other in needed:
                verdict = self.ask(needed - single)
                pair, exception = (other, self.element), (frozenset[str](), single)
            else:
                verdict = self.ask(needed | single)
                pair, exception = (self.element, other), (single, frozenset[str]())
            if not verdict.is_feasible and self.feasible_set(*exception) is None:
                yield self._relation(*pair, verdict)

    def _relation(self, before: str, after: str, verdict: Verdict) -> Relation:
        evidence = {"skill": self.skill.name, "stage": verdict.stage, "facts": verdict.facts}
        return Relation(before, after, verdict.reason, {**evidence, **verdict.evidence})


class _Imagination:
    """States that need not be reachable: chosen elements done, the others untouched."""

    def __init__(self, task: Task) -> None:
        self.task = task
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

    def owner(self, fact: str) -> str | None:
        """Return the element that a fact is about, or None."""
        return self._owner.get(fact)

    def elements(self, verdict: Verdict) -> set[str]:
        """Return the elements that the facts of a verdict are about."""
        facts = [*(verdict.present or ()), *(verdict.absent or ())]
        return {self._owner[fact] for fact in facts if fact in self._owner}

    def _own_facts(self) -> dict[str, str]:
        """Return the element of every fact named after one; not where the arm stands."""
        stands = {fact for robot in self.task.scene.robots for fact in robot.places}
        found = {}
        for fact in self.task.facts.names:
            element = fact.rpartition("(")[2].rstrip(")")
            if element in self.task.operations and fact not in stands:
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
