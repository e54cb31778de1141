"""A network over elements and their relations, evaluated with numpy alone.

Attention whose weights and messages depend on the pair (after Vaswani et al., "Attention is all
you need", 2017, and Shaw et al., "Self-attention with relative position representations", 2018);
scores of n elements, independent of their order and defined for every n.
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
    ElementOrder,
    ElementPaths,
    ElementView,
    Sight,
)

Figures = NDArray[np.float32]

_EPSILON = 1e-6


@dataclass(frozen=True)
class NetworkSize:
    """How large a relational network is.

    Parameters
    ----------
    width
        Of what is known of an element, a multiple of `heads`.
    heads
        How many weightings of the other elements there are.
    layers
        How often elements tell each other what they know.
    pair_width
        Of what is known of a pair.
    """

    width: int = 64
    heads: int = 4
    layers: int = 3
    pair_width: int = 16

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Return the shapes of all arrays by name."""
        width, pair = self.width, self.pair_width
        found: dict[str, tuple[int, ...]] = {
            "enter.weight": (len(ELEMENT_FEATURES), width),
            "enter.bias": (width,),
            "pair.weight": (len(PAIR_FEATURES), pair),
            "pair.bias": (pair,),
            "score.weight": (width, width),
            "score.bias": (width,),
            "score.last": (width, 1),
        }
        for layer in range(self.layers):
            found |= {
                f"{layer}.ask": (width, 3 * width),
                f"{layer}.weigh": (pair, self.heads),
                f"{layer}.tell": (pair, width),
                f"{layer}.mix": (width, width),
                f"{layer}.widen": (width, 2 * width),
                f"{layer}.widen_bias": (2 * width,),
                f"{layer}.narrow": (2 * width, width),
                f"{layer}.narrow_bias": (width,),
            }
        return found


@dataclass(frozen=True)
class RelationalNetwork(FamilyPolicy):
    """Scores elements; the greedy policy goes to the best of those that can be begun.

    Parameters
    ----------
    size
        Of the network.
    arrays
        By name, as `NetworkSize.shapes` says, float32.

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
        wanted = self.size.shapes()
        if set(wanted) != set(self.arrays):
            raise ValueError("The arrays of a relational network have other names.")
        for name, shape in wanted.items():
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

    def scores(self, sight: Sight) -> Figures:
        """Return a score for every element that is seen, shape (n,)."""
        arrays, size = self.arrays, self.size
        known = _rectified(sight.features @ arrays["enter.weight"] + arrays["enter.bias"])
        pairs = _rectified(sight.pairs @ arrays["pair.weight"] + arrays["pair.bias"])
        for layer in range(size.layers):
            known = known + self._told(layer, _normal(known), pairs)
            wide = _normal(known) @ arrays[f"{layer}.widen"] + arrays[f"{layer}.widen_bias"]
            known = known + _rectified(wide) @ arrays[f"{layer}.narrow"]
            known = known + arrays[f"{layer}.narrow_bias"]
        last = _rectified(_normal(known) @ arrays["score.weight"] + arrays["score.bias"])
        scores: Figures = (last @ arrays["score.last"])[:, 0]
        return scores

    def _told(self, layer: int, known: Figures, pairs: Figures) -> Figures:
        """Return what elements tell each other, shape (n, width)."""
        size, count = self.size, len(known)
        each = size.width // size.heads
        parts = (known @ self.arrays[f"{layer}.ask"]).reshape(count, 3, size.heads, each)
        asked, offered, said = parts[:, 0], parts[:, 1], parts[:, 2]
        weights = np.einsum("ihd,jhd->hij", asked, offered) / np.float32(np.sqrt(each))
        weights = weights + (pairs @ self.arrays[f"{layer}.weigh"]).transpose(2, 0, 1)
        weights = np.exp(weights - weights.max(axis=2, keepdims=True))
        weights = weights / weights.sum(axis=2, keepdims=True)
        told = np.matmul(weights, said.transpose(1, 0, 2))
        # What is said of a pair is linear, so that pairs are weighed before they are widened.
        weighed = np.einsum("hij,ijp->hip", weights, pairs)
        of_pairs = self.arrays[f"{layer}.tell"].reshape(size.pair_width, size.heads, each)
        told = told + np.matmul(weighed, of_pairs.transpose(1, 0, 2))
        heard: Figures = told.transpose(1, 0, 2).reshape(count, size.width)
        return heard @ self.arrays[f"{layer}.mix"]


def _rectified(values: Figures) -> Figures:
    found: Figures = np.maximum(values, np.float32(0.0))
    return found


def _normal(values: Figures) -> Figures:
    """Return rows of root mean square 1."""
    squares = (values * values).mean(axis=-1, keepdims=True)
    found: Figures = values / np.sqrt(squares + np.float32(_EPSILON))
    return found


class ElementChoice:
    """Goes to the element of the best score, by the first skill of the way there.

    A skill's score is the best score of the elements that it leads to. Only applicable skills
    count; of equals the first. Back ends are queried for the precedence only, here and never
    again.

    Parameters
    ----------
    network
        What scores.
    model
        Of the task.

    Raises
    ------
    OptionError
        If the task has no elements that could be scored.
    BackEndError
        If a back end fails.
    """

    def __init__(self, network: RelationalNetwork, model: SkillModel) -> None:
        self._network, self._model = network, model
        paths = ElementPaths(model.task)
        self.view = ElementView(paths, ElementOrder.of(model))

    def scores(self, state: State) -> dict[str, float]:
        """Return the score of every applicable skill; minus infinity of one that leads nowhere."""
        found = {skill.name: -np.inf for skill in self._model.applicable(state)}
        sight = self.view(state)
        if not len(sight.elements):
            return found
        for way, score in zip(sight.ways, self._network.scores(sight).tolist(), strict=True):
            if way is not None and way.first in found:
                found[way.first] = max(found[way.first], score)
        return found

    def __call__(self, state: State) -> Skill:
        """Return the skill that is taken in a state; the task's first where none is applicable."""
        applicable = self._model.applicable(state)
        if len(applicable) == 1:
            return applicable[0]
        scores = self.scores(state)
        if not scores:
            return self._model.task.skills[0]
        return self._model.task.skill(max(scores, key=scores.__getitem__))
