"""The update of proximal policy optimisation: small changes towards what went better than expected.

Schulman et al., "Proximal policy optimization algorithms" (2017). Masks hold in the probabilities
and the entropy that are learned from: Huang and Ontanon, "A closer look at invalid action masking
in policy gradient algorithms" (2022).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from skillplan.solvers.learning.episode_training import BestPolicies, CheapestSteps
from skillplan_torch.batched_network import padded
from skillplan_torch.ppo.actor_critic import ActorCritic
from skillplan_torch.ppo.options import PpoOptions
from skillplan_torch.ppo.rollout_buffer import RolloutBuffer

CURVES = ("policy_loss", "value_loss", "entropy", "clipped", "divergence")


@dataclass(frozen=True)
class Rates:
    """What changes over a training.

    Parameters
    ----------
    learning
        Step size of Adam.
    entropy
        Weight of the entropy.
    """

    learning: float
    entropy: float


@dataclass(frozen=True)
class _Steps:
    """What is learned from; all tensors begin with (runs, steps).

    Parameters
    ----------
    observations, masks, actions
        What was observed and allowed, and what was done, the last of shape (runs, steps, 1).
    drawn
        1 where the action was drawn from the policy, else 0.
    old_logs, old_taken
        Logarithms of the probabilities before the update: of all actions, and of what was done.
    gains
        Normalised advantages.
    returns
        Advantages and what was expected.
    """

    observations: torch.Tensor
    masks: torch.Tensor
    actions: torch.Tensor
    drawn: torch.Tensor
    old_logs: torch.Tensor
    old_taken: torch.Tensor
    gains: torch.Tensor
    returns: torch.Tensor


class ClippedUpdate:
    """Learns from a full buffer.

    Parameters
    ----------
    options
        Of the solver.
    networks
        What is improved.
    kept
        The cheapest episodes, which are imitated.
    step_limit, outputs
        Most skills of an episode, and how many outputs the policy has.
    """

    def __init__(
        self,
        options: PpoOptions,
        networks: ActorCritic,
        kept: BestPolicies,
        *,
        step_limit: int,
        outputs: int,
    ) -> None:
        self._options, self._networks = options, networks
        self._kept, self._rows, self._outputs = kept, padded(step_limit), outputs

    def learn(
        self,
        buffer: RolloutBuffer,
        rewards: NDArray[np.float64],
        ahead: NDArray[np.float32],
        rates: Rates,
        generators: Sequence[np.random.Generator],
    ) -> NDArray[np.float64]:
        """Learn from the steps since the last update.

        Parameters
        ----------
        buffer
            The steps; it is full.
        rewards
            Of every step, scaled, shape (runs, rollout).
        ahead
            What is observed after the last step, shape (runs, features).
        rates
            As they are now.
        generators
            One for every run, which shuffles its steps.

        Returns
        -------
        ndarray
            Means over the steps drawn of what `CURVES` names, shape (curves, runs).
        """
        options = self._options
        steps = self._steps(buffer, rewards, ahead)
        cheapest = self._kept.cheapest_steps(self._rows, self._outputs)
        for _ in range(options.epochs):
            order = np.stack([g.permutation(options.rollout) for g in generators])
            for first in range(0, options.rollout, options.batch):
                some = torch.from_numpy(order[:, first : first + options.batch])
                loss = self._loss(steps, some, rates.entropy) + self._imitated(cheapest)
                self._networks.follow(loss, rates.learning)
        return self._means(steps)

    @torch.no_grad()
    def _steps(
        self, buffer: RolloutBuffer, rewards: NDArray[np.float64], ahead: NDArray[np.float32]
    ) -> _Steps:
        """Return the steps of a buffer with what the networks make of them before the update."""
        options, networks = self._options, self._networks
        observations, masks = torch.from_numpy(buffer.observations), torch.from_numpy(buffer.masks)
        values = networks.values(observations).numpy()
        beyond = networks.values(torch.from_numpy(ahead)[:, None])[:, 0].numpy()
        advantages = buffer.advantages(rewards, values, beyond, options.gamma, options.gae_lambda)
        actions = torch.from_numpy(buffer.actions)[..., None]
        logs = networks.log_probabilities(observations, masks)
        return _Steps(
            observations,
            masks,
            actions,
            torch.from_numpy(buffer.drawn.astype(np.float32)),
            logs,
            logs.gather(2, actions)[..., 0],
            torch.from_numpy(buffer.normalised(advantages)),
            torch.from_numpy(advantages + values),
        )

    def _loss(self, steps: _Steps, some: torch.Tensor, entropy_weight: float) -> torch.Tensor:
        """Return the loss of some steps of every run, shape (runs, n), summed over runs."""
        rows = torch.arange(len(some))[:, None]
        observations = steps.observations[rows, some]
        logs = self._networks.log_probabilities(observations, steps.masks[rows, some])
        taken = logs.gather(2, steps.actions[rows, some])[..., 0]
        ratio = (taken - steps.old_taken[rows, some]).exp()
        clipped = ratio.clamp(1.0 - self._options.clip, 1.0 + self._options.clip)
        gain = steps.gains[rows, some]
        policy_loss = -torch.minimum(ratio * gain, clipped * gain)
        value_loss = (self._networks.values(observations) - steps.returns[rows, some]) ** 2
        loss = policy_loss - entropy_weight * _entropy(logs) + value_loss
        return (loss * _shares(steps.drawn[rows, some])).sum()

    def _imitated(self, cheapest: CheapestSteps) -> torch.Tensor:
        """Return the cross entropy of the policies to the cheapest episodes, summed over runs."""
        if not self._options.imitation or not cheapest.shares.any():
            return torch.zeros(())
        observations = torch.from_numpy(cheapest.observations)
        logs = self._networks.log_probabilities(observations, torch.from_numpy(cheapest.masks))
        taken = logs.gather(2, torch.from_numpy(cheapest.actions))[..., 0]
        return -self._options.imitation * (taken * torch.from_numpy(cheapest.shares)).sum()

    @torch.no_grad()
    def _means(self, steps: _Steps) -> NDArray[np.float64]:
        """Return the means of what `CURVES` names, after the update."""
        logs = self._networks.log_probabilities(steps.observations, steps.masks)
        ratio = (logs.gather(2, steps.actions)[..., 0] - steps.old_taken).exp()
        curves = (
            -ratio * steps.gains,
            (self._networks.values(steps.observations) - steps.returns) ** 2,
            _entropy(logs),
            ((ratio - 1.0).abs() > self._options.clip).float(),
            (steps.old_logs.exp() * (steps.old_logs - logs)).sum(2),
        )
        return np.stack([(one * _shares(steps.drawn)).sum(1).double().numpy() for one in curves])


def _shares(drawn: torch.Tensor) -> torch.Tensor:
    """Return weights that sum to 1 over the steps drawn; to 0 where there are none."""
    return drawn / drawn.sum(1, keepdim=True).clamp(min=1.0)


def _entropy(logs: torch.Tensor) -> torch.Tensor:
    """Return the entropy of every row of logarithms of probabilities [nat]."""
    return -(logs.exp() * logs).sum(2)
