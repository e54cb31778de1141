"""Partial orders at random that order a given number of pairs, each within all larger ones."""

from __future__ import annotations

from collections.abc import Callable, Iterator


class RandomOrder:
    """A partial order over elements, drawn at random, that grows pair by pair to a total one.

    A total order is drawn, and then all its pairs in an order of their own: a pair that does not
    follow from those before is added with all that follows from it. What follows is added one
    pair at a time, in such an order that the relation is transitive after each of them. So every
    number of pairs is hit, and a smaller relation is part of every larger one.

    Parameters
    ----------
    count
        How many elements are ordered, at least 0; they are the numbers below it.
    draw
        Returns an even random number of [0, 1) at every call.
    pairs
        How many pairs the transitive relation holds, from 0 to ``count * (count - 1) / 2``.

    Raises
    ------
    ValueError
        If the pairs are below 0 or more than there are.
    """

    def __init__(self, count: int, draw: Callable[[], float], pairs: int) -> None:
        most = count * (count - 1) // 2
        if not 0 <= pairs <= most:
            raise ValueError(f"{count} elements have from 0 to {most} pairs, not {pairs}.")
        self._elements = sorted(range(count), key=[draw() for _ in range(count)].__getitem__)
        # By the place in the total order: bit masks of the places known to come before, after.
        self._before = [0] * count
        self._after = [0] * count
        additions = self._additions(draw)
        for _ in range(pairs):
            earlier, later = next(additions)
            self._after[earlier] |= 1 << later
            self._before[later] |= 1 << earlier

    def covers(self) -> dict[int, list[int]]:
        """Return what comes right after every element, elements before nothing left out.

        Pairs that follow from others are not among these: the transitive reduction.
        """
        found: dict[int, list[int]] = {}
        for place, after in enumerate(self._after):
            further = 0
            for later in _bits(after):
                further |= self._after[later]
            if after:
                right_after = (self._elements[later] for later in _bits(after & ~further))
                found[self._elements[place]] = sorted(right_after)
        return dict(sorted(found.items()))

    def _additions(self, draw: Callable[[], float]) -> Iterator[tuple[int, int]]:
        """Yield the pairs of places to be added, looking at the relation as it is by then."""
        count = len(self._elements)
        drawn = [(draw(), one, other) for one in range(count) for other in range(one + 1, count)]
        for _, one, other in sorted(drawn):
            while not self._after[one] >> other & 1:
                # The first of those before `one` that is not yet before `other`, and the last
                # after `other` that is not yet after that: what is before the first is before
                # the last already, and what is after the last is after the first.
                missing = (self._before[one] | 1 << one) & ~self._before[other]
                earlier = (missing & -missing).bit_length() - 1
                missing = (self._after[other] | 1 << other) & ~self._after[earlier]
                yield earlier, missing.bit_length() - 1


def _bits(mask: int) -> Iterator[int]:
    """Yield the positions of the ones in a mask, the lowest first."""
    while mask:
        lowest = mask & -mask
        yield lowest.bit_length() - 1
        mask ^= lowest
