"""The steps of runs since their last update, and how much better than expected they went on.

Advantages after Schulman et al., "High-dimensional continuous control using generalized advantage
estimation" (2016).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan.env.transition_table import GOES_ON
from skillplan.solvers.learning.episode_training import copy_arrays, restore_arrays


class RolloutBuffer:
    """A fixed number of steps of every run, in order; all arrays begin with (runs, steps).

    Parameters
    ----------
    runs, steps, features, actions
        How many.

    Attributes
    ----------
    filled
        How many steps have been added.
    observations, masks
        What was observed and allowed, shapes (runs, steps, features) and (runs, steps, actions).
    actions
        What was done.
    drawn
        Whether it was drawn from the policy: only then is it learned from.
    ends
        As in the infos of `SkillVectorEnv`.
    step_rewards
        The environment's for the cost, see `RewardScaling`.
    novelties
        How new it was: 1 where it was never done before.
    """

    def __init__(self, runs: int, steps: int, features: int, actions: int) -> None:
        self.filled = 0
        self.observations = np.zeros((runs, steps, features), dtype=np.float32)
        self.masks = np.ones((runs, steps, actions), dtype=np.bool_)
        self.actions = np.zeros((runs, steps), dtype=np.int64)
        self.drawn = np.zeros((runs, steps), dtype=np.bool_)
        self.ends = np.zeros((runs, steps), dtype=np.int8)
        self.step_rewards = np.zeros((runs, steps), dtype=np.float64)
        self.novelties = np.zeros((runs, steps), dtype=np.float64)

    @property
    def is_full(self) -> bool:
        """Whether there is room for no further step."""
        return self.filled == self.actions.shape[1]

    def add(
        self,
        before: tuple[NDArray[np.float32], NDArray[np.bool_]],
        actions: NDArray[np.int64],
        drawn: NDArray[np.bool_],
        ends: NDArray[np.int8],
        step_rewards: NDArray[np.float64],
        novelties: NDArray[np.float64],
    ) -> None:
        """Add a step of every run.

        Parameters
        ----------
        before
            What was observed and allowed.
        actions, drawn, ends, step_rewards, novelties
            As the attributes, shape (runs,).
        """
        slot = self.filled
        self.observations[:, slot], self.masks[:, slot] = before
        self.actions[:, slot], self.drawn[:, slot] = actions, drawn
        self.ends[:, slot], self.step_rewards[:, slot] = ends, step_rewards
        self.novelties[:, slot] = novelties
        self.filled += 1

    def advantages(
        self,
        rewards: NDArray[np.float64],
        values: NDArray[np.float32],
        ahead: NDArray[np.float32],
        gamma: float,
        gae_lambda: float,
    ) -> NDArray[np.float32]:
        """Return how much better than expected every step went on, shape (runs, steps).

        Parameters
        ----------
        rewards
            Of every step by itself, shape (runs, steps).
        values
            What was expected where it was done, shape (runs, steps).
        ahead
            What is expected after the last step, shape (runs,).
        gamma
            Discount factor.
        gae_lambda
            How far to look: 0 one step, 1 to the end of the episode.
        """
        goes_on = np.where(self.ends == GOES_ON, gamma, 0.0)
        found, later = np.zeros(rewards.shape), np.zeros(len(rewards))
        for slot in range(rewards.shape[1] - 1, -1, -1):
            error = rewards[:, slot] + goes_on[:, slot] * ahead - values[:, slot]
            later = error + goes_on[:, slot] * gae_lambda * later
            found[:, slot], ahead = later, values[:, slot]
        return found.astype(np.float32)

    def normalised(self, advantages: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return them with mean 0 and deviation 1 among a run's steps drawn; 0 at all others."""
        found = np.zeros_like(advantages)
        for run, those in enumerate(self.drawn):
            some = advantages[run, those]
            if some.size:
                found[run, those] = (some - some.mean()) / (some.std() + 1e-8)
        return found

    def arrays(self, name: str) -> dict[str, NDArray[Any]]:
        """Return copies of all steps, to be read by `read`; `filled` is not among them."""
        return copy_arrays(name, self._own())

    def read(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over what `arrays` returned.

        Raises
        ------
        ValueError
            If it is of another shape.
        """
        restore_arrays(name, self._own(), arrays)

    def _own(self) -> dict[str, NDArray[Any]]:
        """Return the arrays by their names in a snapshot."""
        return {
            "observations": self.observations,
            "masks": self.masks,
            "actions": self.actions,
            "drawn": self.drawn,
            "ends": self.ends,
            "paid": self.step_rewards,
            "novelties": self.novelties,
        }
