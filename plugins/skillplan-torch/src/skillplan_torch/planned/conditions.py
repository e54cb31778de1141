"""Under which observations actions can be taken, learned as conjunctions of literals.

A conjunction is learned from both sides (Mitchell, "Version spaces", 1977; for preconditions of
actions: Walsh and Littman, "Efficient learning of action schemas and web-service descriptions",
2008). What held wherever an action succeeded is all that it may ask for; of what did not hold where
it failed, it asks for something. In between it is unknown. Where an action asks for no
conjunction, such as one way or another to go in, what failed is known of the very same
observations only.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan_torch.snapshot_arrays import fitting

Words = NDArray[np.uint64]

# Failures that say something new, remembered of an action.
_MOST_FAILURES = 256
_WORD = 64


@dataclass(frozen=True)
class Compiled:
    """What is known of all actions, in the form that searches read.

    Parameters
    ----------
    sure
        Literals under which an action is sure to succeed, shape (actions, words).
    needed
        Literals without one of which it is sure to fail, shape (actions, words).
    lacking
        Sets of literals, of each of which one has to hold, shape (n, words).
    first
        Where the sets of an action begin in `lacking`, shape (actions + 1,).
    """

    sure: Words
    needed: Words
    lacking: Words
    first: NDArray[np.int64]


class Conditions:
    """What actions ask for, as far as it was seen.

    Parameters
    ----------
    actions, words
        How many; literals are bits of words.

    Attributes
    ----------
    succeeded
        Whether an action ever did, shape (actions,).
    needed
        Literals without one of which an action is sure to fail, shape (actions, words).
    """

    def __init__(self, actions: int, words: int) -> None:
        self.succeeded = np.zeros(actions, dtype=np.bool_)
        self.needed = np.zeros((actions, words), dtype=np.uint64)
        # All literals held wherever the action succeeded.
        self._held = np.full((actions, words), np.uint64(2**64 - 1))
        none = np.zeros((0, words), dtype=np.uint64)
        # Of every failure what did not hold, and what of that may be why.
        self._failures, self._lacking = [none] * actions, [none] * actions
        # Of every literal, those that it implies.
        self._implied = np.zeros((_WORD * words, words), dtype=np.uint64)
        self._implying = np.zeros(0, dtype=np.int64)
        self._known: Compiled | None = None

    def imply(self, implied: Words) -> None:
        """Take note which literals every one implies, shape (64 * words, words).

        Where an action may ask for a literal, what that implies says no more.
        """
        if (implied != self._implied).any():
            self._implied = implied.copy()
            self._implying = np.flatnonzero(implied.any(axis=1))
            self._known = None
            for action in range(len(self._held)):
                self._explain(action)

    def _relevant(self, actions: NDArray[np.int64] | slice = slice(None)) -> Words:
        """Return the literals that actions may ask for, but for what others of them imply."""
        held = self._held[actions]
        if not len(self._implying):
            return held.copy()
        rows = self._implying
        has = held[:, rows // _WORD] >> (rows % _WORD).astype(np.uint64) & np.uint64(1)
        said = np.where(has[:, :, None] != 0, self._implied[rows], np.uint64(0))
        found: Words = held & ~np.bitwise_or.reduce(said, axis=1)
        return found

    def succeed(self, actions: NDArray[np.int64], literals: Words) -> None:
        """Take note that actions can be taken where these literals hold, shape (words,)."""
        held = self._held[actions]
        left = held & literals
        for action in actions[(left != held).any(axis=1)].tolist():
            self._held[action] &= literals
            self.succeeded[action] = True
            self._explain(action)

    def fail(self, action: int, literals: Words) -> None:
        """Take note that an action fails where these literals hold and all others do not."""
        known = self._failures[action]
        if not (known == ~literals).all(axis=1).any():
            self._failures[action] = np.concatenate([known, ~literals[None]])[-_MOST_FAILURES:]
            self._explain(action)

    def fail_all(self, actions: NDArray[np.int64], literals: Words) -> None:
        """Take note that several actions fail there, where that is news."""
        for action in actions[~(self.needed[actions] & ~literals).any(axis=1)].tolist():
            if not self.refutes(action, literals):
                self.fail(action, literals)

    def refutes(self, action: int, literals: Words) -> bool:
        """Whether an action is known to fail where these literals hold."""
        if (self.needed[action] & ~literals).any():
            return True
        return bool((~(self._lacking[action] & literals).any(axis=1)).any())

    def compiled(self) -> Compiled:
        """Return what is known."""
        if self._known is None:
            counts = [len(sets) for sets in self._lacking]
            self._known = Compiled(
                self._relevant(),
                self.needed.copy(),
                np.concatenate(self._lacking),
                np.cumsum([0, *counts]),
            )
        return self._known

    def as_seen(self, relevant: Words) -> Compiled:
        """Return what is known if nothing is believed but what was seen.

        Parameters
        ----------
        relevant
            Literals that count, shape (words,).
        """
        return Compiled(
            self._relevant(),
            np.zeros_like(self.needed),
            np.concatenate(self._failures) & relevant,
            np.cumsum([0, *(len(failures) for failures in self._failures)]),
        )

    def _explain(self, action: int) -> None:
        """Work out what an action's failures say, given what held where it succeeded."""
        self._known = None
        failures = self._failures[action]
        if not len(failures):
            return
        lacking = failures & self._relevant(np.array([action]))
        # No conjunction explains these: nothing but the same observation is known to fail.
        contradictory = ~lacking.any(axis=1)
        lacking[contradictory] = failures[contradictory]
        single = np.bitwise_count(lacking).sum(axis=1) == 1
        self.needed[action] = np.bitwise_or.reduce(lacking[single], axis=0)
        # One of the others is needed anyway.
        open_ones = lacking[~single & ~(lacking & self.needed[action]).any(axis=1)]
        self._lacking[action] = open_ones

    def arrays(self, name: str) -> dict[str, NDArray[Any]]:
        """Return all that is known, to be read by `read`."""
        return {
            f"{name}.succeeded": self.succeeded.copy(),
            f"{name}.held": self._held.copy(),
            f"{name}.implied": self._implied.copy(),
            f"{name}.failures": np.concatenate(self._failures),
            f"{name}.counts": np.array([len(one) for one in self._failures], dtype=np.int64),
        }

    def read(self, name: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Take over what `arrays` returned.

        Raises
        ------
        ValueError
            If it is of another shape.
        """
        actions, words = self._held.shape
        self.succeeded = fitting(arrays, f"{name}.succeeded", (actions,)).copy()
        self._held = fitting(arrays, f"{name}.held", (actions, words)).copy()
        shape = self._implied.shape
        self._implied = fitting(arrays, f"{name}.implied", shape).copy()
        self._implying = np.flatnonzero(self._implied.any(axis=1))
        counts = fitting(arrays, f"{name}.counts", (actions,)).tolist()
        rows = fitting(arrays, f"{name}.failures", (sum(counts), words))
        ends = np.cumsum([0, *counts]).tolist()
        for action in range(actions):
            self._failures[action] = rows[ends[action] : ends[action + 1]].copy()
            self._explain(action)
