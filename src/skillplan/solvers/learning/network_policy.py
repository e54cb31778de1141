"""A policy as a feed-forward network: from an observation to a score for every action.

It is evaluated with numpy alone, so that a stored policy needs neither the library that it was
trained with nor code of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float32]


@dataclass(frozen=True)
class NetworkPolicy:
    """Scores of actions; the greedy policy takes the best, of equals the first.

    Parameters
    ----------
    weights
        Weights of every layer, shape (inputs, outputs), float32; at least one layer. Rectified
        outputs of a layer are the inputs of the next.
    biases
        Biases of every layer, shape (outputs,), float32.

    Raises
    ------
    ValueError
        If shapes do not fit or a figure is not finite.
    """

    weights: tuple[Vector, ...]
    biases: tuple[Vector, ...]

    def __post_init__(self) -> None:
        if not self.weights or len(self.weights) != len(self.biases):
            raise ValueError("A network has at least one layer, each of weights and biases.")
        width = self.weights[0].shape[0]
        for weight, bias in zip(self.weights, self.biases, strict=True):
            if weight.ndim != 2 or weight.shape[0] != width or bias.shape != weight.shape[1:]:
                raise ValueError("The layers of a network do not fit each other.")
            if not (np.isfinite(weight).all() and np.isfinite(bias).all()):
                raise ValueError("The figures of a network must be finite.")
            width = weight.shape[1]

    @property
    def inputs(self) -> int:
        """Number of features."""
        return int(self.weights[0].shape[0])

    @property
    def actions(self) -> int:
        """Number of actions."""
        return int(self.weights[-1].shape[1])

    def scores(self, observations: Vector) -> Vector:
        """Return a score for every action.

        Parameters
        ----------
        observations
            Shape (n, inputs).

        Returns
        -------
        ndarray
            Shape (n, actions), float32.
        """
        layer = np.asarray(observations, dtype=np.float32)
        last = len(self.weights) - 1
        for depth, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            layer = layer @ weight + bias
            if depth < last:
                layer = np.maximum(layer, 0.0)
        return layer

    def greedy(
        self, observations: Vector, masks: NDArray[np.bool_] | None = None
    ) -> NDArray[np.int64]:
        """Return the action of the best score among those allowed, shape (n,).

        Parameters
        ----------
        observations
            Shape (n, inputs).
        masks
            Allowed actions, shape (n, actions); None, or an empty row, allows all.
        """
        best: NDArray[np.int64] = np.argmax(
            allowed_scores(self.scores(observations), masks), axis=1
        )
        return best

    def sample(
        self,
        observations: Vector,
        masks: NDArray[np.bool_] | None,
        uniforms: NDArray[np.float64],
        temperature: float,
    ) -> NDArray[np.int64]:
        """Return actions drawn with probabilities proportional to exp(score / temperature).

        Parameters
        ----------
        observations, masks
            As for `greedy`.
        uniforms
            A random number in [0, 1) for every row, shape (n,).
        temperature
            > 0.

        Raises
        ------
        ValueError
            If the temperature is not above 0.
        """
        if not temperature > 0:
            raise ValueError(f"Temperature must be > 0, not {temperature}.")
        scores = allowed_scores(self.scores(observations), masks).astype(np.float64) / temperature
        weights = np.exp(scores - scores.max(axis=1, keepdims=True))
        totals = np.cumsum(weights, axis=1)
        drawn: NDArray[np.int64] = (totals <= uniforms[:, None] * totals[:, -1:]).sum(axis=1)
        return np.minimum(drawn, self.actions - 1)


@dataclass(frozen=True, slots=True)
class ActionRule:
    """How a policy draws its actions from scores.

    Parameters
    ----------
    kind
        ``softmax`` draws with probabilities proportional to exp(score / value); ``epsilon-greedy``
        takes the best score, and with probability `value` a random allowed action.
    value
        Temperature > 0, or epsilon in [0, 1].

    Raises
    ------
    ValueError
        If the value is out of range.
    """

    kind: Literal["softmax", "epsilon-greedy"]
    value: float

    def __post_init__(self) -> None:
        fits = self.value > 0 if self.kind == "softmax" else 0 <= self.value <= 1
        if not fits:
            raise ValueError(f"The {self.words} is out of range.")

    @property
    def words(self) -> str:
        """The rule in words, such as ``temperature 1``."""
        return f"{'temperature' if self.kind == 'softmax' else 'epsilon'} {self.value:g}"

    def draw(
        self,
        policy: NetworkPolicy,
        observations: Vector,
        masks: NDArray[np.bool_] | None,
        uniforms: NDArray[np.float64],
    ) -> NDArray[np.int64]:
        """Return actions of a policy; parameters as for `NetworkPolicy.sample`."""
        if self.kind == "softmax":
            return policy.sample(observations, masks, uniforms, self.value)
        best = policy.greedy(observations, masks)
        explores = uniforms < self.value
        if not explores.any():
            return best
        every = np.ones((len(best), policy.actions), dtype=np.bool_) if masks is None else masks
        # Below epsilon, the random number is evenly spread again after division by it.
        drawn = random_actions(every, np.minimum(uniforms / self.value, 1.0 - 1e-12))
        return np.where(explores, drawn, best)


GREEDY = ActionRule("epsilon-greedy", 0.0)


def allowed_scores(scores: Vector, masks: NDArray[np.bool_] | None) -> Vector:
    """Return the scores with minus infinity where an action is not allowed.

    An empty row allows everything; see `allowing`.
    """
    if masks is None:
        return scores
    return np.where(allowing(masks), scores, np.float32(-np.inf))


def allowing(masks: NDArray[np.bool_] | NDArray[np.int8]) -> NDArray[np.bool_]:
    """Return bool masks, shape (n, actions); a row that allows no action becomes all ones.

    Without an allowed action, any action ends the episode.
    """
    allowed = masks.astype(np.bool_, copy=False)
    return allowed | ~allowed.any(axis=1, keepdims=True)


def random_actions(masks: NDArray[np.bool_], uniforms: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return uniformly random actions among those allowed, shape (n,).

    Parameters
    ----------
    masks
        Shape (n, actions); an empty row allows all.
    uniforms
        A random number in [0, 1) for every row, shape (n,).
    """
    totals = np.cumsum(allowing(masks), axis=1)
    drawn: NDArray[np.int64] = (totals <= uniforms[:, None] * totals[:, -1:]).sum(axis=1)
    return drawn


