"""Geometry before physics: what a quick detector rules out need not be executed.

A screen is a detector that nobody named, put before back ends that execute skills. What it refuses
they are not asked about, and where it leaves no plan at all, nothing is executed but a sample of
what it refused: a screen must not hide what an engine would grant.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from skillplan.checks.audit import VerdictSample
from skillplan.checks.feasibility import Feasibility
from skillplan.checks.single_check import IntroducedBackEnds, check
from skillplan.checks.variants import map_queried_skills
from skillplan.errors import SearchStopped
from skillplan.model.skill_model import ModelStats, SkillModel
from skillplan.solvers.search.exact import ExactSolver
from skillplan.solvers.stop import Stop
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import VerdictStatus

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


def ruled_out(feasibility: Feasibility, stop: Stop, seed: int) -> RuledOut | None:
    """Return the proof by quick back ends that a task has no plan, or None without one.

    Fewer back ends allow more: where they leave no plan, all together leave none.

    Parameters
    ----------
    feasibility
        Of the task, with a screen among its back ends; the verdicts made here serve the search
        after.
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
    model = SkillModel(Feasibility(task, quick, feasibility.cache), stop.overdue)
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

    def document(self) -> dict[str, int]:
        """Return the figures for the trace of a search."""
        return {"refused": self.refused, "executed": self.executed}


def executed_sample(
    back_ends: Sequence[BackEnd], sample: VerdictSample, stop: Stop | None = None
) -> Screened:
    """Execute a sample of what screens have refused.

    Parameters
    ----------
    back_ends
        In the order of the chain in which the verdicts were given.
    sample
        What was refused.
    stop
        That of a search; once it has stopped, nothing more is executed.

    Raises
    ------
    BackEndError
        If a back end fails.
    """
    others = [one for one in back_ends if not one.screens]
    skills = map_queried_skills(back_ends[0].task) if sample.refused else {}
    executed = 0
    for refusal in sample.refused:
        if stop is not None and (stop.interrupted or stop()):
            break
        executed += 1
        screen, skill = back_ends[refusal.back_end], skills[refusal.skill]
        state = refusal.made_in(screen.task)
        if all(_grants(other, skill, state) for other in others):
            names = " and ".join(one.name for one in others if one.expensive)
            words = (
                f"the screen {screen.name!r} refuses {skill.name} ({refusal.reason}), which "
                f"{names} grants in {state}; --no-screening leaves it to {names}"
            )
            return Screened(sample.refusals, executed, words)
    return Screened(sample.refusals, executed)


def _grants(back_end: BackEnd, skill: Skill, state: State) -> bool:
    return check(back_end, skill, state).verdict.status is VerdictStatus.FEASIBLE
