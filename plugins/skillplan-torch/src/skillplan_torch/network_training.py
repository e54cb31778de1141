"""What trainings of all algorithms share: runs, episodes, best policies, snapshots."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from skillplan.env.skill_vector_env import SkillVectorEnv
from skillplan.solvers.learning.learner import Learned, Snapshot, Training
from skillplan.solvers.learning.network_policy import NetworkPolicy
from skillplan_torch.best_policies import BestPolicies
from skillplan_torch.episode_record import EpisodeRecord
from skillplan_torch.network_learner import can_plan, is_certain
from skillplan_torch.network_options import NetworkOptions
from skillplan_torch.reward_scaling import RewardScaling


class NetworkTraining(Training):
    """Runs in progress that train networks, one run for every environment.

    Parameters
    ----------
    options
        Of the solver, with what is derived filled in.
    env
        The environments.
    seeds
        One for every run.
    steps
        How many every run does in all.
    """

    def __init__(
        self, options: NetworkOptions, env: SkillVectorEnv, seeds: Sequence[int], steps: int
    ) -> None:
        # Sums must not depend on how many cores there are; of so small ones, one is the fastest.
        torch.set_num_threads(1)
        self.steps, self.failed = 0, {}
        # Over so many steps schedules run; after that, they stay at their end.
        self._env, self._total = env, options.schedule_steps or steps
        task = env.models[0].task
        self._actions, self._limit = len(task.skills), task.step_limit
        self._scaling = RewardScaling.of(
            task, options.objective, counts_last=options.count_last_cost
        )
        # Under chance, or with several boards, one episode does not show what a policy costs.
        tasks = [model.task for model in env.models]
        self._one_episode_suffices = is_certain(tasks)
        assert options.planning is not None
        self._plans = options.planning and can_plan(options, tasks)
        self._best = BestPolicies(len(seeds), keeps=self._one_episode_suffices)
        self._generators = [np.random.default_rng([seed, 1]) for seed in seeds]
        self._episodes = [EpisodeRecord() for _ in seeds]

    def learned(self, run: int) -> Learned:
        """Return a run's policy as it is, and the best one that an episode has evaluated."""
        return self._best.learned(run, self._policy_of(run))

    def snapshot(self) -> Snapshot:
        """Return all that is needed to go on from here."""
        notes = {
            "steps": self.steps,
            "failed": {str(run): why for run, why in self.failed.items()},
            "generators": [generator.bit_generator.state for generator in self._generators],
            "episodes": [record.document() for record in self._episodes],
            "kept": self._best.document(),
            "env": self._env.state(),
        }
        arrays = {**self._own_arrays(), **self._best.arrays("kept")}
        return Snapshot(arrays, notes | self._own_notes())

    def restore(self, snapshot: Snapshot) -> None:
        """Go on from a snapshot.

        Raises
        ------
        ValueError
            If it is none of these options.
        """
        arrays, notes = snapshot.arrays, snapshot.notes
        self._read_own(arrays, notes)
        self._best.read("kept", arrays, notes["kept"])
        self.steps = int(notes["steps"])
        self.failed = {int(run): str(why) for run, why in notes["failed"].items()}
        for generator, state in zip(self._generators, notes["generators"], strict=True):
            generator.bit_generator.state = state
        self._episodes = [EpisodeRecord.read(document) for document in notes["episodes"]]
        observations, infos = self._env.restore(notes["env"])
        self._observe(observations, infos["action_mask"])

    @abstractmethod
    def _observe(self, observations: NDArray[np.float32], masks: NDArray[np.bool_]) -> None:
        """Take in what every run observes now, and what is allowed there."""

    @abstractmethod
    def _policy_of(self, run: int) -> NetworkPolicy:
        """Return the policy of a run as it is.

        Raises
        ------
        ValueError
            If a figure of it is not finite.
        """

    @abstractmethod
    def _own_arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays of a snapshot that only this algorithm has."""

    @abstractmethod
    def _own_notes(self) -> dict[str, Any]:
        """Return the notes of a snapshot that only this algorithm has, as JSON values."""

    @abstractmethod
    def _read_own(self, arrays: Mapping[str, NDArray[Any]], notes: Mapping[str, Any]) -> None:
        """Take over what `_own_arrays` and `_own_notes` returned.

        Raises
        ------
        ValueError
            If it is of another shape.
        """
