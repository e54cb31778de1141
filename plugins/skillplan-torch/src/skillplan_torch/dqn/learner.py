"""The solver `dqn`: Double DQN with replay, a target network, epsilon-greedy and masks.

Mnih et al., "Human-level control through deep reinforcement learning" (2015); van Hasselt et al.,
"Deep reinforcement learning with double Q-learning" (2016). Values at the step limit bootstrap
from the next state: Pardo et al., "Time limits in reinforcement learning" (2018). Options marked
as additions are not in these papers and are off by default; their code is in `additions`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from skillplan.env.skill_vector_env import SkillVectorEnv
from skillplan.env.transition_table import COMPLETE, GOES_ON, OUT_OF_TIME
from skillplan.solvers.learning.episode_training import Arrays, CompletedEpisode, EpisodeRecord
from skillplan.solvers.learning.learner import Episode, Training
from skillplan.solvers.learning.network_policy import ActionRule, NetworkPolicy, allowing
from skillplan.solvers.learning.observation_counts import ObservationCounts, take_rows
from skillplan.task.task import Task
from skillplan_torch.additions import Branching, Plans, count_bonus, imitation_weight, margin_loss
from skillplan_torch.dqn.update import QNetworks, ReplayMemory, Rewards, double_q_values, td_loss
from skillplan_torch.network_learner import (
    NetworkLearner,
    NetworkOptions,
    NetworkTraining,
    RewardScaling,
)
from skillplan_torch.networks import BLOCK, padded


class DqnOptions(NetworkOptions):
    """Options of `dqn`."""

    LEGACY: ClassVar[Mapping[str, Any]] = {"replay": "distinct", "clip_values": True}
    NEW: ClassVar[Mapping[str, Any]] = {"loss": "huber", "limit_is_failure": False}

    # Exploration
    epsilon: float = Field(
        default=0.3, ge=0.0, le=1.0, description="initial probability of a random action [-]"
    )
    epsilon_end: float = Field(
        default=0.01, ge=0.0, le=1.0, description="final probability of a random action [-]"
    )
    explore_until: float = Field(
        default=0.6,
        gt=0.0,
        le=1.0,
        description="share of the steps after which epsilon is epsilon_end [-]",
    )
    # Replay
    capacity: int = Field(
        default=100_000, ge=1, le=100_000_000, description="transitions in the replay memory [-]"
    )
    replay: Literal["fifo", "distinct"] = Field(
        default="fifo",
        description="replay memory: fifo, all transitions; distinct (addition), each distinct "
        "transition once, weighted by its share of the outcomes [-]",
    )
    # Updates
    batch: int = Field(
        default=64,
        ge=BLOCK,
        le=65_536,
        multiple_of=BLOCK,
        description="transitions of an update, a multiple of 32 [-]",
    )
    updates: float | None = Field(
        default=None,
        gt=0.0,
        le=100.0,
        description="updates per environment step; null for 0.5, and 1 under chance [-]",
    )
    warm_up: int = Field(
        default=100, ge=1, le=1_000_000, description="steps before the first update [-]"
    )
    decay_from: float = Field(
        default=0.6,
        ge=0.0,
        lt=1.0,
        description="share of the steps after which the learning rate falls [-]",
    )
    target_rate: float = Field(
        default=0.02,
        gt=0.0,
        le=1.0,
        description="share by which an update moves the target network [-]",
    )
    loss: Literal["huber", "squared"] = Field(
        default="huber", description="loss of an update: huber or squared [-]"
    )
    limit_is_failure: bool = Field(
        default=False,
        description="count the step limit as a failure, without the next state's value [-]",
    )
    # Additions
    clip_values: bool = Field(
        default=False, description="addition: no next value exceeds the reward for completing [-]"
    )
    exploration: Literal["epsilon", "count"] = Field(
        default="epsilon",
        description="exploration: epsilon, epsilon-greedy; count (addition), a bonus on the "
        "values of rarely tried actions, also in the targets [-]",
    )
    branching: float = Field(
        default=0.0,
        ge=0.0,
        le=1.0,
        description="addition: share of the episodes that leave the policy once, at a random "
        "depth, for the most promising other action [-]",
    )
    imitation: float = Field(
        default=0.0,
        ge=0.0,
        le=1e6,
        description="addition: weight of the margin by which the actions of the cheapest episode "
        "stand out, from 0.65 of the steps on; without chance only [-]",
    )


# Rewards of Moller et al., Table II: 10 and -10 for ends, no reward for the last distance. The step
# rewards of the inverter board keep their scale with this `steps_worth`.
_TABLE_II = {
    "complete": 10.0,
    "failure": 10.0,
    "steps_worth": 0.411489,
    "step_floor": 1e6,
    "count_last_cost": False,
}
# Defaults of skrl's DQN, and networks of its examples: Moller et al. name skrl and print no
# settings. Epsilon falls over 1,000 of 20,000 steps; the memory keeps all.
_SKRL = {
    "gamma": 0.99,
    "updates": 1.0,
    "target_rate": 0.005,
    "epsilon": 1.0,
    "epsilon_end": 0.05,
    "explore_until": 0.05,
    "learning_rate": 1e-3,
    "learning_rate_end": 1e-3,
    "batch": 64,
    "warm_up": 64,
    "width": 64,
    "layers": 2,
    "capacity": 20_000,
}
# Moller et al.: observation of Fig. 5, no mask, and the 20,000 steps of section 5.
_MOLLER = {"steps": 20_000, "observation": "paper", "mask": "none", **_TABLE_II, **_SKRL}


class DqnSolver(NetworkLearner):
    """Learn action values by Double DQN; keep the best evaluated policy.

    Presets for the inverter board: ``moller-strict`` has the observation (Fig. 5) and the rewards
    (Table II, with -10 at the step limit) of Moller et al., and the defaults and the squared loss
    of skrl's DQN. ``moller`` comes nearer to their Table III by a replay of distinct transitions.
    """

    name = "dqn"
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "moller": {**_MOLLER, "replay": "distinct", "clip_values": True},
        # skrl moves the target network at every tenth update.
        "moller-strict": {
            **_MOLLER,
            "target_rate": 0.0005,
            "warm_up": 1,
            "loss": "squared",
            "limit_is_failure": True,
        },
    }

    Options = DqnOptions
    options: DqnOptions

    @property
    def own_rule(self) -> ActionRule:
        """Epsilon-greedy with the final epsilon; greedy with a count bonus, which ends."""
        by_epsilon = self.options.exploration == "epsilon"
        return ActionRule("epsilon-greedy", self.options.epsilon_end if by_epsilon else 0.0)

    def derived(self, tasks: Sequence[Task]) -> dict[str, Any]:
        """Return the values of options that are null."""
        updates = 0.5 if all(task.deterministic for task in tasks) else 1.0
        return super().derived(tasks) | self.where_null(updates=updates)

    def scales(self, task: Task) -> dict[str, float]:
        """Return the step limit, and the factor on rewards of steps."""
        options = self.options
        scaling = RewardScaling.of(task, options.objective, counts_last=options.count_last_cost)
        factor = scaling.factor(options.steps_worth, task.step_limit)
        return {**super().scales(task), "reward_scale": factor}

    def begin(self, env: SkillVectorEnv, seeds: Sequence[int], steps: int) -> Training:
        """Return a training before its first step."""
        options = self.options.model_copy(update=self.derived([m.task for m in env.models]))
        return DqnTraining(options, env, seeds, steps)


class DqnTraining(NetworkTraining):
    """Runs of `dqn` in progress.

    Parameters
    ----------
    options
        Options of the solver, with derived values filled in.
    env
        One environment for every run.
    seeds
        One for every run.
    steps
        Environment steps of every run in all.
    """

    def __init__(
        self, options: DqnOptions, env: SkillVectorEnv, seeds: Sequence[int], steps: int
    ) -> None:
        super().__init__(options, env, seeds, steps)
        assert options.updates is not None
        self._options, self._updates_per_step = options, options.updates
        runs = len(seeds)
        observations, infos = env.reset(seed=list(seeds))
        features = observations.shape[1]
        self._counts = ObservationCounts(runs, features, self._actions)
        self._memory = ReplayMemory(runs, options.capacity, distinct=options.replay == "distinct")
        hidden = (options.width,) * options.layers
        self._networks = QNetworks(
            hidden, features, self._actions, options.target_rate, self._generators
        )
        factor = self._scaling.factor(options.steps_worth, self._limit)
        self._rewards = Rewards(factor, options.complete, options.failure, options.gamma)
        # Updates that are due, including a fraction.
        self._due = 0.0
        # Loss and value of every update since the last call of `figures`.
        self._curves: list[NDArray[np.float64]] = []
        # True for runs that have completed the task, and for episodes that follow the policy.
        self._completed = np.zeros(runs, dtype=np.bool_)
        self._following = [False] * runs
        self._plans: Plans | None = None
        if options.planning:
            self._plans = Plans(self._generators, self._counts, self._limit, options.plan_width)
        self._branching: Branching | None = None
        if options.branching:
            self._branching = Branching(options.branching, self._limit, self._generators)
        for run in range(runs):
            self._begin_episode(run)
        self._observe(observations, infos["action_mask"])

    def advance(self, steps: int) -> list[Episode]:
        """Take environment steps in every run; return the episodes that ended."""
        ended: list[Episode] = []
        for _ in range(steps):
            actions, greedy = self._choose()
            observations, rewards, _, _, infos = self._env.step(actions)
            self.steps += 1
            self._store(actions, greedy, rewards, infos)
            for run in np.flatnonzero(infos["end"] != GOES_ON).tolist():
                episode = self._end_episode(run, int(infos["end"][run]))
                ended += [] if episode is None else [episode]
            self._observe(observations, infos["action_mask"])
            if self.steps >= self._options.warm_up:
                self._due += self._updates_per_step
                while self._due >= 1.0:
                    self._due -= 1.0
                    self._update()
        for run in np.flatnonzero(~self._networks.is_finite()).tolist():
            self._fail(run)
        return ended

    def _choose(self) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Return the action of every run, and whether it is the greedy one."""
        values = np.where(self._allowed, self._networks.evaluate(self._observed), -np.inf)
        greedy: NDArray[np.int64] = values.argmax(axis=1)
        actions = greedy.copy()
        bonus = self._bonus(self._at[:, None])
        if bonus is not None:
            actions = (values + bonus[:, 0]).argmax(axis=1)
        if self._options.exploration == "epsilon":
            epsilon = self._epsilon()
            for run, generator in enumerate(self._generators):
                if generator.random() < epsilon:
                    actions[run] = generator.choice(np.flatnonzero(self._allowed[run]))
        for run in range(len(actions)):
            addition = self._added_action(run, values[run])
            actions[run] = actions[run] if addition is None else addition
        actions = np.where(self._following, greedy, actions)
        return actions, actions == greedy

    def _added_action(self, run: int, values: NDArray[np.float32]) -> int | None:
        """Return the action of an addition: planned, or off the policy; None without one."""
        record, index = self._episodes[run], int(self._at[run])
        action = None
        if self._branching is not None:
            visits = self._counts.visits[run, index]
            action = self._branching.action(
                run,
                record.length,
                values,
                self._allowed[run],
                visits,
                untried=not self._completed[run],
            )
        if self._plans is not None and not self._following[run]:
            planned = self._plans.action(run, index, record)
            action = action if planned is None else planned
        return action

    def _store(
        self,
        actions: NDArray[np.int64],
        greedy: NDArray[np.bool_],
        rewards: NDArray[np.float64],
        infos: Mapping[str, Any],
    ) -> None:
        """Store the transition of every run."""
        before, ends, costs = self._at, infos["end"], infos["cost"]
        after = self._counts.indices(infos["final_obs"], allowing(infos["final_mask"]))
        floor = -self._options.step_floor * self._scaling.typical
        scaled = np.maximum(self._scaling.of_steps(rewards, costs, ends), floor)
        if self._options.limit_is_failure and not self._options.count_last_cost:
            scaled = np.where(ends == OUT_OF_TIME, 0.0, scaled)
        self._counts.visits[np.arange(len(actions)), before, actions] += 1
        for run, end in enumerate(ends.tolist()):
            record, action = self._episodes[run], int(actions[run])
            start, cost = int(before[run]), float(costs[run])
            if self._plans is not None:
                last = record.last_action
                self._plans.learn_step(run, start, action, int(after[run]), end, cost, last)
            record.add(start, action, cost, float(rewards[run]))
            record.greedy = record.greedy and bool(greedy[run])
            self._completed[run] |= end == COMPLETE
            # At the step limit, the value bootstraps from the next state by default.
            bootstraps = end == OUT_OF_TIME and not self._options.limit_is_failure
            stored_end = GOES_ON if bootstraps else end
            self._memory.add(run, start, action, float(scaled[run]), stored_end, int(after[run]))

    def _update(self) -> None:
        """Take a gradient step on a batch of every run."""
        options, memory = self._options, self._memory
        slots, weights = memory.draw(self._generators, options.batch)
        following, ends = take_rows(memory.next_observation, slots), take_rows(memory.end, slots)
        next_values = double_q_values(
            self._networks, self._counts, following, self._bonus(following)
        )
        if options.clip_values:
            next_values = np.minimum(next_values, options.complete)
        targets = self._rewards.of(take_rows(memory.reward, slots), ends)
        targets = targets + self._rewards.discounts(ends) * next_values
        features = take_rows(self._counts.observations, take_rows(memory.observation, slots))
        actions = take_rows(memory.action, slots)
        loss, means = td_loss(
            self._networks, features, actions, targets, weights, squared=options.loss == "squared"
        )
        weight = options.imitation * imitation_weight(self.steps / self._total)
        if weight:
            cheapest = self._best.cheapest_steps(padded(self._limit), self._actions)
            loss = loss + weight * margin_loss(self._networks.values, cheapest)
        self._networks.minimise(loss, self._learning_rate())
        self._curves.append(means)

    def _begin_episode(self, run: int) -> None:
        if self._branching is not None:
            self._branching.begin_episode(run, self.steps / self._total)
        self._following[run] = False
        if self._plans is not None:
            self._plans.begin_episode(run, self.steps)

    def _end_episode(self, run: int, end: int) -> Episode | None:
        """Return a finished episode, after comparing the policy with it; None if the run failed."""
        record = self._episodes[run]
        episode = record.finish(run, self.steps, end)
        self._episodes[run] = EpisodeRecord()
        self._begin_episode(run)
        if run in self.failed:
            return None
        try:
            policy = self._policy_of(run)
        except ValueError:
            self._fail(run)
            return None
        completed = None
        if episode.success:
            rows, actions = np.array(record.indices), np.array(record.actions)
            observations, masks = self._counts.observations[run], self._counts.masks[run]
            completed = CompletedEpisode(episode.cost, observations[rows], masks[rows], actions)
        self._best.compare(run, episode.step, completed, policy)
        return episode

    def _epsilon(self) -> float:
        """Return the probability of a random action."""
        options = self._options
        progress = min(1.0, self.steps / self._total / options.explore_until)
        return options.epsilon + (options.epsilon_end - options.epsilon) * progress

    def _learning_rate(self) -> float:
        """Return the learning rate: constant, then falling exponentially."""
        options = self._options
        decay = max(0.0, self.steps / self._total - options.decay_from) / (1 - options.decay_from)
        ratio = options.learning_rate_end / options.learning_rate
        rate: float = options.learning_rate * ratio ** min(1.0, decay)
        return rate

    def _bonus_weight(self) -> float:
        """Return the bonus of an untried action: 1, then falling linearly to 0."""
        progress = self.steps / self._total / self._options.explore_until
        return min(1.0, max(0.0, 2.0 * (1.0 - progress)))

    def _bonus(self, indices: NDArray[np.int64]) -> NDArray[np.float64] | None:
        """Return the count bonus at observations, shape (runs, n, actions); None without one."""
        weight = self._bonus_weight() if self._options.exploration == "count" else 0.0
        return count_bonus(self._counts.visits, indices, weight) if weight else None

    def start_from(self, networks: Sequence[NetworkPolicy]) -> None:
        """Begin with these networks; the first episode follows them."""
        for run, network in enumerate(networks):
            self._networks.load(run, network)
            self._following[run] = True

    def figures(self) -> list[dict[str, float]]:
        """Return loss, mean value, exploration and learning rate of every run."""
        runs = len(self._generators)
        means = np.mean(self._curves, axis=0) if self._curves else np.full((2, runs), np.nan)
        self._curves = []
        counts = self._options.exploration == "count"
        figures = []
        for run in range(runs):
            figure = {
                "learning_rate": self._learning_rate(),
                "bonus" if counts else "epsilon": (
                    self._bonus_weight() if counts else self._epsilon()
                ),
                "situations": float(self._counts.known(run)),
                "remembered": float(self._memory.size(run)),
            }
            if np.isfinite(means[:, run]).all():
                figure |= {"loss": float(means[0, run]), "value": float(means[1, run])}
            figures.append(figure if self._plans is None else figure | self._plans.figures(run))
        return figures

    def _observe(self, observations: NDArray[np.float32], masks: NDArray[np.bool_]) -> None:
        self._observed, self._allowed = observations, allowing(masks)
        self._at = self._counts.indices(observations, self._allowed)

    def _policy_of(self, run: int) -> NetworkPolicy:
        return self._networks.policy(run)

    def _own_arrays(self) -> Arrays:
        return {
            **self._networks.arrays(),
            **self._counts.arrays("situations"),
            **self._memory.arrays("memory"),
            "curves": np.array(self._curves).reshape(-1, 2, len(self._generators)),
            **({} if self._plans is None else self._plans.arrays("planned")),
        }

    def _own_notes(self) -> dict[str, Any]:
        return {
            "due": self._due,
            "completed": self._completed.tolist(),
            "following": list(self._following),
            "branch": [] if self._branching is None else list(self._branching.depths),
            **({} if self._plans is None else self._plans.notes()),
        }

    def _read_own(self, arrays: Mapping[str, NDArray[Any]], notes: Mapping[str, Any]) -> None:
        self._networks.read(arrays)
        self._counts.read("situations", arrays)
        self._memory.read("memory", arrays)
        self._curves = list(arrays["curves"])
        self._due = float(notes["due"])
        self._completed = np.array(notes["completed"], dtype=np.bool_)
        self._following = [bool(follows) for follows in notes["following"]]
        if self._branching is not None:
            self._branching.depths = [int(depth) for depth in notes["branch"]]
        if self._plans is not None:
            self._plans.read("planned", arrays, notes)
