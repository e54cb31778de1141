"""Solvers of a comparison side by side: each in a process of its own, as many at once as wanted."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from skillplan.checks.verdict_cache import VerdictCache
from skillplan.domains.load import Problem
from skillplan.errors import OptionError, SkillplanError
from skillplan.pipeline.comparing.comparison_row import (
    WRONG_INPUT,
    chain_row,
    failed_chain_row,
    failed_task_row,
    task_row,
)
from skillplan.pipeline.run import warm_cache
from skillplan.pipeline.setup import Setup
from skillplan.records.chain_result import ChainResult
from skillplan.records.result import Result
from skillplan.solvers.stop import Stop
from skillplan.workers.executor import Answer, Ended, Executor, News, Worker, packed
from skillplan.workers.inside import shares_files, when_asked_to_stop
from skillplan.workers.local_processes import LocalProcesses

_WHAT = "the comparison"
# A solver whose machine is lost is run once more elsewhere.
_STARTS = 2

Row = Result | ChainResult


@dataclass(frozen=True, slots=True)
class Terms:
    """What all solvers of a comparison have in common; can be sent to another process.

    Parameters
    ----------
    problem
        A loaded file of one or several tasks.
    setup
        Back ends and options.
    seed
        Governs all randomness.
    warm
        Whether verdicts kept on disk may be used.
    audit
        As in `solve`.
    """

    problem: Problem
    setup: Setup
    seed: int = 0
    warm: bool = False
    audit: int | None = None

    def row(self, solver: str, stop: Stop) -> Row:
        """Return what becomes of a solver; one that raises, or whose back ends do, has failed.

        Raises
        ------
        OptionError, PluginError, TaskError
            If the input is wrong.
        """
        cache = warm_cache() if self.warm and shares_files() else VerdictCache()
        setup, seed, audit = self.setup, self.seed, self.audit
        if self.problem.is_chain:
            return chain_row(self.problem, solver, setup, seed, stop, cache, 1, audit)
        return task_row(self.problem.task, solver, setup, seed, stop, cache, 1, audit)

    def lost(self, solver: str, how: str) -> Row:
        """Return the row of a solver whose process has ended."""
        error = SkillplanError(f"its process ended by {how}")
        if self.problem.is_chain:
            return failed_chain_row(self.problem, solver, self.setup, self.seed, error)
        return failed_task_row(self.problem.task, solver, self.setup, self.seed, error)


@dataclass(frozen=True, slots=True)
class _Ground:
    """What a worker starts from: the terms, and the limits of every search."""

    terms: Terms
    limits: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class _Wrong:
    """The input is wrong: how, in words."""

    words: str


def rows_side_by_side(
    terms: Terms, solvers: Sequence[str], slots: int, limits: Mapping[str, Any], stop: Stop
) -> list[Row]:
    """Return the rows of solvers that run in processes of their own, in their order.

    One whose process is ended has failed, and the others go on. After an interruption those that
    run end with what they have, and rows of the others are missing.

    Parameters
    ----------
    terms
        What they have in common.
    solvers
        Their names.
    slots
        How many at once, >= 1.
    limits
        Of every search, as keywords of `Stop`; time counts from its own beginning.
    stop
        Whether all are to stop.

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
    content = packed(_Ground(_sendable(alone), limits), _WHAT)
    found: dict[int, Row] = {}
    try:
        for index, outcome in _outcomes(executor, content, solvers, stop):
            if isinstance(outcome, _Wrong):
                raise OptionError(outcome.words)
            if isinstance(outcome, Ended):
                outcome = terms.lost(solvers[index], outcome.how)
            found[index] = outcome
    finally:
        executor.close()
    return [found[index] for index in sorted(found)]


def _sendable(terms: Terms) -> Terms:
    """Return the terms without the back ends that loading the file has constructed."""
    return replace(terms, problem=replace(terms.problem, spare_back_ends=[]))


def _outcomes(
    executor: Executor, content: bytes, solvers: Sequence[str], stop: Stop
) -> Iterator[tuple[int, Row | _Wrong | Ended]]:
    """Yield what becomes of solvers as they end, by their index."""
    waiting = [(index, _STARTS) for index in range(len(solvers))]
    at: dict[Worker, tuple[int, int]] = {}
    idle: list[Worker] = []
    asked = False
    while at or waiting:
        if stop.interrupted and not asked:
            asked, waiting = True, []
            for worker in at:
                worker.ask_to_stop()
        while waiting and len(at) < executor.slots:
            # One that has answered goes on; what it imported and compiled is no verdict.
            worker = idle.pop() if idle else executor.start(_prepare, content, _WHAT)
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
            if answer.exit_code is None and starts > 1 and not asked:
                waiting.insert(0, (index, starts - 1))
            elif not answer.started and not answer.killed:
                raise worker.not_started()
            else:
                yield index, answer


def _prepare(ground: _Ground) -> Callable[[str], Row | _Wrong]:
    """Return what runs a solver, in a process of its own."""

    def work(solver: str) -> Row | _Wrong:
        stop = Stop(**ground.limits)
        when_asked_to_stop(stop.interrupt)
        try:
            return ground.terms.row(solver, stop)
        except WRONG_INPUT as error:
            return _Wrong(str(error))
        finally:
            when_asked_to_stop(None)

    return work
