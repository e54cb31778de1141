"""A model as a sequential ordering problem: jobs, costs between them, and precedence.

Escudero (1988): an asymmetric path through all jobs that respects a precedence relation. A job
is the run of skills that brings one element of the product to its goal, such as pick and place;
what a tool change costs is part of the way from one job to the next. Models that do not have
this structure are refused in words.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from skillplan.errors import NotASequencing
from skillplan.model.inquiry import Imagination
from skillplan.model.precedence_chart import derive_chart
from skillplan.model.skill_model import SkillModel
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task

_MAX_CONNECTIONS = 1_000


@dataclass(frozen=True)
class SequencingProblem:
    """Jobs to be put into an order.

    Parameters
    ----------
    jobs
        Names of the n elements.
    skills
        The skills of every job.
    first
        Cost of coming to a job from the initial state and doing it, shape (n,).
    costs
        Cost of coming from job i to job j and doing it, shape (n, n); the diagonal is inf.
    precedence
        Pairs of indices: the first before the second.
    ways
        The skills between the initial state (-1), or a job, and a job: tool changes.
    step_limit
        The most skills a plan of the task may have. An order does not know of it: one whose
        plan is longer is no solution of the task.

    Raises
    ------
    ValueError
        If the shapes do not fit or the precedence names an unknown job.
    """

    jobs: tuple[str, ...]
    skills: tuple[tuple[str, ...], ...]
    first: NDArray[np.float64]
    costs: NDArray[np.float64]
    precedence: frozenset[tuple[int, int]]
    ways: dict[tuple[int, int], tuple[str, ...]]
    step_limit: int

    def __post_init__(self) -> None:
        n = len(self.jobs)
        if len(self.skills) != n or self.first.shape != (n,) or self.costs.shape != (n, n):
            raise ValueError(f"SequencingProblem needs n = {n} jobs, (n,) and (n, n) costs.")
        if any(not (0 <= i < n and 0 <= j < n) for i, j in self.precedence):
            raise ValueError("SequencingProblem precedence names an unknown job.")

    def cost(self, order: Sequence[int]) -> float:
        """Return the cost of doing all jobs in an order."""
        between = sum(self.costs[i, j] for i, j in pairwise(order))
        return float(self.first[order[0]] + between) if len(order) else 0.0

    def plan(self, order: Sequence[int]) -> tuple[str, ...]:
        """Return the skills of doing all jobs in an order, tool changes included."""
        names: list[str] = []
        for before, job in zip((-1, *order), order, strict=False):
            names += [*self.ways[before, job], *self.skills[job]]
        return tuple(names)

    @classmethod
    def from_model(cls, model: SkillModel) -> SequencingProblem:
        """Recognise the structure in a model; the precedence relation is asked of its back ends.

        Raises
        ------
        NotASequencing
            If the model does not have it; the message says what stands against it.
        """
        return _Recognition(model).problem()


class _Recognition:
    """What the steps of recognising share."""

    def __init__(self, model: SkillModel) -> None:
        self.model = model
        self.task: Task = model.task
        if not self.task.deterministic:
            raise self._no("skills may have several outcomes")
        if any(skill.cases for skill in self.task.skills):
            raise self._no("what a skill brings about depends on the state")
        self.imagination = Imagination(self.task)
        goal = list(self.task.goal.requires)
        self.elements = [e for e, fact in self.task.operations.items() if fact in goal]
        if len(self.elements) != len(goal) or self.task.goal.forbids.bits:
            raise self._no("its goal is not just to finish elements of the product")
        self.chains = [self._chain(element) for element in self.elements]
        inside = {skill.name for chain in self.chains for skill in chain}
        self.connectors = [s for s in self.task.skills if s.name not in inside]

    def problem(self) -> SequencingProblem:
        """Return the recognised problem."""
        precedence = self._precedence()
        n = len(self.elements)
        first = np.empty(n)
        costs = np.full((n, n), math.inf)
        ways: dict[tuple[int, int], tuple[str, ...]] = {}
        for j in range(n):
            first[j], ways[-1, j] = self._connect(self.task.initial, j)
        after = [self._after(j, ways[-1, j]) for j in range(n)]
        for i in range(n):
            for j in range(n):
                if i != j:
                    costs[i, j], ways[i, j] = self._connect(after[i], j)
        return SequencingProblem(
            tuple(self.elements),
            tuple(tuple(skill.name for skill in chain) for chain in self.chains),
            first,
            costs,
            precedence,
            ways,
            self.task.step_limit,
        )

    def _no(self, reason: str) -> NotASequencing:
        return NotASequencing(f"{self.task.name!r} is not a sequencing problem: {reason}.")

    def _chain(self, element: str) -> list[Skill]:
        """Return the skills that must follow each other to finish an element."""
        fact = self.task.operations[element]
        chain: list[Skill] = []
        while fact not in self.task.initial:
            makers = [s for s in self.task.skills if fact in s.prediction.add]
            if len(makers) != 1:
                raise self._no(f"{len(makers)} skills bring about {fact}")
            chain.insert(0, makers[0])
            own = [
                name
                for name in makers[0].precondition.requires
                if self.imagination.owner(name) == element and name not in self.task.initial
            ]
            if not own:
                return chain
            if len(own) > 1 or len(chain) > len(self.task.skills):
                raise self._no(f"{makers[0].name} needs several facts of {element}")
            fact = own[0]
        return chain

    def _precedence(self) -> frozenset[tuple[int, int]]:
        chart = derive_chart(self.model.feasibility)
        if chart.impossible:
            skill, why = next(iter(chart.impossible.items()))
            raise self._no(f"{skill} is never feasible ({why})")
        if chart.undecided:
            raise self._no(f"the order around {chart.undecided[0]} could not be worked out")
        if chart.circle:
            raise self._no(f"it has no order, {' before '.join(chart.circle)}")
        if chart.conditional:
            skill, facts = next(iter(chart.conditional.items()))
            raise self._no(f"{skill} depends on more than an order: {', '.join(facts)}")
        index = {element: i for i, element in enumerate(self.elements)}
        pairs = [(r.before, r.after) for r in chart.relations]
        left_out = {name for pair in pairs for name in pair} - set(index)
        if left_out:
            raise self._no(f"{min(left_out)} takes part without being in the goal")
        return frozenset((index[before], index[after]) for before, after in pairs)

    def _check_connector(self, skill: Skill, state: State) -> None:
        """Demand that a tool change is feasible wherever it is applicable.

        Its verdict may rest on tools and the hand, not on places or what has been done.
        """
        verdict = self.model.verdict(state, skill)
        facts = [*(verdict.present or ()), *(verdict.absent or ())]
        stands = self.imagination.stands
        if not verdict.is_feasible or any(
            fact in stands or self.imagination.owner(fact) is not None for fact in facts
        ):
            raise self._no(f"{skill.name} is not feasible wherever it is applicable")

    def _after(self, job: int, way: tuple[str, ...]) -> State:
        """Return a state right after a job, in which no other job is done."""
        state = self.task.initial
        for name in way:
            state = self.task.skills[self.task.action(name)].prediction.apply(state)
        for skill in self.chains[job]:
            state = skill.prediction.apply(state)
        return state

    def _connect(self, start: State, job: int) -> tuple[float, tuple[str, ...]]:
        """Return the least cost of coming from a state to a job and doing it, and the way."""
        queue: list[tuple[float, int, State, tuple[str, ...]]] = [(0.0, 0, start, ())]
        done: set[State] = set()
        best: tuple[float, tuple[str, ...]] = (math.inf, ())
        pushed = 0
        while queue and len(done) < _MAX_CONNECTIONS:
            cost, _, state, way = heapq.heappop(queue)
            if cost >= best[0]:
                break
            if state in done:
                continue
            done.add(state)
            own = self._cost_of_chain(state, job)
            if own is not None and cost + own < best[0]:
                best = (cost + own, way)
            for skill in self.connectors:
                if skill.precondition.holds(state):
                    self._check_connector(skill, state)
                    pushed += 1
                    total = cost + skill.cost.at(state)
                    following = skill.prediction.apply(state)
                    heapq.heappush(queue, (total, pushed, following, (*way, skill.name)))
        if math.isinf(best[0]):
            raise self._no(f"nothing leads to {self.elements[job]} from {start}")
        return best

    def _cost_of_chain(self, state: State, job: int) -> float | None:
        """Return the cost of a job's skills from a state, or None where they do not follow."""
        cost = 0.0
        chain = self.chains[job]
        for position, skill in enumerate(chain):
            # What other jobs have to do first is the precedence relation's business.
            blocked = [f for f in skill.precondition.why_not(state) if not self._foreign(f, job)]
            if blocked:
                return None
            cost += skill.cost.at(state)
            state = skill.prediction.apply(state)
            if position + 1 < len(chain):
                others = [s.name for s in self.model.applicable(state) if s != chain[position + 1]]
                if others:
                    raise self._no(f"{others[0]} may come between the skills of a job")
        return cost

    def _foreign(self, amiss: str, job: int) -> bool:
        owner = self.imagination.owner(amiss.removeprefix("not "))
        return owner in self.elements and owner != self.elements[job]
