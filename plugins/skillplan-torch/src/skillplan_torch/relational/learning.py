"""Imitation of a teacher that knows the cost of every choice on small boards.

AggreVaTe (Ross and Bagnell, "Reinforcement and imitation learning via interactive no-regret
learning", 2014): the network rolls out with random deviations, the teacher labels each state with
the cost of every choice, and the network learns from all states so far.
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
    ElementGraph,
    ElementOrder,
    ElementPaths,
    ElementView,
)
from skillplan_torch.relational.network import NetworkSize, RelationalNetwork

# The teacher's table has 2 ** n * n entries.
MOST_ELEMENTS = 14
# Regret of a dead end, in shares of the board's cost.
DEAD_END = 1.0
_EPSILON = 1e-6

Choose = Callable[[ElementGraph], int]


class CostToGo:
    """Least cost of the remaining elements, over all orders that respect the precedence.

    Parameters
    ----------
    view
        View of a board with at most `MOST_ELEMENTS` elements and no alternatives of precedence.

    Raises
    ------
    ValueError
        If there are more elements, or alternatives.
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

    def of_state(self, done: NDArray[np.bool_], graph: ElementGraph) -> NDArray[np.float64]:
        """Return the cost to go for each next element, shape (n,).

        Parameters
        ----------
        done
            True for finished elements, shape (elements,).
        graph
            Features of the state.
        """
        mask = int(sum(1 << element for element in np.flatnonzero(done).tolist()))
        costs = np.full(len(graph.elements), np.inf)
        for place, element in enumerate(graph.elements.tolist()):
            route = graph.routes[place]
            if route is not None and not self._before[element] & ~mask:
                rest = self._view.rest[element]
                costs[place] = route.cost + rest + self._table[mask | 1 << element, element]
        return costs

    def _fill(self, count: int) -> None:
        sets = np.arange(1 << count)
        sizes = np.array([int(members).bit_count() for members in sets])
        self._table[-1] = 0.0
        for size in range(count - 1, 0, -1):
            here = sets[sizes == size]
            cheapest = np.full((len(here), count), np.inf)
            for element in range(count):
                rows = ((here >> element & 1) == 0) & ((self._before[element] & ~here) == 0)
                onward = self._table[here[rows] | 1 << element, element]
                paid = self._view.costs[:, element] + self._view.rest[element]
                cheapest[rows] = np.minimum(cheapest[rows], onward[:, None] + paid[None])
            self._table[here] = cheapest


@dataclass(frozen=True)
class Board:
    """A board to learn on.

    Parameters
    ----------
    model, view, teacher
        Model, features and cost to go of the board.
    least
        Its least cost, > 0.
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
            If it has no elements to score.
        ValueError
            If it is too large for the teacher, or has no plan.
        """
        view = ElementView(ElementPaths(model.task), ElementOrder.of(model))
        teacher = CostToGo(view)
        cost = float(teacher.of_state(view.done(model.initial), view(model.initial)).min())
        if not 0 < cost < np.inf:
            raise ValueError(f"{model.task.name} has no plan to learn from.")
        return cls(model, view, teacher, cost)

    def walk(
        self, choose: Choose, chance: np.random.Generator, slips: float
    ) -> list[tuple[ElementGraph, NDArray[np.float64]]]:
        """Return the states of a roll-out to the goal, with the regret of each choice.

        Parameters
        ----------
        choose
            Choice of the next element; a dead end is replaced by the best choice.
        chance
            Generator of random choices.
        slips
            Share of random choices, dead ends excluded, in [0, 1].
        """
        states = []
        state = self.model.initial
        for _ in range(self.model.step_limit):
            if self.model.is_goal(state):
                break
            graph = self.view(state)
            regrets = self.regrets(self.view.done(state), graph)
            safe = np.flatnonzero(regrets < DEAD_END)
            if sum(route is not None for route in graph.routes) > 1:
                states.append((graph, regrets))
                place = choose(graph)
                if chance.random() < slips:
                    place = int(chance.choice(safe))
            else:
                place = int(safe[0])
            if regrets[place] >= DEAD_END:
                place = int(regrets.argmin())
            route = graph.routes[place]
            assert route is not None
            state = self.model.task.skill(route.first).prediction.apply(state)
        return states

    def regrets(self, done: NDArray[np.bool_], graph: ElementGraph) -> NDArray[np.float64]:
        """Return the excess cost of each choice over the best, in shares of the board's cost."""
        costs = self.teacher.of_state(done, graph)
        regrets: NDArray[np.float64] = np.minimum((costs - costs.min()) / self.least, DEAD_END)
        return regrets


