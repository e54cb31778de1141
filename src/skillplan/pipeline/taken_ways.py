"""The skills of a plan by the ways that they take, for who executes it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from skillplan.checks.feasibility import Feasibility
from skillplan.errors import OptionError, name_hint
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.task import Task


def by_ways(
    task: Task,
    skills: Sequence[Skill],
    back_ends: Sequence[BackEnd],
    named: Sequence[str | None] = (),
    stopped: Callable[[], bool] = lambda: False,
) -> list[Skill]:
    """Return the skills of a plan, those with several ways by the one that is taken.

    Parameters
    ----------
    task
        Whose skills.
    skills
        The plan, each applicable when its turn comes.
    back_ends
        Asked for the way of each skill that has several and for which none is named.
    named
        The ways in words, as far as they are known, by step; None where a skill has but one.
    stopped
        Whether to stop asking; then first ways are taken.

    Raises
    ------
    OptionError
        If a way is named that a skill does not have.
    BackEndError
        If a back end fails.
    """
    if not any(skill.ways for skill in skills):
        return list(skills)
    feasibility = Feasibility(task, back_ends)
    state, found = task.initial, []
    for index, skill in enumerate(skills):
        label = named[index] if index < len(named) else None
        if not skill.ways:
            found.append(skill)
        elif label is not None:
            labels = [way.label for way in skill.ways]
            if label not in labels:
                hint = name_hint(label, labels)
                raise OptionError(f"Step {index + 1}: {skill.name} has no way {label!r}. {hint}")
            found.append(feasibility.variants.by_label(skill, label))
        elif stopped():
            found.append(skill.by(skill.ways[0]))
        else:
            found.append(feasibility.taken(skill, state))
        state = skill.prediction_in(state).apply(state)
    return found
