"""Find the supports and the order in which one arm places the parts, without turning the product.

The arm releases a placed part, so contact forces of the table and of parts placed before must keep
it there, or else a support of its own, if those are allowed: as few as can be. The order is sought
backwards: a part is taken away upwards or sideways as soon as no other is in its way and no other
needs it. A part that is never free in this way is left out. If parts lock each other, an order is
also built forwards, and the one with more parts is taken.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, lru_cache, reduce
from heapq import heappop, heappush
from operator import and_

import numpy as np
from numpy.typing import NDArray

from skillplan.collision import TILT_DEG, compute_margin_m
from skillplan.collision.contact_forces import find_axes_across
from skillplan.robots.catalogue import ARMS
from skillplan_cad.planning.equilibrium import Equilibrium
from skillplan_cad.planning.precedence import encode_set, list_members
from skillplan_cad.planning.stability import is_over
from skillplan_cad.product import ROUND_KINDS, Product, Vector
from skillplan_cad.relation import Contact, LeftOut, Relation

Array = NDArray[np.float64]

ATTITUDES: Mapping[str, Vector] = {
    "z": (0.0, 0.0, 1.0),
    "x": (1.0, 0.0, 0.0),
    "-x": (-1.0, 0.0, 0.0),
    "y": (0.0, 1.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "-z": (0.0, 0.0, -1.0),
}
"""Vectors that may point up, in the file's frame; the first wins ties."""

# Gap tolerance as in `check`, cosine of a level normal, and height tolerance of points.
_TOUCH_M = 2e-4
_LEVEL = 0.999
_SAME_M = 1e-5
_FEWEST_POINTS = 3
_SHOWN = 3
# Cosine of a direction that is level, and of two directions that are one.
_SIDEWAYS, _ALONG = 1e-3, 0.999
# Largest number of parts that are tried one by one for leaving out.
_MOST_TRIED = 40
# Largest number of parts that are compared for holding.
_MOST_HELD = 8


@dataclass(frozen=True, slots=True)
class Bearing:
    """Supports and order of the parts in one orientation.

    Parameters
    ----------
    up
        Vector that points up, in the product's frame.
    order
        Supported parts in an order of assembly, each after its supports.
    on
        Supports of these parts; empty for parts on the table alone.
    why_not
        Reasons why the other parts that a hand brings are left out.
    undriven
        Reasons why screws and nuts are left out.
    held
        Parts that supports of their own hold where they are, screws and nuts that they keep from
        turning included.
    turned
        Vectors that point up when parts and screws go in after the product was turned, in the order
        of the turns.
    between
        True if supports hold parts, too, that stay at the end, but fall before the last are in.
    heading
        Quarter turns of the product about the vertical before the arm.
    """

    up: Vector
    order: tuple[str, ...]
    on: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    why_not: Mapping[str, LeftOut] = field(default_factory=dict)
    undriven: Mapping[str, LeftOut] = field(default_factory=dict)
    held: tuple[str, ...] = ()
    turned: Mapping[str, Vector] = field(default_factory=dict)
    between: bool = False
    heading: int = 0

    @property
    def ups(self) -> tuple[Vector, ...]:
        """Vectors that point up one after another."""
        return tuple(dict.fromkeys((self.up, *self.turned.values())))

    def get_up(self, name: str) -> Vector:
        """Return the vector that points up when a part goes in."""
        return self.turned.get(name, self.up)


def find_bearing(
    product: Product,
    relation: Relation,
    up: Vector,
    absent: Collection[str] = (),
    *,
    holding: bool = False,
    between: bool = False,
    firm: Collection[str] = (),
    earlier: Sequence[Vector] = (),
) -> Bearing:
    """Return the supports and the order of the parts that one arm brings, in one orientation.

    The lowest parts are left out if more parts then stand in one group, such as above a cap that
    hangs below its mate.

    Parameters
    ----------
    absent
        Names of parts that are not there.
    holding
        True if parts that do not stay may be held by supports of their own.
    between
        True if that goes for parts, too, that stay at the end, but fall before the last are in.
    firm
        Parts and screws that are in, and that a turn of the product did not move.
    earlier
        Vectors that pointed up before that turn.
    """
    sets, ups = (frozenset(absent), frozenset(firm)), tuple(earlier)
    return _find_bearing(product, relation, up, *sets, ups, holding=holding, between=between)


@lru_cache(maxsize=64)
def _find_bearing(
    product: Product,
    relation: Relation,
    up: Vector,
    absent: frozenset[str],
    firm: frozenset[str],
    earlier: tuple[Vector, ...],
    *,
    holding: bool,
    between: bool,
) -> Bearing:
    forces = _share_equilibrium(product, relation)
    holds = (holding, between)
    return _Standing(product, relation, up, forces, absent, *holds, firm, earlier).best()


@lru_cache(maxsize=4)
def _share_equilibrium(product: Product, relation: Relation) -> Equilibrium:
    """Return the contact forces of a product; writing asks for them again for each part less."""
    return Equilibrium(product, relation)


