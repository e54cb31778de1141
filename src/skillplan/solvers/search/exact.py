"""Exact search with proof: lazy A* with a landmark bound.

A* (Hart, Nilsson and Raphael, 1968) ordered by cost, then by number of skills, then by time. Edges
are evaluated lazily (Dellin and Srinivasa, "A unifying formalism for shortest path problems with
expensive edge evaluations", 2016): a back end checks a skill only when its edge is due for
expansion, so most edges need no check. If costs come from a back end, an edge first has a lower
bound; with its cost it returns to the queue, and is expanded if no other label can be cheaper.

If parts arrive at a time and seconds cost, a label also has the time since the begin. The arm may
wait, so a path to a state that is no later, no costlier without its time, and no longer than
another is as good in every continuation: the FIFO property of time-dependent networks (Kaufman and
Smith, "Fastest paths in time-dependent networks for intelligent vehicle-highway systems
application", 1993).
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import count
from typing import TypeVar

from pydantic import Field

from skillplan.model.pooled_model import make_symmetry_key
from skillplan.model.skill_model import SkillModel
from skillplan.solvers.search.landmark_bound import (
    ArrivalBound,
    LandmarkBound,
    convert_from_units,
    convert_to_units,
)
from skillplan.solvers.solution import Plan, Solution
from skillplan.solvers.solver import Solver
from skillplan.task import back_end
from skillplan.task.skill import Skill
from skillplan.task.state import State

Node = TypeVar("Node")
Ranked = tuple[tuple[int, ...], Node]
"""A node with its rank in the search, lowest first."""

# Greatest number of nodes inspected while the search waits for a verdict.
MOST_NODES = 256


def list_questions(
    node: Node,
    others: Iterable[Ranked[Node]],
    *,
    successors: Callable[[Node], Iterable[Ranked[Node]]],
    question: Callable[[Node], tuple[State, Skill]],
    expected: Callable[[State, Skill], bool | None],
) -> Iterator[tuple[State, Skill]]:
    """Yield the questions of a search after a feasible verdict on `node`.

    Parameters
    ----------
    question
        Returns the state and the skill that lead to a node.
    """
    queue: list[tuple[tuple[int, ...], int, Node]] = []

    added = count(0, -1)

    def add(ranked: Iterable[Ranked[Node]]) -> None:
        for rank, node in ranked:
            # The latest of equal nodes first, which the search has just created.
            heapq.heappush(queue, (rank, next(added), node))

    add(others)
    add(successors(node))
    for _ in range(MOST_NODES):
        if not queue:
            return
        *_, here = heapq.heappop(queue)
        answered = question(here)
        if expected(*answered) is None:
            yield answered
        # Cheap back ends may have refused it by now.
        if expected(*answered) is not False:
            add(successors(here))


# Times [us] are added below the last bit of the cost; 2 ** 40 us are twelve days.
_TIME_BITS = 40
# Rounding errors of the costs of paths [units].
_ROUNDING = convert_to_units(1e-12)
# Number of expanded states without a plan, after which an order of components is looked for, and
# number of components from which it is looked for at once: of so many, a dive seldom ends.
_ORDER_AFTER, _ORDER_FIRST = 200, 15
# Greatest number of open labels, next in expansion order, inspected during a check.
_MOST_OPEN = 32


@dataclass(slots=True)
class _Label:
    """A path to a state: cost [units], number of skills, time [us] and parent.

    Labels that are not `priced` have a lower bound for the cost of their last skill. `spent` is the
    part of the cost for the time since the begin; it is counted only if parts arrive.
    """

    state: State
    cost: int
    steps: int
    time: int
    parent: _Label | None
    skill: int
    priced: bool = True
    spent: int = 0


class ExactSolver(Solver):
    """Prove the cheapest plan; of equals, one with the fewest skills, then the fastest."""

    name = "exact"
    polls = True
    seeded = False
    counts_waits = True

    class Options(back_end.Options):
        """Limits of the search."""

        max_labels: int = Field(
            default=2_000_000,
            ge=1,
            description="greatest number of labels before the search ends with a bound: 0.6 to "
            "1 kB of memory each [-]",
        )
        dives: bool = Field(
            default=True, description="search greedily in between to have a plan at any time [-]"
        )
        symmetry: bool = Field(
            default=True,
            description="treat states as one that differ only in which of interchangeable parts "
            "is where [-]",
        )

    options: Options

    def refuses(self, model: SkillModel) -> str | None:
        """Return the reason if a skill may have several outcomes, or None."""
        if not model.task.deterministic:
            return (
                "exact search looks for one sequence and needs skills with one outcome each; "
                "under chance take value-iteration, or replan"
            )
        return None

    def solve(self, model: SkillModel, *, seed: int = 0) -> Solution:
        """Search without the step limit first, which is a relaxation.

        If the optimum is too long, a second search keeps all labels of a state that are not
        dominated in
        cost and length.
        """
        search = _Search(self, model)
        plan, proved = search.run(bounded=False)
        if proved and plan is not None and len(plan) > model.step_limit:
            self.stop.bound(plan.cost or 0.0)
            plan, proved = search.run(bounded=True)
        bound = self.stop.lower_bound
        if proved and plan is not None:
            bound = plan.cost
        trace = {
            "states": search.states,
            "expanded": search.expanded,
            "generated": search.generated,
            "ended": "proof" if proved else self.stop.reason,
            "bound_method": "A* with the landmark bound",
        }
        return Solution(plan, bound, proved=proved, trace=trace)


class _Search:
    """The search of one task, with data that both passes share.

    Labels are ordered by weight: the cost plus a toll for every skill, far below relevant costs and
    far
    above the rounding errors of paths of equal length. Ties go to fewer skills, then to less time,
    which weighs less than one unit of cost.
    """

    def __init__(self, solver: ExactSolver, model: SkillModel) -> None:
        self.options = solver.options
        self.stop = solver.stop
        self.model = model
        task = model.task if self.options.symmetry else model.task.replace(pools=())
        self._key = make_symmetry_key(task)
        self.bound = LandmarkBound(model.task, model.least_cost if model.asks_costs else None)
        # A trajectory takes longer than a geometric check, and less than an execution.
        self._prices_first = any(part.expensive for part in model.feasibility.back_ends)
        self.states = 0
        self.expanded = 0
        self.generated = 0
        # All tolls of a plan together stay within the tolerance of a proof.
        self._toll = max(1, min(1_000, convert_to_units(1e-9) // model.step_limit))
        self._incumbent: int | None = None
        self._plan: Plan | None = None
        self._ordered = not model.task.operations
        self._per_s = model.task.metric.cost_per_s if model.task.counts_waits else 0.0
        self._arrivals = ArrivalBound(model) if self._per_s else None
        self._arrives_us = [
            0 if skill.supply is None else round(skill.supply.arrives_s * 1e6)
            for skill in model.task.skills
        ]

    def run(self, *, bounded: bool) -> tuple[Plan | None, bool]:
        """Return the best plan, and True if it or infeasibility is proved."""
        limit = self.model.step_limit if bounded else None
        operations = self.model.task.operations
        self._adopt(self.stop.best)
        best: dict[int, list[_Label]] = {}
        queue: list[tuple[int, int, int, _Label]] = []
        start = _Label(self.model.initial, 0, 0, 0, None, -1)
        self._push(queue, start, limit)
        next_dive = 0

        def open_labels() -> Iterator[_Label]:
            return (entry[-1] for entry in heapq.nsmallest(_MOST_OPEN, queue))

        while queue:
            ahead, _, _, label = queue[0]
            if self._incumbent is not None and ahead >= self._incumbent:
                return self._plan, True
            if self.generated > self.options.max_labels:
                self.stop.end(f"limit of {self.options.max_labels:,} labels")
            if self.expanded % 16 == 0:
                self.stop.bound(self._floor(ahead), self.expanded)
            if self.stop():
                self.stop.bound(self._floor(ahead), self.expanded)
                return self._plan, False
            heapq.heappop(queue)
            known = best.setdefault(self._key(label.state.bits), [])
            if self._dominated(known, label, bounded):
                continue
            if not (
                label.priced or self._prices_first or self._feasible(label, open_labels, limit)
            ):
                continue
            if not label.priced:
                self._price(label)
                self._push(queue, label, limit)
                continue
            if not self._feasible(label, open_labels, limit):
                continue
            if self.model.is_goal(label.state):
                plan = _plan_of(self.model, label)
                if len(plan) <= self.model.step_limit:
                    self.stop.incumbent(plan)
                return plan, True
            known.append(label)
            self.states += len(known) == 1
            self.expanded += 1
            if self.options.dives and self.expanded > next_dive:
                is_due = self.expanded > _ORDER_AFTER or len(operations) >= _ORDER_FIRST
                if is_due and self._plan is None and not self._ordered:
                    self._order()
                next_dive = 2 * next_dive + 64
                self._dive(label)
            for child in self._children(label):
                if not self._dominated(best.get(self._key(child.state.bits), ()), child, bounded):
                    self._push(queue, child, limit)
        return self._plan, True

    def _weight(self, cost: int, steps: int, time: int) -> int:
        return (cost + self._toll * steps << _TIME_BITS) + time

    def _ahead(self, label: _Label, limit: int | None) -> int | None:
        """Return the least weight of a plan through a label; None for a dead end."""
        cost, steps = self.bound(label.state)
        if cost < 0 or (limit is not None and label.steps + steps > limit):
            return None
        total = label.cost + cost
        if self._arrivals is not None:
            paid = label if label.priced or label.parent is None else label.parent
            ends = convert_to_units(self._per_s * self._arrivals(label.state))
            total = max(total, paid.cost - paid.spent + ends)
        ahead = self._weight(total, label.steps + steps, label.time)
        return None if self._incumbent is not None and ahead >= self._incumbent else ahead

    def _floor(self, ahead: int) -> float:
        """Return the bound on all plans that the lightest open label proves."""
        if self._incumbent is not None:
            ahead = min(ahead, self._incumbent)
        return max(
            0.0, convert_from_units((ahead >> _TIME_BITS) - self._toll * self.model.step_limit)
        )

    def _dominated(self, known: Sequence[_Label], label: _Label, bounded: bool) -> bool:
        """Return True if one of a state's known labels dominates `label`."""
        if self._arrivals is not None and self.model.task.metric.is_duration:
            return any(k.steps <= label.steps and k.cost <= label.cost for k in known)
        if self._arrivals is not None:
            rest = label.cost - label.spent + _ROUNDING
            return label.priced and any(
                k.steps <= label.steps and k.spent <= label.spent and k.cost - k.spent <= rest
                for k in known
            )
        if bounded:
            return any(
                k.steps <= label.steps and (k.cost, k.time) <= (label.cost, label.time)
                for k in known
            )
        weight = self._weight(label.cost, label.steps, label.time)
        return any(self._weight(k.cost, k.steps, k.time) <= weight for k in known)

    def _push(
        self, queue: list[tuple[int, int, int, _Label]], label: _Label, limit: int | None
    ) -> None:
        ahead = self._ahead(label, limit)
        if ahead is not None:
            self.generated += 1
            # The deepest of equal labels first, then the order of creation, for a total order.
            heapq.heappush(queue, (ahead, -label.steps, self.generated, label))

    def _children(self, label: _Label) -> Iterator[_Label]:
        for skill in self.model.applicable(label.state):
            yield self._child(label, skill)

    def _child(self, label: _Label, skill: Skill) -> _Label:
        here, action = label.state, self.model.task.action(skill)
        state = skill.prediction_in(here).apply(here)
        duration_s = skill.duration_s.at(here)
        time = max(label.time, self._arrives_us[action]) + round(duration_s * 1e6)
        asks = self.model.asks_costs
        cost = self.bound.from_here(here, skill) if asks else skill.cost.at(here)
        units = label.cost + convert_to_units(cost)
        child = _Label(state, units, label.steps + 1, time, label, action, priced=not asks)
        if self._arrivals is not None:
            self._let_pass(child, skill, 0.0 if asks else duration_s)
        return child

    def _let_pass(self, label: _Label, skill: Skill, duration_s: float) -> None:
        """Add the wait for the part of a label's last skill, and its duration [s]."""
        assert label.parent is not None
        before = label.parent.spent
        elapsed_s = convert_from_units(before) / self._per_s
        wait = convert_to_units(self._per_s * skill.compute_wait_s(elapsed_s))
        label.cost += wait
        label.spent = before + wait + convert_to_units(self._per_s * duration_s)

    def _price(self, label: _Label) -> None:
        """Replace the bound on the cost of a label's last skill by its cost."""
        if not label.priced and label.parent is not None:
            skill = self.model.task.skills[label.skill]
            state = label.parent.state
            cost = self.model.cost(state, skill)
            label.cost = label.parent.cost + convert_to_units(cost)
            if self._arrivals is not None:
                self._let_pass(label, skill, self.model.duration_s(state, skill))
            label.priced = True

    def _feasible(
        self,
        label: _Label,
        others: Callable[[], Iterable[_Label]],
        limit: int | None,
        *,
        deep: bool = False,
    ) -> bool:
        """Return True if a label's last skill is feasible.

        Meanwhile idle processes check the next questions: below the label, else of the `others`;
        the
        deepest first while the search dives.
        """
        if label.parent is None:
            return True
        likely = partial(self._likely, label, others, limit, deep=deep)
        return self.model.verdict(*self._question(label), likely).is_feasible

    def _question(self, label: _Label) -> tuple[State, Skill]:
        """Return the question of a label: state and skill."""
        assert label.parent is not None
        return label.parent.state, self.model.task.skills[label.skill]

    def _likely(
        self,
        label: _Label,
        others: Callable[[], Iterable[_Label]],
        limit: int | None,
        *,
        deep: bool,
    ) -> Iterator[tuple[State, Skill]]:
        """Yield the next questions if the last skill of a label is feasible."""
        seen = {self._key(label.state.bits)}

        def ranked(labels: Iterable[_Label]) -> Iterator[Ranked[_Label]]:
            for label in labels:
                ahead = None if self._key(label.state.bits) in seen else self._ahead(label, limit)
                if ahead is not None and label.parent is not None:
                    seen.add(self._key(label.state.bits))
                    yield ((-label.steps, ahead) if deep else (ahead, -label.steps)), label

        return list_questions(
            label,
            ranked(others()),
            successors=lambda child: ranked(self._children(child)),
            question=self._question,
            expected=self.model.expected,
        )

    def _dive(self, label: _Label) -> None:
        """Follow the least bound, depth first, to one plan within the step limit."""
        limit = self.model.step_limit
        seen = {self._key(label.state.bits)}
        stack = [label]
        for _ in range(8 * limit):
            if not stack or self.stop():
                return
            here = stack.pop()
            if not here.priced and self._prices_first:
                self._price(here)
            if here is not label and not self._feasible(here, stack.__reversed__, limit, deep=True):
                continue
            self._price(here)
            if self.model.asks_costs and self._ahead(here, limit) is None:
                continue
            if self.model.is_goal(here.state):
                self._keep(here)
                return
            ranked = []
            for order, child in enumerate(self._children(here)):
                ahead = None if self._key(child.state.bits) in seen else self._ahead(child, limit)
                if ahead is not None:
                    ranked.append((ahead, order, child))
            for *_, child in sorted(ranked, reverse=True):
                seen.add(self._key(child.state.bits))
                stack.append(child)

    def _order(self) -> None:
        """Bring components one after another, and learn from failures which goes before which."""
        from skillplan.chart.whole_order import find_order

        self._ordered = True
        task, feasibility = self.model.task, self.model.feasibility
        order = find_order(task, feasibility, (), {}, self.stop, may_drop=False)
        label = _Label(self.model.initial, 0, 0, 0, None, -1)
        for skill in order.skills:
            if not skill.applicable(label.state):
                return
            label = self._child(label, skill)
            if not self._feasible(label, tuple, None):
                return
            self._price(label)
        if self.model.is_goal(label.state) and label.steps <= self.model.step_limit:
            self._keep(label)

    def _adopt(self, plan: Plan | None) -> None:
        """Adopt a known plan, such as a warm start, as the incumbent."""
        if plan is None or self._plan is not None:
            return
        label = _Label(self.model.initial, 0, 0, 0, None, -1)
        for name in plan.skills:
            skill = self.model.task.skill(name)
            label = self._child(label, skill)
            self._price(label)
        self._keep(label)

    def _keep(self, label: _Label) -> None:
        weight = self._weight(label.cost, label.steps, label.time)
        if self._incumbent is None or weight < self._incumbent:
            self._incumbent = weight
            self._plan = _plan_of(self.model, label)
            self.stop.incumbent(self._plan)


def _plan_of(model: SkillModel, label: _Label) -> Plan:
    actions = []
    here: _Label | None = label
    while here is not None and here.parent is not None:
        actions.append(here.skill)
        here = here.parent
    skills = tuple(model.task.skills[action].name for action in reversed(actions))
    return Plan(skills, convert_from_units(label.cost))
