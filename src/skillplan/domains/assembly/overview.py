"""Output of ``check`` on a valid assembly: supports, insertions, meshes, and hints."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from skillplan.collision.boxes import WorldBox, box_at, sweep_hits
from skillplan.domains.assembly.gripping import describe_candidates, list_grasps
from skillplan.domains.assembly.holding import name_direction
from skillplan.domains.assembly.insertion import list_directions, measure_insertion_m
from skillplan.domains.assembly.layout import get_layout
from skillplan.domains.assembly.part_meshes import list_moved_meshes, list_pieces
from skillplan.domains.assembly.part_schema import FixtureConfig, PartConfig
from skillplan.domains.assembly.resting import (
    Rest,
    find_goal_rests,
    find_start_rests,
    find_tipping_issues,
)
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.domains.assembly.schema_types import GraspConfig, list_given_kinds
from skillplan.domains.assembly.screw_holes import find_driving, find_shank
from skillplan.domains.assembly.screw_schema import ScrewConfig
from skillplan.domains.assembly.vocabulary import list_interchangeable
from skillplan.domains.assembly.workholding import find_workholder, list_carried
from skillplan.domains.domain import Overview
from skillplan.errors import Issue
from skillplan.physics.linear_motions import grasp_boxes
from skillplan.task.motion import Point
from skillplan.task.pose import Pose
from skillplan.task.scene import Grasp, GraspKind

_TOUCH_M = 2e-4
_ROUNDING_M = 1e-6


def find_assumptions(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield the assumptions about the arm that its file made necessary, as one message."""
    arm = config.robot.arm
    if arm.assumptions:
        yield Issue(f"{arm.name}: {'; '.join(arm.assumptions)}.", ("robot", "model"))