def hold_mates(relation: Relation, *ups: Vector) -> Relation:
    """Return a relation in which one of each bolt and nut is held from turning.

    The other one, from above in the first orientation that allows it, is driven.
    """
    for up in ups:
        relation = _hold_mates(relation, up)
    return relation


def _hold_mates(relation: Relation, up: Vector) -> Relation:
    mates: set[str] = set()
    for name in sorted(relation.driven, key=relation.index):
        if find_driven_mate(relation, name, relation.driven - mates, up) is not None:
            mates.add(name)
    fasteners = tuple(
        replace(fastener, held=True) if fastener.part in mates else fastener
        for fastener in relation.fasteners
    )
    return replace(relation, fasteners=fasteners) if mates else relation


def find_driven_mate(
    relation: Relation, name: str, driven: Collection[str], up: Vector
) -> str | None:
    """Return the driven one of a bolt and its nut if it is not this one.

    One arm turns one of them: the bolt, unless it comes from below.
    """
    fastener = relation.fastener(name)
    assert fastener is not None
    level = -_SIDEWAYS if fastener.kind == "nut" else _SIDEWAYS
    for mate in fastener.threaded_in:
        other = relation.fastener(mate)
        if mate in driven and other is not None and float(np.dot(other.axis, up)) > level:
            return mate
    return None


def list_rods(relation: Relation, name: str) -> tuple[str, ...]:
    """Return the parts with a thread, other than screws, that a nut is on."""
    nut = relation.fastener(name)
    mates = nut.threaded_in if nut is not None and nut.kind == "nut" else ()
    return tuple(mate for mate in mates if relation.fastener(mate) is None)


def find_best_bearing(
    product: Product, relation: Relation, absent: Collection[str] = (), *, holding: bool = False
) -> Bearing:
    """Return the orientation in which most parts stand by themselves and come straight down.

    Number and mass count the same, and so do standing and coming from above: a hand meets the
    product on level moves. What no arm carries counts on the table alone. Ties, to a tenth of the
    product, go to the orientation in which most parts are placed with supports, then to the one
    with the fewest of them, then to the first.
    """
    masses = {part.name: part.mass_kg for part in product}
    driven = relation.driven - set(absent)
    best: Bearing | None = None
    best_key = (0.0, 0.0, 0)

    def weigh(names: Collection[str]) -> float:
        carried = [mass for name, mass in masses.items() if name in names and name not in driven]
        mass = sum(carried) / sum(masses.values())
        return round(len(names) / len(product) + mass, 6)

    def list_brought(bearing: Bearing) -> set[str]:
        placed = set[str]()
        for name in bearing.order:
            on = bearing.on.get(name, ())
            if placed.issuperset(on) and not (on and masses[name] > _get_most_kg()):
                placed.add(name)
        return placed | (driven - bearing.undriven.keys())

    for up in ATTITUDES.values():
        bearing = find_bearing(product, relation, up, absent, holding=holding)
        alone = find_bearing(product, relation, up, absent) if bearing.held else bearing
        brought = list_brought(bearing)
        straight = list_straight(relation, bearing) & brought - {*absent}
        key = (
            round(weigh(list_brought(alone)) + weigh(straight), 1),
            weigh(brought),
            -len(bearing.held),
        )
        if best is None or key > best_key:
            best, best_key = bearing, key
            is_whole = straight >= {*best.order, *driven}
            if is_whole and not (best.why_not or best.undriven or best.held):
                break
    assert best is not None
    return best


@cache
def _get_most_kg() -> float:
    """Return the greatest payload of an arm of the catalogue [kg]."""
    return max(arm.payload_kg or 0.0 for arm, _ in ARMS.values())


def list_straight(relation: Relation, bearing: Bearing) -> set[str]:
    """Return the parts and screws that come straight down in the order of a bearing."""
    straight, before = set[str](), 0
    for name in bearing.order:
        if can_come_down(relation, name, before, bearing.up):
            straight.add(name)
        before |= 1 << relation.index(name)
    screws = relation.driven - bearing.undriven.keys()
    return straight | {name for name in screws if can_come_down(relation, name, 0, bearing.up)}


def can_come_down(relation: Relation, name: str, before: int, up: Vector) -> bool:
    """Return whether a part comes straight down past others, or a screw is driven from above.

    Parameters
    ----------
    before
        Parts that are in place, as bits.
    """
    fastener = relation.fastener(name)
    if name in relation.driven and fastener is not None:
        return float(np.dot(fastener.axis, up)) > _ALONG
    return any(
        not blockers & before and float(np.dot(relation.directions[direction], up)) > _ALONG
        for direction, blockers in relation.blocker_sets[relation.index(name)]
    )


