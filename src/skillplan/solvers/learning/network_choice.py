"""The greedy policy of a network on a skill model."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from skillplan.env.observation import MaskKind, Observation, check_name, list_allowed_actions
from skillplan.model.skill_model import SkillModel
from skillplan.solvers.learning.network_policy import NetworkPolicy
from skillplan.solvers.solution import Policy
from skillplan.task.skill import Skill
from skillplan.task.state import State

# A policy that reaches more states than this is followed no further.
_MOST_STATES = 20_000


class NetworkChoice:
    """The greedy policy of a network, state by state.

    Parameters
    ----------
    network
        As many inputs as are observed, as many actions as there are skills.
    model
        The skill model; it is queried where the mask needs it.
    observation
        Observation: ``paper``, ``markov`` or ``layout``.
    mask
        Mask of the choice: ``none``, ``applicable`` or ``feasible``.

    Raises
    ------
    OptionError
        If a name is unknown.
    """

    def __init__(
        self, network: NetworkPolicy, model: SkillModel, observation: str, mask: str
    ) -> None:
        self._network, self._model = network, model
        self._mask: MaskKind = check_name("mask", mask, MaskKind)
        self._observation = Observation.of(model.task, observation)

    def __call__(self, state: State) -> Skill:
        """Return the skill that is taken in a state."""
        masks = None if self._mask == "none" else self._allowed(state)[None]
        action = self._network.greedy(self._observation.encode(state)[None], masks)[0]
        return self._model.task.skills[int(action)]

    def _allowed(self, state: State) -> NDArray[np.bool_]:
        model, skills = self._model, self._model.task.skills
        mask = np.zeros(len(skills), dtype=np.bool_)

        def feasible(action: int) -> bool:
            # All transitions are queried at once, and kept by the model.
            return any(arrow.skill is skills[action] for arrow in model.transitions(state))

        mask[list(list_allowed_actions(model, state, self._mask, feasible))] = True
        return mask


def reachable_policy(model: SkillModel, choose: Callable[[State], Skill]) -> Policy:
    """Return a policy in every state that it may reach from the initial one.

    It is followed up to the step limit; a skill that is not feasible is left out.
    """
    choices: dict[State, Skill] = {}
    level = [model.initial]
    for _ in range(model.step_limit):
        following: dict[State, None] = {}
        for state in level:
            if state in choices or model.is_goal(state) or len(choices) >= _MOST_STATES:
                continue
            skill = choose(state)
            if skill.applicable(state) and model.verdict(state, skill).is_feasible:
                choices[state] = skill
                following.update(
                    (outcome.apply(state), None) for outcome in skill.outcomes_in(state)
                )
        level = list(following)
    return Policy(choices)
