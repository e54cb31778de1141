"""Runs of a study in worker processes: learn with one setting and seed, answer from every start."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from skillplan.checks.verdict_cache import VerdictCache
from skillplan.errors import BackEndError, OptionError, SkillplanError
from skillplan.pipeline.setup import Setup
from skillplan.pipeline.solving import SearchRequest, grade, open_warm_cache, search, solve
from skillplan.plugins.blame import ends_program
from skillplan.records.result import Result, Status
from skillplan.records.sweep.result import StartOutcome, SweepRecord
from skillplan.solvers.stop import Stop
from skillplan.task.state import State
from skillplan.task.task import Task, read_start_state
from skillplan.workers.executor import Answer, Executor, News, Worker, pack_content, shares_files
from skillplan.workers.local_processes import LocalProcesses

# Time limit of the exact search from one start [s].
_REFERENCE_S = 10.0


@dataclass(frozen=True)
class StudyJob:
    """The settings that all runs of a study share. It can be sent to another process.

    Parameters
    ----------
    tasks
        The task from every start, by name of the start.
    setup
        Back ends, and options that do not vary.
    warm
        True to use verdicts stored on disk.
    """

    tasks: Mapping[str, Task]
    solver: str
    setup: Setup
    warm: bool = False

    def __post_init__(self) -> None:
        if not self.tasks:
            raise ValueError("A study needs at least one start.")

    def cache(self) -> VerdictCache:
        """Return the verdict cache of a run, empty unless the study is warm and shares files."""
        return open_warm_cache() if self.warm and shares_files() else VerdictCache()

    def optimum(self, start: str) -> float | None:
        """Return the proved optimum from a start; None if exact search does not prove it."""
        task = self.tasks[start]
        if not task.deterministic:
            return None
        options = {key: kv for key, kv in self.setup.options.items() if key != self.solver}
        setup = replace(self.setup, options=options)
        stop = Stop(time_limit_s=_REFERENCE_S)
        best = solve(task, "exact", setup, stop=stop, cache=self.cache())
        return best.cost if best.status is Status.OPTIMAL else None


def set_starts(task: Task, starts: list[str]) -> dict[str, Task]:
    """Return the task from every start; a learner explores from all of them.

    Parameters
    ----------
    starts
        Places, or facts joined by ``+``. Default: the start of the task.

    Raises
    ------
    OptionError
        If a start is unknown, given twice, or an impossible state.
    """
    if not starts:
        places = [place.name for place in task.places_in(task.initial)]
        return {places[0] if len(places) == 1 else "+".join(task.initial): task}
    states: dict[str, State] = {}
    for name in starts:
        try:
            state = read_start_state(task, name.replace("+", ","))
        except OptionError as error:
            raise OptionError(f"--starts {name}: {error}") from None
        if state in states.values():
            raise OptionError(f"--starts: {name} is named twice.")
        states[name] = state
    every = tuple(dict.fromkeys((*task.starts, *states.values())))
    return {
        name: task.replace(initial=state, starts=every, sha256=task.sha256)
        for name, state in states.items()
    }


def do_run(
    job: StudyJob, setting: int, options: Mapping[str, Any], seed: int, stop: Stop | None = None
) -> SweepRecord:
    """Do a run; its errors become part of the record."""
    try:
        return _run(job, setting, options, seed, stop)
    except SkillplanError as error:
        failed = isinstance(error, BackEndError)
        return SweepRecord(setting, seed, error=str(error), back_end_failed=failed)
    except BaseException as error:
        if ends_program(error):
            raise
        message = f"{type(error).__name__}: {error}"
        return SweepRecord(setting, seed, error=message, back_end_failed=True)


def _run(
    job: StudyJob, setting: int, options: Mapping[str, Any], seed: int, stop: Stop | None
) -> SweepRecord:
    known = job.setup.options.get(job.solver, {})
    setup = replace(job.setup, options={**job.setup.options, job.solver: {**known, **options}})
    (first, task), *others = job.tasks.items()
    cache = job.cache()
    request = SearchRequest(task, job.solver, setup, seed, stop or Stop(), cache)
    solved = search(request)
    if solved.refusal is not None:
        return SweepRecord(setting, seed, error=f"refused: {solved.refusal}")
    result = grade(request, solved)
    outcomes = [_make_outcome(first, result)]
    planned = "planned_episodes" in result.trace
    shared = solved.solution.policy is not None
    if shared:
        # Its proof holds for the first start only.
        solution = replace(solved.solution, lower_bound=None, proved=False)
        solved = replace(solved, solution=solution)
    for name, task in others:
        other = (
            grade(replace(request, task=task), solved)
            if shared
            else solve(task, job.solver, setup, seed=seed, stop=stop, cache=job.cache())
        )
        outcomes.append(_make_outcome(name, other))
        planned = planned or "planned_episodes" in other.trace
    return SweepRecord(setting, seed, tuple(outcomes), shared, result.expanded, planned=planned)


def _make_outcome(start: str, result: Result) -> StartOutcome:
    # The learning time of a solver excludes enumeration and compilation.
    known = result.trace.get("learning_s")
    sound = isinstance(known, int | float) and not isinstance(known, bool) and known >= 0
    learning_s = float(known) if sound and known is not None else result.wall_s
    return StartOutcome(
        start, result.status, result.cost, result.makespan, result.reason, learning_s
    )


_PURPOSE = "the runs"


@dataclass(frozen=True, slots=True)
class Order:
    """A run to do: index of the setting, its options, and the seed."""

    setting: int
    options: Mapping[str, Any]
    seed: int


def do_runs(
    job: StudyJob,
    orders: Iterable[Order],
    count: int,
    stopped: Callable[[], bool],
    executor: Executor | None = None,
) -> Iterator[SweepRecord]:
    """Yield the records of runs as they end, in any order.

    If a process dies, its run is recorded as failed and the others continue. A run whose machine is
    lost is repeated once elsewhere. A stop discards unfinished runs.

    Parameters
    ----------
    orders
        The runs. The next one is drawn after the previous record was consumed.
    stopped
        Returns True to stop; called several times per second.
    executor
        Runs the processes instead, in its own number.

    Raises
    ------
    SkillplanError
        If processes cannot be started.
    """
    executor = LocalProcesses(count) if executor is None else executor
    todo = iter(orders)
    content = pack_content(replace(job, setup=job.setup.in_worker), _PURPOSE)
    at: dict[Worker, Order] = {}
    again: list[Order] = []

    def give(worker: Worker | None, order: Order) -> None:
        if worker is None:
            worker = executor.start(_prepare, content, _PURPOSE)
        at[worker] = order
        worker.take((order.setting, dict(order.options), order.seed))

    try:
        for _, order in zip(range(executor.slots), todo, strict=False):
            give(None, order)
        while at and not stopped():
            for worker in executor.first_ready(at):
                answer = worker.answer()
                if answer is None or isinstance(answer, News):
                    continue
                order = at[worker]
                if isinstance(answer, Answer):
                    record = answer.content
                elif answer.exit_code is None and order not in again:
                    # A lost machine is not the fault of the run, so it is repeated elsewhere.
                    again.append(order)
                    del at[worker]
                    worker.end()
                    give(None, order)
                    continue
                elif not answer.started and not answer.killed:
                    raise worker.not_started()
                else:
                    error = f"its process ended by {answer.how}"
                    record = SweepRecord(
                        order.setting, order.seed, error=error, back_end_failed=True
                    )
                # The record comes first, because the next run may depend on it.
                yield record
                following = next(todo, None)
                goes_on = following is not None and isinstance(answer, Answer)
                if not goes_on:
                    del at[worker]
                    worker.end()
                if following is not None:
                    # A new process replaces a dead one.
                    give(worker if goes_on else None, following)
    finally:
        executor.close()


def _prepare(job: StudyJob) -> Callable[[tuple[int, dict[str, Any], int]], SweepRecord]:
    """Return the function that does runs in a worker process."""
    return lambda order: do_run(job, *order)
