"""The straight line: make a model of a task, solve it, and have the referee judge."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from skillplan.chart.precedence_chart import derive_chart
from skillplan.checks.feasibility import CheckCount, Feasibility
from skillplan.checks.verdict_cache import DiskVerdictCache, VerdictCache
from skillplan.errors import SearchStopped, SkillplanError
from skillplan.files.plain_json import json_fault
from skillplan.judge.referee import cross_examine, judge
from skillplan.model.obstruction import obstruction
from skillplan.model.skill_model import SkillModel
from skillplan.pipeline import registry
from skillplan.pipeline.setup import Setup
from skillplan.records.result import Result, Status
from skillplan.solvers.solution import Plan, Solution
from skillplan.solvers.solver import Solver
from skillplan.solvers.stop import Stop
from skillplan.solvers.warm_start import search_from
from skillplan.task.back_end import BackEnd
from skillplan.task.task import Task

DEFAULT_SOLVER = "auto"

# Larger tasks are not charted just to say why they have no plan.
_MOST_CHARTED = 64


def make_feasibility(
    task: Task,
    setup: Setup = Setup(),
    cache: VerdictCache | None = None,
    *,
    jobs: int = 1,
    on_check: Callable[[CheckCount], None] | None = None,
) -> Feasibility:
    """Return the chain of checks for a task; a fresh cache in memory by default."""
    return Feasibility(task, setup.back_ends(task), cache, jobs=jobs, on_check=on_check)


def make_model(
    task: Task,
    setup: Setup = Setup(),
    cache: VerdictCache | None = None,
    overdue: Callable[[], bool] | None = None,
    *,
    jobs: int = 1,
    on_check: Callable[[CheckCount], None] | None = None,
) -> SkillModel:
    """Return the lazy model of a task; of several `jobs`, dear checks are made in processes."""
    feasibility = make_feasibility(task, setup, cache, jobs=jobs, on_check=on_check)
    return SkillModel(feasibility, overdue)


def make_solver(name: str, options: Mapping[str, Any], stop: Stop | None = None) -> Solver:
    """Return a solver by name.

    Raises
    ------
    OptionError
        If an option is wrong.
    PluginError
        If the solver is unknown or broken.
    """
    plugin = registry.load("solver", name)
    solver: Solver = plugin(registry.make_options("solver", name, plugin, options), stop)
    return solver


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
        How many processes dear back ends, and solvers that can, may use; 1 for this one.
    start
        A plan to start from. Where it holds on the model, nothing that costs more is returned;
        where it does not, the trace says so under ``start``.

    Raises
    ------
    OptionError, PluginError
        If a plugin or option is wrong, or the start plan is of another task.
    BackEndError
        If a back end fails.
    """
    cache = VerdictCache() if cache is None else cache
    made = attempt(task, solver, setup, seed=seed, stop=stop, cache=cache, jobs=jobs, start=start)
    return grade(task, made, setup, cache, jobs=jobs)


@dataclass(frozen=True)
class Attempt:
    """What a solver made of a task, before the referee has seen it.

    Parameters
    ----------
    blank
        The result to fill in: who solved what, how, and at what effort.
    solution
        What the solver claims.
    unknown_met
        Whether a back end could not decide about a skill on the way.
    stopped
        Why the search was stopped, or None while it was not.
    dear
        The back ends that were asked and whose verdicts cost much.
    """

    blank: Result
    solution: Solution
    unknown_met: bool = False
    stopped: str | None = None
    dear: tuple[BackEnd, ...] = ()


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
) -> Attempt:
    """Let a solver work on a task; parameters and errors are those of `solve`."""
    stop = Stop() if stop is None else stop
    if isinstance(solver, str):
        solver = make_solver(solver, setup.options.get(solver, {}), stop)
    else:
        solver.stop = stop
    solver.jobs = jobs
    stop.decimals = task.metric.decimals
    cache = VerdictCache() if cache is None else cache
    model = make_model(task, setup, cache, stop.overdue, jobs=jobs, on_check=stop.checked)
    blank = blank_result(task, solver.name, setup, seed)
    begin_s = time.perf_counter()
    with _blamed(solver):
        refusal = solver.refuses(model)
    if refusal is not None:
        return Attempt(replace(blank, status=Status.REFUSED, reason=refusal), Solution())
    dear = tuple(back_end for back_end in model.feasibility.back_ends if back_end.dear)
    with closing(model.feasibility):
        if start is None:
            solution = _search(solver, model, seed, stop)
        else:
            # What dear back ends say of the start plan is asked once, and kept for the search.
            fresh = make_model(task, setup, cache if dear else None, jobs=jobs)
            with closing(fresh.feasibility), _blamed(solver):
                search = partial(_search, solver, model, seed, stop)
                solution = search_from(start, fresh, search, stop)
    wall_s = time.perf_counter() - begin_s
    stats = model.stats
    iterations = _count(solution, "iterations", "expanded", "visited")
    blank = replace(
        blank,
        states=max(stats.states, _count(solution, "states") or 0),
        expanded=stats.states if iterations is None else iterations,
        checks=stats.checks,
        cache_hits=stats.cache_hits,
        wall_s=wall_s,
        interrupted=stop.interrupted,
        trace=solution.trace,
    )
    return Attempt(blank, solution, stats.unknown > 0, stop.reason, dear)


