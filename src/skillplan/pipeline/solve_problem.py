"""A loaded file, solved: its only task, one task of its chain, or the whole chain."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skillplan.checks.verdict_cache import VerdictCache
from skillplan.domains.load import Problem
from skillplan.errors import OptionError
from skillplan.pipeline.run import solve
from skillplan.pipeline.setup import Setup
from skillplan.records.result import Result
from skillplan.solvers.solution import Plan
from skillplan.solvers.stop import Stop

if TYPE_CHECKING:  # most files are of a single task
    from skillplan.records.chain_result import ChainResult


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
    """Solve what a file describes and have it judged.

    Back ends that loading constructed are used and not constructed again.

    Parameters
    ----------
    problem
        A loaded file of one or several tasks.
    part
        The task meant, of a chain of several; None for the only one or the whole chain.
    solver
        The solver's name, for a chain also one for every stage as in `solve_chain`; None for
        the one that serves the file best.
    setup
        Back ends and options.
    seed
        Governs all randomness.
    stop
        When to stop; for a chain its time limit is for the whole. By default never.
    cache
        Where verdicts are kept; a fresh one in memory by default.
    jobs
        How many processes expensive back ends, and solvers that can, may use; 1 for this one.
    start
        A plan to start from; only for a single task.
    audit
        As in `solve`; of a chain for each of its searches.

    Returns
    -------
    Result or ChainResult
        The latter for a whole chain.

    Raises
    ------
    OptionError, PluginError
        If a plugin or option is wrong, no task has the name `part`, or the start plan is of
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
    return solve(
        task,
        name,
        setup,
        seed=seed,
        stop=stop,
        cache=cache,
        jobs=jobs,
        start=start,
        audit=audit,
        back_ends=setup.back_ends(task, problem.spare_back_ends),
    )
