"""Hypothetical states, which need not be reachable, for checks of skills."""

from __future__ import annotations

from collections.abc import Iterable, Set

from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict


class HypotheticalStates:
    """Hypothetical states: some components are done, the others are untouched.

    Attributes
    ----------
    stands
        Facts for the places of arms.
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
        # A part that a holder may keep is taken as held: an order that holds nevertheless is true.
        self._held = task.facts.of(
            *(fact for holder in task.scene.holders for fact in holder.facts.values())
        )

    def chain(self, component: str) -> list[Skill]:
        """Return the skills that bring only one component to its goal, in order."""
        fact = self.task.operations[component]
        skills: list[Skill] = []
        self._bring(self.task.initial, fact, skills)
        return [skill for skill in skills if component in skill.parameters.values()]

    def before(self, skill: Skill, done: Iterable[str]) -> State:
        """Return a state in which `skill` is applicable and exactly some components are done."""
        bits = self.task.initial.bits
        for component in done:
            own, after = self._finished[component]
            bits = bits & ~own | after
        untouched = state = self.task.facts.state(bits)
        required = list(skill.precondition.requires)
        for name in required:
            state = self._bring(state, name, [])
        if not all(name in state for name in required):
            # Another fact took the hand or the tool: own facts, such as the held part, come last.
            owner = self.component(skill)
            required.sort(key=lambda name: self._owner.get(name) == owner)
            state = untouched
            for name in required * 2:
                state = self._bring(state, name, [])
        routes = () if skill.motion is None else skill.motion.routes
        if routes and not any(all(fact in state for fact in route.when) for route in routes):
            # The first route stands for all, such as the first grasp of a part.
            for name in routes[0].when:
                state = self._bring(state, name, [])
        # Facts that the skill forbids, such as a part on it, are removed.
        return (state | self._held) - skill.precondition.forbids

    def bring(self, state: State, component: str) -> tuple[State, list[Skill]]:
        """Return the state after a component is brought to its goal, and the skills for it."""
        return self.reach(state, self.task.operations[component])

    def reach(self, state: State, fact: str) -> tuple[State, list[Skill]]:
        """Return a state in which a fact holds, and the skills that lead there."""
        skills: list[Skill] = []
        return self._bring(state, fact, skills), skills

    def settled(self, skill: Skill, before: Iterable[str], after: Iterable[str]) -> set[str]:
        """Return the facts that hold before a skill in every order that respects it."""
        certain = {*skill.precondition.requires, *skill.precondition.forbids}
        return certain.union(*(self._own.get(component, ()) for component in {*before, *after}))

    def owner(self, fact: str) -> str | None:
        """Return the component of a fact, or None."""
        return self._owner.get(fact)

    def dependence(self, fact: str) -> str:
        """Return the kind of a fact, for "depends on ..."."""
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
        """Return the components that a verdict rests on."""
        facts = [*(verdict.present or ()), *(verdict.absent or ())]
        return {self._owner[fact] for fact in facts if fact in self._owner}

    def reason(self, verdict: Verdict, component: str | None, in_place: Set[str]) -> str:
        """Return stage and reason of a verdict, and the other components in place if they matter.

        Parameters
        ----------
        verdict
            Verdict on a skill of `component`.
        component
            Component that the skill moves or fastens, or None.
        in_place
            Components in place in the state of the verdict.
        """
        text = f"{verdict.stage}: {verdict.reason}"
        if not (self.components(verdict) - {component}) or not in_place - {component}:
            return text
        others = self.task.operations.keys() - {component}
        if in_place >= others:
            return f"{text} (with everything else in place)"
        return f"{text} (with {' and '.join(sorted(in_place - {component}))} in place)"

    def _own_facts(self) -> dict[str, str]:
        """Return the component of every fact named after one, without places of arms."""
        owners = {}
        for fact in self.task.facts.names:
            component = fact.rpartition("(")[2].rstrip(")")
            if component not in self.task.operations:
                # Such as the buffer or the grasp of a part.
                component = component.partition(".")[0]
            if component in self.task.operations and fact not in self.stands:
                owners[fact] = component
        return owners

    def _finished_facts(self) -> dict[str, tuple[int, int]]:
        """Return the bits of each component's own facts, and of those true when it is done."""
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
        """Apply predicted outcomes until `fact` holds, and collect the skills."""
        if fact in state or depth > 8:
            return state
        makers = self._makers.get(fact)
        if not makers:
            return state
        # If several skills add it, such as for an empty tool holder, the one with the fewest
        # missing facts.
        maker = makers[0]
        if len(makers) > 1:
            maker = min(makers, key=lambda s: len(s.precondition.requires - state))
        # What one needs, such as a tool, may take away what another brought.
        for _ in range(2):
            for name in maker.precondition.requires - state:
                state = self._bring(state, name, skills, depth + 1)
        skills.append(maker)
        return maker.prediction.apply(state)


def find_state_with_all_else(task: Task, skill: Skill) -> State:
    """Return a state before a skill in which all other components are at their goals."""
    hypothetical = HypotheticalStates(task)
    return hypothetical.before(skill, task.operations.keys() - {hypothetical.component(skill)})
