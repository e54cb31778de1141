"""Tasks that are learned together, such as boards of one family: what they must have in common."""

from __future__ import annotations

from collections.abc import Sequence

from skillplan.env.observation import Observation
from skillplan.errors import OptionError
from skillplan.task.task import Task


def family_observations(tasks: Sequence[Task], kind: str) -> list[Observation]:
    """Return the observation of every task.

    Parameters
    ----------
    tasks
        At least one.
    kind
        See `Observation`.

    Raises
    ------
    OptionError
        If there is no such kind, or if facts, skills or features are not of the same names in
        the same order.
    """
    observations = [Observation.of(task, kind) for task in tasks]
    for task, observed in zip(tasks[1:], observations[1:], strict=True):
        pairs = {
            "facts": (tasks[0].facts.names, task.facts.names),
            "skills": tuple([skill.name for skill in one.skills] for one in (tasks[0], task)),
            "observations": (observations[0].features, observed.features),
        }
        for what, (names, other_names) in pairs.items():
            if list(names) != list(other_names):
                raise OptionError(
                    f"Tasks {tasks[0].name!r} and {task.name!r} cannot be learned together: their "
                    f"{what} differ."
                )
    return observations
