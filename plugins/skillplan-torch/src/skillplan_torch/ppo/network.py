"""Policy and value networks of all runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from skillplan.solvers.learning.episode_training import Arrays
from skillplan.solvers.learning.network_policy import NetworkPolicy
from skillplan_torch.networks import BLOCK, BatchedAdam, BatchedNetwork

# The initial policy is almost uniform, so that all actions are tried.
_POLICY_GAIN = 0.01
_ADAM_EPSILON = 1e-5

Parameters = list[torch.Tensor]


class ActorCritic:
    """A policy and a value network for every run.

    Parameters
    ----------
    hidden
        Units of every hidden layer.
    features, outputs
        Number of features, and of the policy's outputs; outputs beyond the actions are masked.
    max_gradient
        Length to which longer gradients of a network are cut, > 0.
    generators
        One for every run; draws its weights.
    """

    def __init__(
        self,
        hidden: Sequence[int],
        features: int,
        outputs: int,
        max_gradient: float,
        generators: Sequence[np.random.Generator],
    ) -> None:
        self._runs, self._max_gradient = len(generators), max_gradient
        sizes = [features, *hidden]
        self._policy = BatchedNetwork([*sizes, outputs], generators, last_gain=_POLICY_GAIN)
        # Only the first of the padded outputs is used.
        self._value = BatchedNetwork([*sizes, BLOCK], generators)
        self._parameters = [*self._policy.parameters, *self._value.parameters]
        self._adam = BatchedAdam(self._parameters, epsilon=_ADAM_EPSILON)

    def scores(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the policy's outputs, shape (runs, outputs), of one observation per run."""
        return self._policy.evaluate(observations)

    def log_probabilities(self, observations: torch.Tensor, masks: torch.Tensor) -> torch.Tensor:
        """Return log probabilities, shape (runs, n, outputs); very low for masked actions."""
        # Minus infinity times a probability of 0 would be NaN.
        scores = self._policy(observations).masked_fill(~masks, -1e9)
        return torch.log_softmax(scores, 2)

    def values(self, observations: torch.Tensor) -> torch.Tensor:
        """Return expected returns, shape (runs, n)."""
        return self._value(observations)[..., 0]

    def minimise(self, loss: torch.Tensor, rate: float) -> None:
        """Take a step down the gradient of a loss, cut for each run and network separately."""
        for parameter in self._parameters:
            parameter.grad = None
        loss.backward()  # type: ignore[no-untyped-call]
        zero = torch.zeros(self._runs)
        for network in (self._policy, self._value):
            gradients = [p.grad for p in network.parameters if p.grad is not None]
            # The rounding of a sum over the first axis depends on the number of runs.
            length = sum((g.square().flatten(1).sum(1) for g in gradients), zero).sqrt()
            factor = self._max_gradient / length.clamp(min=1e-12)
            for gradient in gradients:
                gradient.mul_(factor.clamp(max=1.0)[:, None, None])
        self._adam.step(rate)

    def is_finite(self) -> NDArray[np.bool_]:
        """Return whether both networks of a run are finite, shape (runs,)."""
        return self._policy.is_finite() & self._value.is_finite()

    def parameters(self) -> Parameters:
        """Return copies of all parameters of both networks."""
        return [parameter.detach().clone() for parameter in self._parameters]

    @torch.no_grad()
    def reset(self, run: int, parameters: Parameters) -> None:
        """Give the networks of a run earlier parameters again."""
        for now, then in zip(self._parameters, parameters, strict=True):
            now[run] = then[run]

    def policy(self, run: int, actions: int) -> NetworkPolicy:
        """Return a run's policy for its actions; raises ValueError if it is not finite."""
        return self._policy.policy(run, actions)

    def load(self, run: int, network: NetworkPolicy) -> None:
        """Copy a network to a run as its policy; the value network stays as it is."""
        self._policy.load(run, network)

    def arrays(self) -> Arrays:
        """Return copies of all arrays for `read`."""
        return {
            **self._policy.arrays("policy"),
            **self._value.arrays("value"),
            **self._adam.arrays("adam"),
        }

    def read(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore what `arrays` returned; raises ValueError if it has another shape."""
        self._policy.read("policy", arrays)
        self._value.read("value", arrays)
        self._adam.read("adam", arrays)