def find_hints(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield parts too wide for a hand, parts that block a feeder or tip, and idle dwells."""
    yield from _find_wide_grasps(config)
    yield from _find_blocked_feeders(config)
    yield from _find_idle_dwells(config)
    yield from find_tipping_issues(config)


def _find_idle_dwells(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield dwell times that no skill uses."""
    for name, screw in config.screws.items():
        is_brought = screw.feeder is None and screw.start_m is None
        if is_brought and "fetch" in list_given_kinds(screw):
            message = (
                f"has no effect, as {name!r} is fetched nowhere. Give a feeder, or leave it out."
            )
            yield Issue(message, ("screws", name, "durations_s", "fetch"))
    for name, tool in config.tools.items():
        screws = [screw for screw in config.screws.values() if name in screw.tools]
        fetched = any(screw.feeder or screw.start_m for screw in screws)
        holds = any(name in part.tools for part in config.parts.values())
        is_used = {"pick": holds, "place": holds, "fasten": bool(screws), "fetch": fetched}
        for kind in list_given_kinds(tool):
            if not is_used.get(kind, True):
                message = f"has no effect, as no skill with {name!r} has this dwell. Leave it out."
                yield Issue(message, ("tools", name, "durations_s", kind))


def _find_wide_grasps(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield parts that are wider along their closing axis than the jaws of an engine open."""
    for name, part in config.moved_parts.items():
        grasps = list_grasps(config, name)
        tool = config.tools[part.tool]
        opening_m = (tool.hand_on(config.robot.hand) or config.robot.hand).opening_m
        if any(_is_narrow(grasp, opening_m) for grasp in grasps):
            continue
        grasp = grasps[0]
        axis = grasp.closing_axis or name_direction(grasp.closing)
        given = part.grasp if isinstance(part.grasp, GraspConfig) else None
        turned = ""
        if given is not None and grasp.from_above and axis in ("x", "y"):
            # Suggest the other axis if the part is narrow enough along it at the same depth.
            other = "yx"["xy".index(axis)]
            if grasp_boxes(part.bounding_boxes, other, given.depth_m).width_m <= opening_m:
                turned = f"{{closing_axis: {other}}} or "
        message = (
            f"{grasp.width_m:.3f} m wide along {axis}, where jaws of {part.tool!r} close; those "
            f"that engines simulate open {opening_m:.3f} m. Give grasp: {turned}{{type: suction}}."
        )
        is_own = given is None or given.model_fields_set & {"approach", "closing_axis"}
        yield Issue(message, ("parts", name, "grasp" if is_own else part.shape_key))


def _is_narrow(grasp: Grasp, opening_m: float) -> bool:
    apart_m = grasp.width_m - grasp.inside_m
    return grasp.kind is GraspKind.SUCTION or apart_m <= opening_m + _ROUNDING_M


def _find_blocked_feeders(config: AssemblyConfig) -> Iterator[Issue]:
    layout = get_layout(config)
    lying = {
        name: _place_boxes(part, layout.start(name).pose)
        for name, part in config.parts.items()
        if part.feeder is None
    }
    lying |= {
        name: tuple(box_at(box, layout.fixture(name).pose) for box in fixture.bounding_boxes)
        for name, fixture in config.fixtures.items()
    }
    for feeder in config.feeders:
        presented = _list_presented(config, feeder)
        blocked = {
            name: [item for item, boxes in presented.items() if _meet(boxes, own, config)]
            for name, own in lying.items()
        }
        for name, waiting in blocked.items():
            if waiting and name in config.fixtures:
                message = (
                    f"{name!r} stands where {feeder!r} hands out {_join_names(waiting)}, which "
                    "cannot be taken. Move one of them."
                )
                yield Issue(message, ("fixtures", name, "at_m"))
            elif waiting:
                message = (
                    f"{name!r} lies where {feeder!r} hands out {_join_names(waiting)}, which "
                    "cannot be taken before it is gone. Move one of them."
                )
                part = config.parts[name]
                key = "start_on" if part.start_m is None else "start_m"
                key = "goal_m" if part.fixed else key
                yield Issue(message, ("parts", name, key))


def _list_presented(config: AssemblyConfig, feeder: str) -> dict[str, tuple[WorldBox, ...]]:
    """Return the boxes about the parts and screws that a feeder presents, by name."""
    layout, place = get_layout(config), config.feeders[feeder].position
    parts = {
        name: _place_boxes(part, layout.start(name).pose)
        for name, part in config.parts.items()
        if part.feeder == feeder
    }
    heads = {
        name: (_build_head(place, screw.head_diameter_m, screw.head_height_m),)
        for name, screw in config.screws.items()
        if screw.feeder == feeder
    }
    return {**parts, **heads}


def _place_boxes(part: PartConfig, pose: Pose) -> tuple[WorldBox, ...]:
    return tuple(box_at(box, pose) for box in part.bounding_boxes)


def _build_head(place: Point, diameter_m: float, height_m: float) -> WorldBox:
    x_m, y_m, z_m = place
    radius_m = diameter_m / 2
    return WorldBox(
        (x_m - radius_m, y_m - radius_m, z_m), (x_m + radius_m, y_m + radius_m, z_m + height_m)
    )


def _meet(taken: tuple[WorldBox, ...], lying: tuple[WorldBox, ...], config: AssemblyConfig) -> bool:
    """Return True if boxes lifted straight up to safe height meet lying boxes."""
    lift = (0.0, 0.0, config.robot.safe_height_m)
    return any(sweep_hits(own, lift, other, _TOUCH_M) for own in taken for other in lying)


def _join_names(names: list[str]) -> str:
    shown = ", ".join(repr(name) for name in names[:4])
    return f"{shown} and {len(names) - 4} more" if len(names) > 4 else shown


def list_supports(config: AssemblyConfig) -> Overview:
    """Return the supports of every part, moved meshes and convex pieces, as text and JSON."""
    lines, entries = [], []
    for name, part in config.parts.items():
        start, goal = find_start_rests(config, name), find_goal_rests(config, name)
        before = f"in {part.feeder}" if part.feeder is not None else f"on {_format_rests(start)}"
        before += "" if part.arrives_s is None else f", arrives after {part.arrives_s:g} s"
        before = "fixed from the start" if part.fixed else f"at the start {before}"
        if part.made_of:
            before = f"put together of {', '.join(part.made_of)}, {part.mass_kg:.3g} kg"
        rests = f"on {_format_rests(goal)}"
        if not goal and find_workholder(config, name) is not None:
            rests = "on nothing before it is turned"
        elif not goal and any(name in holder.parts for holder in config.holders.values()):
            rests = "on nothing but its holder"
        lines.append(f"rests      {name} {rests}; {before}")
        entries.append({"part": name, "start": _build_rests(start), "goal": _build_rests(goal)})
    fixtures = []
    for name, fixture in config.fixtures.items():
        bottom_m = get_layout(config).fixture(name).box.low[2]
        lines.append(f"fixture    {name} {_locate_fixture(fixture, bottom_m)}")
        bottom_mm = round(bottom_m * 1e3, 3) + 0.0
        fixtures.append({"fixture": name, "stands_on": fixture.stands_on, "bottom_mm": bottom_mm})
    origins, meshes = list_moved_meshes(config)
    more, pieces = list_pieces(config)
    extra = {"fixtures": fixtures, "meshes": meshes, "pieces": pieces}
    document = {"rests": entries, **{key: values for key, values in extra.items() if values}}
    return Overview(document, (*lines, *origins, *more))


def list_holding(config: AssemblyConfig) -> Overview:
    """Return what workholders carry and holders hold, as text."""
    lines = []
    for name, workholder in config.workholders.items():
        own = f", with {', '.join(workholder.fixtures)}" if workholder.fixtures else ""
        lines.append(
            f"turns      {name} {', '.join(workholder.orientations)} in {workholder.takes_s:g} s, "
            f"carries {', '.join(list_carried(config, name))}{own}"
        )
    for name, holder in config.holders.items():
        verb = "closes on" if holder.kind == "clamp" else "waits for"
        where = "" if holder.turns else " in the first orientation"
        lines.append(f"holder     {name} {verb} {' or '.join(holder.parts)}{where}")
    return Overview({}, tuple(lines))


def list_screws(config: AssemblyConfig) -> Overview:
    """Return how the screws with a thread are driven, as text and JSON."""
    lines, entries = [], []
    for name, screw in config.screws.items():
        if not screw.diameter_m:
            continue
        driving = find_driving(config, name)
        into = f" into {' and '.join(screw.into_names)}" if screw.into else ""
        torque = "" if screw.torque_nm is None else f", {screw.torque_nm:g} N m"
        begin = f"screw      {name} {screw.describe()} through {screw.through}{into}{torque}"
        stands_in = [] if screw.shank is None else _list_feeder_bodies(config, name)
        if stands_in:
            where = "at its start" if screw.feeder is None else f"in {screw.feeder}"
            begin += f", {where} its shank is in {_join_names(stands_in)}"
        lines.append(f"{begin}, driven in {driving.takes_s:.1f} s: {driving.source}")
        deep_m = driving.engagement_m
        entries.append(
            {
                "screw": name,
                "designation": screw.describe(),
                "engagement_mm": None if deep_m is None else round(deep_m * 1e3, 3),
                "driving_s": round(driving.takes_s, 3),
                "source": driving.source,
            }
        )
    return Overview({"screws": entries} if entries else {}, tuple(lines))


def _list_feeder_bodies(config: AssemblyConfig, name: str) -> list[str]:
    """Return the bodies with a hole for the shank of a screw at its feeder."""
    shank, own = find_shank(config, name), config.screws[name].shank
    assert shank is not None
    assert own is not None
    return [body for body in shank.stands_in if body not in own.passes]


def _locate_fixture(fixture: FixtureConfig, bottom_m: float) -> str:
    """Return where a fixture is: on another, on the table, let into it, or in the air."""
    if fixture.stands_on is not None:
        return f"on {fixture.stands_on}"
    if abs(bottom_m) <= _TOUCH_M:
        return "on the table"
    words = "above the table" if bottom_m > 0 else "deep in the table"
    return f"{abs(bottom_m) * 1e3:.1f} mm {words}"


def _format_rests(rests: list[Rest]) -> str:
    words = ", ".join(f"{rest.on} ({rest.area_m2 * 1e6:,.1f} mm2)" for rest in rests)
    return words or "nothing but its fit"


def _build_rests(rests: list[Rest]) -> list[dict[str, Any]]:
    return [{"on": rest.on, "area_mm2": round(rest.area_m2 * 1e6, 3)} for rest in rests]


def list_choices(config: AssemblyConfig) -> Overview:
    """Return the insertions and grasps of parts, as text and JSON.

    Parts with one grasp and no given direction of insertion are left out.
    """
    lines, entries, tried = [], [], []
    for name, part in config.moved_parts.items():
        if part.grasp == "auto":
            kept, refused = describe_candidates(config, name)
            lines.append(f"grasp      {name} auto keeps {', '.join(kept)}")
            lines += [f"grasp      {name} auto refuses {words}" for words in refused]
            tried.append({"part": name, "kept": kept, "refused": refused})
        lines += _describe_holds(config, name)
        grasps = [grasp.name for grasp in list_grasps(config, name) if grasp.name]
        directions = () if part.insert_along is None else list_directions(config, name)
        if not grasps and not directions:
            continue
        stretches: list[dict[str, Any]] = []
        words = []
        for direction in directions:
            length_m = measure_insertion_m(config, name, direction)
            stretches.append({"along": list(direction), "insert_m": length_m})
            far = "" if length_m is None else f" over {1000 * length_m:,.1f} mm"
            words.append(f"along {name_direction(direction)}{far}")
        clauses = [f"goes in {' or '.join(words)}"] if words else []
        clauses += [f"is held at {' or '.join(grasps)}"] if grasps else []
        lines.append(f"ways       {name} {', '.join(clauses)}")
        entries.append({"part": name, "directions": stretches, "grasps": grasps})
    lines += _describe_alternatives(config)
    document = {"ways": entries, "automatic_grasps": tried}
    return Overview({key: rows for key, rows in document.items() if rows}, tuple(lines))


def _describe_alternatives(config: AssemblyConfig) -> Iterator[str]:
    """Yield a line for each choice of goals and tools that the search takes."""
    for name, part in config.moved_parts.items():
        members = list_interchangeable(config, name)
        if len(members) > 1 and members[0] == name:
            yield f"same       {name} to {members[-1]}: any of {len(members)} to any of their goals"
        if part.other_goals:
            yield f"choice     {name} has {1 + len(part.other_goals)} goals, of which one is taken"
    owners: dict[str, PartConfig | ScrewConfig] = {**config.moved_parts, **config.screws}
    for name, owner in owners.items():
        if owner.other_tools:
            yield f"choice     {name} by {' or '.join(owner.tools)}"
        if owner.optional:
            yield f"optional   {name} need not be done"
    for line in config.chart:
        if line.any_of:
            yield f"order      {' or '.join(line.any_of)} before {', '.join(line.after)}"


def _describe_holds(config: AssemblyConfig, name: str) -> list[str]:
    """Return a line for each grasp in a hole, with the measured width."""
    return [
        f"grasp      {name} {grasp.name or 'from inside'}: hole {grasp.width_m * 1e3:.1f} mm wide, "
        f"closed jaws {grasp.inside_m * 1e3:.1f} mm"
        for grasp in list_grasps(config, name)
        if grasp.is_inner
    ]
