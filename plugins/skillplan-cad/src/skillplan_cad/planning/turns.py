"""Turn the product for parts and screws that do not come from above in its first orientation.

A workholder carries the product by its base. A part that is in before a turn has to keep its place
in it: a screw joins it to the base or to a held part, or else a support of its own holds it. In the
next orientation all of that stands firm, and further parts come from above again.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence, Set
from functools import partial

from skillplan_cad.planning.bearing import (
    ATTITUDES,
    Bearing,
    can_come_down,
    find_bearing,
    hold_mates,
    list_blockers,
    list_required,
)
from skillplan_cad.planning.precedence import encode_set, list_members
from skillplan_cad.product import Product, Vector
from skillplan_cad.relation import LeftOut, Relation

# Largest number of turns, and of parts or groups of parts that are tried after a turn.
_MOST_TURNS, _MOST_TRIED = 3, 8


def add_turns(
    product: Product,
    relation: Relation,
    bearing: Bearing,
    absent: Collection[str] = (),
    base: str | None = None,
    later: Mapping[str, LeftOut] | None = None,
    early: Collection[str] = (),
) -> Bearing:
    """Return a bearing in which the product is turned as long as that brings in further parts.

    Each turn is the one that brings in most of the parts that are left. The bearing stays as it is
    if no turn helps.

    Parameters
    ----------
    absent
        Names of parts that are not there.
    base
        Part that the workholder holds, if it is placed; default: the heaviest.
    later
        Parts and screws that `bearing` lacks because they fail in its orientation, with reasons.
    early
        Parts that do not wait for a turn to save a support, unless they shut out others after it.
    """
    reasons = dict(later or {})
    reasons |= {**bearing.why_not, **bearing.undriven}
    count = len([part for part in product if part.name not in absent])
    chosen = _choose_base(product, bearing, base)
    placed = list_placed(relation, bearing, {*absent, *reasons})
    if chosen is None or len(placed) == count:
        return bearing

    def turn(deferred: Collection[str]) -> Bearing:
        gone = {*absent, *deferred}
        start = _begin(product, relation, bearing, gone, chosen, reasons)
        return _add_turns(product, relation, start, absent, chosen)

    best = last = turn(deferred := set(later or {}))
    if len(best.ups) == 1:
        return bearing
    waiting = set(deferred)
    for _ in range(_MOST_TRIED):
        shutting = _list_shutting(relation, last, absent, chosen)
        if not shutting:
            break
        waiting |= shutting
        last = turn(waiting)
        # A part that waited may find no way in after the turn.
        if list_placed(relation, last, absent) > list_placed(relation, best, absent):
            best, deferred, early = last, set(waiting), ()
    spared = [name for name in _list_spared(relation, best, chosen) if name not in early]
    for name in spared[:_MOST_TRIED]:
        other = turn({*deferred, name})
        is_whole = list_placed(relation, other, absent) >= list_placed(relation, best, absent)
        if len(other.held) < len(best.held) and is_whole:
            best = other
            deferred.add(name)
    return best


def _begin(
    product: Product,
    relation: Relation,
    given: Bearing,
    gone: Collection[str],
    base: str,
    reasons: Mapping[str, LeftOut],
) -> Bearing:
    """Return a bearing in the air, where the workholder holds the base and no table bears others.

    Parameters
    ----------
    gone
        Names of parts that do not go in before the first turn.
    reasons
        Reasons for some of them.
    """
    up, between = given.up, given.between
    start = find_bearing(product, relation, up, gone, holding=True, between=between, firm=[base])
    left = {**{name: why for name, why in reasons.items() if name in gone}, **start.undriven}
    return Bearing(
        up,
        (base, *start.order),
        {base: (), **start.on},
        {**{n: why for n, why in left.items() if n not in relation.driven}, **start.why_not},
        {name: why for name, why in left.items() if name in relation.driven},
        (base, *start.held),
        between=between,
    )


def _list_shutting(
    relation: Relation, bearing: Bearing, absent: Collection[str], base: str
) -> set[str]:
    """Return parts of the first orientation that shut out further parts after the last turn.

    They are the fewest that are in the way of one of the further parts.
    """
    movable = {*bearing.order} - {*bearing.turned, base}
    first = encode_set([relation.index(name) for name in movable])
    placed = list_placed(relation, bearing, absent)
    missing = [name for name in relation.names if name not in placed and name not in absent]
    ways = [
        blockers & first
        for name in missing
        for blockers in list_blockers(relation, name, bearing.ups[-1])
        if blockers & first and not blockers >> relation.index(base) & 1
    ]
    fewest = min(ways, key=lambda way: (way.bit_count(), way), default=0)
    return {relation.names[number] for number in list_members(fewest)}


def _list_spared(relation: Relation, bearing: Bearing, base: str | None) -> list[str]:
    """Return the held parts that might stand without a support if they go in after a turn."""
    mates = relation.driven - hold_mates(relation, *bearing.ups).driven
    return [n for n in bearing.held if n not in mates and n != base and n not in bearing.turned]


def _add_turns(
    product: Product,
    relation: Relation,
    bearing: Bearing,
    absent: Collection[str],
    base: str | None,
) -> Bearing:
    count = len([part for part in product if part.name not in absent])
    while len(bearing.ups) <= _MOST_TURNS:
        if len(list_placed(relation, bearing, absent)) == count:
            break
        held = _hold_loose(product, relation, bearing, absent, base)
        bearings = [
            further
            for up in ATTITUDES.values()
            if up not in bearing.ups
            and (further := _turn(product, relation, bearing, held, up, absent)) is not None
        ]
        if not bearings:
            break
        bearing = max(bearings, key=partial(_rank, relation))
    return bearing


def _rank(relation: Relation, bearing: Bearing) -> tuple[int, int, int]:
    """Return numbers of which more are better: parts, and the supports that are not needed.

    A part from straight above counts twice, since the arm brings it more easily than from a side.
    """
    placed = encode_set(
        [relation.index(name) for name in bearing.order if name not in bearing.turned]
    )
    straight = sum(can_come_down(relation, name, placed, up) for name, up in bearing.turned.items())
    return len(bearing.turned) + straight, straight, -len(bearing.held)


def list_placed(relation: Relation, bearing: Bearing, absent: Collection[str] = ()) -> set[str]:
    """Return the parts that a bearing brings in, and the screws and nuts that are driven then."""
    return {*bearing.order, *_list_driven(relation, bearing, absent)}


def _list_driven(relation: Relation, bearing: Bearing, absent: Collection[str]) -> set[str]:
    return set(hold_mates(relation, *bearing.ups).driven - {*absent, *bearing.undriven})


def _turn(
    product: Product,
    relation: Relation,
    bearing: Bearing,
    held: tuple[str, ...],
    up: Vector,
    absent: Collection[str],
) -> Bearing | None:
    """Return a bearing with a further turn, or None if it brings in nothing."""
    placed = list_placed(relation, bearing, absent)
    if not held or not placed:
        return None
    more = find_bearing(
        product,
        relation,
        up,
        absent,
        holding=True,
        between=bearing.between,
        firm=placed,
        earlier=bearing.ups,
    )
    driven = hold_mates(relation, *bearing.ups, up).driven - {*absent, *more.undriven, *placed}
    turned = dict.fromkeys((*more.order, *sorted(driven, key=relation.index)), up)
    if not turned:
        return None
    return Bearing(
        bearing.up,
        (*bearing.order, *more.order),
        {**bearing.on, **more.on},
        _renew(bearing.why_not, more.why_not, {*placed, *turned}),
        _renew(bearing.undriven, more.undriven, {*placed, *turned}),
        (*held, *more.held),
        {**bearing.turned, **turned},
        bearing.between,
    )


def _renew(
    reasons: Mapping[str, LeftOut], newer: Mapping[str, LeftOut], there: Set[str]
) -> dict[str, LeftOut]:
    """Return the reasons why parts are not there, given those before and after a turn.

    The earlier ones last, unless they name only parts that are there now.
    """
    lasting = {
        name: why
        for name, why in reasons.items()
        if why.kind != "follows" or not there >= {*why.by}
    }
    merged = {**reasons, **newer, **lasting}
    return {name: why for name, why in merged.items() if name not in there}


def _choose_base(product: Product, bearing: Bearing, base: str | None) -> str | None:
    """Return a part if it is placed, or else the heaviest that is."""
    masses = {part.name: part.mass_kg for part in product if part.name in bearing.order}
    return base if base in masses else max(masses, key=masses.__getitem__, default=None)


def _hold_loose(
    product: Product,
    relation: Relation,
    bearing: Bearing,
    absent: Collection[str],
    base: str | None,
) -> tuple[str, ...]:
    """Return the parts that are held in a turn: the base, and one of each group beyond it.

    Screws join the parts of a group.
    """
    masses = {part.name: part.mass_kg for part in product}
    held = {*bearing.held, *(name for name in masses if name == base)}
    joins = [
        {name for name in list_required(relation, screw, bearing.get_up(screw)) if name in masses}
        for screw in sorted(_list_driven(relation, bearing, absent), key=relation.index)
    ]
    for name in sorted(bearing.order, key=lambda name: -masses[name]):
        if name not in _close(held, joins):
            held.add(name)
    return tuple(name for name in bearing.order if name in held)


def _close(names: set[str], joins: Sequence[set[str]]) -> set[str]:
    """Return some parts, and the ones that screws join to them directly or over others."""
    closed = set(names)
    while more := {name for pair in joins if closed & pair for name in pair} - closed:
        closed |= more
    return closed
