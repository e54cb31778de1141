"""Several solvers on one problem: each starts cold, and their claims are held together.

A solver that raises, or meets a back end that does, is a row ``failed``; the others run on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from skillplan.checks.verdict_cache import VerdictCache
from skillplan.domains.load import Problem
from skillplan.judge.referee import cross_examine
from skillplan.pipeline import registry
from skillplan.pipeline.comparing.comparison_row import chain_row, task_row
from skillplan.pipeline.comparing.comparison_workers import Terms, rows_side_by_side
from skillplan.pipeline.run import check_solver, warm_cache
from skillplan.pipeline.setup import Setup
from skillplan.pipeline.solver_choice import solver_names
from skillplan.records.chain_result import ChainResult
from skillplan.records.result import Result
from skillplan.solvers.stop import Stop
from skillplan.task.task import Task


def compare_solvers(
    problem: Problem,
    solvers: Sequence[str],
    setup: Setup = Setup(),
    *,
    seed: int = 0,
    make_stop: Callable[[str], Stop] = lambda name: Stop(),
    warm: bool = False,
    jobs: int = 1,
    audit: int | None = None,
    limits: Mapping[str, Any] | None = None,
) -> list[Result] | list[ChainResult]:
    """Solve a problem with several solvers and hold their claims together.

    In turn; but where there are no more processes than solvers, each runs in one of them, and as
    many at once as there are processes.

    Parameters
    ----------
    problem
        A loaded file of one or several tasks.
    solvers
        Their names; for a chain also one for every stage, as in `solve_chain`.
    setup
        Back ends and options.
    seed
        Governs all randomness.
    make_stop
        Returns when a solver is to stop, given its name.
    warm
        Whether verdicts kept on disk may be used; otherwise each starts with a cold cache.
    jobs
        How many processes solvers run in at once; or where there are more than solvers, how many
        expensive back ends, and solvers that can, may use. 1 for this one.
    audit
        As in `solve`.
    limits
        Those of every search, as keywords of `Stop`, for where they run at once; `make_stop` is
        then called once, for all.

    Returns
    -------
    list of Result or ChainResult
        A row for every solver, in order; those after an interruption are missing. A row of a
        solver or back end that raised, or of a back end that contradicts itself, has the status
        ``failed``.

    Raises
    ------
    OptionError, PluginError
        If a plugin or option is wrong; before any solver runs.
    """
    for name in dict.fromkeys(each for spec in solvers for each in solver_names(spec)):
        check_solver(name, setup.options.get(name, {}))
    limits = {} if limits is None else limits
    if _side_by_side(solvers, jobs, limits):
        terms = Terms(problem, setup, seed, warm, audit)
        rows = rows_side_by_side(terms, solvers, jobs, limits, make_stop(", ".join(solvers)))
        if problem.is_chain:
            return [row for row in rows if isinstance(row, ChainResult)]
        return cross_examine([row for row in rows if isinstance(row, Result)])
    if problem.is_chain:
        return solve_chain_with_all(
            problem,
            solvers,
            setup,
            seed=seed,
            make_stop=make_stop,
            make_cache=warm_cache if warm else VerdictCache,
            jobs=jobs,
            audit=audit,
        )
    return solve_all(
        problem.task,
        solvers,
        setup,
        seed=seed,
        make_stop=make_stop,
        warm=warm,
        jobs=jobs,
        audit=audit,
    )


def solve_all(
    task: Task,
    solvers: Sequence[str],
    setup: Setup = Setup(),
    *,
    seed: int = 0,
    make_stop: Callable[[str], Stop] = lambda name: Stop(),
    warm: bool = False,
    jobs: int = 1,
    audit: int | None = None,
) -> list[Result]:
    """Solve a task with several solvers, cold unless `warm`, and hold their claims together.

    Parameters are those of `compare_solvers`, but for the task.
    """
    results = []
    for name in solvers:
        stop = make_stop(name)
        cache = warm_cache() if warm else VerdictCache()
        results.append(task_row(task, name, setup, seed, stop, cache, jobs, audit))
        if stop.interrupted:
            break
    return cross_examine(results)


def solve_chain_with_all(
    problem: Problem,
    solvers: Sequence[str],
    setup: Setup = Setup(),
    *,
    seed: int = 0,
    make_stop: Callable[[str], Stop] = lambda name: Stop(),
    make_cache: Callable[[], VerdictCache] = VerdictCache,
    jobs: int = 1,
    audit: int | None = None,
) -> list[ChainResult]:
    """Solve a chain with several solvers in turn, each with a cache and a stop of its own.

    Parameters are those of `compare_solvers`; `make_cache` returns where a solver's verdicts
    are kept.
    """
    results = []
    for name in solvers:
        stop = make_stop(name)
        results.append(chain_row(problem, name, setup, seed, stop, make_cache(), jobs, audit))
        if stop.interrupted:
            break
    return results


def _side_by_side(solvers: Sequence[str], jobs: int, limits: Mapping[str, Any]) -> bool:
    """Whether every process has a solver to run; under limits only those that heed them."""
    if not 1 < jobs <= len(solvers):
        return False
    if all(limit is None for limit in limits.values()):
        return True
    names = {each for spec in solvers for each in solver_names(spec)}
    return all(registry.load("solver", name).polls for name in names)
