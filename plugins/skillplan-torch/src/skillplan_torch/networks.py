"""Feed-forward networks of one shape and their optimiser, one network for every run.

Parameters have a leading axis of runs. Nothing is shared or summed across it, so a run has the
same figures alone and among others.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from skillplan.solvers.learning.episode_training import (
    Arrays,
    copy_arrays,
    read_array,
    restore_arrays,
)
from skillplan.solvers.learning.network_policy import NetworkPolicy

Vector = NDArray[np.float32]

BLOCK = 32
"""All numbers of rows and units are multiples of it, the widest vector of a processor: the rest of
an incomplete block is rounded differently, depending on the number of runs."""

_MEAN_DECAY, _SQUARE_DECAY = 0.9, 0.999


def padded(count: int) -> int:
    """Return a count rounded up to whole blocks."""
    return -(-count // BLOCK) * BLOCK


class BatchedNetwork:
    """Linear layers with rectifiers between them.

    Parameters
    ----------
    sizes
        Number of inputs, of units of every hidden layer, and of outputs.
    generators
        One for every run; draws its weights.
    last_gain
        Initial standard deviation of the outputs, relative to that of the last layer's inputs.

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
            # He et al. (2015): a rectifier halves the variance.
            gain = last_gain if depth == len(pairs) - 1 else 2.0**0.5
            weights = [
                generator.standard_normal((inputs, outputs), dtype=np.float32)
                * np.float32(gain / inputs**0.5)
                for generator in generators
            ]
            self.parameters.append(torch.from_numpy(np.stack(weights)).requires_grad_())
            self.parameters.append(torch.zeros(len(weights), 1, outputs, requires_grad=True))
        # Views of the same memory, which an optimiser changes.
        self._arrays = [parameter.detach().numpy() for parameter in self.parameters]

    def __call__(self, observations: torch.Tensor) -> torch.Tensor:
        """Return outputs, shape (runs, n, outputs), of observations, shape (runs, n, inputs)."""
        layer = observations
        for depth in range(0, len(self.parameters), 2):
            if depth:
                layer = layer.relu_()
            layer = torch.baddbmm(self.parameters[depth + 1], layer, self.parameters[depth])
        return layer

    def evaluate(self, observations: Vector) -> Vector:
        """Return outputs, shape (runs, outputs), of one observation per run, without gradients."""
        layer = observations[:, None, :]
        for depth in range(0, len(self._arrays), 2):
            if depth:
                layer = np.maximum(layer, 0.0)
            layer = layer @ self._arrays[depth] + self._arrays[depth + 1]
        return layer[:, 0]

    def copy(self) -> BatchedNetwork:
        """Return an independent network with equal parameters."""
        twin = BatchedNetwork.__new__(BatchedNetwork)
        twin.parameters = [parameter.detach().clone() for parameter in self.parameters]
        twin._arrays = [parameter.numpy() for parameter in twin.parameters]
        return twin

    @torch.no_grad()
    def approach(self, other: BatchedNetwork, share: float) -> None:
        """Move all parameters towards another network's by a share of the difference."""
        torch._foreach_lerp_(self.parameters, [p.detach() for p in other.parameters], share)

    def is_finite(self) -> NDArray[np.bool_]:
        """Return whether all parameters of a run are finite, shape (runs,)."""
        finite = np.ones(len(self._arrays[0]), dtype=np.bool_)
        for array in self._arrays:
            finite &= np.isfinite(array).all(axis=(1, 2))
        return finite

    def policy(self, run: int, outputs: int) -> NetworkPolicy:
        """Return a run's network with its first `outputs` outputs.

        Raises
        ------
        ValueError
            If a parameter is not finite.
        """
        weights = [array[run].copy() for array in self._arrays[::2]]
        biases = [array[run, 0].copy() for array in self._arrays[1::2]]
        weights[-1], biases[-1] = weights[-1][:, :outputs].copy(), biases[-1][:outputs].copy()
        return NetworkPolicy(tuple(weights), tuple(biases))

    def load(self, run: int, network: NetworkPolicy) -> None:
        """Copy a network's parameters to a run; outputs beyond the network's stay as they are.

        Raises
        ------
        ValueError
            If it has other layers.
        """
        for mine, weight in zip(self._arrays[::2], network.weights, strict=True):
            if mine.shape[1] != weight.shape[0] or mine.shape[2] < weight.shape[1]:
                raise ValueError("The layers of the network differ from the training's.")
            mine[run, :, : weight.shape[1]] = weight
        for mine, bias in zip(self._arrays[1::2], network.biases, strict=True):
            mine[run, 0, : len(bias)] = bias

    def arrays(self, name: str) -> Arrays:
        """Return copies of all parameters for `read`."""
        return copy_arrays(name, self._own_arrays())

    def read(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore what `arrays` returned; raises ValueError if it has another shape."""
        restore_arrays(name, self._own_arrays(), arrays)

    def _own_arrays(self) -> Arrays:
        return {str(i): array for i, array in enumerate(self._arrays)}


class BatchedAdam:
    """Adam (Kingma and Ba, 2015) for batched networks.

    torch.optim.Adam spends more time on wrapping networks of this size than on arithmetic.

    Parameters
    ----------
    parameters
        Parameters to optimise.
    epsilon
        Denominator's offset, > 0.
    """

    def __init__(self, parameters: Sequence[torch.Tensor], epsilon: float = 1e-8) -> None:
        self._parameters, self._epsilon = list(parameters), epsilon
        self._steps = 0
        self._means = [torch.zeros_like(p, requires_grad=False) for p in self._parameters]
        self._squares = [torch.zeros_like(p, requires_grad=False) for p in self._parameters]

    def minimise(self, loss: torch.Tensor, rate: float) -> None:
        """Take a step down the gradient of a loss that is summed over runs."""
        for parameter in self._parameters:
            parameter.grad = None
        loss.backward()  # type: ignore[no-untyped-call]
        self.step(rate)

    def step(self, rate: float) -> None:
        """Take a step down the present gradients."""
        # Moments of weights without gradient decay to denormal numbers, which are slow.
        torch.set_flush_denormal(True)
        try:
            self._step(rate)
        finally:
            torch.set_flush_denormal(False)

    @torch.no_grad()
    def _step(self, rate: float) -> None:
        self._steps += 1
        step = rate / (1.0 - _MEAN_DECAY**self._steps)
        correction = math.sqrt(1.0 - _SQUARE_DECAY**self._steps)
        gradients = [p.grad for p in self._parameters if p.grad is not None]
        assert len(gradients) == len(self._parameters)
        # All parameters in one call: calls cost more than arithmetic.
        torch._foreach_lerp_(self._means, gradients, 1.0 - _MEAN_DECAY)
        torch._foreach_mul_(self._squares, _SQUARE_DECAY)
        torch._foreach_addcmul_(self._squares, gradients, gradients, 1.0 - _SQUARE_DECAY)
        scales = torch._foreach_sqrt(self._squares)
        torch._foreach_div_(scales, correction)
        torch._foreach_add_(scales, self._epsilon)
        torch._foreach_addcdiv_(self._parameters, self._means, scales, -step)

    def arrays(self, name: str) -> Arrays:
        """Return copies of the moments for `read`."""
        steps = np.array(self._steps, dtype=np.int64)
        return {f"{name}.steps": steps, **copy_arrays(name, self._own_arrays())}

    def read(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore what `arrays` returned; raises ValueError if it has another shape."""
        self._steps = int(read_array(arrays, f"{name}.steps", ()))
        restore_arrays(name, self._own_arrays(), arrays)

    def _own_arrays(self) -> Arrays:
        arrays: Arrays = {}
        for i, (mean, square) in enumerate(zip(self._means, self._squares, strict=True)):
            arrays[f"{i}.mean"], arrays[f"{i}.square"] = mean.numpy(), square.numpy()
        return arrays
