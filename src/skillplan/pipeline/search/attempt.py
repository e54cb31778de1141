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

from skillplan.checks.audit import audit as hold_together
from skillplan.checks.feasibility import Feasibility
from skillplan.checks.reuse_sample import DEFAULT_SIZE
from skillplan.checks.verdict_cache import VerdictCache
from skillplan.judge.untouched import Untouched
from skillplan.model.skill_model import ModelStats, SkillModel
from skillplan.pipeline.search.solver_call import blamed, plain_answer
from skillplan.records.grading import Draft
from skillplan.solvers.solution import Plan, Solution
from skillplan.solvers.solver import Solver
from skillplan.solvers.stop import Stop
from skillplan.solvers.warm_start import search_from
from skillplan.task.back_end import BackEnd
from skillplan.task.task import Task

DEFAULT_AUDIT = 4
"""So many verdicts are asked again after a search, where that costs nothing to speak of."""


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
    """

    draft: Draft
    solution: Solution
    unknown_met: bool = False
    stopped: str | None = None
    refusal: str | None = None
    back_ends: Sequence[BackEnd] | None = None
    touched: bool = False
    doubt: str = ""

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
    size = DEFAULT_AUDIT if terms.audit is None else terms.audit
    model.feasibility.reused.most = max(DEFAULT_SIZE, 2 * size)
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
        hold_together(model.feasibility, size, terms.seed, expensive=terms.audit is not None)
        executed, doubt = _executed_sample(model, terms)
        trace = {**trace, **executed}
    stats = search.stats
    iterations = _count(solution, "iterations", "expanded", "visited")
    draft = replace(
        draft,
        states=max(stats.states, _count(solution, "states") or 0),
        expanded=stats.states if iterations is None else iterations,
        checks=stats.checks,
        cache_hits=stats.cache_hits,
        wall_s=wall_s,
        interrupted=stop.interrupted,
        trace=trace,
    )
    made = Attempt(draft, solution, stats.unknown > 0, stop.reason, None, back_ends, doubt=doubt)
    # What holds parts of the task as the solver left it serves no more.
    return replace(made, back_ends=None, touched=True) if touched else made


class _Search:
    """A search that is done once, and what was queried in it.

    Parameters
    ----------
    do
        Does it.
    """

    def __init__(self, do: Callable[[], tuple[Solution, ModelStats]]) -> None:
        self._do = do
        self.stats = ModelStats()

    def __call__(self) -> Solution:
        solution, self.stats = self._do()
        return solution


def _search_of(solver: Solver, model: SkillModel, terms: Terms) -> _Search:
    """Return the search, in a process of its own where that has to be ended from outside."""
    stop = terms.stop
    if terms.may_leave and not solver.polls and stop.limits_effort:
        # Takes what starts processes, which most searches can do without.
        from skillplan.pipeline.search import apart

        if apart.is_possible():
            args = (solver, model.task, model.feasibility.back_ends, terms.cache, terms.seed, stop)
            return _Search(partial(apart.search_apart, *args))
    return _Search(partial(_search, solver, model, terms))


def _search(solver: Solver, model: SkillModel, terms: Terms) -> tuple[Solution, ModelStats]:
    return plain_answer(solver, model, terms.seed, terms.stop), model.stats


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
    proof = ruled_out(model.feasibility, terms.cache, stop, terms.seed)
    if proof is None:
        return None
    with closing(model.feasibility):
        executed, doubt = _executed_sample(model, terms)
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


def _executed_sample(model: SkillModel, terms: Terms) -> tuple[dict[str, Any], str]:
    """Execute some of what a screen refused; return figures for the trace, and what is in doubt."""
    if not model.feasibility.screens:
        return {}, ""
    from skillplan.pipeline.search.screening import DEFAULT_SAMPLE, executed_sample

    size = DEFAULT_SAMPLE if terms.audit is None else terms.audit
    sample = executed_sample(model.feasibility, terms.cache, size, terms.seed, terms.stop)
    return {"screening": sample.document()}, sample.overruled


def _count(solution: Solution, *names: str) -> int | None:
    """Return the first of some figures of a trace that is a count."""
    for name in names:
        figure = solution.trace.get(name)
        if isinstance(figure, int) and figure >= 0:
            return figure
    return None
