"""Evaluation of a policy in all its reachable states."""

from __future__ import annotations

from collections.abc import Mapping

from skillplan.model.skill_model import SkillModel
from skillplan.solvers.stop import Stop
from skillplan.task.skill import Skill
from skillplan.task.state import State


def query_everywhere(
    model: SkillModel, policy: Mapping[State, Skill], most: int, stop: Stop
) -> bool:
    """Query a policy in its reachable states; return True if all were visited."""
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
