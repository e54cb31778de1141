"""The elements of a product as a relational policy sees them, one by one and in pairs.

An element is a component that has to be brought to its goal, such as a part or a screw.
`ElementPaths` finds the skills and the cost by which a robot reaches each element,
`ElementOrder` holds the precedence relation, and `ElementView` turns both into features. Features
are counts and comparisons, never names or list positions, so that the order and the number of
elements do not matter.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan.chart.partial_order import closure
from skillplan.chart.precedence_chart import DerivedChart, derive_chart
from skillplan.errors import OptionError
from skillplan.model.fact_analysis import CostBasis, effects, map_named_bits
from skillplan.model.skill_model import SkillModel
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task

Figures = NDArray[np.float32]

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
        named = map_named_bits(task)
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


@dataclass(frozen=True)
class ElementOrder:
    """Precedence of the n elements of a task.

    Parameters
    ----------
    before
        Whether the one comes before the other in every order, shape (n, n); closed.
    choices
        By element what an order chooses from: pairs of bits over elements, of those that must be
        done when it is, and of those that must not.
    """

    before: NDArray[np.bool_]
    choices: tuple[tuple[int, tuple[tuple[int, int], ...]], ...] = ()

    @classmethod
    def of(cls, model: SkillModel) -> ElementOrder:
        """Return what the back ends of a model say.

        Raises
        ------
        BackEndError
            If a back end fails.
        """
        return cls.from_chart(tuple(model.task.operations), derive_chart(model.feasibility))

    @classmethod
    def from_chart(cls, elements: Sequence[str], chart: DerivedChart) -> ElementOrder:
        """Return what a derived chart says of elements in an order."""
        index = {name: i for i, name in enumerate(elements)}
        before = np.zeros((len(elements), len(elements)), dtype=np.bool_)
        for one, other in closure((r.before, r.after) for r in chart.relations):
            before[index[one], index[other]] = True
        choices = []
        for choice in chart.alternatives:
            own = index[choice.component]
            groups = []
            for pairs in choice.any_of:
                done = sum(1 << index[a] for a, b in pairs if index[b] == own)
                undone = sum(1 << index[b] for a, b in pairs if index[a] == own)
                groups.append((done, undone))
            choices.append((own, tuple(groups)))
        return cls(before, tuple(choices))

    def after(self, done: int) -> NDArray[np.bool_]:
        """Return what comes before what once some are done, shape (n, n).

        That is what holds in every order, and of a choice what all that is still possible have in
        common. Where something has to be done for each of them, so much is added of the one that
        takes least.

        Parameters
        ----------
        done
            Bits of the elements that are done.
        """
        if not self.choices:
            return self.before
        found = self.before.copy()
        for own, groups in self.choices:
            possible = [(must & ~done, never) for must, never in groups if not done & never]
            if done >> own & 1 or not possible:
                continue
            needed, barred = possible[0]
            for must, never in possible[1:]:
                needed, barred = needed & must, barred & never
            if not needed and all(must for must, _ in possible):
                needed = min((must for must, _ in possible), key=int.bit_count)
            found[list(each_index(needed)), own] = True
            found[own, list(each_index(barred))] = True
        return found


def each_index(bits: int) -> Iterator[int]:
    """Yield the index of every bit that is set, in ascending order."""
    while bits:
        low = bits & -bits
        yield low.bit_length() - 1
        bits ^= low


ELEMENT_FEATURES = (
    "its next skill is within reach of the tools",
    "by how much it costs more to come to than the cheapest",
    "something must come before it that is not done",
    "how many such there are",
    "skills come between, such as a tool change",
    "how many must come after it",
    "how many wait for it alone",
    "how many of the same tool are left",
    "how many of them can be done in a row from here",
    "share of them",
    "by how much the cheapest next one costs more than for others",
    "how many are left",
    "whether any can be done without skills between",
    "share of the attached tool's that can be done in a row",
)
PAIR_FEATURES = (
    "by how much the other costs more to come to than the cheapest after the one",
    "by how much the other costs more to come to from the one than from the best",
    "the same, the other way round: after the other",
    "the same, the other way round: from the other",
    "the one comes before the other",
    "the other comes before the one",
    "both need the same tool",
    "the other waits for the one alone",
    "they are the same",
)

# Differences beyond so many spreads are cut.
_MOST_SPREADS = 8.0


@dataclass(frozen=True)
class Sight:
    """A state as a relational network sees it; n elements are left to be done.

    Parameters
    ----------
    elements
        Their indices in the task.
    ways
        How each is come to; None where it cannot be begun here.
    features
        Of each, shape (n, len(ELEMENT_FEATURES)).
    pairs
        Of each pair, shape (n, n, len(PAIR_FEATURES)).
    """

    elements: NDArray[np.int64]
    ways: tuple[Way | None, ...]
    features: Figures
    pairs: Figures


class ElementView:
    """Sees the states of one task.

    Parameters
    ----------
    paths
        How elements are come to.
    order
        What must come before what.

    Attributes
    ----------
    costs
        Of coming from the one, done, to the other, with its first skill, shape (n, n); inf on the
        diagonal.
    rest
        Of the further skills of each, shape (n,).
    """

    def __init__(self, paths: ElementPaths, order: ElementOrder) -> None:
        self.paths, self.order = paths, order
        count, bits = len(paths.elements), paths.task.initial.bits
        firsts = [paths.first_skill(one, bits) for one in range(count)]
        self.costs = np.full((count, count), np.inf)
        self.rest = np.zeros(count)
        groups: dict[int, int] = {}
        self._groups = np.zeros(count, dtype=np.int64)
        for one, first in enumerate(firsts):
            if first is None:
                continue
            need = paths.needed_of(first)
            self._groups[one] = groups.setdefault(need, len(groups))
            self.rest[one], end = paths.finish(one, first, bits)
            for other, second in enumerate(firsts):
                way = None if second is None or other == one else paths.way(second, end)
                if way is not None:
                    self.costs[one, other] = way.cost
        self._same = self._groups[:, None] == self._groups[None]
        self._spread = _spread(self.costs, self._same)

    def done(self, state: State) -> NDArray[np.bool_]:
        """Return which elements are done in a state, shape (n,)."""
        return np.array([bool(state.bits & goal) for goal in self.paths.goals])

    def __call__(self, state: State) -> Sight:
        """Return what is seen of a state."""
        bits, paths = state.bits, self.paths
        done = self.done(state)
        left = np.flatnonzero(~done)
        ways: list[Way | None] = []
        waits = []
        for one in left.tolist():
            skill = paths.next_skill(one, bits)
            waits.append(skill is None)
            skill = skill or paths.first_skill(one, bits)
            ways.append(None if skill is None else paths.way(skill, bits))
        come = np.array([np.inf if way is None else way.cost for way in ways])
        between = np.array([0 if way is None else way.between for way in ways]) > 0
        mask = sum(1 << one for one in np.flatnonzero(done).tolist())
        before = self.order.after(mask)[np.ix_(left, left)]
        features = self._features(left, before, come, between)
        usable = tuple(None if wait else way for way, wait in zip(ways, waits, strict=True))
        features[:, 0] = [way is not None for way in usable]
        return Sight(left, usable, features, self._pairs(left, before))

    def _features(
        self,
        left: NDArray[np.int64],
        before: NDArray[np.bool_],
        come: NDArray[np.float64],
        between: NDArray[np.bool_],
    ) -> Figures:
        count = len(left)
        same = self._same[np.ix_(left, left)]
        waiting = before.sum(axis=0)
        alone = (before & (waiting[None] == 1)).sum(axis=1)
        in_row = self._in_a_row(before, same)
        group_left = same.sum(axis=1)
        share = in_row / np.maximum(group_left, 1)
        at_hand = ~between
        out = np.zeros((count, len(ELEMENT_FEATURES)), dtype=np.float32)
        free = waiting == 0
        least = come[free].min() if free.any() else come.min(initial=np.inf)
        out[:, 1] = self._spreads(come - (least if np.isfinite(least) else 0.0))
        out[:, 2] = ~free
        out[:, 3] = np.log1p(waiting)
        out[:, 4] = between
        out[:, 5] = np.log1p(before.sum(axis=1))
        out[:, 6] = np.log1p(alone)
        out[:, 7] = np.log1p(group_left)
        out[:, 8] = np.log1p(in_row)
        out[:, 9] = share
        onward = self.costs[np.ix_(left, left)].min(axis=1, initial=np.inf)
        finite = onward[np.isfinite(onward)]
        out[:, 10] = self._spreads(onward - (finite.min() if finite.size else 0.0))
        out[:, 11] = np.log1p(count)
        out[:, 12] = bool((at_hand & free).any())
        out[:, 13] = share[at_hand].max(initial=0.0)
        return out

    def _in_a_row(self, before: NDArray[np.bool_], same: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Return how many of the same tool can be done from here with nothing else between."""
        # What waits for one of another tool, however far back, cannot.
        blocked = np.asarray((before & ~same).any(axis=0))
        counted: NDArray[np.int64] = (same & ~blocked[None]).sum(axis=1)
        return counted

    def _pairs(self, left: NDArray[np.int64], before: NDArray[np.bool_]) -> Figures:
        grid = np.ix_(left, left)
        costs, same = self.costs[grid], self._same[grid]
        after = self._spreads(costs - _least(costs, 1))
        ahead = self._spreads(costs - _least(costs, 0))
        waiting = before.sum(axis=0)
        alone = before & (waiting[None] == 1)
        layers = (after, ahead, after.T, ahead.T, before, before.T, same, alone)
        out = np.zeros((len(left), len(left), len(PAIR_FEATURES)), dtype=np.float32)
        for index, layer in enumerate(layers):
            out[:, :, index] = layer
        out[:, :, len(layers)] = np.eye(len(left))
        return out

    def _spreads(self, differences: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.clip(differences / self._spread, -_MOST_SPREADS, _MOST_SPREADS)


def _least(costs: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    least = costs.min(axis=axis, keepdims=True, initial=np.inf)
    return np.where(np.isfinite(least), least, 0.0)


def _spread(costs: NDArray[np.float64], same: NDArray[np.bool_]) -> float:
    """Return by how much costs within a tool usually differ; of all where there are too few."""
    for among in (costs[same], costs.ravel()):
        finite = among[np.isfinite(among)]
        if finite.size > 2 and finite.std() > 0:
            return float(finite.std())
    return 1.0
