"""What Moller et al. printed of their ten runs on the inverter board, to stand beside ours."""

from __future__ import annotations

from dataclasses import dataclass

from skillplan.task.task import Task

SUCCESS_RATE = 0.40
"""What the success rate of their training converged to, about: section 5.1."""

# Table III: a sequence, what it measures [m] and its deviation, by the first differing places.
_OPTIMAL = (0, 1, 2, 3, 4, 5, 8, 9, 10, 11, 6, 7, 13, 14, 15)
_SWITCHED = (0, 1, 4, 5, 2, 3, 8, 9, 10, 11, 6, 7, 13, 14, 15)
_OPTIMUM_M = 1.867
_NAME = "inverter-board"
_PARTS = ("pcb", "switch_1", "switch_2", "clock", "transformer", "brace")
# Fig. 6, from pick(pcb) on: what every action does.
_ACTIONS = (
    *(f"{verb}({part})" for part in _PARTS for verb in ("pick", "place")),
    "load(gripper)",
    "load(screwdriver)",
    "fasten(screw_1)",
    "fasten(screw_2)",
)


@dataclass(frozen=True, slots=True)
class PublishedRun:
    """A row of Table III.

    Parameters
    ----------
    actions
        Action numbers; empty where the run produced no feasible sequence.
    cost
        Its distance [m]; None without a sequence.
    deviation
        Printed excess over 1.867 m, as a fraction; None without a sequence.
    """

    actions: tuple[int, ...] = ()
    cost: float | None = None
    deviation: float | None = None


TABLE_III = (
    PublishedRun(_SWITCHED, 1.880, 0.0070),
    PublishedRun(),
    PublishedRun(_OPTIMAL, 1.867, 0.0),
    PublishedRun(_SWITCHED, 1.880, 0.0070),
    PublishedRun((0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 13, 14, 15), 1.885, 0.0096),
    PublishedRun(_OPTIMAL, 1.867, 0.0),
    PublishedRun(_OPTIMAL, 1.867, 0.0),
    PublishedRun((0, 1, 6, 7, 2, 3, 8, 9, 4, 5, 10, 11, 13, 14, 15), 1.939, 0.0386),
    PublishedRun(),
    PublishedRun(_OPTIMAL, 1.867, 0.0),
)
"""Their ten runs, in the order of Table III."""


def published_runs(task: Task, optimum: float | None) -> tuple[PublishedRun, ...]:
    """Return their ten runs where a task is theirs, or else none.

    It is by its name, its actions in their order, and an optimum that rounds to 1.867 m.

    Parameters
    ----------
    task
        The task.
    optimum
        Its proved optimum; None where it is not known, and so nothing is compared.
    """
    theirs = (
        task.name == _NAME
        and task.metric.unit == "m"
        and tuple(skill.name for skill in task.skills) == _ACTIONS
        and optimum is not None
        and round(optimum, 3) == _OPTIMUM_M
    )
    return TABLE_III if theirs else ()
