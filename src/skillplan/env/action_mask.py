"""Which actions a learner is limited to in a state."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from skillplan.env.env_options import MaskKind
from skillplan.model.skill_model import SkillModel
from skillplan.task.state import State


def allowed_actions(
    model: SkillModel, state: State, mask: MaskKind, feasible: Callable[[int], bool]
) -> Sequence[int]:
    """Return the actions that a mask allows in a state, in ascending order.

    Parameters
    ----------
    model
        The model; back ends are not queried by way of it.
    state
        The state.
    mask
        ``none`` allows all; ``applicable`` those whose preconditions hold; ``feasible`` those
        of them that are feasible, too. The latter allows none in a goal: nothing follows it,
        and back ends need not be queried.
    feasible
        Whether an applicable action is feasible; called for the mask ``feasible`` only.
    """
    if mask == "none":
        return range(len(model.task.skills))
    applicable = [model.task.action(skill) for skill in model.applicable(state)]
    if mask == "applicable":
        return applicable
    return [] if model.is_goal(state) else [action for action in applicable if feasible(action)]
