"""Repeated A* to the same goal, each search more focused than those before.

Adaptive A* (Koenig and Likhachev, "Adaptive A*", 2005): after a search with the least cost D from
its start, the cost to go of a state expanded at cost g is at least D - g. These bounds remain valid
for searches from other starts, as the goal does not change. Along the cheapest path they are exact,
so a later search ends at such a state.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable
from dataclasses import dataclass

from skillplan.model.skill_model import SkillModel
from skillplan.solvers.search.landmark_bound import (
    LandmarkBound,
    convert_from_units,
    convert_to_units,
)
from skillplan.solvers.stop import Stop
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task


@dataclass(frozen=True, slots=True)
class Step:
    """The first skill on a cheapest path from a state, and the cost to the goal."""

    skill: Skill
    to_go: int


class AdaptiveSearch:
    """Cheapest paths of a deterministic task from successive states.

    Parameters
    ----------
    max_labels
        Greatest number of labels of one search, >= 1.
    weight
        Factor on bounds on the cost to go, >= 1. Above 1 a path may cost up to this multiple of the
        least (weighted A*: Pohl, 1970), and other states learn nothing.
    ahead
        Another lower bound on the cost to the goal, by state; None for none.

    Attributes
    ----------
    searches, expanded
        Number of searches, and of states expanded by all of them.
    questions
        Bits of the facts that verdicts depended on; all bits for verdicts without such facts.
    floor
        Least possible cost of a path after an aborted search, >= 0.
    """

    def __init__(
        self,
        model: SkillModel,
        certain: Task,
        stop: Stop,
        max_labels: int,
        weight: float = 1.0,
        ahead: Callable[[State], float] | None = None,
    ) -> None:
        self._model, self._task, self._stop = model, certain, stop
        self._max_labels = max_labels
        self._landmarks = LandmarkBound(certain)
        self._bounds: dict[int, int] = {}
        self._steps: dict[int, Step] = {}
        self._tries = {
            skill.name: tuple(outcome for outcome in skill.outcomes[1:])
            for skill in model.task.skills
        }
        self._skills = {skill.name: skill for skill in certain.skills}
        self.searches = 0
        self.expanded = 0
        self.questions = 0
        self.floor = 0.0
        self._weight = weight
        self._ahead = ahead
        self._looked_ahead: dict[int, int] = {}

    def skill(self, state: State) -> Skill | None:
        """Return the first skill of a cheapest path, with its failures; None without a path."""
        step = self._step(state)
        return None if step is None else step.skill

    def cost(self, state: State) -> float | None:
        """Return the cost of a cheapest path to the goal; None without a path."""
        if self._model.is_goal(state):
            return 0.0
        step = self._step(state)
        return None if step is None else convert_from_units(step.to_go)

    def bound(self, state: State) -> float:
        """Return a lower bound on the cost to the goal without a search; inf for a dead end."""
        units = 0 if self._model.is_goal(state) else self._bound(state)
        return math.inf if units < 0 else convert_from_units(units)

    def _step(self, state: State) -> Step | None:
        if state.bits not in self._steps:
            self._search(state)
        return self._steps.get(state.bits)

    def _bound(self, state: State) -> int:
        """Return a lower bound on the cost to the goal [units]; -1 for a dead end."""
        known = self._steps.get(state.bits)
        if known is not None:
            return known.to_go
        own, _ = self._landmarks(state)
        if own < 0:
            return own
        learnt = self._bounds.get(state.bits, 0)
        return max(own, learnt, 0 if self._ahead is None else self._looking_ahead(state))

    def _looking_ahead(self, state: State) -> int:
        bounds = self._looked_ahead.get(state.bits)
        if bounds is None:
            assert self._ahead is not None
            bounds = self._looked_ahead[state.bits] = convert_to_units(self._ahead(state))
        return bounds

    def _search(self, start: State) -> None:
        """Find a cheapest path and keep its steps, if there is one."""
        self.searches += 1
        bound = self._bound(start)
        if bound < 0:
            return
        spent = {start.bits: 0}
        came: dict[int, tuple[State, Skill, int]] = {}
        closed: dict[int, int] = {}
        queue: list[tuple[int, int, State, int]] = [(bound, 0, start, 0)]
        labels = 0
        while queue:
            total, _, state, cost = heapq.heappop(queue)
            if cost > spent[state.bits] or state.bits in closed:
                continue
            if self._model.is_goal(state) or state.bits in self._steps:
                learnt = closed if self._weight == 1.0 else {}
                self._keep(start, state, total, came, learnt)
                return
            if labels > self._max_labels or (self.expanded % 64 == 0 and self._stop()):
                self.floor = convert_from_units(total) if self._weight == 1.0 else 0.0
                return
            closed[state.bits] = cost
            self.expanded += 1
            for skill in self._model.applicable(state):
                sure = self._skills[skill.name]
                following = sure.prediction_in(state).apply(state)
                step = convert_to_units(sure.cost.at(state))
                reached = cost + step
                if reached >= spent.get(following.bits, reached + 1):
                    continue
                bound = self._bound(following)
                if bound < 0 or not self.feasible(state, skill):
                    continue
                spent[following.bits] = reached
                came[following.bits] = (state, skill, step)
                closed.pop(following.bits, None)
                labels += 1
                ahead = reached + (bound if self._weight == 1.0 else int(self._weight * bound))
                heapq.heappush(queue, (ahead, -labels, following, reached))

    def feasible(self, state: State, skill: Skill) -> bool:
        """Return True if a skill can be executed, and tried again after a failure."""
        failed = (outcome.apply(state) for outcome in self._tries[skill.name])
        for where in (state, *failed):
            verdict = self._model.verdict(where, skill)
            if verdict.present is None or verdict.absent is None:
                self.questions = self._task.facts.all_bits
            else:
                self.questions |= verdict.present.bits | verdict.absent.bits
            if not verdict.is_feasible:
                return False
        return True

    def _keep(
        self,
        start: State,
        end: State,
        total: int,
        came: dict[int, tuple[State, Skill, int]],
        closed: dict[int, int],
    ) -> None:
        """Keep a path, and the bounds of the search on other states."""
        for bits, cost in closed.items():
            if total - cost > self._bounds.get(bits, 0):
                self._bounds[bits] = total - cost
        known = self._steps.get(end.bits)
        to_go = 0 if known is None else known.to_go
        state = end
        while state != start:
            state, skill, step = came[state.bits]
            to_go += step
            self._steps[state.bits] = Step(skill, to_go)
