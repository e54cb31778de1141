"""The solver `ppo`: proximal policy optimisation with masks.

Schulman et al., "Proximal policy optimization algorithms" (2017). Moller et al., section 6, name
the method as future work. Options marked as additions are not in that paper and are off by
default.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from skillplan.env.skill_vector_env import SkillVectorEnv
from skillplan.env.transition_table import COMPLETE, GOES_ON
from skillplan.solvers.learning.episode_training import (
    Arrays,
    CompletedEpisode,
    EpisodeRecord,
    read_array,
)
from skillplan.solvers.learning.learner import Episode, Training, is_certain
from skillplan.solvers.learning.network_policy import ActionRule, NetworkPolicy, allowing
from skillplan.solvers.learning.observation_counts import ObservationCounts
from skillplan.task.task import Task
from skillplan_torch.additions import Plans
from skillplan_torch.network_learner import (
    FailureLoss,
    FinalLearningRate,
    Layers,
    NetworkLearner,
    NetworkOptions,
    NetworkTraining,
    StepFloor,
    StepsWorth,
    Width,
)
from skillplan_torch.networks import BLOCK, padded
from skillplan_torch.ppo.update import CURVES, ActorCritic, ClippedUpdate, Rates, RolloutBuffer


class PpoOptions(NetworkOptions):
    """Options of `ppo`."""

    LEGACY: ClassVar[Mapping[str, Any]] = {"scale_by_success": True}

    width: Width = 64
    layers: Layers = 2
    learning_rate_end: Annotated[
        FinalLearningRate, Field(description="final learning rate of Adam, approached linearly [-]")
    ] = 1e-4
    failure: Annotated[
        FailureLoss,
        Field(description="loss for a skill that cannot be executed, and for the step limit [-]"),
    ] = 1.0
    steps_worth: StepsWorth = 1.25
    step_floor: StepFloor = 8.0
    # Updates
    rollout: int = Field(
        default=256,
        ge=BLOCK,
        le=1_048_576,
        multiple_of=BLOCK,
        description="environment steps between updates, a multiple of 32 [-]",
    )
    epochs: int = Field(
        default=8, ge=1, le=1_000, description="passes of an update over these steps [-]"
    )
    batch: int = Field(
        default=128,
        ge=BLOCK,
        le=1_048_576,
        multiple_of=BLOCK,
        description="steps of a gradient step, a multiple of 32 [-]",
    )
    clip: float = Field(
        default=0.2,
        gt=0.0,
        le=1.0,
        description="greatest change of a probability's ratio that still gains [-]",
    )
    max_gradient: float = Field(
        default=0.5,
        gt=0.0,
        le=1e6,
        description="length to which longer gradients of a network are cut [-]",
    )
    gae_lambda: float = Field(
        default=0.95,
        ge=0.0,
        le=1.0,
        description="weight of later steps in advantages: 0 one step, 1 the whole episode [-]",
    )
    entropy: float = Field(
        default=0.1, ge=0.0, le=1e3, description="initial weight of the policy's entropy [-]"
    )
    entropy_end: float = Field(
        default=0.0,
        ge=0.0,
        le=1e3,
        description="final weight of the entropy, approached linearly [-]",
    )
    follow: bool | None = Field(
        default=None,
        description="evaluate the policy without exploration for an episode after each update; "
        "its steps count, but are not learned from. Never under chance or on several boards, "
        "because one episode does not suffice; null elsewhere true [-]",
    )
    # Additions
    scale_by_success: bool = Field(
        default=False,
        description="addition: scale rewards of steps by the share of successful episodes, so "
        "that failing early is never cheaper than trying [-]",
    )
    imitation: float = Field(
        default=0.0,
        ge=0.0,
        le=1e6,
        description="addition: weight of the cross entropy to the cheapest episode; without "
        "chance only [-]",
    )
    novelty: float = Field(
        default=0.0,
        ge=0.0,
        le=1e6,
        description="addition: initial reward for a new action at an observation, divided by the "
        "root of its count and falling linearly to 0 [-]",
    )


class PpoSolver(NetworkLearner):
    """Learn action probabilities by PPO; keep the best evaluated policy."""

    name = "ppo"

    Options = PpoOptions
    options: PpoOptions
    steps_factor = 2.0

    @property
    def own_rule(self) -> ActionRule:
        """The probabilities that were learned: temperature 1."""
        return ActionRule("softmax", 1.0)

    def derived(self, tasks: Sequence[Task]) -> dict[str, Any]:
        """Return the values of options that are null."""
        return {**super().derived(tasks), **self.where_null(follow=is_certain(tasks))}

    def begin(self, env: SkillVectorEnv, seeds: Sequence[int], steps: int) -> Training:
        """Return a training before its first step."""
        options = self.options.model_copy(update=self.derived([m.task for m in env.models]))
        return PpoTraining(options, env, seeds, steps)


class PpoTraining(NetworkTraining):
    """Runs of `ppo` in progress.

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
        self, options: PpoOptions, env: SkillVectorEnv, seeds: Sequence[int], steps: int
    ) -> None:
        super().__init__(options, env, seeds, steps)
        self._options = options
        runs = len(seeds)
        # Outputs beyond the actions are always masked.
        self._outputs = padded(self._actions)
        self._follows = options.follow is not False and self._one_episode_suffices
        observations, infos = env.reset(seed=list(seeds))
        features = observations.shape[1]
        hidden = (options.width,) * options.layers
        self._networks = ActorCritic(
            hidden, features, self._outputs, options.max_gradient, self._generators
        )
        self._update = ClippedUpdate(
            self._networks,
            epochs=options.epochs,
            batch=options.batch,
            clip=options.clip,
            gamma=options.gamma,
            gae_lambda=options.gae_lambda,
            imitation=options.imitation,
        )
        self._buffer = RolloutBuffer(runs, options.rollout, features, self._outputs)
        # Visits for novelty, and for plans; each only if it is on.
        self._counts = ObservationCounts(runs, features, self._outputs)
        self._seen = ObservationCounts(runs, features, self._actions)
        self._plans: Plans | None = None
        if options.planning:
            self._plans = Plans(self._generators, self._seen, self._limit, options.plan_width)
        self._episodes = [EpisodeRecord(greedy=False) for _ in seeds]
        # Observations and masks of the current episodes.
        longest = max(model.task.step_limit for model in env.models)
        self._episode_observations = np.zeros((runs, longest, features), dtype=np.float32)
        self._episode_masks = np.zeros((runs, longest, self._outputs), dtype=np.bool_)
        # True if the next episode evaluates the policy.
        self._due = np.zeros(runs, dtype=np.bool_)
        # Typical loss of a step of every run; NaN until steps have shown it.
        self._typical = np.full(runs, np.nan)
        self._curves = np.zeros((len(CURVES), runs))
        self._updates = 0
        self._observe(observations, infos["action_mask"])

    def advance(self, steps: int) -> list[Episode]:
        """Take environment steps in every run; return the episodes that ended."""
        ended: list[Episode] = []
        for _ in range(steps):
            before, actions, novelties = (self._observed, self._allowed), *self._choose()
            drawn = np.array([not record.greedy for record in self._episodes])
            if self._plans is not None:
                self._replace_by_plans(self._plans, actions, drawn)
            observations, rewards, _, _, infos = self._env.step(actions)
            self.steps += 1
            step_rewards = self._scaling.of_steps(rewards, infos["cost"], infos["end"])
            self._buffer.add(before, actions, drawn, infos["end"], step_rewards, novelties)
            if self._plans is not None:
                self._learn_plans(self._plans, actions, infos)
            for run, end in enumerate(infos["end"].tolist()):
                record = self._episodes[run]
                self._episode_observations[run, record.length] = before[0][run]
                self._episode_masks[run, record.length] = before[1][run]
                record.add(0, int(actions[run]), float(infos["cost"][run]), float(rewards[run]))
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

    def _choose(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the action of every run, drawn or greedy, and its novelty."""
        scores = self._networks.scores(self._observed).astype(np.float64)
        scores = np.where(self._allowed, scores, -np.inf)
        likelihoods = np.exp(scores - scores.max(axis=1, keepdims=True)).cumsum(axis=1)
        # One number per step and run even if unused, so that later draws do not depend on it.
        uniforms = np.array([generator.random() for generator in self._generators])
        drawn = (likelihoods <= uniforms[:, None] * likelihoods[:, -1:]).sum(axis=1)
        greedy = np.array([record.greedy for record in self._episodes])
        # Rounding may put a number close to 1 beyond the last action.
        actions = np.where(greedy, scores.argmax(axis=1), np.minimum(drawn, self._actions - 1))
        if not self._options.novelty:
            return actions, np.zeros(len(actions))
        indices = self._counts.indices(self._observed, self._allowed)
        visits, rows = self._counts.visits, np.arange(len(actions))
        visits[rows, indices, actions] += 1
        return actions, 1.0 / np.sqrt(visits[rows, indices, actions])

    def _learn(self) -> None:
        """Update the networks from the full buffer, and begin a new one."""
        before, options = self._networks.parameters(), self._options
        cheapest = None
        if options.imitation:
            cheapest = self._best.cheapest_steps(padded(self._limit), self._outputs)
        self._curves += self._update.run(
            self._buffer, self._rewards(), self._observed, self._rates(), self._generators, cheapest
        )
        self._updates += 1
        for run in np.flatnonzero(~self._networks.is_finite()).tolist():
            self._fail(run)
            self._networks.reset(run, before)
        self._buffer.filled = 0
        self._due[:] = self._follows
        for run, record in enumerate(self._episodes):
            # An episode in progress has followed two policies, unless it is yet to begin.
            record.greedy = self._follows and record.length == 0
            if record.greedy:
                self._due[run] = False

    def _rewards(self) -> NDArray[np.float64]:
        """Return the rewards of the buffer's steps, shape (runs, rollout)."""
        options, ends = self._options, self._buffer.ends
        complete, over = ends == COMPLETE, ends != GOES_ON
        worth = options.steps_worth / self._limit
        if options.scale_by_success:
            success = complete.sum(axis=1) / np.maximum(1, over.sum(axis=1))
            share = (worth * success)[:, None]
            losses = self._buffer.step_rewards / self._typical_losses()
        else:
            share = np.full((len(ends), 1), worth)
            losses = self._buffer.step_rewards / (self._scaling.typical or np.inf)
        rewards: NDArray[np.float64] = np.maximum(share * losses, -share * options.step_floor)
        rewards += self._scheduled(options.novelty, 0.0) * self._buffer.novelties
        rewards += np.where(complete, options.complete, 0.0)
        rewards -= np.where(over & ~complete, options.failure, 0.0)
        return rewards

    def _typical_losses(self) -> NDArray[np.float64]:
        """Return the median loss of a step in the first buffer of each run, shape (runs, 1)."""
        rewards, ends = self._buffer.step_rewards, self._buffer.ends
        for run in np.flatnonzero(np.isnan(self._typical)).tolist():
            losses = -rewards[run][(ends[run] == GOES_ON) & (rewards[run] < 0)]
            if losses.size:
                self._typical[run] = np.median(losses)
        typical: NDArray[np.float64] = np.nan_to_num(self._typical, nan=np.inf)
        return typical[:, None]

    def _evaluate(self, episode: Episode) -> None:
        """Compare a run's policy with an episode that has ended."""
        run, length = episode.run, len(episode.actions)
        completed = None
        if episode.success:
            completed = CompletedEpisode(
                episode.cost,
                self._episode_observations[run, :length].copy(),
                self._episode_masks[run, :length, : self._actions].copy(),
                np.array(episode.actions),
            )
        self._best.compare(run, episode.step, completed, self._policy_of(run))

    def _replace_by_plans(
        self, plans: Plans, actions: NDArray[np.int64], drawn: NDArray[np.bool_]
    ) -> None:
        """Replace drawn actions by planned ones; both arrays are changed."""
        self._at = self._seen.indices(self._observed, self._allowed[:, : self._actions])
        for run, record in enumerate(self._episodes):
            if not record.greedy:
                action = plans.action(run, int(self._at[run]), record)
                if action is not None:
                    actions[run], drawn[run] = action, False

    def _learn_plans(
        self, plans: Plans, actions: NDArray[np.int64], infos: Mapping[str, Any]
    ) -> None:
        """Learn action schemas from the step of every run."""
        after = self._seen.indices(infos["final_obs"], allowing(infos["final_mask"]))
        self._seen.visits[np.arange(len(actions)), self._at, actions] += 1
        for run, end in enumerate(infos["end"].tolist()):
            before, last = int(self._at[run]), self._episodes[run].last_action
            cost = float(infos["cost"][run])
            plans.learn_step(run, before, int(actions[run]), int(after[run]), end, cost, last)
            if end != GOES_ON:
                plans.begin_episode(run, self.steps)

    def start_from(self, networks: Sequence[NetworkPolicy]) -> None:
        """Begin with these networks; the first episode follows them."""
        for run, network in enumerate(networks):
            self._networks.load(run, network)
            self._episodes[run].greedy = self._follows

    def figures(self) -> list[dict[str, float]]:
        """Return losses, entropy, the extent of updates, and the rates of every run.

        ``clipped`` is the share of steps whose ratio has reached the clip, ``divergence`` the
        Kullback-Leibler divergence between the policies before and after an update.
        """
        rates = self._rates()
        now = {"learning_rate": rates.learning, "entropy_weight": rates.entropy}
        means = self._curves / max(1, self._updates)
        figures = []
        for run in range(len(self._generators)):
            curves = dict(zip(CURVES, means[:, run].tolist(), strict=True))
            figure = now | (curves if self._updates and run not in self.failed else {})
            figures.append(figure if self._plans is None else figure | self._plans.figures(run))
        self._curves[:], self._updates = 0.0, 0
        return figures

    def _rates(self) -> Rates:
        options = self._options
        return Rates(
            self._scheduled(options.learning_rate, options.learning_rate_end),
            self._scheduled(options.entropy, options.entropy_end),
        )

    def _scheduled(self, first: float, last: float) -> float:
        return first + (last - first) * min(1.0, self.steps / self._total)

    def _observe(self, observations: NDArray[np.float32], masks: NDArray[np.bool_]) -> None:
        self._observed = observations
        self._allowed = np.zeros((len(masks), self._outputs), dtype=np.bool_)
        self._allowed[:, : self._actions] = allowing(masks)

    def _policy_of(self, run: int) -> NetworkPolicy:
        return self._networks.policy(run, self._actions)

    def _own_arrays(self) -> Arrays:
        return {
            **self._networks.arrays(),
            **self._buffer.arrays("roll_out"),
            **self._counts.arrays("situations"),
            **self._seen.arrays("seen"),
            **({} if self._plans is None else self._plans.arrays("planned")),
            **{name: array.copy() for name, array in self._small_arrays().items()},
        }

    def _own_notes(self) -> dict[str, Any]:
        plans = {} if self._plans is None else self._plans.notes()
        return {"filled": self._buffer.filled, "updates": self._updates, **plans}

    def _read_own(self, arrays: Mapping[str, NDArray[Any]], notes: Mapping[str, Any]) -> None:
        self._networks.read(arrays)
        self._buffer.read("roll_out", arrays)
        self._counts.read("situations", arrays)
        self._seen.read("seen", arrays)
        if self._plans is not None:
            self._plans.read("planned", arrays, notes)
        for name, array in self._small_arrays().items():
            np.copyto(array, read_array(arrays, name, array.shape))
        self._buffer.filled, self._updates = int(notes["filled"]), int(notes["updates"])

    def _small_arrays(self) -> Arrays:
        """Return the training's own arrays by their names in a snapshot."""
        return {
            "unit": self._typical,
            "curves": self._curves,
            "due": self._due,
            "way_observed": self._episode_observations,
            "way_allowed": self._episode_masks,
        }
