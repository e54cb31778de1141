"""A model as a multi-agent problem: each agent moves between places of its own.

Stern et al., "Multi-agent pathfinding: definitions, variants, and benchmarks" (2019),
generalised: a move excludes not one vertex or edge, but everything that its case
forbids and occupies, such as the pins that a swing sweeps. Models that do not have this structure
are refused in words.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

from skillplan.errors import SkillplanError
from skillplan.model.skill_model import SkillModel
from skillplan.task.cost import CaseCost, ConstantCost, Cost
from skillplan.task.skill import Case, Skill
from skillplan.task.state import State
from skillplan.task.task import Task


class NotMultiAgent(SkillplanError):
    """A model does not have the structure of agents that move between places of their own."""


@dataclass(frozen=True, slots=True)
class Move:
    """One move of one agent from a place to another.

    Parameters
    ----------
    index
        Number among the problem's moves, from 0.
    agent, start, end
        Indices of the agent and of two of its places.
    start_bit, end_bit
        Bits of the facts that it stands there.
    skill
        Name of the skill.
    forbids
        Bits of the others' places that must be empty.
    occupies
        Bits of the resources that it needs to itself while it runs.
    cost
        In the task's metric, >= 0.
    duration_s
        Time it takes [s], >= 0.
    rejected
        Pairs of bits of facts, present and absent, with which back ends do not let it pass.
    """

    index: int
    agent: int
    start: int
    end: int
    start_bit: int
    end_bit: int
    skill: str
    forbids: int
    occupies: int
    cost: float
    duration_s: float
    rejected: tuple[tuple[int, int], ...] = ()

    def passes(self, bits: int) -> bool:
        """Return whether it is allowed with the agents at `bits` and its own agent at its start."""
        if self.forbids & bits:
            return False
        return not any(
            bits & present == present and not bits & absent for present, absent in self.rejected
        )

    def clashes(self, other: Move) -> bool:
        """Return whether two moves of different agents must not overlap in time.

        Moves that do not clash may be made in either order and at once. One that back ends
        reject depending on the others is made alone.
        """
        return bool(
            self.occupies & other.occupies
            or self.forbids & (other.start_bit | other.end_bit)
            or other.forbids & (self.start_bit | self.end_bit)
            or self.rejected
            or other.rejected
        )


Moves = tuple[tuple[Move, ...], ...]
"""The moves of one agent by the index of the place where they start."""


@dataclass(frozen=True)
class MultiAgentProblem:
    """Agents that have to reach their goals without blocking each other.

    Parameters
    ----------
    agents
        Names of the n agents.
    places
        Facts of each agent's places.
    place_bits
        Their bits.
    starts, goals
        Index of each agent's first and last place.
    moves
        Moves of each agent by place; moves that stay are left out, as waiting needs no skill.
    resources
        Names of what moves occupy; bit i of `Move.occupies` is the i-th.
    step_limit
        The most moves a plan of the task may have.

    Raises
    ------
    ValueError
        If the numbers of agents, places, starts, goals and moves do not agree.
    """

    agents: tuple[str, ...]
    places: tuple[tuple[str, ...], ...]
    place_bits: tuple[tuple[int, ...], ...]
    starts: tuple[int, ...]
    goals: tuple[int, ...]
    moves: tuple[Moves, ...]
    resources: tuple[str, ...]
    step_limit: int

    def __post_init__(self) -> None:
        n = len(self.agents)
        given = (self.places, self.place_bits, self.starts, self.goals, self.moves)
        if any(len(values) != n for values in given):
            raise ValueError(f"MultiAgentProblem needs n = {n} of everything that agents have.")
        for places, bits, moves in zip(self.places, self.place_bits, self.moves, strict=True):
            if not len(places) == len(bits) == len(moves):
                raise ValueError("MultiAgentProblem needs a bit and a list of moves for a place.")

    @classmethod
    def from_model(cls, model: SkillModel) -> MultiAgentProblem:
        """Recognise the structure in a model; queries no back end.

        Raises
        ------
        NotMultiAgent
            If the model does not have this structure; the message gives the reason.
        """
        return cls.from_task(model.task)

    @classmethod
    def from_task(cls, task: Task) -> MultiAgentProblem:
        """Recognise the structure in a task.

        Raises
        ------
        NotMultiAgent
            If the task does not have this structure; the message gives the reason.
        """
        return _Recognition(task).problem()

    def bits(self, places: tuple[int, ...]) -> int:
        """Return the bits of the state in which the agents stand at `places`."""
        return sum(bits[place] for bits, place in zip(self.place_bits, places, strict=True))

    def all_moves(self) -> Iterator[Move]:
        """Yield every move, by agent and place."""
        return (move for moves in self.moves for here in moves for move in here)

    def without(self, move: Move, present: int, absent: int) -> MultiAgentProblem:
        """Return the problem in which back ends reject a move where these facts are so.

        The move is dropped where this rests on its own agent's place alone.
        """
        own = sum(self.place_bits[move.agent])
        at_start = move.start_bit
        if present & ~at_start == 0 and not absent & ~own and not absent & at_start:
            kept: tuple[Move, ...] = ()
        else:
            kept = (replace(move, rejected=(*move.rejected, (present, absent))),)
        mine = list(self.moves[move.agent])
        others = [kept if m.index == move.index else (m,) for m in mine[move.start]]
        mine[move.start] = tuple(m for group in others for m in group)
        moves = list(self.moves)
        moves[move.agent] = tuple(mine)
        return replace(self, moves=tuple(moves))

    @cached_property
    def least_costs(self) -> tuple[tuple[float, ...], ...]:
        """Cost of each agent's cheapest path to its goal from every place, alone; inf for none."""
        return tuple(
            self._distances(agent, [[move.cost for move in here] for here in moves])
            for agent, moves in enumerate(self.moves)
        )

    @cached_property
    def fewest_moves(self) -> tuple[tuple[float, ...], ...]:
        """Length of each agent's shortest path to its goal from every place, alone."""
        return tuple(
            self._distances(agent, [[1.0] * len(here) for here in moves])
            for agent, moves in enumerate(self.moves)
        )

    def _distances(self, agent: int, weights: list[list[float]]) -> tuple[float, ...]:
        back: list[list[tuple[int, float]]] = [[] for _ in self.places[agent]]
        for here, values in zip(self.moves[agent], weights, strict=True):
            for move, weight in zip(here, values, strict=True):
                back[move.end].append((move.start, weight))
        distances = [math.inf] * len(back)
        distances[self.goals[agent]] = 0.0
        queue = [(0.0, self.goals[agent])]
        while queue:
            distance, place = heapq.heappop(queue)
            if distance > distances[place]:
                continue
            for before, weight in back[place]:
                if distance + weight < distances[before]:
                    distances[before] = distance + weight
                    heapq.heappush(queue, (distance + weight, before))
        return tuple(distances)


