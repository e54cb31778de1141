"""Networks, replay memory and update of Double DQN.

Mnih et al., "Human-level control through deep reinforcement learning" (2015); van Hasselt et al.,
"Deep reinforcement learning with double Q-learning" (2016). Masks also hold in the targets.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from skillplan.env.transition_table import COMPLETE, GOES_ON
from skillplan.solvers.learning.episode_training import Arrays, read_array
from skillplan.solvers.learning.network_policy import NetworkPolicy
from skillplan.solvers.learning.observation_counts import ObservationCounts, double_rows, take_rows
from skillplan_torch.networks import BatchedAdam, BatchedNetwork, padded

# Initial values are small, so that untried actions look alike.
_LAST_GAIN = 0.3


class QNetworks:
    """Values of actions, of every run.

    Parameters
    ----------
    hidden
        Units of every hidden layer.
    features, actions
        Numbers of features and actions.
    target_rate
        Share by which an update moves the target network, in (0, 1].
    generators
        One for every run; draws its weights.
    """

    def __init__(
        self,
        hidden: Sequence[int],
        features: int,
        actions: int,
        target_rate: float,
        generators: Sequence[np.random.Generator],
    ) -> None:
        self._actions, self._target_rate = actions, target_rate
        sizes = [features, *hidden, padded(actions)]
        self._online = BatchedNetwork(sizes, generators, last_gain=_LAST_GAIN)
        self._target = self._online.copy()
        self._adam = BatchedAdam(self._online.parameters)

    def evaluate(self, observations: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return values, shape (runs, actions), of one observation per run, without gradients."""
        # Values of a diverged network overflow; the training reports it.
        with np.errstate(over="ignore", invalid="ignore"):
            values: NDArray[np.float32] = self._online.evaluate(observations)[..., : self._actions]
        return values

    def values(self, observations: torch.Tensor) -> torch.Tensor:
        """Return values, shape (runs, n, actions), of observations, shape (runs, n, features)."""
        return self._online(observations)[..., : self._actions]

    def target_values(self, observations: torch.Tensor) -> torch.Tensor:
        """Return the target network's values, of the same shape."""
        return self._target(observations)[..., : self._actions]

    def minimise(self, loss: torch.Tensor, rate: float) -> None:
        """Take a step down the gradient of a loss, and move the target network."""
        self._adam.minimise(loss, rate)
        self._target.approach(self._online, self._target_rate)

    def is_finite(self) -> NDArray[np.bool_]:
        """Return whether the network of a run is finite, shape (runs,)."""
        return self._online.is_finite()

    def policy(self, run: int) -> NetworkPolicy:
        """Return a run's network as a policy; raises ValueError if it is not finite."""
        return self._online.policy(run, self._actions)

    def load(self, run: int, network: NetworkPolicy) -> None:
        """Copy a network to a run, as its online and its target network."""
        self._online.load(run, network)
        self._target.load(run, network)

    def arrays(self) -> Arrays:
        """Return copies of all arrays for `read`."""
        return {
            **self._online.arrays("network"),
            **self._target.arrays("target"),
            **self._adam.arrays("adam"),
        }

    def read(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore what `arrays` returned; raises ValueError if it has another shape."""
        self._online.read("network", arrays)
        self._target.read("target", arrays)
        self._adam.read("adam", arrays)


_FIRST_SIZE = 1_024
# Attributes of a transition by their names in a snapshot.
_COLUMNS = {
    "situation": "observation",
    "action": "action",
    "reward": "reward",
    "end": "end",
    "following": "next_observation",
    "seen": "seen",
    "tried": "tried",
}


class ReplayMemory:
    """Transitions of several runs, drawn uniformly; the oldest are overwritten.

    Parameters
    ----------
    runs
        Number of runs.
    capacity
        Most transitions of a run, >= 1.
    distinct
        Addition: store each distinct transition once, with the mean of its rewards. A transition
        is then weighted by its share among the outcomes of its observation and action.

    Attributes
    ----------
    observation, action, next_observation
        Indices, shape (runs, size); observations by their index in `ObservationCounts`.
    reward
        Rewards.
    end
        End codes of the environment; `GOES_ON` if the episode went on.
    seen, tried
        Numbers of times that the transition and its action were taken; 1 unless distinct.
    """

    def __init__(self, runs: int, capacity: int, *, distinct: bool = False) -> None:
        self._capacity, self._distinct = capacity, distinct
        self._slots: list[dict[tuple[int, ...], int]] = [{} for _ in range(runs)]
        self._choices: list[dict[tuple[int, int], list[int]]] = [{} for _ in range(runs)]
        self._added = [0] * runs
        shape = (runs, min(capacity, _FIRST_SIZE))
        self.observation, self.action, self.next_observation, self.end = (
            np.zeros(shape, dtype=np.int64) for _ in range(4)
        )
        self.reward = np.zeros(shape)
        self.seen, self.tried = (np.zeros(shape, dtype=np.int64) for _ in range(2))

    def add(
        self,
        run: int,
        observation: int,
        action: int,
        reward: float,
        end: int,
        next_observation: int,
    ) -> None:
        """Store a transition of a run; arguments as the attributes."""
        key = (observation, action, next_observation, end)
        slot = self._slots[run].get(key) if self._distinct else None
        if slot is None:
            slot = self._free_slot(run)
            self.observation[run, slot], self.action[run, slot] = observation, action
            self.next_observation[run, slot], self.end[run, slot] = next_observation, end
            self.reward[run, slot] = reward
            self.seen[run, slot] = self.tried[run, slot] = 1
            if self._distinct:
                self._slots[run][key] = slot
                self._choices[run].setdefault(key[:2], []).append(slot)
        else:
            self.seen[run, slot] += 1
            mean = self.reward[run, slot]
            self.reward[run, slot] += (reward - mean) / self.seen[run, slot]
        if self._distinct:
            self._count_tries(run, key[:2])

    def draw(
        self, generators: Sequence[np.random.Generator], count: int
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return slots of `count` transitions of every run, and their weights.

        Returns
        -------
        slots, weights
            Shapes (runs, count).
        """
        uniforms = np.stack([generator.random(count) for generator in generators])
        sizes = np.array([self.size(run) for run in range(len(generators))])[:, None]
        slots = np.minimum((uniforms * sizes).astype(np.int64), sizes - 1)
        return slots, take_rows(self.seen, slots) / take_rows(self.tried, slots)

    def size(self, run: int) -> int:
        """Return the number of transitions of a run."""
        return min(self._added[run], self._capacity)

    def arrays(self, name: str) -> Arrays:
        """Return copies of all arrays for `read`."""
        most = max(1, *(self.size(run) for run in range(len(self._added))))
        arrays = {key: getattr(self, column)[:, :most].copy() for key, column in _COLUMNS.items()}
        arrays["added"] = np.array(self._added, dtype=np.int64)
        return {f"{name}.{key}": array for key, array in arrays.items()}

    def read(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore what `arrays` returned.

        Raises
        ------
        ValueError
            If it has another shape.
        """
        runs = len(self._added)
        self._added = read_array(arrays, f"{name}.added", (runs,)).tolist()
        most = max(1, *(self.size(run) for run in range(runs)))
        while self.reward.shape[1] < most:
            self._grow()
        for key, column in _COLUMNS.items():
            getattr(self, column)[:, :most] = read_array(arrays, f"{name}.{key}", (runs, most))
        for run in range(runs if self._distinct else 0):
            self._slots[run], self._choices[run] = {}, {}
            for slot in range(self.size(run)):
                transition = self._key(run, slot)
                self._slots[run][transition] = slot
                self._choices[run].setdefault(transition[:2], []).append(slot)

    def _count_tries(self, run: int, choice: tuple[int, int]) -> None:
        """Set how often an action was taken at an observation, for all its outcomes."""
        slots = self._choices[run][choice]
        self.tried[run, slots] = self.seen[run, slots].sum()

    def _key(self, run: int, slot: int) -> tuple[int, int, int, int]:
        return (
            int(self.observation[run, slot]),
            int(self.action[run, slot]),
            int(self.next_observation[run, slot]),
            int(self.end[run, slot]),
        )

    def _free_slot(self, run: int) -> int:
        slot = self._added[run] % self._capacity
        if self._added[run] >= self._capacity and self._distinct:
            key = self._key(run, slot)
            del self._slots[run][key]
            self._choices[run][key[:2]].remove(slot)
            self._count_tries(run, key[:2])
        elif slot == self.reward.shape[1]:
            self._grow()
        self._added[run] += 1
        return slot

    def _grow(self) -> None:
        for column in _COLUMNS.values():
            setattr(self, column, double_rows(getattr(self, column)))


class Rewards:
    """Rewards of transitions, as a Q-network learns them.

    Parameters
    ----------
    step_factor
        Factor on rewards of steps.
    complete, failure
        Reward for completing, and loss for failing.
    gamma
        Discount factor.
    """

    def __init__(self, step_factor: float, complete: float, failure: float, gamma: float) -> None:
        self._step_factor, self._complete, self._failure = step_factor, complete, failure
        self._gamma = gamma

    def of(self, rewards: NDArray[np.float64], end: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the rewards of transitions with these rewards of steps and ends."""
        scaled = self._step_factor * rewards
        scaled += np.where(end == COMPLETE, self._complete, 0.0)
        scaled -= np.where((end != COMPLETE) & (end != GOES_ON), self._failure, 0.0)
        return scaled

    def discounts(self, end: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the factor on the next value: 0 at the end of an episode."""
        return np.where(end == GOES_ON, self._gamma, 0.0)


def double_q_values(
    networks: QNetworks,
    counts: ObservationCounts,
    observations: NDArray[np.int64],
    bonus: NDArray[np.float64] | None = None,
) -> NDArray[np.float32]:
    """Return values of the best next actions, shape (runs, batch).

    The online network chooses among the allowed actions, and the target network evaluates.

    Parameters
    ----------
    networks, counts
        Networks, and observations and masks by index.
    observations
        Indices of the next observations, shape (runs, batch).
    bonus
        Addition: bonus on the values, shape (runs, batch, actions).
    """
    with torch.no_grad():
        features = torch.from_numpy(take_rows(counts.observations, observations))
        barred = torch.from_numpy(~take_rows(counts.masks, observations))
        online = networks.values(features).masked_fill(barred, -torch.inf)
        target = networks.target_values(features)
        if bonus is not None:
            added = torch.from_numpy(bonus.astype(np.float32))
            online, target = online + added, target + added
        best = online.argmax(2, keepdim=True)
        values: NDArray[np.float32] = target.gather(2, best)[..., 0].numpy()
    return values


def td_loss(
    networks: QNetworks,
    features: NDArray[np.float32],
    actions: NDArray[np.int64],
    targets: NDArray[np.float64],
    weights: NDArray[np.float64],
    *,
    squared: bool = False,
) -> tuple[torch.Tensor, NDArray[np.float64]]:
    """Return the loss summed over runs, and mean loss and value of every run.

    Parameters
    ----------
    networks
        The networks.
    features, actions
        Observations and actions of a batch, shapes (runs, batch, features) and (runs, batch).
    targets, weights
        Shape (runs, batch).
    squared
        True for squared errors instead of Huber's loss.

    Returns
    -------
    loss, means
        The latter of shape (2, runs).
    """
    taken = torch.from_numpy(actions)[..., None]
    values = networks.values(torch.from_numpy(features)).gather(2, taken)[..., 0]
    goals = torch.from_numpy(targets.astype(np.float32))
    shares = torch.from_numpy(weights.astype(np.float32))
    loss = torch.nn.functional.mse_loss if squared else torch.nn.functional.huber_loss
    losses = loss(values, goals, reduction="none") * shares
    means = losses.mean(1)
    with torch.no_grad():
        figures = np.stack([means.numpy(), values.mean(1).numpy()]).astype(np.float64)
    return means.sum(), figures
