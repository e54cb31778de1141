"""Chains of tasks: each solved in turn, the later ones grounded from what the earlier ones gave.

The hierarchical planner of Veeramani and Muthuswamy (section 4.1) is such a chain: heads along
the trajectory, goals of the base, paths of the base.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from skillplan.checks.single_check import introduce_back_ends
from skillplan.checks.verdict_cache import VerdictCache
from skillplan.domains.domain import Account
from skillplan.domains.load import Problem
from skillplan.errors import ChainBroken, SkillplanError
from skillplan.pipeline.run import attempt, grade, make_draft, make_solver, solve
from skillplan.pipeline.search.attempt import Attempt
from skillplan.pipeline.setup import Setup
from skillplan.pipeline.solver_choice import REFERENCE, made_for, solvers_by_stage
from skillplan.records.chain_result import ChainPart, ChainResult
from skillplan.records.grading import failed_grade
from skillplan.records.result import Result, Status
from skillplan.solvers.solution import Plan, Solution
from skillplan.solvers.stop import Stop
from skillplan.task.back_end import BackEnd
from skillplan.task.task import Task


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

    A task whose plan the domain has by a rule of its own is not searched, unless it is of the
    one stage that the solver is for; the other stages of such a solver are left to exact
    search, and where it fails it may request finer plans of the levels above, as often as its
    ``replans`` says. A policy answers later tasks with the same goal without planning again.
    Beside every plan stands the optimum that exact search proves.

    Parameters
    ----------
    problem
        A loaded file of one or several tasks.
    solver
        The solver's name; or one for every stage, as ``heads=monte-carlo,base=sarsa``, where
        ``exact`` takes the stages that are not named.
    setup
        Back ends and options.
    seed
        Governs all randomness.
    stop
        When to stop; its time limit is for the whole chain.
    cache
        Where verdicts are kept; a fresh one in memory by default.
    jobs
        In how many processes expensive back ends are queried; 1 for this one.
    audit
        As in `solve`, for each search.

    Raises
    ------
    OptionError, PluginError
        If a plugin or option is wrong.
    BackEndError
        If a back end fails.
    """
    stop = Stop() if stop is None else stop
    spare = problem.spare_back_ends
    return Chain(problem, solver, setup, seed, stop, cache, jobs, spare=spare, audit=audit).run()


