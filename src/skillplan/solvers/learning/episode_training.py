"""Base of trainings: episodes in progress, the best evaluated policies, and snapshots."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from skillplan.env.skill_vector_env import SkillVectorEnv
from skillplan.env.transition_table import COMPLETE, INFEASIBLE, OUT_OF_TIME
from skillplan.solvers.learning.learner import (
    End,
    Episode,
    Learned,
    LearnerOptions,
    Snapshot,
    Training,
    is_certain,
)
from skillplan.solvers.learning.network_policy import NetworkPolicy

# Costs that differ by less are equal.
_TOLERANCE = 1e-9
_ENDS: Mapping[int, End] = {
    COMPLETE: "complete",
    INFEASIBLE: "infeasible",
    OUT_OF_TIME: "out-of-time",
}

Arrays = dict[str, NDArray[Any]]


def read_array(
    arrays: Mapping[str, NDArray[Any]], name: str, shape: tuple[int, ...]
) -> NDArray[Any]:
    """Return an array of a snapshot.

    Raises
    ------
    ValueError
        If it is missing or of another shape.
    """
    if name not in arrays or arrays[name].shape != shape:
        raise ValueError(f"The snapshot's {name} is missing or of another shape.")
    return arrays[name]


def copy_arrays(prefix: str, arrays: Mapping[str, NDArray[Any]]) -> Arrays:
    """Return copies of arrays for a snapshot, their names preceded by a prefix and a dot."""
    return {f"{prefix}.{key}": array.copy() for key, array in arrays.items()}


def restore_arrays(
    prefix: str, arrays: Mapping[str, NDArray[Any]], snapshot: Mapping[str, NDArray[Any]]
) -> None:
    """Write the copies of `copy_arrays` back into the arrays.

    Raises
    ------
    ValueError
        If one is missing or of another shape.
    """
    for key, array in arrays.items():
        np.copyto(array, read_array(snapshot, f"{prefix}.{key}", array.shape))


@dataclass
class EpisodeRecord:
    """Steps of an episode in progress.

    Parameters
    ----------
    indices, actions
        Index of the observation, see `ObservationCounts`, and action of every step.
    costs, rewards
        Cost and environment reward of every step.
    greedy
        True if all actions were the policy's own.
    planned
        True if an action was planned with a learned model.
    """

    indices: list[int] = field(default_factory=list)
    actions: list[int] = field(default_factory=list)
    costs: list[float] = field(default_factory=list)
    rewards: list[float] = field(default_factory=list)
    greedy: bool = True
    planned: bool = False

    @property
    def length(self) -> int:
        """Number of steps."""
        return len(self.actions)

    @property
    def last_action(self) -> int:
        """Latest action; -1 before the first step."""
        return self.actions[-1] if self.actions else -1

    def add(self, index: int, action: int, cost: float, reward: float) -> None:
        """Append a step."""
        self.indices.append(index)
        self.actions.append(action)
        self.costs.append(cost)
        self.rewards.append(reward)

    def finish(self, run: int, step: int, end: int) -> Episode:
        """Return the finished episode of a run.

        Parameters
        ----------
        run
            Index of the run.
        step
            Environment steps that the run has done.
        end
            End code of the environment.
        """
        return Episode(
            run,
            step,
            _ENDS[end],
            tuple(self.actions),
            sum(self.costs),
            sum(self.rewards),
            self.greedy,
            self.planned,
        )

    def document(self) -> dict[str, Any]:
        """Return the record as JSON values for `read`."""
        document = {
            "situations": list(self.indices),
            "actions": list(self.actions),
            "costs": list(self.costs),
            "rewards": list(self.rewards),
            "greedy": self.greedy,
        }
        return {**document, "planned": True} if self.planned else document

    @classmethod
    def read(cls, document: Mapping[str, Any]) -> EpisodeRecord:
        """Return the record of a document."""
        return cls(
            indices=list(document["situations"]),
            actions=list(document["actions"]),
            costs=list(document["costs"]),
            rewards=list(document["rewards"]),
            greedy=bool(document["greedy"]),
            planned=bool(document.get("planned", False)),
        )


@dataclass(frozen=True)
class CompletedEpisode:
    """An episode that completed the task.

    Parameters
    ----------
    cost
        Its cost.
    observations, masks
        Observation and mask before every action, shapes (n, features) and (n, actions).
    actions
        Shape (n,).
    """

    cost: float
    observations: NDArray[np.float32]
    masks: NDArray[np.bool_]
    actions: NDArray[np.int64]

    def is_followed_by(self, policy: NetworkPolicy) -> bool:
        """Return whether a policy takes the same actions throughout."""
        # Scores of a diverged network overflow; the training reports it.
        with np.errstate(over="ignore", invalid="ignore"):
            greedy = policy.greedy(self.observations, self.masks)
        return bool((greedy == self.actions).all())


class CheapestSteps(NamedTuple):
    """Steps of every run's cheapest episode, padded to equal length.

    Parameters
    ----------
    observations, masks, actions
        Shapes (runs, rows, features), (runs, rows, actions) and (runs, rows, 1).
    shares
        Weight of every step, shape (runs, rows): 1 / length, and 0 for padding.
    """

    observations: NDArray[np.float32]
    masks: NDArray[np.bool_]
    actions: NDArray[np.int64]
    shares: NDArray[np.float32]


class BestPolicies:
    """Keeps every run's cheapest evaluated policy and cheapest episode.

    Without chance, a policy that takes the actions of an episode costs as much as the episode.
    Every finished episode is therefore an evaluation: the current policy is compared with it and
    with the cheapest episode so far. Moller et al., section 5, evaluate the best model of a
    session.

    Parameters
    ----------
    runs
        Number of runs.
    keeps
        True if one episode shows the cost of a policy; otherwise no policy is kept.
    """

    def __init__(self, runs: int, *, keeps: bool) -> None:
        self._keeps = keeps
        self._best: list[tuple[float, int, NetworkPolicy] | None] = [None] * runs
        self._cheapest: list[CompletedEpisode | None] = [None] * runs

    def compare(
        self, run: int, step: int, episode: CompletedEpisode | None, policy: NetworkPolicy
    ) -> None:
        """Compare a run's policy with an episode that has ended.

        Parameters
        ----------
        run
            Index of the run.
        step
            Environment steps that it has done.
        episode
            The episode; None if it did not complete the task.
        policy
            The run's current policy.
        """
        if not self._keeps:
            return
        cheapest = self._cheapest[run]
        if episode is not None and (cheapest is None or episode.cost < cheapest.cost - _TOLERANCE):
            self._cheapest[run] = cheapest = episode
        best = self._best[run]
        for candidate in (cheapest, episode):
            if candidate is None or (best is not None and candidate.cost >= best[0] - _TOLERANCE):
                continue
            if candidate.is_followed_by(policy):
                self._best[run] = (candidate.cost, step, policy)
                return

    def best(self, run: int) -> NetworkPolicy | None:
        """Return a run's cheapest evaluated policy; None without one."""
        best = self._best[run]
        return None if best is None else best[2]

    def cheapest(self, run: int) -> CompletedEpisode | None:
        """Return a run's cheapest episode that completed the task; None without one."""
        return self._cheapest[run]

    def cheapest_steps(self, rows: int, actions: int) -> CheapestSteps:
        """Return the cheapest episodes of all runs, padded.

        Parameters
        ----------
        rows
            Steps after padding: equal for all runs, so that no run depends on another.
        actions
            Number of actions.
        """
        runs = len(self._cheapest)
        width = max((ep.observations.shape[1] for ep in self._cheapest if ep), default=0)
        steps = CheapestSteps(
            np.zeros((runs, rows, width), dtype=np.float32),
            np.zeros((runs, rows, actions), dtype=np.bool_),
            np.zeros((runs, rows, 1), dtype=np.int64),
            np.zeros((runs, rows), dtype=np.float32),
        )
        for run, episode in enumerate(self._cheapest):
            if episode is not None:
                length, known = episode.masks.shape
                steps.observations[run, :length] = episode.observations
                steps.masks[run, :length, :known] = episode.masks
                steps.actions[run, :length, 0] = episode.actions
                steps.shares[run, :length] = 1.0 / length
        return steps

    def learned(self, run: int, last: NetworkPolicy) -> Learned:
        """Return a run's policies, given the current one."""
        best = self._best[run]
        return Learned(last) if best is None else Learned(last, best[2], best[0], best[1])

    def arrays(self, name: str) -> Arrays:
        """Return copies of all arrays for `read`."""
        arrays: Arrays = {}
        for run, best in enumerate(self._best):
            if best is not None:
                for layer, weight in enumerate(best[2].weights):
                    arrays[f"{name}.{run}.{layer}.weight"] = weight.copy()
                    arrays[f"{name}.{run}.{layer}.bias"] = best[2].biases[layer].copy()
            episode = self._cheapest[run]
            if episode is not None:
                arrays[f"{name}.{run}.observations"] = episode.observations
                arrays[f"{name}.{run}.masks"] = episode.masks
                arrays[f"{name}.{run}.actions"] = episode.actions
        return arrays

    def document(self) -> list[dict[str, Any]]:
        """Return costs and steps as JSON values for `read`."""
        return [
            {
                "best": None if best is None else {"cost": best[0], "step": best[1]},
                "cheapest": None if episode is None else episode.cost,
            }
            for best, episode in zip(self._best, self._cheapest, strict=True)
        ]

    def read(
        self, name: str, arrays: Mapping[str, NDArray[Any]], documents: Sequence[Mapping[str, Any]]
    ) -> None:
        """Restore what `arrays` and `document` returned.

        Raises
        ------
        ValueError
            If they belong to other runs.
        """
        if len(documents) != len(self._best):
            raise ValueError("The snapshot's kept policies are of other runs.")
        try:
            for run, document in enumerate(documents):
                self._read_run(f"{name}.{run}", run, arrays, document)
        except KeyError as error:
            raise ValueError(f"The snapshot's {error} is missing.") from None

    def _read_run(
        self, name: str, run: int, arrays: Mapping[str, NDArray[Any]], document: Mapping[str, Any]
    ) -> None:
        self._best[run], self._cheapest[run] = None, None
        best, cost = document["best"], document["cheapest"]
        if best is not None:
            layers = sum(key.startswith(f"{name}.") and key.endswith(".bias") for key in arrays)
            policy = NetworkPolicy(
                tuple(np.array(arrays[f"{name}.{layer}.weight"]) for layer in range(layers)),
                tuple(np.array(arrays[f"{name}.{layer}.bias"]) for layer in range(layers)),
            )
            self._best[run] = (float(best["cost"]), int(best["step"]), policy)
        if cost is not None:
            keys = ("observations", "masks", "actions")
            self._cheapest[run] = CompletedEpisode(
                float(cost), *(np.array(arrays[f"{name}.{key}"]) for key in keys)
            )


