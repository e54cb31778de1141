"""States that need not be reachable, in which back ends check skills."""

from __future__ import annotations

from collections.abc import Iterable, Set

from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict


class HypotheticalStates:
    """States that need not be reachable: chosen components done, the others untouched.

    Attributes
    ----------
    stands
        The facts that say where an arm stands.
    """

    def __init__(self, task: Task) -> None:
        self.task = task
        self.stands = {fact for robot in task.scene.robots for fact in robot.places}
        self._owner = self._own_facts()
        self._own: dict[str, list[str]] = {}
        for fact, component in self._owner.items():
            self._own.setdefault(component, []).append(fact)
        self._makers: dict[str, list[Skill]] = {}
        for skill in task.skills:
            for fact in skill.prediction.add:
                self._makers.setdefault(fact, []).append(skill)
        self._finished = self._finished_facts()

    def chain(self, component: str) -> list[Skill]:
        """Return the skills that bring one component, and no other, to its goal, in order."""
        fact = self.task.operations[component]
        skills: list[Skill] = []
        self._bring(self.task.initial, fact, skills)
        return [skill for skill in skills if component in skill.parameters.values()]

    def before(self, skill: Skill, done: Iterable[str]) -> State:
        """Return a state in which `skill` is applicable and the components in `done` are done."""
        bits = self.task.initial.bits
        for component in done:
            own, after = self._finished[component]
            bits = bits & ~own | after
        state = self.task.facts.state(bits)
        for name in skill.precondition.requires:
            state = self._bring(state, name, [])
        # What the skill forbids, such as a part lying on it, is taken away.
        return state - skill.precondition.forbids

    def settled(self, skill: Skill, before: Iterable[str], after: Iterable[str]) -> set[str]:
        """Return the facts that are certain where a skill is applicable in a good order."""
        certain = {*skill.precondition.requires, *skill.precondition.forbids}
        return certain.union(*(self._own.get(component, ()) for component in {*before, *after}))

    def owner(self, fact: str) -> str | None:
        """Return the component that a fact is about, or None."""
        return self._owner.get(fact)

    def dependence(self, fact: str) -> str:
        """Return the kind of thing that a fact states, for "depends on ..."."""
        if fact in self.stands:
            return "where the arm comes from"
        if fact in self._owner:
            return "which other parts are in place"
        return "the tool or the hand"

    def component(self, skill: Skill) -> str | None:
        """Return the component that a skill moves or fastens, or None."""
        operations = self.task.operations
        return next((name for name in skill.parameters.values() if name in operations), None)

    def components(self, verdict: Verdict) -> set[str]:
        """Return the components that the facts of a verdict are about."""
        facts = [*(verdict.present or ()), *(verdict.absent or ())]
        return {self._owner[fact] for fact in facts if fact in self._owner}

    def reason(self, verdict: Verdict, component: str | None, in_place: Set[str]) -> str:
        """Return a verdict's stage and reason, with the other components in place if they matter.

        Parameters
        ----------
        verdict
            Of a skill of `component`.
        component
            The component that the skill moves or fastens; None for none.
        in_place
            The components that are in place in the state of the verdict.
        """
        text = f"{verdict.stage}: {verdict.reason}"
        if not (self.components(verdict) - {component}) or not in_place - {component}:
            return text
        others = self.task.operations.keys() - {component}
        if in_place >= others:
            return f"{text} (with everything else in place)"
        return f"{text} (with {' and '.join(sorted(in_place - {component}))} in place)"

    def _own_facts(self) -> dict[str, str]:
        """Return the component of every fact named after one; not where the arm stands."""
        found = {}
        for fact in self.task.facts.names:
            component = fact.rpartition("(")[2].rstrip(")")
            if component in self.task.operations and fact not in self.stands:
                found[fact] = component
        return found

    def _finished_facts(self) -> dict[str, tuple[int, int]]:
        """Return, by component, the bits of its own facts and those of them that hold when done."""
        own = dict.fromkeys(self.task.operations, 0)
        for fact, component in self._owner.items():
            own[component] |= self.task.facts.bit(fact)
        return {
            component: (mask, self._bring(self.task.initial, goal, []).bits & mask)
            for (component, goal), mask in zip(
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
        maker = makers[0]
        if len(makers) > 1:
            maker = min(makers, key=lambda s: len(s.precondition.requires - state))
        for name in maker.precondition.requires - state:
            state = self._bring(state, name, skills, depth + 1)
        skills.append(maker)
        return maker.prediction.apply(state)


def state_with_all_else(task: Task, skill: Skill) -> State:
    """Return a state before a skill in which every component but its own is at its goal."""
    hypothetical = HypotheticalStates(task)
    return hypothetical.before(skill, task.operations.keys() - {hypothetical.component(skill)})
