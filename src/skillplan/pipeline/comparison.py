"""Several solvers on one problem: each starts cold, and their claims are compared.

The solvers run in turn, or each in a process of its own, as many at once as there are processes.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from skillplan.checks.verdict_cache import VerdictCache
from skillplan.domains.load import Problem
from skillplan.errors import OptionError, PluginError, SkillplanError, TaskError
from skillplan.judge.referee import cross_examine
from skillplan.pipeline import registry
from skillplan.pipeline.chain import Chain
from skillplan.pipeline.setup import Setup
from skillplan.pipeline.solving import (
    SearchRequest,
    check_solver,
    describe_failure,
    grade,
    list_solvers,
    open_warm_cache,
    search,
)
from skillplan.plugins.blame import format_traceback, is_debugging
from skillplan.records.chain_result import ChainResult
from skillplan.records.result import Result
from skillplan.solvers.stop import Stop
from skillplan.workers.executor import (
    Answer,
    Ended,
    Executor,
    News,
    Worker,
    pack_content,
    set_stop_handler,
    shares_files,
)
from skillplan.workers.local_processes import LocalProcesses

_LOG = logging.getLogger(__name__)
_PURPOSE = "the comparison"
# A solver whose machine is lost is run once more elsewhere.
_STARTS = 2

WRONG_INPUT = (OptionError, PluginError, TaskError)
"""Errors that the user has to fix before any solver can run."""

Row = Result | ChainResult


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
    """Solve a problem with several solvers and compare their claims.

    Solvers run in turn. If there are at least as many solvers as processes, each runs in one.

    Parameters
    ----------
    problem
        A loaded file of one or several tasks.
    solvers
        Their names; for a chain also one for each stage, as in `solve_chain`.
    setup
        Back ends and options.
    seed
        Seed of all random numbers.
    make_stop
        Returns the stop of a solver, given its name.
    warm
        True if verdicts kept on disk may be used; otherwise each solver starts with a cold cache.
    jobs
        Number of processes in which solvers run at once, >= 1. With fewer solvers, number of
        processes for expensive back ends and parallel solvers.
    audit
        As in `SearchRequest`.
    limits
        Keywords of a `Stop` for each search of solvers that run at once; `make_stop` is then
        called once, for all.

    Returns
    -------
    list of Result or ChainResult
        A row for each solver, in order; those after an interruption are missing. A row of a
        solver or back end that raised has the status ``failed``.

    Raises
    ------
    OptionError, PluginError
        If a plugin or option is wrong; before any solver runs.
    """
    for name in dict.fromkeys(each for spec in solvers for each in list_solvers(spec)):
        check_solver(name, setup.options.get(name, {}))
    limits = {} if limits is None else limits
    rows: Sequence[Row]
    if _can_run_at_once(solvers, jobs, limits):
        terms = Terms(problem, setup, seed, warm, audit)
        rows = rows_side_by_side(terms, solvers, jobs, limits, make_stop(", ".join(solvers)))
    else:
        rows = rows_in_turn(Terms(problem, setup, seed, warm, audit, jobs), solvers, make_stop)
    if problem.is_chain:
        return [row for row in rows if isinstance(row, ChainResult)]
    return cross_examine([row for row in rows if isinstance(row, Result)])


def rows_in_turn(
    terms: Terms, solvers: Sequence[str], make_stop: Callable[[str], Stop] = lambda name: Stop()
) -> list[Row]:
    """Run solvers one after the other and return their rows, up to an interruption.

    Parameters
    ----------
    make_stop
        Returns the stop of a solver, given its name.

    Raises
    ------
    OptionError, PluginError, TaskError
        If the input is wrong.
    """
    rows = []
    for name in solvers:
        stop = make_stop(name)
        rows.append(terms.row(name, stop))
        if stop.interrupted:
            break
    return rows


def _can_run_at_once(solvers: Sequence[str], jobs: int, limits: Mapping[str, Any]) -> bool:
    """Return whether each process has a solver to run, and the solvers keep the limits."""
    if not 1 < jobs <= len(solvers):
        return False
    if all(limit is None for limit in limits.values()):
        return True
    names = {each for spec in solvers for each in list_solvers(spec)}
    return all(registry.load("solver", name).polls for name in names)


@dataclass(frozen=True, slots=True)
class Terms:
    """The terms that all solvers of a comparison share; can be sent to another process.

    Parameters
    ----------
    problem
        A loaded file of one or several tasks.
    setup
        Back ends and options.
    seed
        Seed of all random numbers.
    warm
        True if verdicts kept on disk may be used.
    audit
        As in `SearchRequest`.
    jobs
        Number of processes for expensive back ends and parallel solvers, >= 1.
    """

    problem: Problem
    setup: Setup
    seed: int = 0
    warm: bool = False
    audit: int | None = None
    jobs: int = 1

    def row(self, solver: str, stop: Stop) -> Row:
        """Run a solver and return its row, a failed one if a solver or back end raises.

        Raises
        ------
        OptionError, PluginError, TaskError
            If the input is wrong.
        """
        request = self._request(solver, stop)
        chain = Chain(self.problem, request, spare=[]) if self.problem.is_chain else None
        try:
            return grade(request, search(request)) if chain is None else chain.run()
        except WRONG_INPUT:
            raise
        except SkillplanError as error:
            return self._failed_row(request, chain, error)

    def lost(self, solver: str, how: str) -> Row:
        """Return the row of a solver whose process has ended."""
        request = self._request(solver, Stop())
        chain = Chain(self.problem, request, spare=[]) if self.problem.is_chain else None
        return self._failed_row(request, chain, SkillplanError(f"its process ended by {how}"))

    def _failed_row(
        self, request: SearchRequest, chain: Chain | None, error: SkillplanError
    ) -> Row:
        """Return a row with the message; log the traceback if ``SKILLPLAN_DEBUG`` demands it."""
        if is_debugging():
            _LOG.error("%s\n%s", error, format_traceback(error))
        return describe_failure(request, error) if chain is None else chain.end_with(error)

    def _request(self, solver: str, stop: Stop) -> SearchRequest:
        cache = open_warm_cache() if self.warm and shares_files() else VerdictCache()
        task, jobs = self.problem.tasks[0], self.jobs
        return SearchRequest(
            task, solver, self.setup, self.seed, stop, cache, jobs, audit=self.audit
        )


@dataclass(frozen=True, slots=True)
class _Ground:
    """The content of a worker: the terms, and the limits of each search."""

    terms: Terms
    limits: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class _Wrong:
    """A message about wrong input."""

    message: str


def rows_side_by_side(
    terms: Terms, solvers: Sequence[str], slots: int, limits: Mapping[str, Any], stop: Stop
) -> list[Row]:
    """Run solvers in processes of their own and return their rows, in order.

    A solver whose process is ended has failed, and the others go on. After an interruption the
    running solvers end with their best plans, and rows of the others are missing.

    Parameters
    ----------
    terms
        Problem and options that the solvers share.
    solvers
        Names of the solvers.
    slots
        Number of processes, >= 1.
    limits
        Keywords of a `Stop` for each search; time counts from its own beginning.
    stop
        Ends the comparison.

    Raises
    ------
    OptionError
        If the input is wrong.
    SkillplanError
        If processes cannot be started.
    """
    maker = terms.setup.make_executor
    executor = LocalProcesses(slots) if maker is None else maker(slots)
    alone = replace(terms, setup=terms.setup.in_worker)
    content = pack_content(_Ground(_drop_back_ends(alone), limits), _PURPOSE)
    rows: dict[int, Row] = {}
    try:
        for index, outcome in _collect_rows(executor, content, solvers, stop):
            if isinstance(outcome, _Wrong):
                raise OptionError(outcome.message)
            if isinstance(outcome, Ended):
                outcome = terms.lost(solvers[index], outcome.how)
            rows[index] = outcome
    finally:
        executor.close()
    return [rows[index] for index in sorted(rows)]


def _drop_back_ends(terms: Terms) -> Terms:
    """Return the terms without the back ends that were constructed while loading."""
    return replace(terms, problem=replace(terms.problem, spare_back_ends=[]))


def _collect_rows(
    executor: Executor, content: bytes, solvers: Sequence[str], stop: Stop
) -> Iterator[tuple[int, Row | _Wrong | Ended]]:
    """Yield the rows of solvers as they end, with their index."""
    waiting = [(index, _STARTS) for index in range(len(solvers))]
    at: dict[Worker, tuple[int, int]] = {}
    idle: list[Worker] = []
    is_stopping = False
    while at or waiting:
        if stop.interrupted:
            is_stopping, waiting = True, []
            # Again and again, because a process that is starting does not hear it.
            for worker in at:
                worker.ask_to_stop()
        while waiting and len(at) < executor.slots:
            # A process that has answered is used again.
            worker = idle.pop() if idle else executor.start(_prepare, content, _PURPOSE)
            at[worker] = waiting.pop(0)
            worker.take(solvers[at[worker][0]])
        for worker in executor.first_ready(at):
            answer = worker.answer()
            if answer is None or isinstance(answer, News):
                continue
            index, starts = at.pop(worker)
            if isinstance(answer, Answer):
                idle.append(worker)
                yield index, answer.content
                continue
            worker.end()
            if answer.exit_code is None and starts > 1 and not is_stopping:
                waiting.insert(0, (index, starts - 1))
            elif not answer.started and not answer.killed:
                raise worker.not_started()
            else:
                yield index, answer


def _prepare(ground: _Ground) -> Callable[[str], Row | _Wrong]:
    """Return the function that runs a solver; called in the other process."""

    def work(solver: str) -> Row | _Wrong:
        stop = Stop(**ground.limits)
        set_stop_handler(stop.interrupt)
        try:
            return ground.terms.row(solver, stop)
        except WRONG_INPUT as error:
            return _Wrong(str(error))
        finally:
            set_stop_handler(None)

    return work
