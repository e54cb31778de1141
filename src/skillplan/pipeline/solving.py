"""The straight line from a request to a judged result: model the task, search it, judge the answer.

`search` runs the solver and returns its claims, `grade` has the referee check them.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from skillplan.checks.audit import SampleSize, VerdictSample, ask_again, draw_sample
from skillplan.checks.feasibility import CheckCount, Feasibility
from skillplan.checks.single_check import list_not_checked
from skillplan.checks.verdict_cache import DiskVerdictCache, VerdictCache
from skillplan.domains.load import Problem
from skillplan.errors import (
    BackEndError,
    OptionError,
    SearchStopped,
    SkillplanError,
    SolverError,
    name_hint,
)
from skillplan.files.folder import get_cache_folder
from skillplan.judge.referee import judge
from skillplan.model.policy_value import roll_out
from skillplan.model.replay import replay
from skillplan.model.skill_model import ModelStats, SkillModel
from skillplan.pipeline import registry
from skillplan.pipeline.setup import Setup
from skillplan.plugins.blame import blame
from skillplan.records.result import Result, Status, tolerance
from skillplan.solvers.solution import Plan, Solution
from skillplan.solvers.solver import Solver
from skillplan.solvers.stop import Stop
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.workers.supervised import doing

if TYPE_CHECKING:  # most files hold a single task
    from skillplan.records.chain_result import ChainResult

DEFAULT_SOLVER = "auto"
REFERENCE = "exact"
"""Solver of the stages of a chain for which none is named, and of reference optima."""


@dataclass(frozen=True, slots=True)
class SearchRequest:
    """A task, the solver that searches it, and the terms of the search.

    Parameters
    ----------
    solver
        A solver's name, or a solver object, which is given `stop`.
    setup
        Back ends and plugin options.
    seed
        Seed of all random numbers.
    stop
        Limits of the search; none by default.
    cache
        Verdict cache; by default a new one in memory.
    jobs
        Number of processes for expensive back ends and parallel solvers, >= 1.
    start
        A plan to start from. If it holds, the result costs no more.
    back_ends
        Back ends constructed for this task and setup; None to construct them.
    audit
        Number of reused verdicts to recompute after the search; None for a few cheap ones.
    """

    task: Task
    solver: str | Solver = DEFAULT_SOLVER
    setup: Setup = field(default_factory=Setup)
    seed: int = 0
    stop: Stop = field(default_factory=Stop)
    cache: VerdictCache = field(default_factory=VerdictCache)
    jobs: int = 1
    start: Plan | None = None
    back_ends: Sequence[BackEnd] | None = None
    audit: int | None = None

    @property
    def sample_size(self) -> SampleSize:
        """Number and kind of the verdicts that are recomputed after the search."""
        return SampleSize.of(self.audit, self.seed)


@dataclass(frozen=True, slots=True)
class SearchOutcome:
    """The claims of a solver, which the referee has not seen yet, and the effort behind them.

    Parameters
    ----------
    solution
        Plan or policy, bound and proof as the solver claims them.
    stats
        Queries of the search; None if nothing was searched.
    sample
        Verdicts to recompute that another process has drawn; None after a search in this one.
    solver
        Name of the solver, or ``rule`` for a plan by the domain's own rule.
    wall_s
        Duration of the search [s].
    stopped
        Reason why the search was stopped; None if it ended by itself.
    refusal
        Reason why the solver does not serve the task; None if it does.
    back_ends
        The back ends that were queried.
    not_checked
        Sentences of the back ends about unchecked properties of the task.
    doubt
        Reason why a claimed proof is not granted; empty without one.
    """

    solution: Solution = field(default_factory=Solution)
    stats: ModelStats | None = None
    sample: VerdictSample | None = None
    solver: str = ""
    wall_s: float = 0.0
    stopped: str | None = None
    interrupted: bool = False
    refusal: str | None = None
    back_ends: Sequence[BackEnd] = ()
    not_checked: tuple[str, ...] = ()
    doubt: str = ""

    def back_ends_for(self, task: Task) -> Sequence[BackEnd]:
        """Return the back ends if they were constructed for this task, or else none."""
        fit = all(back_end.task is task for back_end in self.back_ends)
        return self.back_ends if fit else ()


def solve_problem(
    problem: Problem,
    part: str | None = None,
    solver: str | None = None,
    setup: Setup = Setup(),
    *,
    seed: int = 0,
    stop: Stop | None = None,
    cache: VerdictCache | None = None,
    jobs: int = 1,
    start: Plan | None = None,
    audit: int | None = None,
) -> Result | ChainResult:
    """Solve the tasks of a loaded file and have the answers judged.

    Back ends that loading constructed are used again.

    Parameters
    ----------
    problem
        A loaded file of one or several tasks.
    part
        Name of one task of a chain; None for the only task or the whole chain.
    solver
        A solver's name, for a chain also one for each stage as in `solve_chain`; None for the
        default of the kind of task.
    setup, seed, stop, cache, jobs, audit
        As in `SearchRequest`. For a chain the time limit covers all tasks, and the audit each
        search.
    start
        A plan to start from; only for a single task.

    Returns
    -------
    Result or ChainResult
        The latter for a whole chain.

    Raises
    ------
    OptionError, PluginError
        If a plugin or option is wrong, no task has the name `part`, or the start plan is for
        another task or for a whole chain.
    SolverError
        If the solver fails.
    BackEndError
        If a back end fails.
    """
    name = solver or problem.domain.default_solver(problem.config)
    if problem.is_chain and part is None:
        if start is not None:
            raise OptionError("A plan to start from is for one task of a chain; name its part.")
        from skillplan.pipeline.chain import solve_chain

        return solve_chain(
            problem, name, setup, seed=seed, stop=stop, cache=cache, jobs=jobs, audit=audit
        )
    task = problem.part(part)
    stop, cache = stop or Stop(), VerdictCache() if cache is None else cache
    back_ends = setup.back_ends(task, problem.spare_back_ends)
    request = SearchRequest(task, name, setup, seed, stop, cache, jobs, start, back_ends, audit)
    return grade(request, search(request))


def solve(
    task: Task,
    solver: str | Solver = DEFAULT_SOLVER,
    setup: Setup = Setup(),
    *,
    seed: int = 0,
    stop: Stop | None = None,
    cache: VerdictCache | None = None,
    jobs: int = 1,
    start: Plan | None = None,
    back_ends: Sequence[BackEnd] | None = None,
    audit: int | None = None,
) -> Result:
    """Solve a task and have the solution judged.

    Parameters
    ----------
    task, solver, setup, seed, stop, cache, jobs, start, back_ends, audit
        As in `SearchRequest`.

    Raises
    ------
    OptionError, PluginError
        If a plugin or option is wrong, or the start plan is for another task.
    SolverError
        If the solver fails.
    BackEndError
        If a back end fails or contradicts itself.
    """
    stop, cache = stop or Stop(), VerdictCache() if cache is None else cache
    request = SearchRequest(task, solver, setup, seed, stop, cache, jobs, start, back_ends, audit)
    return grade(request, search(request))


def search(request: SearchRequest) -> SearchOutcome:
    """Run the solver of a request and return its claims; raises the errors of `solve`."""
    setup, stop = request.setup, request.stop
    if isinstance(request.solver, str):
        solver = make_solver(request.solver, setup.options.get(request.solver, {}), stop)
    else:
        solver = request.solver
        solver.stop = stop
    solver.jobs, solver.make_executor = request.jobs, setup.make_executor
    stop.decimals = request.task.metric.decimals
    model = make_model(
        request.task,
        setup,
        request.cache,
        stop.overdue,
        jobs=request.jobs,
        on_check=stop.checked,
        back_ends=request.back_ends,
    )
    back_ends = model.feasibility.back_ends
    ungraded = SearchOutcome(
        solver=solver.name, back_ends=back_ends, not_checked=list_not_checked(back_ends)
    )
    if model.feasibility.screens:
        from skillplan.pipeline.screening import search_by_geometry

        proof = search_by_geometry(model, request)
        if proof is not None:
            return replace(proof, solver=solver.name, not_checked=ungraded.not_checked)
    begin_s = time.perf_counter()
    with blame_solver(type(solver)):
        refusal = solver.find_refusal(model)
    if refusal is not None:
        return replace(ungraded, refusal=refusal)
    with closing(model.feasibility):
        run = _choose_process(solver, model, request)
        outcome = run() if request.start is None else _search_from(request, model, solver, run)
    wall_s = time.perf_counter() - begin_s
    trace, doubt = outcome.solution.trace, ""
    if not stop.interrupted:
        sample = outcome.sample or draw_sample(model.feasibility, request.sample_size)
        # The other process has recomputed its verdicts once; this one has not.
        ask_again(back_ends, sample.reused, times=2 if sample.elsewhere else 1)
        if model.feasibility.screens:
            from skillplan.pipeline.screening import execute_sample

            screened = execute_sample(back_ends, sample, stop)
            trace = {**trace, "screening": screened.document()}
            doubt = screened.overruled
    foresight = model.feasibility.foresight
    if foresight is not None and foresight.made:
        trace = {**trace, "ahead": {"useful": foresight.useful, "wasted": foresight.wasted}}
    return replace(
        ungraded,
        solution=replace(outcome.solution, trace=trace),
        stats=outcome.stats,
        wall_s=wall_s,
        stopped=stop.reason,
        interrupted=stop.interrupted,
        doubt=doubt,
    )


def _choose_process(
    solver: Solver, model: SkillModel, request: SearchRequest
) -> Callable[[], SearchOutcome]:
    """Return a function that searches, in another process if the solver has to be ended."""
    stop, size = request.stop, request.sample_size
    # A solver object stays in the process of its caller.
    if isinstance(request.solver, str) and not solver.polls and stop.limits_effort:
        from skillplan.pipeline import separate_process

        if separate_process.is_possible():
            return partial(separate_process.search_apart, solver, model, request)
    model.feasibility.reused.keep(size.reused)
    return partial(run_solver, solver, model, request.seed, stop)


def _search_from(
    request: SearchRequest, model: SkillModel, solver: Solver, run: Callable[[], SearchOutcome]
) -> SearchOutcome:
    """Replay a known plan, pass it to the solver, and keep it if the solver finds no cheaper plan.

    A plan that fails on the model is not used. The entry ``start`` of the trace reports this.
    """
    task, start, stop = request.task, request.start, request.stop
    assert start is not None
    if not task.deterministic:
        raise OptionError(f"A plan to start from is of no use under chance, as in {task.name}.")
    back_ends = model.feasibility.back_ends
    # Verdicts of expensive back ends on the start plan serve the search, too.
    kept = request.cache if list_expensive(back_ends) else None
    fresh = SkillModel(Feasibility(task, back_ends, kept, jobs=request.jobs))
    with closing(fresh.feasibility), blame_solver(type(solver)):
        replayed = replay(fresh, [task.skill(name) for name in start.skills])
        if replayed.violations:
            fault = replayed.violations[0]
            where = f"step {fault.step + 1} ({fault.skill})" if fault.skill else "the end"
            reason = f"{fault.stage}: {fault.reason}"
            words = f"the plan given is not used, it fails at {where}: {reason}"
            outcome = run()
            solution = outcome.solution
        else:
            words = f"from a plan of {task.cost_text(replayed.cost)}"
            known = Plan(start.skills, replayed.cost)
            stop.incumbent(known)
            outcome = run()
            solution = outcome.solution
            if _costs_less(replayed.cost, solution, fresh):
                solution = replace(solution, found=known)
    return replace(outcome, solution=replace(solution, trace={**solution.trace, "start": words}))


def _costs_less(known: float, solution: Solution, model: SkillModel) -> bool:
    """Return whether a known cost is below a solution's, or the solution lacks a complete plan."""
    plan, policy, task = solution.plan, solution.policy, model.task

    def choose(state: State) -> Skill | None:
        skill = None if policy is None else policy.get(state)
        return None if skill is None else task.skills[task.action(skill)]

    cost = None if plan is None else plan.cost
    if cost is None:
        try:
            if plan is not None:
                skills = [task.skill(name) for name in plan.skills]
            elif policy is not None:
                skills = roll_out(model, choose)
            else:
                return True
            replayed = replay(model, skills)
        except OptionError:
            # The referee rejects a plan for another task.
            return False
        if not replayed.complete:
            return True
        cost = replayed.cost
    return known < cost - tolerance(cost)


