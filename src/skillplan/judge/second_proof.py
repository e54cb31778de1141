"""Least costs worked out a second time, for small cases, in code that no solver shares.

A checker that used the search it checks would repeat its faults. So here are the two plainest
methods there are, without bounds, pruning, compiled code or options: a dynamic program over
orders of jobs (Held and Karp, "A dynamic programming approach to sequencing problems", 1962;
restricted to sets closed under the precedence relation, as by Escudero, 1988), and uniform-cost
search over the lazy model (Dijkstra, 1959). Both are given up beyond a limit.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skillplan.errors import SearchStopped
from skillplan.model.skill_model import SkillModel, Transition
from skillplan.task.state import State

if TYPE_CHECKING:
    from skillplan.model.sequencing import SequencingProblem

MOST_SUBSETS = 1_000_000
MOST_STATES = 200_000
ORDERS = "dynamic program over orders of jobs"
STATES = "uniform-cost search over all states"
_STOPPED = "stopped before it was done"
_POLL_EVERY = 1_024


@dataclass(frozen=True, slots=True)
class LeastCost:
    """What a method came to.

    Parameters
    ----------
    method
        In words.
    cost
        The least cost of any plan, infinite where there is none; None where the method was given
        up.
    skills
        A plan of that cost; empty where there is none.
    why_not
        Why the method was given up; empty where it was not.
    """

    method: str
    cost: float | None = None
    skills: tuple[str, ...] = ()
    why_not: str = ""


def least_cost_of_orders(
    problem: SequencingProblem,
    over: Callable[[], bool] = lambda: False,
    most_subsets: int = MOST_SUBSETS,
) -> LeastCost:
    """Return the least cost of doing all jobs, by how much has been done and which job was last.

    Parameters
    ----------
    problem
        n jobs, costs between them and their precedence.
    over
        Polled once in a while; the method is given up once it is true.
    most_subsets
        The most pairs of a set of jobs and its last job.
    """
    n = len(problem.jobs)
    if n == 0:
        return LeastCost(ORDERS, 0.0)
    before = [0] * n
    for earlier, later in problem.precedence:
        before[later] |= 1 << earlier
    costs = [[float(cost) for cost in row] for row in problem.costs]
    # Pairs of a set and its last job: the least cost, and the last job but one.
    layer = {(1 << j, j): (float(problem.first[j]), -1) for j in range(n) if before[j] == 0}
    layers = [layer]
    kept = len(layer)
    for _ in range(n - 1):
        following: dict[tuple[int, int], tuple[float, int]] = {}
        for count, ((done, last), (cost, _)) in enumerate(layer.items()):
            if count % _POLL_EVERY == 0 and over():
                return LeastCost(ORDERS, why_not=_STOPPED)
            for job in range(n):
                if done >> job & 1 or before[job] & ~done:
                    continue
                total, key = cost + costs[last][job], (done | 1 << job, job)
                if total < following.get(key, (math.inf, -1))[0]:
                    following[key] = (total, last)
            if kept + len(following) > most_subsets:
                why = f"too large, more than {most_subsets:,} sets of jobs"
                return LeastCost(ORDERS, why_not=why)
        layer = following
        layers.append(layer)
        kept += len(layer)
    if not layer:
        return LeastCost(ORDERS, math.inf)
    (done, last), (least, _) = min(layer.items(), key=lambda entry: entry[1][0])
    if math.isinf(least):
        return LeastCost(ORDERS, math.inf)
    order: list[int] = []
    for layer in reversed(layers):
        order.append(last)
        done, last = done & ~(1 << last), layer[done, last][1]
    skills = problem.plan(order[::-1])
    if len(skills) > problem.step_limit:
        why = f"the cheapest order takes {len(skills)} skills, the limit is {problem.step_limit}"
        return LeastCost(ORDERS, why_not=why)
    return LeastCost(ORDERS, least, skills)


def least_cost_of_states(
    model: SkillModel,
    over: Callable[[], bool] = lambda: False,
    most_states: int = MOST_STATES,
) -> LeastCost:
    """Return the least cost of a plan within the step limit, state by state in order of cost.

    Of several paths to a state all are kept of which none is both cheaper and shorter.

    Parameters
    ----------
    model
        A deterministic model; it is queried on every state that is cheaper than the goal.
    over
        Polled once in a while; the method is given up once it is true.
    most_states
        The most paths to states that are looked at.

    Raises
    ------
    BackEndError
        If a back end fails.
    """
    # The path to a state: its last step and the path before that; for the initial state None.
    start: _Path | None = None
    queue: list[tuple[float, int, int, State, _Path | None]] = [(0.0, 0, 0, model.initial, start)]
    shortest: dict[State, int] = {}
    pushed = looked_at = 0
    try:
        while queue and not model.stats.unknown:
            cost, steps, _, state, path = heapq.heappop(queue)
            if shortest.get(state, model.step_limit + 1) <= steps:
                continue
            shortest[state] = steps
            if model.is_goal(state):
                return LeastCost(STATES, cost, _skills(path))
            looked_at += 1
            if looked_at > most_states:
                return LeastCost(STATES, why_not=f"too large, more than {most_states:,} states")
            if looked_at % _POLL_EVERY == 0 and over():
                return LeastCost(STATES, why_not=_STOPPED)
            if steps == model.step_limit:
                continue
            for step in model.transitions(state):
                if shortest.get(step.next_state, model.step_limit + 1) <= steps + 1:
                    continue
                pushed += 1
                entry = (cost + step.cost, steps + 1, pushed, step.next_state, (step, path))
                heapq.heappush(queue, entry)
    except SearchStopped:
        return LeastCost(STATES, why_not=_STOPPED)
    if model.stats.unknown:
        return LeastCost(STATES, why_not="some verdicts are unknown")
    return LeastCost(STATES, math.inf)


_Path = tuple[Transition, "_Path | None"]


def _skills(path: _Path | None) -> tuple[str, ...]:
    names = []
    while path is not None:
        step, path = path
        names.append(step.skill.name)
    return tuple(reversed(names))
