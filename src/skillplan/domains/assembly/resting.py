"""What parts rest on, with which area; and what floats, overlaps, or lies elsewhere."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

from skillplan.collision.boxes import WorldBox
from skillplan.collision.solid import TOUCH_M, Solid, centre_of, stands
from skillplan.domains.assembly.layout import goal_solid, start_solid, table
from skillplan.domains.assembly.part_meshes import origin_hint
from skillplan.domains.assembly.part_schema import PartConfig
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.errors import Issue

# Up to so much of its least width, a part is taken to have been meant beside what it stands on.
_MOST_SHARE = 0.4
_PRECISION_M = 1e-5

TABLE = "the table"
"""What is beneath everything; no part can have this name."""


@dataclass(frozen=True, slots=True)
class Rest:
    """What bears a part.

    Parameters
    ----------
    on
        Its name.
    area_m2
        How much of it the part stands on, seen from above [m2]; 0 on a line or a point.
    """

    on: str
    area_m2: float


@dataclass(frozen=True, slots=True)
class _Layout:
    """All parts that lie or stand somewhere at one time."""

    key: str
    when: str
    solids: Mapping[str, Solid]
    named: Mapping[str, list[str]]

    def place(self, part: PartConfig) -> list[float] | None:
        """Return the numbers that the file gives for a part's place."""
        given: list[float] | None = getattr(part, f"{self.key}_m")
        return given


def bearers_at_start(config: AssemblyConfig, name: str) -> list[str]:
    """Return the parts that a part lies on at the start, as the file says or by its height."""
    part = config.parts[name]
    if part.start_m is None or len(part.start_m) == 2:
        return [] if part.start_on is None else [part.start_on]
    own = start_solid(config, name)
    lying = [other for other, at in config.parts.items() if other != name and at.feeder is None]
    return [other for other in lying if _bears(start_solid(config, other), own)]


def rests_at_start(config: AssemblyConfig, name: str) -> list[Rest]:
    """Return what a part lies on at the start, that of the most area first; none in a feeder."""
    return [] if config.parts[name].feeder is not None else _rests(_starts(config), name)


def rests_at_goal(config: AssemblyConfig, name: str) -> list[Rest]:
    """Return what a part stands on at its goal once all others do, that of the most area first."""
    return _rests(_goals(config), name)


