"""The networks of deep Q-learning: the one that acts, and the target network that trails it.

Mnih et al., "Human-level control through deep reinforcement learning" (2015).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from skillplan.solvers.learning.network_policy import NetworkPolicy
from skillplan_torch.batched_adam import BatchedAdam
from skillplan_torch.batched_network import BatchedNetwork, padded
from skillplan_torch.dqn.options import DqnOptions

# Values are small at first, so that what was not tried yet looks alike.
_LAST_GAIN = 0.3


class QNetworks:
    """Values of actions, of every run.

    Parameters
    ----------
    options
        Of the solver.
    features, actions
        How many.
    generators
        One for every run, from which its weights are drawn.
    """

    def __init__(
        self,
        options: DqnOptions,
        features: int,
        actions: int,
        generators: Sequence[np.random.Generator],
    ) -> None:
        self._options, self._actions = options, actions
        sizes = [features, *[options.width] * options.layers, padded(actions)]
        self._online = BatchedNetwork(sizes, generators, last_gain=_LAST_GAIN)
        self._target = self._online.copy()
        self._adam = BatchedAdam(self._online.parameters)

    def of_one(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return values, shape (runs, actions), of one observation a run, without gradients."""
        # Of a run that breaks they overflow; it is named where its network is seen to.
        with np.errstate(over="ignore", invalid="ignore"):
            outputs = torch.from_numpy(self._online.of_one(observations))
            values: NDArray[np.float32] = outputs[..., : self._actions].numpy()
        return values

    def values(self, observations: torch.Tensor) -> torch.Tensor:
        """Return values, shape (runs, n, actions), of observations, shape (runs, n, features)."""
        return self._online(observations)[..., : self._actions]

    def target_values(self, observations: torch.Tensor) -> torch.Tensor:
        """Return the same by the target network."""
        return self._target(observations)[..., : self._actions]

    def follow(self, loss: torch.Tensor, rate: float) -> None:
        """Follow the gradient of a loss that is a sum over runs; the target network trails."""
        self._adam.step(loss, rate)
        self._target.approach(self._online, self._options.target_rate)

    def is_sane(self) -> NDArray[np.bool_]:
        """Return for every run whether all figures of its network are finite, shape (runs,)."""
        return self._online.is_sane()

    def policy(self, run: int) -> NetworkPolicy:
        """Return a run's network as a policy.

        Raises
        ------
        ValueError
            If a figure is not finite.
        """
        return self._online.policy(run, self._actions)

    def take_over(self, run: int, network: NetworkPolicy) -> None:
        """Give a run a network's figures, as the one that acts and as the target."""
        self._online.take_over(run, network)
        self._target.take_over(run, network)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return copies of all figures, to be read by `read`."""
        return {
            **self._online.arrays("network"),
            **self._target.arrays("target"),
            **self._adam.arrays("adam"),
        }

    def read(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over what `arrays` returned.

        Raises
        ------
        ValueError
            If it is of another shape.
        """
        self._online.read("network", arrays)
        self._target.read("target", arrays)
        self._adam.read("adam", arrays)