def run_solver(solver: Solver, model: SkillModel, seed: int, stop: Stop) -> SearchOutcome:
    """Let a solver search a model in this process.

    If the model stops it, the outcome is the best plan and bound that `stop` has received.

    Raises
    ------
    SolverError
        If the solver fails, or does not return a solution.
    """
    names = ", ".join(back_end.name for back_end in model.feasibility.back_ends)
    activity = f"the search by the solver {solver.name!r} with {names}"
    left_s = stop.left_s
    # The model ends a solver that does not poll a second after the limit; this comes after it.
    limit_s = None if left_s is None else 1.1 * left_s + 1.5
    try:
        if stop.interrupted:
            # A signal came while the task was prepared.
            raise SearchStopped
        with doing(activity, limit_s=limit_s), blame_solver(type(solver)):
            solution = solver.solve(model, seed=seed)
    except SearchStopped:
        # Polled, as it may be the first to notice that the time is over.
        stop()
        solution = Solution(stop.best, stop.lower_bound)
    if not isinstance(solution, Solution):
        raise SolverError(
            f"The solver {solver.name!r} returned {type(solution).__name__}, not a Solution."
        )
    try:
        return SearchOutcome(solution.with_plain_numbers(), model.stats)
    except Exception as error:
        words = f"The solver {solver.name!r} returned a Solution that cannot be read"
        raise SolverError(f"{words}: {error}.") from None


