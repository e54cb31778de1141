"""Which bodies of the simulator pass through each other for the time being."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import pybullet


class PairFilter:
    """Lets pairs of bodies, or links of a body, touch nothing.

    Parameters
    ----------
    client
        Where the bodies are.
    numbers
        Of the bodies there by name, kept up to date.
    """

    def __init__(self, client: int, numbers: Mapping[str, int]) -> None:
        self._client, self._numbers = client, numbers
        # Pairs that pass through each other for the time being, and links that nothing touches.
        self._parted: set[tuple[str, str]] = set()
        self._withdrawn: dict[str, frozenset[int]] = {}

    def part(self, one: str, others: Iterable[str]) -> None:
        """Let a body pass through others."""
        for other in others:
            self._parted.add(_pair(one, other))
            self._tell(one, self._links(one), other)

    def join(self, one: str, others: Iterable[str]) -> None:
        """Let a body touch others again."""
        for other in others:
            self._parted.discard(_pair(one, other))
            self._tell(one, self._links(one), other)

    def withdraw(self, name: str, links: Iterable[int]) -> None:
        """Let these links of a body touch nothing, what is added later included.

        Its other links, and those that were withdrawn before, touch what they may. That of a
        body without joints is -1.
        """
        before, now = self._withdrawn.get(name, frozenset()), frozenset(links)
        self._withdrawn[name] = now
        for other in self._numbers:
            if other != name:
                self._tell(name, sorted(before ^ now), other)

    def added(self, body: str) -> None:
        """Tell the simulator of a body that is new, or has been made anew."""
        for name, links in self._withdrawn.items():
            for other in self._numbers if name == body else [body]:
                if name != other:
                    self._tell(name, sorted(links), other)
        for one, other in sorted(self._parted):
            if body in (one, other):
                self._tell(one, self._links(one), other)

    def _links(self, name: str) -> range:
        """Return the numbers of a body's links, from -1 for its base."""
        return range(-1, pybullet.getNumJoints(self._numbers[name], physicsClientId=self._client))

    def _tell(self, one: str, links: Iterable[int], other: str) -> None:
        """Set in the simulator which links of a body may touch another."""
        parted = _pair(one, other) in self._parted
        hidden = self._withdrawn.get(one, frozenset())
        others_hidden = self._withdrawn.get(other, frozenset())
        for link in links:
            for other_link in self._links(other):
                may = not parted and link not in hidden and other_link not in others_hidden
                pybullet.setCollisionFilterPair(
                    self._numbers[one],
                    self._numbers[other],
                    link,
                    other_link,
                    int(may),
                    physicsClientId=self._client,
                )


def _pair(one: str, other: str) -> tuple[str, str]:
    return min(one, other), max(one, other)
