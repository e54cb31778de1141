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

# Most skills between two elements, such as putting a tool away and fetching another.
_MOST_BETWEEN = 3
# Situations whose routes are cached.
_MOST_KEPT = 20_000


@dataclass(frozen=True, slots=True)
class Route:
    """Skills up to and including an element's next one.

    Parameters
    ----------
    first
        First skill: one between elements, such as a tool change, or the element's own.
    between
        Number of skills between elements.
    cost
        Total cost, in the task's metric.
    """

    first: str
    between: int
    cost: float


class ElementPaths:
    """Routes to the elements of a task from any of its states.

    Routes follow from preconditions, predicted outcomes and costs; no back end is queried.

    Parameters
    ----------
    task
        Task whose operations are components to be brought to their goals.

    Attributes
    ----------
    elements
        Names of the components, in the order of the task.
    goals
        Bit of the goal fact of each element.
    own
        Bits of the facts about each element.

    Raises
    ------
    OptionError
        If the task has no elements, several robots, or skills that depend on more than facts.
    """

    def __init__(self, task: Task) -> None:
        _check(task)
        self.task = task
        self.elements = tuple(task.operations)
        named = map_named_bits(task)
        self.own = tuple(named.get(element, 0) for element in self.elements)
        self.goals = tuple(task.facts.bit(fact) for fact in task.operations.values())
        self._skills: dict[str, list[Skill]] = {element: [] for element in self.elements}
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
        self._routes: dict[tuple[int, str], Route | None] = {}

    def owner(self, skill: Skill) -> str | None:
        """Return the element that a skill moves or fastens; None for a skill between elements."""
        values = skill.parameters.values()
        return next((value for value in values if value in self.task.operations), None)

    def next_skill(self, element: int, bits: int) -> Skill | None:
        """Return the next skill of an element; None if it waits for another element.

        Facts that skills between elements change, such as the tool, are disregarded.
        """
        kept = ~self._free
        for skill in self._skills[self.elements[element]]:
            needs, bars = skill.precondition.requires.bits, skill.precondition.forbids.bits
            if bits & needs & kept == needs & kept and not bits & bars & kept:
                return skill
        return None

    def first_skill(self, element: int, bits: int) -> Skill | None:
        """Return the next skill of an element by the facts about itself; None if it is done."""
        own = self.own[element]
        if bits & self.goals[element]:
            return None
        for skill in self._skills[self.elements[element]]:
            needs, bars = skill.precondition.requires.bits, skill.precondition.forbids.bits
            if bits & needs & own == needs & own and not bits & bars & own:
                return skill
        return None

    def route(self, skill: Skill, bits: int) -> Route | None:
        """Return the cheapest route to a skill from a state; None if there is none."""
        key = bits & self._situation, skill.name
        if key not in self._routes:
            if len(self._routes) >= _MOST_KEPT:
                self._routes.clear()
            self._routes[key] = self._find_route(skill, bits)
        return self._routes[key]

    def needed_of(self, skill: Skill) -> int:
        """Return the needed bits that skills between elements change: the tool."""
        return skill.precondition.requires.bits & self._free

    def finish(self, element: int, skill: Skill, bits: int) -> tuple[float, int]:
        """Return the cost of an element's skills after the given one, and the bits at its end."""
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
        """Return the bits after the skills between elements, right before a skill."""
        for end in self._reach(bits):
            if self._fits(skill, end):
                return bits & ~self._situation | end & self._situation
        return bits

    def _find_route(self, skill: Skill, bits: int) -> Route | None:
        for end, (first, between, cost) in self._reach(bits).items():
            if self._fits(skill, end):
                total = cost + self._cost(skill, end)
                return Route(first or skill.name, between, total)
        return None

    def _fits(self, skill: Skill, bits: int) -> bool:
        needs, bars = skill.precondition.requires.bits, skill.precondition.forbids.bits
        free = self._free
        return bits & needs & free == needs & free and not bits & bars & free

    def _reach(self, bits: int) -> Mapping[int, tuple[str, int, float]]:
        """Return first skill, number and cost of skills between to each end, the nearest first."""
        key = bits & self._situation
        if key not in self._ends:
            if len(self._ends) >= _MOST_KEPT:
                self._ends.clear()
            self._ends[key] = self._explore(key)
        return self._ends[key]

    def _explore(self, start: int) -> dict[int, tuple[str, int, float]]:
        ends = {start: ("", 0, 0.0)}
        level = [start]
        for count in range(1, _MOST_BETWEEN + 1):
            following = []
            for bits in level:
                first, _, cost = ends[bits]
                for skill in self._between:
                    if not skill.precondition.holds(State(bits, self.task.facts)):
                        continue
                    end = _after(skill, bits)
                    total = cost + self._cost(skill, bits)
                    if end in ends and ends[end][2] <= total:
                        continue
                    if end not in ends:
                        following.append(end)
                    ends[end] = (first or skill.name, count, total)
            level = following
        return dict(sorted(ends.items(), key=lambda item: item[1][1:3]))

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
        True if the row's element precedes the column's in every order, shape (n, n); closed.
    choices
        Alternatives by element, each as bits of the elements that must precede it and of those
        that must follow it.
    """

    before: NDArray[np.bool_]
    choices: tuple[tuple[int, tuple[tuple[int, int], ...]], ...] = ()

    @classmethod
    def of(cls, model: SkillModel) -> ElementOrder:
        """Return the precedence that ``skillplan chart`` derives by the task's back ends.

        Raises
        ------
        BackEndError
            If a back end fails.
        """
        return cls.from_chart(tuple(model.task.operations), derive_chart(model.feasibility))

    @classmethod
    def from_chart(cls, elements: Sequence[str], chart: DerivedChart) -> ElementOrder:
        """Return the precedence of a derived chart, for elements in this order."""
        index = {name: i for i, name in enumerate(elements)}
        before = np.zeros((len(elements), len(elements)), dtype=np.bool_)
        for first, second in closure((r.before, r.after) for r in chart.relations):
            before[index[first], index[second]] = True
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
        """Return the precedence that remains after some elements, shape (n, n).

        It includes the elements that all remaining alternatives of a choice have in common. If
        each alternative needs an element, the alternative with the fewest is included.

        Parameters
        ----------
        done
            Bits of the finished elements.
        """
        if not self.choices:
            return self.before
        before = self.before.copy()
        for own, groups in self.choices:
            possible = [(must & ~done, never) for must, never in groups if not done & never]
            if done >> own & 1 or not possible:
                continue
            needed, barred = possible[0]
            for must, never in possible[1:]:
                needed, barred = needed & must, barred & never
            if not needed and all(must for must, _ in possible):
                needed = min((must for must, _ in possible), key=int.bit_count)
            before[list(each_index(needed)), own] = True
            before[own, list(each_index(barred))] = True
        return before


def each_index(bits: int) -> Iterator[int]:
    """Yield the indices of the set bits, ascending."""
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

# Greatest difference of costs, in spreads.
_MOST_SPREADS = 8.0


@dataclass(frozen=True)
class ElementGraph:
    """Features of a state with n unfinished elements.

    Parameters
    ----------
    elements
        Indices in the task.
    routes
        Route to each element; None if it cannot be begun.
    features
        Shape (n, len(ELEMENT_FEATURES)).
    pairs
        Shape (n, n, len(PAIR_FEATURES)).
    """

    elements: NDArray[np.int64]
    routes: tuple[Route | None, ...]
    features: Figures
    pairs: Figures


class ElementView:
    """Computes the features of a task's states.

    Parameters
    ----------
    paths
        Routes to the elements.
    order
        Their precedence.

    Attributes
    ----------
    costs
        Cost of the route from one finished element to another, shape (n, n); inf on the diagonal.
    rest
        Cost of the further skills of each element, shape (n,).
    """

    def __init__(self, paths: ElementPaths, order: ElementOrder) -> None:
        self.paths, self.order = paths, order
        count, bits = len(paths.elements), paths.task.initial.bits
        firsts = [paths.first_skill(element, bits) for element in range(count)]
        self.costs = np.full((count, count), np.inf)
        self.rest = np.zeros(count)
        groups: dict[int, int] = {}
        self._groups = np.zeros(count, dtype=np.int64)
        for element, first in enumerate(firsts):
            if first is None:
                continue
            tool = paths.needed_of(first)
            self._groups[element] = groups.setdefault(tool, len(groups))
            self.rest[element], end = paths.finish(element, first, bits)
            for other, second in enumerate(firsts):
                skip = second is None or other == element
                route = None if skip or second is None else paths.route(second, end)
                if route is not None:
                    self.costs[element, other] = route.cost
        self._same = self._groups[:, None] == self._groups[None]
        self._spread = _spread(self.costs, self._same)

    def done(self, state: State) -> NDArray[np.bool_]:
        """Return whether each element is done in a state, shape (n,)."""
        return np.array([bool(state.bits & goal) for goal in self.paths.goals])

    def __call__(self, state: State) -> ElementGraph:
        """Return the features of a state."""
        bits, paths = state.bits, self.paths
        done = self.done(state)
        left = np.flatnonzero(~done)
        routes: list[Route | None] = []
        waits = []
        for element in left.tolist():
            skill = paths.next_skill(element, bits)
            waits.append(skill is None)
            skill = skill or paths.first_skill(element, bits)
            routes.append(None if skill is None else paths.route(skill, bits))
        come = np.array([np.inf if route is None else route.cost for route in routes])
        between = np.array([0 if route is None else route.between for route in routes]) > 0
        mask = sum(1 << element for element in np.flatnonzero(done).tolist())
        before = self.order.after(mask)[np.ix_(left, left)]
        features = self._features(left, before, come, between)
        usable = tuple(None if wait else route for route, wait in zip(routes, waits, strict=True))
        features[:, 0] = [route is not None for route in usable]
        return ElementGraph(left, usable, features, self._pairs(left, before))

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
        cheapest = come[free].min() if free.any() else come.min(initial=np.inf)
        out[:, 1] = self._spreads(come - (cheapest if np.isfinite(cheapest) else 0.0))
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
        """Return the number of elements of the same tool that need no other tool before."""
        blocked = np.asarray((before & ~same).any(axis=0))
        counted: NDArray[np.int64] = (same & ~blocked[None]).sum(axis=1)
        return counted

    def _pairs(self, left: NDArray[np.int64], before: NDArray[np.bool_]) -> Figures:
        grid = np.ix_(left, left)
        costs, same = self.costs[grid], self._same[grid]
        after = self._spreads(costs - _cheapest(costs, 1))
        ahead = self._spreads(costs - _cheapest(costs, 0))
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


def _cheapest(costs: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
    cheapest = costs.min(axis=axis, keepdims=True, initial=np.inf)
    return np.where(np.isfinite(cheapest), cheapest, 0.0)


def _spread(costs: NDArray[np.float64], same: NDArray[np.bool_]) -> float:
    """Return the standard deviation of costs within a tool, or of all costs if too few."""
    for among in (costs[same], costs.ravel()):
        finite = among[np.isfinite(among)]
        if finite.size > 2 and finite.std() > 0:
            return float(finite.std())
    return 1.0
