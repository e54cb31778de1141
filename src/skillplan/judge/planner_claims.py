"""Claims about all plans of a task, compared with what Fast Downward proves by PDDL."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

from skillplan.errors import SearchStopped
from skillplan.exporters.exporter import Handover
from skillplan.exporters.pddl.exporter import PddlExporter, PlanningTask
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
    """Yield the claims about all plans, compared with the optimum that Fast Downward proves.

    PDDL states the task as the model does, or the planner is not asked: whatever it proves
    otherwise is a contradiction. It adds up rounded costs, so its plan is replayed on the model,
    too: an optimum that is within the rounding fails if that plan costs less.

    Parameters
    ----------
    stored
        The claims.
    model
        A fresh model of the task.
    limit_s
        Time limit for verdicts and planner together [s], > 0.
    charted
        Whether the hand-made chart is all that the detectors check.

    Raises
    ------
    OptionError
        If the planner is not installed.
    """
    fast_downward.driver()
    claimed = _claimed(stored)
    handover = Handover(model, None, charted)
    deadline_s = time.monotonic() + limit_s
    try:
        task, answer = _asked(handover, deadline_s, count_steps=False)
        if len(answer.skills) > model.step_limit:
            # The plan is too long: the least cost within the limit is another question.
            task, answer = _asked(handover, deadline_s, count_steps=True)
        if task is not None and not answer.silence:
            yield _compared(claimed, stored, task, answer)
            return
        reason = answer.silence
    except SearchStopped:
        reason = "back ends have not given all verdicts within the limit"
    yield Claim(claimed, Outcome.NOT_CHECKED, reason, NAME)


def _asked(
    handover: Handover, deadline_s: float, *, count_steps: bool
) -> tuple[PlanningTask | None, PlannerAnswer]:
    """Return the task as PDDL has it and the planner's answer, or None and why PDDL cannot say it.

    Parameters
    ----------
    handover
        The task.
    deadline_s
        Time at which the planner should end, by the monotonic clock [s].
    count_steps
        Whether the step limit is part of the task.
    """
    # The comparison accounts for rounding.
    options = PddlExporter.Options(accept_rounding=True, count_steps=count_steps)
    exporter = PddlExporter(options)
    reason = exporter.refuses(handover)
    if reason:
        return None, PlannerAnswer(silence=f"PDDL cannot say it: {reason}")
    task = exporter.planning_task(handover)
    if task.left_out:
        reason = f"PDDL cannot say it: verdicts are not known: {task.left_out}"
        return None, PlannerAnswer(silence=reason)
    return task, fast_downward.asked(task, max(1.0, deadline_s - time.monotonic()))


def _claimed(stored: StoredClaims) -> str:
    if stored.status in (Status.OPTIMAL, Status.INFEASIBLE):
        return str(stored.status)
    return "lower bound" if stored.lower_bound is not None else "cost"


def _compared(
    claimed: str, stored: StoredClaims, task: PlanningTask, answer: PlannerAnswer
) -> Claim:
    """Return whether the planner's optimum agrees with the claims."""
    metric = task.task.metric
    if answer.unsolvable or answer.cost is None:
        words = "it proves that there is no plan"
        if stored.cost is None:
            return Claim(claimed, Outcome.HOLDS, words, NAME)
        return _contradiction(claimed, f"{words}, claimed is one of {stored.cost:.10g}")
    least = answer.cost / task.scale.per_unit
    rounding = task.scale.rounding(max(len(stored.skills), len(answer.skills)))
    words = f"it proves {metric.text(least)}"
    words += f", rounded by at most {rounding:.2g}" if rounding else ""
    words += "" if stored.cost is None else f", claimed {stored.cost:.10g}"
    slack = rounding + tolerance(least)
    if stored.cost is not None and stored.cost < least - slack:
        return _contradiction(claimed, f"{words}: no plan costs so little")
    limit = _no_plan_below(stored)
    if limit is None:
        return Claim(claimed, Outcome.HOLDS, words, NAME)
    walked = replay(task.model, [task.task.skill(name) for name in answer.skills])
    if not walked.complete:
        violation = walked.violations[0]
        reason = f"its plan fails at {violation.skill or 'its end'}: {violation.reason}"
        return _contradiction(claimed, f"{words}; {reason}")
    # Rounding hides the exact cost of a plan from the planner, and not from the model.
    if walked.cost < limit - tolerance(walked.cost) or least < limit - slack:
        return _contradiction(claimed, f"{words}: its plan costs {walked.cost:.10g}")
    return Claim(claimed, Outcome.HOLDS, words, NAME)


def _contradiction(claimed: str, words: str) -> Claim:
    return Claim(claimed, Outcome.FAILS, words, NAME, contradiction=True)


def _no_plan_below(stored: StoredClaims) -> float | None:
    """Return the cost below which no plan is claimed to be; None if none is claimed."""
    if stored.status is Status.INFEASIBLE:
        return math.inf
    return stored.cost if stored.status is Status.OPTIMAL else stored.lower_bound
