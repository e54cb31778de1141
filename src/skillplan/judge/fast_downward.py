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
from skillplan.workers.processes import run_program

NAME = "fast-downward"
_PACKAGE = "up_fast_downward"
_PLAN = "sas_plan"
_MOST_PLAN_BYTES = 16 * 1024 * 1024
_COST = re.compile(r"^; cost = (\d+) ", re.MULTILINE)
# Its exit codes: https://www.fast-downward.org/ExitCodes.
_SOLVED, _UNSOLVABLE, _NO_TIME, _NO_MEMORY = {0}, {10, 11}, {21, 23, 24}, {20, 22}
# It ends at its time limit, unless it hangs [s].
_GRACE_S = 5.0
_MOST_S = 86_400.0


@dataclass(frozen=True, slots=True)
class PlannerAnswer:
    """The answer of a planner about a task.

    Parameters
    ----------
    cost
        The least cost of any plan, in the units of the problem; None without a plan or an answer.
    skills
        Names of the skills of such a plan.
    unsolvable
        True if the planner has proved that no plan exists.
    silence
        Reason for a missing answer; empty with an answer.
    """

    cost: int | None = None
    skills: tuple[str, ...] = ()
    unsolvable: bool = False
    silence: str = ""


def find_driver() -> Path:
    """Return the path of the program.

    Raises
    ------
    OptionError
        If it is not installed.
    """
    spec = importlib.util.find_spec(_PACKAGE)
    for folder in () if spec is None else spec.submodule_search_locations or ():
        path = Path(folder) / "downward" / "fast-downward.py"
        if path.is_file():
            return path
    raise OptionError(
        f"{NAME} is not installed. Install it with: pip install 'skillplan[planner]' (60 MB)."
    )


def run_planner(task: PlanningTask, limit_s: float) -> PlannerAnswer:
    """Run Fast Downward on a task.

    Parameters
    ----------
    task
        The task in PDDL.
    limit_s
        Time limit [s], > 0.

    Raises
    ------
    OptionError
        If it is not installed.
    """
    limit_s = min(limit_s, _MOST_S)
    words = [
        sys.executable,
        str(find_driver()),
        "--overall-time-limit",
        f"{max(1, round(limit_s))}s",
    ]
    words += ["--plan-file", _PLAN, DOMAIN, PROBLEM, "--search", "astar(lmcut())"]
    with tempfile.TemporaryDirectory(prefix="skillplan-pddl-") as folder:
        write_whole(Path(folder) / DOMAIN, task.domain())
        write_whole(Path(folder) / PROBLEM, task.problem())
        code = run_program(words, folder, limit_s + _GRACE_S)
        if code in _SOLVED:
            text = read_bytes(Path(folder) / _PLAN, _MOST_PLAN_BYTES, within=folder).decode()
            return _read_answer(task, text)
    if code in _UNSOLVABLE:
        return PlannerAnswer(unsolvable=True)
    if code is None or code in _NO_TIME:
        return PlannerAnswer(silence=f"it has not ended within {limit_s:.3g} s")
    if code in _NO_MEMORY:
        return PlannerAnswer(silence="it has run out of memory")
    return PlannerAnswer(silence=f"it has failed with exit code {code}")


def _read_answer(task: PlanningTask, text: str) -> PlannerAnswer:
    cost = _COST.search(text)
    skill_of = ActionNames(task.task).skill_of
    names = [skill_of(line[1:].split()[0]) for line in text.splitlines() if line[:1] == "("]
    if cost is None or None in names:
        return PlannerAnswer(silence="what it wrote is no plan of this task")
    return PlannerAnswer(int(cost[1]), tuple(str(name) for name in names))


def check_with_planner(
    stored: StoredClaims, model: SkillModel, limit_s: float, *, charted: bool
) -> Iterator[Claim]:
    """Yield the claims about all plans, compared with the optimum that Fast Downward proves.

    The planner runs only if PDDL expresses the task as the model does, so another proof is a
    contradiction. It adds up rounded costs, so its plan is replayed on the model: an optimum
    within the rounding fails if that plan costs less.

    Parameters
    ----------
    stored
        The claims.
    model
        A fresh model of the task.
    limit_s
        Time limit for verdicts and planner together [s], > 0.
    charted
        True if the chart of the task file is the only check.

    Raises
    ------
    OptionError
        If the planner is not installed.
    """
    find_driver()
    claimed = _name_claim(stored)
    handover = Handover(model, None, charted)
    try:
        task, answer = plan_with_planner(handover, limit_s)
        if task is not None and not answer.silence:
            yield _compare(claimed, stored, task, answer)
            return
        reason = answer.silence
    except SearchStopped:
        reason = "back ends have not given all verdicts within the limit"
    yield Claim(claimed, Outcome.NOT_CHECKED, reason, NAME)


