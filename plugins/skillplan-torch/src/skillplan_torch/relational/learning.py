"""Learning by imitation of a teacher that knows what every choice costs.

AggreVaTe (Ross and Bagnell, "Reinforcement and imitation learning via interactive no-regret
learning", 2014): the network itself walks, with slips, the teacher says what each choice there
would have cost, and all that was met so far is learned again.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray

from skillplan.model.skill_model import SkillModel
from skillplan_torch.relational.elements import (
    ELEMENT_FEATURES,
    PAIR_FEATURES,
    ElementOrder,
    ElementPaths,
    ElementView,
    Sight,
)
from skillplan_torch.relational.network import NetworkSize, RelationalNetwork

# Its table has 2 ** n * n entries.
MOST_ELEMENTS = 14


class CostToGo:
    """The least cost of what is left, in every order that respects the precedence.

    Parameters
    ----------
    view
        Of a board of at most `MOST_ELEMENTS` elements that leave no choices.

    Raises
    ------
    ValueError
        If there are more, or an order has to choose between precedences.
    """

    def __init__(self, view: ElementView) -> None:
        count = len(view.rest)
        if count > MOST_ELEMENTS or view.order.choices:
            raise ValueError(f"The teacher knows boards of at most {MOST_ELEMENTS} elements.")
        self._view = view
        powers = 1 << np.arange(count)
        self._before = (view.order.before * powers[:, None]).sum(axis=0)
        self._table = np.full((1 << count, count), np.inf)
        self._fill(count)

    def of_state(self, done: NDArray[np.bool_], sight: Sight) -> NDArray[np.float64]:
        """Return what is to pay if the next element is each of those seen, shape (n,).

        Parameters
        ----------
        done
            Which elements of the task are done.
        sight
            What is seen of the state.
        """
        mask = int(sum(1 << one for one in np.flatnonzero(done).tolist()))
        found = np.full(len(sight.elements), np.inf)
        for place, (one, way) in enumerate(zip(sight.elements.tolist(), sight.ways, strict=True)):
            if way is not None and not self._before[one] & ~mask:
                rest = self._view.rest[one]
                found[place] = way.cost + rest + self._table[mask | 1 << one, one]
        return found

    def _fill(self, count: int) -> None:
        sets = np.arange(1 << count)
        sizes = np.array([int(one).bit_count() for one in sets])
        self._table[-1] = 0.0
        for size in range(count - 1, 0, -1):
            here = sets[sizes == size]
            least = np.full((len(here), count), np.inf)
            for element in range(count):
                open_here = ((here >> element & 1) == 0) & ((self._before[element] & ~here) == 0)
                onward = self._table[here[open_here] | 1 << element, element]
                paid = self._view.costs[:, element] + self._view.rest[element]
                least[open_here] = np.minimum(least[open_here], onward[:, None] + paid[None])
            self._table[here] = least


# What a choice is worse by that leads nowhere, in shares of what is to pay at the start.
DEAD_END = 1.0

Choose = Callable[[Sight], int]


@dataclass(frozen=True)
class Board:
    """A board to learn on.

    Parameters
    ----------
    model, view, teacher
        The board, how it is seen, and what is still to pay there.
    least
        What the whole of it costs at least, > 0.
    """

    model: SkillModel
    view: ElementView
    teacher: CostToGo
    least: float

    @classmethod
    def of(cls, model: SkillModel) -> Board:
        """Return the board of a model.

        Raises
        ------
        OptionError
            If it has no elements that could be scored.
        ValueError
            If it is too large to be taught, or has no plan.
        """
        view = ElementView(ElementPaths(model.task), ElementOrder.of(model))
        teacher = CostToGo(view)
        least = float(teacher.of_state(view.done(model.initial), view(model.initial)).min())
        if not 0 < least < np.inf:
            raise ValueError(f"{model.task.name} has no plan to learn from.")
        return cls(model, view, teacher, least)

    def walk(
        self, choose: Choose, chance: np.random.Generator, slips: float
    ) -> list[tuple[Sight, NDArray[np.float64]]]:
        """Return what is seen on a way to the goal, and what each choice is worse by.

        Parameters
        ----------
        choose
            Which of the elements seen is gone for; where that is a dead end, the best is.
        chance
            Of slips.
        slips
            Share of choices made at random among those that are no dead ends.
        """
        found = []
        state = self.model.initial
        for _ in range(self.model.step_limit):
            if self.model.is_goal(state):
                break
            sight = self.view(state)
            regrets = self.regrets(self.view.done(state), sight)
            open_ones = np.flatnonzero(regrets < DEAD_END)
            if sum(way is not None for way in sight.ways) > 1:
                found.append((sight, regrets))
                place = choose(sight)
                if chance.random() < slips:
                    place = int(chance.choice(open_ones))
            else:
                place = int(open_ones[0])
            if regrets[place] >= DEAD_END:
                place = int(regrets.argmin())
            way = sight.ways[place]
            assert way is not None
            state = self.model.task.skill(way.first).prediction.apply(state)
        return found

    def regrets(self, done: NDArray[np.bool_], sight: Sight) -> NDArray[np.float64]:
        """Return by how much each choice is worse than the best, in shares of the whole."""
        to_pay = self.teacher.of_state(done, sight)
        regrets: NDArray[np.float64] = np.minimum((to_pay - to_pay.min()) / self.least, DEAD_END)
        return regrets


@dataclass
class Lessons:
    """States met so far, and by how much each choice there is worse than the best."""

    _sights: list[Sight] = field(default_factory=list)
    _regrets: list[NDArray[np.float64]] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self._sights)

    def __iter__(self) -> Iterator[tuple[Sight, NDArray[np.float64]]]:
        return iter(zip(self._sights, self._regrets, strict=True))

    def add(self, met: Sequence[tuple[Sight, NDArray[np.float64]]]) -> None:
        """Keep what was met."""
        for sight, regrets in met:
            self._sights.append(sight)
            self._regrets.append(regrets)

    def batch(self, places: NDArray[np.int64]) -> tuple[torch.Tensor, ...]:
        """Return features, pairs, who is present, who can be chosen, and regrets, padded."""
        count, most = len(places), max(len(self._regrets[one]) for one in places)
        features = np.zeros((count, most, len(ELEMENT_FEATURES)), dtype=np.float32)
        pairs = np.zeros((count, most, most, len(PAIR_FEATURES)), dtype=np.float32)
        present = np.zeros((count, most), dtype=np.bool_)
        usable = np.zeros((count, most), dtype=np.bool_)
        regrets = np.full((count, most), DEAD_END, dtype=np.float32)
        for row, place in enumerate(places):
            sight = self._sights[place]
            n = len(sight.elements)
            features[row, :n], pairs[row, :n, :n] = sight.features, sight.pairs
            present[row, :n] = True
            usable[row, :n] = [way is not None for way in sight.ways]
            regrets[row, :n] = self._regrets[place]
        arrays = (features, pairs, present, usable, regrets)
        return tuple(torch.from_numpy(one) for one in arrays)


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
