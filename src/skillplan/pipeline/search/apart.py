"""A search in a process of its own, for a solver that nothing says would stop when it should.

What it hands to its stop is told to this process at once. Where the process is ended, the last that
was told is what the search has come to.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from skillplan.checks.feasibility import Feasibility
from skillplan.checks.single_check import Recipe, construct
from skillplan.checks.verdict_cache import DiskVerdictCache, VerdictCache
from skillplan.errors import BackEndError, SkillplanError, SolverError
from skillplan.judge.plain_solution import plain_plan
from skillplan.model.skill_model import ModelStats, SkillModel
from skillplan.pipeline.search.solver_call import blamed, plain_answer
from skillplan.plugins.blame import traceback_text
from skillplan.solvers.solution import Plan, Policy, Solution
from skillplan.solvers.solver import Solver
from skillplan.solvers.stop import MEMORY_LIMIT, Stop
from skillplan.task.back_end import BackEnd
from skillplan.task.task import Task
from skillplan.workers.executor import Answer, Ended, Executor, News, Worker, packed
from skillplan.workers.inside import tell, when_asked_to_stop
from skillplan.workers.local_processes import LocalProcesses
from skillplan.workers.resident_memory import resident_bytes_of

_WHAT = "the search"
# So long it may take to return once it was asked to [s].
GRACE_S = 1.0
# Bounds come by the thousand; telling of them more often takes time from the search [s].
_TELL_EVERY_S = 0.02

_Content = tuple[Task, list[Recipe], type[Solver], BaseModel, Path | None]
# The best plan and bound so far, how many nodes, and what was queried until then.
_Told = tuple[Plan | None, float | None, int, ModelStats]


@dataclass(frozen=True, slots=True)
class _Job:
    seed: int
    limits: Mapping[str, Any]
    start: Plan | None
    lower_bound: float | None


@dataclass(frozen=True, slots=True)
class _Raised:
    words: str
    traceback: str
    back_end: bool


_Answer = tuple[Solution, ModelStats] | _Raised


def is_possible() -> bool:
    """Whether a process can be started from here; not from one that does jobs itself."""
    return not LocalProcesses(1).refusal


def search_apart(
    solver: Solver,
    task: Task,
    back_ends: Sequence[BackEnd],
    cache: VerdictCache,
    seed: int,
    stop: Stop,
    executor: Executor | None = None,
) -> tuple[Solution, ModelStats]:
    """Let a solver search in a process of its own, and end that when its time has come.

    Parameters
    ----------
    solver
        Its class and options are taken; the object is not used.
    task
        What is searched.
    back_ends
        The process makes its own of the same classes and options.
    cache
        Where verdicts are kept; the process uses the same folder, if there is one.
    seed
        As in `Solver.solve`.
    stop
        Its limits count for the process, which is asked to stop once it is true.
    executor
        Where it runs instead.

    Returns
    -------
    Solution
        The solver's answer, or the best that it had told.
    ModelStats
        What was queried; of a process that was ended, until it last told anything.

    Raises
    ------
    SolverError
        If the solver fails, or its process is ended by something else.
    BackEndError
        If a back end fails.
    SkillplanError
        If no process can be started.
    """
    folder = cache.folder if isinstance(cache, DiskVerdictCache) else None
    made = [Recipe.of(back_end) for back_end in back_ends]
    content: _Content = (task, made, type(solver), solver.options, folder)
    place = LocalProcesses(1) if executor is None else executor
    worker = place.start(_prepare, packed(content, _WHAT), _WHAT)
    try:
        worker.take(_Job(seed, stop.left(), stop.best, stop.lower_bound))
        return _heard(solver.name, worker, place, stop)
    finally:
        worker.end(gently=False)


def _heard(name: str, worker: Worker, place: Executor, stop: Stop) -> tuple[Solution, ModelStats]:
    """Listen to a search until it ends, or has to be ended."""
    asked_s: float | None = None
    stats = ModelStats()
    while True:
        for ready in place.first_ready([worker]):
            said = ready.answer()
            if isinstance(said, Ended):
                if not said.started and not said.killed:
                    raise worker.not_started()
                raise SolverError(
                    f"The solver {name!r} failed: its process was ended by {said.how}."
                )
            if isinstance(said, News):
                stats = _note(said.content, stop)
            elif isinstance(said, Answer):
                return _found(said.content)
        limit, held = stop.memory_limit_bytes, resident_bytes_of(worker.number)
        if limit is not None and held is not None and held > limit:
            stop.end(MEMORY_LIMIT)
            return Solution(stop.best, stop.lower_bound), stats
        if stop():
            if asked_s is None:
                asked_s = time.monotonic()
                worker.ask_to_stop()
            elif time.monotonic() > asked_s + GRACE_S:
                return Solution(stop.best, stop.lower_bound), stats


def _note(told: _Told, stop: Stop) -> ModelStats:
    plan, bound, nodes, stats = told
    if plan is not None:
        stop.incumbent(plan)
    if bound is not None:
        stop.bound(bound, nodes)
    return stats


def _found(content: _Answer) -> tuple[Solution, ModelStats]:
    if not isinstance(content, _Raised):
        return content
    error = (BackEndError if content.back_end else SolverError)(content.words)
    error.remote_traceback = content.traceback
    raise error


def _prepare(content: _Content) -> Callable[[_Job], _Answer]:
    """Return what searches, in a process of its own."""
    task, wanted, solver, options, folder = content

    def search(job: _Job) -> _Answer:
        try:
            return _search(job)
        except SkillplanError as error:
            return _Raised(str(error), traceback_text(error), isinstance(error, BackEndError))

    def _search(job: _Job) -> tuple[Solution, ModelStats]:
        stop = _started(job)
        back_ends = construct(task, wanted)
        cache = VerdictCache() if folder is None else DiskVerdictCache(folder)
        model = SkillModel(Feasibility(task, back_ends, cache), stop.overdue)
        with _Reporter(stop, model):
            with blamed(solver):
                made = solver(options, stop)
            solution = plain_answer(made, model, job.seed, stop)
        return _portable(solver.name, solution), model.stats

    return search


def _portable(name: str, solution: Solution) -> Solution:
    """Return a solution that can be sent to another process."""
    found = solution.found
    if not isinstance(found, Mapping):
        return solution
    try:
        return replace(solution, found=Policy(dict(found.items())))
    except Exception as error:
        words = f"The solver {name!r} returned a Solution that cannot be read"
        raise SolverError(f"{words}: {error}.") from None


class _Reporter:
    """Tells what a stop is given to whoever waits for the search, but not too often.

    Parameters
    ----------
    stop
        Of the search.
    model
        What the search queries.
    """

    def __init__(self, stop: Stop, model: SkillModel) -> None:
        self._stop = stop
        self._model = model
        self._told = (stop.best, stop.lower_bound)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._repeat, daemon=True)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _repeat(self) -> None:
        # What is gone has nobody to tell.
        with suppress(OSError):
            while not self._over.wait(_TELL_EVERY_S):
                self.report()

    def report(self) -> None:
        """Tell what is new."""
        stop = self._stop
        best, bound = known = (stop.best, stop.lower_bound)
        if known != self._told:
            self._told = known
            plan = None if best is None else plain_plan(best)
            tell((plan, bound, stop.nodes, self._model.stats))


def _started(job: _Job) -> Stop:
    """Return the stop of a search, as far as the search has come before it was sent here."""
    stop = Stop(**job.limits)
    if job.start is not None:
        stop.incumbent(job.start)
    if job.lower_bound is not None:
        stop.bound(job.lower_bound)
    when_asked_to_stop(stop.interrupt)
    return stop
