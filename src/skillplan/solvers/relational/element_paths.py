"""How each element of a product can be come to from a state, and at what cost.

All of it is read from the task: preconditions, predicted outcomes and costs. No back end is
queried.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from skillplan.errors import OptionError
from skillplan.model.fact_analysis import CostBasis, effects, named_bits
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task

# More skills than this never lie between two elements: a tool is put away, another is fetched.
_MOST_BETWEEN = 3
# Ways are kept for so many situations.
_MOST_KEPT = 20_000


@dataclass(frozen=True, slots=True)
class Way:
    """How an element is come to, up to and with its own next skill.

    Parameters
    ----------
    first
        The skill to begin with: one that comes between, such as a tool change, or its own.
    between
        How many skills come between.
    cost
        Of all of them and of the element's own next skill, in the task's metric.
    """

    first: str
    between: int
    cost: float


class ElementPaths:
    """The ways to the elements of a task, from any of its states.

    Parameters
    ----------
    task
        One whose operations are components that a robot brings to their goals.

    Attributes
    ----------
    elements
        Names of the components, in the order of the task.
    goals
        Bit of the fact that each is brought about by, in that order.
    own
        Bits of the facts about each.

    Raises
    ------
    OptionError
        If the task has none, several robots, or skills that depend on more than facts.
    """

    def __init__(self, task: Task) -> None:
        _check(task)
        self.task = task
        self.elements = tuple(task.operations)
        named = named_bits(task)
        self.own = tuple(named.get(one, 0) for one in self.elements)
        self.goals = tuple(task.facts.bit(fact) for fact in task.operations.values())
        self._skills: dict[str, list[Skill]] = {one: [] for one in self.elements}
        self._between: list[Skill] = []
        for skill in task.skills:
            owner = self.owner(skill)
            (self._between if owner is None else self._skills[owner]).append(skill)
        places = {fact for robot in task.scene.robots for fact in robot.places}
        moved = 0
        for fact in places:
            moved |= task.facts.bit(fact)
        self._free = moved
        for skill in self._between:
            self._free |= effects(skill)
        self._situation = self._free | self._read_bits()
        self._ends: dict[int, dict[int, tuple[str, int, float]]] = {}
        self._ways: dict[tuple[int, str], Way | None] = {}

    def owner(self, skill: Skill) -> str | None:
        """Return the element that a skill moves or fastens; None of one that comes between."""
        values = skill.parameters.values()
        return next((one for one in values if one in self.task.operations), None)

    def next_skill(self, element: int, bits: int) -> Skill | None:
        """Return the skill that an element waits for; None where it waits for something else.

        Its precondition holds but for what skills between can change, such as the tool.
        """
        kept = ~self._free
        for skill in self._skills[self.elements[element]]:
            needs, bars = skill.precondition.requires.bits, skill.precondition.forbids.bits
            if bits & needs & kept == needs & kept and not bits & bars & kept:
                return skill
        return None

    def first_skill(self, element: int, bits: int) -> Skill | None:
        """Return the skill that begins an element, whatever else it waits for.

        Only the facts about the element itself are looked at; None where it is done.
        """
        own = self.own[element]
        if bits & self.goals[element]:
            return None
        for skill in self._skills[self.elements[element]]:
            needs, bars = skill.precondition.requires.bits, skill.precondition.forbids.bits
            if bits & needs & own == needs & own and not bits & bars & own:
                return skill
        return None

    def way(self, skill: Skill, bits: int) -> Way | None:
        """Return how a skill of an element is come to from a state; None where it cannot be."""
        key = bits & self._situation, skill.name
        if key not in self._ways:
            if len(self._ways) >= _MOST_KEPT:
                self._ways.clear()
            self._ways[key] = self._found_way(skill, bits)
        return self._ways[key]

    def needed_of(self, skill: Skill) -> int:
        """Return the bits that a skill needs of what skills between change: its tool."""
        return skill.precondition.requires.bits & self._free

    def finish(self, element: int, skill: Skill, bits: int) -> tuple[float, int]:
        """Return the cost of all skills of an element after one, and the bits when it is done."""
        bits = self._bits_before(skill, bits)
        bits = _after(skill, bits)
        cost = 0.0
        for _ in self._skills[self.elements[element]]:
            if bits & self.goals[element]:
                break
            following = self.first_skill(element, bits)
            if following is None:
                break
            cost += self._cost(following, bits)
            bits = _after(following, bits)
        return cost, bits

    def _bits_before(self, skill: Skill, bits: int) -> int:
        """Return the bits of a state after what comes between it and a skill."""
        for end in self._reach(bits):
            if self._fits(skill, end):
                return bits & ~self._situation | end & self._situation
        return bits

    def _found_way(self, skill: Skill, bits: int) -> Way | None:
        for end, (first, between, cost) in self._reach(bits).items():
            if self._fits(skill, end):
                total = cost + self._cost(skill, end)
                return Way(first or skill.name, between, total)
        return None

    def _fits(self, skill: Skill, bits: int) -> bool:
        needs, bars = skill.precondition.requires.bits, skill.precondition.forbids.bits
        free = self._free
        return bits & needs & free == needs & free and not bits & bars & free

    def _reach(self, bits: int) -> Mapping[int, tuple[str, int, float]]:
        """Return what skills between lead to: first skill, how many, cost; the nearest first."""
        key = bits & self._situation
        found = self._ends.get(key)
        if found is None:
            if len(self._ends) >= _MOST_KEPT:
                self._ends.clear()
            found = self._ends[key] = self._explored(key)
        return found

    def _explored(self, start: int) -> dict[int, tuple[str, int, float]]:
        found = {start: ("", 0, 0.0)}
        level = [start]
        for count in range(1, _MOST_BETWEEN + 1):
            following = []
            for bits in level:
                first, _, cost = found[bits]
                for skill in self._between:
                    if not skill.precondition.holds(State(bits, self.task.facts)):
                        continue
                    end = _after(skill, bits)
                    total = cost + self._cost(skill, bits)
                    if end in found and found[end][2] <= total:
                        continue
                    if end not in found:
                        following.append(end)
                    found[end] = (first or skill.name, count, total)
            level = following
        return dict(sorted(found.items(), key=lambda one: one[1][1:3]))

    def _cost(self, skill: Skill, bits: int) -> float:
        return skill.cost.at(State(bits, self.task.facts))

    def _read_bits(self) -> int:
        basis, read = CostBasis(), 0
        for skill in self.task.skills:
            bits = basis.bits(skill.cost)
            if bits is None or skill.cases:
                raise OptionError(_refusal(self.task, f"what {skill.name} costs or brings about"))
            read |= bits
        for skill in self._between:
            read |= skill.precondition.requires.bits | skill.precondition.forbids.bits
        return read


def _after(skill: Skill, bits: int) -> int:
    outcome = skill.prediction
    return bits & ~outcome.delete.bits | outcome.add.bits


def _check(task: Task) -> None:
    if not task.operations:
        raise OptionError(_refusal(task, "no components to be brought to their goals"))
    if len(task.scene.robots) != 1:
        raise OptionError(_refusal(task, f"{len(task.scene.robots)} robots"))


def _refusal(task: Task, what: str) -> str:
    return (
        f"A relational policy cannot act on {task.name}: it has {what}. It acts on assembly "
        "tasks of one robot; 'skillplan search-optimal' plans others."
    )
