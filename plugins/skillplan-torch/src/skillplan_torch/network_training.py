"""Base of the trainings of `dqn` and `ppo`."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from skillplan.env.skill_vector_env import SkillVectorEnv
from skillplan.solvers.learned_model import can_model
from skillplan.solvers.learning.episode_training import EpisodeTraining
from skillplan_torch.network_options import NetworkOptions
from skillplan_torch.reward_scaling import RewardScaling


class NetworkTraining(EpisodeTraining):
    """Runs in progress that train networks on scaled rewards.

    Parameters
    ----------
    options, env, seeds, steps
        As for `EpisodeTraining`.
    """

    def __init__(
        self, options: NetworkOptions, env: SkillVectorEnv, seeds: Sequence[int], steps: int
    ) -> None:
        # Sums must not depend on the number of cores; for small ones, one thread is fastest.
        torch.set_num_threads(1)
        super().__init__(options, env, seeds, steps)
        task = env.models[0].task
        self._scaling = RewardScaling.of(
            task, options.objective, counts_last=options.count_last_cost
        )
        tasks = [model.task for model in env.models]
        self._plans = bool(options.planning) and can_model(tasks, options.observation)
