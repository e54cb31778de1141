"""Fast Downward, an optimal planner of others, as a referee: it sees nothing but PDDL.

Helmert, "The Fast Downward planning system" (2006); A* with the landmark-cut heuristic (Helmert and
Domshlak, 2009). It is a program of its own under its own licence, run beside this one.
"""

from __future__ import annotations

import importlib.util
import re
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from skillplan.errors import OptionError
from skillplan.exporters.pddl.exporter import DOMAIN, PROBLEM, ActionNames, PlanningTask
from skillplan.files.atomic_file import write_whole
from skillplan.files.regular_file import read_bytes
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
