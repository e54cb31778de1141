"""Networks, rollout buffer and clipped update of proximal policy optimisation.

Schulman et al., "Proximal policy optimization algorithms" (2017), with advantages after
"High-dimensional continuous control using generalized advantage estimation" (2016). Masks hold in
probabilities and entropy: Huang and Ontanon, "A closer look at invalid action masking in policy
gradient algorithms" (2022).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from skillplan.env.transition_table import GOES_ON
from skillplan.solvers.learning.episode_training import (
    Arrays,
    CheapestSteps,
    copy_arrays,
    restore_arrays,
)
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


CURVES = ("policy_loss", "value_loss", "entropy", "clipped", "divergence")


class RolloutBuffer:
    """A fixed number of steps of every run, in order; all arrays begin with (runs, steps).

    Parameters
    ----------
    runs, steps, features, actions
        Numbers of runs, steps, features and actions.

    Attributes
    ----------
    filled
        Number of steps added.
    observations, masks
        Observation and mask before each step, shapes (runs, steps, features) and
        (runs, steps, actions).
    actions
        Actions taken.
    drawn
        True for actions drawn from the policy; other steps are not learned from.
    ends
        End codes of the environment.
    step_rewards
        Environment rewards for costs, see `RewardScaling`.
    novelties
        Addition: 1 / sqrt(visits) of the action there.
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
        """True if all steps have been added."""
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
            Observations and masks.
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
        """Return generalised advantages, shape (runs, steps).

        Parameters
        ----------
        rewards, values
            Reward and expected return of every step, shape (runs, steps).
        ahead
            Expected return after the last step, shape (runs,).
        gamma
            Discount factor.
        gae_lambda
            Weight of later steps: 0 for one step, 1 for the whole episode.
        """
        discounts = np.where(self.ends == GOES_ON, gamma, 0.0)
        advantages, later = np.zeros(rewards.shape), np.zeros(len(rewards))
        for slot in range(rewards.shape[1] - 1, -1, -1):
            error = rewards[:, slot] + discounts[:, slot] * ahead - values[:, slot]
            later = error + discounts[:, slot] * gae_lambda * later
            advantages[:, slot], ahead = later, values[:, slot]
        return advantages.astype(np.float32)

    def normalise(self, advantages: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return advantages with mean 0 and deviation 1 over a run's drawn steps; 0 elsewhere."""
        normalised = np.zeros_like(advantages)
        for run, drawn in enumerate(self.drawn):
            chosen = advantages[run, drawn]
            if chosen.size:
                normalised[run, drawn] = (chosen - chosen.mean()) / (chosen.std() + 1e-8)
        return normalised

    def arrays(self, name: str) -> Arrays:
        """Return copies of all arrays for `read`; `filled` is not among them."""
        return copy_arrays(name, self._own_arrays())

    def read(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore what `arrays` returned; raises ValueError if it has another shape."""
        restore_arrays(name, self._own_arrays(), arrays)

    def _own_arrays(self) -> Arrays:
        return {
            "observations": self.observations,
            "masks": self.masks,
            "actions": self.actions,
            "drawn": self.drawn,
            "ends": self.ends,
            "paid": self.step_rewards,
            "novelties": self.novelties,
        }


@dataclass(frozen=True)
class Rates:
    """Values that change over a training.

    Parameters
    ----------
    learning
        Learning rate of Adam.
    entropy
        Weight of the entropy.
    """

    learning: float
    entropy: float


@dataclass(frozen=True)
class _Steps:
    """Steps of a full buffer with the networks' outputs before the update.

    Parameters
    ----------
    observations, masks, actions
        Shapes (runs, steps, features), (runs, steps, outputs) and (runs, steps, 1).
    drawn
        1 for actions drawn from the policy, else 0, shape (runs, steps).
    old_logs, old_taken
        Log probabilities of all actions, and of those taken.
    advantages, returns
        Normalised advantages, and advantages plus values, shape (runs, steps).
    """

    observations: torch.Tensor
    masks: torch.Tensor
    actions: torch.Tensor
    drawn: torch.Tensor
    old_logs: torch.Tensor
    old_taken: torch.Tensor
    advantages: torch.Tensor
    returns: torch.Tensor


class ClippedUpdate:
    """Updates the networks from a full buffer.

    Parameters
    ----------
    networks
        Policy and value networks.
    epochs, batch
        Passes over the steps, and steps of a gradient step.
    clip
        Greatest change of a probability's ratio that still gains.
    gamma, gae_lambda
        As for `RolloutBuffer.advantages`.
    imitation
        Addition: weight of the cross entropy to the cheapest episodes.
    """

    def __init__(
        self,
        networks: ActorCritic,
        *,
        epochs: int,
        batch: int,
        clip: float,
        gamma: float,
        gae_lambda: float,
        imitation: float,
    ) -> None:
        self._networks, self._epochs, self._batch, self._clip = networks, epochs, batch, clip
        self._gamma, self._gae_lambda, self._imitation = gamma, gae_lambda, imitation

    def run(
        self,
        buffer: RolloutBuffer,
        rewards: NDArray[np.float64],
        ahead: NDArray[np.float32],
        rates: Rates,
        generators: Sequence[np.random.Generator],
        cheapest: CheapestSteps | None,
    ) -> NDArray[np.float64]:
        """Update from all steps of the buffer.

        Parameters
        ----------
        buffer
            The full buffer.
        rewards
            Reward of every step, shape (runs, steps).
        ahead
            Observation after the last step, shape (runs, features).
        rates
            Present rates.
        generators
            One for every run; shuffles its steps.
        cheapest
            Cheapest episodes for imitation; None without.

        Returns
        -------
        ndarray
            Means of `CURVES` over the drawn steps, shape (curves, runs).
        """
        steps = self._prepare(buffer, rewards, ahead)
        count = buffer.actions.shape[1]
        for _ in range(self._epochs):
            order = np.stack([generator.permutation(count) for generator in generators])
            for first in range(0, count, self._batch):
                batch = torch.from_numpy(order[:, first : first + self._batch])
                loss = self._loss(steps, batch, rates.entropy)
                if cheapest is not None:
                    loss = loss + self._imitation_loss(cheapest)
                self._networks.minimise(loss, rates.learning)
        return self._curves(steps)

    @torch.no_grad()
    def _prepare(
        self, buffer: RolloutBuffer, rewards: NDArray[np.float64], ahead: NDArray[np.float32]
    ) -> _Steps:
        observations, masks = torch.from_numpy(buffer.observations), torch.from_numpy(buffer.masks)
        values = self._networks.values(observations).numpy()
        beyond = self._networks.values(torch.from_numpy(ahead)[:, None])[:, 0].numpy()
        advantages = buffer.advantages(rewards, values, beyond, self._gamma, self._gae_lambda)
        actions = torch.from_numpy(buffer.actions)[..., None]
        logs = self._networks.log_probabilities(observations, masks)
        return _Steps(
            observations,
            masks,
            actions,
            torch.from_numpy(buffer.drawn.astype(np.float32)),
            logs,
            logs.gather(2, actions)[..., 0],
            torch.from_numpy(buffer.normalise(advantages)),
            torch.from_numpy(advantages + values),
        )

    def _loss(self, steps: _Steps, batch: torch.Tensor, entropy_weight: float) -> torch.Tensor:
        """Return the loss of a batch of every run, shape (runs, n), summed over runs."""
        rows = torch.arange(len(batch))[:, None]
        observations = steps.observations[rows, batch]
        logs = self._networks.log_probabilities(observations, steps.masks[rows, batch])
        taken = logs.gather(2, steps.actions[rows, batch])[..., 0]
        ratio = (taken - steps.old_taken[rows, batch]).exp()
        clipped = ratio.clamp(1.0 - self._clip, 1.0 + self._clip)
        advantages = steps.advantages[rows, batch]
        policy_loss = -torch.minimum(ratio * advantages, clipped * advantages)
        value_loss = (self._networks.values(observations) - steps.returns[rows, batch]) ** 2
        loss = policy_loss - entropy_weight * _entropy(logs) + value_loss
        return (loss * _weights(steps.drawn[rows, batch])).sum()

    def _imitation_loss(self, cheapest: CheapestSteps) -> torch.Tensor:
        """Return the cross entropy to the cheapest episodes, summed over runs."""
        if not self._imitation or not cheapest.shares.any():
            return torch.zeros(())
        observations = torch.from_numpy(cheapest.observations)
        logs = self._networks.log_probabilities(observations, torch.from_numpy(cheapest.masks))
        taken = logs.gather(2, torch.from_numpy(cheapest.actions))[..., 0]
        return -self._imitation * (taken * torch.from_numpy(cheapest.shares)).sum()

    @torch.no_grad()
    def _curves(self, steps: _Steps) -> NDArray[np.float64]:
        logs = self._networks.log_probabilities(steps.observations, steps.masks)
        ratio = (logs.gather(2, steps.actions)[..., 0] - steps.old_taken).exp()
        curves = (
            -ratio * steps.advantages,
            (self._networks.values(steps.observations) - steps.returns) ** 2,
            _entropy(logs),
            ((ratio - 1.0).abs() > self._clip).float(),
            (steps.old_logs.exp() * (steps.old_logs - logs)).sum(2),
        )
        weights = _weights(steps.drawn)
        return np.stack([(curve * weights).sum(1).double().numpy() for curve in curves])


def _weights(drawn: torch.Tensor) -> torch.Tensor:
    """Return weights that sum to 1 over the drawn steps of a run, if there are any."""
    return drawn / drawn.sum(1, keepdim=True).clamp(min=1.0)


def _entropy(logs: torch.Tensor) -> torch.Tensor:
    """Return the entropy of every row of log probabilities [nat]."""
    return -(logs.exp() * logs).sum(2)
