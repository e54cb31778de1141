"""The situations that runs have met: what was observed, what was allowed, how often what was tried.

A situation is an observation and, if wanted, the action before it: where observations leave out
what costs depend on, it says more than the observation alone. Networks never see it; it tells
apart what is counted and remembered.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan_torch.batched_network import fitting

_FIRST_SIZE = 512


class Situations:
    """Numbers for the situations of every run, from 0 on in the order in which they were met.

    Parameters
    ----------
    runs, features, actions
        How many.
    tells_last_action
        Whether the action before belongs to a situation.

    Attributes
    ----------
    observations, masks
        By run and situation, shapes (runs, size, features) and (runs, size, actions).
    tried
        How often an action was taken in a situation, shape (runs, size, actions).
    """

    def __init__(self, runs: int, features: int, actions: int, tells_last_action: bool) -> None:
        self._tells_last_action = tells_last_action
        self._numbers: list[dict[bytes, int]] = [{} for _ in range(runs)]
        self._before = np.zeros((runs, _FIRST_SIZE), dtype=np.int64)
        self.observations = np.zeros((runs, _FIRST_SIZE, features), dtype=np.float32)
        self.masks = np.zeros((runs, _FIRST_SIZE, actions), dtype=np.bool_)
        self.tried = np.zeros((runs, _FIRST_SIZE, actions), dtype=np.int64)

    def numbers(
        self,
        observations: NDArray[np.float32],
        masks: NDArray[np.bool_],
        before: Sequence[int],
    ) -> NDArray[np.int64]:
        """Return the number of the situation that every run is in.

        Parameters
        ----------
        observations, masks
            Of every run, shapes (runs, features) and (runs, actions); each mask allows some.
        before
            The action before of every run, -1 at the start of an episode.
        """
        found = np.empty(len(self._numbers), dtype=np.int64)
        for run, known in enumerate(self._numbers):
            last = before[run] if self._tells_last_action else -1
            key = _key(observations[run], masks[run], last)
            number = known.get(key)
            if number is None:
                number = known[key] = len(known)
                if number == self.tried.shape[1]:
                    self._grow()
                self._before[run, number] = last
                self.observations[run, number] = observations[run]
                self.masks[run, number] = masks[run]
            found[run] = number
        return found

    def known(self, run: int) -> int:
        """Return how many situations a run has met."""
        return len(self._numbers[run])

    def arrays(self, name: str) -> dict[str, NDArray[Any]]:
        """Return copies of all there is to know, to be read by `read`."""
        known = np.array([len(one) for one in self._numbers], dtype=np.int64)
        most = max(1, int(known.max()))
        return {
            f"{name}.known": known,
            f"{name}.before": self._before[:, :most].copy(),
            f"{name}.observations": self.observations[:, :most].copy(),
            f"{name}.masks": self.masks[:, :most].copy(),
            f"{name}.tried": self.tried[:, :most].copy(),
        }

    def read(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over what `arrays` returned.

        Raises
        ------
        ValueError
            If it is of another shape.
        """
        runs = len(self._numbers)
        known = fitting(arrays, f"{name}.known", (runs,))
        most = max(1, int(known.max()))
        while self.tried.shape[1] < most:
            self._grow()
        for key, mine in (
            ("before", self._before),
            ("observations", self.observations),
            ("masks", self.masks),
            ("tried", self.tried),
        ):
            mine[:, :most] = fitting(arrays, f"{name}.{key}", (runs, most, *mine.shape[2:]))
        self._numbers = [
            {
                _key(
                    self.observations[run, number],
                    self.masks[run, number],
                    int(self._before[run, number]),
                ): number
                for number in range(int(known[run]))
            }
            for run in range(runs)
        ]

    def _grow(self) -> None:
        self._before = doubled(self._before)
        self.observations = doubled(self.observations)
        self.masks = doubled(self.masks)
        self.tried = doubled(self.tried)


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


def _key(observation: NDArray[np.float32], mask: NDArray[np.bool_], before: int) -> bytes:
    return observation.tobytes() + mask.tobytes() + before.to_bytes(4, "little", signed=True)
