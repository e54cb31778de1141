"""A network over elements and their relations, evaluated with numpy alone.

Attention with weights and messages that depend on the pair (Vaswani et al., "Attention is all you
need", 2017; Shaw et al., "Self-attention with relative position representations", 2018). It scores
any number of elements, independent of their order.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from skillplan.model.skill_model import SkillModel
from skillplan.solvers.learning.family_learner import FamilyPolicy
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan_torch.relational.elements import (
    ELEMENT_FEATURES,
    PAIR_FEATURES,
    ElementGraph,
    ElementOrder,
    ElementPaths,
    ElementView,
)

Figures = NDArray[np.float32]

_EPSILON = 1e-6


@dataclass(frozen=True)
class NetworkSize:
    """Dimensions of a relational network.

    Parameters
    ----------
    width
        Units per element, a multiple of `heads`.
    heads
        Attention heads.
    layers
        Attention layers.
    pair_width
        Units per pair.
    """

    width: int = 64
    heads: int = 4
    layers: int = 3
    pair_width: int = 16

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Return the shapes of all arrays by name."""
        width, pair = self.width, self.pair_width
        shapes: dict[str, tuple[int, ...]] = {
            "enter.weight": (len(ELEMENT_FEATURES), width),
            "enter.bias": (width,),
            "pair.weight": (len(PAIR_FEATURES), pair),
            "pair.bias": (pair,),
            "score.weight": (width, width),
            "score.bias": (width,),
            "score.last": (width, 1),
        }
        for layer in range(self.layers):
            shapes |= {
                f"{layer}.ask": (width, 3 * width),
                f"{layer}.weigh": (pair, self.heads),
                f"{layer}.tell": (pair, width),
                f"{layer}.mix": (width, width),
                f"{layer}.widen": (width, 2 * width),
                f"{layer}.widen_bias": (2 * width,),
                f"{layer}.narrow": (2 * width, width),
                f"{layer}.narrow_bias": (width,),
            }
        return shapes