def make_feasibility(
    task: Task,
    setup: Setup = Setup(),
    cache: VerdictCache | None = None,
    *,
    jobs: int = 1,
    on_check: Callable[[CheckCount], None] | None = None,
    back_ends: Sequence[BackEnd] | None = None,
) -> Feasibility:
    """Return the chain of checks for a task, with the parameters of `make_model`."""
    chain = setup.back_ends(task) if back_ends is None else back_ends
    return Feasibility(
        task, chain, cache, jobs=jobs, make_executor=setup.make_executor, on_check=on_check
    )


def make_model(
    task: Task,
    setup: Setup = Setup(),
    cache: VerdictCache | None = None,
    overdue: Callable[[], bool] | None = None,
    *,
    jobs: int = 1,
    on_check: Callable[[CheckCount], None] | None = None,
    back_ends: Sequence[BackEnd] | None = None,
) -> SkillModel:
    """Return the lazy model of a task.

    Parameters
    ----------
    task
        The task to model.
    setup
        Back ends and options.
    cache
        Verdict cache; by default a new one in memory.
    overdue
        Returns True once a solver should have stopped long ago.
    jobs
        Number of processes for expensive checks, >= 1.
    on_check
        Called with the checks of expensive back ends.
    back_ends
        Back ends constructed for this task and setup; None to construct them.
    """
    feasibility = make_feasibility(
        task, setup, cache, jobs=jobs, on_check=on_check, back_ends=back_ends
    )
    return SkillModel(feasibility, overdue)


