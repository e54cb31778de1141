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
    """

    relations: tuple[Relation, ...]
    hand_made: tuple[tuple[str, str], ...] | None
    missing: tuple[tuple[str, str], ...]
    extra: tuple[Relation, ...]
    impossible: Mapping[str, str]


def derive_chart(feasibility: Feasibility) -> DerivedChart:
    """Ask back ends for the precedence relation of their task."""
    task = feasibility.task
    found: dict[tuple[str, str], Relation] = {}
    impossible: dict[str, str] = {}
    imagination = _Imagination(task)
    for element in task.operations:
        for skill in imagination.chain(element):
            for relation in _relations(feasibility, imagination, element, skill, impossible):
                found.setdefault((relation.before, relation.after), relation)
    order = list(task.operations)
    relations = tuple(
        sorted(found.values(), key=lambda r: (order.index(r.before), order.index(r.after)))
    )
    derived = closure(found)
    if not task.chart:
        return DerivedChart(relations, None, (), (), impossible)
    hand_made = tuple((line.before, line.after) for line in task.chart)
    by_hand = closure(hand_made)
    return DerivedChart(
        relations,
        hand_made,
        tuple(pair for pair in hand_made if pair not in derived),
        tuple(r for r in relations if (r.before, r.after) not in by_hand),
        impossible,
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


def _relations(
    feasibility: Feasibility,
    imagination: _Imagination,
    element: str,
    skill: Skill,
    impossible: dict[str, str],
) -> Iterable[Relation]:
    """Yield what must precede and follow `element` on account of one of its skills."""

    def ask(done: Iterable[str]) -> Verdict:
        return feasibility.rule(skill, imagination.before(skill, done))

    def relation(before: str, after: str, verdict: Verdict) -> Relation:
        evidence = {"skill": skill.name, "stage": verdict.stage, "facts": verdict.facts}
        return Relation(before, after, verdict.reason, {**evidence, **verdict.evidence})

    for fact in skill.precondition.forbids:
        other = imagination.owner(fact)
        if other not in (None, element):
            # Another element's untouched start, such as a part lying on this one.
            reason = f"{skill.name} needs not {fact}"
            evidence = {"skill": skill.name, "stage": PRECONDITION, "facts": [f"not {fact}"]}
            yield Relation(str(other), element, reason, evidence)
    needed: set[str] = set()
    in_the_way: set[str] = set()
    verdict = ask(needed)
    while not verdict.is_feasible:
        blamed = imagination.elements(verdict) - {element}
        blocking = blamed & needed
        helping = blamed - needed - in_the_way
        if blocking:
            needed -= blocking
            in_the_way |= blocking
        elif helping:
            needed |= helping
        else:
            impossible[skill.name] = f"{verdict.stage}: {verdict.reason}"
            return
        verdict = ask(needed)
    order = [other for other in imagination.task.operations if other != element]
    for other in order:
        if other in needed:
            without = ask(needed - {other})
            if not without.is_feasible:
                yield relation(other, element, without)
        else:
            beside = ask(needed | {other})
            if not beside.is_feasible:
                yield relation(element, other, beside)


class _Imagination:
    """States that need not be reachable: chosen elements done, the others untouched."""

    def __init__(self, task: Task) -> None:
        self.task = task
        self._owner = self._own_facts()

    def chain(self, element: str) -> list[Skill]:
        """Return the skills that bring one element, and no other, to its goal, in order."""
        fact = self.task.operations[element]
        skills: list[Skill] = []
        self._bring(self.task.initial, fact, skills)
        return [skill for skill in skills if element in skill.parameters.values()]

    def before(self, skill: Skill, done: Iterable[str]) -> State:
        """Return a state in which `skill` is applicable and the elements in `done` are done."""
        state = self.task.initial
        chosen = set(done)
        for element, fact in self.task.operations.items():
            if element in chosen:
                state = self._bring(state, fact, [])
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
        return {
            fact: element
            for element in self.task.operations
            for fact in self.task.facts.names
            if fact.endswith(f"({element})") and fact not in stands
        }

    def _bring(self, state: State, fact: str, skills: list[Skill], depth: int = 0) -> State:
        """Apply predicted outcomes until `fact` holds, noting the skills used."""
        if fact in state or depth > 8:
            return state
        maker = next((s for s in self.task.skills if fact in s.prediction.add), None)
        if maker is None:
            return state
        for name in maker.precondition.requires:
            state = self._bring(state, name, skills, depth + 1)
        skills.append(maker)
        return maker.prediction.apply(state)
