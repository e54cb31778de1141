"""An attempt: a solver searches a model, and what it rested on is put to the test.

Nothing is judged here; a solution is what the solver claims.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from skillplan.checks.audit import SampleSize, VerdictSample, ask_again, draw_sample
from skillplan.checks.feasibility import Feasibility
from skillplan.checks.verdict_cache import VerdictCache
from skillplan.judge.untouched import Untouched
from skillplan.model.skill_model import ModelStats, SkillModel
from skillplan.pipeline.search.found import Found
from skillplan.pipeline.search.solver_call import blamed, plain_answer
from skillplan.records.grading import Draft
from skillplan.solvers.solution import Plan, Solution
from skillplan.solvers.solver import Solver
from skillplan.solvers.stop import Stop
from skillplan.solvers.warm_start import search_from
from skillplan.task.back_end import BackEnd
from skillplan.task.task import Task


@dataclass(frozen=True)
class Attempt:
    """What a solver made of a task, before the referee has seen it.

    Parameters
    ----------
    draft
        Who solved what, how, and at what effort.
    solution
        What the solver claims.
    unknown_met
        Whether a back end could not decide about a skill during the search.
    stopped
        Why the search was stopped, or None while it was not.
    refusal
        Why the solver does not serve the task, or None.
    back_ends
        Those that were queried; None where none has been constructed.
    touched
        Whether the solver changed the task, which has been undone.
    doubt
        Why a proof is not granted although the solver has one; empty without doubt.
    left_open
        About which skill a back end could not decide first, and why; empty without.
    """

    draft: Draft
    solution: Solution
    unknown_met: bool = False
    stopped: str | None = None
    refusal: str | None = None
    back_ends: Sequence[BackEnd] | None = None
    touched: bool = False
    doubt: str = ""
    left_open: str = ""

    def back_ends_of(self, task: Task) -> Sequence[BackEnd] | None:
        """Return the back ends if they are of `task`; None where it takes others."""
        made = self.back_ends
        return made if made and all(back_end.task is task for back_end in made) else None


@dataclass(frozen=True, slots=True)
class Terms:
    """On which terms a solver searches.

    Parameters
    ----------
    cache
        Where verdicts are kept.
    seed
        Governs all randomness.
    stop
        When the search stops.
    jobs
        How many processes expensive back ends may use, >= 1.
    audit
        How many verdicts that were reused are asked again after the search; None for a handful, and
        then none of expensive back ends.
    start
        A plan to start from, or None.
    may_leave
        Whether the solver may search in a process of its own.
    """

    cache: VerdictCache
    seed: int
    stop: Stop
    jobs: int = 1
    audit: int | None = None
    start: Plan | None = None
    may_leave: bool = True

    @property
    def sample_size(self) -> SampleSize:
        """How many verdicts are put to the test after the search."""
        return SampleSize.of(self.audit, self.seed)


def attempted(solver: Solver, model: SkillModel, draft: Draft, terms: Terms) -> Attempt:
    """Let a solver search a model.

    Parameters
    ----------
    solver
        Heeds the stop of `terms`.
    model
        Of the task, on which nothing has been asked.
    draft
        Says who solves what.
    terms
        On which the solver searches.

    Raises
    ------
    OptionError
        If the start plan is of another task.
    SolverError
        If the solver fails.
    BackEndError
        If a back end fails or contradicts itself.
    """
    stop, back_ends = terms.stop, model.feasibility.back_ends
    by_geometry = _attempted_by_geometry(draft, model, terms)
    if by_geometry is not None:
        return by_geometry
    before = Untouched(model.task)
    begin_s = time.perf_counter()
    try:
        with blamed(type(solver)):
            refusal = solver.refuses(model)
        if refusal is not None:
            return Attempt(draft, Solution(), refusal=refusal, back_ends=back_ends)
        with closing(model.feasibility):
            search = _search_of(solver, model, terms)
            if terms.start is None:
                solution = search()
            else:
                with blamed(type(solver)):
                    solution = _search_from(terms.start, model, search, terms)
        wall_s = time.perf_counter() - begin_s
    finally:
        touched = before.restore()
    trace, doubt = solution.trace, ""
    if not touched and not stop.interrupted:
        sample = search.sample or draw_sample(model.feasibility, terms.sample_size)
        # Those of another process were asked there; here it is the first time.
        ask_again(back_ends, sample.reused, times=2 if sample.elsewhere else 1)
        executed, doubt = _executed_sample(model, sample, stop)
        trace = {**trace, **executed}
    foresight = model.feasibility.foresight
    if foresight is not None and foresight.made:
        trace = {**trace, "ahead": {"useful": foresight.useful, "wasted": foresight.wasted}}
    stats = search.stats
    iterations = _count(solution, "iterations", "expanded", "visited")
    draft = replace(
        draft,
        states=max(stats.states, _count(solution, "states") or 0),
        expanded=stats.states if iterations is None else iterations,
        checks=stats.checks,
        cache_hits=stats.cache_hits,
        trajectories=stats.trajectories,
        wall_s=wall_s,
        interrupted=stop.interrupted,
        trace=trace,
    )
    made = Attempt(draft, solution, stats.unknown > 0, stop.reason, None, back_ends, doubt=doubt)
    made = replace(made, left_open=stats.left_open)
    # What holds parts of the task as the solver left it serves no more.
    return replace(made, back_ends=None, touched=True) if touched else made


class _Search:
    """A search that is done once, what was queried in it, and what of that was drawn elsewhere.

    Parameters
    ----------
    do
        Does it.
    """

    def __init__(self, do: Callable[[], Found]) -> None:
        self._do = do
        self.stats = ModelStats()
        self.sample: VerdictSample | None = None

    def __call__(self) -> Solution:
        found = self._do()
        self.stats, self.sample = found.stats, found.sample
        return found.solution


def _search_of(solver: Solver, model: SkillModel, terms: Terms) -> _Search:
    """Return the search, in a process of its own where that has to be ended from outside."""
    stop = terms.stop
    if terms.may_leave and not solver.polls and stop.limits_effort:
        # Takes what starts processes, which most searches can do without.
        from skillplan.pipeline.search import apart

        if apart.is_possible():
            args = (solver, model.task, model.feasibility.back_ends, terms.cache, terms.seed, stop)
            return _Search(partial(apart.search_apart, *args, terms.sample_size))
    model.feasibility.reused.keep(terms.sample_size.reused)
    return _Search(partial(_search, solver, model, terms))


def _search(solver: Solver, model: SkillModel, terms: Terms) -> Found:
    return Found(plain_answer(solver, model, terms.seed, terms.stop), model.stats)


def _search_from(start: Plan, model: SkillModel, search: _Search, terms: Terms) -> Solution:
    """Return what a search finds that begins with a plan, if that holds."""
    back_ends = model.feasibility.back_ends
    # What expensive back ends say of the start plan is kept for the search.
    kept = terms.cache if any(back_end.expensive for back_end in back_ends) else None
    fresh = SkillModel(Feasibility(model.task, back_ends, kept, jobs=terms.jobs))
    with closing(fresh.feasibility):
        return search_from(start, fresh, search, terms.stop)


def _attempted_by_geometry(draft: Draft, model: SkillModel, terms: Terms) -> Attempt | None:
    """Return an attempt that proves without any execution that there is no plan, or None."""
    if not model.feasibility.screens:
        return None
    from skillplan.pipeline.search.screening import ruled_out

    stop = terms.stop
    begin_s = time.perf_counter()
    proof = ruled_out(model.feasibility, stop, terms.seed)
    if proof is None:
        return None
    with closing(model.feasibility):
        sample = draw_sample(model.feasibility, terms.sample_size)
        executed, doubt = _executed_sample(model, sample, stop)
    draft = replace(
        draft,
        states=proof.trace["states"],
        expanded=proof.trace["expanded"],
        checks=proof.stats.checks,
        cache_hits=proof.stats.cache_hits,
        wall_s=time.perf_counter() - begin_s,
        interrupted=stop.interrupted,
        trace={
            **proof.trace,
            "choice": "exact, by geometry alone, which leaves no plan",
            **executed,
        },
    )
    return Attempt(draft, Solution(proved=True), back_ends=proof.back_ends, doubt=doubt)


def _executed_sample(
    model: SkillModel, sample: VerdictSample, stop: Stop
) -> tuple[dict[str, Any], str]:
    """Execute some of what a screen refused; return figures for the trace, and what is in doubt."""
    if not model.feasibility.screens:
        return {}, ""
    from skillplan.pipeline.search.screening import executed_sample

    screened = executed_sample(model.feasibility.back_ends, sample, stop)
    return {"screening": screened.document()}, screened.overruled


def _count(solution: Solution, *names: str) -> int | None:
    """Return the first of some figures of a trace that is a count."""
    for name in names:
        figure = solution.trace.get(name)
        if isinstance(figure, int) and figure >= 0:
            return figure
    return None
