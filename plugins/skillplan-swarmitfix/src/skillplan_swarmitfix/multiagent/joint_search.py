"""Joint A*: exact multi-agent search over the places of all agents together.

A* (Hart, Nilsson and Raphael, 1968) whose edges are synchronous steps: a set of moves of different
agents that do not clash. Paths are ordered by cost, then by number of steps, or vice versa. The
cost and the steps that each agent needs alone bound both, as a sum and as a maximum.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum

from skillplan_swarmitfix.multiagent.multi_agent import Move, MultiAgentProblem

_POLL_EVERY = 64


class Objective(StrEnum):
    """First objective; the other breaks ties."""

    SWINGS = "swings"
    MAKESPAN = "makespan"


@dataclass(frozen=True, slots=True)
class JointResult:
    """Result of a joint search.

    Parameters
    ----------
    steps
        The moves of every synchronous step; None where no plan was found.
    complete
        True if the search finished: the plan is optimal, or none exists.
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
    problem: MultiAgentProblem, objective: Objective, stop: Callable[[], bool], max_nodes: int
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
    came: dict[tuple[int, ...], tuple[tuple[int, ...], tuple[Move, ...]]], places: tuple[int, ...]
) -> tuple[tuple[Move, ...], ...]:
    steps = []
    while places in came:
        places, moves = came[places]
        steps.append(moves)
    return tuple(reversed(steps))


@dataclass(frozen=True, slots=True)
class TimedMove:
    """A move and when it runs.

    Parameters
    ----------
    move
        Moves of the plan.
    step
        The synchronous step in which it is made, from 0.
    start_s
        When it starts where none waits for a step to end [s].

    Raises
    ------
    ValueError
        If it starts before the beginning.
    """

    move: Move
    step: int
    start_s: float

    def __post_init__(self) -> None:
        if self.step < 0 or not self.start_s >= 0:
            raise ValueError(f"A move cannot be made in step {self.step}, at {self.start_s} s.")

    @property
    def end_s(self) -> float:
        """When it ends [s]."""
        return self.start_s + self.move.duration_s


@dataclass(frozen=True, slots=True)
class ParallelSchedule:
    """A sequence of moves, each as early as its predecessors allow.

    Parameters
    ----------
    moves
        In the order of the sequence.

    Raises
    ------
    ValueError
        If two moves of one step clash.
    """

    moves: tuple[TimedMove, ...]

    def __post_init__(self) -> None:
        for step in self.steps():
            for i, move in enumerate(step):
                if any(move.agent == other.agent or move.clashes(other) for other in step[:i]):
                    raise ValueError(f"{move.skill} clashes with another move of its step.")

    @classmethod
    def earliest(cls, moves: Sequence[Move]) -> ParallelSchedule:
        """Return the earliest schedule, in steps and in seconds, of a sequence of moves."""
        timed: list[TimedMove] = []
        for move in moves:
            step, start_s = 0, 0.0
            for before in timed:
                if before.move.agent == move.agent or before.move.clashes(move):
                    step = max(step, before.step + 1)
                    start_s = max(start_s, before.end_s)
            timed.append(TimedMove(move, step, start_s))
        return cls(tuple(timed))

    def steps(self) -> tuple[tuple[Move, ...], ...]:
        """Return the moves of every synchronous step, by agent; they may be made in any order."""
        steps: list[list[Move]] = [[] for _ in range(self.makespan)]
        for timed in self.moves:
            steps[timed.step].append(timed.move)
        return tuple(tuple(sorted(step, key=lambda move: move.agent)) for step in steps)

    @property
    def makespan(self) -> int:
        """Number of synchronous steps."""
        return max((timed.step + 1 for timed in self.moves), default=0)

    @property
    def makespan_s(self) -> float:
        """When the last move ends where none waits for a step to end [s]."""
        return max((timed.end_s for timed in self.moves), default=0.0)
