"""AND/OR precedence from a blocking relation: which parts have to be absent for one to go.

A part goes off in any direction whose blockers are all absent; so its condition is an OR over
directions of an AND over blockers, and assembly is the same read backwards: a part comes before
whatever blocks it in the direction in which it comes. Sets of parts are integers, a bit a part.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from skillplan_cad.relation import Relation


@dataclass(frozen=True, slots=True)
class Alternative:
    """One way for a part to go off.

    Parameters
    ----------
    directions
        Numbers of the directions in which it may go, all with the same blockers.
    blockers
        The parts that have to be absent, as a set of bits.
    """

    directions: tuple[int, ...]
    blockers: int


@dataclass(frozen=True, slots=True)
class Precedence:
    """For each part its alternatives: all, and the minimal ones.

    Parameters
    ----------
    names
        Of the parts; the part of number n has the bit 1 << n.
    alternatives
        Of each part all sets of blockers, each once, by their first direction.
    """

    names: tuple[str, ...]
    alternatives: tuple[tuple[Alternative, ...], ...]

    @property
    def everything(self) -> int:
        """The set of all parts."""
        return (1 << len(self.names)) - 1

    def minimal(self, part: int) -> tuple[Alternative, ...]:
        """Return the alternatives of which no other asks for a subset of the same blockers."""
        mine = self.alternatives[part]
        return tuple(
            one
            for one in mine
            if not any(
                other.blockers != one.blockers and other.blockers & one.blockers == other.blockers
                for other in mine
            )
        )

    def free_directions(self, part: int, present: int) -> tuple[int, ...]:
        """Return the directions in which a part can go off a set of parts, in their order."""
        others = present & ~(1 << part)
        found = [
            direction
            for one in self.alternatives[part]
            if not one.blockers & others
            for direction in one.directions
        ]
        return tuple(sorted(found))

    def is_free(self, part: int, present: int) -> bool:
        """Return whether a part can go off a set of parts in any direction."""
        others = present & ~(1 << part)
        return any(not one.blockers & others for one in self.alternatives[part])

    def core(self, present: int | None = None, fixed: int = 0) -> int:
        """Return what is left once every part has gone that can, one at a time.

        It depends on no order: what has become free stays so while others go.

        Parameters
        ----------
        present
            The parts to begin with; left out: all.
        fixed
            Parts that never go.
        """
        left = self.everything if present is None else present
        progress = True
        while progress:
            progress = False
            for part in members(left & ~fixed):
                if left != 1 << part and self.is_free(part, left):
                    left &= ~(1 << part)
                    progress = True
        return left

    def with_path(self, part: int, number: int, blockers: int) -> Precedence:
        """Return this precedence with one more way for a part: a path that was found.

        Parameters
        ----------
        part
            Which goes along it.
        number
            Of the path, as a direction's; greater than those of all directions.
        blockers
            Parts that have to be absent.
        """
        mine = (*self.alternatives[part], Alternative((number,), blockers))
        others = self.alternatives[:part], self.alternatives[part + 1 :]
        return Precedence(self.names, (*others[0], mine, *others[1]))

    def orders(self, may_stand: Callable[[int], bool] | None = None) -> int:
        """Return in how many orders the parts come together, one at a time, exactly.

        Parameters
        ----------
        may_stand
            Whether a set of at least one part is allowed on the way; left out: any is.
        """
        counts = {self.everything: 1}
        for _ in range(len(self.names) - 1):
            smaller: dict[int, int] = {}
            for present, count in counts.items():
                for part in members(present):
                    left = present & ~(1 << part)
                    if self.is_free(part, present) and (may_stand is None or may_stand(left)):
                        smaller[left] = smaller.get(left, 0) + count
            counts = smaller
        return sum(counts.values())


def precedence_of(
    relation: Relation, waived: frozenset[tuple[str, str]] = frozenset()
) -> Precedence:
    """Return the precedence that a blocking relation means.

    Parameters
    ----------
    relation
        What blocks what.
    waived
        Pairs (part, by) that block each other in no direction, as a path was found past it.
    """
    weights = [1 << number for number in range(len(relation.parts))]
    past = {(relation.index(a), relation.index(b)) for a, b in waived}
    found = []
    for part in range(len(relation.parts)):
        by_blockers: dict[int, list[int]] = {}
        for direction in range(len(relation.directions)):
            row = np.flatnonzero(relation.matrix[direction, part])
            blockers = sum(weights[by] for by in row.tolist() if (part, by) not in past)
            by_blockers.setdefault(blockers, []).append(direction)
        ordered = sorted(by_blockers.items(), key=lambda item: item[1][0])
        found.append(tuple(Alternative(tuple(way), blockers) for blockers, way in ordered))
    return Precedence(relation.names, tuple(found))


def members(parts: int) -> Iterator[int]:
    """Yield the numbers of the parts in a set, ascending."""
    while parts:
        lowest = parts & -parts
        yield lowest.bit_length() - 1
        parts ^= lowest


def as_set(numbers: Sequence[int]) -> int:
    """Return parts by number as a set of bits."""
    return sum(1 << number for number in set(numbers))


def touching(relation: Relation) -> tuple[int, ...]:
    """Return for each part the set of those that it touches."""
    found = [0] * len(relation.parts)
    for contact in relation.contacts:
        a, b = (relation.index(name) for name in contact.parts)
        found[a] |= 1 << b
        found[b] |= 1 << a
    return tuple(found)


def is_connected(parts: int, touches: Sequence[int]) -> bool:
    """Return whether all parts of a set hang together by contacts within it."""
    if not parts:
        return True
    reached = frontier = parts & -parts
    while frontier:
        beyond = 0
        for part in members(frontier):
            beyond |= touches[part]
        frontier = beyond & parts & ~reached
        reached |= frontier
    return reached == parts