@dataclass(frozen=True)
class NamedNetwork:
    """A network with names of its inputs and outputs.

    Parameters
    ----------
    network
        The network.
    features
        Name of every input.
    actions
        Skill of every output.
    """

    network: NetworkPolicy
    features: tuple[str, ...]
    actions: tuple[str, ...]

    def carried_over(self, features: Sequence[str], actions: Sequence[str]) -> NetworkPolicy:
        """Return a network for other features and skills.

        Inputs and outputs of equal names are copied. An unknown feature has weight 0; an unknown
        skill gets the mean score of the known ones. If all features and skills are known, the
        greedy choice is the old one if unknown features are 0 and the best skill is known.

        Parameters
        ----------
        features, actions
            Names on the other task.

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
        for arrays in (weights, biases):
            last = arrays[-1]
            mean = last[..., outputs[known]].mean(-1, keepdims=True, dtype=np.float32)
            arrays[-1] = np.where(known, last[..., outputs], mean)
        return NetworkPolicy(
            tuple(np.ascontiguousarray(weight) for weight in weights),
            tuple(np.ascontiguousarray(bias) for bias in biases),
        )


def _places(known: Sequence[str], names: Sequence[str]) -> NDArray[np.int64]:
    """Return the place of every name among the known ones; -1 if it is unknown."""
    places = {name: place for place, name in enumerate(known)}
    return np.array([places.get(name, -1) for name in names], dtype=np.int64)


def lookup_network(
    observations: NDArray[np.float32], actions: NDArray[np.int64], count: int
) -> NetworkPolicy:
    """Return a network that takes a given action at each of some observations of bits.

    Each observation has a hidden unit that is 1 there and 0 at all others; the unit scores the
    action by 1. If no unit is active, all scores are 0.

    Parameters
    ----------
    observations
        Bits, shape (n, features).
    actions
        Shape (n,).
    count
        Number of actions to choose from.
    """
    rows = np.asarray(observations, dtype=np.float32)
    units = max(1, len(rows))
    weights = np.zeros((rows.shape[1], units), dtype=np.float32)
    biases = np.zeros(units, dtype=np.float32)
    scores = np.zeros((units, count), dtype=np.float32)
    weights[:, : len(rows)] = (2.0 * rows - 1.0).T
    biases[: len(rows)] = 1.0 - rows.sum(axis=1)
    scores[np.arange(len(rows)), actions] = 1.0
    return NetworkPolicy((weights, scores), (biases, np.zeros(count, dtype=np.float32)))