class Chain:
    """The tasks of a problem, solved in turn.

    Parameters
    ----------
    problem, solver, setup, seed, stop, cache, jobs, audit
        As in `solve_chain`.
    spare
        Back ends constructed already; those that are used are taken out.

    Attributes
    ----------
    tasks
        As they stand, given the parts solved so far.
    parts
        What became of the first of them.
    plans
        Names of skills by the name of the task that they solve.
    replans
        How often the upper levels were planned again because a lower one had failed.
    """

    def __init__(
        self,
        problem: Problem,
        solver: str,
        setup: Setup,
        seed: int,
        stop: Stop,
        cache: VerdictCache | None,
        jobs: int,
        *,
        spare: list[BackEnd],
        audit: int | None = None,
    ) -> None:
        self.problem = problem
        self.solver = solver
        self.setup = setup
        self.seed = seed
        self.stop = stop
        self.cache = VerdictCache() if cache is None else cache
        self.jobs = jobs
        self.audit = audit
        self.spare = spare
        self.tasks = problem.tasks
        self.parts: list[ChainPart] = []
        self.plans: dict[str, tuple[str, ...]] = {}
        self.replans = 0
        stages = (*problem.domain.stages, *(task.stage for task in problem.tasks))
        self.solvers = solvers_by_stage(solver, dict.fromkeys(stages))
        # A solver that is made for a stage searches even what has a plan by rule.
        self.searched = {stage for stage, name in self.solvers.items() if made_for(name) == stage}
        self.policies: dict[tuple[object, ...], Attempt] = {}
        self.optima: dict[tuple[object, ...], tuple[float | None, str]] = {}

    def run(self) -> ChainResult:
        """Solve the tasks; errors are those of `solve_chain`."""
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
                finer = self._finer(task.stage, self.replans)
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

    def failed(self, error: SkillplanError) -> ChainResult:
        """Return the chain as far as it came before a solver or back end raised."""
        task = self.tasks[len(self.parts)]
        solver = self.solvers[task.stage]
        granted = failed_grade(error)
        result = make_draft(task, solver, self.setup, self.seed).graded(granted)
        self.parts.append(ChainPart(task, result))
        return self._result()

    def _result(self, broken: str = "") -> ChainResult:
        problem = self.problem
        return ChainResult(
            problem.name,
            problem.kind,
            problem.sha256,
            self.solver,
            self.seed,
            tuple(self.parts),
            len(self.tasks),
            Account() if broken else problem.account(self.plans, self.replans),
            self.replans,
            broken,
        )

    def _finer(self, stage: str, replans: int) -> tuple[Task, ...]:
        """Return the chain on finer plans of the upper levels; empty where there is none."""
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
            draft = make_draft(task, "rule", self.setup, self.seed, back_ends)
            return self._judged(task, Attempt(draft, by_rule, back_ends=back_ends))
        key = policy_key(task)
        stored = self.policies.get(key)
        if stored is not None and _answers(stored.solution, task):
            # What was claimed for the other start does not hold for this one.
            answer = Solution(stored.solution.policy, trace=stored.solution.trace)
            return replace(self._judged(task, replace(stored, solution=answer)), reused=True)
        made = self._attempt(task, self.solvers[task.stage])
        if made.solution.policy is not None and not made.stopped and not made.touched:
            self.policies[key] = made
        return self._judged(task, made)

    def rule_solution(self, task: Task) -> Solution | None:
        """Return what the domain's own rule says of a task; None if a solver is to search it."""
        if task.infeasible:
            return Solution(proved=True)
        if task.preset is None or task.stage in self.searched:
            return None
        return Solution(Plan(task.preset))

    def _attempt(self, task: Task, solver: str) -> Attempt:
        return attempt(
            task,
            solver,
            self.setup,
            seed=self.seed,
            stop=self.stop,
            cache=self.cache,
            jobs=self.jobs,
            back_ends=self._back_ends(task),
            audit=self.audit,
        )

    def _back_ends(self, task: Task) -> Sequence[BackEnd]:
        """Return the back ends for a task, spare ones where they fit."""
        return introduce_back_ends(self.setup.back_ends(task, self.spare))

    def _judged(self, task: Task, made: Attempt) -> ChainPart:
        result = grade(task, made, self.setup, self.cache, jobs=self.jobs)
        optimum, method = self._optimum(task, result, made.back_ends_of(task))
        cost, bound = result.cost, result.lower_bound
        if cost is not None and optimum is not None and (bound is None or bound < optimum):
            result = replace(result, lower_bound=min(optimum, cost), bound_method=method)
        # Where nothing was searched, or only the optimum beside it, no result mentions it.
        result = replace(result, interrupted=result.interrupted or self.stop.interrupted)
        return ChainPart(task, result, optimum)

    def _optimum(
        self, task: Task, result: Result, back_ends: Sequence[BackEnd] | None
    ) -> tuple[float | None, str]:
        """Return the proved optimum of a task and what proved it.

        By exact search where the solver gave no bound.
        """
        if result.status is Status.OPTIMAL:
            return result.cost, result.bound_method
        if result.lower_bound is not None or not task.deterministic or self.stop():
            return None, ""
        key = (task.initial, task.goal, task.facts.names, task.skills)
        if key not in self.optima:
            stop = self.stop.within(_REFERENCE_S)
            best = solve(
                task,
                REFERENCE,
                self.setup,
                stop=stop,
                cache=VerdictCache(),
                jobs=self.jobs,
                back_ends=back_ends,
            )
            proved = best.status is Status.OPTIMAL
            self.optima[key] = (best.cost, best.bound_method) if proved else (None, "")
        return self.optima[key]


def policy_key(task: Task) -> tuple[object, ...]:
    """Return the properties of a task on which a policy depends, without its start."""
    return (task.goal, task.facts.names, task.skills, task.reward, task.step_limit)


def _answers(solution: Solution, task: Task) -> bool:
    """Whether a stored policy knows what to do at the start of a task with the same goal."""
    policy = solution.policy
    return policy is not None and (task.goal.holds(task.initial) or task.initial in policy)


# Exact search of one task, to stand beside a solver's plan, takes no longer than this.
_REFERENCE_S = 5.0
