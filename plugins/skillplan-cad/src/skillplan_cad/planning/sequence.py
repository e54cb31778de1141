"""Find a cheap order of removal, and thereby of assembly.

Costs count turns of the product, changes of direction and tool, held parts, and states in which the
product falls into pieces. A layered search keeps the cheapest path to each set of parts; the order
is optimal unless a layer was cut down to its most promising entries.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from skillplan_cad.planning.precedence import Precedence, is_connected, list_members
from skillplan_cad.planning.stability import Stability
from skillplan_cad.product import Vector

# Cosines within this of 0 are level (0.06 degrees), within this of 1 up (2.6 degrees).
_LEVEL = 1e-3


@dataclass(frozen=True, slots=True)
class Prices:
    """Weights of the cost terms [-]."""

    turn: float = 10.0
    direction: float = 1.0
    sideways: float = 0.5
    tool: float = 2.0
    held: float = 5.0
    apart: float = 50.0


@dataclass(frozen=True, slots=True)
class Removal:
    """A step of disassembly; reversed, a step of assembly.

    Parameters
    ----------
    direction
        Number of the direction, or of a path; paths are numbered after directions.
    up
        Vector that points up during the step, in the product's frame.
    turn
        True if the product is turned over before the step.
    stays
        True if the placed part is stable.
    tips
        True if the centre of mass lies outside the support, with the part in place.
    connected
        True if the remaining parts are in one piece.
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
    """An order of removals.

    Parameters
    ----------
    removals
        Removals in order; assembly is the reverse.
    left
        Remaining parts: the base, and parts that cannot leave alone.
    cost
        Total cost [-].
    cheapest
        True if the order is proved optimal.
    """

    removals: tuple[Removal, ...]
    left: int
    cost: float
    cheapest: bool

    @property
    def assembly(self) -> tuple[int, ...]:
        """Parts in order of assembly, without the remaining ones."""
        return tuple(removal.part for removal in reversed(self.removals))

    @property
    def turns(self) -> int:
        """Number of times the product is turned over."""
        return sum(removal.turn for removal in self.removals)


class _Path(NamedTuple):
    """The cheapest path to a set of parts, with the fields of its last removal."""

    cost: float
    present: int
    up: int
    part: int = -1
    direction: int = -1
    tool: int = -1
    stays: bool = True
    tips: bool = False
    connected: bool = True
    before: _Path | None = None


_Layer = dict[tuple[int, int, int, int], _Path]


@dataclass(frozen=True, slots=True)
class _View:
    """Properties of each direction for one vector that points up."""

    up: tuple[int, ...]
    is_sideways: tuple[bool, ...]


