"""An order of removal, and with it of assembly: stable and connected where there is a choice.

What counts: turns of the product, changes of direction and of tools, parts that must be held, and
states in which what is together does not hang together. Layer by layer, a part at a time, the
cheapest way to each set of parts is kept, so that the order is the cheapest of all unless a layer
was cut down to its most promising.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from skillplan_cad.planning.precedence import Precedence, is_connected, members
from skillplan_cad.planning.stability import Stability
from skillplan_cad.product import Vector

# A cosine this near to 0 is level, to 0.06 degrees; this near to 1 it is up, to 2.6 degrees.
_LEVEL = 1e-3


@dataclass(frozen=True, slots=True)
class Prices:
    """What counts how much; without unit."""

    turn: float = 10.0
    direction: float = 1.0
    sideways: float = 0.5
    tool: float = 2.0
    held: float = 5.0
    apart: float = 50.0


@dataclass(frozen=True, slots=True)
class Removal:
    """One step of taking apart; backwards a step of putting together.

    Parameters
    ----------
    part
        Number of the part that goes off.
    direction
        Number of the direction, or of a path: those follow the directions.
    up
        What points up then, in the product's frame.
    tool
        That takes it.
    turn
        Whether the product is turned over before it.
    stays
        Whether the part, put there, stays by itself.
    tips
        Whether what is left, with the part, has its centre of mass beside its support.
    connected
        Whether what is left hangs together.
    """

    part: int
    direction: int
    up: Vector
    tool: str
    turn: bool
    stays: bool
    tips: bool
    connected: bool


@dataclass(frozen=True, slots=True)
class Sequence:
    """An order in which parts go off.

    Parameters
    ----------
    removals
        The first goes off first; assembly is the same backwards.
    left
        What stays: the base, or what no single part leaves.
    cost
        Of all removals.
    cheapest
        Whether no order costs less.
    """

    removals: tuple[Removal, ...]
    left: int
    cost: float
    cheapest: bool

    @property
    def assembly(self) -> tuple[int, ...]:
        """Parts in the order in which they come, after those that are left."""
        return tuple(one.part for one in reversed(self.removals))

    @property
    def turns(self) -> int:
        """How often the product is turned over."""
        return sum(one.turn for one in self.removals)


class _Way(NamedTuple):
    """The cheapest way to a set of parts, and how its last step is done, as `Removal` has it."""

    cost: float
    present: int
    up: int
    part: int = -1
    direction: int = -1
    tool: int = -1
    stays: bool = True
    tips: bool = False
    connected: bool = True
    before: _Way | None = None


_Layer = dict[tuple[int, int, int, int], _Way]


@dataclass(frozen=True, slots=True)
class _View:
    """What holds of each direction while one vector points up."""

    up: tuple[int, ...]
    is_sideways: tuple[bool, ...]


class Sequencer:
    """Seeks the cheapest order.

    Parameters
    ----------
    precedence
        What may go when.
    directions
        Unit vectors by number; for a path, along which its last move goes.
    touches
        For each part the set of those it touches.
    stability
        Who stays.
    tools
        Of each part, which tool handles it.
    prices
        What counts how much.
    """

    def __init__(
        self,
        precedence: Precedence,
        directions: tuple[Vector, ...],
        touches: tuple[int, ...],
        stability: Stability,
        tools: Mapping[int, str],
        prices: Prices = Prices(),
    ) -> None:
        self._precedence, self._touches, self._stability = precedence, touches, stability
        self._directions, self._tools, self._prices = directions, tools, prices
        self._connected: dict[int, bool] = {}
        # Of each part what may block it at all, and where it may go by what of that is there.
        self._blockers = [
            functools.reduce(operator.or_, (one.blockers for one in ways), 0)
            for ways in precedence.alternatives
        ]
        self._free: dict[tuple[int, int], tuple[int, ...]] = {}
        self._names = sorted({"gripper", *tools.values()})
        parts = range(len(precedence.alternatives))
        self._tool_of = [self._names.index(tools.get(part, "gripper")) for part in parts]
        self._ups: list[Vector] = []
        self._views: dict[int, _View] = {}

    def sequence(self, present: int, base: int, up: Vector) -> Sequence:
        """Return the cheapest order that leaves the base, or what no single part leaves.

        Parameters
        ----------
        present
            The set to begin with.
        base
            The part that stays.
        up
            What points up in the finished product.
        """
        left = self._precedence.core(present, fixed=1 << base)
        self._ups, self._views = sorted({up, *self._directions}), {}
        layer = [_Way(0.0, present, self._ups.index(up))]
        width, cheapest = _width(present.bit_count()), True
        for _ in range((present & ~left).bit_count()):
            best: _Layer = {}
            for way in layer:
                self._lengthen(way, left, best)
            ordered = sorted(best.items(), key=lambda item: (item[1].cost, item[0]))
            cheapest = cheapest and len(ordered) <= width
            layer = [way for _, way in ordered[:width]]
        best_way = min(layer, key=lambda way: way.cost)
        return Sequence(self._removals(best_way), left, round(best_way.cost, 6), cheapest)

    def _lengthen(self, way: _Way, left: int, best: _Layer) -> None:
        """Add each way that is longer by one part, unless one as far costs no more."""
        view, prices = self._view(way.up), self._prices
        tips: dict[int, bool] = {}
        for part in members(way.present & ~left):
            others, tool = way.present & ~(1 << part), self._tool_of[part]
            stays: dict[int, bool] = {}
            for direction in self._free_directions(part, way.present):
                up = view.up[direction]
                key = (others, direction, tool, up)
                cost = way.cost + self._fixed_cost(way, direction, tool, up)
                known = best.get(key)
                if known is not None and cost >= known.cost:
                    continue
                if up not in tips:
                    tips[up] = self._stability.tips(way.present, self._ups[up])
                if up not in stays:
                    stays[up] = self._stability.stays(part, others, self._ups[up])
                connected = self._hang_together(others)
                cost += prices.held * (not stays[up]) + prices.held * tips[up]
                cost += prices.apart * (not connected)
                if known is None or cost < known.cost:
                    best[key] = _Way(
                        cost, others, up, part, direction, tool, stays[up], tips[up], connected, way
                    )

    def _free_directions(self, part: int, present: int) -> tuple[int, ...]:
        key = (part, present & self._blockers[part])
        if key not in self._free:
            self._free[key] = self._precedence.free_directions(part, present)
        return self._free[key]

    def _view(self, up: int) -> _View:
        """Return what points up while a part goes each way: it never comes from below."""
        if up not in self._views:
            cosines = [float(np.dot(way, self._ups[up])) for way in self._directions]
            after = [
                up if cosine > -_LEVEL else self._ups.index(way)
                for cosine, way in zip(cosines, self._directions, strict=True)
            ]
            flat = [
                float(np.dot(way, self._ups[then])) < 1 - _LEVEL
                for way, then in zip(self._directions, after, strict=True)
            ]
            self._views[up] = _View(tuple(after), tuple(flat))
        return self._views[up]

    def _fixed_cost(self, before: _Way, direction: int, tool: int, up: int) -> float:
        """Return what a removal costs, whatever it leaves."""
        prices = self._prices
        cost = prices.turn * (before.up != up)
        if self._view(before.up).is_sideways[direction]:
            cost += prices.sideways
        if before.part >= 0:
            cost += prices.direction * (before.direction != direction)
            cost += prices.tool * (before.tool != tool)
        return cost

    def _hang_together(self, parts: int) -> bool:
        if parts not in self._connected:
            self._connected[parts] = is_connected(parts, self._touches)
        return self._connected[parts]

    def _removals(self, way: _Way) -> tuple[Removal, ...]:
        found: list[Removal] = []
        while way.before is not None:
            turn = way.up != way.before.up
            found.append(
                Removal(
                    way.part,
                    way.direction,
                    self._ups[way.up],
                    self._names[way.tool],
                    turn,
                    way.stays,
                    way.tips,
                    way.connected,
                )
            )
            way = way.before
        return tuple(reversed(found))


def _width(parts: int) -> int:
    """Return how many ways a layer keeps: all of a small product."""
    for most, width in ((12, 20_000), (24, 400), (60, 40)):
        if parts <= most:
            return width
    return 8