def list_blockers(relation: Relation, name: str, up: Vector) -> list[int]:
    """Return the blockers of a part in each direction that is not downwards, as bits.

    A screw that is driven leaves along its axis alone.
    """
    is_driven, fastener = name in relation.driven, relation.fastener(name)
    along, steepest = up, -_SIDEWAYS
    if is_driven and fastener is not None:
        along, steepest = fastener.axis, _ALONG
    blockers = [
        blockers
        for direction, blockers in relation.blocker_sets[relation.index(name)]
        if float(np.dot(relation.directions[direction], along)) > steepest
    ]
    return blockers or [0] if is_driven else blockers


def list_required(relation: Relation, name: str, up: Vector) -> tuple[str, ...]:
    """Return the parts without which a screw or nut cannot be put in.

    A bolt that comes from above hangs by its head: it can go in before its nut.
    """
    fastener = relation.fastener(name)
    if fastener is None:
        return ()
    nuts = {other.part for other in relation.fasteners if other.kind == "nut"}
    held = [join for join in fastener.joins if join not in relation.driven | nuts]
    from_above = float(np.dot(fastener.axis, up)) > _ALONG
    return tuple(held) if held and fastener.kind == "screw" and from_above else fastener.joins


class _Standing:
    """A product in one orientation."""

    def __init__(
        self,
        product: Product,
        relation: Relation,
        up: Vector,
        equilibrium: Equilibrium,
        absent: Collection[str],
        holding: bool,
        between: bool,
        firm: Collection[str],
        earlier: Sequence[Vector],
    ) -> None:
        given, self._firm = relation, set(firm)
        relation = hold_mates(relation, *earlier, up) if holding else relation
        self._holding, self._held = holding, set[str]()
        self._between = holding and between
        # Parts that are held as they fall in between; None if such parts are not held.
        self._more: set[str] | None = None
        self._up, self._vector, self._plan = up, np.asarray(up), find_axes_across(up)
        self._product, self._relation, self._equilibrium = product, relation, equilibrium
        self._absent = set(absent)
        self._driven = {name for name in relation.driven if name not in self._absent}
        # Without a pocket, these turn unless they are held: one of each bolt and nut, and rods.
        mates = {fastener.part for fastener in relation.fasteners if fastener.held} - {
            fastener.part for fastener in given.fasteners if fastener.held
        }
        rods = {rod for name in self._driven for rod in list_rods(relation, name)}
        self._turning = (mates | rods) - self._firm if holding else set[str]()
        self._parts = {
            part.name: part
            for part in product
            if part.name not in relation.driven and part.name not in self._absent
        }
        self._centres = {
            name: self._plan @ np.asarray(part.centre_m) for name, part in self._parts.items()
        }
        self._lowest = {
            name: float((part.vertices_m @ self._vector).min())
            for name, part in self._parts.items()
        }
        self._feet: dict[str, Array] = {}
        self._beneath: dict[str, dict[str, Array]] = {name: {} for name in self._parts}
        self._lost: dict[str, list[str]] = {name: [] for name in self._parts}
        for contact in relation.contacts:
            for upper, lower, points in self._find_level_contacts(contact):
                if upper in self._parts and lower in self._parts:
                    self._beneath[upper][lower] = points
                elif upper in self._parts and lower in self._absent:
                    self._lost[upper].append(lower)
        self._numbers = {name: number for number, name in enumerate(relation.names)}
        self._touched = dict.fromkeys(self._parts, 0)
        # What touches a part, or is screwed to it.
        self._linked = {name: set[str]() for name in relation.names}
        for contact in relation.contacts:
            for name, other in (contact.parts, contact.parts[::-1]):
                self._linked[name].add(other)
                if name in self._touched:
                    self._touched[name] |= 1 << self._numbers[other]
        for fastener in relation.fasteners:
            for join in fastener.joins:
                self._linked[fastener.part].add(join)
                self._linked[join].add(fastener.part)
        self._firm_bits = encode_set([self._numbers[name] for name in self._firm])
        self._known: dict[tuple[str, int, bool], bool] = {}
        self._earlier: dict[str, int] = {}
        self._blockers: dict[int, list[int]] = {}
        self._heights: dict[int, float] = {}
        self._joined = {
            name: set(fastener.joins)
            for name in self._driven
            for fastener in (relation.fastener(name),)
            if fastener is not None
        }

    def best(self) -> Bearing:
        """Return the largest set of parts that one arm places."""
        undriven = self._find_undriven()
        if self._firm:
            near = {name for name in self._parts if self._touched[name] or name in self._firm}
            ground = -np.inf
            best = self._order_holding(self._support(near, ground, undriven), ground, undriven)
        else:
            best = self._find_standing(undriven)
            ground = self._find_ground(self._parts, undriven)
        if any(reason.kind in ("closed in", "from below") for reason in best.why_not.values()):
            placed, closed_in = self._build_up(ground)
            bearing = self._order_holding(placed, ground, undriven | closed_in)
            fewer = len(bearing.order) <= len(best.order)
            if not fewer and bearing.undriven.keys() <= best.undriven.keys():
                best = bearing
        return best

    def _find_standing(self, undriven: Mapping[str, LeftOut]) -> Bearing:
        """Return the largest set of parts of which each has a support."""
        present = set(self._parts)
        best = self._order([], 0.0, undriven)
        while present and len(present) > len(best.order):
            ground = min(self._lowest[name] for name in present)
            borne = self._find_supported(present, ground)
            # Without its base, the rest of the product must be in one piece.
            whole = len(present) == len(self._parts) or self._is_connected(borne)
            if len(borne) > len(best.order) and whole:
                bearing = self._order(borne, ground, undriven)
                if len(bearing.order) > len(best.order):
                    best = bearing
            present = {name for name in present if self._lowest[name] > ground + _TOUCH_M}
        if self._holding and (best.why_not or self._turning):
            ground = self._find_ground(self._parts, undriven)
            # What touches nothing may be a mistake, and is told.
            near = {name for name in self._parts if self._touched[name]}
            borne = self._support(near, ground, undriven)
            bearing = self._order_holding(borne, ground, undriven)
            if len(bearing.order) > len(best.order) - bool(self._turning):
                best = bearing
        return best

    def _build_up(self, ground: float) -> tuple[list[str], dict[str, LeftOut]]:
        """Return parts that come one by one past those before them, and those shut out by them.

        Few of the parts that lock each other are left out, as a part that shuts out others comes
        late.
        """
        self._held = set(self._turning)
        placed, there = [name for name in self._parts if name in self._firm], self._firm_bits
        waiting = {self._numbers[name] for name in self._parts.keys() - self._firm}
        while (number := self._choose_next(waiting, there, ground)) is not None:
            name = self._relation.names[number]
            if not self._stays(name, there, ground):
                self._held.add(name)
            placed.append(name)
            waiting.discard(number)
            there |= 1 << number
        return placed, {
            name: self._explain_closed_in(name, there)
            for name in self._parts
            if self._numbers[name] in waiting
            and all(way & there for way in self._list_blockers(self._numbers[name], name))
        }

    @cached_property
    def _inner(self) -> dict[str, set[int]]:
        """The numbers of the parts in the box about each part, which a hand brings first."""
        bounds_m = {name: part.bounds_m for name, part in self._parts.items()}
        boxes = {name: (lo - _TOUCH_M, hi + _TOUCH_M) for name, (lo, hi) in bounds_m.items()}
        return {
            name: {
                self._numbers[other]
                for other, (lower, upper) in boxes.items()
                if other != name and (lower >= low).all() and (upper <= high).all()
            }
            for name, (low, high) in boxes.items()
        }

    def _choose_next(self, waiting: Collection[int], there: int, ground: float) -> int | None:
        """Return the part that shuts out least, one next to placed ones before one on the table.

        What it shuts out counts by the parts that touch that.
        """
        able, lost = list[int](), dict.fromkeys(waiting, 0)
        for number in sorted(waiting):
            name = self._relation.names[number]
            free = [way for way in self._list_blockers(number, name) if not way & there]
            if free and (
                (self._holding and there & self._touched[name]) or self._stays(name, there, ground)
            ):
                able.append(number)
            # Each of these would be in its way in all directions.
            for other in list_members(reduce(and_, free)) if free else ():
                if other in lost:
                    lost[other] += len(self._linked[name])

        def rate(number: int) -> tuple[int, bool, bool, bool, int]:
            name = self._relation.names[number]
            is_apart = bool(there) and not there & self._touched[name]
            is_around = not self._inner[name].isdisjoint(waiting)
            return lost[number], is_apart, not self._stays(name, there, ground), is_around, number

        return min(able, key=rate, default=None)

    def _find_ground(self, present: Collection[str], lost: Collection[str]) -> float:
        """Return the lowest height, without what left-out parts cut off from the largest group."""
        groups = self._list_groups(present, lost)
        weights = [
            (len(group), sum(self._parts[name].mass_kg for name in group)) for group, _ in groups
        ]
        main = max(range(len(groups)), key=weights.__getitem__, default=0)
        return min(
            (
                self._get_lowest(group)
                for number, (group, is_cut_off) in enumerate(groups)
                if number == main or not is_cut_off
            ),
            default=0.0,
        )

    def _get_lowest(self, names: Collection[str]) -> float:
        return min(self._lowest[name] for name in names)

    def _drop_hanging(self, present: set[str], ground: float, lost: Collection[str]) -> set[str]:
        """Return the parts without groups that hang in the air, as parts are left out."""
        kept: set[str] = set()
        for group, is_cut_off in self._list_groups(present, lost):
            stands = abs(self._get_lowest(group) - ground) < _TOUCH_M
            if stands or not is_cut_off or self._firm & group:
                kept |= group
        return kept

    def _list_groups(
        self, present: Collection[str], lost: Collection[str]
    ) -> list[tuple[set[str], bool]]:
        """Return the connected groups of parts, and whether each touches a left-out part.

        Parameters
        ----------
        lost
            Screws and nuts that are left out; the others connect parts, too.
        """
        there = {*present, *(self._driven - set(lost)), *self._firm}
        left = [name for name in self._parts if name in there]
        groups: list[tuple[set[str], bool]] = []
        while left:
            reached, fresh, is_cut_off = {left[0]}, [left[0]], False
            while fresh:
                linked = self._linked[fresh.pop()]
                is_cut_off |= not linked <= there
                more = (linked & there) - reached
                reached |= more
                fresh += more
            groups.append((reached & self._parts.keys(), is_cut_off))
            left = [name for name in left if name not in reached]
        return groups

    def _support(self, present: set[str], ground: float, lost: Collection[str]) -> list[str]:
        """Return the supported parts, each after its supports; hold parts that do not stay.

        The part that lets most others stand is held next, the heaviest of several. Then each hold
        without which all stand is given up. What left-out parts alone connect to the rest is not
        held, as it would hang in the air.

        Parameters
        ----------
        lost
            Screws and nuts that are left out.
        """
        if not self._holding:
            return self._find_supported(present, ground)
        present = self._drop_hanging(present, ground, lost)
        self._held = self._turning & present
        borne = self._find_supported(present, ground)
        while len(borne) < len(present):
            masses = {n: self._parts[n].mass_kg for n in present if n not in borne}
            near = [n for n in masses if any(self._touches(n, other) for other in borne)]
            tried = sorted(near or masses, key=lambda n: (-masses[n], n))[:_MOST_HELD]
            counts: dict[str, int] = {}
            for name in tried:
                self._held.add(name)
                counts[name] = len(self._find_supported(present, ground, borne))
                self._held.discard(name)
            self._held.add(max(tried, key=counts.__getitem__))
            borne = self._find_supported(present, ground, borne)
        for name in sorted(self._held - self._turning, key=self._numbers.__getitem__):
            self._held.discard(name)
            if len(self._find_supported(present, ground)) < len(present):
                self._held.add(name)
        return self._find_supported(present, ground)

    def _touches(self, name: str, other: str) -> bool:
        return bool(self._touched[name] >> self._numbers[other] & 1)

    def _find_undriven(self) -> dict[str, LeftOut]:
        """Return the screws and nuts that are driven from below, turn their mate or seat on none.

        A nut that is held does without a seat: its bolt is driven.
        """
        words = "is driven from below: the product has to be turned over, or held up by a fixture"
        undriven = {}
        for name in sorted(self._driven - self._firm, key=self._numbers.__getitem__):
            is_below = float(np.dot(self._get_axis(name), self._vector)) < -_SIDEWAYS
            mate = find_driven_mate(self._relation, name, self._driven, self._up)
            if mate is not None:
                why = (
                    f"is on {mate}, which is driven, and no pocket keeps it from turning: a nest "
                    "or a second hand has to hold it"
                )
                undriven[name] = LeftOut(name, "from below" if is_below else "turns", why)
            elif is_below:
                undriven[name] = LeftOut(name, "from below", words)
            elif not self._holding and (rods := list_rods(self._relation, name)):
                why = f"turns {rods[0]} with it, which a second hand has to hold"
                undriven[name] = LeftOut(name, "turns", why)
            elif self._is_loose(name):
                why = "lies on no part against which it could be tightened"
                undriven[name] = LeftOut(name, "turns", why)
        return undriven

    def _is_loose(self, name: str) -> bool:
        """Return whether a driven nut touches none of the parts that it holds."""
        nut = self._relation.fastener(name)
        if nut is None or nut.kind != "nut":
            return False
        pressed = set(nut.joins) - set(nut.threaded_in)
        return not any(
            name in contact.parts and pressed & set(contact.parts)
            for contact in self._relation.contacts
        )

    def _get_axis(self, name: str) -> Vector:
        fastener = self._relation.fastener(name)
        assert fastener is not None
        return fastener.axis

    def _find_supported(
        self, present: Collection[str], ground: float, borne: Collection[str] = ()
    ) -> list[str]:
        """Return the supported parts, each after its supports, early parts of the product first.

        Parameters
        ----------
        borne
            Parts that are supported for sure, in such an order; they come first.
        """
        supported = list(borne or (name for name in self._parts if name in self._firm))
        standing = self._firm_bits | encode_set([self._numbers[name] for name in supported])
        waiting = {self._numbers[n] for n in present if n in self._parts} - {
            self._numbers[n] for n in supported
        }
        queue = sorted(waiting)
        queued = {*queue}
        while queue:
            number = heappop(queue)
            queued.discard(number)
            name = self._relation.names[number]
            if self._stays(name, standing, ground):
                supported.append(name)
                standing |= 1 << number
                waiting.discard(number)
                # No other part can have a support that it lacked before.
                for other in list_members(self._touched[name]):
                    if other in waiting and other not in queued:
                        heappush(queue, other)
                        queued.add(other)
        return supported

    def _stays(self, name: str, standing: int, ground: float) -> bool:
        """Return whether a support, the table or parts that stand keep a part in place."""
        if name in self._held or name in self._firm:
            return True
        grounded = self._lowest[name] < ground + _TOUCH_M
        key = (name, standing & self._touched[name], grounded)
        if key not in self._known:
            faces = [
                points
                for other, points in self._beneath[name].items()
                if standing >> self._numbers[other] & 1
            ]
            if grounded:
                faces.append(self._find_foot(name))
            foot = np.concatenate(faces) if faces else None
            self._known[key] = self._stands_level(name, foot) or self._equilibrium.stays(
                self._numbers[name], key[1], self._up, foot
            )
        return self._known[key]

    def _stands_level(self, name: str, foot_m: Array | None) -> bool:
        """Return whether level faces alone bear a part, with the margin of `decide_standing`."""
        if foot_m is None or not len(foot_m):
            return False
        part = self._parts[name]
        height_m = float(np.asarray(part.centre_m) @ self._vector - (foot_m @ self._vector).min())
        reach_m = compute_margin_m(float(np.ptp(part.vertices_m, axis=0).max()), height_m)
        return is_over(self._centres[name], foot_m @ self._plan.T, reach_m)

    def _list_bearers(self, name: str, borne: Mapping[str, object]) -> tuple[str, ...]:
        """Return the parts that bear a part: those beneath level faces, or any that push it up."""
        bearers = [other for other in self._beneath[name] if other in borne]
        there = encode_set([self._numbers[other] for other in borne])
        if not bearers:
            numbers = self._equilibrium.list_bearers(self._numbers[name], there, self._up)
            bearers = [self._relation.names[number] for number in numbers]
        return tuple(bearers)

    def _order_holding(
        self, borne: Collection[str], ground: float, undriven: Mapping[str, LeftOut]
    ) -> Bearing:
        """Return an order, with parts held that fall in between.

        These supports must be fewer than the parts that they bring, which come past held ones.
        """
        held = {*self._held}
        plain = self._order(borne, ground, undriven)
        left_out = (*plain.why_not.values(), *plain.undriven.values())
        if not self._between or not any(r.kind in ("closed in", "from below") for r in left_out):
            return plain
        self._held, self._more = held, set()
        further = self._order(borne, ground, undriven)
        gained = len(further.order) - len(plain.order)
        gained += len(plain.undriven) - len(further.undriven)
        is_better, self._more = gained > len(self._more), None
        return further if is_better else plain

    def _order(
        self, borne: Collection[str], ground: float, undriven: Mapping[str, LeftOut]
    ) -> Bearing:
        """Return an order of the supported parts, except parts that spoil every order."""
        kept, reasons = list(borne), dict(undriven)
        while True:
            self._drop_loose(kept, reasons)
            self._earlier = self._rank(kept)
            screws = self._driven - reasons.keys()
            everything = encode_set([self._numbers[name] for name in (*kept, *screws)])
            removed, left = self._take_away_holding(everything | self._firm_bits, ground)
            left &= ~self._firm_bits
            if not left:
                break
            name = self._choose_withdrawn(left, ground)
            reasons[name] = self._explain_closed_in(name, left | self._firm_bits)
            there = {other for other in kept if other not in reasons}
            if self._holding and there and not self._firm:
                # Without its lowest part the product stands on the next one.
                ground = self._find_ground(there, reasons)
            kept = self._support(there, ground, reasons)
        order = [name for name in reversed(removed) if name in kept]
        standing: dict[str, tuple[str, ...]] = {
            name: () for name in self._parts if name in self._firm
        }
        for name in order:
            standing[name] = self._list_bearers(name, standing)
        why_not = {name: reason for name, reason in reasons.items() if name in self._parts}
        why_not = self._explain_all(standing, why_not)
        undriven = {name: reason for name, reason in reasons.items() if name in self._driven}
        held = tuple(name for name in order if name in self._held)
        on = {name: standing[name] for name in order}
        return Bearing(self._up, tuple(order), on, why_not, undriven, held, {}, self._between)

    def _rank(self, kept: Collection[str]) -> dict[str, int]:
        """Return the parts before each part: supports must not bear each other in a circle."""
        earlier, before = {}, 0
        for name in kept:
            earlier[name] = before
            before |= 1 << self._numbers[name]
        return earlier

    def _drop_loose(self, kept: Collection[str], reasons: dict[str, LeftOut]) -> None:
        """Leave out the screws and nuts that join a part that is left out."""
        there = set(kept) | (self._driven - reasons.keys()) | self._firm
        changed = True
        while changed:
            changed = False
            for name in sorted(there & self._driven - self._firm, key=self._numbers.__getitem__):
                for join in list_required(self._relation, name, self._up):
                    if join not in there:
                        words = f"goes through or into {join}, which is left out"
                        reasons[name] = LeftOut(name, "follows", words, (join,))
                        there.discard(name)
                        changed = True
                        break

    def _take_away(
        self, present: int, ground: float, first: Collection[str] = ()
    ) -> tuple[list[str], int]:
        """Return the parts that can be taken away one by one, in order, and the rest.

        Parameters
        ----------
        first
            Parts that leave as soon as they can.
        """
        removed: list[str] = []
        names = self._relation.names
        # From the top: parts below may still be needed.
        order = sorted(
            list_members(present), key=lambda n: (names[n] not in first, -self._get_height(n), -n)
        )
        progress = True
        while progress:
            progress = False
            for number in order:
                if present >> number & 1 and self._is_free(number, present, ground):
                    present &= ~(1 << number)
                    removed.append(names[number])
                    progress = True
                    if first:
                        break
        return removed, present

    def _take_away_holding(self, present: int, ground: float) -> tuple[list[str], int]:
        """Return the same as `_take_away`; hold parts that fall as others leave.

        Then each of these holds without which all can be taken away is given up.
        """
        removed, left = self._take_away(present, ground)
        if self._more is None:
            return removed, left
        more, before = set[str](), {*self._held}
        while (number := self._find_least_bearing(left, ground)) is not None:
            falling = self._list_falling(number, left, ground)
            more |= falling
            self._held |= falling
            later, left = self._take_away(left & ~(1 << number), ground, more)
            removed += [self._relation.names[number], *later]
        for name in sorted(more, key=self._numbers.__getitem__):
            self._held.discard(name)
            again, rest = self._take_away(present, ground, self._held - before)
            if rest == left:
                removed = again
            else:
                self._held.add(name)
        self._more = self._held - before
        return removed, left

    def _find_least_bearing(self, present: int, ground: float) -> int | None:
        """Return the part that can leave without which fewest fall; ties go to the highest.

        Contacts must still connect the falling parts to the table: supports hold no loose part.
        """
        falling = {
            number: self._list_falling(number, present, ground)
            for number in list_members(present)
            if self._can_leave(number, present)
        }
        return min(
            (
                number
                for number, names in falling.items()
                if names <= self._list_tied(present & ~(1 << number), names, ground)
            ),
            key=lambda n: (len(falling[n]), -self._get_height(n)),
            default=None,
        )

    def _list_tied(self, present: int, falling: Collection[str], ground: float) -> set[str]:
        """Return the parts that contacts connect to the table."""
        left = [name for name in self._parts if present >> self._numbers[name] & 1]
        tied, fresh = set[str](), list[str]()
        for name in left:
            stands = self._lowest[name] < ground + _TOUCH_M and name not in falling
            if stands or name in self._firm:
                fresh.append(name)
        while fresh:
            tied.update(fresh)
            touched = [n for n in left if n not in tied for t in fresh if self._touches(t, n)]
            fresh = list(dict.fromkeys(touched))
        return tied

    def _get_height(self, number: int) -> float:
        if number not in self._heights:
            centre_m = np.asarray(self._product.parts[number].centre_m)
            self._heights[number] = round(float(centre_m @ self._vector), 6)
        return self._heights[number]

    def _is_free(self, number: int, present: int, ground: float) -> bool:
        """Return whether a part can leave upwards or sideways, and all others stay."""
        can_leave = self._can_leave(number, present)
        return can_leave and not self._list_falling(number, present, ground)

    def _can_leave(self, number: int, present: int) -> bool:
        """Return whether a part can leave upwards or sideways: no part or screw is in its way."""
        name, others = self._relation.names[number], present & ~(1 << number)
        joined = name in self._parts and any(
            name in joins and others >> self._numbers[screw] & 1
            for screw, joins in self._joined.items()
        )
        return (
            name not in self._firm
            and not joined
            and not all(blockers & others for blockers in self._list_blockers(number, name))
        )

    def _list_falling(self, number: int, present: int, ground: float) -> set[str]:
        """Return the neighbours that fall as a part leaves."""
        others = present & ~(1 << number)
        return {
            other
            for other, touched in self._touched.items()
            if touched >> number & 1
            and others >> self._numbers[other] & 1
            and not self._stays(other, others & self._earlier[other], ground)
        }

    def _list_blockers(self, number: int, name: str) -> list[int]:
        """Return the blockers of a part in each direction that is not downwards."""
        if number not in self._blockers:
            self._blockers[number] = list_blockers(self._relation, name, self._up)
        return self._blockers[number]

    def _choose_withdrawn(self, left: int, ground: float) -> str:
        """Return the part without which most others are placed; ties go to the lightest."""
        masses = {n: self._product.parts[n].mass_kg for n in list_members(left)}
        tried = sorted(masses, key=lambda n: (masses[n], n))[:_MOST_TRIED]
        held, firm = self._held, self._firm_bits
        if self._more is not None:
            self._held = {*self._parts}
        rests = {n: self._take_away(left & ~(1 << n) | firm, ground)[1].bit_count() for n in tried}
        self._held = held
        number = min(tried, key=lambda n: (rests[n], masses[n], n))
        return self._relation.names[number]

    def _explain_closed_in(self, name: str, left: int) -> LeftOut:
        """Return the reason why a part is never free."""
        number = self._numbers[name]
        others = left & ~(1 << number)
        below = [
            direction
            for direction, blockers in self._relation.blocker_sets[number]
            if not blockers & others
        ]
        if below and name not in self._driven:
            words = "comes from below: the product has to be turned over, or held up by a fixture"
            return LeftOut(name, "from below", words)
        sets = self._list_blockers(number, name)
        fewest = min(sets, key=lambda blockers: (blockers & others).bit_count(), default=0)
        by = tuple(self._relation.names[n] for n in list_members(fewest & others))
        words = (
            f"cannot be placed before or after {_format_names(list(by))}"
            if by
            else "is needed as a support by parts that must be placed before it"
        )
        return LeftOut(name, "closed in", words, by)

    def _explain_all(
        self, borne: Mapping[str, object], known: Mapping[str, LeftOut]
    ) -> dict[str, LeftOut]:
        return {
            name: known.get(name) or self._explain(name, borne)
            for name in self._parts
            if name not in borne
        }

    def _is_connected(self, names: Collection[str]) -> bool:
        """Return whether contacts connect all parts."""
        pairs = [
            contact.parts for contact in self._relation.contacts if set(contact.parts) <= set(names)
        ]
        reached = set(list(names)[:1])
        while more := {name for pair in pairs if reached & set(pair) for name in pair} - reached:
            reached |= more
        return len(reached) == len(names)

    def _find_foot(self, name: str) -> Array:
        """Return the corners of the level faces that a part stands on."""
        if name not in self._feet:
            self._feet[name] = self._compute_foot(name)
        return self._feet[name]

    def _compute_foot(self, name: str) -> Array:
        part = self._parts[name]
        corners = part.vertices_m[part.triangles]
        heights = corners @ self._vector
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        level = normals @ self._vector < -_LEVEL * np.linalg.norm(normals, axis=1)
        for face in part.faces:
            # A level chord of a round face does not prevent rolling.
            level[face.triangles] &= face.kind not in ROUND_KINDS
        low = (heights < self._lowest[name] + _TOUCH_M).all(axis=1)
        return np.asarray(corners[level & low].reshape(-1, 3))

    def _find_level_contacts(self, contact: Contact) -> Iterator[tuple[str, str, Array]]:
        """Yield which part of a contact stands on the other, and where."""
        points = np.asarray(contact.points_m).reshape(-1, 3)
        if not len(points) or (
            contact.axis is not None and abs(float(self._vector @ contact.axis)) < _LEVEL
        ):
            return
        normals = np.asarray(contact.normals).reshape(-1, 3) @ self._vector
        first, second = contact.parts
        for upper, lower, there in (
            (first, second, (normals < -_LEVEL).any()),
            (second, first, (normals > _LEVEL).any()),
        ):
            if there:
                yield upper, lower, self._select_level_points(points)

    def _select_level_points(self, points: Array) -> Array:
        """Return the points that share their height with others: those on a level face."""
        heights = np.round(points @ self._vector / _SAME_M)
        _, which, counts = np.unique(heights, return_inverse=True, return_counts=True)
        level = counts[which] >= _FEWEST_POINTS
        return np.asarray(points[level] if level.any() else points)

    def _explain(self, name: str, borne: Mapping[str, object]) -> LeftOut:
        """Return the reason why a part lacks support."""
        beneath = list(self._beneath[name])
        there = [other for other in beneath if other in borne]
        touched = [
            other
            for contact in self._relation.contacts
            if name in contact.parts
            for other in contact.parts
            if other != name
        ]
        ground = min((self._lowest[supported] for supported in borne), default=-np.inf)
        below = self._lowest[name] < ground - _TOUCH_M
        lost = self._lost[name]
        if lost:
            words = f"stands on {_format_names(lost)}, which is left out"
            return LeftOut(name, "follows", words, tuple(lost))
        if below and is_over(self._centres[name], self._find_foot(name) @ self._plan.T):
            words = "stands lower than all others, more of which stand without it"
            return LeftOut(name, "hangs lower", words)
        if there:
            words = (
                f"would tip off {_format_names(there)}, at least if the table is tilted by "
                f"{TILT_DEG:g} degrees: its centre of mass is not over its supports"
            )
            return LeftOut(name, "tips", words, tuple(there))
        if beneath:
            words = f"stands on {_format_names(beneath)} alone, which nothing bears"
            return LeftOut(name, "follows", words, tuple(beneath))
        bearers = self._list_bearers(name, borne)
        if touched and self._absent.issuperset(touched):
            words = f"touches only {_format_names(touched)}, which is left out"
            return LeftOut(name, "follows", words, tuple(dict.fromkeys(touched)))
        if bearers:
            words = f"would slip or roll off {_format_names(list(bearers))}"
            return LeftOut(name, "tips", words, bearers)
        if touched:
            words = (
                f"has no level face beneath it: only its fit to {_format_names(touched)} holds it, "
                "which takes a second hand, a press or a nest"
            )
            return LeftOut(name, "not level", words, tuple(dict.fromkeys(touched)))
        return LeftOut(name, "floats", "has nothing beneath it: it touches no other part")


def _format_names(names: list[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return " or ".join(names[:_SHOWN]) + more
