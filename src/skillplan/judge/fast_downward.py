"""Claims about all plans of a task, compared with the optimum that Fast Downward proves from PDDL.

Helmert, "The Fast Downward planning system" (2006); A* with the landmark-cut heuristic (Helmert and
Domshlak, 2009). It is a program under its own licence, and shares no code with skillplan.
"""

from __future__ import annotations

import importlib.util
import math
import re
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from skillplan.errors import OptionError, SearchStopped
from skillplan.exporters.exporter import Handover
from skillplan.exporters.pddl.exporter import (
    DOMAIN,
    PROBLEM,
    ActionNames,
    PddlExporter,
    PlanningTask,
)
from skillplan.files.atomic_file import write_whole
from skillplan.files.regular_file import read_bytes
from skillplan.model.replay import replay
from skillplan.model.skill_model import SkillModel
from skillplan.records.certificate import Claim, Outcome
from skillplan.records.result import Status, tolerance
from skillplan.records.stored.result_file import StoredClaims
from skillplan.workers.processes import exit_code_of

NAME = "fast-downward"
_PACKAGE = "up_fast_downward"
_PLAN = "sas_plan"
_MOST_PLAN_BYTES = 16 * 1024 * 1024
_COST = re.compile(r"^; cost = (\d+) ", re.MULTILINE)
# What its exit codes say: https://www.fast-downward.org/ExitCodes.
_SOLVED, _UNSOLVABLE, _NO_TIME, _NO_MEMORY = {0}, {10, 11}, {21, 23, 24}, {20, 22}
# It notices itself that its time is over, unless it hangs.
_GRACE_S = 5.0
_MOST_S = 86_400.0


@dataclass(frozen=True, slots=True)
class PlannerAnswer:
    """What a planner says of a task.

    Parameters
    ----------
    cost
        The least cost of any plan, in the units of the problem; None where there is no plan, or
        the planner does not say.
    skills
        Names of the skills of such a plan.
    unsolvable
        Whether it has proved that there is no plan.
    silence
        Why it does not say anything, in words.
    """

    cost: int | None = None
    skills: tuple[str, ...] = ()
    unsolvable: bool = False
    silence: str = ""


def driver() -> Path:
    """Return the program.

    Raises
    ------
    OptionError
        If it is not installed.
    """
    found = importlib.util.find_spec(_PACKAGE)
    for folder in () if found is None else found.submodule_search_locations or ():
        path = Path(folder) / "downward" / "fast-downward.py"
        if path.is_file():
            return path
    raise OptionError(
        f"{NAME} is not installed. Install it with: pip install 'skillplan[planner]' (60 MB)."
    )


def asked(made: PlanningTask, limit_s: float) -> PlannerAnswer:
    """Return what Fast Downward proves of a task.

    Parameters
    ----------
    made
        The task as PDDL has it.
    limit_s
        How long it may take [s], > 0.

    Raises
    ------
    OptionError
        If it is not installed.
    """
    limit_s = min(limit_s, _MOST_S)
    words = [sys.executable, str(driver()), "--overall-time-limit", f"{max(1, round(limit_s))}s"]
    words += ["--plan-file", _PLAN, DOMAIN, PROBLEM, "--search", "astar(lmcut())"]
    with tempfile.TemporaryDirectory(prefix="skillplan-pddl-") as folder:
        write_whole(Path(folder) / DOMAIN, made.domain())
        write_whole(Path(folder) / PROBLEM, made.problem())
        code = exit_code_of(words, folder, limit_s + _GRACE_S)
        if code in _SOLVED:
            text = read_bytes(Path(folder) / _PLAN, _MOST_PLAN_BYTES, within=folder).decode()
            return _solved(made, text)
    if code in _UNSOLVABLE:
        return PlannerAnswer(unsolvable=True)
    if code is None or code in _NO_TIME:
        return PlannerAnswer(silence=f"it has not ended within {limit_s:.3g} s")
    if code in _NO_MEMORY:
        return PlannerAnswer(silence="it has run out of memory")
    return PlannerAnswer(silence=f"it has failed with exit code {code}")


def _solved(made: PlanningTask, text: str) -> PlannerAnswer:
    cost = _COST.search(text)
    skill_of = ActionNames(made.task).skill_of
    names = [skill_of(line[1:].split()[0]) for line in text.splitlines() if line[:1] == "("]
    if cost is None or None in names:
        return PlannerAnswer(silence="what it wrote is no plan of this task")
    return PlannerAnswer(int(cost[1]), tuple(str(name) for name in names))


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
    driver()
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
    return task, asked(task, max(1.0, deadline_s - time.monotonic()))


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
