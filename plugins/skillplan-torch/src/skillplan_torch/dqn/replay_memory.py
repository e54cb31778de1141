"""What runs remember of their steps, to be learned from again and again.

Every distinct transition is remembered once, however often it was seen, and all are drawn evenly:
so what was met seldom is learned from as often as what is met in every episode.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.learning.episode_training import read_array
from skillplan.solvers.learning.observation_counts import double_rows, take_rows

_FIRST_SIZE = 1_024
# What a transition has, by its name in a snapshot.
_COLUMNS = {
    "situation": "observation",
    "action": "action",
    "reward": "reward",
    "end": "end",
    "following": "next_observation",
    "seen": "seen",
    "tried": "tried",
    "share": "share",
}


class ReplayMemory:
    """Transitions of several runs.

    Parameters
    ----------
    runs
        How many.
    capacity
        The most transitions that a run remembers; the oldest are forgotten, >= 1.

    Attributes
    ----------
    observation, action, next_observation
        Indices, shape (runs, size); of observations those of `ObservationCounts`.
    reward
        What the learner makes of the reward, on average: where an observation leaves out what costs
        depend on, it is not always the same.
    end
        How the episode ended with it; 0 where it went on.
    seen, tried
        How often the transition was seen, and its choice tried.
    share
        How likely the outcome is, see `pool`; NaN where it was not worked out.
    """

    def __init__(self, runs: int, capacity: int) -> None:
        self._capacity = capacity
        self._slots: list[dict[tuple[int, ...], int]] = [{} for _ in range(runs)]
        self._choices: list[dict[tuple[int, int], list[int]]] = [{} for _ in range(runs)]
        self._added = [0] * runs
        shape = (runs, min(capacity, _FIRST_SIZE))
        self.observation, self.action, self.next_observation, self.end = (
            np.zeros(shape, dtype=np.int64) for _ in range(4)
        )
        self.reward = np.zeros(shape)
        self.share = np.full(shape, np.nan)
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
        """Remember a transition of a run.

        Parameters
        ----------
        run
            Whose.
        observation, action
            Index of what was observed, and what was done.
        reward
            What the learner makes of it.
        end
            How the episode ended with it; 0 where it went on.
        next_observation
            Index of what was observed after it.
        """
        key = (observation, action, next_observation, end)
        slot = self._slots[run].get(key)
        if slot is None:
            slot = self._free(run)
            self._slots[run][key] = slot
            self._choices[run].setdefault((observation, action), []).append(slot)
            self.observation[run, slot], self.action[run, slot] = observation, action
            self.next_observation[run, slot], self.end[run, slot] = next_observation, end
            self.share[run, slot], self.seen[run, slot] = np.nan, 0
            self.reward[run, slot] = 0.0
        self.seen[run, slot] += 1
        self.reward[run, slot] += (reward - self.reward[run, slot]) / self.seen[run, slot]
        self._count(run, (observation, action))

    def draw(
        self, generators: Sequence[np.random.Generator], count: int
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return so many transitions of every run, and how much each of them counts.

        Outcomes of one and the same choice count as often as they were seen.

        Returns
        -------
        slots, weights
            Shapes (runs, count).
        """
        uniforms = np.stack([generator.random(count) for generator in generators])
        sizes = np.array([self.size(run) for run in range(len(generators))])[:, None]
        slots = np.minimum((uniforms * sizes).astype(np.int64), sizes - 1)
        counted = take_rows(self.seen, slots) / take_rows(self.tried, slots)
        shares = take_rows(self.share, slots)
        return slots, np.where(np.isnan(shares), counted, shares)

    def pool(self, run: int, observations: NDArray[np.float32]) -> None:
        """Work out how likely outcomes are, over all observations in which an action was taken.

        Outcomes of one and the same choice differ in some features, such as whether a part is
        held. Which of these an action leads to is as likely wherever it is taken.

        Parameters
        ----------
        run
            Whose.
        observations
            By index, shape (n, features).
        """
        size = self.size(run)
        actions, following = self.action[run, :size], self.next_observation[run, :size]
        differing: dict[int, NDArray[np.bool_]] = {}
        for (_, action), slots in self._choices[run].items():
            if len(slots) > 1:
                after = observations[self.next_observation[run, slots]]
                differs = (after != after[:1]).any(axis=0)
                differing[action] = differing.get(action, False) | differs
        for action, differs in differing.items():
            members = np.flatnonzero(actions == action)
            after = observations[following[members]][:, differs]
            _, kinds = np.unique(after, axis=0, return_inverse=True)
            counts = np.bincount(kinds, weights=self.seen[run, members])
            self.share[run, members] = counts[kinds] / counts.sum()

    def size(self, run: int) -> int:
        """Return how many transitions a run remembers."""
        return min(self._added[run], self._capacity)

    def arrays(self, name: str) -> dict[str, NDArray[Any]]:
        """Return copies of all that is remembered, to be read by `read`."""
        most = max(1, *(self.size(run) for run in range(len(self._added))))
        found = {key: getattr(self, column)[:, :most].copy() for key, column in _COLUMNS.items()}
        found["added"] = np.array(self._added, dtype=np.int64)
        return {f"{name}.{key}": array for key, array in found.items()}

    def read(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over what `arrays` returned.

        Raises
        ------
        ValueError
            If it is of another shape.
        """
        runs = len(self._added)
        self._added = read_array(arrays, f"{name}.added", (runs,)).tolist()
        most = max(1, *(self.size(run) for run in range(runs)))
        while self.reward.shape[1] < most:
            self._grow()
        for key, column in _COLUMNS.items():
            getattr(self, column)[:, :most] = read_array(arrays, f"{name}.{key}", (runs, most))
        for run in range(runs):
            self._slots[run], self._choices[run] = {}, {}
            for slot in range(self.size(run)):
                transition = self._key(run, slot)
                self._slots[run][transition] = slot
                self._choices[run].setdefault(transition[:2], []).append(slot)

    def _count(self, run: int, choice: tuple[int, int]) -> None:
        """Say of all outcomes of a choice how often it was tried."""
        slots = self._choices[run][choice]
        if len(slots) == 1:
            self.tried[run, slots[0]] = self.seen[run, slots[0]]
            return
        self.tried[run, slots] = self.seen[run, slots].sum()

    def _key(self, run: int, slot: int) -> tuple[int, int, int, int]:
        return (
            int(self.observation[run, slot]),
            int(self.action[run, slot]),
            int(self.next_observation[run, slot]),
            int(self.end[run, slot]),
        )

    def _free(self, run: int) -> int:
        slot = self._added[run] % self._capacity
        if self._added[run] >= self._capacity:
            key = self._key(run, slot)
            del self._slots[run][key]
            self._choices[run][key[:2]].remove(slot)
            self._count(run, key[:2])
        elif slot == self.reward.shape[1]:
            self._grow()
        self._added[run] += 1
        return slot

    def _grow(self) -> None:
        for column in _COLUMNS.values():
            setattr(self, column, double_rows(getattr(self, column)))
