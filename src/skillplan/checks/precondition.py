"""The first stage of every check: whether a skill is applicable, and else what is amiss."""

from __future__ import annotations

from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict, VerdictStatus

PRECONDITION = "precondition"

# Of the facts that would do, a message names so many.
_MOST_NAMED = 12


def inapplicable(task: Task, skill: Skill, state: State) -> Verdict:
    """Return the verdict on a skill that is not applicable in a state."""
    amiss = skill.why_not(state)
    names = [*amiss.requires, *(f"not {name}" for name in amiss.forbids)]
    one_of = "one of " if len(amiss.requires) > len(skill.condition(state).requires) else ""
    shown = names if len(names) <= _MOST_NAMED else [*names[:_MOST_NAMED], "..."]
    reason = f"needs {one_of}{', '.join(shown)}"
    wrong = [task.places[fact].name for fact in amiss.forbids if fact in task.places]
    if len(wrong) == len(names):
        reason = f"cannot be done at {', '.join(wrong)}"
    return Verdict(
        VerdictStatus.INFEASIBLE,
        reason,
        PRECONDITION,
        amiss.forbids,
        amiss.requires,
        {"amiss": names},
    )
