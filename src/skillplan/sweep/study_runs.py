"""One run of a study: learn with one setting and seed, and answer from every start."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from skillplan.checks.verdict_cache import VerdictCache
from skillplan.errors import OptionError, SkillplanError
from skillplan.pipeline.setup import Setup
from skillplan.pipeline.solving import SearchRequest, grade, search, solve, warm_cache
from skillplan.plugins.blame import ends_program
from skillplan.records.result import Result, Status
from skillplan.records.stored.policy_file import start_state
from skillplan.records.sweep.result import StartOutcome, SweepRecord
from skillplan.solvers.stop import Stop
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.workers.executor import Answer, Executor, News, Worker, packed, shares_files
from skillplan.workers.local_processes import LocalProcesses

# Exact search from one start, to stand beside what is learned, takes no longer than this.
_REFERENCE_S = 10.0


@dataclass(frozen=True)
class StudyJob:
    """What all runs of a study have in common; can be sent to another process.

    Parameters
    ----------
    tasks
        The task from every start, by the start's name.
    solver
        The solver's name.
    setup
        Back ends and the options that do not vary.
    warm
        Whether verdicts kept on disk are used.

    Raises
    ------
    ValueError
        If there is no task.
    """

    tasks: Mapping[str, Task]
    solver: str
    setup: Setup
    warm: bool = False

    def __post_init__(self) -> None:
        if not self.tasks:
            raise ValueError("A study needs at least one start.")

    def cache(self) -> VerdictCache:
        """Return where a run keeps verdicts: cold unless the study is warm, and on its machine."""
        return warm_cache() if self.warm and shares_files() else VerdictCache()

    def optimum(self, start: str) -> float | None:
        """Return the proved least cost from a start; None where exact search proves none."""
        task = self.tasks[start]
        if not task.deterministic:
            return None
        options = {key: kv for key, kv in self.setup.options.items() if key != self.solver}
        setup = replace(self.setup, options=options)
        stop = Stop(time_limit_s=_REFERENCE_S)
        best = solve(task, "exact", setup, stop=stop, cache=self.cache())
        return best.cost if best.status is Status.OPTIMAL else None


def from_starts(task: Task, starts: list[str]) -> dict[str, Task]:
    """Return the task from every start; a learner explores from all of them.

    Parameters
    ----------
    task
        The task.
    starts
        Places, or facts joined by ``+``; empty for the task's own start.

    Raises
    ------
    OptionError
        If a start is unknown, named twice, or no state the task can be in.
    """
    if not starts:
        places = [place.name for place in task.places_in(task.initial)]
        return {places[0] if len(places) == 1 else "+".join(task.initial): task}
    states: dict[str, State] = {}
    for name in starts:
        try:
            state = start_state(task, name.replace("+", ","))
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
    """Return what became of a run; whatever goes wrong in it stands in its record.

    Parameters
    ----------
    job
        What is studied.
    setting
        Index of the setting.
    options
        Its options of the solver.
    seed
        Governs all randomness.
    stop
        When to stop; by default never.
    """
    try:
        return _run(job, setting, options, seed, stop)
    except SkillplanError as error:
        return SweepRecord(setting, seed, error=str(error))
    except BaseException as error:
        if ends_program(error):
            raise
        return SweepRecord(setting, seed, error=f"{type(error).__name__}: {error}")


def _run(
    job: StudyJob, setting: int, options: Mapping[str, Any], seed: int, stop: Stop | None
) -> SweepRecord:
    known = job.setup.options.get(job.solver, {})
    setup = replace(job.setup, options={**job.setup.options, job.solver: {**known, **options}})
    (first, task), *others = job.tasks.items()
    cache = job.cache()
    request = SearchRequest(task, job.solver, setup, seed, stop or Stop(), cache)
    made = search(request)
    if made.refusal is not None:
        return SweepRecord(setting, seed, error=f"refused: {made.refusal}")
    result = grade(request, made)
    outcomes = [_outcome(first, result)]
    shared = made.solution.policy is not None
    if shared:
        # What it claims to have proved, it claims of the first start only.
        solution = replace(made.solution, lower_bound=None, proved=False)
        made = replace(made, solution=solution)
    for name, task in others:
        other = (
            grade(replace(request, task=task), made)
            if shared
            else solve(task, job.solver, setup, seed=seed, stop=stop, cache=job.cache())
        )
        outcomes.append(_outcome(name, other))
    return SweepRecord(setting, seed, tuple(outcomes), shared, result.expanded)


def _outcome(start: str, result: Result) -> StartOutcome:
    # The time that a solver reports for learning leaves out enumerating and compiling.
    known = result.trace.get("learning_s")
    sound = isinstance(known, int | float) and not isinstance(known, bool) and known >= 0
    learning_s = float(known) if sound and known is not None else result.wall_s
    return StartOutcome(
        start, result.status, result.cost, result.makespan, result.reason, learning_s
    )


_WHAT = "the runs"


@dataclass(frozen=True, slots=True)
class Order:
    """A run to be done: the index of its setting, its options and its seed."""

    setting: int
    options: Mapping[str, Any]
    seed: int


def do_all(
    job: StudyJob,
    orders: Iterable[Order],
    count: int,
    stopped: Callable[[], bool],
    executor: Executor | None = None,
) -> Iterator[SweepRecord]:
    """Yield the records of runs as they end, in whatever order.

    A run whose process is ended, for want of memory for example, is recorded as failed, and the
    others go on; one whose machine is lost is done once more elsewhere. Once `stopped` is true,
    unfinished runs are given up.

    Parameters
    ----------
    job
        What all runs have in common.
    orders
        The runs; the next one is asked for once the record before it has been taken.
    count
        How many processes, >= 1.
    stopped
        Whether to stop; called several times a second.
    executor
        Where they run instead; it has the number of them, too.

    Raises
    ------
    SkillplanError
        If processes cannot be started.
    """
    executor = LocalProcesses(count) if executor is None else executor
    todo = iter(orders)
    content = packed(replace(job, setup=job.setup.in_worker), _WHAT)
    at: dict[Worker, Order] = {}
    again: list[Order] = []

    def give(worker: Worker | None, order: Order) -> None:
        if worker is None:
            worker = executor.start(_prepare, content, _WHAT)
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
                    # A lost machine is no fault of the run's: once more, elsewhere.
                    again.append(order)
                    del at[worker]
                    worker.end()
                    give(None, order)
                    continue
                elif not answer.started and not answer.killed:
                    raise worker.not_started()
                else:
                    error = f"its process ended by {answer.how}"
                    record = SweepRecord(order.setting, order.seed, error=error)
                # First the record, by which the next run may be chosen.
                yield record
                following = next(todo, None)
                goes_on = following is not None and isinstance(answer, Answer)
                if not goes_on:
                    del at[worker]
                    worker.end()
                if following is not None:
                    # Another process goes on where this one broke down.
                    give(worker if goes_on else None, following)
    finally:
        executor.close()


def _prepare(job: StudyJob) -> Callable[[tuple[int, dict[str, Any], int]], SweepRecord]:
    """Return what does the runs of a study, in a process of its own."""
    return lambda order: do_run(job, *order)
