"""Which bodies pass through each other: kinds and affinities of a compiled model.

Two geometries touch where the kind of one is among the affinities of the other. A body that passes
through some others has a kind of its own; all the rest share one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any

from skillplan_simulation.simulator import ROBOT, UpsetError

# Bits of a kind; the first is that of all bodies without one of their own.
_BITS = 31


class PairMasks:
    """Lets pairs of bodies, or links of the arm, touch nothing.

    Parameters
    ----------
    model
        Compiled.
    owners
        Names of what the bodies of the model belong to: the arm's links to the arm.
    present
        What is in the world, kept up to date.
    """

    def __init__(self, model: Any, owners: Mapping[int, str], present: Mapping[str, int]) -> None:
        self._model, self._owners, self._present = model, owners, present
        self._parted: set[tuple[str, str]] = set()
        self._withdrawn: dict[str, frozenset[int]] = {}
        self._idle: list[int] = []
        self._geoms: dict[int, list[int]] = {}
        for geom, body in enumerate(model.geom_bodyid.tolist()):
            self._geoms.setdefault(body, []).append(geom)

    def geoms(self, body: int) -> list[int]:
        """Return the numbers of a body's geometries."""
        return self._geoms.get(body, [])

    def part(self, one: str, others: Iterable[str]) -> None:
        """Let a body pass through others."""
        self._parted |= {_pair(one, other) for other in others}
        self.set()

    def join(self, one: str, others: Iterable[str]) -> None:
        """Let a body touch others again."""
        self._parted -= {_pair(one, other) for other in others}
        self.set()

    def withdraw(self, name: str, links: Iterable[int]) -> None:
        """Let links of the arm touch nothing, and its others what they may; -1 is all of a body."""
        self._withdrawn[name] = frozenset(links)
        self.set()

    def idle(self, geoms: Iterable[int]) -> None:
        """Let these geometries touch nothing, and all others what they may."""
        self._idle = list(geoms)
        self.set()

    def set(self) -> None:
        """Tell the model."""
        special = _cover(self._parted)
        if len(special) > _BITS - 1:
            raise UpsetError(f"more than {_BITS - 1} bodies pass through others at once")
        bits = {name: 2 << place for place, name in enumerate(special)}
        model = self._model
        for body, geoms in self._geoms.items():
            kind, affinity = self._mask(body, bits)
            model.geom_contype[geoms], model.geom_conaffinity[geoms] = kind, affinity
            model.body_contype[body], model.body_conaffinity[body] = kind, affinity
        model.geom_contype[self._idle] = model.geom_conaffinity[self._idle] = 0

    def _mask(self, body: int, bits: Mapping[str, int]) -> tuple[int, int]:
        """Return kind and affinity of a body of the model."""
        name = self._owners[body]
        if name not in self._present:
            return 0, 0
        hidden = self._withdrawn.get(name, frozenset())
        if body in hidden or -1 in hidden:
            return 0, 0
        through = {name, *(other for pair in self._parted if name in pair for other in pair)}
        # Whoever has a kind of its own leaves it to the rest whether they touch it.
        shared = 0 if name in bits else 1
        return bits.get(name, 1), shared + sum(
            bit for other, bit in bits.items() if other not in through
        )


def _cover(parted: Iterable[tuple[str, str]]) -> list[str]:
    """Return bodies of which every pair has one, and the arm, whose links are no obstacles."""
    pairs = sorted(parted)
    count = Counter(name for pair in pairs for name in pair)
    found = {ROBOT}
    for pair in pairs:
        if not found & set(pair):
            found.add(max(pair, key=lambda name: (count[name], name)))
    return sorted(found)


def _pair(one: str, other: str) -> tuple[str, str]:
    return min(one, other), max(one, other)
