"""Visit counts: which observations a run has met, and how often it took which action there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan_torch.snapshot_arrays import fitting

_FIRST_SIZE = 512


class ObservationCounts:
    """Gives the observations of every run indices, from 0 on in the order of their first visits.

    Parameters
    ----------
    runs, features, actions
        How many.

    Attributes
    ----------
    observations, masks
        By run and index, shapes (runs, size, features) and (runs, size, actions).
    visits
        How often an action was taken there, shape (runs, size, actions).
    """

    def __init__(self, runs: int, features: int, actions: int) -> None:
        self._indices: list[dict[bytes, int]] = [{} for _ in range(runs)]
        self.observations = np.zeros((runs, _FIRST_SIZE, features), dtype=np.float32)
        self.masks = np.zeros((runs, _FIRST_SIZE, actions), dtype=np.bool_)
        self.visits = np.zeros((runs, _FIRST_SIZE, actions), dtype=np.int64)

    def indices(
        self, observations: NDArray[np.float32], masks: NDArray[np.bool_]
    ) -> NDArray[np.int64]:
        """Return the index of what every run observes; new observations are added.

        Parameters
        ----------
        observations, masks
            Of every run, shapes (runs, features) and (runs, actions); each mask allows some.
        """
        found = np.empty(len(self._indices), dtype=np.int64)
        for run, known in enumerate(self._indices):
            key = _key(observations[run], masks[run])
            index = known.get(key)
            if index is None:
                index = known[key] = len(known)
                if index == self.visits.shape[1]:
                    self._grow()
                self.observations[run, index] = observations[run]
                self.masks[run, index] = masks[run]
            found[run] = index
        return found

    def known(self, run: int) -> int:
        """Return how many different observations a run has met."""
        return len(self._indices[run])

    def arrays(self, name: str) -> dict[str, NDArray[Any]]:
        """Return copies of all observations and counts, to be read by `read`."""
        known = np.array([len(one) for one in self._indices], dtype=np.int64)
        most = max(1, int(known.max()))
        return {
            f"{name}.known": known,
            f"{name}.observations": self.observations[:, :most].copy(),
            f"{name}.masks": self.masks[:, :most].copy(),
            f"{name}.tried": self.visits[:, :most].copy(),
        }

    def read(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over what `arrays` returned.

        Raises
        ------
        ValueError
            If it is of another shape.
        """
        runs = len(self._indices)
        known = fitting(arrays, f"{name}.known", (runs,))
        most = max(1, int(known.max()))
        while self.visits.shape[1] < most:
            self._grow()
        for key, mine in (
            ("observations", self.observations),
            ("masks", self.masks),
            ("tried", self.visits),
        ):
            mine[:, :most] = fitting(arrays, f"{name}.{key}", (runs, most, *mine.shape[2:]))
        self._indices = [
            {
                _key(self.observations[run, index], self.masks[run, index]): index
                for index in range(int(known[run]))
            }
            for run in range(runs)
        ]

    def _grow(self) -> None:
        self.observations = doubled(self.observations)
        self.masks = doubled(self.masks)
        self.visits = doubled(self.visits)


def doubled(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array of twice the size along the second axis, zeros at the end."""
    return np.concatenate([array, np.zeros_like(array)], axis=1)


def of_runs(array: NDArray[Any], indices: NDArray[np.int64]) -> NDArray[Any]:
    """Return the entries of every run at these indices.

    Parameters
    ----------
    array
        By run, shape (runs, size, ...).
    indices
        By run, shape (runs, n).

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
