"""Learning by imitation of a teacher that knows what every choice costs.

AggreVaTe (Ross and Bagnell, "Reinforcement and imitation learning via interactive no-regret
learning", 2014): the network itself walks, with slips, the teacher says what each choice there
would have cost, and all that was met so far is learned again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import torch

from skillplan.solvers.relational.element_view import Sight
from skillplan.solvers.relational.relational_network import NetworkSize, RelationalNetwork
from skillplan_torch.relational.lessons import Board, Lessons

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


class RelationalLearning:
    """A network that learns on boards, round by round.

    Parameters
    ----------
    boards
        At least one.
    size
        Of the network.
    seed
        Governs all randomness, >= 0.
    batch, learning_rate, slips, sharpness
        As in `RelationalOptions`.
    """

    def __init__(
        self,
        boards: Sequence[Board],
        size: NetworkSize,
        seed: int,
        *,
        batch: int = 256,
        learning_rate: float = 1e-3,
        slips: float = 0.15,
        sharpness: float = 100.0,
    ) -> None:
        self._boards = boards
        self._chance = np.random.Generator(np.random.PCG64(seed))
        self._torch = TorchNetwork(size, seed)
        self._adam = torch.optim.Adam(self._torch.parameters.values(), lr=learning_rate)
        self._rate, self._batch = learning_rate, batch
        self._slips, self._sharpness = slips, sharpness
        self._lessons = Lessons()
        self.updates = 0

    @property
    def network(self) -> RelationalNetwork:
        """What has been learned so far."""
        return self._torch.network()

    @property
    def states(self) -> int:
        """How many states have been met."""
        return len(self._lessons)

    def walk(self, boards: Sequence[Board] | None = None) -> None:
        """Meet states on the boards: at first on ways at random, then on the network's."""
        choose = self._at_random if not self._lessons else self._greedy(self.network)
        for board in self._boards if boards is None else boards:
            self._lessons.add(board.walk(choose, self._chance, self._slips))

    def learn(self, updates: int, stop: Callable[[], bool], share: tuple[float, float]) -> float:
        """Update from what has been met; return the mean regret of the last ones.

        Parameters
        ----------
        updates
            How many.
        stop
            Whether to stop early.
        share
            Which share of all that will be learned this is, from and to: the step size falls.
        """
        losses = []
        for update in range(updates):
            if stop():
                break
            at = share[0] + (share[1] - share[0]) * update / updates
            self._adam.param_groups[0]["lr"] = self._rate * max(0.02, 1.0 - at)
            places = self._chance.integers(len(self._lessons), size=self._batch)
            loss, regret = self._loss(self._lessons.batch(places))
            self._adam.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            torch.nn.utils.clip_grad_norm_(self._torch.parameters.values(), 1.0)
            self._adam.step()
            self.updates += 1
            losses.append(regret)
        return float(np.mean(losses[-50:])) if losses else float("nan")

    def _loss(self, batch: tuple[torch.Tensor, ...]) -> tuple[torch.Tensor, float]:
        """Return the loss: the teacher's soft choice, and the regret that is to be expected."""
        features, pairs, present, usable, regrets = batch
        scores = self._torch.scores(features, pairs, present).masked_fill(~usable, -1e9)
        logs = torch.log_softmax(scores, dim=1)
        wanted = torch.softmax((-self._sharpness * regrets).masked_fill(~usable, -1e9), dim=1)
        expected = (logs.exp() * regrets).sum(dim=1)
        crossed = -(wanted * logs).sum(dim=1)
        return (crossed + self._sharpness * expected).mean(), float(expected.detach().mean())

    def _at_random(self, sight: Sight) -> int:
        usable = [place for place, way in enumerate(sight.ways) if way is not None]
        return int(self._chance.choice(usable))

    @staticmethod
    def _greedy(network: RelationalNetwork) -> Callable[[Sight], int]:
        def choose(sight: Sight) -> int:
            usable = np.array([way is not None for way in sight.ways])
            return int(np.argmax(np.where(usable, network.scores(sight), -np.inf)))

        return choose
