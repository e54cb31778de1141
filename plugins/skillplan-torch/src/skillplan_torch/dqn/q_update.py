"""The update of deep Q-learning: targets by double Q-learning, and a step of gradient descent.

van Hasselt et al., "Deep reinforcement learning with double Q-learning" (2016). In the end the
cheapest episode is followed by a margin: Hester et al., "Deep Q-learning from demonstrations"
(2018); it is the run's own, and nobody else's.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from skillplan.env.transition_table import COMPLETE, GOES_ON
from skillplan.solvers.learning.episode_training import BestPolicies
from skillplan.solvers.learning.observation_counts import ObservationCounts, take_rows
from skillplan_torch.batched_network import padded
from skillplan_torch.dqn.exploration import Exploration
from skillplan_torch.dqn.options import DqnOptions
from skillplan_torch.dqn.q_networks import QNetworks
from skillplan_torch.dqn.replay_memory import ReplayMemory
from skillplan_torch.dqn.schedules import Schedules

# By how much values of imitated actions stand out; they are about -1 to 4.
_MARGIN = 0.2


class QUpdate:
    """Learns from batches of what is remembered.

    Parameters
    ----------
    options, schedules
        How it learns, and when.
    networks, memory, counts, exploration
        What is improved, from what, and by which bonus for what was tried seldom.
    kept
        The cheapest episodes, which are followed in the end.
    step_limit
        Most skills of an episode.
    reward_scale
        What the rewards of steps are multiplied by.
    """

    def __init__(
        self,
        options: DqnOptions,
        schedules: Schedules,
        networks: QNetworks,
        memory: ReplayMemory,
        counts: ObservationCounts,
        exploration: Exploration,
        kept: BestPolicies,
        step_limit: int,
        *,
        reward_scale: float,
    ) -> None:
        self._options, self._schedules, self._networks = options, schedules, networks
        self._memory, self._counts, self._exploration = memory, counts, exploration
        self._kept, self._rows = kept, padded(step_limit)
        self._scale = reward_scale

    def learn(self, generators: Sequence[np.random.Generator], steps: int) -> NDArray[np.float64]:
        """Learn from a batch of every run, after so many steps.

        Returns
        -------
        ndarray
            Mean loss and mean value of every run, shape (2, runs).
        """
        memory, seen = self._memory, self._counts.observations
        slots, weights = memory.draw(generators, self._options.batch)
        wanted = torch.from_numpy(self._targets(slots, steps).astype(np.float32))
        shares = torch.from_numpy(weights.astype(np.float32))
        now = torch.from_numpy(take_rows(seen, take_rows(memory.observation, slots)))
        taken = torch.from_numpy(take_rows(memory.action, slots))[..., None]
        values = self._networks.values(now).gather(2, taken)[..., 0]
        losses = torch.nn.functional.huber_loss(values, wanted, reduction="none") * shares
        each = losses.mean(1)
        loss = each.sum()
        weight = self._options.imitation * self._schedules.imitation(steps)
        if weight:
            loss = loss + weight * self._margins()
        self._networks.follow(loss, self._schedules.learning_rate(steps))
        with torch.no_grad():
            means = [each.numpy(), values.mean(1).numpy()]
        return np.stack(means).astype(np.float64)

    def _margins(self) -> torch.Tensor:
        """Return by how much actions of the cheapest episodes fall short of standing out."""
        steps = self._kept.cheapest_steps(self._rows, self._counts.masks.shape[2])
        if not steps.shares.any():
            return torch.zeros(())
        rivals = steps.masks.copy()
        np.put_along_axis(rivals, steps.actions, False, axis=2)
        values = self._networks.values(torch.from_numpy(steps.observations))
        own = values.gather(2, torch.from_numpy(steps.actions))
        others = values.masked_fill(torch.from_numpy(~rivals), -torch.inf)
        short = torch.relu(others.amax(2) + _MARGIN - own[..., 0])
        return (short * torch.from_numpy(steps.shares)).sum()

    def _targets(self, slots: NDArray[np.int64], steps: int) -> NDArray[np.float64]:
        """Return what the values of transitions should be, shape (runs, batch)."""
        options, memory = self._options, self._memory
        following, end = take_rows(memory.next_observation, slots), take_rows(memory.end, slots)
        rewards = self._scale * take_rows(memory.reward, slots)
        rewards += np.where(end == COMPLETE, options.complete, 0.0)
        rewards -= np.where((end != COMPLETE) & (end != GOES_ON), options.failure, 0.0)
        next_values = self._next_values(following, steps)
        discounts = np.where(end == GOES_ON, options.gamma, 0.0)
        # Steps only lose: nothing is worth more than completing, however promising it looks.
        targets: NDArray[np.float64] = rewards + discounts * np.minimum(
            next_values, options.complete
        )
        return targets

    @torch.no_grad()
    def _next_values(self, following: NDArray[np.int64], steps: int) -> NDArray[np.float32]:
        """Return values of the best next actions: one network chooses, the other one values."""
        after = torch.from_numpy(take_rows(self._counts.observations, following))
        barred = torch.from_numpy(~take_rows(self._counts.masks, following))
        own = self._networks.values(after).masked_fill(barred, -torch.inf)
        others = self._networks.target_values(after)
        bonus = self._exploration.bonus(following, steps)
        if bonus is not None:
            added = torch.from_numpy(bonus.astype(np.float32))
            own, others = own + added, others + added
        found: NDArray[np.float32] = others.gather(2, own.argmax(2, keepdim=True))[..., 0].numpy()
        return found