@dataclass
class Lessons:
    """States to learn from, with the regret of each choice."""

    _graphs: list[ElementGraph] = field(default_factory=list)
    _regrets: list[NDArray[np.float64]] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self._graphs)

    def __iter__(self) -> Iterator[tuple[ElementGraph, NDArray[np.float64]]]:
        return iter(zip(self._graphs, self._regrets, strict=True))

    def add(self, states: Sequence[tuple[ElementGraph, NDArray[np.float64]]]) -> None:
        """Add states of a roll-out."""
        for graph, regrets in states:
            self._graphs.append(graph)
            self._regrets.append(regrets)

    def batch(self, places: NDArray[np.int64]) -> tuple[torch.Tensor, ...]:
        """Return features, pairs, presence, usability and regrets of states, padded."""
        count, most = len(places), max(len(self._regrets[place]) for place in places)
        features = np.zeros((count, most, len(ELEMENT_FEATURES)), dtype=np.float32)
        pairs = np.zeros((count, most, most, len(PAIR_FEATURES)), dtype=np.float32)
        present = np.zeros((count, most), dtype=np.bool_)
        usable = np.zeros((count, most), dtype=np.bool_)
        regrets = np.full((count, most), DEAD_END, dtype=np.float32)
        for row, place in enumerate(places):
            graph = self._graphs[place]
            n = len(graph.elements)
            features[row, :n], pairs[row, :n, :n] = graph.features, graph.pairs
            present[row, :n] = True
            usable[row, :n] = [route is not None for route in graph.routes]
            regrets[row, :n] = self._regrets[place]
        arrays = (features, pairs, present, usable, regrets)
        return tuple(torch.from_numpy(array) for array in arrays)


