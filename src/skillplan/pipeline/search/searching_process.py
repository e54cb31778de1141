"""The process in which a search runs apart: it searches, and tells what its stop is given."""

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

from skillplan.checks.audit import DrawnVerdict, SampleSize, draw_reused, draw_sample
from skillplan.checks.feasibility import Feasibility
from skillplan.checks.single_check import Recipe, construct
from skillplan.checks.verdict_cache import DiskVerdictCache, VerdictCache
from skillplan.errors import BackEndError, SkillplanError, SolverError
from skillplan.judge.plain_solution import plain_plan
from skillplan.model.skill_model import ModelStats, SkillModel
from skillplan.pipeline.search.found import Found
from skillplan.pipeline.search.solver_call import blamed, plain_answer
from skillplan.plugins.blame import ends_program, traceback_text
from skillplan.solvers.solution import Plan, Policy, Solution
from skillplan.solvers.solver import Solver
from skillplan.solvers.stop import Progress, Stop
from skillplan.task.task import Task
from skillplan.workers.inside import tell, when_asked_to_stop

# Bounds come by the thousand; telling of them more often takes time from the search [s].
_TELL_EVERY_S = 0.02
# Drawing from what was reused takes a millisecond where there are hundreds of skills [s].
_DRAW_EVERY_S = 0.2

Content = tuple[Task, list[Recipe], type[Solver], BaseModel, Path | None]
# The best plan and bound so far, how many nodes, what was queried, and some of what was reused.
Told = tuple[Plan | None, float | None, int, ModelStats, Sequence[DrawnVerdict]]


@dataclass(frozen=True, slots=True)
class Job:
    """What is searched for, and how long.

    Parameters
    ----------
    seed
        Governs all randomness of the solver.
    size
        How many verdicts come back, to be asked again.
    limits
        Those of a `Stop`.
    start, lower_bound
        The best plan and bound that are known; None where there is none.
    """

    seed: int
    size: SampleSize
    limits: Mapping[str, Any]
    start: Plan | None
    lower_bound: float | None


@dataclass(frozen=True, slots=True)
class Raised:
    """An error in words.

    Parameters
    ----------
    words
        Its message.
    traceback
        Where it was raised.
    back_end
        Whether a back end failed, or else the solver.
    """

    words: str
    traceback: str
    back_end: bool


Answered = Found | Raised


def prepare(content: Content) -> Callable[[Job], Answered]:
    """Return what searches, in this process."""
    task, wanted, solver, options, folder = content

    def search(job: Job) -> Answered:
        try:
            return _search(job)
        except SkillplanError as error:
            return Raised(str(error), traceback_text(error), isinstance(error, BackEndError))

    def _search(job: Job) -> Found:
        stop = _started(job)
        back_ends = construct(task, wanted)
        cache = VerdictCache() if folder is None else DiskVerdictCache(folder)
        model = SkillModel(Feasibility(task, back_ends, cache), stop.overdue)
        model.feasibility.reused.keep(job.size.reused)
        with _Reporter(stop, model, job.size):
            with blamed(solver):
                made = solver(options, stop)
            solution = plain_answer(made, model, job.seed, stop)
        sample = replace(draw_sample(model.feasibility, job.size), elsewhere=True)
        return Found(_portable(solver.name, solution), model.stats, sample)

    return search


def _portable(name: str, solution: Solution) -> Solution:
    """Return a solution that can be sent to another process."""
    found = solution.found
    if not isinstance(found, Mapping):
        return solution
    try:
        return replace(solution, found=Policy(dict(found.items())))
    except BaseException as error:
        if ends_program(error):
            raise
        words = f"The solver {name!r} returned a Solution that cannot be read"
        raise SolverError(f"{words}: {error}.") from None


class _Reporter:
    """Tells what a stop is given to whoever waits for the search: plans at once, bounds soon.

    Parameters
    ----------
    stop
        Of the search.
    model
        What the search queries.
    size
        How much is drawn from that.
    """

    def __init__(self, stop: Stop, model: SkillModel, size: SampleSize) -> None:
        self._stop = stop
        self._model = model
        self._size = size
        self._reused: Sequence[DrawnVerdict] = ()
        self._drawn_s = -math.inf
        self._best = stop.best
        self._plan: Plan | None = None
        self._told_bound = stop.lower_bound
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._repeat, daemon=True)
        stop.listen(self._progressed)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _progressed(self, _: Progress) -> None:
        """Tell of a better plan: the search may take all memory with its next step."""
        best = self._stop.best
        if best is not None and best is not self._best:
            self._best, self._plan = best, plain_plan(best)
            self._tell()

    def _repeat(self) -> None:
        # What is gone has nobody to tell.
        with suppress(OSError):
            while not self._over.wait(_TELL_EVERY_S):
                if self._stop.lower_bound != self._told_bound:
                    self._tell()

    def _tell(self) -> None:
        stop = self._stop
        self._told_bound = bound = stop.lower_bound
        tell((self._plan, bound, stop.nodes, self._model.stats, self._drawn()))

    def _drawn(self) -> Sequence[DrawnVerdict]:
        """Return some of what was reused until now, or a moment ago."""
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


def _started(job: Job) -> Stop:
    """Return the stop of a search, as far as the search has come before it was sent here."""
    stop = Stop(**job.limits)
    if job.start is not None:
        stop.incumbent(job.start)
    if job.lower_bound is not None:
        stop.bound(job.lower_bound)
    when_asked_to_stop(stop.interrupt)
    return stop