def plan_with_planner(
    handover: Handover, limit_s: float
) -> tuple[PlanningTask | None, PlannerAnswer]:
    """Return a task in PDDL and the planner's answer within the step limit of the task.

    Parameters
    ----------
    handover
        The task.
    limit_s
        Time limit for verdicts and planner together [s], > 0.

    Returns
    -------
    tuple of PlanningTask or None, and PlannerAnswer
        Without PDDL None and the reason.

    Raises
    ------
    OptionError
        If the planner is not installed.
    SearchStopped
        If the verdicts take too long.
    """
    deadline_s = time.monotonic() + limit_s
    task, answer = _export_and_run(handover, deadline_s, count_steps=False)
    if len(answer.skills) > handover.model.step_limit:
        # The plan is too long: search again within the step limit.
        task, answer = _export_and_run(handover, deadline_s, count_steps=True)
    return task, answer


def _export_and_run(
    handover: Handover, deadline_s: float, *, count_steps: bool
) -> tuple[PlanningTask | None, PlannerAnswer]:
    """Return the task in PDDL and the planner's answer; without PDDL None and the reason.

    Parameters
    ----------
    handover
        The task.
    deadline_s
        End of the planner by the monotonic clock [s].
    count_steps
        True if the step limit is part of the task.
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
    return task, run_planner(task, max(1.0, deadline_s - time.monotonic()))


def _name_claim(stored: StoredClaims) -> str:
    if stored.status in (Status.OPTIMAL, Status.INFEASIBLE):
        return str(stored.status)
    return "lower bound" if stored.lower_bound is not None else "cost"


def _compare(
    claimed: str, stored: StoredClaims, task: PlanningTask, answer: PlannerAnswer
) -> Claim:
    """Compare the optimum of the planner with the claims."""
    metric = task.task.metric
    if answer.unsolvable or answer.cost is None:
        words = "it proves that there is no plan"
        if stored.cost is None:
            return Claim(claimed, Outcome.HOLDS, words, NAME)
        return _make_contradiction(claimed, f"{words}, claimed is one of {stored.cost:.10g}")
    least_cost = answer.cost / task.scale.per_unit
    rounding = task.scale.rounding(max(len(stored.skills), len(answer.skills)))
    words = f"it proves {metric.text(least_cost)}"
    words += f", rounded by at most {rounding:.2g}" if rounding else ""
    words += "" if stored.cost is None else f", claimed {stored.cost:.10g}"
    slack = rounding + tolerance(least_cost)
    if stored.cost is not None and stored.cost < least_cost - slack:
        return _make_contradiction(claimed, f"{words}: no plan costs so little")
    limit = _find_claimed_bound(stored)
    if limit is None:
        return Claim(claimed, Outcome.HOLDS, words, NAME)
    walked = replay(task.model, [task.task.skill(name) for name in answer.skills])
    if not walked.complete:
        violation = walked.violations[0]
        reason = f"its plan fails at {violation.skill or 'its end'}: {violation.reason}"
        return _make_contradiction(claimed, f"{words}; {reason}")
    # The model has the exact cost of the plan, which rounding hides from the planner.
    if walked.cost < limit - tolerance(walked.cost) or least_cost < limit - slack:
        return _make_contradiction(claimed, f"{words}: its plan costs {walked.cost:.10g}")
    return Claim(claimed, Outcome.HOLDS, words, NAME)


def _make_contradiction(claimed: str, words: str) -> Claim:
    return Claim(claimed, Outcome.FAILS, words, NAME, contradiction=True)


def _find_claimed_bound(stored: StoredClaims) -> float | None:
    """Return the claimed lower bound on the cost of all plans; None without one."""
    if stored.status is Status.INFEASIBLE:
        return math.inf
    return stored.cost if stored.status is Status.OPTIMAL else stored.lower_bound
