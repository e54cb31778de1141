"""What a planner of others says about what is claimed of all plans of a task."""

from __future__ import annotations

import math
from collections.abc import Iterator

from skillplan.errors import OptionError
from skillplan.exporters.handover import Handover
from skillplan.exporters.pddl.exporter import PddlExporter
from skillplan.exporters.pddl.planning_task import PlanningTask
from skillplan.judge import fast_downward
from skillplan.judge.fast_downward import NAME, PlannerAnswer
from skillplan.model.replay import replay
from skillplan.model.skill_model import SkillModel
from skillplan.records.certificate import Claim, Outcome
from skillplan.records.result import Status, tolerance
from skillplan.records.stored.result_file import StoredClaims


def planner_claims(
    stored: StoredClaims, model: SkillModel, limit_s: float, *, charted: bool
) -> Iterator[Claim]:
    """Yield what is claimed of all plans, held against what Fast Downward proves by PDDL.

    Where PDDL leaves out something that back ends judge, the planner may find more plans than
    there are: its optimum is then a lower bound only. It adds up costs that are rounded, so that
    its plan is walked on the model, too: a claim that is within the rounding does not hold where
    that plan costs less.

    Parameters
    ----------
    stored
        What is claimed.
    model
        A fresh model of the task.
    limit_s
        How long the planner may take [s], > 0.
    charted
        Whether the hand-made chart is all that the detectors go by.

    Raises
    ------
    OptionError
        If it is not installed.
    """
    fast_downward.driver()
    claimed = _claimed(stored)
    handover = Handover(model, None, charted, derived=True)
    # What rounding may come to is accounted for.
    exporter = PddlExporter(PddlExporter.Options(accept_rounding=True))
    refusal = exporter.refuses(handover)
    if refusal:
        yield Claim(claimed, Outcome.NOT_CHECKED, f"PDDL cannot say it: {refusal}", NAME)
        return
    made = exporter.planning_task(handover)
    answer = fast_downward.asked(made, limit_s)
    if answer.silence:
        yield Claim(claimed, Outcome.NOT_CHECKED, answer.silence, NAME)
        return
    yield _held(claimed, stored, made, answer)


def _claimed(stored: StoredClaims) -> str:
    if stored.status in (Status.OPTIMAL, Status.INFEASIBLE):
        return str(stored.status)
    return "lower bound" if stored.lower_bound is not None else "cost"


def _held(claimed: str, stored: StoredClaims, made: PlanningTask, answer: PlannerAnswer) -> Claim:
    task = made.task
    if answer.unsolvable or answer.cost is None:
        holds = stored.cost is None
        words = "it proves that there is no plan"
        words += "" if holds else f", claimed is one of {stored.cost:.10g}"
        return Claim(claimed, Outcome.HOLDS if holds else Outcome.FAILS, words, NAME)
    least = answer.cost / made.scale.per_unit
    rounding = made.scale.rounding(max(len(stored.skills), len(answer.skills)))
    words = f"it proves {task.metric.text(least)}"
    words += f", rounded by at most {rounding:.2g}" if rounding else ""
    words += "" if stored.cost is None else f", claimed {stored.cost:.10g}"
    if stored.cost is not None and stored.cost < least - rounding - tolerance(least):
        return Claim(claimed, Outcome.FAILS, f"{words}: no plan costs so little", NAME)
    limit = _no_plan_below(stored)
    if limit is None:
        return Claim(claimed, Outcome.HOLDS, words, NAME)
    # Rounding hides what a plan costs from the planner, and not from the model.
    found = _cost_of(made.model, answer.skills)
    if found is not None and found < limit - tolerance(found):
        words += f": its plan costs {found:.10g}"
        return Claim(claimed, Outcome.FAILS, words, NAME)
    if limit <= least + rounding + tolerance(least):
        return Claim(claimed, Outcome.HOLDS, words, NAME)
    words += "; its plan does not hold, as back ends judge by more than an order"
    return Claim(claimed, Outcome.NOT_CHECKED, words, NAME)


def _no_plan_below(stored: StoredClaims) -> float | None:
    """Return the cost below which no plan is claimed to be; None where nothing is claimed."""
    if stored.status is Status.INFEASIBLE:
        return math.inf
    return stored.cost if stored.status is Status.OPTIMAL else stored.lower_bound


def _cost_of(model: SkillModel, skills: tuple[str, ...]) -> float | None:
    """Return what the planner's plan costs on the model; None where it does not hold there."""
    try:
        walked = replay(model, [model.task.skill(name) for name in skills])
    except OptionError:
        return None
    return walked.cost if walked.complete else None
