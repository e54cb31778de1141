"""The straight line: make a model of a task, solve it, and have the referee judge."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from typing import Any

from skillplan.checks.feasibility import CheckCount, Feasibility
from skillplan.checks.single_check import IntroducedBackEnds, list_not_checked
from skillplan.checks.verdict_cache import DiskVerdictCache, VerdictCache
from skillplan.files.cache_folder import cache_folder
from skillplan.judge.referee import judge
from skillplan.model.skill_model import SkillModel
from skillplan.pipeline import registry
from skillplan.pipeline.search.attempt import Attempt, Terms, attempted
from skillplan.pipeline.search.solver_call import blamed
from skillplan.pipeline.setup import CHART, Setup
from skillplan.records.grading import Draft, Grade
from skillplan.records.result import Result, Status
from skillplan.solvers.solution import Plan, Solution
from skillplan.solvers.solver import Solver
from skillplan.solvers.stop import Stop
from skillplan.task.back_end import BackEnd
from skillplan.task.task import Task

DEFAULT_SOLVER = "auto"

# Larger tasks are not charted just to say why they have no plan.
_MOST_CHARTED = 64
_MOST_CONTRADICTIONS = 3


def make_feasibility(
    task: Task,
    setup: Setup = Setup(),
    cache: VerdictCache | None = None,
    *,
    jobs: int = 1,
    on_check: Callable[[CheckCount], None] | None = None,
    back_ends: Sequence[BackEnd] | None = None,
) -> Feasibility:
    """Return the chain of checks for a task.

    Parameters
    ----------
    task, setup, cache, jobs, on_check, back_ends
        As in `make_model`.
    """
    made = setup.back_ends(task) if back_ends is None else back_ends
    return Feasibility(
        task, made, cache, jobs=jobs, make_executor=setup.make_executor, on_check=on_check
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
        What is modelled.
    setup
        Back ends and options.
    cache
        Where verdicts are kept; a fresh one in memory by default.
    overdue
        Returns True once a solver should have stopped long ago.
    jobs
        How many processes may be used for expensive checks, >= 1; 1 for this one.
    on_check
        Called with the checks of expensive back ends.
    back_ends
        Those constructed already for this task and setup; None to construct them.
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
    with blamed(plugin):
        solver: Solver = plugin(validated, stop)
    return solver


def check_solver(name: str, options: Mapping[str, Any]) -> None:
    """Raise what is wrong with a solver's name or options; does not construct it.

    Raises
    ------
    OptionError
        If an option is wrong.
    PluginError
        If the solver is unknown or broken.
    """
    registry.make_options("solver", name, registry.load("solver", name), options)


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
    task
        What to solve.
    solver
        A solver's name, or a solver; the latter is given `stop`.
    setup
        Back ends and options.
    seed
        Governs all randomness.
    stop
        When to stop; by default never.
    cache
        Where verdicts are kept; a fresh one in memory by default.
    jobs
        How many processes expensive back ends, and solvers that can, may use; 1 for this one.
    start
        A plan to start from. Where it holds on the model, nothing that costs more is returned;
        where it does not, the trace says so under ``start``.
    back_ends
        Those constructed already for this task and setup; None to construct them.
    audit
        How many verdicts that were reused are asked again after the search; None for a handful, and
        then none of expensive back ends.

    Raises
    ------
    OptionError, PluginError
        If a plugin or option is wrong, or the start plan is of another task.
    BackEndError
        If a back end fails or contradicts itself.
    """
    cache = VerdictCache() if cache is None else cache
    made = attempt(
        task,
        solver,
        setup,
        seed=seed,
        stop=stop,
        cache=cache,
        jobs=jobs,
        start=start,
        back_ends=back_ends,
        audit=audit,
    )
    return grade(task, made, setup, cache, jobs=jobs)


def attempt(
    task: Task,
    solver: str | Solver,
    setup: Setup = Setup(),
    *,
    seed: int = 0,
    stop: Stop | None = None,
    cache: VerdictCache | None = None,
    jobs: int = 1,
    start: Plan | None = None,
    back_ends: Sequence[BackEnd] | None = None,
    audit: int | None = None,
) -> Attempt:
    """Let a solver work on a task; errors are those of `solve`.

    Parameters
    ----------
    task, solver, setup, seed, stop, cache, jobs, start, back_ends, audit
        As in `solve`.
    """
    stop = Stop() if stop is None else stop
    # What is handed over as an object stays where it is.
    may_leave = not isinstance(solver, Solver)
    solver = _prepared(solver, task, setup, stop, jobs)
    cache = VerdictCache() if cache is None else cache
    model = make_model(
        task, setup, cache, stop.overdue, jobs=jobs, on_check=stop.checked, back_ends=back_ends
    )
    draft = make_draft(task, solver.name, setup, seed, model.feasibility.back_ends)
    terms = Terms(cache, seed, stop, jobs, audit, start, may_leave)
    return attempted(solver, model, draft, terms)


def _prepared(solver: str | Solver, task: Task, setup: Setup, stop: Stop, jobs: int) -> Solver:
    """Return a solver that heeds `stop`."""
    if isinstance(solver, str):
        solver = make_solver(solver, setup.options.get(solver, {}), stop)
    else:
        solver.stop = stop
    solver.jobs, solver.make_executor = jobs, setup.make_executor
    stop.decimals = task.metric.decimals
    return solver