def make_solver(name: str, options: Mapping[str, Any], stop: Stop | None = None) -> Solver:
    """Return a solver by name.

    Raises
    ------
    OptionError
        If an option is wrong.
    PluginError
        If the solver is unknown or broken.
    SolverError
        If the solver fails to start.
    """
    plugin = registry.load("solver", name)
    validated = registry.make_options("solver", name, plugin, options)
    with blame_solver(plugin):
        solver: Solver = plugin(validated, stop)
    return solver


def check_solver(name: str, options: Mapping[str, Any]) -> None:
    """Check a solver's name and options without constructing it.

    Raises
    ------
    OptionError
        If an option is wrong.
    PluginError
        If the solver is unknown or broken.
    """
    registry.make_options("solver", name, registry.load("solver", name), options)


def map_solvers(spec: str, stages: Iterable[str]) -> dict[str, str]:
    """Return the solver of every stage.

    Parameters
    ----------
    spec
        A solver's name, or ``STAGE=NAME`` entries after commas or plus signs.
    stages
        The stages that there may be.

    Raises
    ------
    OptionError
        If an entry names a stage that there is not.
    PluginError
        If a solver is unknown or broken.
    """
    stages = list(stages)
    if "=" not in spec:
        only = find_stage(spec)
        return {stage: spec if only in (None, stage) else REFERENCE for stage in stages}
    chosen = dict.fromkeys(stages, REFERENCE)
    named: set[str] = set()
    for entry in _entries(spec):
        stage, _, name = entry.partition("=")
        if stage in named:
            raise OptionError(f"Two solvers for the stage {stage!r}. Give one.")
        named.add(stage)
        if stage not in chosen:
            raise OptionError(f"No stage {stage!r} in this task. {name_hint(stage, stages)}")
        find_stage(name)
        chosen[stage] = name
    return chosen


def list_solvers(spec: str) -> tuple[str, ...]:
    """Return the solvers that a choice of solvers names."""
    if "=" not in spec:
        return (spec,)
    return tuple(dict.fromkeys(entry.partition("=")[2] for entry in _entries(spec)))


def _entries(spec: str) -> list[str]:
    return [entry.strip() for entry in spec.replace("+", ",").split(",") if entry.strip()]


def find_stage(name: str) -> str | None:
    """Return the only stage that a solver searches, or None."""
    plugin: type[Solver] = registry.load("solver", name)
    return plugin.stage


@contextmanager
def blame_solver(plugin: type[Solver]) -> Iterator[None]:
    """Raise foreign exceptions as `SolverError` with the solver's name and line of code."""
    try:
        yield
    except BaseException as error:
        blame(
            error, plugin, lambda words: f"The solver {plugin.name!r} failed: {words}", SolverError
        )


