"""Geometry before physics: what a quick detector rules out need not be executed.

A screen is a detector that nobody named, put before back ends that execute skills. What it refuses
they are not asked about, and where it leaves no plan at all, nothing is executed but a sample of
what it refused: a screen must not hide what an engine would grant.
"""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from skillplan.checks.feasibility import Feasibility
from skillplan.checks.single_check import IntroducedBackEnds, check
from skillplan.checks.verdict_cache import VerdictCache
from skillplan.checks.ways import asked_about
from skillplan.errors import BackEndError, SearchStopped
from skillplan.model.skill_model import ModelStats, SkillModel
from skillplan.solvers.search.exact import ExactSolver
from skillplan.solvers.stop import Stop
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import Verdict, VerdictStatus

DEFAULT_SAMPLE = 2
"""So many refusals are executed after a search."""
# Where geometry alone takes longer, the search with physics begins without its proof [s].
_PATIENCE_S = 20.0


@dataclass(frozen=True, slots=True)
class RuledOut:
    """A proof that there is no plan, for which nothing was executed.

    Parameters
    ----------
    back_ends
        Those that it rests on.
    stats
        What was queried for it.
    trace
        Of the search that found it.
    """

    back_ends: IntroducedBackEnds
    stats: ModelStats
    trace: Mapping[str, Any]


def ruled_out(
    feasibility: Feasibility, cache: VerdictCache, stop: Stop, seed: int
) -> RuledOut | None:
    """Return the proof by quick back ends that a task has no plan, or None without one.

    Fewer back ends allow more: where they leave no plan, all together leave none.

    Parameters
    ----------
    feasibility
        Of the task, with a screen among its back ends.
    cache
        Where verdicts are kept; those made here serve the search after.
    stop
        That of the search.
    seed
        Governs the search by geometry.

    Raises
    ------
    BackEndError
        If a back end fails.
    """
    task = feasibility.task
    if not task.deterministic:
        return None
    quick = IntroducedBackEnds(one for one in feasibility.back_ends if not one.expensive)
    model = SkillModel(Feasibility(task, quick, cache), stop.overdue)
    # Ctrl-C is heard by `stop` alone, at the next query.
    solver = ExactSolver(stop=stop.within(_PATIENCE_S))
    try:
        solution = solver.solve(model, seed=seed)
    except SearchStopped:
        return None
    none = solution.plan is None and solution.proved and not model.stats.unknown
    return RuledOut(quick, model.stats, solution.trace) if none else None


@dataclass(frozen=True, slots=True)
class Screened:
    """What came of executing some of what a screen refused.

    Parameters
    ----------
    refused
        How many verdicts refused something.
    executed
        How many of them were executed.
    overruled
        The first that everything else granted, in words; empty where there is none.
    """

    refused: int
    executed: int
    overruled: str = ""

    def raise_overruled(self) -> None:
        """Say that geometry and physics contradict each other, if they do.

        Raises
        ------
        BackEndError
            If they do.
        """
        if self.overruled:
            raise BackEndError(f"{self.overruled[0].upper()}{self.overruled[1:]}.")

    def document(self) -> dict[str, int]:
        """Return the figures for the trace of a search."""
        return {"refused": self.refused, "executed": self.executed}


def executed_sample(
    feasibility: Feasibility,
    cache: VerdictCache | None = None,
    size: int = DEFAULT_SAMPLE,
    seed: int = 0,
    stop: Stop | None = None,
) -> Screened:
    """Execute a sample of what a screen has refused.

    Parameters
    ----------
    feasibility
        With which a search was done, or a chart derived.
    cache
        Where verdicts are kept; by default that of `feasibility`.
    size
        How many refusals are executed, >= 0.
    seed
        Governs the choice.
    stop
        That of a search; once it has stopped, nothing more is executed.

    Raises
    ------
    BackEndError
        If a back end fails.
    """
    refusals = list(_refusals(feasibility, feasibility.cache if cache is None else cache))
    draw = random.Random(seed)
    others = [one for one in feasibility.back_ends if not one.screens]
    executed = 0
    for screen, skill, state, verdict in draw.sample(refusals, min(size, len(refusals))):
        if stop is not None and (stop.interrupted or stop()):
            break
        executed += 1
        if all(_grants(other, skill, state) for other in others):
            names = " and ".join(one.name for one in others if one.expensive)
            words = (
                f"the screen {screen.name!r} refuses {skill.name} ({verdict.reason}), which "
                f"{names} grants in {state}; --no-screening leaves it to {names}"
            )
            return Screened(len(refusals), executed, words)
    return Screened(len(refusals), executed)


def _grants(back_end: BackEnd, skill: Skill, state: State) -> bool:
    return check(back_end, skill, state).verdict.status is VerdictStatus.FEASIBLE


def _refusals(
    feasibility: Feasibility, cache: VerdictCache
) -> Iterator[tuple[BackEnd, Skill, State, Verdict]]:
    for screen in feasibility.screens:
        for skill in asked_about(feasibility.task):
            for verdict, state in cache.made(screen, skill):
                if verdict.status is VerdictStatus.INFEASIBLE:
                    yield screen, skill, state, verdict
