"""Q-networks of all runs, each with a target network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from skillplan.solvers.learning.episode_training import Arrays
from skillplan.solvers.learning.network_policy import NetworkPolicy
from skillplan_torch.networks import BatchedAdam, BatchedNetwork, padded

# Initial values are small, so that untried actions look alike.
_LAST_GAIN = 0.3


class QNetworks:
    """Values of actions, of every run.

    Parameters
    ----------
    hidden
        Units of every hidden layer.
    features, actions
        Numbers of features and actions.
    target_rate
        Share by which an update moves the target network, in (0, 1].
    generators
        One for every run; draws its weights.
    """

    def __init__(
        self,
        hidden: Sequence[int],
        features: int,
        actions: int,
        target_rate: float,
        generators: Sequence[np.random.Generator],
    ) -> None:
        self._actions, self._target_rate = actions, target_rate
        sizes = [features, *hidden, padded(actions)]
        self._online = BatchedNetwork(sizes, generators, last_gain=_LAST_GAIN)
        self._target = self._online.copy()
        self._adam = BatchedAdam(self._online.parameters)

    def evaluate(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return values, shape (runs, actions), of one observation per run, without gradients."""
        # Values of a diverged network overflow; the training reports it.
        with np.errstate(over="ignore", invalid="ignore"):
            values: NDArray[np.float32] = self._online.evaluate(observations)[..., : self._actions]
        return values

    def values(self, observations: torch.Tensor) -> torch.Tensor:
        """Return values, shape (runs, n, actions), of observations, shape (runs, n, features)."""
        return self._online(observations)[..., : self._actions]

    def target_values(self, observations: torch.Tensor) -> torch.Tensor:
        """Return the target network's values, of the same shape."""
        return self._target(observations)[..., : self._actions]

    def minimise(self, loss: torch.Tensor, rate: float) -> None:
        """Take a step down the gradient of a loss, and move the target network."""
        self._adam.minimise(loss, rate)
        self._target.approach(self._online, self._target_rate)

    def is_finite(self) -> NDArray[np.bool_]:
        """Return whether the network of a run is finite, shape (runs,)."""
        return self._online.is_finite()

    def policy(self, run: int) -> NetworkPolicy:
        """Return a run's network as a policy; raises ValueError if it is not finite."""
        return self._online.policy(run, self._actions)

    def load(self, run: int, network: NetworkPolicy) -> None:
        """Copy a network to a run, as its online and its target network."""
        self._online.load(run, network)
        self._target.load(run, network)

    def arrays(self) -> Arrays:
        """Return copies of all arrays for `read`."""
        return {
            **self._online.arrays("network"),
            **self._target.arrays("target"),
            **self._adam.arrays("adam"),
        }

    def read(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore what `arrays` returned; raises ValueError if it has another shape."""
        self._online.read("network", arrays)
        self._target.read("target", arrays)
        self._adam.read("adam", arrays)
