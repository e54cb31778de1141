"""Chains of tasks: each solved in turn, the later ones grounded from the plans of the earlier ones.

The hierarchical planner of Veeramani and Muthuswamy (section 4.1) is such a chain: heads along
the trajectory, goals of the base, paths of the base.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from skillplan.checks.single_check import introduce_back_ends, list_not_checked
from skillplan.checks.verdict_cache import VerdictCache
from skillplan.domains.domain import Account
from skillplan.domains.load import Problem
from skillplan.errors import ChainBroken, SkillplanError
from skillplan.pipeline.setup import Setup
from skillplan.pipeline.solving import (
    REFERENCE,
    SearchOutcome,
    SearchRequest,
    describe_failure,
    find_stage,
    grade,
    make_solver,
    map_solvers,
    search,
)
from skillplan.records.chain_result import ChainPart, ChainResult
from skillplan.records.result import Result, Status
from skillplan.solvers.solution import Plan, Solution
from skillplan.solvers.stop import Stop
from skillplan.task.back_end import BackEnd
from skillplan.task.task import Task

# Time limit of the exact search whose optimum is shown with a solver's plan [s].
_REFERENCE_S = 5.0


def solve_chain(
    problem: Problem,
    solver: str,
    setup: Setup = Setup(),
    *,
    seed: int = 0,
    stop: Stop | None = None,
    cache: VerdictCache | None = None,
    jobs: int = 1,
    audit: int | None = None,
) -> ChainResult:
    """Solve the tasks of a problem in turn and have each judged.

    A task whose plan the domain has by a rule of its own is not searched, unless the solver is
    made for its stage. Exact search solves the other stages of such a solver. If the solver fails,
    it may request finer plans of the levels above, at most ``replans`` times. A policy
    answers later tasks with the same goal without planning again. Beside each plan stands the
    optimum that exact search proves.

    Parameters
    ----------
    problem
        A loaded file of one or several tasks.
    solver
        A solver's name; or one for each stage, as ``heads=monte-carlo,base=sarsa``, where
        ``exact`` solves the stages that are not named.
    setup, seed, cache, jobs, audit
        As in `SearchRequest`.
    stop
        Limits; the time limit is for the whole chain.

    Raises
    ------
    OptionError, PluginError
        If a plugin or option is wrong.
    BackEndError
        If a back end fails.
    """
    stop, cache = stop or Stop(), VerdictCache() if cache is None else cache
    request = SearchRequest(problem.tasks[0], solver, setup, seed, stop, cache, jobs, audit=audit)
    return Chain(problem, request, problem.spare_back_ends).run()


class Chain:
    """The tasks of a problem, solved in turn.

    Parameters
    ----------
    problem
        A loaded file of one or several tasks.
    request
        The request for each search. Its task is replaced. Its solver is one name, or one for each
        stage as in `solve_chain`.
    spare
        Back ends constructed already; a back end is taken out when it is used.

    Attributes
    ----------
    tasks
        The tasks, grounded with the plans so far.
    parts
        The solved tasks with their results.
    plans
        Names of skills by the name of the task that they solve.
    replans
        Number of times that the upper levels were planned again because a lower one had failed.
    """

    def __init__(self, problem: Problem, request: SearchRequest, spare: list[BackEnd]) -> None:
        self.problem = problem
        self.request = request
        self.setup, self.stop = request.setup, request.stop
        self.spare = spare
        self.tasks = problem.tasks
        self.parts: list[ChainPart] = []
        self.plans: dict[str, tuple[str, ...]] = {}
        self.replans = 0
        stages = (*problem.domain.stages, *(task.stage for task in problem.tasks))
        assert isinstance(request.solver, str)
        self.solver = request.solver
        self.solvers = map_solvers(self.solver, dict.fromkeys(stages))
        # A solver that is made for a stage searches even the tasks that have a plan by rule.
        self.searched = {stage for stage, name in self.solvers.items() if find_stage(name) == stage}
        self.policies: dict[tuple[object, ...], SearchOutcome] = {}
        self.optima: dict[tuple[object, ...], tuple[float | None, str]] = {}

    def run(self) -> ChainResult:
        """Solve the tasks; raises the errors of `solve_chain`."""
        while len(self.parts) < len(self.tasks):
            task = self.tasks[len(self.parts)]
            if self.parts and task.stage != self.parts[-1].task.stage:
                try:
                    self.tasks = self.problem.follow(self.plans, self.replans)
                except ChainBroken as error:
                    return self._result(f"{error}")
                task = self.tasks[len(self.parts)]
            part = self._part(task)
            searched = task.stage in self.searched and not task.infeasible
            if part.result.cost is None and searched:
                finer = self._plan_finer(task.stage, self.replans)
                if finer:
                    self.tasks, self.parts, self.plans = finer, [], {}
                    self.replans += 1
                    continue
            self.parts.append(part)
            if part.result.cost is None:
                break
            self.plans[task.name] = tuple(step.skill for step in part.result.steps)
            if self.stop.interrupted:
                break
        return self._result()

    def end_with(self, error: SkillplanError) -> ChainResult:
        """Return the chain so far, ended by a solver or back end that raised."""
        task = self.tasks[len(self.parts)]
        request = replace(self.request, task=task, solver=self.solvers[task.stage])
        self.parts.append(ChainPart(task, describe_failure(request, error)))
        return self._result()

    def _result(self, broken: str = "") -> ChainResult:
        problem = self.problem
        return ChainResult(
            problem.name,
            problem.kind,
            problem.sha256,
            self.solver,
            self.request.seed,
            tuple(self.parts),
            len(self.tasks),
            Account() if broken else problem.account(self.plans, self.replans),
            self.replans,
            broken,
        )

    def _plan_finer(self, stage: str, replans: int) -> tuple[Task, ...]:
        """Return the chain on finer plans of the upper levels; empty if there is none."""
        name = self.solvers[stage]
        most = make_solver(name, self.setup.options.get(name, {})).replans
        if replans >= most or self.stop():
            return ()
        return self.problem.follow({}, replans + 1)

    def _part(self, task: Task) -> ChainPart:
        self.stop.renew()
        by_rule = self.rule_solution(task)
        if by_rule is not None:
            back_ends = self._back_ends(task)
            outcome = SearchOutcome(
                by_rule, solver="rule", back_ends=back_ends, not_checked=list_not_checked(back_ends)
            )
            return self._judge(task, outcome)
        key = policy_key(task)
        stored = self.policies.get(key)
        if stored is not None and _can_answer(stored.solution, task):
            # The claims about the other start do not hold for this one.
            answer = Solution(stored.solution.policy, trace=stored.solution.trace)
            return replace(self._judge(task, replace(stored, solution=answer)), reused=True)
        outcome = search(
            replace(
                self.request,
                task=task,
                solver=self.solvers[task.stage],
                back_ends=self._back_ends(task),
            )
        )
        if outcome.solution.policy is not None and not outcome.stopped:
            self.policies[key] = outcome
        return self._judge(task, outcome)

    def rule_solution(self, task: Task) -> Solution | None:
        """Return the solution by the domain's own rule; None if a solver has to search."""
        if task.infeasible:
            return Solution(proved=True)
        if task.preset is None or task.stage in self.searched:
            return None
        return Solution(Plan(task.preset))

    def _back_ends(self, task: Task) -> Sequence[BackEnd]:
        """Return the back ends for a task, spare ones if they fit."""
        return introduce_back_ends(self.setup.back_ends(task, self.spare))

    def _judge(self, task: Task, outcome: SearchOutcome) -> ChainPart:
        request = replace(self.request, task=task)
        result = grade(request, outcome)
        optimum, method = self._optimum(task, result, outcome.back_ends_for(task))
        cost, bound = result.cost, result.lower_bound
        if cost is not None and optimum is not None and (bound is None or bound < optimum):
            result = replace(result, lower_bound=min(optimum, cost), bound_method=method)
        # The result of a search lacks an interruption that came after it.
        result = replace(result, interrupted=result.interrupted or self.stop.interrupted)
        return ChainPart(task, result, optimum)

    def _optimum(
        self, task: Task, result: Result, back_ends: Sequence[BackEnd]
    ) -> tuple[float | None, str]:
        """Return the proved optimum of a task and its method, by exact search if need be."""
        if result.status is Status.OPTIMAL:
            return result.cost, result.bound_method
        if result.lower_bound is not None or not task.deterministic or self.stop():
            return None, ""
        key = (task.initial, task.goal, task.facts.names, task.skills)
        if key not in self.optima:
            request = SearchRequest(
                task,
                REFERENCE,
                self.setup,
                stop=self.stop.within(_REFERENCE_S),
                jobs=self.request.jobs,
                back_ends=back_ends or None,
            )
            best = grade(request, search(request))
            proved = best.status is Status.OPTIMAL
            self.optima[key] = (best.cost, best.bound_method) if proved else (None, "")
        return self.optima[key]


def policy_key(task: Task) -> tuple[object, ...]:
    """Return the properties of a task that determine a policy; its start is not one of them."""
    return (task.goal, task.facts.names, task.skills, task.reward, task.step_limit)


def _can_answer(solution: Solution, task: Task) -> bool:
    """Return whether a stored policy covers the start of a task with the same goal."""
    policy = solution.policy
    return policy is not None and (task.goal.holds(task.initial) or task.initial in policy)