class TorchNetwork:
    """`RelationalNetwork` for padded batches, with gradients.

    Parameters
    ----------
    size
        Dimensions of the network.
    seed
        Seed of the initial weights, >= 0.
    """

    def __init__(self, size: NetworkSize, seed: int) -> None:
        self.size = size
        chance = np.random.Generator(np.random.PCG64(seed))
        self.parameters: dict[str, torch.Tensor] = {}
        for name, shape in size.shapes().items():
            values = np.zeros(shape, dtype=np.float32)
            if len(shape) == 2:
                gain = 0.1 if name.endswith((".narrow", ".mix", "score.last")) else 1.0
                weights = chance.standard_normal(shape) * gain / math.sqrt(shape[0])
                values = weights.astype(np.float32)
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
            False for padding, shape (batch, n).
        """
        own = self.parameters
        hidden = torch.relu(features @ own["enter.weight"] + own["enter.bias"])
        related = torch.relu(pairs @ own["pair.weight"] + own["pair.bias"])
        absent = ~present[:, None, None, :]
        for layer in range(self.size.layers):
            hidden = hidden + self._attend(layer, _normalise(hidden), related, absent)
            wide = _normalise(hidden) @ own[f"{layer}.widen"] + own[f"{layer}.widen_bias"]
            narrow = torch.relu(wide) @ own[f"{layer}.narrow"]
            hidden = hidden + narrow + own[f"{layer}.narrow_bias"]
        last = torch.relu(_normalise(hidden) @ own["score.weight"] + own["score.bias"])
        return (last @ own["score.last"])[..., 0]

    def network(self) -> RelationalNetwork:
        """Return a copy of the network for numpy."""
        return RelationalNetwork(
            self.size,
            {name: weight.detach().numpy().copy() for name, weight in self.parameters.items()},
        )

    def _attend(
        self, layer: int, hidden: torch.Tensor, pairs: torch.Tensor, absent: torch.Tensor
    ) -> torch.Tensor:
        size, own = self.size, self.parameters
        batch, count = hidden.shape[:2]
        each = size.width // size.heads
        parts = (hidden @ own[f"{layer}.ask"]).reshape(batch, count, 3, size.heads, each)
        queries, keys, values = (parts[:, :, part].transpose(1, 2) for part in range(3))
        weights = queries @ keys.transpose(2, 3) / math.sqrt(each)
        weights = weights + (pairs @ own[f"{layer}.weigh"]).permute(0, 3, 1, 2)
        weights = torch.softmax(weights.masked_fill(absent, -1e9), dim=3)
        # Weighted pairs of every element and head, shape (batch, n, heads, pair width).
        weighted = weights.permute(0, 2, 1, 3) @ pairs
        widening = own[f"{layer}.tell"].reshape(size.pair_width, size.heads, each)
        messages = (weights @ values).transpose(1, 2)
        messages = messages + torch.einsum("bihp,phd->bihd", weighted, widening)
        return messages.reshape(batch, count, size.width) @ own[f"{layer}.mix"]


def _normalise(values: torch.Tensor) -> torch.Tensor:
    return values / torch.sqrt((values * values).mean(dim=-1, keepdim=True) + _EPSILON)


class RelationalLearning:
    """A network that learns on boards, round by round.

    Parameters
    ----------
    boards
        At least one board.
    size
        Dimensions of the network.
    seed
        Seed of all randomness, >= 0.
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
        """The current network."""
        return self._torch.network()

    @property
    def states(self) -> int:
        """Number of states to learn from."""
        return len(self._lessons)

    def walk(self, boards: Sequence[Board] | None = None) -> None:
        """Add states of roll-outs on the boards: first random ones, then the network's."""
        choose = self._choose_random if not self._lessons else self._greedy_choice(self.network)
        for board in self._boards if boards is None else boards:
            self._lessons.add(board.walk(choose, self._chance, self._slips))

    def learn(self, updates: int, stop: Callable[[], bool], share: tuple[float, float]) -> float:
        """Update from the states; return the mean regret of the last updates.

        Parameters
        ----------
        updates
            Number of updates.
        stop
            Returns True to stop early.
        share
            Begin and end of this round as shares of the training; the learning rate falls.
        """
        losses = []
        for update in range(updates):
            if stop():
                break
            progress = share[0] + (share[1] - share[0]) * update / updates
            self._adam.param_groups[0]["lr"] = self._rate * max(0.02, 1.0 - progress)
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
        """Return the loss and the expected regret.

        The loss is the cross entropy to the teacher's soft choice plus the expected regret.
        """
        features, pairs, present, usable, regrets = batch
        scores = self._torch.scores(features, pairs, present).masked_fill(~usable, -1e9)
        logs = torch.log_softmax(scores, dim=1)
        choice = torch.softmax((-self._sharpness * regrets).masked_fill(~usable, -1e9), dim=1)
        expected = (logs.exp() * regrets).sum(dim=1)
        cross_entropy = -(choice * logs).sum(dim=1)
        loss = (cross_entropy + self._sharpness * expected).mean()
        return loss, float(expected.detach().mean())

    def _choose_random(self, graph: ElementGraph) -> int:
        usable = [place for place, route in enumerate(graph.routes) if route is not None]
        return int(self._chance.choice(usable))

    @staticmethod
    def _greedy_choice(network: RelationalNetwork) -> Callable[[ElementGraph], int]:
        def choose(graph: ElementGraph) -> int:
            usable = np.array([route is not None for route in graph.routes])
            return int(np.argmax(np.where(usable, network.scores(graph), -np.inf)))

        return choose
