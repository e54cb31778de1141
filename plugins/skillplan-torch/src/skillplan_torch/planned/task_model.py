"""What a run has learned of its task: what actions change, ask for and cost, and what the goal is.

Walsh and Littman, "Efficient learning of action schemas and web-service descriptions" (2008):
actions set and clear bits, whatever else is observed, and ask for conjunctions of bits. Costs are
those of an action after another one, as they depend on where the robot stands. All of it is
learned from steps that a run took.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan_torch.planned.beam_kernel import Rules
from skillplan_torch.planned.conditions import Conditions, Words
from skillplan_torch.snapshot_arrays import copies, fitting, take_over

Arrays = dict[str, NDArray[Any]]

_WORD = 64
# Of how cheap an unseen cost may be, runs differ by so much.
_HOPES = 0.9, 1.0
# After so many times it is believed that a bit never lasts.
_OFTEN = 3


class TaskModel:
    """What one run knows.

    Parameters
    ----------
    features, actions
        How many; features are bits.
    generator
        From which is drawn how cheap costs that were not seen may be.

    Attributes
    ----------
    allowed, feasible
        What actions ask for to be among those that may be chosen, and to succeed.
    """

    def __init__(self, features: int, actions: int, generator: np.random.Generator) -> None:
        self._features, self._actions = features, actions
        self.words = -(-features // _WORD)
        self.allowed = Conditions(actions, 2 * self.words)
        self.feasible = Conditions(actions, 2 * self.words)
        shape = (actions, self.words)
        self._sets, self._clears = np.zeros(shape, np.uint64), np.zeros(shape, np.uint64)
        # Bits that were seen to last through an action that does not set them.
        self._lasted = np.zeros(self.words, np.uint64)
        # How often every bit was cleared by a step, as far as it was not seen to last.
        self._lost = np.zeros(self.words * _WORD, np.int64)
        # Literals that some action made true, and false.
        self._made, self._undone = np.zeros((2, 2 * self.words), np.uint64)
        # Of every bit, those that were set when it was.
        self._together = np.zeros((self.words * _WORD, self.words), np.uint64)
        self._apart = b"", b""
        self._costs = np.full((actions + 1, actions), np.nan)
        self._hopes = generator.uniform(*_HOPES, self._costs.shape)
        self._goal: Words | None = None
        self._confirmed = np.zeros(2 * self.words, np.uint64)

    @property
    def completed(self) -> bool:
        """Whether an episode has reached the goal."""
        return self._goal is not None

    def bits(self, observation: NDArray[np.float32]) -> Words:
        """Return an observation as bits, shape (words,)."""
        packed = np.zeros(self.words * _WORD, dtype=np.uint8)
        packed[: self._features] = observation > 0.5
        return np.packbits(packed, bitorder="little").view(np.uint64)

    def literals(self, bits: Words) -> Words:
        """Return what holds of bits: those that are set, then those that are not."""
        return np.concatenate([bits, ~bits])

    def observe(self, bits: Words, mask: NDArray[np.bool_]) -> None:
        """Take note of what may be chosen where something is observed for the first time."""
        literals = self.literals(bits)
        self._together[np.flatnonzero(_unpacked(bits[None])[0])] |= bits
        if self._goal is not None:
            self._confirm(literals)
        if not mask.all():
            self.allowed.succeed(np.flatnonzero(mask), literals)
            self.allowed.fail_all(np.flatnonzero(~mask), literals)
        elif self.allowed.succeeded.any():
            # Masks that allow nothing are handed on as such that allow everything.
            self.allowed.fail_all(np.arange(self._actions), literals)

    def forbid(self, bits: Words, action: int) -> None:
        """Take note that an action may not be chosen."""
        self.allowed.fail(action, self.literals(bits))

    def fail(self, bits: Words, action: int) -> None:
        """Take note that an action could not be executed."""
        self.feasible.fail(action, self.literals(bits))

    def succeed(
        self, bits: Words, last: int, action: int, after: Words, cost: float, *, complete: bool
    ) -> None:
        """Take note of what an action came to.

        Parameters
        ----------
        bits, after
            What was observed before and after it.
        last
            The action before it; -1 where there was none.
        action
            The action.
        cost
            Of it.
        complete
            Whether the task is completed by it.
        """
        literals, result = self.literals(bits), self.literals(after)
        self.feasible.succeed(np.array([action]), literals)
        self._sets[action] |= after & ~bits
        cleared = bits & ~after
        self._clears[action] |= cleared
        if (cleared & ~self._lasted).any():
            self._lost += _unpacked(cleared[None])[0]
        self._lasted |= bits & after & ~self._sets[action]
        self._made |= result & ~literals
        self._undone |= literals & ~result
        self._costs[last + 1, action] = cost
        self._imply()
        if complete:
            self._goal = result if self._goal is None else self._goal & result

    def predicted(self, bits: Words, action: int) -> Words:
        """Return what is to be observed after an action."""
        predicted: Words = bits & ~self._passing & ~self._clears[action] | self._sets[action]
        return predicted

    def surprised(self, bits: Words, action: int, after: Words) -> bool:
        """Whether an action was not expected to succeed, or to lead there."""
        if self.feasible.refutes(action, self.literals(bits)):
            return True
        return bool((self.predicted(bits, action) != after).any())

    @property
    def _passing(self) -> Words:
        """Bits that were cleared by whatever was done next, unless an action set them."""
        often = np.packbits(self._lost >= _OFTEN, bitorder="little").view(np.uint64)
        passing: Words = often & ~self._lasted
        return passing

    def rules(self, hope: float, conjunctions: bool = True) -> Rules:
        """Return what is known of actions, in the form that searches read.

        Parameters
        ----------
        hope
            What a cost that was not seen yet is taken for, as a share of the least that the
            action ever cost, in [0, 1].
        conjunctions
            Whether it is believed that what actions ask for to succeed are conjunctions; if not,
            they are known to fail where they did, but for bits that last for one step.
        """
        allowed, feasible = self.allowed.compiled(), self.feasible.compiled()
        allowed_if = allowed.sure if self.allowed.succeeded.any() else np.zeros_like(allowed.sure)
        if not conjunctions:
            passing = np.concatenate([self._passing, self._passing])
            feasible = self.feasible.as_seen(~passing)
        return Rules(
            self._sets,
            self._clears,
            self._passing,
            self._estimated_costs(hope),
            ~self.feasible.succeeded,
            np.stack([allowed_if, feasible.sure]),
            np.stack([allowed.needed, feasible.needed]),
            np.concatenate([allowed.lacking, feasible.lacking]),
            np.stack([allowed.first, feasible.first + len(allowed.lacking)]),
        )

    @property
    def lasting(self) -> Words:
        """Literals that were made true and never undone."""
        lasting: Words = self._made & ~self._undone
        return lasting

    @property
    def goal(self) -> Words:
        """What held and lasted wherever the task was completed; nothing before it was."""
        none = np.zeros_like(self._made)
        return none if self._goal is None else self._goal & self.lasting

    def progress(self, costs: NDArray[np.float64]) -> tuple[Words, NDArray[np.float64]]:
        """Return the literals that count as progress, and the least cost of what makes them true.

        Of the literals that the same actions make true only one counts.

        Parameters
        ----------
        costs
            Of an action after another one, as in `Rules`.

        Returns
        -------
        counted, weights
            Shapes (2 * words,) and (2 * words * 64,).
        """
        least = costs.min(axis=0)
        weights = np.zeros(2 * self.words * _WORD)
        counted = np.zeros(2 * self.words, np.uint64)
        wanted = self.goal if self.completed else self.lasting
        for makers, literals in self._by_makers(wanted):
            counted |= _literal(literals[0], 2 * self.words)
            weights[literals[0]] = least[makers].min()
        return counted, weights

    def doubts(self) -> list[Words]:
        """Return literals of the goal of which it was not seen that the goal needs them.

        Those that the same actions make true stand together.
        """
        found = []
        for _, literals in self._by_makers(self.goal & ~self._confirmed):
            found.append(np.bitwise_or.reduce([_literal(one, 2 * self.words) for one in literals]))
        return found

    def confirm(self, literals: Words) -> None:
        """Take literals as needed by the goal, until the task is completed without them."""
        self._confirmed |= literals

    def _confirm(self, literals: Words) -> None:
        """See whether only one thing is missing where the task is not completed."""
        missing = self.goal & ~literals
        if (
            missing.any()
            and not (missing & self._confirmed).any()
            and len(self._by_makers(missing)) == 1
        ):
            self._confirmed |= missing

    def _imply(self) -> None:
        """See which bits that last for one step are never set together, such as places."""
        passing = np.flatnonzero(_unpacked(self._passing[None])[0])
        apart = self._passing & ~self._together[passing]
        if (passing.tobytes(), apart.tobytes()) == self._apart:
            return
        self._apart = passing.tobytes(), apart.tobytes()
        implied = np.zeros((2 * self.words * _WORD, 2 * self.words), np.uint64)
        implied[passing, self.words :] = apart
        self.allowed.imply(implied)
        self.feasible.imply(implied)

    def _by_makers(self, literals: Words) -> list[tuple[NDArray[np.int64], list[int]]]:
        """Return groups of literals that the same actions make true, with these actions."""
        makes = _unpacked(np.concatenate([self._sets, self._clears], axis=1))
        groups: dict[bytes, tuple[NDArray[np.int64], list[int]]] = {}
        for literal in np.flatnonzero(_unpacked(literals[None])[0]).tolist():
            makers = makes[:, literal]
            if makers.any():
                group = groups.setdefault(makers.tobytes(), (np.flatnonzero(makers), []))
                group[1].append(literal)
        return list(groups.values())

    def _estimated_costs(self, hope: float) -> NDArray[np.float64]:
        known = ~np.isnan(self._costs)
        if not known.any():
            return np.zeros_like(self._costs)
        least = np.where(known, self._costs, np.inf).min(axis=0)
        least = np.where(np.isfinite(least), least, self._costs[known].min())
        return np.where(known, self._costs, hope * self._hopes * least)

    def arrays(self, name: str) -> Arrays:
        """Return all that is known, to be read by `read`."""
        goal = np.zeros((0, 2 * self.words), np.uint64)
        return {
            **copies(name, self._own()),
            f"{name}.goal": goal if self._goal is None else self._goal[None].copy(),
            **self.allowed.arrays(f"{name}.allowed"),
            **self.feasible.arrays(f"{name}.feasible"),
        }

    def read(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over what `arrays` returned.

        Raises
        ------
        ValueError
            If it is of another shape.
        """
        take_over(name, self._own(), arrays)
        many = len(arrays.get(f"{name}.goal", ()))
        goal = fitting(arrays, f"{name}.goal", (many, 2 * self.words))
        self._goal = goal[0].copy() if many else None
        self._apart = b"", b""
        self.allowed.read(f"{name}.allowed", arrays)
        self.feasible.read(f"{name}.feasible", arrays)

    def _own(self) -> Arrays:
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
            "hopes": self._hopes,
            "confirmed": self._confirmed,
        }


def _literal(index: int, words: int) -> Words:
    one = np.zeros(words, np.uint64)
    one[index // _WORD] = np.uint64(1) << np.uint64(index % _WORD)
    return one


def _unpacked(literals: Words) -> NDArray[np.bool_]:
    """Return literals as truth values, shape (n, 64 * words)."""
    rows = np.ascontiguousarray(literals).view(np.uint8)
    return np.unpackbits(rows, axis=1, bitorder="little").astype(np.bool_)
