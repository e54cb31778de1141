"""A network learned on one task as the start on another: what has the same name is taken over."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.learning.network_policy import NetworkPolicy


@dataclass(frozen=True)
class NamedNetwork:
    """A network, and what goes in and out.

    Parameters
    ----------
    network
        What acts.
    features
        What every input means.
    actions
        The skill that every output scores.
    """

    network: NetworkPolicy
    features: tuple[str, ...]
    actions: tuple[str, ...]

    def carried_over(self, features: Sequence[str], actions: Sequence[str]) -> NetworkPolicy:
        """Return a network for other features and skills that acts as this one where it can.

        A feature of an unknown name does not count at first. A skill of an unknown name scores
        what the known ones do on average. So on a task that has all features and skills of the
        old one, the greedy choice is the old one wherever none but old features are non-zero and
        the best skill is an old one.

        Parameters
        ----------
        features, actions
            Of the other task.

        Raises
        ------
        ValueError
            If no feature or no skill has a known name.
        """
        inputs, outputs = _places(self.features, features), _places(self.actions, actions)
        if not (inputs >= 0).any() or not (outputs >= 0).any():
            raise ValueError("Nothing of the network has a name that the other task knows.")
        weights, biases = list(self.network.weights), list(self.network.biases)
        weights[0] = np.where((inputs >= 0)[:, None], weights[0][inputs], np.float32(0.0))
        known = outputs >= 0
        for figures in (weights, biases):
            last = figures[-1]
            mean = last[..., outputs[known]].mean(-1, keepdims=True, dtype=np.float32)
            figures[-1] = np.where(known, last[..., outputs], mean)
        return NetworkPolicy(
            tuple(np.ascontiguousarray(one) for one in weights),
            tuple(np.ascontiguousarray(one) for one in biases),
        )


def _places(known: Sequence[str], wanted: Sequence[str]) -> NDArray[np.int64]:
    """Return where every wanted name is among the known ones; -1 where it is not."""
    at = {name: place for place, name in enumerate(known)}
    return np.array([at.get(name, -1) for name in wanted], dtype=np.int64)
