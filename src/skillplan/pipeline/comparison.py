"""Several solvers on one problem: each starts cold, and their claims are held together.

A solver that raises, or meets a back end that does, is a row ``failed``; the others run on.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence

from skillplan.checks.verdict_cache import VerdictCache
from skillplan.domains.load import Problem
from skillplan.errors import (
    OptionError,
    PluginError,
    SkillplanError,
    TaskError,
)
from skillplan.judge.referee import cross_examine
from skillplan.pipeline.chain import Chain
from skillplan.pipeline.run import check_solver, make_draft, solve, warm_cache
from skillplan.pipeline.setup import Setup
from skillplan.pipeline.solver_choice import solver_names
from skillplan.plugins.blame import debugging, traceback_text
from skillplan.records.chain_result import ChainResult
from skillplan.records.grading import failed_grade
from skillplan.records.result import Result
from skillplan.solvers.stop import Stop
from skillplan.task.task import Task

_LOG = logging.getLogger(__name__)

# What the user has to repair before any solver can run.
_WRONG_INPUT = (OptionError, PluginError, TaskError)


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
) -> list[Result] | list[ChainResult]:
    """Solve a problem with several solvers in turn and hold their claims together.

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
        How many processes expensive back ends, and solvers that can, may use; 1 for this one.
    audit
        As in `solve`.

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
        try:
            result = solve(
                task, name, setup, seed=seed, stop=stop, cache=cache, jobs=jobs, audit=audit
            )
        except _WRONG_INPUT:
            raise
        except SkillplanError as error:
            _note(error)
            result = make_draft(task, name, setup, seed).graded(failed_grade(error))
        results.append(result)
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
        chain = Chain(problem, name, setup, seed, stop, make_cache(), jobs, spare=[], audit=audit)
        try:
            result = chain.run()
        except _WRONG_INPUT:
            raise
        except SkillplanError as error:
            _note(error)
            result = chain.failed(error)
        results.append(result)
        if stop.interrupted:
            break
    return results


def _note(error: SkillplanError) -> None:
    """Show the traceback where ``SKILLPLAN_DEBUG`` demands it; the row says the rest."""
    if debugging():
        _LOG.error("%s\n%s", error, traceback_text(error))
