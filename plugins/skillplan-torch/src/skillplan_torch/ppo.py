"""Proximal policy optimisation: learn a policy from what it tried last, by small changes.

Schulman et al., "Proximal policy optimization algorithms" (2017); advantages after Schulman et
al., "High-dimensional continuous control using generalized advantage estimation" (2016). Masks
hold where actions are drawn and in the probabilities and the entropy that are learned from:
Huang and Ontanon, "A closer look at invalid action masking in policy gradient algorithms" (2022).
Moller et al., section 6, name the method as future work.

What the environment pays stays the task's. What is learned from is made of it here, as its kinds
differ a thousandfold: see `Options`, which the manifest of a run holds.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from skillplan.env.skill_vector_env import SkillVectorEnv
from skillplan.env.transition_table import COMPLETE, GOES_ON
from skillplan.solvers.learning.learner import Episode, Learned, Learner, Snapshot, Training
from skillplan.solvers.learning.network_policy import NetworkPolicy, allowing
from skillplan_torch.batched_network import BLOCK, BatchedAdam, BatchedNetwork, fitting, padded
from skillplan_torch.episode_record import EpisodeRecord
from skillplan_torch.kept_policies import KeptPolicies, Walk
from skillplan_torch.ppo_options import PpoOptions
from skillplan_torch.roll_out import RollOut
from skillplan_torch.situations import Situations
from skillplan_torch.step_pay import StepPay

# The policy's first outputs are next to even, so that all actions are tried at first.
_POLICY_GAIN = 0.01
# Keeps small gradients of both networks from being blown up.
_ADAM_EPSILON = 1e-5
_CURVES = ("policy_loss", "value_loss", "entropy", "clipped", "divergence")


class PpoSolver(Learner):
    """Learn how likely every action should be; keep the best policy that was followed."""

    name = "ppo"

    Options = PpoOptions
    options: PpoOptions

    def begin(self, env: SkillVectorEnv, seeds: Sequence[int], steps: int) -> Training:
        """Return a training that is yet to do its first step."""
        return PpoTraining(self.options, env, seeds, steps)


class PpoTraining(Training):
    """Runs of proximal policy optimisation under way.

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
        self, options: PpoOptions, env: SkillVectorEnv, seeds: Sequence[int], steps: int
    ) -> None:
        # Sums must not depend on how many cores there are; of so small ones, one is the fastest.
        torch.set_num_threads(1)
        self.steps, self.failed = 0, {}
        self._options, self._env, self._total = options, env, steps
        task = env.models[0].task
        self._actions, self._limit = len(task.skills), task.step_limit
        # Those beyond the actions are never allowed.
        self._outputs = padded(self._actions)
        self._pay = StepPay.of(task, options.objective, counts_last=options.count_last_cost)
        tells = len(env.models) == 1 and task.deterministic
        self._follows = options.follow and tells
        self._kept = KeptPolicies(len(seeds), keeps=tells)
        self._generators = [np.random.default_rng([seed, 1]) for seed in seeds]
        observations, infos = env.reset(seed=list(seeds))
        inner = [observations.shape[1], *[options.width] * options.layers]
        self._policy = BatchedNetwork(
            [*inner, self._outputs], self._generators, last_gain=_POLICY_GAIN
        )
        # Only the first of its outputs counts.
        self._value = BatchedNetwork([*inner, BLOCK], self._generators)
        self._adam = BatchedAdam(
            [*self._policy.parameters, *self._value.parameters], epsilon=_ADAM_EPSILON
        )
        self._roll_out = RollOut(len(seeds), options.rollout, inner[0], self._outputs)
        self._situations = Situations(len(seeds), inner[0], self._outputs, False)
        # Usual size of a step's reward, once it is known.
        self._unit = np.full(len(seeds), np.nan)
        self._episodes = [EpisodeRecord(greedy=False) for _ in seeds]
        # What was observed and allowed before every action of the episodes under way.
        way = (len(seeds), max(model.task.step_limit for model in env.models))
        self._way_observed = np.zeros((*way, inner[0]), dtype=np.float32)
        self._way_allowed = np.zeros((*way, self._outputs), dtype=np.bool_)
        # Whether the next episode is to follow the policy.
        self._due = np.zeros(len(seeds), dtype=np.bool_)
        self._curves = np.zeros((len(_CURVES), len(seeds)))
        self._updates = 0
        self._look(observations, infos["action_mask"])

    def advance(self, steps: int) -> list[Episode]:
        """Do so many environment steps in every run; return the episodes that ended."""
        ended: list[Episode] = []
        for _ in range(steps):
            before, actions, novelties = (self._observed, self._allowed), *self._choose()
            drawn = np.array([not record.greedy for record in self._episodes])
            observations, rewards, _, _, infos = self._env.step(actions)
            paid = self._pay.of_steps(rewards, infos["cost"], infos["end"])
            self._roll_out.add(before, actions, drawn, infos["end"], paid, novelties)
            self.steps += 1
            costs = infos["cost"].tolist()
            for run, end in enumerate(infos["end"].tolist()):
                record = self._episodes[run]
                self._way_observed[run, record.length] = before[0][run]
                self._way_allowed[run, record.length] = before[1][run]
                record.add(0, int(actions[run]), 0.0, costs[run], float(rewards[run]))
                if end != GOES_ON:
                    episode = record.ended(run, self.steps, end)
                    self._episodes[run] = EpisodeRecord(greedy=bool(self._due[run]))
                    self._due[run] = False
                    if run not in self.failed:
                        self._keep(episode)
                        ended.append(episode)
            self._look(observations, infos["action_mask"])
            if self._roll_out.is_full:
                self._update()
        return ended

    def figures(self) -> list[dict[str, float]]:
        """Return losses, entropy, how far updates went, and the schedules.

        ``clipped`` is the share of steps that have reached the clip, ``divergence`` that of
        Kullback and Leibler between the policies before and after an update.
        """
        now = {"learning_rate": self._rate(), "entropy_weight": self._entropy_weight()}
        means = self._curves / max(1, self._updates)
        found = []
        for run in range(len(self._generators)):
            curves = dict(zip(_CURVES, means[:, run].tolist(), strict=True))
            found.append(now | (curves if self._updates and run not in self.failed else {}))
        self._curves[:], self._updates = 0.0, 0
        return found

    def learned(self, run: int) -> Learned:
        """Return a run's policy as it is, and the best one that it followed."""
        return self._kept.learned(run, self._policy_of(run))

    def snapshot(self) -> Snapshot:
        """Return all that is needed to go on from here."""
        arrays = {
            **self._policy.arrays("policy"),
            **self._value.arrays("value"),
            **self._adam.arrays("adam"),
            **self._kept.arrays("kept"),
            **self._roll_out.arrays("roll_out"),
            **self._situations.arrays("situations"),
            "unit": self._unit.copy(),
            "curves": self._curves.copy(),
            "due": self._due.copy(),
            "way_observed": self._way_observed.copy(),
            "way_allowed": self._way_allowed.copy(),
        }
        notes = {
            "steps": self.steps,
            "filled": self._roll_out.filled,
            "updates": self._updates,
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
        self._policy.read("policy", arrays)
        self._value.read("value", arrays)
        self._adam.read("adam", arrays)
        self._roll_out.read("roll_out", arrays)
        self._situations.read("situations", arrays)
        own = {"unit": self._unit, "curves": self._curves, "due": self._due}
        own |= {"way_observed": self._way_observed, "way_allowed": self._way_allowed}
        for name, array in own.items():
            np.copyto(array, fitting(arrays, name, array.shape))
        self._kept.read("kept", arrays, notes["kept"])
        self.steps, self._updates = int(notes["steps"]), int(notes["updates"])
        self._roll_out.filled = int(notes["filled"])
        self.failed = {int(run): str(why) for run, why in notes["failed"].items()}
        for generator, state in zip(self._generators, notes["generators"], strict=True):
            generator.bit_generator.state = state
        self._episodes = [EpisodeRecord.read(document) for document in notes["episodes"]]
        observations, infos = self._env.restore(notes["env"])
        self._look(observations, infos["action_mask"])

    def _keep(self, episode: Episode) -> None:
        """Hold a run's policy against the episode that has ended and the cheapest so far."""
        run, length = episode.run, len(episode.actions)
        walk = None
        if episode.success:
            walk = Walk(
                episode.cost,
                self._way_observed[run, :length].copy(),
                self._way_allowed[run, :length, : self._actions].copy(),
                np.array(episode.actions),
            )
        self._kept.ended(run, episode.step, walk, self._policy_of(run))

    def _look(self, observations: NDArray[np.float32], masks: NDArray[np.bool_]) -> None:
        """Take in where every run is now; where nothing is allowed, everything ends it."""
        self._observed = observations
        self._allowed = np.zeros((len(masks), self._outputs), dtype=np.bool_)
        self._allowed[:, : self._actions] = allowing(masks)

    def _choose(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the action of every run, and how new it is.

        It is drawn, or the likeliest where the policy is followed.
        """
        scores = self._policy.of_one(self._observed).astype(np.float64)
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
        # The action before is no part of these situations.
        at = self._situations.numbers(self._observed, self._allowed, [-1] * len(actions))
        tried, rows = self._situations.tried, np.arange(len(actions))
        tried[rows, at, actions] += 1
        return actions, 1.0 / np.sqrt(tried[rows, at, actions])

    def _update(self) -> None:
        """Learn from the steps since the last update, and begin to gather anew."""
        options, kept = self._options, self._roll_out
        rows = torch.arange(len(kept.actions))[:, None]
        old = (self._policy.copy(), self._value.copy())
        observations, masks = torch.from_numpy(kept.observations), torch.from_numpy(kept.masks)
        actions = torch.from_numpy(kept.actions)[..., None]
        drawn = torch.from_numpy(kept.drawn.astype(np.float32))
        with torch.no_grad():
            old_logs = self._logs(observations, masks)
            old_taken = old_logs.gather(2, actions)[..., 0]
            values = self._value(observations)[..., 0].numpy()
            ahead = self._value(torch.from_numpy(self._observed)[:, None])[:, 0, 0].numpy()
        advantages = kept.advantages(
            self._worth(), values, ahead, options.gamma, options.gae_lambda
        )
        returns = torch.from_numpy(advantages + values)
        gains = torch.from_numpy(kept.normalised(advantages))
        for _ in range(options.epochs):
            order = np.stack([g.permutation(options.rollout) for g in self._generators])
            for first in range(0, options.rollout, options.batch):
                some = torch.from_numpy(order[:, first : first + options.batch])
                weights = _shares(drawn[rows, some])
                logs = self._logs(observations[rows, some], masks[rows, some])
                taken = logs.gather(2, actions[rows, some])[..., 0]
                ratio = (taken - old_taken[rows, some]).exp()
                clipped = ratio.clamp(1.0 - options.clip, 1.0 + options.clip)
                gain = gains[rows, some]
                policy_loss = -torch.minimum(ratio * gain, clipped * gain)
                told = self._value(observations[rows, some])[..., 0]
                value_loss = (told - returns[rows, some]) ** 2
                loss = policy_loss - self._entropy_weight() * _entropy(logs) + value_loss
                self._learn((loss * weights).sum())
        with torch.no_grad():
            logs = self._logs(observations, masks)
            ratio = (logs.gather(2, actions)[..., 0] - old_taken).exp()
            told = self._value(observations)[..., 0]
            figures = (
                -ratio * gains,
                (told - returns) ** 2,
                _entropy(logs),
                ((ratio - 1.0).abs() > options.clip).float(),
                (old_logs.exp() * (old_logs - logs)).sum(2),
            )
            means = [(one * _shares(drawn)).sum(1).double().numpy() for one in figures]
        self._gather_anew(np.stack(means), old)

    def _gather_anew(
        self, curves: NDArray[np.float64], old: tuple[BatchedNetwork, BatchedNetwork]
    ) -> None:
        """Take note of an update; runs that it broke stay for good what they were before."""
        networks = (self._policy, self._value)
        for run in np.flatnonzero(~(networks[0].is_sane() & networks[1].is_sane())).tolist():
            reason = (
                f"its networks are no longer finite after {self.steps:,} steps; lower learning_rate"
            )
            self.failed.setdefault(run, reason)
            with torch.no_grad():
                for network, before in zip(networks, old, strict=True):
                    for now, then in zip(network.parameters, before.parameters, strict=True):
                        now[run] = then[run]
        self._curves += curves
        self._updates += 1
        self._roll_out.filled = 0
        self._due[:] = self._follows
        for run, record in enumerate(self._episodes):
            # An episode under way has followed two policies now, unless it is yet to begin.
            record.greedy = self._follows and record.length == 0
            if record.greedy:
                self._due[run] = False

    def _worth(self) -> NDArray[np.float64]:
        """Return what is learned from instead of the rewards, shape (runs, rollout)."""
        options, paid, ends = self._options, self._roll_out.paid, self._roll_out.ends
        for run in np.flatnonzero(np.isnan(self._unit)).tolist():
            losses = -paid[run][(ends[run] == GOES_ON) & (paid[run] < 0)]
            if losses.size:
                self._unit[run] = np.median(losses)
        unit = np.nan_to_num(self._unit, nan=np.inf)[:, None]
        complete, over = ends == COMPLETE, ends != GOES_ON
        success = complete.sum(axis=1) / np.maximum(1, over.sum(axis=1))
        share = (options.steps_worth / self._limit * success)[:, None]
        worth: NDArray[np.float64] = np.maximum(share * (paid / unit), -share * options.step_floor)
        worth += self._scheduled(options.novelty, 0.0) * self._roll_out.novelties
        worth += np.where(complete, options.complete, 0.0)
        worth -= np.where(over & ~complete, options.failure, 0.0)
        return worth

    def _learn(self, loss: torch.Tensor) -> None:
        """Follow the gradient of a loss that is a sum over runs, cut for every run by itself."""
        for parameter in (*self._policy.parameters, *self._value.parameters):
            parameter.grad = None
        loss.backward()  # type: ignore[no-untyped-call]
        zero = torch.zeros(len(self._generators))
        for network in (self._policy, self._value):
            gradients = [p.grad for p in network.parameters if p.grad is not None]
            # Added one by one: a sum over the first axis is rounded by how many runs there are.
            length = sum((g.square().flatten(1).sum(1) for g in gradients), zero).sqrt()
            factor = self._options.max_gradient / length.clamp(min=1e-12)
            for gradient in gradients:
                gradient.mul_(factor.clamp(max=1.0)[:, None, None])
        self._adam.follow(self._rate())

    def _logs(self, observations: torch.Tensor, masks: torch.Tensor) -> torch.Tensor:
        """Return logarithms of the probabilities of all actions; very low where not allowed."""
        # Not minus infinity: that times a probability of 0 would be no number.
        scores = self._policy(observations).masked_fill(~masks, -1e9)
        return torch.log_softmax(scores, 2)

    def _rate(self) -> float:
        """Return the learning rate as it is now."""
        return self._scheduled(self._options.learning_rate, self._options.learning_rate_end)

    def _entropy_weight(self) -> float:
        """Return the weight of entropy as it is now."""
        return self._scheduled(self._options.entropy, self._options.entropy_end)

    def _scheduled(self, first: float, last: float) -> float:
        return first + (last - first) * min(1.0, self.steps / self._total)

    def _policy_of(self, run: int) -> NetworkPolicy:
        return self._policy.policy(run, self._actions)


def _shares(drawn: torch.Tensor) -> torch.Tensor:
    """Return weights that sum to 1 over the steps drawn; to 0 where there are none."""
    return drawn / drawn.sum(1, keepdim=True).clamp(min=1.0)


def _entropy(logs: torch.Tensor) -> torch.Tensor:
    """Return the entropy of every row of logarithms of probabilities [nat]."""
    return -(logs.exp() * logs).sum(2)