def blank_result(task: Task, solver: str, setup: Setup, seed: int) -> Result:
    """Return a result that says who solves what, and nothing of how it went."""
    return Result(
        task=task.name,
        kind=task.kind,
        sha256=task.sha256,
        solver=solver,
        seed=seed,
        physics=setup.physics_choice(task).name,
        collision=",".join(choice.name for choice in setup.collision_choices(task)),
        status=Status.UNSOLVED,
        cost_unit=task.metric.unit,
    )


def grade(task: Task, made: Attempt, setup: Setup, cache: VerdictCache, *, jobs: int = 1) -> Result:
    """Have the referee judge an attempt at a task.

    The attempt may have been made at another task of the same skills: a stored policy answers
    from other starts, too.
    """
    if made.blank.status is Status.REFUSED:
        return made.blank
    dear = made.dear
    # Verdicts of dear back ends were made by them, not by the solver, and are not asked twice.
    fresh = make_model(task, setup, cache.only(dear), jobs=jobs)
    with closing(fresh.feasibility):
        result = judge(
            made.blank, made.solution, fresh, unknown_met=made.unknown_met, audit=not dear
        )
    if result.cost is not None:
        result = replace(result, policy=made.solution.policy)
    if result.lower_bound is not None:
        # That nothing costs less than 0, nobody has worked out.
        method = made.blank.solver if result.lower_bound else "no cost being below 0"
        method = made.solution.trace.get("bound_method") or method
        result = replace(result, bound_method=str(method))
    if result.status is Status.INFEASIBLE:
        result = replace(result, reason=_why_infeasible(fresh, charted=not dear))
    said = made.solution.trace.get("reason")
    if result.status is Status.UNSOLVED and isinstance(said, str):
        result = replace(result, reason=said)
    if result.status in (Status.SOLVED, Status.UNSOLVED) and made.stopped:
        reason = f"{made.stopped}: {result.reason}" if result.reason else made.stopped
        result = replace(result, reason=reason)
    return result


def _why_infeasible(model: SkillModel, *, charted: bool) -> str:
    """Return what stands against every plan: what fails in every state, or a circle of orders.

    A chart asks about states that the search did not meet; dear back ends are not asked that.
    """
    task = model.task
    blamed = obstruction(model)
    if blamed is not None:
        return blamed
    if charted and task.deterministic and len(task.operations) <= _MOST_CHARTED:
        obstacle = derive_chart(model.feasibility).obstacle()
        if obstacle is not None:
            return obstacle
    return f"none within {task.step_limit} skills"


def _count(solution: Solution, *names: str) -> int | None:
    """Return the first of some figures of a trace that is a count."""
    for name in names:
        figure = solution.trace.get(name)
        if isinstance(figure, int) and figure >= 0:
            return figure
    return None


@contextmanager
def _blamed(solver: Solver) -> Iterator[None]:
    """Name the solver in whatever it raises that is not in words already."""
    try:
        yield
    except SkillplanError:
        raise
    except Exception as error:
        raise SkillplanError(
            f"The solver {solver.name!r} failed: {type(error).__name__}: {error}"
        ) from error


def _search(solver: Solver, model: SkillModel, seed: int, stop: Stop) -> Solution:
    try:
        with _blamed(solver):
            solution = solver.solve(model, seed=seed)
    except SearchStopped:
        return Solution(stop.best, stop.lower_bound)
    if not isinstance(solution, Solution):
        raise SkillplanError(
            f"The solver {solver.name!r} returned {type(solution).__name__}, not a Solution."
        )
    fault = json_fault(solution.trace)
    if fault is not None:
        raise SkillplanError(f"The trace of the solver {solver.name!r} is not JSON: {fault}.")
    return solution


def cache_folder() -> Path:
    """Return where verdicts are kept between runs: ``SKILLPLAN_CACHE_DIR``, or the user's cache."""
    chosen = os.environ.get("SKILLPLAN_CACHE_DIR")
    if chosen:
        return Path(chosen)
    from platformdirs import user_cache_path

    return user_cache_path("skillplan")


def warm_cache() -> DiskVerdictCache:
    """Return the cache that is kept between runs."""
    return DiskVerdictCache(cache_folder() / "verdicts")


def solve_all(
    task: Task,
    solvers: Sequence[str],
    setup: Setup = Setup(),
    *,
    seed: int = 0,
    make_stop: Callable[[str], Stop] = lambda name: Stop(),
    warm: bool = False,
    jobs: int = 1,
) -> list[Result]:
    """Solve a task with several solvers, cold unless `warm`, and hold their claims together."""
    results = []
    for name in solvers:
        stop = make_stop(name)
        cache = warm_cache() if warm else VerdictCache()
        results.append(solve(task, name, setup, seed=seed, stop=stop, cache=cache, jobs=jobs))
        if stop.interrupted:
            break
    return cross_examine(results)