def make_draft(
    task: Task, solver: str, setup: Setup, seed: int, back_ends: Sequence[BackEnd] = ()
) -> Draft:
    """Return a draft that names the task, the solver and what `back_ends` leave unchecked."""
    return Draft(
        task=task.name,
        kind=task.kind,
        sha256=task.sha256,
        solver=solver,
        seed=seed,
        physics=setup.physics_choice(task).name,
        collision=setup.detector_names(task),
        cost_unit=task.metric.unit,
        timed_by=setup.timed_by(task),
        not_checked=list_not_checked(back_ends),
        dwells_from=task.dwells_from,
    )


def grade(task: Task, made: Attempt, setup: Setup, cache: VerdictCache, *, jobs: int = 1) -> Result:
    """Have the referee judge an attempt at a task, in a fresh model.

    The attempt may have been made at another task of the same skills: a stored policy answers
    from other starts, too.

    Parameters
    ----------
    task
        The task that the solution is held against.
    made
        What a solver made of it.
    setup
        Back ends and options.
    cache
        Where the verdicts of the attempt were kept.
    jobs
        How many processes expensive back ends may use, >= 1.
    """
    draft = replace(made.draft, task=task.name)
    if made.refusal is not None:
        return draft.graded(Grade(Status.REFUSED, reason=made.refusal))
    back_ends = made.back_ends_of(task) or setup.back_ends(task)
    # Verdicts of expensive back ends were made by them, not by the solver: they are kept.
    kept = expensive(back_ends)
    fresh = make_model(task, setup, cache.only(kept), jobs=jobs, back_ends=back_ends)
    with closing(fresh.feasibility):
        granted = judge(
            made.solution,
            fresh,
            unknown_met=made.unknown_met,
            audit=not kept,
            left_open=made.left_open,
        )
        reason = granted.reason
        if granted.status is Status.WRONG and made.touched:
            reason = f"the solver changed the task, and on the task as it was {reason}"
        if granted.status is Status.INFEASIBLE:
            reason = task.infeasible or _why_infeasible(fresh, charted=not kept)
    said = made.solution.trace.get("reason")
    if granted.status is Status.UNSOLVED and isinstance(said, str):
        reason = said
    if made.doubt and granted.status in (Status.OPTIMAL, Status.SOLVED, Status.INFEASIBLE):
        status = Status.UNSOLVED if granted.cost is None else Status.SOLVED
        granted, reason = replace(granted, status=status, lower_bound=None), made.doubt
    if granted.status in (Status.SOLVED, Status.UNSOLVED) and made.stopped:
        reason = f"{made.stopped}: {reason}" if reason else made.stopped
    return draft.graded(
        replace(
            granted,
            reason=reason,
            bound_method=_bound_method(draft.solver, granted, made.solution),
            policy=None if granted.cost is None else made.solution.policy,
        )
    )


def expensive(back_ends: Iterable[BackEnd]) -> tuple[BackEnd, ...]:
    """Return the back ends whose verdicts are worth keeping."""
    return tuple(back_end for back_end in back_ends if back_end.expensive)


def _bound_method(solver: str, granted: Grade, solution: Solution) -> str:
    """Return what proved the bound, in words; empty where there is none."""
    if granted.lower_bound is None:
        return ""
    # That nothing costs less than 0, nobody has worked out.
    method = solver if granted.lower_bound else "no cost being below 0"
    return str(solution.trace.get("bound_method") or method)


def _why_infeasible(model: SkillModel, *, charted: bool) -> str:
    """Return what stands against every plan: what fails in every state, or a cycle.

    A chart needs states that the search did not meet; expensive back ends are not queried there.
    """
    # Only where there is no plan.
    from skillplan.chart.precedence_chart import derive_chart
    from skillplan.model.obstruction import obstruction

    task = model.task
    if charted and task.deterministic and len(task.operations) <= _MOST_CHARTED:
        chart = derive_chart(model.feasibility)
        # A cycle names the line of a chart that closes it; a single skill that never succeeds
        # does not.
        obstacle = ("" if chart.cycle else _chart_contradictions(model)) or chart.obstacle(task)
        if obstacle:
            return obstacle
    blamed = obstruction(model)
    if blamed is not None:
        return blamed
    return f"none within {task.step_limit} skills"


def _chart_contradictions(model: SkillModel) -> str:
    """Return why no plan exists without the chart, or else how it contradicts the back ends.

    Empty if neither is so.
    """
    from skillplan.chart.precedence_chart import derive_chart

    back_ends = model.feasibility.back_ends
    others = [back_end for back_end in back_ends if back_end.name != CHART]
    if len(others) in (0, len(back_ends)):
        return ""
    # They know of the chart's detector already, which changes none of their answers.
    chart = derive_chart(Feasibility(model.task, IntroducedBackEnds(others)))
    return chart.obstacle(model.task) or "\n".join(chart.contradictions[:_MOST_CONTRADICTIONS])


def warm_cache() -> DiskVerdictCache:
    """Return the cache that is kept between runs."""
    return DiskVerdictCache(cache_folder() / "verdicts")