@dataclass(frozen=True)
class RelationalNetwork(FamilyPolicy):
    """Scores elements; the greedy policy goes to the best element that can be begun.

    Parameters
    ----------
    size
        Dimensions of the network.
    arrays
        Weights by name, float32; shapes as in `NetworkSize.shapes`.

    Raises
    ------
    ValueError
        If arrays are missing, of other shapes, or not finite.
    """

    element_features = ELEMENT_FEATURES
    pair_features = PAIR_FEATURES
    size: NetworkSize
    arrays: Mapping[str, Figures]

    def __post_init__(self) -> None:
        shapes = self.size.shapes()
        if set(shapes) != set(self.arrays):
            raise ValueError("The arrays of a relational network have other names.")
        for name, shape in shapes.items():
            array = self.arrays[name]
            if array.shape != shape or array.dtype != np.float32:
                raise ValueError(f"{name} is {array.dtype} {array.shape}, not float32 {shape}.")
            if not np.isfinite(array).all():
                raise ValueError(f"{name} has figures that are not finite.")

    @property
    def weights(self) -> Mapping[str, Figures]:
        """Weights by name."""
        return self.arrays

    @property
    def dimensions(self) -> dict[str, int]:
        """Dimensions of the network by name."""
        return asdict(self.size)

    @classmethod
    def build(cls, dimensions: Mapping[str, int], arrays: Mapping[str, Figures]) -> Self:
        """Return a stored policy; raises ValueError if the arrays do not fit."""
        return cls(NetworkSize(**dimensions), arrays)

    def choice_on(self, model: SkillModel) -> ElementChoice:
        """Return the greedy choice on a task; raises what `ElementChoice` raises."""
        return ElementChoice(self, model)

    def scores(self, graph: ElementGraph) -> Figures:
        """Return a score for every element, shape (n,)."""
        arrays, size = self.arrays, self.size
        hidden = _rectify(graph.features @ arrays["enter.weight"] + arrays["enter.bias"])
        pairs = _rectify(graph.pairs @ arrays["pair.weight"] + arrays["pair.bias"])
        for layer in range(size.layers):
            hidden = hidden + self._attend(layer, _normalise(hidden), pairs)
            wide = _normalise(hidden) @ arrays[f"{layer}.widen"] + arrays[f"{layer}.widen_bias"]
            hidden = hidden + _rectify(wide) @ arrays[f"{layer}.narrow"]
            hidden = hidden + arrays[f"{layer}.narrow_bias"]
        last = _rectify(_normalise(hidden) @ arrays["score.weight"] + arrays["score.bias"])
        scores: Figures = (last @ arrays["score.last"])[:, 0]
        return scores

    def _attend(self, layer: int, hidden: Figures, pairs: Figures) -> Figures:
        """Return the messages that elements receive, shape (n, width)."""
        size, count = self.size, len(hidden)
        each = size.width // size.heads
        parts = (hidden @ self.arrays[f"{layer}.ask"]).reshape(count, 3, size.heads, each)
        queries, keys, values = parts[:, 0], parts[:, 1], parts[:, 2]
        weights = np.einsum("ihd,jhd->hij", queries, keys) / np.float32(np.sqrt(each))
        weights = weights + (pairs @ self.arrays[f"{layer}.weigh"]).transpose(2, 0, 1)
        weights = np.exp(weights - weights.max(axis=2, keepdims=True))
        weights = weights / weights.sum(axis=2, keepdims=True)
        messages = np.matmul(weights, values.transpose(1, 0, 2))
        # Messages of pairs are linear, so pairs are weighted before they are widened.
        weighted = np.einsum("hij,ijp->hip", weights, pairs)
        widening = self.arrays[f"{layer}.tell"].reshape(size.pair_width, size.heads, each)
        messages = messages + np.matmul(weighted, widening.transpose(1, 0, 2))
        joined: Figures = messages.transpose(1, 0, 2).reshape(count, size.width)
        return joined @ self.arrays[f"{layer}.mix"]


def _rectify(values: Figures) -> Figures:
    rectified: Figures = np.maximum(values, np.float32(0.0))
    return rectified


def _normalise(values: Figures) -> Figures:
    """Return rows of root mean square 1."""
    squares = (values * values).mean(axis=-1, keepdims=True)
    rows: Figures = values / np.sqrt(squares + np.float32(_EPSILON))
    return rows


class ElementChoice:
    """Goes to the element of the best score, by the first skill of its route.

    The score of a skill is the best score of the elements whose routes begin with it. Only
    applicable skills count; of equals the first. Back ends are queried for the precedence only,
    once.

    Parameters
    ----------
    network
        Network that scores elements.
    model
        Model of the task.

    Raises
    ------
    OptionError
        If the task has no elements to score.
    BackEndError
        If a back end fails.
    """

    def __init__(self, network: RelationalNetwork, model: SkillModel) -> None:
        self._network, self._model = network, model
        paths = ElementPaths(model.task)
        self.view = ElementView(paths, ElementOrder.of(model))

    def scores(self, state: State) -> dict[str, float]:
        """Return the score of every applicable skill; minus infinity if it leads nowhere."""
        scores = {skill.name: -np.inf for skill in self._model.applicable(state)}
        graph = self.view(state)
        if not len(graph.elements):
            return scores
        for route, score in zip(graph.routes, self._network.scores(graph).tolist(), strict=True):
            if route is not None and route.first in scores:
                scores[route.first] = max(scores[route.first], score)
        return scores

    def __call__(self, state: State) -> Skill:
        """Return the skill for a state; the task's first if none is applicable."""
        applicable = self._model.applicable(state)
        if len(applicable) == 1:
            return applicable[0]
        scores = self.scores(state)
        if not scores:
            return self._model.task.skills[0]
        return self._model.task.skill(max(scores, key=scores.__getitem__))
