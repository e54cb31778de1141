"""Indices of the observations that runs have met, and counts of the actions taken there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.learning.episode_training import Arrays, read_array

_FIRST_SIZE = 512


class ObservationCounts:
    """Numbers the observations of every run from 0, in the order of their first visits.

    Parameters
    ----------
    runs, features, actions
        Numbers of runs, features and actions.

    Attributes
    ----------
    observations, masks
        By run and index, shapes (runs, size, features) and (runs, size, actions).
    visits
        Number of times that each action was taken there, shape (runs, size, actions).
    """

    def __init__(self, runs: int, features: int, actions: int) -> None:
        self._indices: list[dict[bytes, int]] = [{} for _ in range(runs)]
        self.observations = np.zeros((runs, _FIRST_SIZE, features), dtype=np.float32)
        self.masks = np.zeros((runs, _FIRST_SIZE, actions), dtype=np.bool_)
        self.visits = np.zeros((runs, _FIRST_SIZE, actions), dtype=np.int64)

    def indices(
        self, observations: NDArray[np.float32], masks: NDArray[np.bool_]
    ) -> NDArray[np.int64]:
        """Return the index of every run's observation; new observations are added.

        Parameters
        ----------
        observations, masks
            Shapes (runs, features) and (runs, actions); each mask allows an action.
        """
        indices = np.empty(len(self._indices), dtype=np.int64)
        for run, known in enumerate(self._indices):
            key = _key(observations[run], masks[run])
            index = known.get(key)
            if index is None:
                index = known[key] = len(known)
                if index == self.visits.shape[1]:
                    self._grow()
                self.observations[run, index] = observations[run]
                self.masks[run, index] = masks[run]
            indices[run] = index
        return indices

    def find(
        self, run: int, observations: NDArray[np.float32], masks: NDArray[np.bool_]
    ) -> list[int]:
        """Return the indices of known observations of a run, shapes (n, features), (n, actions)."""
        keys = (_key(*pair) for pair in zip(observations, masks, strict=True))
        return [self._indices[run][key] for key in keys]

    def known(self, run: int) -> int:
        """Return the number of different observations that a run has met."""
        return len(self._indices[run])

    def arrays(self, name: str) -> Arrays:
        """Return copies of all arrays for `read`."""
        known = np.array([len(indices) for indices in self._indices], dtype=np.int64)
        most = max(1, int(known.max()))
        return {
            f"{name}.known": known,
            f"{name}.observations": self.observations[:, :most].copy(),
            f"{name}.masks": self.masks[:, :most].copy(),
            f"{name}.tried": self.visits[:, :most].copy(),
        }

    def read(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore what `arrays` returned.

        Raises
        ------
        ValueError
            If it has another shape.
        """
        runs = len(self._indices)
        known = read_array(arrays, f"{name}.known", (runs,))
        most = max(1, int(known.max()))
        while self.visits.shape[1] < most:
            self._grow()
        for key, mine in (
            ("observations", self.observations),
            ("masks", self.masks),
            ("tried", self.visits),
        ):
            mine[:, :most] = read_array(arrays, f"{name}.{key}", (runs, most, *mine.shape[2:]))
        self._indices = [
            {
                _key(self.observations[run, index], self.masks[run, index]): index
                for index in range(int(known[run]))
            }
            for run in range(runs)
        ]

    def _grow(self) -> None:
        self.observations = double_rows(self.observations)
        self.masks = double_rows(self.masks)
        self.visits = double_rows(self.visits)


def double_rows(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array of twice the size along the second axis, zeros at the end."""
    return np.concatenate([array, np.zeros_like(array)], axis=1)


def take_rows(array: NDArray[Any], indices: NDArray[np.int64]) -> NDArray[Any]:
    """Return every run's entries at its indices.

    Parameters
    ----------
    array
        Shape (runs, size, ...).
    indices
        Shape (runs, n).

    Returns
    -------
    ndarray
        Shape (runs, n, ...).
    """
    runs, size = array.shape[:2]
    flat = indices + size * np.arange(runs)[:, None]
    entries: NDArray[Any] = array.reshape(runs * size, *array.shape[2:]).take(flat, axis=0)
    return entries


def _key(observation: NDArray[np.float32], mask: NDArray[np.bool_]) -> bytes:
    return observation.tobytes() + mask.tobytes()
