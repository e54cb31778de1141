"""Joint A*: exact multi-agent search over the places of all agents together.

A* (Hart, Nilsson and Raphael, 1968) whose edges are synchronous steps: a set of moves of different
agents that do not clash. Paths are ordered by cost, then by number of steps, or vice versa. The
cost and the steps that each agent needs alone bound both, as a sum and as a maximum.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum

from skillplan_swarmitfix.multiagent.multi_agent import Move, MultiAgentProblem

_POLL_EVERY = 64


class Objective(StrEnum):
    """What counts first; the other breaks ties."""

    SWINGS = "swings"
    MAKESPAN = "makespan"


@dataclass(frozen=True, slots=True)
class JointResult:
    """What a joint search found.

    Parameters
    ----------
    steps
        The moves of every synchronous step; None where no plan was found.
    complete
        Whether the search ran to its end: the plan is optimal, or there is none.
    floor
        Lower bound on the objective.
    expanded
        Joint places expanded.
    """

    steps: tuple[tuple[Move, ...], ...] | None
    complete: bool
    floor: float
    expanded: int


def search_jointly(
    problem: MultiAgentProblem,
    objective: Objective,
    stop: Callable[[], bool],
    max_nodes: int,
) -> JointResult:
    """Return the best joint plan of all agents to their goals.

    Parameters
    ----------
    problem
        Agents, places and moves.
    objective
        The sum of costs, or the number of steps; the other breaks ties.
    stop
        Polled once in a while; the search ends without a plan once it is true.
    max_nodes
        The most joint places to generate, to limit memory.
    """
    by_cost = objective is Objective.SWINGS
    costs, lengths = problem.least_costs, problem.fewest_moves

    def ahead(places: tuple[int, ...]) -> tuple[float, float]:
        cost = sum(costs[agent][place] for agent, place in enumerate(places))
        steps = max(lengths[agent][place] for agent, place in enumerate(places))
        return (cost, steps) if by_cost else (steps, cost)

    start = problem.starts
    first, second = ahead(start)
    known: dict[tuple[int, ...], tuple[float, float]] = {start: (0.0, 0.0)}
    came: dict[tuple[int, ...], tuple[tuple[int, ...], tuple[Move, ...]]] = {}
    # Of equals, the farthest from the start first; then the order of creation.
    queue = [(first, second, 0.0, 0, start, (0.0, 0.0))] if math.isfinite(first) else []
    pushed, expanded, floor = 0, 0, first
    while queue:
        floor, _, _, _, places, so_far = heapq.heappop(queue)
        if so_far != known[places]:
            continue
        if places == problem.goals:
            return JointResult(_path(came, places), True, floor, expanded)
        if (expanded % _POLL_EVERY == 0 and stop()) or len(known) > max_nodes:
            return JointResult(None, False, floor, expanded)
        expanded += 1
        for moves in joint_steps(problem, places, problem.bits(places)):
            following = list(places)
            cost = 0.0
            for move in moves:
                following[move.agent] = move.end
                cost += move.cost
            to = tuple(following)
            step = (cost, 1.0) if by_cost else (1.0, cost)
            total = (so_far[0] + step[0], so_far[1] + step[1])
            if to not in known or total < known[to]:
                first, second = ahead(to)
                if math.isfinite(first):
                    known[to], came[to] = total, (places, moves)
                    pushed += 1
                    entry = (total[0] + first, total[1] + second, -total[0], pushed, to, total)
                    heapq.heappush(queue, entry)
    return JointResult(None, True, math.inf, expanded)


def joint_steps(
    problem: MultiAgentProblem, places: tuple[int, ...], bits: int
) -> Iterator[tuple[Move, ...]]:
    """Yield every nonempty set of moves that may be made at once."""
    ready = [
        [move for move in problem.moves[agent][place] if move.passes(bits)]
        for agent, place in enumerate(places)
    ]

    def extend(agent: int, chosen: tuple[Move, ...]) -> Iterator[tuple[Move, ...]]:
        if agent == len(ready):
            if chosen:
                yield chosen
            return
        yield from extend(agent + 1, chosen)
        for move in ready[agent]:
            if not any(move.clashes(other) for other in chosen):
                yield from extend(agent + 1, (*chosen, move))

    return extend(0, ())


def _path(
    came: dict[tuple[int, ...], tuple[tuple[int, ...], tuple[Move, ...]]],
    places: tuple[int, ...],
) -> tuple[tuple[Move, ...], ...]:
    steps = []
    while places in came:
        places, moves = came[places]
        steps.append(moves)
    return tuple(reversed(steps))