class Sequencer:
    """Searches the cheapest order.

    Parameters
    ----------
    directions
        Unit vectors by number; for a path, that of its last move.
    touches
        Set of touched parts for each part.
    tools
        Tool of each part, by part number.
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
        # All potential blockers of each part, and its free directions by those present.
        self._blockers = [
            functools.reduce(
                operator.or_, (alternative.blockers for alternative in alternatives), 0
            )
            for alternatives in precedence.alternatives
        ]
        self._free: dict[tuple[int, int], tuple[int, ...]] = {}
        self._names = sorted({"gripper", *tools.values()})
        parts = range(len(precedence.alternatives))
        self._tool_of = [self._names.index(tools.get(part, "gripper")) for part in parts]
        self._ups: list[Vector] = []
        self._views: dict[int, _View] = {}

    def sequence(self, present: int, base: int, up: Vector) -> Sequence:
        """Return the cheapest order that leaves the base and what cannot be removed.

        Parameters
        ----------
        up
            Vector that points up in the finished product.
        """
        left = self._precedence.find_core(present, fixed=1 << base)
        self._ups, self._views = sorted({up, *self._directions}), {}
        layer = [_Path(0.0, present, self._ups.index(up))]
        width, cheapest = _choose_width(present.bit_count()), True
        for _ in range((present & ~left).bit_count()):
            best: _Layer = {}
            for path in layer:
                self._extend(path, left, best)
            ordered = sorted(best.items(), key=lambda item: (item[1].cost, item[0]))
            cheapest = cheapest and len(ordered) <= width
            layer = [path for _, path in ordered[:width]]
        best_path = min(layer, key=lambda path: path.cost)
        return Sequence(self._list_removals(best_path), left, round(best_path.cost, 6), cheapest)

    def _extend(self, path: _Path, left: int, best: _Layer) -> None:
        """Extend a path by each removable part; keep the cheapest path to each state."""
        view, prices = self._get_view(path.up), self._prices
        tips: dict[int, bool] = {}
        for part in list_members(path.present & ~left):
            others, tool = path.present & ~(1 << part), self._tool_of[part]
            stays: dict[int, bool] = {}
            for direction in self._free_directions(part, path.present):
                up = view.up[direction]
                key = (others, direction, tool, up)
                cost = path.cost + self._compute_fixed_cost(path, direction, tool, up)
                known = best.get(key)
                if known is not None and cost >= known.cost:
                    continue
                if up not in tips:
                    tips[up] = self._stability.tips(path.present, self._ups[up])
                if up not in stays:
                    stays[up] = self._stability.stays(part, others, self._ups[up])
                connected = self._is_connected(others)
                cost += prices.held * (not stays[up]) + prices.held * tips[up]
                cost += prices.apart * (not connected)
                if known is None or cost < known.cost:
                    best[key] = _Path(
                        cost,
                        others,
                        up,
                        part,
                        direction,
                        tool,
                        stays[up],
                        tips[up],
                        connected,
                        path,
                    )

    def _free_directions(self, part: int, present: int) -> tuple[int, ...]:
        key = (part, present & self._blockers[part])
        if key not in self._free:
            self._free[key] = self._precedence.list_free_directions(part, present)
        return self._free[key]

    def _get_view(self, up: int) -> _View:
        """Return the up vector during a move in each direction: parts never come from below."""
        if up not in self._views:
            cosines = [float(np.dot(direction, self._ups[up])) for direction in self._directions]
            after = [
                up if cosine > -_LEVEL else self._ups.index(direction)
                for cosine, direction in zip(cosines, self._directions, strict=True)
            ]
            flat = [
                float(np.dot(direction, self._ups[then])) < 1 - _LEVEL
                for direction, then in zip(self._directions, after, strict=True)
            ]
            self._views[up] = _View(tuple(after), tuple(flat))
        return self._views[up]

    def _compute_fixed_cost(self, before: _Path, direction: int, tool: int, up: int) -> float:
        """Return the cost of a removal that does not depend on the remaining parts."""
        prices = self._prices
        cost = prices.turn * (before.up != up)
        if self._get_view(before.up).is_sideways[direction]:
            cost += prices.sideways
        if before.part >= 0:
            cost += prices.direction * (before.direction != direction)
            cost += prices.tool * (before.tool != tool)
        return cost

    def _is_connected(self, parts: int) -> bool:
        if parts not in self._connected:
            self._connected[parts] = is_connected(parts, self._touches)
        return self._connected[parts]

    def _list_removals(self, path: _Path) -> tuple[Removal, ...]:
        removals: list[Removal] = []
        while path.before is not None:
            turn = path.up != path.before.up
            removals.append(
                Removal(
                    path.part,
                    path.direction,
                    self._ups[path.up],
                    self._names[path.tool],
                    turn,
                    path.stays,
                    path.tips,
                    path.connected,
                )
            )
            path = path.before
        return tuple(reversed(removals))


def _choose_width(parts: int) -> int:
    """Return the number of paths kept in a layer; small products keep all."""
    for most, width in ((12, 20_000), (24, 400), (60, 40)):
        if parts <= most:
            return width
    return 8
