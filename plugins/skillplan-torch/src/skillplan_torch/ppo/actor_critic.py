"""The networks of proximal policy optimisation: the policy, and what it expects to come."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from skillplan.solvers.learning.network_policy import NetworkPolicy
from skillplan_torch.batched_adam import BatchedAdam
from skillplan_torch.batched_network import BLOCK, BatchedNetwork
from skillplan_torch.ppo.options import PpoOptions

# The policy's first outputs are next to even, so that all actions are tried at first.
_POLICY_GAIN = 0.01
# Keeps small gradients of both networks from being blown up.
_ADAM_EPSILON = 1e-5

Figures = list[torch.Tensor]


class ActorCritic:
    """A policy and a value network for every run.

    Parameters
    ----------
    options
        Of the solver.
    features, outputs
        How many; outputs beyond the actions are never allowed.
    generators
        One for every run, from which its weights are drawn.
    """

    def __init__(
        self,
        options: PpoOptions,
        features: int,
        outputs: int,
        generators: Sequence[np.random.Generator],
    ) -> None:
        inner = [features, *[options.width] * options.layers]
        self._runs, self._max_gradient = len(generators), options.max_gradient
        self._policy = BatchedNetwork([*inner, outputs], generators, last_gain=_POLICY_GAIN)
        # Only the first of its outputs counts.
        self._value = BatchedNetwork([*inner, BLOCK], generators)
        self._parameters = [*self._policy.parameters, *self._value.parameters]
        self._adam = BatchedAdam(self._parameters, epsilon=_ADAM_EPSILON)

    def scores(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the policy's outputs, shape (runs, outputs), of one observation a run."""
        return self._policy.of_one(observations)

    def log_probabilities(self, observations: torch.Tensor, masks: torch.Tensor) -> torch.Tensor:
        """Return those of all actions, shape (runs, n, outputs); very low where not allowed."""
        # Not minus infinity: that times a probability of 0 would be no number.
        scores = self._policy(observations).masked_fill(~masks, -1e9)
        return torch.log_softmax(scores, 2)

    def values(self, observations: torch.Tensor) -> torch.Tensor:
        """Return expected returns, shape (runs, n)."""
        return self._value(observations)[..., 0]

    def follow(self, loss: torch.Tensor, rate: float) -> None:
        """Follow the gradient of a loss that is a sum over runs, cut for every run by itself."""
        for parameter in self._parameters:
            parameter.grad = None
        loss.backward()  # type: ignore[no-untyped-call]
        zero = torch.zeros(self._runs)
        for network in (self._policy, self._value):
            gradients = [p.grad for p in network.parameters if p.grad is not None]
            # Added one by one: a sum over the first axis is rounded by how many runs there are.
            length = sum((g.square().flatten(1).sum(1) for g in gradients), zero).sqrt()
            factor = self._max_gradient / length.clamp(min=1e-12)
            for gradient in gradients:
                gradient.mul_(factor.clamp(max=1.0)[:, None, None])
        self._adam.follow(rate)

    def is_sane(self) -> NDArray[np.bool_]:
        """Return for every run whether all figures are finite, shape (runs,)."""
        return self._policy.is_sane() & self._value.is_sane()

    def figures(self) -> Figures:
        """Return copies of all figures of both networks."""
        return [parameter.detach().clone() for parameter in self._parameters]

    @torch.no_grad()
    def put_back(self, run: int, figures: Figures) -> None:
        """Give the networks of a run the figures that they had."""
        for now, then in zip(self._parameters, figures, strict=True):
            now[run] = then[run]

    def policy(self, run: int, actions: int) -> NetworkPolicy:
        """Return a run's policy for so many actions.

        Raises
        ------
        ValueError
            If a figure is not finite.
        """
        return self._policy.policy(run, actions)

    def take_over(self, run: int, network: NetworkPolicy) -> None:
        """Give a run a network's figures as its policy; what it expects to come stays as drawn."""
        self._policy.take_over(run, network)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return copies of all figures, to be read by `read`."""
        return {
            **self._policy.arrays("policy"),
            **self._value.arrays("value"),
            **self._adam.arrays("adam"),
        }

    def read(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over what `arrays` returned.

        Raises
        ------
        ValueError
            If it is of another shape.
        """
        self._policy.read("policy", arrays)
        self._value.read("value", arrays)
        self._adam.read("adam", arrays)
