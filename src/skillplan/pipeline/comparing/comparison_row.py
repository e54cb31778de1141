"""The row of one solver in a comparison; one that raises, or whose back ends do, has failed."""

from __future__ import annotations

import logging

from skillplan.checks.verdict_cache import VerdictCache
from skillplan.domains.load import Problem
from skillplan.errors import OptionError, PluginError, SkillplanError, TaskError
from skillplan.pipeline.chain import Chain
from skillplan.pipeline.run import make_draft, solve
from skillplan.pipeline.setup import Setup
from skillplan.plugins.blame import debugging, traceback_text
from skillplan.records.chain_result import ChainResult
from skillplan.records.grading import failed_grade
from skillplan.records.result import Result
from skillplan.solvers.stop import Stop
from skillplan.task.task import Task

_LOG = logging.getLogger(__name__)

WRONG_INPUT = (OptionError, PluginError, TaskError)
"""What the user has to repair before any solver can run."""


def task_row(
    task: Task,
    solver: str,
    setup: Setup,
    seed: int,
    stop: Stop,
    cache: VerdictCache,
    jobs: int,
    audit: int | None,
) -> Result:
    """Return what became of a solver on a task; parameters are those of `solve`.

    Raises
    ------
    OptionError, PluginError, TaskError
        If the input is wrong.
    """
    try:
        return solve(task, solver, setup, seed=seed, stop=stop, cache=cache, jobs=jobs, audit=audit)
    except WRONG_INPUT:
        raise
    except SkillplanError as error:
        return failed_task_row(task, solver, setup, seed, error)


def failed_task_row(
    task: Task, solver: str, setup: Setup, seed: int, error: SkillplanError
) -> Result:
    """Return the row of a solver that has failed."""
    _note(error)
    return make_draft(task, solver, setup, seed).graded(failed_grade(error))


def chain_row(
    problem: Problem,
    solver: str,
    setup: Setup,
    seed: int,
    stop: Stop,
    cache: VerdictCache,
    jobs: int,
    audit: int | None,
) -> ChainResult:
    """Return what became of a solver on a chain; parameters are those of `solve_chain`.

    Raises
    ------
    OptionError, PluginError, TaskError
        If the input is wrong.
    """
    chain = Chain(problem, solver, setup, seed, stop, cache, jobs, spare=[], audit=audit)
    try:
        return chain.run()
    except WRONG_INPUT:
        raise
    except SkillplanError as error:
        _note(error)
        return chain.failed(error)


def failed_chain_row(
    problem: Problem, solver: str, setup: Setup, seed: int, error: SkillplanError
) -> ChainResult:
    """Return the row of a solver that has failed before it solved any task of the chain."""
    _note(error)
    return Chain(problem, solver, setup, seed, Stop(), None, 1, spare=[]).failed(error)


def _note(error: SkillplanError) -> None:
    """Show the traceback where ``SKILLPLAN_DEBUG`` demands it; the row says the rest."""
    if debugging():
        _LOG.error("%s\n%s", error, traceback_text(error))
