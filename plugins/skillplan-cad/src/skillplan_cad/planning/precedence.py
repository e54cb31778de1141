"""AND/OR precedence: which parts must be absent for a part to leave.

Attributes
----------
part can leave in any direction whose blockers are all absent
    an OR over directions of an AND
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from skillplan_cad.relation import Relation


@dataclass(frozen=True, slots=True)
class Alternative:
    """One possibility for a part to leave.

    Parameters
    ----------
    directions
        Numbers of the directions that share these blockers.
    blockers
        Parts that must be absent, as bits.
    """

    directions: tuple[int, ...]
    blockers: int


@dataclass(frozen=True, slots=True)
class Precedence:
    """The alternatives of each part.

    Parameters
    ----------
    names
        Names of the parts; part n has the bit 1 << n.
    alternatives
        All distinct sets of blockers for each part, by their first direction.
    """

    names: tuple[str, ...]
    alternatives: tuple[tuple[Alternative, ...], ...]

    @property
    def everything(self) -> int:
        """The set of all parts."""
        return (1 << len(self.names)) - 1

    def list_minimal(self, part: int) -> tuple[Alternative, ...]:
        """Return the alternatives whose blockers include no other alternative's blockers."""
        mine = self.alternatives[part]
        return tuple(
            alternative
            for alternative in mine
            if not any(
                other.blockers != alternative.blockers
                and other.blockers & alternative.blockers == other.blockers
                for other in mine
            )
        )

    def list_free_directions(self, part: int, present: int) -> tuple[int, ...]:
        """Return the directions in which a part can leave a set of parts, ascending."""
        others = present & ~(1 << part)
        directions = [
            direction
            for alternative in self.alternatives[part]
            if not alternative.blockers & others
            for direction in alternative.directions
        ]
        return tuple(sorted(directions))

    def is_free(self, part: int, present: int) -> bool:
        """Return whether a part can leave a set of parts in any direction."""
        others = present & ~(1 << part)
        return any(not alternative.blockers & others for alternative in self.alternatives[part])

    def find_core(self, present: int | None = None, fixed: int = 0) -> int:
        """Return the parts that remain after all others have left one at a time.

        The order does not matter: a free part stays free while others leave.

        Parameters
        ----------
        present
            The parts to start from; None for all.
        """
        left = self.everything if present is None else present
        progress = True
        while progress:
            progress = False
            for part in list_members(left & ~fixed):
                if left != 1 << part and self.is_free(part, left):
                    left &= ~(1 << part)
                    progress = True
        return left

    def with_path(self, part: int, number: int, blockers: int) -> Precedence:
        """Return this precedence with a path as an additional alternative of a part.

        Parameters
        ----------
        part
            The part that leaves along the path.
        number
            Number of the path, above the numbers of all directions.
        """
        mine = (*self.alternatives[part], Alternative((number,), blockers))
        others = self.alternatives[:part], self.alternatives[part + 1 :]
        return Precedence(self.names, (*others[0], mine, *others[1]))


def derive_precedence(
    relation: Relation, waived: frozenset[tuple[str, str]] = frozenset()
) -> Precedence:
    """Return the precedence that a blocking relation implies.

    Parameters
    ----------
    waived
        Pairs (part, by) that never block each other because a path passes.
    """
    weights = [1 << number for number in range(len(relation.parts))]
    past = {(relation.index(a), relation.index(b)) for a, b in waived}
    alternatives = []
    for part in range(len(relation.parts)):
        by_blockers: dict[int, list[int]] = {}
        for direction in range(len(relation.directions)):
            row = np.flatnonzero(relation.matrix[direction, part])
            blockers = sum(weights[by] for by in row.tolist() if (part, by) not in past)
            by_blockers.setdefault(blockers, []).append(direction)
        ordered = sorted(by_blockers.items(), key=lambda item: item[1][0])
        alternatives.append(
            tuple(Alternative(tuple(directions), blockers) for blockers, directions in ordered)
        )
    return Precedence(relation.names, tuple(alternatives))


def list_members(parts: int) -> Iterator[int]:
    """Yield the numbers of the parts in a set, ascending."""
    while parts:
        lowest = parts & -parts
        yield lowest.bit_length() - 1
        parts ^= lowest


def encode_set(numbers: Sequence[int]) -> int:
    """Return parts by number as a set of bits."""
    return sum(1 << number for number in set(numbers))


def find_touching(relation: Relation) -> tuple[int, ...]:
    """Return the set of touched parts for each part."""
    touched = [0] * len(relation.parts)
    for contact in relation.contacts:
        a, b = (relation.index(name) for name in contact.parts)
        touched[a] |= 1 << b
        touched[b] |= 1 << a
    return tuple(touched)


def is_connected(parts: int, touches: Sequence[int]) -> bool:
    """Return whether contacts connect all parts of a set."""
    if not parts:
        return True
    reached = frontier = parts & -parts
    while frontier:
        beyond = 0
        for part in list_members(frontier):
            beyond |= touches[part]
        frontier = beyond & parts & ~reached
        reached |= frontier
    return reached == parts