class EpisodeTraining(Training):
    """Runs in progress, one environment each.

    Parameters
    ----------
    options
        Options of the learner, with derived values filled in.
    env
        The environments.
    seeds
        One for every run.
    steps
        Environment steps of every run in all.
    """

    def __init__(
        self, options: LearnerOptions, env: SkillVectorEnv, seeds: Sequence[int], steps: int
    ) -> None:
        self.steps, self.failed = 0, {}
        # Length of the schedules; their values stay constant afterwards.
        self._env, self._total = env, options.schedule_steps or steps
        task = env.models[0].task
        self._actions, self._limit = len(task.skills), task.step_limit
        # Under chance or with several boards, one episode does not show the cost of a policy.
        self._one_episode_suffices = is_certain([model.task for model in env.models])
        self._best = BestPolicies(len(seeds), keeps=self._one_episode_suffices)
        self._generators = [np.random.default_rng([seed, 1]) for seed in seeds]
        self._episodes = [EpisodeRecord() for _ in seeds]

    def learned(self, run: int) -> Learned:
        """Return a run's current policy and its best evaluated one."""
        return self._best.learned(run, self._policy_of(run))

    def snapshot(self) -> Snapshot:
        """Return everything that a resumed training needs."""
        notes = {
            "steps": self.steps,
            "failed": {str(run): reason for run, reason in self.failed.items()},
            "generators": [generator.bit_generator.state for generator in self._generators],
            "episodes": [record.document() for record in self._episodes],
            "kept": self._best.document(),
            "env": self._env.state(),
        }
        arrays = {**self._own_arrays(), **self._best.arrays("kept")}
        return Snapshot(arrays, notes | self._own_notes())

    def restore(self, snapshot: Snapshot) -> None:
        """Resume from a snapshot.

        Raises
        ------
        ValueError
            If it does not fit these options.
        """
        arrays, notes = snapshot.arrays, snapshot.notes
        self._read_own(arrays, notes)
        self._best.read("kept", arrays, notes["kept"])
        self.steps = int(notes["steps"])
        self.failed = {int(run): str(reason) for run, reason in notes["failed"].items()}
        for generator, state in zip(self._generators, notes["generators"], strict=True):
            generator.bit_generator.state = state
        self._episodes = [EpisodeRecord.read(document) for document in notes["episodes"]]
        observations, infos = self._env.restore(notes["env"])
        self._observe(observations, infos["action_mask"])

    @abstractmethod
    def _observe(self, observations: NDArray[np.float32], masks: NDArray[np.bool_]) -> None:
        """Store the current observation and mask of every run."""

    @abstractmethod
    def _policy_of(self, run: int) -> NetworkPolicy:
        """Return a run's current policy.

        Raises
        ------
        ValueError
            If a weight is not finite.
        """

    @abstractmethod
    def _own_arrays(self) -> Arrays:
        """Return the algorithm's own arrays of a snapshot."""

    @abstractmethod
    def _own_notes(self) -> dict[str, Any]:
        """Return the algorithm's own notes of a snapshot, as JSON values."""

    @abstractmethod
    def _read_own(self, arrays: Mapping[str, NDArray[Any]], notes: Mapping[str, Any]) -> None:
        """Restore what `_own_arrays` and `_own_notes` returned.

        Raises
        ------
        ValueError
            If it has another shape.
        """
