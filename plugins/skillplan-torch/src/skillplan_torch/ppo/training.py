"""Proximal policy optimisation as it runs: steps in the environment, gathered for an update.

Schulman et al., "Proximal policy optimization algorithms" (2017). The update itself is in
`clipped_update`, advantages are in `rollout_buffer`, the rewards learned from in `scaled_rewards`.
Moller et al., section 6, name the method as future work.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan.env.skill_vector_env import SkillVectorEnv
from skillplan.env.transition_table import COMPLETE, GOES_ON, INFEASIBLE
from skillplan.solvers.learned_model.planned_episodes import PlannedEpisodes
from skillplan.solvers.learning.episode_training import CompletedEpisode, EpisodeRecord, read_array
from skillplan.solvers.learning.learner import Episode
from skillplan.solvers.learning.network_policy import NetworkPolicy, allowing
from skillplan.solvers.learning.observation_counts import ObservationCounts
from skillplan_torch.batched_network import padded
from skillplan_torch.network_training import NetworkTraining
from skillplan_torch.ppo.actor_critic import ActorCritic, Figures
from skillplan_torch.ppo.clipped_update import CURVES, ClippedUpdate, Rates
from skillplan_torch.ppo.options import PpoOptions
from skillplan_torch.ppo.rollout_buffer import RolloutBuffer
from skillplan_torch.ppo.scaled_rewards import ScaledRewards


class PpoTraining(NetworkTraining):
    """Runs of proximal policy optimisation in progress.

    Parameters
    ----------
    options
        Of the solver.
    env
        An environment for every run.
    seeds
        One for every run.
    steps
        How many every run does in all.
    """

    def __init__(
        self, options: PpoOptions, env: SkillVectorEnv, seeds: Sequence[int], steps: int
    ) -> None:
        super().__init__(options, env, seeds, steps)
        self._options = options
        runs = len(seeds)
        # Those beyond the actions are never allowed.
        self._outputs = padded(self._actions)
        self._follows = options.follow and self._one_episode_suffices
        observations, infos = env.reset(seed=list(seeds))
        features = observations.shape[1]
        self._networks = ActorCritic(options, features, self._outputs, self._generators)
        self._update = ClippedUpdate(
            options, self._networks, self._best, step_limit=self._limit, outputs=self._outputs
        )
        self._buffer = RolloutBuffer(runs, options.rollout, features, self._outputs)
        self._counts = ObservationCounts(runs, features, self._outputs)
        # What plans are made with is counted apart: for actions only, and while plans are made.
        self._seen = ObservationCounts(runs, features, self._actions)
        self._planned: PlannedEpisodes | None = None
        if self._plans:
            self._planned = PlannedEpisodes(
                self._generators, self._seen, self._limit, options.plan_width
            )
        self._rewards = ScaledRewards(options, runs, self._limit)
        self._episodes = [EpisodeRecord(greedy=False) for _ in seeds]
        # What was observed and allowed before every action of the current episodes.
        longest = max(model.task.step_limit for model in env.models)
        self._seen_observations = np.zeros((runs, longest, features), dtype=np.float32)
        self._seen_masks = np.zeros((runs, longest, self._outputs), dtype=np.bool_)
        # Whether the next episode is to follow the policy.
        self._due = np.zeros(runs, dtype=np.bool_)
        self._curves = np.zeros((len(CURVES), runs))
        self._updates = 0
        self._observe(observations, infos["action_mask"])

    def advance(self, steps: int) -> list[Episode]:
        """Do so many environment steps in every run; return the episodes that ended."""
        ended: list[Episode] = []
        for _ in range(steps):
            before, actions, novelties = (self._observed, self._allowed), *self._choose()
            drawn = np.array([not record.greedy for record in self._episodes])
            at = self._follow_plans(actions, drawn)
            observations, rewards, _, _, infos = self._env.step(actions)
            step_rewards = self._scaling.of_steps(rewards, infos["cost"], infos["end"])
            self._buffer.add(before, actions, drawn, infos["end"], step_rewards, novelties)
            self.steps += 1
            self._learn_of_steps(at, actions, infos)
            costs = infos["cost"].tolist()
            for run, end in enumerate(infos["end"].tolist()):
                record = self._episodes[run]
                self._seen_observations[run, record.length] = before[0][run]
                self._seen_masks[run, record.length] = before[1][run]
                record.add(0, int(actions[run]), costs[run], float(rewards[run]))
                if end != GOES_ON:
                    episode = record.finish(run, self.steps, end)
                    self._episodes[run] = EpisodeRecord(greedy=bool(self._due[run]))
                    self._due[run] = False
                    if run not in self.failed:
                        self._evaluate(episode)
                        ended.append(episode)
            self._observe(observations, infos["action_mask"])
            if self._buffer.is_full:
                self._learn()
        return ended

    def start_from(self, networks: Sequence[NetworkPolicy]) -> None:
        """Begin with these networks instead of drawn ones; the first episode keeps to them."""
        for run, network in enumerate(networks):
            self._networks.take_over(run, network)
            self._episodes[run].greedy = self._follows

    def figures(self) -> list[dict[str, float]]:
        """Return losses, entropy, how far updates went, and the schedules.

        ``clipped`` is the share of steps that have reached the clip, ``divergence`` that of
        Kullback and Leibler between the policies before and after an update.
        """
        rates = self._rates()
        now = {"learning_rate": rates.learning, "entropy_weight": rates.entropy}
        means = self._curves / max(1, self._updates)
        found = []
        for run in range(len(self._generators)):
            curves = dict(zip(CURVES, means[:, run].tolist(), strict=True))
            found.append(now | (curves if self._updates and run not in self.failed else {}))
        self._curves[:], self._updates = 0.0, 0
        return found

    def _own_arrays(self) -> dict[str, NDArray[Any]]:
        return {
            **self._networks.arrays(),
            **self._buffer.arrays("roll_out"),
            **self._counts.arrays("situations"),
            **self._seen.arrays("seen"),
            **({} if self._planned is None else self._planned.arrays("planned")),
            **{name: array.copy() for name, array in self._small_arrays().items()},
        }

    def _own_notes(self) -> dict[str, Any]:
        plans = [] if self._planned is None else self._planned.notes()
        return {"filled": self._buffer.filled, "updates": self._updates, "plans": plans}

    def _read_own(self, arrays: Mapping[str, NDArray[Any]], notes: Mapping[str, Any]) -> None:
        self._networks.read(arrays)
        self._buffer.read("roll_out", arrays)
        self._counts.read("situations", arrays)
        self._seen.read("seen", arrays)
        if self._planned is not None:
            self._planned.read("planned", arrays, notes["plans"])
        for name, array in self._small_arrays().items():
            np.copyto(array, read_array(arrays, name, array.shape))
        self._buffer.filled, self._updates = int(notes["filled"]), int(notes["updates"])

    def _small_arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that are this object's own, by their names in a snapshot."""
        return {
            "unit": self._rewards.typical,
            "curves": self._curves,
            "due": self._due,
            "way_observed": self._seen_observations,
            "way_allowed": self._seen_masks,
        }

    def _evaluate(self, episode: Episode) -> None:
        """Compare a run's policy with the episode that has ended and the cheapest so far."""
        run, length = episode.run, len(episode.actions)
        completed = None
        if episode.success:
            completed = CompletedEpisode(
                episode.cost,
                self._seen_observations[run, :length].copy(),
                self._seen_masks[run, :length, : self._actions].copy(),
                np.array(episode.actions),
            )
        self._best.compare(run, episode.step, completed, self._policy_of(run))

    def _observe(self, observations: NDArray[np.float32], masks: NDArray[np.bool_]) -> None:
        self._observed = observations
        self._allowed = np.zeros((len(masks), self._outputs), dtype=np.bool_)
        self._allowed[:, : self._actions] = allowing(masks)

    def _choose(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the action of every run, and how new it is.

        It is drawn, or the likeliest where the policy is followed.
        """
        scores = self._networks.scores(self._observed).astype(np.float64)
        scores = np.where(self._allowed, scores, -np.inf)
        likely = np.exp(scores - scores.max(axis=1, keepdims=True)).cumsum(axis=1)
        # One number a step in every run, needed or not: what is drawn later stays the same.
        uniforms = np.array([generator.random() for generator in self._generators])
        drawn = (likely <= uniforms[:, None] * likely[:, -1:]).sum(axis=1)
        greedy = np.array([record.greedy for record in self._episodes])
        # Rounding may put a number next to 1 beyond the last action.
        actions = np.where(greedy, scores.argmax(axis=1), np.minimum(drawn, self._actions - 1))
        if not self._options.novelty:
            return actions, np.zeros(len(actions))
        at = self._counts.indices(self._observed, self._allowed)
        visits, rows = self._counts.visits, np.arange(len(actions))
        visits[rows, at, actions] += 1
        return actions, 1.0 / np.sqrt(visits[rows, at, actions])

    def _learn(self) -> None:
        """Learn from the steps since the last update, and begin to gather again."""
        before = self._networks.figures()
        rewards = self._rewards.of(self._buffer, self._scheduled(self._options.novelty, 0.0))
        self._curves += self._update.learn(
            self._buffer, rewards, self._observed, self._rates(), self._generators
        )
        self._updates += 1
        self._find_failures(before)
        self._buffer.filled = 0
        self._due[:] = self._follows
        for run, record in enumerate(self._episodes):
            # A running episode has followed two policies now, unless it is yet to begin.
            record.greedy = self._follows and record.length == 0
            if record.greedy:
                self._due[run] = False

    def _follow_plans(
        self, actions: NDArray[np.int64], drawn: NDArray[np.bool_]
    ) -> NDArray[np.int64]:
        """Put planned actions in the place of drawn ones; return the indices of what is observed.

        Parameters
        ----------
        actions, drawn
            Of every run: the action, and whether it was drawn from the policy. Both are changed.
        """
        if self._planned is None:
            return np.zeros(len(actions), dtype=np.int64)
        allowed = self._allowed[:, : self._actions]
        at = self._seen.indices(self._observed, allowed)
        for run, record in enumerate(self._episodes):
            if not record.greedy and not self._planned.is_settled(run):
                action = self._planned.action(run, int(at[run]), record.last_action, record.length)
                if action is not None:
                    actions[run], drawn[run] = action, False
        return at

    def _learn_of_steps(
        self, at: NDArray[np.int64], actions: NDArray[np.int64], infos: dict[str, Any]
    ) -> None:
        """Have plans take in what steps led to.

        Parameters
        ----------
        at, actions
            Of every run: index of what was observed, and what was done.
        infos
            Of the environment.
        """
        if self._planned is None:
            return
        allowed = allowing(infos["final_mask"])
        after = self._seen.indices(infos["final_obs"], allowed)
        self._seen.visits[np.arange(len(at)), at, actions] += 1
        for run, end in enumerate(infos["end"].tolist()):
            self._planned.learn_step(
                run,
                int(at[run]),
                self._episodes[run].last_action,
                int(actions[run]),
                None if end == INFEASIBLE else int(after[run]),
                cost=float(infos["cost"][run]),
                complete=end == COMPLETE,
            )
            if end != GOES_ON:
                self._planned.begin_episode(run)

    def _find_failures(self, before: Figures) -> None:
        """Put runs that an update has broken back for good to what they were before it."""
        for run in np.flatnonzero(~self._networks.is_sane()).tolist():
            reason = (
                f"its networks are no longer finite after {self.steps:,} steps; lower learning_rate"
            )
            self.failed.setdefault(run, reason)
            self._networks.put_back(run, before)

    def _rates(self) -> Rates:
        options = self._options
        return Rates(
            self._scheduled(options.learning_rate, options.learning_rate_end),
            self._scheduled(options.entropy, options.entropy_end),
        )

    def _scheduled(self, first: float, last: float) -> float:
        return first + (last - first) * min(1.0, self.steps / self._total)

    def _policy_of(self, run: int) -> NetworkPolicy:
        return self._networks.policy(run, self._actions)
