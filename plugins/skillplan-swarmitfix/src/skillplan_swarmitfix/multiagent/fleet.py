"""Multi-agent path finding (MAPF): joint A* or LaCAM with MAPF-LNS; a plan and its schedule."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import BaseModel, Field

from skillplan.model.skill_model import SkillModel
from skillplan.solvers.solution import Plan, Solution
from skillplan.solvers.solver import Solver
from skillplan.solvers.stop import Stop
from skillplan.task import back_end
from skillplan_swarmitfix.multiagent.configuration_search import (
    ScheduleImprovement,
    search_with_restarts,
)
from skillplan_swarmitfix.multiagent.joint_search import Objective, ParallelSchedule, search_jointly
from skillplan_swarmitfix.multiagent.multi_agent import Move, MultiAgentProblem, NotMultiAgent

_TOLERANCE = 1e-9
_JOINT_UP_TO = 2


# Rounds of improvement where only the time limit ends them.
_MOST_ROUNDS = 1_000_000_000


class FleetSolver(Solver):
    """Bring several agents to their goals without conflicts; two of them with a proof."""

    name = "fleet"
    polls = True

    class Options(back_end.Options):
        """Method, objective and effort."""

        method: Literal["auto", "joint", "prioritised"] = Field(
            default="auto",
            description="joint: exact, over the places of all agents together; prioritised: fast "
            "and complete, then improved; auto: joint up to two agents [-]",
        )
        objective: Literal["swings", "makespan"] = Field(
            default="swings",
            description="the task's own cost or the number of parallel steps; "
            "the other breaks ties [-]",
        )
        restarts: int = Field(
            default=6,
            ge=0,
            le=1_000_000,
            description="searches of the prioritised method after the first that found a plan [-]",
        )
        rounds: int = Field(
            default=50,
            ge=0,
            le=10_000_000,
            description="rounds of improvement, in each of which some agents are replanned; with a "
            "time limit as many as it allows [-]",
        )
        max_nodes: int = Field(
            default=2_000_000,
            ge=1,
            description="joint places generated before the search ends, to limit memory [-]",
        )

    options: Options

    def __init__(self, options: BaseModel | None = None, stop: Stop | None = None) -> None:
        super().__init__(options, stop)
        self._known: tuple[SkillModel, MultiAgentProblem] | None = None

    def refuses(self, model: SkillModel) -> str | None:
        """Return the reason if the model does not consist of agents that move between places."""
        try:
            self._recognise(model)
        except NotMultiAgent as error:
            return str(error)
        return None

    def solve(self, model: SkillModel, *, seed: int = 0) -> Solution:
        """Search, let back ends check the plan's moves, and search again without rejected ones.

        Back ends reject few or no moves as a rule, and checking all of them beforehand would
        cost more than the search.
        """
        return _Run(self, model, self._recognise(model), seed).solution()

    def _recognise(self, model: SkillModel) -> MultiAgentProblem:
        """Return the problem of a model; the last one is kept, as it is needed twice."""
        if self._known is None or self._known[0] is not model:
            self._known = (model, MultiAgentProblem.from_model(model))
        return self._known[1]


@dataclass(frozen=True, slots=True)
class _Found:
    """A schedule, if any, with the bounds of the search."""

    schedule: ParallelSchedule | None
    complete: bool
    floor: float


class _Run:
    """One run of the solver: what its searches share."""

    def __init__(
        self, solver: FleetSolver, model: SkillModel, problem: MultiAgentProblem, seed: int
    ) -> None:
        self.options = solver.options
        self.stop = solver.stop
        self.model = model
        self.objective = Objective(self.options.objective)
        self.rng = random.Random(seed)
        self.problem = problem
        self.agents = range(len(self.problem.agents))
        joint = self.options.method == "joint" or (
            self.options.method == "auto" and len(self.agents) <= _JOINT_UP_TO
        )
        self.method = "joint" if joint else "prioritised"
        self.figures = {"expanded": 0, "searches": 0, "rounds": 0, "rejected": 0}
        self.bound_sum, self.bound_max = self._independent_bounds()

    def solution(self) -> Solution:
        """Return the best schedule found as a plan, with its proof."""
        if math.isinf(self.bound_sum) or self._shortest_plan() > self.problem.step_limit:
            return self._nothing(complete=True)
        self.stop.bound(self.bound_sum)
        while True:
            outcome = self._jointly() if self.method == "joint" else self._by_priority()
            if outcome.schedule is None:
                return self._nothing(outcome.complete)
            if self._passes(outcome.schedule):
                better = self._improved(outcome)
                if self._passes(better):
                    return self._solution(better, outcome)
            if self.stop():
                return self._nothing(complete=False)

    def _independent_bounds(self) -> tuple[float, float]:
        """Return the sum of the agents' least costs alone, and the longest of their paths."""
        starts = self.problem.starts
        costs = [self.problem.least_costs[i][starts[i]] for i in self.agents]
        lengths = [self.problem.fewest_moves[i][starts[i]] for i in self.agents]
        return sum(costs), max(lengths)

    def _shortest_plan(self) -> float:
        return sum(self.problem.fewest_moves[i][self.problem.starts[i]] for i in self.agents)

    def _jointly(self) -> _Found:
        result = search_jointly(self.problem, self.objective, self.stop, self.options.max_nodes)
        self.figures["expanded"] += result.expanded
        floor = result.floor if self.objective is Objective.SWINGS else self.bound_sum
        if result.steps is None:
            self.stop.bound(floor)
            self._end_by_limit(result.complete)
            return _Found(None, result.complete, floor)
        return _Found(_schedule(result.steps), result.complete, floor)

    def _by_priority(self) -> _Found:
        result = search_with_restarts(
            self.problem,
            self.rng,
            self.stop,
            restarts=self.options.restarts,
            max_nodes=self.options.max_nodes,
        )
        self.figures["expanded"] += result.generated
        self.figures["searches"] += result.searches
        if not result.plans:
            self._end_by_limit(result.complete)
            return _Found(None, result.complete, self.bound_sum)
        best = min(map(_schedule, result.plans), key=self._key)
        return _Found(best, False, self.bound_sum)

    def _improved(self, outcome: _Found) -> ParallelSchedule:
        """Return a schedule that is no worse; some of its moves may be unchecked."""
        assert outcome.schedule is not None
        if outcome.complete or any(move.rejected for move in self.problem.all_moves()):
            return outcome.schedule
        search = ScheduleImprovement(self.problem, self.objective, self.rng, self.stop)
        rounds = _MOST_ROUNDS if self.stop.limited else self.options.rounds
        better = _schedule(search.run(outcome.schedule.steps(), rounds))
        self.figures["rounds"] += search.rounds
        return min(better, outcome.schedule, key=self._key)

    def _key(self, schedule: ParallelSchedule) -> tuple[float, float]:
        cost = sum(timed.move.cost for timed in schedule.moves)
        if self.objective is Objective.SWINGS:
            return cost, schedule.makespan
        return schedule.makespan, cost

    def _passes(self, schedule: ParallelSchedule) -> bool:
        """Return whether back ends accept every move; the first rejected move is removed."""
        state, task = self.model.initial, self.model.task
        moves = _in_sequence(schedule)
        for move in moves:
            skill = task.skill(move.skill)
            verdict = self.model.verdict(state, skill)
            if not verdict.is_feasible:
                present = task.facts.none if verdict.present is None else verdict.present
                absent = task.facts.none if verdict.absent is None else verdict.absent
                self.problem = self.problem.without(move, present.bits, absent.bits)
                self.figures["rejected"] += 1
                return False
            state = skill.prediction_in(state).apply(state)
        if len(moves) <= self.problem.step_limit:
            self.stop.incumbent(self._plan(moves))
        return True

    def _plan(self, moves: Sequence[Move]) -> Plan:
        cost = math.fsum(move.cost for move in moves)
        return Plan(tuple(move.skill for move in moves), cost)

    def _end_by_limit(self, complete: bool) -> None:
        if not complete and not self.stop():
            self.stop.end(f"limit of {self.options.max_nodes:,} joint places")

    def _nothing(self, complete: bool) -> Solution:
        """Return the incumbent of the stop, if any, if the search found no plan."""
        if complete:
            return Solution(None, None, proved=True, trace=self._trace(None))
        return Solution(self.stop.best, self.stop.lower_bound, trace=self._trace(None))

    def _solution(self, schedule: ParallelSchedule, outcome: _Found) -> Solution:
        moves = _in_sequence(schedule)
        plan = self._plan(moves)
        assert plan.cost is not None
        exact = outcome.complete and self.objective is Objective.SWINGS
        bound = plan.cost if exact else outcome.floor
        proved = plan.cost - bound <= _TOLERANCE
        trace = self._trace(schedule)
        trace["makespan_proved"] = (
            outcome.complete and self.objective is Objective.MAKESPAN
        ) or schedule.makespan == self.bound_max
        if len(moves) > self.problem.step_limit:
            # The cheapest plan is too long; where every move costs the same, so is any other.
            same = len({move.cost for move in self.problem.all_moves()}) == 1
            return Solution(None, bound, proved=exact and same, trace=trace)
        self.stop.bound(bound)
        return Solution(plan, bound, proved=proved, trace=trace)

    def _trace(self, schedule: ParallelSchedule | None) -> dict[str, Any]:
        jointly = self.method == "joint" and self.objective is Objective.SWINGS
        trace: dict[str, Any] = {
            "method": self.method,
            "bound_method": "A* over the places of all agents together"
            if jointly
            else "the least cost of every agent alone",
            "objective": str(self.objective),
            **self.figures,
            "ended": self.stop.reason or "by itself",
        }
        if math.isfinite(self.bound_sum):
            trace["independent_bound_sum"] = self.bound_sum
            trace["independent_bound_max"] = self.bound_max
        if schedule is not None:
            trace["parallel_makespan"] = schedule.makespan
            trace["parallel_makespan_s"] = schedule.makespan_s
            trace["schedule"] = [[self._named(move) for move in step] for step in schedule.steps()]
            trace["timetable"] = [
                [timed.start_s, timed.end_s, *self._named(timed.move)]
                for timed in sorted(schedule.moves, key=lambda t: (t.start_s, t.move.agent))
            ]
        return trace

    def _named(self, move: Move) -> list[str]:
        """Return agent, action, and the places of a move by their names."""
        task = self.model.task
        places = self.problem.places[move.agent]
        ends = [places[move.start], places[move.end]]
        names = [task.places[fact].name if fact in task.places else fact for fact in ends]
        action = task.skill(move.skill).parameters.get("action", move.skill)
        return [self.problem.agents[move.agent], action, *names]


def _schedule(steps: Sequence[Sequence[Move]]) -> ParallelSchedule:
    return ParallelSchedule.earliest([move for step in steps for move in step])


def _in_sequence(schedule: ParallelSchedule) -> list[Move]:
    return [move for step in schedule.steps() for move in step]
