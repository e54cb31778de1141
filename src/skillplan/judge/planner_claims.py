"""What a planner of others says about what is claimed of all plans of a task."""

from __future__ import annotations

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
from skillplan.records.result import Status
from skillplan.records.stored.result_file import StoredClaims


def planner_claims(
    stored: StoredClaims, model: SkillModel, limit_s: float, *, charted: bool
) -> Iterator[Claim]:
    """Yield what is claimed of all plans, held against what Fast Downward proves by PDDL.

    Where PDDL leaves out something that back ends judge, the planner may find more plans than
    there are: its optimum is then a lower bound only.

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
    refusal = PddlExporter().refuses(handover)
    if refusal:
        yield Claim(claimed, Outcome.NOT_CHECKED, f"PDDL cannot say it: {refusal}", NAME)
        return
    made = PlanningTask(handover)
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
    skills = max(len(stored.skills), len(answer.skills))
    rounding = made.scale.rounding(skills)
    words = f"it proves {task.metric.text(least)}"
    words += f", rounded by at most {rounding:.2g}" if rounding else ""
    exact = not made.order.beyond and len(answer.skills) <= task.step_limit
    if stored.cost is not None:
        words += f", claimed {stored.cost:.10g}"
        if stored.cost < least - rounding:
            return Claim(claimed, Outcome.FAILS, f"{words}: no plan costs so little", NAME)
        if stored.status is Status.OPTIMAL and stored.cost <= least + rounding:
            return Claim(claimed, Outcome.HOLDS, words, NAME)
    if exact:
        exact = _goes(made.model, answer.skills)
    bound = stored.lower_bound
    if stored.status is Status.SOLVED and (bound is None or bound <= least + rounding):
        return Claim(claimed, Outcome.HOLDS, words, NAME)
    if not exact:
        words += "; its plan does not hold, as back ends judge by more than an order"
        return Claim(claimed, Outcome.NOT_CHECKED, words, NAME)
    return Claim(claimed, Outcome.FAILS, f"{words}: there is a better plan", NAME)


def _goes(model: SkillModel, skills: tuple[str, ...]) -> bool:
    """Whether the planner's plan reaches the goal on the model, too."""
    try:
        return replay(model, [model.task.skill(name) for name in skills]).complete
    except OptionError:
        return False
