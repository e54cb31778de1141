"""Exact search for the Pareto front of two costs, with a proof of every point.

Best-first search over labels with two costs, in lexicographic order of their bounds (NAMOA*: Mandow
and Perez de la Cruz, "Multiobjective A* search with consistent heuristics", 2010). Bounds are those
of the exact search, one for each cost. As no label ahead can dominate the label in turn, each plan
is proved as soon as it is found, and an interrupted search leaves the front up to the first cost
that it has reached. Feasibility and times are queried lazily, as there. If parts arrive at a time,
one cost is the time since the begin, from which the waits follow, and the other one contains none.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from skillplan.model.skill_model import SkillModel
from skillplan.solvers.search.landmark_bound import (
    ArrivalBound,
    LandmarkBound,
    convert_from_units,
    convert_to_units,
)
from skillplan.solvers.stop import Stop
from skillplan.task.cost import Cost, WeightedCost
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task

Pair = tuple[int, int]

# Differences of costs that count as rounding: of two plans, and of two paths to a state [units].
_SAME_PLANS = convert_to_units(1e-9)
_SAME_PATHS = convert_to_units(1e-12)
MOST_LABELS = 2_000_000
"""Greatest number of labels before the search ends; about 1 kB of memory each."""


@dataclass(frozen=True)
class Objective:
    """One of two costs of a task.

    Parameters
    ----------
    task
        The task with this cost: same facts and skills as the task of the model.
    """

    name: str
    task: Task

    def price(self, action: int, state: State, duration_s: float) -> float:
        """Return the cost of a skill whose duration is known [s]."""
        cost = self.task.skills[action].cost
        if isinstance(cost, WeightedCost):
            return cost.price(state, duration_s)
        return duration_s if self.task.metric.is_duration else cost.at(state)

    def least(self, model: SkillModel, skill: Skill, true_bits: int, false_bits: int) -> float:
        """Return a lower bound on the cost of a skill of the model, if some facts are known."""
        cost: Cost = self.task.skills[self.task.action(skill)].cost
        if not self.task.metric.depends_on_time:
            return cost.least(true_bits, false_bits)
        least_s = model.least_duration_s(skill, true_bits, false_bits)
        return (
            cost.bound(true_bits, false_bits, least_s)
            if isinstance(cost, WeightedCost)
            else least_s
        )


@dataclass(frozen=True, slots=True)
class FrontPlan:
    """A plan of the front: the names of its skills, and its two costs."""

    skills: tuple[str, ...]
    costs: tuple[float, float]


@dataclass(frozen=True, slots=True)
class FrontSearch:
    """Outcome of a search for a front.

    Parameters
    ----------
    plans
        Plans in ascending order of the first cost. None is dominated by any plan of the task.
    complete
        True if the front has no other points.
    reached
        Greatest first cost up to which the front is complete; None if it is complete.
    expanded, generated
        Numbers of labels.
    """

    plans: tuple[FrontPlan, ...]
    complete: bool
    reached: float | None = None
    expanded: int = 0
    generated: int = 0


@dataclass(slots=True)
class _Label:
    """A path to a state; `priced` is False while the costs of its last skill are bounds."""

    state: State
    costs: Pair
    steps: int
    parent: _Label | None
    action: int
    priced: bool = True


def search_front(
    model: SkillModel,
    objectives: tuple[Objective, Objective],
    stop: Stop,
    *,
    max_labels: int = MOST_LABELS,
) -> FrontSearch:
    """Return the Pareto front of two costs.

    Parameters
    ----------
    model
        Model of the task with either cost. If one of them depends on time and back ends provide
        times, the costs of its task must depend on time, because that decides which motion of a
        skill is executed.
    stop
        Ends the search early.
    """
    search = _Search(model, objectives, stop, max_labels)
    front = search.run(bounded=False)
    if any(len(plan.skills) > model.step_limit for plan in front.plans):
        # The plans without a limit are a relaxation; this pass keeps shorter paths, too.
        front = search.run(bounded=True)
    return front


class _Search:
    def __init__(
        self,
        model: SkillModel,
        objectives: tuple[Objective, Objective],
        stop: Stop,
        max_labels: int,
    ) -> None:
        self.model = model
        self.objectives = objectives
        self.stop = stop
        self.max_labels = max_labels
        self.bounds = tuple(
            LandmarkBound(model.task, partial(objective.least, model)) for objective in objectives
        )
        # A trajectory takes longer than a geometric check, and less than an execution.
        self._prices_first = any(part.expensive for part in model.feasibility.back_ends)
        # The cost that is the time since the begin, from which waits for parts follow.
        self._clock = next((i for i, o in enumerate(objectives) if o.task.counts_waits), None)
        self._arrivals = ArrivalBound(model)
        self._asks = model.times_skills and any(o.task.metric.depends_on_time for o in objectives)

    def run(self, *, bounded: bool) -> FrontSearch:
        """Return the front within the step limit, or without it if not `bounded`."""
        limit = self.model.step_limit if bounded else None
        plans: list[tuple[Pair, _Label]] = []
        best: dict[int, list[tuple[int, int, int]]] = {}
        queue: list[tuple[int, int, int, int, _Label]] = []
        generated = expanded = 0
        reached = 0
        # Time of the last point [s].
        last_s = 0.0

        def push(label: _Label, floor: Pair) -> None:
            nonlocal generated
            ahead = self._ahead(label, limit)
            if ahead is None:
                return
            # A bound of a path is no less than that of its beginning.
            ahead = max(ahead[0], floor[0]), max(ahead[1], floor[1])
            if not _is_dominated(ahead, plans):
                generated += 1
                heapq.heappush(queue, (*ahead, -label.steps, generated, label))

        push(_Label(self.model.initial, (0, 0), 0, None, -1), (0, 0))
        while queue:
            if generated > self.max_labels:
                self.stop.end(f"limit of {self.max_labels:,} labels")
            if plans and time.monotonic() - last_s > self.stop.stall_s:
                self.stop.end("stalled")
            if self.stop():
                reached = queue[0][0]
                break
            first, second, _, _, label = heapq.heappop(queue)
            if expanded % 64 == 0:
                self.stop.bound(convert_from_units(first), expanded)
            known = best.setdefault(label.state.bits, [])
            if _is_dominated((first, second), plans) or _is_passed(known, label, bounded):
                continue
            if not (label.priced or self._prices_first or self._is_feasible(label)):
                continue
            if not label.priced:
                self._price(label)
                push(label, (first, second))
                continue
            if not self._is_feasible(label):
                continue
            if self.model.is_goal(label.state):
                # Equal to rounding in the first cost, and better in the second.
                plans = [entry for entry in plans if not _covers(label.costs, entry[0])]
                plans.append((label.costs, label))
                last_s = time.monotonic()
                continue
            known[:] = [k for k in known if not _passes(label, k, bounded)]
            known.append((*label.costs, label.steps))
            expanded += 1
            for skill in self.model.applicable(label.state):
                child = self._child(label, skill)
                if not _is_passed(best.get(child.state.bits, ()), child, bounded):
                    push(child, (first, second))
        ended = not queue
        return FrontSearch(
            tuple(self._plan_of(label) for _, label in plans),
            ended,
            None if ended else convert_from_units(reached),
            expanded,
            generated,
        )

    def _ahead(self, label: _Label, limit: int | None) -> Pair | None:
        """Return lower bounds on the costs of all plans through a label; None for a dead end."""
        first, steps = self.bounds[0](label.state)
        second, _ = self.bounds[1](label.state)
        if first < 0 or second < 0 or (limit is not None and label.steps + steps > limit):
            return None
        ahead = [label.costs[0] + first, label.costs[1] + second]
        if self._clock is not None:
            ends = convert_to_units(self._arrivals(label.state))
            ahead[self._clock] = max(ahead[self._clock], ends)
        return ahead[0], ahead[1]

    def _child(self, label: _Label, skill: Skill) -> _Label:
        here, action = label.state, self.model.task.action(skill)
        child = _Label(
            skill.prediction_in(here).apply(here),
            label.costs,
            label.steps + 1,
            label,
            action,
            priced=not self._asks,
        )
        if self._asks:
            costs = [bound.from_here(here, skill) for bound in self.bounds]
        else:
            costs = self._costs(here, skill, skill.duration_s.at(here))
        self._add_wait(costs, label, skill)
        child.costs = _add(label.costs, costs)
        return child

    def _price(self, label: _Label) -> None:
        """Replace the bounds on the costs of a label's last skill by its costs."""
        assert label.parent is not None
        state, skill = label.parent.state, self.model.task.skills[label.action]
        costs = self._costs(state, skill, self.model.duration_s(state, skill))
        self._add_wait(costs, label.parent, skill)
        label.costs, label.priced = _add(label.parent.costs, costs), True

    def _add_wait(self, costs: list[float], before: _Label, skill: Skill) -> None:
        """Add the wait for the part of a skill to the cost that is the time."""
        if self._clock is not None:
            elapsed_s = convert_from_units(before.costs[self._clock])
            costs[self._clock] += skill.compute_wait_s(elapsed_s)

    def _costs(self, state: State, skill: Skill, duration_s: float) -> list[float]:
        action = self.model.task.action(skill)
        return [o.price(action, state, duration_s) for o in self.objectives]

    def _is_feasible(self, label: _Label) -> bool:
        if label.parent is None:
            return True
        skill = self.model.task.skills[label.action]
        return self.model.verdict(label.parent.state, skill).is_feasible

    def _plan_of(self, label: _Label) -> FrontPlan:
        names: list[str] = []
        here: _Label | None = label
        while here is not None and here.parent is not None:
            names.append(self.model.task.skills[here.action].name)
            here = here.parent
        costs = convert_from_units(label.costs[0]), convert_from_units(label.costs[1])
        return FrontPlan(tuple(reversed(names)), costs)


def _add(costs: Pair, more: Sequence[float]) -> Pair:
    return costs[0] + convert_to_units(more[0]), costs[1] + convert_to_units(more[1])


def _covers(costs: Pair, others: Pair) -> bool:
    """Return True if costs are no greater than others, to rounding."""
    return costs[0] <= others[0] + _SAME_PLANS and costs[1] <= others[1] + _SAME_PLANS


def _is_dominated(ahead: Pair, plans: Sequence[tuple[Pair, _Label]]) -> bool:
    return any(_covers(costs, ahead) for costs, _ in plans)


def _is_passed(known: Sequence[tuple[int, int, int]], label: _Label, bounded: bool) -> bool:
    """Return True if a known path to the state of a label is no worse in both costs."""
    first, second = label.costs[0] + _SAME_PATHS, label.costs[1] + _SAME_PATHS
    return any(
        k[0] <= first and k[1] <= second and (not bounded or k[2] <= label.steps) for k in known
    )


def _passes(label: _Label, known: tuple[int, int, int], bounded: bool) -> bool:
    return (
        label.costs[0] <= known[0]
        and label.costs[1] <= known[1]
        and (not bounded or label.steps <= known[2])
    )
