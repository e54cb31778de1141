"""The relational network in torch, for as long as it learns; its arrays are the numpy network's."""

from __future__ import annotations

import math

import numpy as np
import torch

from skillplan.solvers.relational.relational_network import NetworkSize, RelationalNetwork

_EPSILON = 1e-6


class TorchNetwork:
    """Scores padded batches of sights.

    Parameters
    ----------
    size
        Of the network.
    seed
        Of the first weights, >= 0.
    """

    def __init__(self, size: NetworkSize, seed: int) -> None:
        self.size = size
        chance = np.random.Generator(np.random.PCG64(seed))
        self.parameters: dict[str, torch.Tensor] = {}
        for name, shape in size.shapes().items():
            values = np.zeros(shape, dtype=np.float32)
            if len(shape) == 2:
                gain = 0.1 if name.endswith((".narrow", ".mix", "score.last")) else 1.0
                drawn = chance.standard_normal(shape) * gain / math.sqrt(shape[0])
                values = drawn.astype(np.float32)
            self.parameters[name] = torch.from_numpy(values).requires_grad_()

    def scores(
        self, features: torch.Tensor, pairs: torch.Tensor, present: torch.Tensor
    ) -> torch.Tensor:
        """Return scores, shape (batch, n).

        Parameters
        ----------
        features
            Shape (batch, n, features).
        pairs
            Shape (batch, n, n, features of pairs).
        present
            Which elements there are, shape (batch, n); the others are padding.
        """
        own = self.parameters
        known = torch.relu(features @ own["enter.weight"] + own["enter.bias"])
        seen = torch.relu(pairs @ own["pair.weight"] + own["pair.bias"])
        absent = ~present[:, None, None, :]
        for layer in range(self.size.layers):
            known = known + self._told(layer, _normal(known), seen, absent)
            wide = _normal(known) @ own[f"{layer}.widen"] + own[f"{layer}.widen_bias"]
            known = known + torch.relu(wide) @ own[f"{layer}.narrow"] + own[f"{layer}.narrow_bias"]
        last = torch.relu(_normal(known) @ own["score.weight"] + own["score.bias"])
        return (last @ own["score.last"])[..., 0]

    def network(self) -> RelationalNetwork:
        """Return the network as it is, for numpy."""
        return RelationalNetwork(
            self.size,
            {name: one.detach().numpy().copy() for name, one in self.parameters.items()},
        )

    def _told(
        self, layer: int, known: torch.Tensor, pairs: torch.Tensor, absent: torch.Tensor
    ) -> torch.Tensor:
        size, own = self.size, self.parameters
        batch, count = known.shape[:2]
        each = size.width // size.heads
        parts = (known @ own[f"{layer}.ask"]).reshape(batch, count, 3, size.heads, each)
        asked, offered, said = (parts[:, :, one].transpose(1, 2) for one in range(3))
        weights = asked @ offered.transpose(2, 3) / math.sqrt(each)
        weights = weights + (pairs @ own[f"{layer}.weigh"]).permute(0, 3, 1, 2)
        weights = torch.softmax(weights.masked_fill(absent, -1e9), dim=3)
        # Of every element, by head, what the pairs are that it attends to: (batch, n, heads, pair).
        weighed = weights.permute(0, 2, 1, 3) @ pairs
        of_pairs = own[f"{layer}.tell"].reshape(size.pair_width, size.heads, each)
        told = (weights @ said).transpose(1, 2)
        told = told + torch.einsum("bihp,phd->bihd", weighed, of_pairs)
        return told.reshape(batch, count, size.width) @ own[f"{layer}.mix"]


def _normal(values: torch.Tensor) -> torch.Tensor:
    return values / torch.sqrt((values * values).mean(dim=-1, keepdim=True) + _EPSILON)
