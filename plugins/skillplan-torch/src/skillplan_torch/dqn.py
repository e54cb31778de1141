"""Deep Q-learning: double, n-step, with a target network and a count of what was tried.

Mnih et al., "Human-level control through deep reinforcement learning" (2015); van Hasselt et al.,
"Deep reinforcement learning with double Q-learning" (2016); Wang et al., "Dueling network
architectures" (2016). Untried actions are taken to be better than they look, where an action is
chosen and where a value is learned from the next one: Rashid et al., "Optimistic exploration even
with a pessimistic initialisation" (2020). Targets are mixed with the best return seen: Ostrovski
et al., "Count-based exploration with neural density models" (2017). A step limit that nobody
observes is no end of what is learned: Pardo et al., "Time limits in reinforcement learning" (2018).

What the environment pays stays the task's. What a network learns from is made of it here, as its
kinds differ a thousandfold: see `DqnOptions`, which the manifest of a run holds.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from skillplan.env.skill_vector_env import SkillVectorEnv
from skillplan.env.transition_table import COMPLETE, GOES_ON, OUT_OF_TIME
from skillplan.solvers.learning.learner import Episode, Learned, Learner, Snapshot, Training
from skillplan.solvers.learning.network_policy import NetworkPolicy, allowing
from skillplan_torch.batched_network import BatchedAdam, BatchedNetwork, padded
from skillplan_torch.dqn_options import DqnOptions
from skillplan_torch.episode_record import EpisodeRecord
from skillplan_torch.kept_policies import KeptPolicies, Walk
from skillplan_torch.replay_memory import ReplayMemory
from skillplan_torch.situations import Situations, of_runs
from skillplan_torch.step_pay import StepPay

# Values are small at first, so that what was not tried yet looks alike.
_LAST_GAIN = 0.3
# From so many tries on the bonus is as good as gone.
_MOST_TRIES = 256
_BONUS, _MASKED_BONUS = 1.0, 5.0
# Over this share of the steps the best return comes in.
_IMITATION_RAMP = 0.05


class DqnSolver(Learner):
    """Learn what every action is worth; keep the best policy that was followed."""

    name = "dqn"

    Options = DqnOptions
    options: DqnOptions

    def begin(self, env: SkillVectorEnv, seeds: Sequence[int], steps: int) -> Training:
        """Return a training that is yet to do its first step."""
        return DqnTraining(self.options, env, seeds, steps)


class DqnTraining(Training):
    """Runs of deep Q-learning under way.

    Parameters
    ----------
    options
        Of the solver.
    env
        A place for every run.
    seeds
        One for every run.
    steps
        How many every run does in all.
    """

    def __init__(
        self, options: DqnOptions, env: SkillVectorEnv, seeds: Sequence[int], steps: int
    ) -> None:
        # Sums must not depend on how many cores there are; of so small ones, one is the fastest.
        torch.set_num_threads(1)
        self.steps, self.failed = 0, {}
        self._options, self._env, self._total = options, env, steps
        task = env.models[0].task
        self._actions, self._limit = len(task.skills), task.step_limit
        deterministic = all(model.task.deterministic for model in env.models)
        self._best_share = 0.9 if deterministic else 0.0
        if options.best_return is not None:
            self._best_share = options.best_return
        bonus = _BONUS if options.mask == "none" else _MASKED_BONUS
        self._fading = 1.0 / np.arange(1.0, _MOST_TRIES + 1.0) ** options.bonus_power
        self._bonus_at_first = bonus if options.bonus is None else options.bonus
        self._pay = StepPay.of(task, options.objective, counts_last=options.count_last_cost)
        runs = len(seeds)
        self._rows = np.arange(runs)
        self._generators = [np.random.default_rng([seed, 1]) for seed in seeds]
        observations, infos = env.reset(seed=list(seeds))
        self._situations = Situations(
            runs, observations.shape[1], self._actions, options.tell_last_action
        )
        self._memory = ReplayMemory(
            runs,
            options.capacity,
            distinct=options.replay == "distinct",
            priority=options.priority,
        )
        outputs = padded(self._actions + options.dueling)
        sizes = [observations.shape[1], *[options.width] * options.layers, outputs]
        self._network = BatchedNetwork(sizes, self._generators, last_gain=_LAST_GAIN)
        self._target = self._network.copy()
        self._adam = BatchedAdam(self._network.parameters)
        self._episodes = [EpisodeRecord() for _ in seeds]
        self._kept = KeptPolicies(runs, keeps=deterministic and len(env.models) == 1)
        # What rewards of steps are multiplied by, and the least that one of them is taken for.
        usual = self._pay.usual
        self._scale = options.steps_worth / (self._limit * usual) if usual else 0.0
        self._least = -options.step_floor * usual
        self._completed = np.zeros(runs, dtype=np.bool_)
        self._due = 0.0
        self._curves: list[NDArray[np.float64]] = []
        self._branch = [self._branch_depth(run) for run in range(runs)]
        self._look(observations, infos["action_mask"])

    def advance(self, steps: int) -> list[Episode]:
        """Do so many environment steps in every run; return the episodes that ended."""
        options = self._options
        ended: list[Episode] = []
        for _ in range(steps):
            actions, greedy = self._choose()
            observations, rewards, _, _, infos = self._env.step(actions)
            self.steps += 1
            before, ends = self._at, infos["end"]
            final = self._situations.numbers(
                infos["final_obs"], allowing(infos["final_mask"]), actions.tolist()
            )
            paid = np.maximum(self._pay.of_steps(rewards, infos["cost"], ends), self._least)
            self._situations.tried[self._rows, before, actions] += 1
            costs = infos["cost"].tolist()
            for run, end in enumerate(ends.tolist()):
                action, reward = int(actions[run]), float(paid[run])
                record = self._episodes[run]
                record.add(int(before[run]), action, reward, costs[run], float(rewards[run]))
                record.greedy = record.greedy and bool(greedy[run])
                goes_on = end == OUT_OF_TIME and not options.late_is_failure
                self._remember(run, GOES_ON if goes_on else end, int(final[run]), over=end)
                if end != GOES_ON:
                    episode = record.ended(run, self.steps, end)
                    self._episodes[run] = EpisodeRecord()
                    self._branch[run] = self._branch_depth(run)
                    if run not in self.failed and self._keep(run, record, episode):
                        ended.append(episode)
            self._look(observations, infos["action_mask"])
            if self.steps >= options.warm_up:
                self._due += options.updates
                while self._due >= 1.0:
                    self._due -= 1.0
                    self._update()
        self._find_failures()
        return ended

    def figures(self) -> list[dict[str, float]]:
        """Return loss, mean value and what exploration and learning rate have come to."""
        runs = len(self._generators)
        means = np.mean(self._curves, axis=0) if self._curves else np.full((2, runs), np.nan)
        self._curves = []
        found = []
        for run in range(runs):
            one = {"learning_rate": self._rate(), self._options.exploration: self._exploring()}
            one["situations"] = float(self._situations.known(run))
            one["remembered"] = float(self._memory.size(run))
            if np.isfinite(means[:, run]).all():
                one |= {"loss": float(means[0, run]), "value": float(means[1, run])}
            found.append(one)
        return found

    def learned(self, run: int) -> Learned:
        """Return a run's policy as it is, and the best one that it followed."""
        return self._kept.learned(run, self._policy(run))

    def snapshot(self) -> Snapshot:
        """Return all that is needed to go on from here."""
        arrays = {
            **self._network.arrays("network"),
            **self._target.arrays("target"),
            **self._adam.arrays("adam"),
            **self._situations.arrays("situations"),
            **self._memory.arrays("memory"),
            **self._kept.arrays("kept"),
            "curves": np.array(self._curves).reshape(-1, 2, len(self._generators)),
        }
        notes = {
            "steps": self.steps,
            "due": self._due,
            "branch": list(self._branch),
            "completed": self._completed.tolist(),
            "failed": {str(run): why for run, why in self.failed.items()},
            "generators": [generator.bit_generator.state for generator in self._generators],
            "episodes": [record.document() for record in self._episodes],
            "kept": self._kept.document(),
            "env": self._env.state(),
        }
        return Snapshot(arrays, notes)

    def restore(self, snapshot: Snapshot) -> None:
        """Go on from a snapshot.

        Raises
        ------
        ValueError
            If it is none of these options.
        """
        arrays, notes = snapshot.arrays, snapshot.notes
        for network, name in ((self._network, "network"), (self._target, "target")):
            network.read(name, arrays)
        self._adam.read("adam", arrays)
        self._situations.read("situations", arrays)
        self._memory.read("memory", arrays)
        self._kept.read("kept", arrays, notes["kept"])
        self._curves = list(arrays["curves"])
        self.steps, self._due = int(notes["steps"]), float(notes["due"])
        self._branch = [int(depth) for depth in notes["branch"]]
        self._completed = np.array(notes["completed"], dtype=np.bool_)
        self.failed = {int(run): str(why) for run, why in notes["failed"].items()}
        for generator, state in zip(self._generators, notes["generators"], strict=True):
            generator.bit_generator.state = state
        self._episodes = [EpisodeRecord.read(one) for one in notes["episodes"]]
        observations, infos = self._env.restore(notes["env"])
        self._look(observations, infos["action_mask"])

    def _look(self, observations: NDArray[np.float32], masks: NDArray[np.bool_]) -> None:
        """Take in where every run is now."""
        before = [record.last_action for record in self._episodes]
        self._observed, self._allowed = observations, allowing(masks)
        self._at = self._situations.numbers(observations, self._allowed, before)

    def _choose(self) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Return the action of every run, and whether it is the policy's own."""
        options, allowed = self._options, self._allowed
        # Of a run that breaks they overflow; it is named where its network is seen to.
        with np.errstate(over="ignore", invalid="ignore"):
            values = self._values(torch.from_numpy(self._network.of_one(self._observed))).numpy()
        values = np.where(allowed, values, -np.inf)
        greedy: NDArray[np.int64] = values.argmax(axis=1)
        actions = greedy.copy()
        if options.exploration == "count":
            bonus = self._bonus(self._at[:, None])
            actions = greedy.copy() if bonus is None else (values + bonus[:, 0]).argmax(axis=1)
        elif options.exploration == "boltzmann":
            with np.errstate(over="ignore", invalid="ignore"):
                worth = np.exp((values - values.max(axis=1, keepdims=True)) / self._exploring())
            for run, generator in enumerate(self._generators):
                total = np.cumsum(worth[run])
                drawn = np.searchsorted(total, generator.random() * total[-1], side="right")
                actions[run] = min(int(drawn), self._actions - 1)
        else:
            for run, generator in enumerate(self._generators):
                if generator.random() < self._exploring():
                    actions[run] = generator.choice(np.flatnonzero(allowed[run]))
        for run, depth in enumerate(self._branch):
            if self._episodes[run].length >= depth:
                tried = self._situations.tried[run, self._at[run]]
                others = allowed[run].copy()
                others[greedy[run]] = False
                if not self._completed[run]:
                    others &= tried == 0
                if others.any():
                    promise = values[run] + options.branch_bonus / np.sqrt(tried + 1.0)
                    actions[run] = np.where(others, promise, -np.inf).argmax()
                    self._branch[run] = self._limit
        return actions, actions == greedy

    def _branch_depth(self, run: int) -> int:
        """Return after how many skills the episode that begins leaves the policy."""
        options, generator = self._options, self._generators[run]
        branches = self.steps < options.branch_until * self._total
        if branches and generator.random() < options.branching:
            return int(generator.integers(self._limit))
        return self._limit

    def _remember(self, run: int, end: int, following: int, *, over: int) -> None:
        """Add the transitions that are complete with the step just taken.

        Parameters
        ----------
        run
            Whose.
        end
            How the episode is taken to end with the step.
        following
            The situation after it.
        over
            How it does end.
        """
        record, n_step = self._episodes[run], self._options.n_step
        last = record.length
        while len(record.slots) < last and (over != GOES_ON or last - len(record.slots) >= n_step):
            first = len(record.slots)
            slot = self._memory.add(
                run,
                record.situations[first],
                record.actions[first],
                sum(
                    self._options.gamma**later * paid
                    for later, paid in enumerate(record.paid[first:])
                ),
                end,
                following,
                last - first,
            )
            record.slots.append(slot)
        if end == COMPLETE:
            self._completed[run] = True
            self._memory.complete(run, record.slots, record.paid)

    def _update(self) -> None:
        """Learn from a batch of every run."""
        options, memory, met = self._options, self._memory, self._situations
        slots, weights = memory.draw(self._generators, options.batch)
        following, end = of_runs(memory.following, slots), of_runs(memory.end, slots)
        steps = of_runs(memory.steps, slots)
        worth = self._scale * of_runs(memory.reward, slots)
        # What the last of several steps brings is as far away.
        last = options.gamma ** (steps - 1)
        worth += np.where(end == COMPLETE, last * options.complete, 0.0)
        worth -= np.where((end != COMPLETE) & (end != GOES_ON), last * options.failure, 0.0)
        with torch.no_grad():
            after = torch.from_numpy(of_runs(met.observations, following))
            barred = torch.from_numpy(~of_runs(met.masks, following))
            own = self._values(self._network(after)).masked_fill(barred, -torch.inf)
            others = self._values(self._target(after))
            bonus = self._bonus(following)
            if bonus is not None:
                added = torch.from_numpy(bonus.astype(np.float32))
                own, others = own + added, others + added
            next_values = others.gather(2, own.argmax(2, keepdim=True))[..., 0]
        discounts = np.where(end == GOES_ON, options.gamma**steps, 0.0)
        # Steps only lose: nothing is worth more than completing, however promising it looks.
        targets = worth + discounts * np.minimum(next_values.numpy(), options.complete)
        share = self._best_share * self._imitation()
        if share and options.gamma == 1.0:
            # What was seen is held up once the search for better is over.
            seen = options.complete + self._scale * of_runs(memory.best, slots)
            targets = np.where(np.isnan(seen), targets, (1 - share) * targets + share * seen)
        wanted = torch.from_numpy(targets.astype(np.float32))
        counts = torch.from_numpy(weights.astype(np.float32))
        now = torch.from_numpy(of_runs(met.observations, of_runs(memory.situation, slots)))
        taken = torch.from_numpy(of_runs(memory.action, slots))[..., None]
        values = self._values(self._network(now)).gather(2, taken)[..., 0]
        losses = torch.nn.functional.huber_loss(values, wanted, reduction="none") * counts
        self._adam.step(losses.mean(1).sum(), self._rate())
        self._target.approach(self._network, options.target_rate)
        with torch.no_grad():
            memory.learned(slots, (values - wanted).numpy())
            self._curves.append(
                np.stack([losses.mean(1).numpy(), values.mean(1).numpy()]).astype(np.float64)
            )

    def _values(self, outputs: torch.Tensor) -> torch.Tensor:
        """Return values of actions from a network's outputs."""
        advantages = outputs[..., : self._actions]
        if not self._options.dueling:
            return advantages
        value = outputs[..., self._actions : self._actions + 1]
        return advantages - advantages.mean(-1, keepdim=True) + value

    def _bonus(self, situations: NDArray[np.int64]) -> NDArray[np.float64] | None:
        """Return what is added to values for being tried seldom; None where that is nothing.

        Parameters
        ----------
        situations
            By run, shape (runs, n).

        Returns
        -------
        ndarray or None
            Shape (runs, n, actions).
        """
        if self._options.exploration != "count" or not self._optimism():
            return None
        tried = of_runs(self._situations.tried, situations)
        fading: NDArray[np.float64] = self._fading.take(np.minimum(tried, _MOST_TRIES - 1))
        return self._exploring() * fading

    def _optimism(self) -> float:
        """Return 1 while exploration is in full swing, then less, and 0 in the end."""
        done = self.steps / self._total / self._options.explore_until
        return min(1.0, max(0.0, 2.0 * (1.0 - done)))

    def _imitation(self) -> float:
        """Return 0 at first, then more, and 1 in the end."""
        first = self._options.imitate_from
        return min(1.0, max(0.0, (self.steps / self._total - first) / _IMITATION_RAMP))

    def _exploring(self) -> float:
        """Return the bonus, the temperature or epsilon as it is now."""
        options = self._options
        done = min(1.0, self.steps / self._total / options.explore_until)
        if options.exploration == "count":
            return self._bonus_at_first * self._optimism()
        if options.exploration == "epsilon":
            return options.epsilon + (options.epsilon_end - options.epsilon) * done
        fall: float = (options.temperature_end / options.temperature) ** done
        return options.temperature * fall

    def _rate(self) -> float:
        """Return the learning rate as it is now."""
        options = self._options
        done = max(0.0, self.steps / self._total - options.decay_from) / (1 - options.decay_from)
        fall: float = (options.learning_rate_end / options.learning_rate) ** done
        return options.learning_rate * fall

    def _policy(self, run: int) -> NetworkPolicy:
        return self._network.policy(run, self._actions)

    def _keep(self, run: int, record: EpisodeRecord, episode: Episode) -> bool:
        """Hold a run's policy against the episode that has ended; False where it has none."""
        try:
            policy = self._policy(run)
        except ValueError:
            self._find_failures()
            return False
        walk = None
        if episode.success:
            met, actions = np.array(record.situations), np.array(record.actions)
            seen = self._situations
            walk = Walk(episode.cost, seen.observations[run, met], seen.masks[run, met], actions)
        self._kept.ended(run, episode.step, walk, policy)
        return True

    def _find_failures(self) -> None:
        for run in np.flatnonzero(~self._network.is_sane()).tolist():
            reason = (
                f"its network is no longer finite after {self.steps:,} steps; lower learning_rate"
            )
            self.failed.setdefault(run, reason)