def grade(request: SearchRequest, outcome: SearchOutcome) -> Result:
    """Have the referee judge the claims of a solver in a fresh model.

    The claims may come from another task of the same skills, as a stored policy also answers from
    other starts.

    Parameters
    ----------
    request
        Task, back ends and options by which the claims are judged.
    outcome
        The claims.
    """
    task, setup, solution = request.task, request.setup, outcome.solution
    ungraded = describe(request, outcome)
    if outcome.refusal is not None:
        return replace(ungraded, status=Status.REFUSED, reason=outcome.refusal)
    back_ends = outcome.back_ends_for(task) or setup.back_ends(task)
    # Verdicts of expensive back ends do not depend on the solver and are used again.
    kept = list_expensive(back_ends)
    fresh = make_model(
        task, setup, request.cache.only(kept), jobs=request.jobs, back_ends=back_ends
    )
    stats = outcome.stats or ModelStats()
    with closing(fresh.feasibility):
        result = judge(
            ungraded,
            solution,
            fresh,
            unknown_met=stats.unknown > 0,
            audit=not kept,
            left_open=stats.left_open,
        )
        reason = result.reason
        if result.status is Status.INFEASIBLE:
            from skillplan.pipeline.obstacles import explain_infeasible

            reason = task.infeasible or explain_infeasible(fresh, charted=not kept)
    claimed = solution.trace.get("reason")
    if result.status is Status.UNSOLVED and isinstance(claimed, str):
        reason = claimed
    if outcome.doubt and result.status in (Status.OPTIMAL, Status.SOLVED, Status.INFEASIBLE):
        status = Status.UNSOLVED if result.cost is None else Status.SOLVED
        result, reason = replace(result, status=status, lower_bound=None), outcome.doubt
    if result.status in (Status.SOLVED, Status.UNSOLVED) and outcome.stopped:
        reason = f"{outcome.stopped}: {reason}" if reason else outcome.stopped
    bound_method = ""
    if result.lower_bound is not None:
        # No search has proved the trivial bound 0.
        method = result.solver if result.lower_bound else "no cost being below 0"
        bound_method = str(solution.trace.get("bound_method") or method)
    policy = None if result.cost is None else solution.policy
    return replace(result, reason=reason, bound_method=bound_method, policy=policy)


def describe(request: SearchRequest, outcome: SearchOutcome = SearchOutcome()) -> Result:
    """Return an unsolved result that names the task, the solver and the effort of a search."""
    task, setup, solver = request.task, request.setup, request.solver
    name = outcome.solver or (solver if isinstance(solver, str) else solver.name)
    result = Result(
        task=task.name,
        kind=task.kind,
        sha256=task.sha256,
        solver=name,
        seed=request.seed,
        physics=setup.physics_choice(task).name,
        collision=setup.detector_names(task),
        status=Status.UNSOLVED,
        cost_unit=task.metric.unit,
        timed_by=setup.timed_by(task),
        wall_s=outcome.wall_s,
        interrupted=outcome.interrupted,
        trace=outcome.solution.trace,
        not_checked=outcome.not_checked,
        dwells_from=task.dwells_from,
    )
    stats, trace = outcome.stats, outcome.solution.trace
    if stats is None:
        return result
    iterations = _read_count(trace, "iterations", "expanded", "visited")
    return replace(
        result,
        states=max(stats.states, _read_count(trace, "states") or 0),
        expanded=stats.states if iterations is None else iterations,
        checks=stats.checks,
        cache_hits=stats.cache_hits,
        trajectories=stats.trajectories,
    )


def describe_failure(request: SearchRequest, error: SkillplanError) -> Result:
    """Return the result of a solver that failed, or met a back end that did."""
    back_end_failed = isinstance(error, BackEndError)
    return replace(
        describe(request), status=Status.FAILED, reason=str(error), back_end_failed=back_end_failed
    )


def _read_count(trace: Mapping[str, Any], *names: str) -> int | None:
    """Return the first of some figures of a trace that is a count."""
    for name in names:
        figure = trace.get(name)
        if isinstance(figure, int) and figure >= 0:
            return figure
    return None


def list_expensive(back_ends: Iterable[BackEnd]) -> tuple[BackEnd, ...]:
    """Return the back ends whose verdicts are worth keeping."""
    return tuple(back_end for back_end in back_ends if back_end.expensive)


def open_warm_cache() -> DiskVerdictCache:
    """Return the cache that is kept between runs."""
    return DiskVerdictCache(get_cache_folder() / "verdicts")
