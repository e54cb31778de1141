"""Deep Q-learning as it runs: steps in the environment, what is remembered of them, updates.

Mnih et al., "Human-level control through deep reinforcement learning" (2015). The update itself
is in `q_update`, the choice of actions in `exploration`. A step limit that nobody observes is no
end of what is learned: Pardo et al., "Time limits in reinforcement learning" (2018).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan.env.skill_vector_env import SkillVectorEnv
from skillplan.env.transition_table import COMPLETE, GOES_ON, INFEASIBLE, OUT_OF_TIME
from skillplan.solvers.learning.episode_training import CompletedEpisode, EpisodeRecord
from skillplan.solvers.learning.learner import Episode
from skillplan.solvers.learning.network_policy import NetworkPolicy, allowing
from skillplan.solvers.learning.observation_counts import ObservationCounts
from skillplan.task.task import Task
from skillplan_torch.dqn.exploration import Exploration
from skillplan_torch.dqn.options import DqnOptions
from skillplan_torch.dqn.q_networks import QNetworks
from skillplan_torch.dqn.q_update import QUpdate
from skillplan_torch.dqn.replay_memory import ReplayMemory
from skillplan_torch.dqn.schedules import Schedules
from skillplan_torch.network_training import NetworkTraining
from skillplan_torch.reward_scaling import RewardScaling

# Environment steps after which it is worked out anew how likely outcomes are.
_POOLED_STEPS = 500


def reward_scale(options: DqnOptions, task: Task) -> float:
    """Return by what the rewards of steps are multiplied, 0 where no step costs anything."""
    typical = RewardScaling.of(task, options.objective, counts_last=options.count_last_cost).typical
    return options.steps_worth / (task.step_limit * typical) if typical else 0.0


class DqnTraining(NetworkTraining):
    """Runs of deep Q-learning in progress.

    Parameters
    ----------
    options
        Of the solver, with what is derived filled in.
    env
        An environment for every run.
    seeds
        One for every run.
    steps
        How many every run does in all.
    """

    def __init__(
        self, options: DqnOptions, env: SkillVectorEnv, seeds: Sequence[int], steps: int
    ) -> None:
        super().__init__(options, env, seeds, steps)
        self._options = options
        runs = len(seeds)
        self._rows = np.arange(runs)
        observations, infos = env.reset(seed=list(seeds))
        features = observations.shape[1]
        self._counts = ObservationCounts(runs, features, self._actions)
        self._memory = ReplayMemory(runs, options.capacity)
        self._networks = QNetworks(options, features, self._actions, self._generators)
        self._schedules = Schedules(options, self._total)
        self._exploration = Exploration(
            options,
            self._schedules,
            self._generators,
            self._counts,
            self._limit,
            plans=self._plans,
        )
        self._pools = len(env.models) == 1 and not env.models[0].task.deterministic
        assert options.updates is not None
        self._updates = options.updates
        # The least that the reward of a step is taken for.
        self._least = -options.step_floor * self._scaling.typical
        self._update = QUpdate(
            options,
            self._schedules,
            self._networks,
            self._memory,
            self._counts,
            self._exploration,
            self._best,
            self._limit,
            reward_scale=reward_scale(options, env.models[0].task),
        )
        # Updates that are due; a fraction of one is carried over.
        self._due = 0.0
        self._curves: list[NDArray[np.float64]] = []
        self._observe(observations, infos["action_mask"])

    def advance(self, steps: int) -> list[Episode]:
        """Do so many environment steps in every run; return the episodes that ended."""
        ended: list[Episode] = []
        for _ in range(steps):
            actions, greedy = self._choose()
            observations, rewards, _, _, infos = self._env.step(actions)
            self.steps += 1
            before, ends = self._at, infos["end"]
            final = self._counts.indices(infos["final_obs"], allowing(infos["final_mask"]))
            step_rewards = np.maximum(
                self._scaling.of_steps(rewards, infos["cost"], ends), self._least
            )
            self._counts.visits[self._rows, before, actions] += 1
            costs = infos["cost"].tolist()
            for run, end in enumerate(ends.tolist()):
                record = self._episodes[run]
                if self._exploration.planned is not None:
                    self._exploration.planned.learn_step(
                        run,
                        int(before[run]),
                        record.last_action,
                        int(actions[run]),
                        None if end == INFEASIBLE else int(final[run]),
                        cost=costs[run],
                        complete=end == COMPLETE,
                    )
                record.add(int(before[run]), int(actions[run]), costs[run], float(rewards[run]))
                record.greedy = record.greedy and bool(greedy[run])
                # What is learned at the step limit goes on with the state after it.
                self._memory.add(
                    run,
                    int(before[run]),
                    int(actions[run]),
                    float(step_rewards[run]),
                    GOES_ON if end == OUT_OF_TIME else end,
                    int(final[run]),
                )
                self._exploration.completed[run] |= end == COMPLETE
                if end != GOES_ON:
                    episode = self._end_episode(run, end)
                    if episode is not None:
                        ended.append(episode)
            self._observe(observations, infos["action_mask"])
            if self._pools and self.steps % _POOLED_STEPS == 0:
                for run in range(len(self._rows)):
                    self._memory.pool(run, self._counts.observations[run])
            if self.steps >= self._options.warm_up:
                self._due += self._updates
                while self._due >= 1.0:
                    self._due -= 1.0
                    self._curves.append(self._update.learn(self._generators, self.steps))
        self._find_failures()
        return ended

    def start_from(self, networks: Sequence[NetworkPolicy]) -> None:
        """Begin with these networks instead of drawn ones; the first episode keeps to them."""
        for run, network in enumerate(networks):
            self._networks.take_over(run, network)
            self._exploration.following[run] = True

    def figures(self) -> list[dict[str, float]]:
        """Return loss, mean value and what exploration and learning rate have come to."""
        runs, steps = len(self._generators), self.steps
        means = np.mean(self._curves, axis=0) if self._curves else np.full((2, runs), np.nan)
        self._curves = []
        counts = self._options.exploration == "count"
        exploring = self._schedules.bonus(steps) if counts else self._schedules.epsilon(steps)
        found = []
        for run in range(runs):
            one = {
                "learning_rate": self._schedules.learning_rate(steps),
                "bonus" if counts else "epsilon": exploring,
                "situations": float(self._counts.known(run)),
                "remembered": float(self._memory.size(run)),
            }
            if np.isfinite(means[:, run]).all():
                one |= {"loss": float(means[0, run]), "value": float(means[1, run])}
            found.append(one)
        return found

    def _own_arrays(self) -> dict[str, NDArray[Any]]:
        return {
            **self._networks.arrays(),
            **self._counts.arrays("situations"),
            **self._memory.arrays("memory"),
            "curves": np.array(self._curves).reshape(-1, 2, len(self._generators)),
            **self._exploration.arrays("planned"),
        }

    def _own_notes(self) -> dict[str, Any]:
        return {
            "due": self._due,
            **self._exploration.notes(),
        }

    def _read_own(self, arrays: Mapping[str, NDArray[Any]], notes: Mapping[str, Any]) -> None:
        self._networks.read(arrays)
        self._counts.read("situations", arrays)
        self._memory.read("memory", arrays)
        self._curves = list(arrays["curves"])
        self._due = float(notes["due"])
        self._exploration.read("planned", arrays, notes)

    def _observe(self, observations: NDArray[np.float32], masks: NDArray[np.bool_]) -> None:
        self._observed, self._allowed = observations, allowing(masks)
        self._at = self._counts.indices(observations, self._allowed)

    def _choose(self) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Return the action of every run, and whether it is the policy's own."""
        values = np.where(self._allowed, self._networks.of_one(self._observed), -np.inf)
        lengths = [record.length for record in self._episodes]
        lasts = [record.last_action for record in self._episodes]
        return self._exploration.choose(values, self._allowed, self._at, lengths, lasts, self.steps)

    def _policy_of(self, run: int) -> NetworkPolicy:
        return self._networks.policy(run)

    def _end_episode(self, run: int, end: int) -> Episode | None:
        """Compare a run's policy with the episode that has ended, and begin the next one.

        Returns
        -------
        Episode or None
            None of a run that has failed.
        """
        record = self._episodes[run]
        episode = record.finish(run, self.steps, end)
        self._episodes[run] = EpisodeRecord()
        self._exploration.begin_episode(run, self.steps)
        if run in self.failed:
            return None
        try:
            policy = self._policy_of(run)
        except ValueError:
            self._find_failures()
            return None
        completed = None
        if episode.success:
            at, actions = np.array(record.indices), np.array(record.actions)
            seen = self._counts
            completed = CompletedEpisode(
                episode.cost, seen.observations[run, at], seen.masks[run, at], actions
            )
        self._best.compare(run, episode.step, completed, policy)
        return episode

    def _find_failures(self) -> None:
        for run in np.flatnonzero(~self._networks.is_sane()).tolist():
            reason = (
                f"its network is no longer finite after {self.steps:,} steps; lower learning_rate"
            )
            self.failed.setdefault(run, reason)
