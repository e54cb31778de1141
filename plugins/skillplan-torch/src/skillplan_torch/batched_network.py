"""Feed-forward networks of one shape, one for every run, computed side by side.

Parameters have a leading axis of runs. Nothing is shared or summed across it, so that a run's
figures are the same alone and among others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from skillplan.solvers.learning.episode_training import copy_arrays, restore_arrays
from skillplan.solvers.learning.network_policy import NetworkPolicy

Vector = NDArray[np.float32]

BLOCK = 32
"""What a run has of anything is padded to so many, the widest vector of a processor. What is left
over of a block is rounded otherwise, and with several runs in a row it depends on how many they
are where the leftovers are."""


def padded(count: int) -> int:
    """Return a count, rounded up to whole blocks."""
    return -(-count // BLOCK) * BLOCK


class BatchedNetwork:
    """Rectified layers; the last one is linear.

    Parameters
    ----------
    sizes
        Inputs, hidden units of every layer, outputs.
    generators
        One for every run, from which its weights are drawn.
    last_gain
        Standard deviation of the last layer's outputs at first, relative to its inputs'.

    Attributes
    ----------
    parameters
        Weights, shape (runs, inputs, outputs), and biases, shape (runs, 1, outputs), of every
        layer in turn.
    """

    def __init__(
        self,
        sizes: Sequence[int],
        generators: Sequence[np.random.Generator],
        *,
        last_gain: float = 1.0,
    ) -> None:
        self.parameters: list[torch.Tensor] = []
        pairs = list(pairwise(sizes))
        for depth, (inputs, outputs) in enumerate(pairs):
            # After He et al. (2015): a rectifier halves the variance.
            gain = last_gain if depth == len(pairs) - 1 else 2.0**0.5
            drawn = [
                generator.standard_normal((inputs, outputs), dtype=np.float32)
                * np.float32(gain / inputs**0.5)
                for generator in generators
            ]
            self.parameters.append(torch.from_numpy(np.stack(drawn)).requires_grad_())
            self.parameters.append(torch.zeros(len(drawn), 1, outputs, requires_grad=True))
        # The same memory: what an optimiser does is seen here at once.
        self._arrays = [parameter.detach().numpy() for parameter in self.parameters]

    def __call__(self, observations: torch.Tensor) -> torch.Tensor:
        """Return outputs, shape (runs, n, outputs), of observations, shape (runs, n, inputs)."""
        layer = observations
        for depth in range(0, len(self.parameters), 2):
            if depth:
                layer = layer.relu_()
            layer = torch.baddbmm(self.parameters[depth + 1], layer, self.parameters[depth])
        return layer

    def of_one(self, observations: Vector) -> Vector:
        """Return outputs, shape (runs, outputs), of one observation a run, without gradients."""
        layer = observations[:, None, :]
        for depth in range(0, len(self._arrays), 2):
            if depth:
                layer = np.maximum(layer, 0.0)
            layer = layer @ self._arrays[depth] + self._arrays[depth + 1]
        return layer[:, 0]

    def copy(self) -> BatchedNetwork:
        """Return an independent network of the same figures."""
        twin = BatchedNetwork.__new__(BatchedNetwork)
        twin.parameters = [parameter.detach().clone() for parameter in self.parameters]
        twin._arrays = [parameter.numpy() for parameter in twin.parameters]
        return twin

    @torch.no_grad()
    def approach(self, other: BatchedNetwork, share: float) -> None:
        """Move all parameters by a share of the difference towards another network's."""
        torch._foreach_lerp_(self.parameters, [p.detach() for p in other.parameters], share)

    def is_sane(self) -> NDArray[np.bool_]:
        """Return for every run whether all its parameters are finite, shape (runs,)."""
        sane = np.ones(len(self._arrays[0]), dtype=np.bool_)
        for array in self._arrays:
            sane &= np.isfinite(array).all(axis=(1, 2))
        return sane

    def policy(self, run: int, outputs: int) -> NetworkPolicy:
        """Return a run's network as it is, with the first so many of its outputs.

        Raises
        ------
        ValueError
            If a figure is not finite.
        """
        weights = [array[run].copy() for array in self._arrays[::2]]
        biases = [array[run, 0].copy() for array in self._arrays[1::2]]
        weights[-1], biases[-1] = weights[-1][:, :outputs].copy(), biases[-1][:outputs].copy()
        return NetworkPolicy(tuple(weights), tuple(biases))

    def take_over(self, run: int, network: NetworkPolicy) -> None:
        """Give a run a network's parameters; what outputs are beyond the network's stays as it was.

        Raises
        ------
        ValueError
            If its layers are not those of this one.
        """
        pairs = [*zip(self._arrays[::2], network.weights, strict=True)]
        for mine, weight in pairs:
            if mine.shape[1] != weight.shape[0] or mine.shape[2] < weight.shape[1]:
                raise ValueError("The layers of the network are not those of the training.")
            mine[run, :, : weight.shape[1]] = weight
        for mine, bias in zip(self._arrays[1::2], network.biases, strict=True):
            mine[run, 0, : len(bias)] = bias

    def arrays(self, name: str) -> dict[str, NDArray[Any]]:
        """Return copies of all parameters, to be read by `read`."""
        return copy_arrays(name, self._own())

    def read(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over what `arrays` returned.

        Raises
        ------
        ValueError
            If it is of another shape.
        """
        restore_arrays(name, self._own(), arrays)

    def _own(self) -> dict[str, NDArray[Any]]:
        """Return the arrays by their names in a snapshot."""
        return {str(i): array for i, array in enumerate(self._arrays)}
