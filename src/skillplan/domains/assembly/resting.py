"""Supports of parts with their contact areas, and faults: overlaps, gaps, missing supports."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations

from skillplan.collision.solid import TOUCH_M, Solid, is_supported
from skillplan.domains.assembly.insertion import list_directions
from skillplan.domains.assembly.layout import get_layout, get_table
from skillplan.domains.assembly.part_meshes import build_origin_hint
from skillplan.domains.assembly.part_schema import FitConfig, PartConfig
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.domains.assembly.workholding import (
    find_workholder,
    list_carried,
    list_orientations,
    turn_pose,
)
from skillplan.errors import Issue
from skillplan.task.pose import Point
from skillplan.task.shape import Box, Cylinder, Mesh, Shape

# A part that passes a wall once it is narrower by this share was meant to stand next to it.
_WALL_SHARE = 0.4
_PRECISION_M = 1e-5
# Rounding of a depth [m].
_ROUNDING_M = 1e-9
# Extent that a part keeps at least where its stated overlap is taken away [m].
_LEAST_CORE_M = 2e-4

TABLE = "the table"
"""Name of the table as a support; part names have no blanks."""


@dataclass(frozen=True, slots=True)
class Rest:
    """A support of a part.

    Parameters
    ----------
    area_m2
        Contact area seen from above [m2]; 0 for a line or a point.
    """

    on: str
    area_m2: float


@dataclass(frozen=True, slots=True)
class _Stage:
    """All parts at the start, or all at their goals, and the fixtures."""

    key: str
    when: str
    solids: Mapping[str, Solid]
    named: Mapping[str, list[str]]

    def place(self, part: PartConfig) -> list[float] | None:
        """Return the place of a part as the file gives it."""
        given: list[float] | None = getattr(part, f"{self.key}_m")
        return given


def find_bearers(config: AssemblyConfig, name: str) -> list[str]:
    """Return the parts that a part lies on at the start, by name or by its height.

    Fixtures are none of them: they are never taken away.
    """
    part = config.parts[name]
    if part.made_of:
        return []
    if part.start_m is None or len(part.start_m) == 2:
        return [part.start_on] if part.start_on in config.parts else []
    layout = get_layout(config)
    own = layout.start(name)
    lying = [other for other in _list_lying(config) if other != name]
    return [other for other in lying if _is_bearing(layout.start(other), own)]


def find_start_rests(config: AssemblyConfig, name: str) -> list[Rest]:
    """Return the supports of a part at the start, largest area first; none in a feeder."""
    lies = name in _list_lying(config)
    return _find_rests(_collect_starts(config), name) if lies else []


def _list_lying(config: AssemblyConfig) -> list[str]:
    """Return the parts that lie somewhere at the start: not in feeders, and no sub-assemblies."""
    parts = config.parts.items()
    return [name for name, part in parts if part.feeder is None and not part.made_of]


def find_goal_rests(config: AssemblyConfig, name: str) -> list[Rest]:
    """Return the supports of a part at its goal among all parts, largest area first."""
    return _find_rests(_collect_goals(config), name)


def find_resting_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield overlaps, and parts that do not lie on their supports, with millimetres."""
    for stage in (_collect_starts(config), _collect_goals(config)):
        overlapping: set[str] = set()
        for issue, names in _find_overlaps(config, stage):
            overlapping |= names
            yield issue
        for name in stage.solids:
            if name not in overlapping and name in config.parts:
                hint = build_origin_hint(config, (name, *stage.named.get(name, ())))
                for issue in _find_gaps_in_all(config, name, stage):
                    yield replace(issue, message=f"{issue.message}{hint}")
    yield from _find_left_behind(config)