def resting_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield what overlaps, and what does not lie on what it should, with millimetres."""
    for layout in (_starts(config), _goals(config)):
        amiss: set[str] = set()
        for issue, names in _overlaps(config, layout):
            amiss |= names
            yield issue
        for name in layout.solids:
            if name not in amiss:
                hint = origin_hint(config, (name, *layout.named.get(name, ())))
                for issue in _loose(config.parts[name], name, layout):
                    yield replace(issue, message=f"{issue.message}{hint}")


def _starts(config: AssemblyConfig) -> _Layout:
    lying = [name for name, part in config.parts.items() if part.feeder is None]
    return _Layout(
        "start",
        "at the start",
        {name: start_solid(config, name) for name in lying},
        {name: [on] for name in lying if (on := config.parts[name].start_on) is not None},
    )


def _goals(config: AssemblyConfig) -> _Layout:
    return _Layout(
        "goal",
        "at their goals",
        {name: goal_solid(config, name) for name in config.parts},
        {name: on for name, part in config.parts.items() if (on := part.goal_on) is not None},
    )


def _rests(layout: _Layout, name: str) -> list[Rest]:
    own = layout.solids[name]
    beneath = {TABLE: table(), **layout.solids}
    found = [
        Rest(other, own.contact_m2(solid))
        for other, solid in beneath.items()
        if other != name and _bears(solid, own)
    ]
    return sorted(found, key=lambda rest: -rest.area_m2)


def _bears(lower: Solid, upper: Solid) -> bool:
    if upper.box.low[2] > lower.box.high[2] + TOUCH_M:
        return False
    gap_m = upper.gap_m(lower)
    return gap_m is not None and gap_m <= TOUCH_M


def _overlaps(config: AssemblyConfig, layout: _Layout) -> Iterator[tuple[Issue, set[str]]]:
    """Yield what overlaps, with the names of those that do."""
    for one, other in combinations(layout.solids, 2):
        depth_m = layout.solids[other].depth_m(layout.solids[one])
        if depth_m > TOUCH_M:
            way_m = layout.solids[other].way_out_m(layout.solids[one])
            message = f"{other!r} and {one!r} overlap by {_mm(way_m)} {layout.when}. Move one."
            message += origin_hint(config, (other, one))
            given = layout.place(config.parts[other]) is not None
            key = f"{layout.key}_m" if given else f"{layout.key}_on"
            yield Issue(message, ("parts", other, key)), {one, other}
    for name, solid in layout.solids.items():
        depth_m = -solid.box.low[2]
        if depth_m > TOUCH_M:
            message = f"{name!r} is {_mm(depth_m)} deep in the table {layout.when}. Raise it."
            yield Issue(message, ("parts", name, f"{layout.key}_m")), {name}


def _loose(part: PartConfig, name: str, layout: _Layout) -> Iterator[Issue]:
    """Yield what a part should lie on, and does not."""
    own, place = layout.solids[name], layout.place(part)
    key, raised = f"{layout.key}_on", place is not None and len(place) == 3
    named = layout.named.get(name, [])
    for index, other in enumerate(named):
        beneath = layout.solids[other]
        gap_m = own.gap_m(beneath)
        path = ("parts", name, key, index) if len(named) > 1 else ("parts", name, key)
        if gap_m is not None and gap_m <= TOUCH_M:
            continue
        if own.fall_m(beneath) is None:
            message = (
                f"{name!r} does not lie over {other!r}, of which no face is beneath it. Move it."
            )
            yield Issue(message, path)
        elif gap_m is None:
            yield Issue(f"{name!r} does not lie on {other!r}, but below its top. Raise it.", path)
        elif raised:
            message = f"{name!r} floats {_mm(gap_m)} above {other!r}. Lower it, or leave out z."
            yield Issue(message, ("parts", name, f"{layout.key}_m"))
        else:
            message = (
                f"{name!r} does not lie on {other!r}, but {_mm(gap_m)} above it. Leave it out."
            )
            yield Issue(message, path)
    if raised and not named:
        yield from _floating(name, layout)
    if named and not raised:
        yield from _on_a_wall(name, named, layout)


def _on_a_wall(name: str, named: list[str], layout: _Layout) -> Iterator[Issue]:
    """Yield that a part would tip off what it would pass by if it was a little narrower."""
    own = layout.solids[name]
    beneath = [table(), *(solid for other, solid in layout.solids.items() if other != name)]
    corners = [corner for solid in beneath for face in own.contacts(solid) for corner in face]
    if not corners or stands(centre_of(own.shapes, own.pose), corners):
        return

    def passes(by_m: float) -> bool:
        falls_m = [own.narrowed_fall_m(layout.solids[other], by_m) for other in named]
        return TOUCH_M < min(falls_m) < math.inf

    sizes_m = [h - low for piece in own.pieces for low, h in zip(*_plan(piece.box), strict=True)]
    low_m, high_m = 0.0, _MOST_SHARE * min(sizes_m)
    if not passes(high_m):
        return
    while high_m - low_m > _PRECISION_M:
        middle_m = (low_m + high_m) / 2
        low_m, high_m = (low_m, middle_m) if passes(middle_m) else (middle_m, high_m)
    message = (
        f"{name!r} is {_mm(high_m)} deep in a wall of {_listed(named)} {layout.when}. Move it."
    )
    key = "m" if layout.key == "goal" else "on"
    yield Issue(message, ("parts", name, f"{layout.key}_{key}"))


def _plan(box: WorldBox) -> tuple[tuple[float, ...], tuple[float, ...]]:
    return box.low[:2], box.high[:2]


def _listed(names: list[str]) -> str:
    return " or ".join(repr(name) for name in names)


def _floating(name: str, layout: _Layout) -> Iterator[Issue]:
    own = layout.solids[name]
    beneath = {TABLE: table(), **layout.solids}
    gaps = {
        other: gap_m
        for other, solid in beneath.items()
        if other != name and (gap_m := own.gap_m(solid)) is not None
    }
    if not gaps:
        return
    nearest = min(gaps, key=lambda other: gaps[other])
    if gaps[nearest] > TOUCH_M:
        what = nearest if nearest == TABLE else repr(nearest)
        message = (
            f"{name!r} floats {_mm(gaps[nearest])} above {what} {layout.when}. Lower it, or leave "
            "out z."
        )
        yield Issue(message, ("parts", name, f"{layout.key}_m"))


def _mm(length_m: float) -> str:
    return f"{length_m * 1e3:.1f} mm"