def cost_of_agents_alone(problem: MultiAgentProblem) -> float:
    """Return the sum of the agents' least costs if no agent blocked another; a lower bound.

    For ``verify``, so by uniform-cost search (Dijkstra, 1959) in code that no solver uses.
    """
    total = 0.0
    for agent, (start, goal) in enumerate(zip(problem.starts, problem.goals, strict=True)):
        queue, settled = [(0.0, start)], set[int]()
        least_cost = math.inf
        while queue:
            cost, place = heapq.heappop(queue)
            if place == goal:
                least_cost = cost
                break
            if place in settled:
                continue
            settled.add(place)
            for move in problem.moves[agent][place]:
                heapq.heappush(queue, (cost + move.cost, move.end))
        total += least_cost
    return total


class _Recognition:
    """Shared state of the recognition of agents."""

    def __init__(self, task: Task) -> None:
        self.task = task
        self.agents = self._agents()
        self.groups = [self._group(agent) for agent in self.agents]
        facts = task.facts
        self.bits = [tuple(facts.bit(fact) for fact in group) for group in self.groups]
        self.place = [{bit: i for i, bit in enumerate(bits)} for bits in self.bits]
        self.own = [sum(bits) for bits in self.bits]
        self.resources: dict[str, int] = {}
        self.index = 0
        self._sets: dict[frozenset[str], int] = {}

    def problem(self) -> MultiAgentProblem:
        """Return the recognised problem."""
        everything = sum(self.own)
        if len({fact for group in self.groups for fact in group}) < sum(map(len, self.groups)):
            raise self._no("two agents share places")
        if everything != self.task.facts.all_bits:
            rest = self.task.facts.names_of(self.task.facts.all_bits & ~everything)
            raise self._no(f"{rest[0]} is not the place of an agent")
        if self.task.goal.forbids.bits:
            raise self._no("its goal forbids facts")
        starts = [self._only(i, self.task.initial, "starts at") for i in range(len(self.agents))]
        goals = [self._only(i, self.task.goal.requires, "has to reach") for i in range(len(starts))]
        moves: list[list[list[Move]]] = [[[] for _ in group] for group in self.groups]
        for skill in self.task.skills:
            self._add(skill, moves)
        return MultiAgentProblem(
            tuple(self.agents),
            tuple(self.groups),
            tuple(self.bits),
            tuple(starts),
            tuple(goals),
            tuple(tuple(tuple(here) for here in mine) for mine in moves),
            tuple(self.resources),
            self.task.step_limit,
        )

    def _no(self, reason: str) -> NotMultiAgent:
        return NotMultiAgent(f"{self.task.name!r} is not a multi-agent problem: {reason}.")

    def _agents(self) -> list[str]:
        for skill in self.task.skills:
            if len(skill.agents) != 1:
                raise self._no(f"{skill.name} needs {len(skill.agents)} agents at once")
            if not skill.cases:
                raise self._no(f"{skill.name} does not depend on where its agent stands")
            if not skill.deterministic:
                raise self._no(f"{skill.name} may have several outcomes")
        if not self.task.skills:
            raise self._no("it has no skills")
        return list(dict.fromkeys(skill.agents[0] for skill in self.task.skills))

    def _group(self, agent: str) -> tuple[str, ...]:
        """Return the exclusive facts that the cases of an agent's skills are selected by."""
        selectors = {
            fact
            for skill in self.task.skills
            if skill.agents[0] == agent
            for case in skill.cases
            for fact in case.fact
        }
        for group in self.task.facts.exclusive:
            if selectors <= set(group):
                return group
        raise self._no(f"the cases of {agent}'s skills are not one exclusive group of facts")

    def _only(self, agent: int, facts: State, what: str) -> int:
        """Return the only place of an agent among some facts."""
        facts_places = [self.place[agent].get(self.task.facts.bit(fact)) for fact in facts]
        places = [place for place in facts_places if place is not None]
        if len(places) != 1:
            raise self._no(f"{self.agents[agent]} {what} {len(places)} places, not one")
        return places[0]

    def _add(self, skill: Skill, moves: list[list[list[Move]]]) -> None:
        """Add the moves of a skill to its agent."""
        agent = self.agents.index(skill.agents[0])
        own, place = self.own[agent], self.place[agent]
        if skill.precondition.requires.bits or skill.precondition.forbids.bits & ~own:
            raise self._no(f"{skill.name} has a precondition other than its agent's place")
        costs = self._by_place(skill, skill.cost, "cost")
        durations_s = self._by_place(skill, skill.duration_s, "duration")
        for case in skill.cases:
            start_bit = case.fact.bits
            end_bit = self._end_bit(skill, case, agent)
            if end_bit == start_bit or start_bit & (
                skill.precondition.forbids.bits | case.forbids.bits
            ):
                continue
            start, end = place[start_bit], place[end_bit]
            moves[agent][start].append(
                Move(
                    self.index,
                    agent,
                    start,
                    end,
                    start_bit,
                    end_bit,
                    skill.name,
                    case.forbids.bits & ~own,
                    self._occupied(case.occupies),
                    costs[start_bit],
                    durations_s[start_bit],
                )
            )
            self.index += 1

    def _end_bit(self, skill: Skill, case: Case, agent: int) -> int:
        (outcome,) = case.outcomes
        start, add, delete = case.fact.bits, outcome.add.bits, outcome.delete.bits
        end = add or start
        if end not in self.place[agent] or (end != start and delete != start) or delete & ~start:
            raise self._no(f"{skill.name} does more than take {skill.agents[0]} to another place")
        return end

    def _by_place(self, skill: Skill, cost: Cost, what: str) -> Mapping[int, float]:
        """Return the value of a skill's cost by the bit of the place where it starts."""
        starts = [case.fact.bits for case in skill.cases]
        if isinstance(cost, ConstantCost):
            return dict.fromkeys(starts, cost.value)
        if isinstance(cost, CaseCost) and cost.values.keys() == set(starts):
            return cost.values
        raise self._no(f"the {what} of {skill.name} depends on more than its agent's place")

    def _occupied(self, names: frozenset[str]) -> int:
        bits = self._sets.get(names)
        if bits is None:
            bits = 0
            for name in sorted(names):
                bits |= self.resources.setdefault(name, 1 << len(self.resources))
            self._sets[names] = bits
        return bits
