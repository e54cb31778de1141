"""Published results of Moller et al.: their ten runs on the inverter board."""

from __future__ import annotations

from dataclasses import dataclass

from skillplan.task.task import Task

SUCCESS_RATE = 0.40
"""Approximate final success rate of their training: section 5.1."""

# Sequences of Table III.
_OPTIMAL = (0, 1, 2, 3, 4, 5, 8, 9, 10, 11, 6, 7, 13, 14, 15)
_SWITCHED = (0, 1, 4, 5, 2, 3, 8, 9, 10, 11, 6, 7, 13, 14, 15)
_OPTIMUM_M = 1.867
_NAME = "inverter-board"
_PARTS = ("pcb", "switch_1", "switch_2", "clock", "transformer", "brace")
# The skill of every action number: Fig. 6.
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
        Action numbers; empty if the run produced no feasible sequence.
    cost
        Distance of the sequence [m], if any.
    deviation
        Printed excess over 1.867 m, as a fraction, if any.
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


def get_published_runs(task: Task, optimum: float | None) -> tuple[PublishedRun, ...]:
    """Return the published runs if a task is the paper's, otherwise none.

    The paper's task has its name, its actions in order, and an optimum that rounds to 1.867 m.

    Parameters
    ----------
    optimum
        The proved optimum of the task; None disables the comparison.
    """
    same_task = (
        task.name == _NAME
        and task.metric.unit == "m"
        and tuple(skill.name for skill in task.skills) == _ACTIONS
        and optimum is not None
        and round(optimum, 3) == _OPTIMUM_M
    )
    return TABLE_III if same_task else ()
