"""Geometry before physics: skills that a quick detector rules out need not be executed.

A screen is a detector that no user named, checked before back ends that execute skills. They are
not queried about the skills that it refuses. If it leaves no plan at all, only a sample of its
refusals is executed: a screen must not hide what an engine would grant.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace

from skillplan.checks.audit import VerdictSample, draw_sample
from skillplan.checks.feasibility import Feasibility
from skillplan.checks.single_check import IntroducedBackEnds, check
from skillplan.checks.variants import map_queried_skills
from skillplan.errors import SearchStopped
from skillplan.model.skill_model import SkillModel
from skillplan.pipeline.solving import SearchOutcome, SearchRequest
from skillplan.solvers.search.exact import ExactSolver
from skillplan.solvers.solution import Solution
from skillplan.solvers.stop import Stop
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import VerdictStatus

# If geometry alone takes longer, the search with physics begins without its proof [s].
_PATIENCE_S = 20.0


def search_by_geometry(model: SkillModel, request: SearchRequest) -> SearchOutcome | None:
    """Return a proof by the quick back ends that a task has no plan, or None without one.

    Fewer back ends allow more plans: if these leave none, all together leave none. Only a sample
    of the refusals of the screen is executed.

    Parameters
    ----------
    model
        Model of the task, with a screen among its back ends. The search after this one uses its
        verdicts again.
    request
        The request of the whole search.

    Raises
    ------
    BackEndError
        If a back end fails.
    """
    task, feasibility, stop = model.task, model.feasibility, request.stop
    if not task.deterministic:
        return None
    begin_s = time.perf_counter()
    quick = IntroducedBackEnds(
        back_end for back_end in feasibility.back_ends if not back_end.expensive
    )
    geometry = SkillModel(Feasibility(task, quick, feasibility.cache), stop.overdue)
    # Only `stop` receives Ctrl-C, at the next query.
    solver = ExactSolver(stop=stop.within(_PATIENCE_S))
    try:
        solution = solver.solve(geometry, seed=request.seed)
    except SearchStopped:
        return None
    stats = geometry.stats
    if solution.plan is not None or not solution.proved or stats.unknown:
        return None
    with closing(feasibility):
        sample = draw_sample(feasibility, request.sample_size)
        screened = execute_sample(feasibility.back_ends, sample, stop)
    trace = {
        **solution.trace,
        "choice": "exact, by geometry alone, which leaves no plan",
        "screening": screened.document(),
    }
    return SearchOutcome(
        Solution(proved=True, trace=trace),
        # The trace has the number of states.
        replace(stats, states=0, trajectories=0),
        wall_s=time.perf_counter() - begin_s,
        interrupted=stop.interrupted,
        back_ends=quick,
        doubt=screened.overruled,
    )


@dataclass(frozen=True, slots=True)
class Screened:
    """Outcome of executing a sample of the refusals of a screen.

    Parameters
    ----------
    refused
        Number of refusals.
    executed
        Number of refused skills that were executed.
    overruled
        Message about the first of them that all other back ends granted; empty without one.
    """

    refused: int
    executed: int
    overruled: str = ""

    def document(self) -> dict[str, int]:
        """Return the figures for the trace of a search."""
        return {"refused": self.refused, "executed": self.executed}


def execute_sample(
    back_ends: Sequence[BackEnd], sample: VerdictSample, stop: Stop | None = None
) -> Screened:
    """Execute a sample of the skills that screens have refused.

    Parameters
    ----------
    back_ends
        The chain that gave the verdicts, in its order.
    sample
        The refusals.
    stop
        Stop of a search; nothing more is executed once it has stopped.

    Raises
    ------
    BackEndError
        If a back end fails.
    """
    others = [back_end for back_end in back_ends if not back_end.screens]
    skills = map_queried_skills(back_ends[0].task) if sample.refused else {}
    executed = 0
    for refusal in sample.refused:
        if stop is not None and (stop.interrupted or stop()):
            break
        executed += 1
        screen, skill = back_ends[refusal.back_end], skills[refusal.skill]
        state = refusal.made_in
        if all(_grants(other, skill, state) for other in others):
            names = " and ".join(other.name for other in others if other.expensive)
            words = (
                f"the screen {screen.name!r} refuses {skill.name} ({refusal.verdict.reason}), "
                f"which {names} grants in {state}; --no-screening leaves it to {names}"
            )
            return Screened(sample.refusals, executed, words)
    return Screened(sample.refusals, executed)


def _grants(back_end: BackEnd, skill: Skill, state: State) -> bool:
    return check(back_end, skill, state).verdict.status is VerdictStatus.FEASIBLE
