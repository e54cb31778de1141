"""The claims of a stored result before a referee that shares no code with skillplan."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from functools import partial

from skillplan.errors import OptionError, name_hint
from skillplan.judge.fast_downward import NAME, driver
from skillplan.judge.planner_claims import planner_claims
from skillplan.pipeline.exchange.export import charted
from skillplan.pipeline.restoration import Override, load_result
from skillplan.pipeline.solving import make_model
from skillplan.records.certificate import Claim
from skillplan.solvers.stop import Stop

REFEREES = (NAME,)


def check_referee(name: str) -> None:
    """See that there is a referee of a name.

    Raises
    ------
    OptionError
        If there is none, or it is not installed.
    """
    if name not in REFEREES:
        raise OptionError(f"--with {name}: no such referee. {name_hint(name, REFEREES)}")
    driver()


def referee_claims(path: str, task_file: str | None, limit_s: float, stop: Stop) -> Iterator[Claim]:
    """Yield what Fast Downward says of a result, task by task.

    Parameters
    ----------
    path
        The result.
    task_file
        The task; None for the file that the result names.
    limit_s
        How long it may take for one task [s], > 0.
    stop
        Whether somebody has interrupted.

    Raises
    ------
    OptionError
        If the result cannot be used, or the planner is not installed.
    BackEndError
        If a back end fails.
    """
    loaded = load_result(path, Override(task_file))
    stored = loaded.stored
    tasks = list(loaded.plans()) if stored.cost is not None else []
    if not tasks and not stored.is_chain:
        tasks = [(loaded.problem.part(loaded.origin.part), stored)]
    for task, claims in tasks:
        if stop.interrupted:
            return
        clock = Stop(time_limit_s=limit_s)
        model = make_model(task, loaded.setup, overdue=partial(_is_over, stop, clock))
        with closing(model.feasibility):
            by_chart = charted(model, loaded.setup)
            for claim in planner_claims(claims, model, limit_s, charted=by_chart):
                prefix = f"{task.name}: " if stored.is_chain else ""
                yield replace(claim, claim=f"{prefix}{claim.claim}")


def _is_over(stop: Stop, clock: Stop) -> bool:
    return stop.interrupted or clock.overdue()
