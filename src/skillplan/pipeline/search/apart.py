"""A search in a process of its own, for a solver that nothing says would stop when it should.

What it hands to its stop is told to this process at once. Where the process is ended, the last that
was told is what the search has come to.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

from skillplan.checks.audit import (
    SampleSize,
    VerdictSample,
)
from skillplan.checks.single_check import Recipe
from skillplan.checks.verdict_cache import DiskVerdictCache, VerdictCache
from skillplan.errors import BackEndError, SolverError
from skillplan.model.skill_model import ModelStats
from skillplan.pipeline.search.found import Found
from skillplan.pipeline.search.searching_process import (
    Answered,
    Content,
    Job,
    Raised,
    Told,
    prepare,
)
from skillplan.solvers.solution import Solution
from skillplan.solvers.solver import Solver
from skillplan.solvers.stop import MEMORY_LIMIT, Stop
from skillplan.task.back_end import BackEnd
from skillplan.task.task import Task
from skillplan.workers.executor import Answer, Ended, Executor, News, Worker, packed
from skillplan.workers.local_processes import LocalProcesses
from skillplan.workers.resident_memory import resident_bytes_of

_WHAT = "the search"
# So long it may take to return once it was asked to [s].
GRACE_S = 1.0
# Of a process that has to be ended so much is heard that it has said already.
_MOST_LAST = 100


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
    size: SampleSize = SampleSize(),
    executor: Executor | None = None,
) -> Found:
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
    size
        How many of its verdicts come back, to be asked again.
    executor
        Where it runs instead.

    Returns
    -------
    Found
        The solver's answer, or the best that it had told. What was queried for it, and a sample of
        that; of a process that was ended, until it last told anything.

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
    content: Content = (task, made, type(solver), solver.options, folder)
    place = LocalProcesses(1) if executor is None else executor
    worker = place.start(prepare, packed(content, _WHAT), _WHAT)
    try:
        worker.take(Job(seed, size, stop.left(), stop.best, stop.lower_bound))
        return _heard(solver.name, worker, place, stop)
    finally:
        worker.end(gently=False)


def _heard(name: str, worker: Worker, place: Executor, stop: Stop) -> Found:
    """Listen to a search until it ends, or has to be ended."""
    asked_s: float | None = None
    heard = _Heard(name, worker, stop)
    while True:
        if place.first_ready([worker]):
            found = heard.listen()
            if found is not None:
                return found
        limit, held = stop.memory_limit_bytes, resident_bytes_of(worker.number)
        late = asked_s is not None and time.monotonic() > asked_s + GRACE_S
        if limit is not None and held is not None and held > limit:
            stop.end(MEMORY_LIMIT)
            late = True
        if late:
            return heard.last(place)
        if asked_s is None and stop():
            asked_s = time.monotonic()
            worker.ask_to_stop()


class _Heard:
    """What a search apart has said until now.

    Parameters
    ----------
    name
        Of the solver.
    worker
        Where it searches.
    stop
        Given what it tells.
    """

    def __init__(self, name: str, worker: Worker, stop: Stop) -> None:
        self._name = name
        self._worker = worker
        self._stop = stop
        self._stats = ModelStats()
        self._sample = VerdictSample(elsewhere=True)

    def listen(self) -> Found | None:
        """Hear what is there, and return the answer if it is that.

        Raises
        ------
        SkillplanError
            If the search failed, or could not begin.
        """
        said = self._worker.answer()
        if isinstance(said, Ended):
            if not said.started and not said.killed:
                raise self._worker.not_started()
            raise SolverError(
                f"The solver {self._name!r} failed: its process was ended by {said.how}."
            )
        if isinstance(said, Answer):
            return _found(said.content)
        if isinstance(said, News):
            self._note(said.content)
        return None

    def last(self, place: Executor) -> Found:
        """Return the answer if it has been said by now, or else the best that was told."""
        for _ in range(_MOST_LAST):
            if not place.first_ready([self._worker], 0.0):
                break
            found = self.listen()
            if found is not None:
                return found
        return Found(Solution(self._stop.best, self._stop.lower_bound), self._stats, self._sample)

    def _note(self, told: Told) -> None:
        plan, bound, nodes, self._stats, reused = told
        if plan is not None:
            self._stop.incumbent(plan)
        if bound is not None:
            self._stop.bound(bound, nodes)
        self._sample = VerdictSample(tuple(reused), elsewhere=True)


def _found(content: Answered) -> Found:
    if not isinstance(content, Raised):
        return content
    error = (BackEndError if content.back_end else SolverError)(content.words)
    error.remote_traceback = content.traceback
    raise error
