"""Asking a policy wherever it may get to."""

from __future__ import annotations

from collections.abc import Mapping

from skillplan.model.skill_model import SkillModel
from skillplan.solvers.stop import Stop
from skillplan.task.skill import Skill
from skillplan.task.state import State


def asked_everywhere(
    model: SkillModel, policy: Mapping[State, Skill], most: int, stop: Stop
) -> bool:
    """Ask a policy in every state that it may get to; return whether that was everywhere.

    Parameters
    ----------
    model
        Says what may come of skills.
    policy
        Remembers what it was asked.
    most
        Once it remembers so many states no further one is asked.
    stop
        When to give up.
    """
    todo, seen = [model.initial], {model.initial}
    while todo:
        if stop() or len(policy) >= most:
            return False
        state = todo.pop()
        skill = None if model.is_goal(state) else policy.get(state)
        for outcome in () if skill is None else skill.outcomes_in(state):
            following = outcome.apply(state)
            if following not in seen:
                seen.add(following)
                todo.append(following)
    return True
