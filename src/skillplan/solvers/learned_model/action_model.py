"""Action schemas learned from steps: preconditions, effects and costs, and the goal.

Actions set and clear bits and need conjunctions of literals (Walsh and Littman, "Efficient
learning of action schemas and web-service descriptions", 2008). The cost of an action depends on
the action before it, because it depends on where the robot is.

A literal is an observed bit or its negation. Sets of literals are packed in words: first the set
bits, then the unset ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan.solvers.learned_model.plan_search import Rules, Words
from skillplan.solvers.learning.episode_training import (
    Arrays,
    copy_arrays,
    read_array,
    restore_arrays,
)

_WORD = 64
# Most failures kept for an action.
_MOST_FAILURES = 256
# Range of the factor on an unseen cost, drawn for every run.
_COST_FACTORS = 0.9, 1.0
# Number of losses after which a bit counts as passing.
_LOSSES = 3


@dataclass(frozen=True)
class CompiledConditions:
    """Preconditions of all actions in the form of `Rules`.

    Parameters
    ----------
    sure
        Literals under which an action certainly succeeds, shape (actions, words).
    needed
        Literals without one of which it certainly fails, shape (actions, words).
    lacking
        Sets of literals, one of each of which must hold, shape (n, words).
    first
        Index of an action's first set in `lacking`, shape (actions + 1,).
    """

    sure: Words
    needed: Words
    lacking: Words
    first: NDArray[np.int64]


class Conditions:
    """Preconditions as conjunctions of literals, learned from successes and failures.

    The version space of a conjunction is bounded from both sides (Mitchell, "Version spaces",
    1977): an action needs at most the literals that held at every success, and at least one of
    the literals that did not hold at a failure. If no conjunction explains a failure, only the
    same observation is known to fail.

    Parameters
    ----------
    actions, words
        Number of actions, and of words of literals.

    Attributes
    ----------
    succeeded
        True for actions that ever succeeded, shape (actions,).
    needed
        Literals without one of which an action certainly fails, shape (actions, words).
    """

    def __init__(self, actions: int, words: int) -> None:
        self.succeeded = np.zeros(actions, dtype=np.bool_)
        self.needed = np.zeros((actions, words), dtype=np.uint64)
        # Literals that held at every success.
        self._held = np.full((actions, words), np.uint64(2**64 - 1))
        none = np.zeros((0, words), dtype=np.uint64)
        # For every failure the literals that did not hold, and the possible explanations.
        self._failures, self._lacking = [none] * actions, [none] * actions
        # Literals that each literal implies.
        self._implied = np.zeros((_WORD * words, words), dtype=np.uint64)
        self._implying = np.zeros(0, dtype=np.int64)
        self._compiled: CompiledConditions | None = None

    def imply(self, implied: Words) -> None:
        """Set the literals that each literal implies, shape (64 * words, words).

        If an action may need a literal, its implied literals are not considered.
        """
        if (implied != self._implied).any():
            self._implied = implied.copy()
            self._implying = np.flatnonzero(implied.any(axis=1))
            self._compiled = None
            for action in range(len(self._held)):
                self._explain(action)

    def succeed(self, actions: NDArray[np.int64], literals: Words) -> None:
        """Learn that actions succeed where these literals hold, shape (words,)."""
        held = self._held[actions]
        left = held & literals
        for action in actions[(left != held).any(axis=1)].tolist():
            self._held[action] &= literals
            self.succeeded[action] = True
            self._explain(action)

    def fail(self, action: int, literals: Words) -> None:
        """Learn that an action fails where exactly these literals hold."""
        known = self._failures[action]
        if not (known == ~literals).all(axis=1).any():
            self._failures[action] = np.concatenate([known, ~literals[None]])[-_MOST_FAILURES:]
            self._explain(action)

    def fail_all(self, actions: NDArray[np.int64], literals: Words) -> None:
        """Learn that several actions fail; failures that are known already are skipped."""
        for action in actions[~(self.needed[actions] & ~literals).any(axis=1)].tolist():
            if not self.refutes(action, literals):
                self.fail(action, literals)

    def refutes(self, action: int, literals: Words) -> bool:
        """Return whether an action certainly fails where these literals hold."""
        if (self.needed[action] & ~literals).any():
            return True
        return bool((~(self._lacking[action] & literals).any(axis=1)).any())

    def compile(self) -> CompiledConditions:
        """Return the learned preconditions."""
        if self._compiled is None:
            counts = [len(sets) for sets in self._lacking]
            self._compiled = CompiledConditions(
                self._possible(),
                self.needed.copy(),
                np.concatenate(self._lacking),
                np.cumsum([0, *counts]),
            )
        return self._compiled

    def compile_failures(self, relevant: Words) -> CompiledConditions:
        """Return preconditions that exclude only observations that have failed.

        Parameters
        ----------
        relevant
            Literals by which observations are distinguished, shape (words,).
        """
        return CompiledConditions(
            self._possible(),
            np.zeros_like(self.needed),
            np.concatenate(self._failures) & relevant,
            np.cumsum([0, *(len(failures) for failures in self._failures)]),
        )

    def arrays(self, name: str) -> Arrays:
        """Return copies of all arrays for `read`."""
        return {
            f"{name}.succeeded": self.succeeded.copy(),
            f"{name}.held": self._held.copy(),
            f"{name}.implied": self._implied.copy(),
            f"{name}.failures": np.concatenate(self._failures),
            f"{name}.counts": np.array([len(rows) for rows in self._failures], dtype=np.int64),
        }

    def read(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore what `arrays` returned.

        Raises
        ------
        ValueError
            If it has another shape.
        """
        actions, words = self._held.shape
        self.succeeded = read_array(arrays, f"{name}.succeeded", (actions,)).copy()
        self._held = read_array(arrays, f"{name}.held", (actions, words)).copy()
        self._implied = read_array(arrays, f"{name}.implied", self._implied.shape).copy()
        self._implying = np.flatnonzero(self._implied.any(axis=1))
        counts = read_array(arrays, f"{name}.counts", (actions,)).tolist()
        rows = read_array(arrays, f"{name}.failures", (sum(counts), words))
        ends = np.cumsum([0, *counts]).tolist()
        for action in range(actions):
            self._failures[action] = rows[ends[action] : ends[action + 1]].copy()
            self._explain(action)

    def _possible(self, actions: NDArray[np.int64] | slice = slice(None)) -> Words:
        """Return the literals that actions may need, without implied ones."""
        held = self._held[actions]
        if not len(self._implying):
            return held.copy()
        rows = self._implying
        has = held[:, rows // _WORD] >> (rows % _WORD).astype(np.uint64) & np.uint64(1)
        implied = np.where(has[:, :, None] != 0, self._implied[rows], np.uint64(0))
        possible: Words = held & ~np.bitwise_or.reduce(implied, axis=1)
        return possible

    def _explain(self, action: int) -> None:
        """Update the literals that an action needs after a new success or failure."""
        self._compiled = None
        failures = self._failures[action]
        if not len(failures):
            return
        lacking = failures & self._possible(np.array([action]))
        # No conjunction explains these failures: only the same observations are known to fail.
        contradictory = ~lacking.any(axis=1)
        lacking[contradictory] = failures[contradictory]
        single = np.bitwise_count(lacking).sum(axis=1) == 1
        self.needed[action] = np.bitwise_or.reduce(lacking[single], axis=0)
        # A set with a literal that is needed anyway adds nothing.
        self._lacking[action] = lacking[~single & ~(lacking & self.needed[action]).any(axis=1)]


class ActionModel:
    """Schemas of all actions and the goal, as one run has learned them.

    Parameters
    ----------
    features, actions
        Number of observed bits, and of actions.
    generator
        Draws how much cheaper unseen costs may be.

    Attributes
    ----------
    allowed, feasible
        Preconditions of being allowed by the mask, and of succeeding.
    contradicted
        Actions whose effects differed between states, shape (actions,): no schema fits them.
    """

    def __init__(self, features: int, actions: int, generator: np.random.Generator) -> None:
        self._features, self._actions = features, actions
        self.words = -(-features // _WORD)
        self.allowed = Conditions(actions, 2 * self.words)
        self.feasible = Conditions(actions, 2 * self.words)
        self.contradicted = np.zeros(actions, np.bool_)
        shape = (actions, self.words)
        self._sets, self._clears = np.zeros(shape, np.uint64), np.zeros(shape, np.uint64)
        # Bits that lasted through an action that does not set them.
        self._lasted = np.zeros(self.words, np.uint64)
        # Number of steps that cleared each bit, unless the bit is known to last.
        self._lost = np.zeros(self.words * _WORD, np.int64)
        # Literals that an action made true, and false.
        self._made, self._undone = np.zeros((2, 2 * self.words), np.uint64)
        # For every bit the bits that were set together with it.
        self._together = np.zeros((self.words * _WORD, self.words), np.uint64)
        self._apart = b"", b""
        self._costs = np.full((actions + 1, actions), np.nan)
        self._factors = generator.uniform(*_COST_FACTORS, self._costs.shape)
        self._goal: Words | None = None
        self._confirmed = np.zeros(2 * self.words, np.uint64)

    @property
    def completed(self) -> bool:
        """True if an episode has completed the task."""
        return self._goal is not None

    @property
    def lasting(self) -> Words:
        """Literals that were made true and never undone."""
        lasting: Words = self._made & ~self._undone
        return lasting

    @property
    def goal(self) -> Words:
        """Lasting literals that held at every completion; none before the first."""
        none = np.zeros_like(self._made)
        return none if self._goal is None else self._goal & self.lasting

    @property
    def _passing(self) -> Words:
        """Bits that every step clears, unless an action sets them."""
        often = np.packbits(self._lost >= _LOSSES, bitorder="little").view(np.uint64)
        passing: Words = often & ~self._lasted
        return passing

    def bits(self, observation: NDArray[np.float32]) -> Words:
        """Return an observation as bits, shape (words,)."""
        packed = np.zeros(self.words * _WORD, dtype=np.uint8)
        packed[: self._features] = observation > 0.5
        return np.packbits(packed, bitorder="little").view(np.uint64)

    def literals(self, bits: Words) -> Words:
        """Return the literals that hold."""
        return np.concatenate([bits, ~bits])

    def observe(self, bits: Words, mask: NDArray[np.bool_]) -> None:
        """Learn which actions are allowed at a new observation."""
        literals = self.literals(bits)
        self._together[np.flatnonzero(_unpack(bits[None])[0])] |= bits
        if self._goal is not None:
            self._confirm_single(literals)
        if not mask.all():
            self.allowed.succeed(np.flatnonzero(mask), literals)
            self.allowed.fail_all(np.flatnonzero(~mask), literals)
        elif self.allowed.succeeded.any():
            # `allowing` has turned an empty mask into a full one.
            self.allowed.fail_all(np.arange(self._actions), literals)

    def forbid(self, bits: Words, action: int) -> None:
        """Learn that an action is not allowed."""
        self.allowed.fail(action, self.literals(bits))

    def fail(self, bits: Words, action: int) -> None:
        """Learn that an action fails."""
        self.feasible.fail(action, self.literals(bits))

    def succeed(
        self, bits: Words, last: int, action: int, after: Words, cost: float, *, complete: bool
    ) -> None:
        """Learn from an action that succeeded.

        Parameters
        ----------
        bits, after
            Observations before and after the action.
        last
            Action before it; -1 at the start.
        action
            The action.
        cost
            Its cost.
        complete
            True if it completed the task.
        """
        literals, result = self.literals(bits), self.literals(after)
        self.feasible.succeed(np.array([action]), literals)
        self._sets[action] |= after & ~bits
        cleared = bits & ~after
        self._clears[action] |= cleared
        if (cleared & ~self._lasted).any():
            self._lost += _unpack(cleared[None])[0]
        self._lasted |= bits & after & ~self._sets[action]
        self._made |= result & ~literals
        self._undone |= literals & ~result
        self._costs[last + 1, action] = cost
        self._imply_places()
        if complete:
            self._goal = result if self._goal is None else self._goal & result
        # The step itself has been learned, so only an effect of another state can differ.
        if (self.predict(bits, action) != after).any():
            self.contradicted[action] = True

    def predict(self, bits: Words, action: int) -> Words:
        """Return the predicted observation after an action."""
        predicted: Words = bits & ~self._passing & ~self._clears[action] | self._sets[action]
        return predicted

    def is_surprised(self, bits: Words, action: int, after: Words) -> bool:
        """Return whether the model expected an action to fail, or another observation."""
        if self.feasible.refutes(action, self.literals(bits)):
            return True
        return bool((self.predict(bits, action) != after).any())

    def rules(self, hope: float, conjunctions: bool = True) -> Rules:
        """Return the learned schemas for a search.

        Parameters
        ----------
        hope
            Unseen costs, as a share of the action's least known cost, in [0, 1].
        conjunctions
            True if actions need conjunctions to succeed; otherwise they fail only at
            observations at which they have failed, passing bits disregarded.
        """
        allowed, feasible = self.allowed.compile(), self.feasible.compile()
        allowed_if = allowed.sure if self.allowed.succeeded.any() else np.zeros_like(allowed.sure)
        if not conjunctions:
            passing = np.concatenate([self._passing, self._passing])
            feasible = self.feasible.compile_failures(~passing)
        return Rules(
            self._sets,
            self._clears,
            self._passing,
            self._estimate_costs(hope),
            ~self.feasible.succeeded,
            np.stack([allowed_if, feasible.sure]),
            np.stack([allowed.needed, feasible.needed]),
            np.concatenate([allowed.lacking, feasible.lacking]),
            np.stack([allowed.first, feasible.first + len(allowed.lacking)]),
        )

    def progress(self, costs: NDArray[np.float64]) -> tuple[Words, NDArray[np.float64]]:
        """Return the literals that count as progress, and the least cost of each.

        Among literals that the same actions make true, only one counts.

        Parameters
        ----------
        costs
            Costs of actions as in `Rules`.

        Returns
        -------
        counted, weights
            Shapes (2 * words,) and (2 * words * 64,).
        """
        cheapest = costs.min(axis=0)
        weights = np.zeros(2 * self.words * _WORD)
        counted = np.zeros(2 * self.words, np.uint64)
        for makers, literals in self._group_by_makers(
            self.goal if self.completed else self.lasting
        ):
            counted |= _literal(literals[0], 2 * self.words)
            weights[literals[0]] = cheapest[makers].min()
        return counted, weights

    def doubts(self) -> list[Words]:
        """Return literals of the goal that may not be needed, grouped by the same makers."""
        return [
            np.bitwise_or.reduce([_literal(literal, 2 * self.words) for literal in literals])
            for _, literals in self._group_by_makers(self.goal & ~self._confirmed)
        ]

    def confirm(self, literals: Words) -> None:
        """Regard literals as needed by the goal, until an episode completes without them."""
        self._confirmed |= literals

    def arrays(self, name: str) -> Arrays:
        """Return copies of all arrays for `read`."""
        goal = np.zeros((0, 2 * self.words), np.uint64)
        arrays = {
            **copy_arrays(name, self._own_arrays()),
            f"{name}.goal": goal if self._goal is None else self._goal[None].copy(),
            **self.allowed.arrays(f"{name}.allowed"),
            **self.feasible.arrays(f"{name}.feasible"),
        }
        if self.contradicted.any():
            arrays[f"{name}.contradicted"] = self.contradicted.copy()
        return arrays

    def read(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Restore what `arrays` returned.

        Raises
        ------
        ValueError
            If it has another shape.
        """
        restore_arrays(name, self._own_arrays(), arrays)
        completions = len(arrays.get(f"{name}.goal", ()))
        goal = read_array(arrays, f"{name}.goal", (completions, 2 * self.words))
        self._goal = goal[0].copy() if completions else None
        self._apart = b"", b""
        self.allowed.read(f"{name}.allowed", arrays)
        self.feasible.read(f"{name}.feasible", arrays)
        self.contradicted[:] = arrays.get(f"{name}.contradicted", False)

    def _confirm_single(self, literals: Words) -> None:
        """Confirm a literal of the goal if nothing else is missing and the task is not done."""
        missing = self.goal & ~literals
        if (
            missing.any()
            and not (missing & self._confirmed).any()
            and len(self._group_by_makers(missing)) == 1
        ):
            self._confirmed |= missing

    def _imply_places(self) -> None:
        """Learn which passing bits exclude each other, such as places of the robot."""
        passing = np.flatnonzero(_unpack(self._passing[None])[0])
        apart = self._passing & ~self._together[passing]
        if (passing.tobytes(), apart.tobytes()) == self._apart:
            return
        self._apart = passing.tobytes(), apart.tobytes()
        implied = np.zeros((2 * self.words * _WORD, 2 * self.words), np.uint64)
        implied[passing, self.words :] = apart
        self.allowed.imply(implied)
        self.feasible.imply(implied)

    def _group_by_makers(self, literals: Words) -> list[tuple[NDArray[np.int64], list[int]]]:
        """Return the actions that make literals true, with the literals of equal actions."""
        makes = _unpack(np.concatenate([self._sets, self._clears], axis=1))
        groups: dict[bytes, tuple[NDArray[np.int64], list[int]]] = {}
        for literal in np.flatnonzero(_unpack(literals[None])[0]).tolist():
            makers = makes[:, literal]
            if makers.any():
                group = groups.setdefault(makers.tobytes(), (np.flatnonzero(makers), []))
                group[1].append(literal)
        return list(groups.values())

    def _estimate_costs(self, hope: float) -> NDArray[np.float64]:
        known = ~np.isnan(self._costs)
        if not known.any():
            return np.zeros_like(self._costs)
        cheapest = np.where(known, self._costs, np.inf).min(axis=0)
        cheapest = np.where(np.isfinite(cheapest), cheapest, self._costs[known].min())
        return np.where(known, self._costs, hope * self._factors * cheapest)

    def _own_arrays(self) -> Arrays:
        """Return the arrays by their names in a snapshot."""
        return {
            "sets": self._sets,
            "clears": self._clears,
            "lasted": self._lasted,
            "lost": self._lost,
            "made": self._made,
            "undone": self._undone,
            "together": self._together,
            "costs": self._costs,
            "hopes": self._factors,
            "confirmed": self._confirmed,
        }


def _literal(index: int, words: int) -> Words:
    literal = np.zeros(words, np.uint64)
    literal[index // _WORD] = np.uint64(1) << np.uint64(index % _WORD)
    return literal


def _unpack(literals: Words) -> NDArray[np.bool_]:
    """Return literals as truth values, shape (n, 64 * words)."""
    rows = np.ascontiguousarray(literals).view(np.uint8)
    return np.unpackbits(rows, axis=1, bitorder="little").astype(np.bool_)
