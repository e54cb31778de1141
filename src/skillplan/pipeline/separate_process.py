"""A search in a process of its own, for a solver that may not stop at its limits by itself.

The process sends each better plan and bound at once. If it has to be ended, the last of them are
the outcome of the search.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from skillplan.checks.audit import DrawnVerdict, SampleSize, VerdictSample, draw_reused, draw_sample
from skillplan.checks.feasibility import Feasibility
from skillplan.checks.single_check import Recipe, construct
from skillplan.checks.verdict_cache import DiskVerdictCache, VerdictCache
from skillplan.errors import BackEndError, SkillplanError, SolverError
from skillplan.model.skill_model import ModelStats, SkillModel
from skillplan.pipeline.solving import SearchOutcome, SearchRequest, blame_solver, run_solver
from skillplan.plugins.blame import ends_program, format_traceback
from skillplan.solvers.solution import Plan, Policy, Solution
from skillplan.solvers.solver import Solver
from skillplan.solvers.stop import MEMORY_LIMIT, Progress, Stop
from skillplan.task.task import Task
from skillplan.workers.executor import (
    Answer,
    Ended,
    Executor,
    News,
    Worker,
    pack_content,
    set_stop_handler,
    tell,
)
from skillplan.workers.local_processes import LocalProcesses
from skillplan.workers.processes import measure_resident_bytes_of

_PURPOSE = "the search"
# Time that the process may take to return after a request to stop [s].
GRACE_S = 1.0
# Number of messages that are read from a process that has to be ended.
_MOST_LAST = 100
# Bounds come by the thousand; sending them more often takes time from the search [s].
_SEND_EVERY_S = 0.02
# Drawing from the reused verdicts takes a millisecond for hundreds of skills [s].
_DRAW_EVERY_S = 0.2

# Task, back ends, solver class, its options, folder of kept verdicts.
Content = tuple[Task, list[Recipe], type[Solver], BaseModel, Path | None]
# Best plan and bound so far, number of nodes, queries, sample of the reused verdicts.
Message = tuple[Plan | None, float | None, int, ModelStats, Sequence[DrawnVerdict]]


@dataclass(frozen=True, slots=True)
class Job:
    """One search, as it is sent to the process.

    Parameters
    ----------
    seed
        Seed of the solver.
    size
        Number of verdicts that come back to be recomputed.
    limits
        Keywords of a `Stop`.
    start, lower_bound
        The best plan and bound that are known, or None.
    """

    seed: int
    size: SampleSize
    limits: Mapping[str, Any]
    start: Plan | None
    lower_bound: float | None


@dataclass(frozen=True, slots=True)
class Failure:
    """An error of the search, as text.

    Parameters
    ----------
    back_end
        True if a back end failed, and not the solver.
    """

    message: str
    traceback: str
    back_end: bool


def is_possible() -> bool:
    """Return whether this process can start another; a worker process cannot."""
    return not LocalProcesses(1).refusal


def search_apart(
    solver: Solver, model: SkillModel, request: SearchRequest, executor: Executor | None = None
) -> SearchOutcome:
    """Let a solver search in a process of its own, and end that process when its time has come.

    Parameters
    ----------
    solver
        The process constructs a solver of the same class and options.
    model
        The process constructs back ends of the same classes and options.
    request
        The process uses the same folder of kept verdicts, and has the limits of its `stop`.
    executor
        Executor of the process; by default processes of this machine.

    Returns
    -------
    SearchOutcome
        The solver's answer, or the best plan and bound that it has sent, with its queries and a
        sample of its verdicts.

    Raises
    ------
    SolverError
        If the solver fails, or its process is ended by something else.
    BackEndError
        If a back end fails.
    SkillplanError
        If no process can be started.
    """
    cache, stop = request.cache, request.stop
    folder = cache.folder if isinstance(cache, DiskVerdictCache) else None
    recipes = [Recipe.of(back_end) for back_end in model.feasibility.back_ends]
    content: Content = (model.task, recipes, type(solver), solver.options, folder)
    place = LocalProcesses(1) if executor is None else executor
    worker = place.start(prepare, pack_content(content, _PURPOSE), _PURPOSE)
    try:
        size = request.sample_size
        worker.take(Job(request.seed, size, stop.left(), stop.best, stop.lower_bound))
        return _listen(solver.name, worker, place, stop)
    finally:
        worker.end(gently=False)


def _listen(name: str, worker: Worker, place: Executor, stop: Stop) -> SearchOutcome:
    """Read the messages of a search until it ends, or has to be ended."""
    asked_s: float | None = None
    inbox = _Inbox(name, worker, stop)
    while True:
        if place.first_ready([worker]):
            outcome = inbox.read()
            if outcome is not None:
                return outcome
        limit, held = stop.memory_limit_bytes, measure_resident_bytes_of(worker.number)
        late = asked_s is not None and time.monotonic() > asked_s + GRACE_S
        if limit is not None and held is not None and held > limit:
            stop.end(MEMORY_LIMIT)
            late = True
        if late:
            return inbox.read_last(place)
        if asked_s is None and stop():
            asked_s = time.monotonic()
            worker.ask_to_stop()


class _Inbox:
    """The messages of a search in another process.

    Parameters
    ----------
    name
        Name of the solver.
    worker
        The process.
    stop
        Receives plans and bounds.
    """

    def __init__(self, name: str, worker: Worker, stop: Stop) -> None:
        self._name = name
        self._worker = worker
        self._stop = stop
        self._stats = ModelStats()
        self._sample = VerdictSample(elsewhere=True)

    def read(self) -> SearchOutcome | None:
        """Read one message; return the outcome if it is the last one.

        Raises
        ------
        SkillplanError
            If the search failed, or could not begin.
        """
        answer = self._worker.answer()
        if isinstance(answer, Ended):
            if not answer.started and not answer.killed:
                raise self._worker.not_started()
            raise SolverError(
                f"The solver {self._name!r} failed: its process was ended by {answer.how}."
            )
        if isinstance(answer, Answer):
            return _unpack(answer.content)
        if isinstance(answer, News):
            self._note(answer.content)
        return None

    def read_last(self, place: Executor) -> SearchOutcome:
        """Return the outcome if it has arrived by now, or else the best plan and bound so far."""
        for _ in range(_MOST_LAST):
            if not place.first_ready([self._worker], 0.0):
                break
            outcome = self.read()
            if outcome is not None:
                return outcome
        best = Solution(self._stop.best, self._stop.lower_bound)
        return SearchOutcome(best, self._stats, self._sample)

    def _note(self, message: Message) -> None:
        plan, bound, nodes, self._stats, reused = message
        if plan is not None:
            self._stop.incumbent(plan)
        if bound is not None:
            self._stop.bound(bound, nodes)
        self._sample = VerdictSample(tuple(reused), elsewhere=True)


def _unpack(content: SearchOutcome | Failure) -> SearchOutcome:
    if not isinstance(content, Failure):
        return content
    error = (BackEndError if content.back_end else SolverError)(content.message)
    error.remote_traceback = content.traceback
    raise error


def prepare(content: Content) -> Callable[[Job], SearchOutcome | Failure]:
    """Return the function that searches; called in the other process."""
    task, recipes, solver_class, options, folder = content

    def search(job: Job) -> SearchOutcome | Failure:
        try:
            return run_job(job)
        except SkillplanError as error:
            return Failure(str(error), format_traceback(error), isinstance(error, BackEndError))

    def run_job(job: Job) -> SearchOutcome:
        stop = _make_stop(job)
        back_ends = construct(task, recipes)
        cache = VerdictCache() if folder is None else DiskVerdictCache(folder)
        model = SkillModel(Feasibility(task, back_ends, cache), stop.overdue)
        model.feasibility.reused.keep(job.size.reused)
        with _Reporter(stop, model, job.size):
            with blame_solver(solver_class):
                solver = solver_class(options, stop)
            outcome = run_solver(solver, model, job.seed, stop)
        sample = replace(draw_sample(model.feasibility, job.size), elsewhere=True)
        solution = _make_portable(solver_class.name, outcome.solution)
        return replace(outcome, solution=solution, sample=sample)

    return search


def _make_portable(name: str, solution: Solution) -> Solution:
    """Return a solution that can be sent to another process."""
    policy = solution.policy
    if policy is None:
        return solution
    try:
        return replace(solution, found=Policy(dict(policy.items())))
    except BaseException as error:
        if ends_program(error):
            raise
        words = f"The solver {name!r} returned a Solution that cannot be read"
        raise SolverError(f"{words}: {error}.") from None


class _Reporter:
    """Sends plans of a search at once, and bounds soon, to the process that waits for it.

    Parameters
    ----------
    stop
        Stop of the search.
    model
        Model that the search queries.
    size
        Size of the sample of verdicts.
    """

    def __init__(self, stop: Stop, model: SkillModel, size: SampleSize) -> None:
        self._stop = stop
        self._model = model
        self._size = size
        self._reused: Sequence[DrawnVerdict] = ()
        self._drawn_s = -math.inf
        self._best = stop.best
        self._plan: Plan | None = None
        self._sent_bound = stop.lower_bound
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._repeat, daemon=True)
        stop.listen(self._report_progress)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _report_progress(self, _: Progress) -> None:
        """Send a better plan: the search may take all memory with its next step."""
        best = self._stop.best
        if best is not None and best is not self._best:
            self._best = self._plan = best
            self._send()

    def _repeat(self) -> None:
        # The other process may have ended.
        with suppress(OSError):
            while not self._over.wait(_SEND_EVERY_S):
                if self._stop.lower_bound != self._sent_bound:
                    self._send()

    def _send(self) -> None:
        stop = self._stop
        self._sent_bound = bound = stop.lower_bound
        tell((self._plan, bound, stop.nodes, self._model.stats, self._draw()))

    def _draw(self) -> Sequence[DrawnVerdict]:
        """Return a sample of the verdicts reused until now, or until a moment ago."""
        now_s = time.monotonic()
        if now_s >= self._drawn_s + _DRAW_EVERY_S:
            self._drawn_s = now_s
            size = self._size
            self._reused = draw_reused(
                self._model.feasibility,
                size.reused,
                size.seed,
                expensive=size.expensive,
                going_on=True,
            )
        return self._reused


def _make_stop(job: Job) -> Stop:
    """Return the stop of a search, with the plan and bound that were known before it was sent."""
    stop = Stop(**job.limits)
    if job.start is not None:
        stop.incumbent(job.start)
    if job.lower_bound is not None:
        stop.bound(job.lower_bound)
    set_stop_handler(stop.interrupt)
    return stop
