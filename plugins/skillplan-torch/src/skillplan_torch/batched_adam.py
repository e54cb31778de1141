"""The optimiser of batched networks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from skillplan.solvers.learning.episode_training import copy_arrays, read_array, restore_arrays

_MEAN_DECAY, _SQUARE_DECAY = 0.9, 0.999


class BatchedAdam:
    """Adam (Kingma and Ba, 2015) for batched networks.

    Written out, as the library's costs more in wrapping so small networks than in arithmetic.

    Parameters
    ----------
    parameters
        What it changes.
    epsilon
        Keeps small gradients from being blown up, > 0.
    """

    def __init__(self, parameters: Sequence[torch.Tensor], epsilon: float = 1e-8) -> None:
        self._parameters, self._epsilon = list(parameters), epsilon
        self._steps = 0
        self._means = [torch.zeros_like(one, requires_grad=False) for one in self._parameters]
        self._squares = [torch.zeros_like(one, requires_grad=False) for one in self._parameters]

    def step(self, loss: torch.Tensor, rate: float) -> None:
        """Follow the gradient of a loss that is a sum over runs."""
        for parameter in self._parameters:
            parameter.grad = None
        loss.backward()  # type: ignore[no-untyped-call]
        self.follow(rate)

    def follow(self, rate: float) -> None:
        """Follow the gradients that there are."""
        # Moments of weights that no longer matter fade to figures that processors are slow at.
        torch.set_flush_denormal(True)
        try:
            self._follow(rate)
        finally:
            # Others in this thread are to find arithmetic as it was.
            torch.set_flush_denormal(False)

    @torch.no_grad()
    def _follow(self, rate: float) -> None:
        self._steps += 1
        step = rate / (1.0 - _MEAN_DECAY**self._steps)
        correction = math.sqrt(1.0 - _SQUARE_DECAY**self._steps)
        gradients = [one.grad for one in self._parameters if one.grad is not None]
        assert len(gradients) == len(self._parameters)
        # All parameters at once: calls cost more than arithmetic.
        torch._foreach_lerp_(self._means, gradients, 1.0 - _MEAN_DECAY)
        torch._foreach_mul_(self._squares, _SQUARE_DECAY)
        torch._foreach_addcmul_(self._squares, gradients, gradients, 1.0 - _SQUARE_DECAY)
        scales = torch._foreach_sqrt(self._squares)
        torch._foreach_div_(scales, correction)
        torch._foreach_add_(scales, self._epsilon)
        torch._foreach_addcdiv_(self._parameters, self._means, scales, -step)

    def arrays(self, name: str) -> dict[str, NDArray[Any]]:
        """Return copies of its moments, to be read by `read`."""
        steps = np.array(self._steps, dtype=np.int64)
        return {f"{name}.steps": steps, **copy_arrays(name, self._own())}

    def read(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over what `arrays` returned.

        Raises
        ------
        ValueError
            If it is of another shape.
        """
        self._steps = int(read_array(arrays, f"{name}.steps", ()))
        restore_arrays(name, self._own(), arrays)

    def _own(self) -> dict[str, NDArray[Any]]:
        """Return its moments, which are not copied, by their names in a snapshot."""
        found: dict[str, NDArray[Any]] = {}
        for i, (mean, square) in enumerate(zip(self._means, self._squares, strict=True)):
            found[f"{i}.mean"], found[f"{i}.square"] = mean.numpy(), square.numpy()
        return found
