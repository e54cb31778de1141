"""Roll-outs of a network on a skill model: the states it meets, and what comes of its choices."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan.env.action_mask import allowed_actions
from skillplan.env.env_options import MaskKind
from skillplan.env.observation import Observation
from skillplan.model.skill_model import SkillModel, Transition
from skillplan.task.state import State

Mask = NDArray[np.bool_]
Features = NDArray[np.float32]


@dataclass(frozen=True)
class Sight:
    """A state as a network sees it.

    Parameters
    ----------
    features
        Shape (inputs,).
    mask
        What may be chosen, shape (actions,).
    arrows
        The transitions of the skills that are feasible, by action.
    """

    features: Features
    mask: Mask
    arrows: dict[int, Transition]


class Views:
    """What a network sees in the states of a model, each worked out once."""

    def __init__(self, model: SkillModel, observation: str, mask: MaskKind) -> None:
        self.model = model
        self._mask = mask
        self._observation = Observation.of(model.task, observation)
        self._seen: dict[State, Sight] = {}

    @property
    def width(self) -> int:
        """How many features there are."""
        return self._observation.width

    def __getitem__(self, state: State) -> Sight:
        found = self._seen.get(state)
        if found is None:
            task = self.model.task
            arrows = {task.action(one.skill): one for one in self.model.transitions(state)}
            mask = np.ones(len(task.skills), dtype=np.bool_)
            if self._mask != "none":
                mask[:] = False
                allowed = allowed_actions(self.model, state, self._mask, arrows.__contains__)
                mask[list(allowed)] = True
            found = Sight(self._observation.encode(state), mask, arrows)
            self._seen[state] = found
        return found


@dataclass
class Episode:
    """A roll-out.

    Parameters
    ----------
    states, actions, costs
        What was met, done, and paid for it.
    complete
        Whether the goal was reached.
    """

    states: list[State]
    actions: list[int]
    costs: list[float]
    complete: bool = False


def roll_out(
    views: Views,
    choose: Callable[[State, Sight], int],
    chance: np.random.Generator,
    limit: int,
) -> Episode:
    """Follow choices from the initial state to the goal, an infeasible skill or the limit."""
    episode = Episode([], [], [])
    state = views.model.initial
    for _ in range(limit):
        if views.model.is_goal(state):
            episode.complete = True
            break
        sight = views[state]
        if not sight.arrows:
            break
        action = choose(state, sight)
        arrow = sight.arrows.get(action)
        episode.states.append(state)
        episode.actions.append(action)
        if arrow is None:
            episode.costs.append(0.0)
            break
        episode.costs.append(arrow.cost)
        shares = np.cumsum([share for share, _ in arrow.outcomes])
        drawn = int(np.searchsorted(shares, chance.random(), side="right"))
        state = arrow.outcomes[min(drawn, len(shares) - 1)][1]
    else:
        episode.complete = views.model.is_goal(state)
    return episode
