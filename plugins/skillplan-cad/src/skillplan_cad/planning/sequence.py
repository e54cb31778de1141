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
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from skillplan_cad.planning.precedence import Precedence, is_connected, members
from skillplan_cad.planning.stability import Stability
from skillplan_cad.product import Vector


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


@dataclass(frozen=True, slots=True)
class _Way:
    """The cheapest way to a set of parts."""

    cost: float
    present: int
    last: Removal | None = None
    before: _Way | None = field(default=None, repr=False)


_Layer = dict[tuple[int, int, str, Vector], _Way]


class _Step(NamedTuple):
    """One more removal, as `Removal` has it, and what it costs."""

    cost: float
    part: int
    direction: int
    up: Vector
    stays: bool
    tips: bool
    connected: bool


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
        self._vectors = np.asarray(directions)
        self._connected: dict[int, bool] = {}
        # Of each part what may block it at all, and where it may go by what of that is there.
        self._blockers = [
            functools.reduce(operator.or_, (one.blockers for one in ways), 0)
            for ways in precedence.alternatives
        ]
        self._free: dict[tuple[int, int], tuple[int, ...]] = {}
        self._cosines: dict[tuple[int, Vector], float] = {}

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
        layer = [_Way(0.0, present)]
        width, cheapest = _width(present.bit_count()), True
        for _ in range((present & ~left).bit_count()):
            best: _Layer = {}
            for way in layer:
                self._lengthen(way, left, up, best)
            ordered = sorted(best.items(), key=lambda item: (item[1].cost, item[0]))
            cheapest = cheapest and len(ordered) <= width
            layer = [way for _, way in ordered[:width]]
        best_way = min(layer, key=lambda way: way.cost)
        return Sequence(_removals(best_way), left, round(best_way.cost, 6), cheapest)

    def _lengthen(self, way: _Way, left: int, up: Vector, best: _Layer) -> None:
        """Add each way that is longer by one part, unless one as far costs no more."""
        before = way.last
        for part in members(way.present & ~left):
            tool = self._tools.get(part, "gripper")
            for direction in self._free_directions(part, way.present):
                now = self._up(before.up if before else up, direction)
                others = way.present & ~(1 << part)
                key = (others, direction, tool, now)
                known = best.get(key)
                if known is not None:
                    least = self._fixed_cost(before, part, direction, now)
                    if way.cost + least >= known.cost:
                        continue
                step = self._step(way, part, direction, now, up)
                if known is None or way.cost + step.cost < known.cost:
                    best[key] = self._longer(way, step, tool, up)

    def _free_directions(self, part: int, present: int) -> tuple[int, ...]:
        key = (part, present & self._blockers[part])
        if key not in self._free:
            self._free[key] = self._precedence.free_directions(part, present)
        return self._free[key]

    def _up(self, now: Vector, direction: int) -> Vector:
        """Return what points up while a part goes: it never comes from below."""
        return now if self._along(direction, now) > -1e-3 else self._directions[direction]

    def _along(self, direction: int, up: Vector) -> float:
        """Return the cosine between a direction and what points up."""
        key = (direction, up)
        if key not in self._cosines:
            self._cosines[key] = float(np.dot(self._vectors[direction], up))
        return self._cosines[key]

    def _fixed_cost(self, before: Removal | None, part: int, direction: int, up: Vector) -> float:
        """Return what a removal costs, whatever it leaves."""
        prices, tool = self._prices, self._tools.get(part, "gripper")
        cost = 0.0
        if self._along(direction, up) < 1 - 1e-3:
            cost += prices.sideways
        if before is not None:
            cost += prices.direction * (before.direction != direction)
            cost += prices.tool * (before.tool != tool)
            cost += prices.turn * (before.up != up)
        return cost

    def _step(self, way: _Way, part: int, direction: int, up: Vector, first: Vector) -> _Step:
        """Return what one more removal costs, and why."""
        others = way.present & ~(1 << part)
        stays = self._stability.stays(part, others, up)
        tips = self._stability.tips(way.present, up)
        connected = self._hang_together(others)
        prices = self._prices
        cost = self._fixed_cost(way.last, part, direction, up)
        cost += prices.held * (not stays) + prices.held * tips + prices.apart * (not connected)
        if way.last is None:
            cost += prices.turn * (first != up)
        return _Step(cost, part, direction, up, stays, tips, connected)

    def _longer(self, way: _Way, step: _Step, tool: str, first: Vector) -> _Way:
        """Return a way with one more removal."""
        turn = (way.last.up if way.last else first) != step.up
        removal = Removal(
            step.part, step.direction, step.up, tool, turn, step.stays, step.tips, step.connected
        )
        return _Way(way.cost + step.cost, way.present & ~(1 << step.part), removal, way)

    def _hang_together(self, parts: int) -> bool:
        if parts not in self._connected:
            self._connected[parts] = is_connected(parts, self._touches)
        return self._connected[parts]


def _removals(way: _Way) -> tuple[Removal, ...]:
    found: list[Removal] = []
    at: _Way | None = way
    while at is not None and at.last is not None:
        found.append(at.last)
        at = at.before
    return tuple(reversed(found))


def _width(parts: int) -> int:
    """Return how many ways a layer keeps: all of a small product."""
    for most, width in ((12, 20_000), (24, 400), (60, 40)):
        if parts <= most:
            return width
    return 8