def _find_left_behind(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield parts beneath which a workholder turns something away."""
    if not config.workholders:
        return
    stage = _collect_goals(config)
    workholder_of = {name: find_workholder(config, name) for name in stage.solids}
    for name in config.moved_parts:
        own = workholder_of[name]
        may_fail = [other for other, turns in workholder_of.items() if turns not in (None, own)]
        if not any(_is_bearing(stage.solids[other], stage.solids[name]) for other in may_fail):
            # The areas of contacts take long.
            continue
        for rest in _find_rests(stage, name):
            turns = workholder_of.get(rest.on)
            if turns is None or turns == own:
                continue
            words = f"{name!r} stands on {rest.on!r}, which turns"
            path = ("parts", name, "goal_m" if stage.place(config.parts[name]) else "goal_on")
            if name in config.joined_in:
                owner = config.joined_in[name]
                yield Issue(f"{words}. Put {owner!r} together on a body that stands.", path)
            elif own is not None:
                yield Issue(f"{words} with {turns!r}, not {own!r}. Let one carry both.", path)
            else:
                yield Issue(f"{words}: name it in 'carries'.", ("workholders", turns, "carries"))
            break


def find_tipping_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield parts that do not stand by themselves at the start or at their goals.

    Parts that a fit, a holder or a workholder keeps are left out. A screw may keep others.
    """
    kept = {name for holder in config.holders.values() for name in holder.parts}
    kept |= {name for name in config.parts if find_workholder(config, name) is not None}
    kept |= {
        name
        for name, part in config.parts.items()
        if part.fixed or any(fit.holds for fit in (part.fits or {}).values())
    }
    for stage in (_collect_starts(config), _collect_goals(config)):
        for name in (key for key in config.moved_parts if key in stage.solids):
            is_goal = stage.key == "goal"
            reason = None if is_goal and name in kept else _find_fall(name, stage)
            if reason is not None:
                screws = [key for key, screw in config.screws.items() if screw.through == name]
                until = f" until {screws[0]!r} is in" if is_goal and screws else ""
                where = "its goal" if is_goal else "its start"
                message = f"at {where} {reason}. A holder or a fit has to keep it{until}."
                key = (
                    f"{stage.key}_on"
                    if stage.place(config.parts[name]) is None
                    else f"{stage.key}_m"
                )
                yield Issue(message, ("parts", name, key))


def _find_fall(name: str, stage: _Stage) -> str | None:
    """Return the reason why a part does not stand on all others, or None."""
    own = stage.solids[name]
    others = {TABLE: get_table(), **stage.solids}
    corners = [
        corner
        for other, solid in others.items()
        if other != name
        for face in own.contacts(solid)
        for corner in face
    ]
    if is_supported(own.centre, corners):
        return None
    # Imports numpy.
    from skillplan.collision.standing import decide_standing, find_touches, weigh

    touches = [
        touch
        for other, solid in others.items()
        if other != name
        for touch in find_touches({name: own, other: solid})
    ]
    standing = decide_standing({name: weigh(own, 1.0)}, touches, tilt_deg=0)
    return None if standing.stands else standing.reason


def find_buffer_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield parts that would be in a fixture, a fixed part or the table in a buffer, or float."""
    layout = get_layout(config)
    still = {name: layout.fixture(name) for name in config.fixtures}
    still |= {name: layout.goal(name) for name, part in config.parts.items() if part.fixed}
    for name, part in config.moved_parts.items():
        for index, buffer in enumerate(part.buffers or ()):
            own = layout.buffered(name, buffer)
            path = ("parts", name, "buffers", index)
            for other, solid in {TABLE: get_table(), **still}.items():
                if own.depth_m(solid) > TOUCH_M:
                    shown = other if other == TABLE else repr(other)
                    words = f"{_show_mm(own.way_out_m(solid))} deep in {shown} in buffer {buffer!r}"
                    yield Issue(f"{name!r} is {words}. Move the buffer.", path)
            if len(config.buffers[buffer].at_m) == 3:
                gaps_m = [own.gap_m(solid) for solid in (get_table(), *still.values())]
                known_m = [gap_m for gap_m in gaps_m if gap_m is not None]
                if known_m and min(known_m) > TOUCH_M:
                    words = f"floats {_show_mm(min(known_m))} above all that stays there"
                    yield Issue(f"{name!r} {words} in buffer {buffer!r}. Lower it.", path)


def _collect_starts(config: AssemblyConfig) -> _Stage:
    layout = get_layout(config)
    lying = _list_lying(config)
    jaws = {name for holder in config.holders.values() for name in holder.fixtures or ()}
    fixtures = [name for name in config.fixtures if name not in jaws]
    return _Stage(
        "start",
        "at the start",
        {name: layout.start(name) for name in (*fixtures, *lying)},
        {name: [on] for name in lying if (on := config.parts[name].start_on) is not None},
    )


def _collect_goals(config: AssemblyConfig) -> _Stage:
    layout = get_layout(config)
    return _Stage(
        "goal",
        "at their goals",
        {name: layout.goal(name) for name in (*config.fixtures, *config.parts)},
        {name: on for name, part in config.parts.items() if (on := part.goal_on) is not None},
    )


def _find_rests(stage: _Stage, name: str) -> list[Rest]:
    own = stage.solids[name]
    rests = [
        Rest(other, own.contact_m2(solid))
        for other, solid in {TABLE: get_table(), **stage.solids}.items()
        if other != name and _is_bearing(solid, own)
    ]
    return sorted(rests, key=lambda rest: -rest.area_m2)


def _is_bearing(lower: Solid, upper: Solid) -> bool:
    if upper.box.low[2] > lower.box.high[2] + TOUCH_M:
        return False
    gap_m = upper.gap_m(lower)
    return gap_m is not None and gap_m <= TOUCH_M


def _find_overlaps(config: AssemblyConfig, stage: _Stage) -> Iterator[tuple[Issue, set[str]]]:
    """Yield overlaps of parts with each other, with fixtures and with the table, and the names.

    Fixtures may overlap each other and the table: nothing moves them.
    """
    for first, second in combinations(stage.solids, 2):
        if second in config.fixtures:
            continue
        depth_m = stage.solids[second].depth_m(stage.solids[first])
        fit = _find_fit(config, first, second)
        stated_m = 0.0 if fit is None or stage.key == "start" else fit.overlap_m
        if depth_m > TOUCH_M + stated_m:
            if stage.key == "goal" and any(
                turned.solids[second].depth_m(turned.solids[first]) <= TOUCH_M + stated_m
                for turned in _turn_stages(config, second, stage)
            ):
                # Back ends tell whether both are there in one orientation.
                continue
            way_m = stage.solids[second].way_out_m(stage.solids[first])
            message = (
                f"{second!r} and {first!r} overlap by {_show_mm(way_m)} {stage.when}"
                + (f", where their fit states {stated_m * 1e3:.3g} mm" if stated_m else "")
                + ". Move one."
            )
            message += build_origin_hint(config, (second, first))
            given = stage.place(config.parts[second]) is not None
            key = f"{stage.key}_m" if given else f"{stage.key}_on"
            yield Issue(message, ("parts", second, key)), {first, second}
        elif stated_m:
            yield from _find_sinking(config, stage, first, second)
    for name, solid in stage.solids.items():
        if name in config.fixtures:
            continue
        depth_m = -solid.box.low[2]
        if depth_m > TOUCH_M and not (
            stage.key == "goal"
            and any(
                turned.solids[name].box.low[2] >= -TOUCH_M
                for turned in _turn_stages(config, name, stage)
            )
        ):
            message = f"{name!r} is {_show_mm(depth_m)} deep in the table {stage.when}. Raise it."
            yield Issue(message, ("parts", name, f"{stage.key}_m")), {name}


def _find_sinking(
    config: AssemblyConfig, stage: _Stage, first: str, second: str
) -> Iterator[tuple[Issue, set[str]]]:
    """Yield a part that is deep in its partner where its fit states an overlap of the sides only.

    Without the stated overlap on its sides, it must not overlap along its insertion.
    """
    for name, other in ((first, second), (second, first)):
        part = config.parts.get(name)
        if part is None or other not in (part.fits or {}):
            continue
        fit = (part.fits or {})[other]
        own, partner = stage.solids[name], stage.solids[other]
        depth_m = min(
            _measure_depth_m(own, partner, direction, fit.overlap_m)
            for direction in list_directions(config, name)
        )
        if depth_m > TOUCH_M + _ROUNDING_M:
            message = (
                f"{name!r} is {_show_mm(depth_m)} deep in {other!r} along its "
                f"insertion {stage.when}. Its fit states an overlap of the sides. Move one."
            )
            key = f"{stage.key}_on" if stage.place(part) is None else f"{stage.key}_m"
            yield Issue(message, ("parts", name, key)), {first, second}


def _measure_depth_m(own: Solid, partner: Solid, direction: Point, by_m: float) -> float:
    """Return the depth of a body whose sides along a direction are shifted inwards [m].

    Bodies oblique to the direction, and meshes that are not convex, count as no deeper.
    """
    along = own.pose.inverse().rotate(direction)
    axis = max(range(3), key=lambda i: abs(along[i]))
    if abs(along[axis]) < 1 - 1e-6:
        return 0.0
    narrowed = [_narrow(shape, axis, by_m) for shape in own.shapes]
    shapes = [shape for shape in narrowed if shape is not None]
    return replace(own, shapes=shapes).depth_m(partner) if shapes else 0.0


def _narrow(shape: Shape, axis: int, by_m: float) -> Shape | None:
    """Return a shape whose sides along an axis of its body are shifted inwards, or None."""
    if isinstance(shape, Cylinder) and axis == 2:
        width_m = max(shape.diameter_m - 2 * by_m, _LEAST_CORE_M)
        return replace(shape, diameter_m=min(width_m, shape.diameter_m))
    if isinstance(shape, Cylinder) or (isinstance(shape, Mesh) and not shape.convex):
        return None
    box = shape.box
    size = [
        extent if i == axis else min(max(extent - 2 * by_m, _LEAST_CORE_M), extent)
        for i, extent in enumerate(box.size)
    ]
    if isinstance(shape, Box):
        return Box((size[0], size[1], size[2]), box.centre)
    corners = []
    for corner in shape.corners:
        x, y, z = (
            middle + (value - middle) * size[i] / box.size[i]
            for i, (value, middle) in enumerate(zip(corner, box.centre, strict=True))
        )
        corners.append((x, y, z))
    return replace(shape, corners=tuple(corners))


def _find_fit(config: AssemblyConfig, first: str, second: str) -> FitConfig | None:
    """Return the fit between two parts, whichever states it, or None."""
    for name, other in ((first, second), (second, first)):
        part = config.parts.get(name)
        if part is not None and other in (part.fits or {}):
            return (part.fits or {})[other]
    return None


def _find_gaps_in_all(config: AssemblyConfig, name: str, stage: _Stage) -> list[Issue]:
    """Return the gaps below a part; none if it rests in some orientation, or a holder waits."""
    part = config.parts[name]
    issues = list(_find_gaps(part, name, stage))
    if not issues or stage.key == "start":
        return issues
    holders = config.holders.values()
    if any(holder.kind == "hold" and name in holder.parts for holder in holders):
        return []
    for turned in _turn_stages(config, name, stage):
        if not any(_find_gaps(part, name, turned)):
            return []
    return issues


def _turn_stages(config: AssemblyConfig, name: str, stage: _Stage) -> Iterator[_Stage]:
    """Yield the stage with the workholder of a part in its other orientations."""
    workholder = find_workholder(config, name) if config.workholders else None
    if workholder is None:
        return
    own = config.workholders[workholder].fixtures or ()
    turning = {*list_carried(config, workholder), *own}
    for orientation in list_orientations(config, name)[1:]:
        yield replace(
            stage,
            solids={
                body: replace(solid, pose=turn_pose(solid.pose, orientation.motion))
                if body in turning
                else solid
                for body, solid in stage.solids.items()
            },
        )


def _find_gaps(part: PartConfig, name: str, stage: _Stage) -> Iterator[Issue]:
    """Yield the named supports that a part does not touch, and a part above all supports."""
    own, place = stage.solids[name], stage.place(part)
    key, has_height = f"{stage.key}_on", place is not None and len(place) == 3
    named = stage.named.get(name, [])
    fits = (part.fits or {}).values()
    if stage.key == "goal" and has_height and any(fit.holds for fit in fits):
        # The fit bears it; back ends check its stop.
        return
    for index, other in enumerate(named):
        beneath = stage.solids[other]
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
        elif has_height:
            message = (
                f"{name!r} floats {_show_mm(gap_m)} above {other!r}. Lower it, or leave out z."
            )
            yield Issue(message, ("parts", name, f"{stage.key}_m"))
        else:
            message = (
                f"{name!r} does not lie on {other!r}, but {_show_mm(gap_m)} above it. Leave it out."
            )
            yield Issue(message, path)
    if has_height and not named:
        yield from _find_floating(name, stage)
    if named and not has_height:
        beneath_fits = (fit for other, fit in (part.fits or {}).items() if other in named)
        stated_m = max((fit.overlap_m for fit in beneath_fits if fit.kind), default=None)
        yield from _find_wall_overlap(name, named, stage, stated_m)


def _find_wall_overlap(
    name: str, named: list[str], stage: _Stage, stated_m: float | None = None
) -> Iterator[Issue]:
    """Yield a part that would tip off a wall that it would pass if it were a little narrower.

    Parameters
    ----------
    stated_m
        Overlap that its fit states [m], which must let it pass; None without a fit.
    """
    own = stage.solids[name]
    beneath = [get_table(), *(solid for other, solid in stage.solids.items() if other != name)]
    corners = [corner for solid in beneath for face in own.contacts(solid) for corner in face]
    if not corners:
        return
    if stated_m is None and is_supported(own.centre, corners):
        return

    def passes(by_m: float) -> bool:
        falls_m = [own.narrowed_fall_m(stage.solids[other], by_m) for other in named]
        return TOUCH_M < min(falls_m) < math.inf

    boxes = [piece.box for piece in own.pieces]
    sizes_m = [box.high[axis] - box.low[axis] for box in boxes for axis in (0, 1)]
    low_m, high_m = 0.0, _WALL_SHARE * min(sizes_m)
    if not passes(high_m):
        return
    while high_m - low_m > _PRECISION_M:
        middle_m = (low_m + high_m) / 2
        low_m, high_m = (low_m, middle_m) if passes(middle_m) else (middle_m, high_m)
    walls = " or ".join(repr(other) for other in named)
    deep = _show_mm(high_m) if stated_m is None else f"{high_m * 1e3:.3g} mm"
    message = f"{name!r} is {deep} deep in a wall of {walls} {stage.when}"
    message += "" if stated_m is None else f", where its fit states {stated_m * 1e3:.3g} mm"
    message += ". Move it."
    key = "m" if stage.key == "goal" else "on"
    yield Issue(message, ("parts", name, f"{stage.key}_{key}"))


def _find_floating(name: str, stage: _Stage) -> Iterator[Issue]:
    """Yield a part at a given height with a gap to the nearest support."""
    own = stage.solids[name]
    others = {TABLE: get_table(), **stage.solids}
    gaps_m: dict[str, float] = {}
    # The supports have the nearest tops, and one that it touches suffices.
    for other in sorted(others, key=lambda key: abs(own.box.low[2] - others[key].box.high[2])):
        gap_m = None if other == name else own.gap_m(others[other])
        if gap_m is not None:
            gaps_m[other] = gap_m
            if gap_m <= TOUCH_M:
                return
    if not gaps_m:
        return
    nearest = min((key for key in others if key in gaps_m), key=lambda key: gaps_m[key])
    support = nearest if nearest == TABLE else repr(nearest)
    message = (
        f"{name!r} floats {_show_mm(gaps_m[nearest])} above {support} {stage.when}. Lower it, "
        "or leave out z."
    )
    yield Issue(message, ("parts", name, f"{stage.key}_m"))


def _show_mm(length_m: float) -> str:
    return f"{length_m * 1e3:.1f} mm"
