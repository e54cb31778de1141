"""Zones of an assembly: places in keep-out zones, zones without effect, and their list."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from skillplan.collision.solid import Solid
from skillplan.domains.assembly.gripping import list_grasps
from skillplan.domains.assembly.layout import get_layout
from skillplan.domains.assembly.schema import AssemblyConfig, choose_variant
from skillplan.domains.assembly.screw_schema import ScrewConfig
from skillplan.domains.assembly.workholding import (
    list_goal_poses,
    list_insertion_orientations,
    turn_pose,
)
from skillplan.domains.assembly.works import list_work_points
from skillplan.domains.assembly.zone_schema import ZoneConfig
from skillplan.domains.domain import Overview
from skillplan.errors import Issue
from skillplan.task.pose import DOWN, Point, Pose, is_same_direction
from skillplan.task.zone import CEILING_M, Zone

# Overlap of a load with a zone that counts as touching [m].
_TOUCH_M = 2e-4

_Path = tuple[str | int, ...]


def find_zone_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield places in keep-out zones, which no motion can reach.

    A goal of a part with several is none, unless all of them are closed.
    """
    closed = {("parts", name, "goal_m") for name, label in list_closed_goals(config) if not label}
    yield from (issue for issue in _find_issues(config) if issue.path not in closed)


def list_closed_goals(config: AssemblyConfig) -> dict[tuple[str, str], str]:
    """Return the goals in keep-out zones of parts that have another goal, with the reason.

    Keys are the part and the suffix of the skill, such as ``@2``.
    """
    closed: dict[tuple[str, str], str] = {}
    for name, part in config.moved_parts.items() if config.zones else ():
        labels = ["", *(f"@{number + 2}" for number in range(len(part.other_goals or ())))]
        reasons = {}
        for label in labels if len(labels) > 1 else ():
            for issue in _find_issues(choose_variant(config, name, label)):
                if issue.path == ("parts", name, "goal_m"):
                    reasons[name, label] = issue.message
        if len(reasons) < len(labels):
            closed |= reasons
    return closed


def _find_issues(config: AssemblyConfig) -> Iterator[Issue]:
    zones = [zone.build(name) for name, zone in config.zones.items()]
    for zone in zones:
        if "arm" in zone.keeps_out:
            yield from _find_closed_places(config, zone)
    for path, words, loads in _list_loads(config) if zones else ():
        for zone in zones:
            if "load" in zone.keeps_out and all(_holds_load(zone, load) for load in loads):
                message = (
                    f"{words} is in {zone.label}, which keeps the load out "
                    f"({_format_range(zone)}). Move one of them."
                )
                yield Issue(message, path)


def _find_closed_places(config: AssemblyConfig, zone: Zone) -> Iterator[Issue]:
    """Yield places of base, tip and hand in a zone that keeps the arm out."""
    for path, words, points in _list_arm_places(config):
        if all(zone.holds(point) for point in points):
            x_m, y_m, z_m = points[0]
            message = (
                f"{words}, at ({x_m:.3f}, {y_m:.3f}, {z_m:.3f}) m, is in {zone.label}, which "
                f"keeps the arm out ({_format_range(zone)}). Move one of them."
            )
            yield Issue(message, path)


def _list_arm_places(config: AssemblyConfig) -> Iterator[tuple[_Path, str, list[Point]]]:
    """Yield key path, name and points [m] of each place that base or tip must be at.

    Of several points, as for several grasps and orientations, one is enough.
    """
    robot, layout = config.robot, get_layout(config)
    x_m, y_m, z_m = robot.base_m
    yield ("robot", "base_m"), "the base of the arm", [(x_m, y_m, z_m + _TOUCH_M)]
    home = (robot.home_m[0], robot.home_m[1], robot.safe_height_m)
    yield ("robot", "home_m"), "home", [home]
    if robot.look_m is not None:
        yield ("robot", "look_m"), "the place to look from", [robot.look]
    for name, tool in config.carriers.items():
        yield ("tools", name, "holder_m"), f"the holder of {name!r}", [_lift(tool.holder)]
    for name, feeder in config.feeders.items():
        yield ("feeders", name, "position_m"), f"feeder {name!r}", [_lift(feeder.position)]
    for name, part in config.moved_parts.items():
        tips = [grasp.tip for grasp in list_grasps(config, name)]
        if part.feeder is None:
            key = "start_m" if part.start_m is not None else "start_on"
            start = layout.start(name).pose
            yield ("parts", name, key), f"the grasp of {name!r}", [*map(start.apply, tips)]
        goals = list_goal_poses(config, name, layout.goal(name).pose)
        words = f"the grasp of {name!r} at its goal"
        points = [goal.apply(tip) for goal in goals for tip in tips]
        yield ("parts", name, "goal_m"), words, points
        for buffer in part.buffers or ():
            pose = layout.buffered(name, buffer).pose
            words = f"the grasp of {name!r} in {buffer!r}"
            yield ("buffers", buffer, "at_m"), words, [*map(pose.apply, tips)]
    for name, screw in config.screws.items():
        holes = [
            turn_pose(layout.hole_pose(screw), turn.motion).position
            for turn in list_insertion_orientations(config, name)
        ]
        yield ("screws", name, "hole_m"), f"the hole of {name!r}", [*map(_lift, holes)]
        if screw.start_m is not None and (place := layout.fetch(screw)) is not None:
            yield ("screws", name, "start_m"), f"the start of {name!r}", [_lift(place)]
    for name, work in config.works.items():
        if work.part in config.parts and work.tool in config.tools:
            for point in list_work_points(config, name):
                key = "at_m" if work.path_m is None else "path_m"
                yield ("works", name, key), f"{name!r}", [_lift(point)]


def _lift(point: Point) -> Point:
    """Return a point just above a place, because a zone may begin at the table."""
    return (point[0], point[1], point[2] + _TOUCH_M)


_Load = list[tuple[list[tuple[float, ...]], float, float]]


def _list_loads(config: AssemblyConfig) -> Iterator[tuple[_Path, str, list[_Load]]]:
    """Yield key path, name and prisms of each part at its start and goal, and of each head.

    Prisms are listed for each orientation, of which one is enough. A prism is its outline from
    above, and the heights of bottom and top [m]. Slanted shapes are left out: the exact check is
    that of the motion.
    """
    layout = get_layout(config)
    for name, part in config.moved_parts.items():
        start_key = "start_on" if part.start_m is None else "start_m"
        start_key = start_key if part.feeder is None else "feeder"
        goal = layout.goal(name)
        goals = [replace(goal, pose=pose) for pose in list_goal_poses(config, name, goal.pose)]
        places: list[tuple[_Path, str, list[Solid]]] = [
            (("parts", name, start_key), f"the start of {name!r}", [layout.start(name)]),
            (("parts", name, "goal_m"), f"the goal of {name!r}", goals),
        ]
        for buffer in part.buffers or ():
            here: _Path = ("buffers", buffer, "at_m")
            places.append((here, f"{name!r} in {buffer!r}", [layout.buffered(name, buffer)]))
        for path, words, solids in places:
            yield path, words, [_list_prisms(solid) for solid in solids]
    for name, screw in config.screws.items():
        hole = layout.hole_pose(screw)
        turns = list_insertion_orientations(config, name)
        heads = [_list_head(screw, turn_pose(hole, turn.motion), turn.motion) for turn in turns]
        yield ("screws", name, "hole_m"), f"the head of {name!r}", heads


def _list_prisms(solid: Solid) -> _Load:
    prisms = [piece.prism for piece in solid.pieces if piece.prism is not None]
    return [(list(prism.face), prism.low_m, prism.high_m) for prism in prisms]


def _list_head(screw: ScrewConfig, hole: Pose, motion: Pose | None) -> _Load:
    into = screw.direction if motion is None else motion.rotate(screw.direction)
    if not is_same_direction(into, DOWN):
        return []
    x_m, y_m, z_m = hole.position
    radius_m = screw.head_diameter_m / 2
    rim: list[tuple[float, ...]] = [
        (x_m + radius_m * math.cos(angle), y_m + radius_m * math.sin(angle))
        for angle in (math.pi * step / 8 for step in range(16))
    ]
    return [(rim, z_m, z_m + screw.head_height_m)]


def _holds_load(zone: Zone, load: _Load) -> bool:
    return any(zone.meets(outline, low_m, high_m, _TOUCH_M) for outline, low_m, high_m in load)


def find_zone_hints(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield zones that cannot have an effect."""
    robot = config.robot
    import shapely

    base = shapely.Point(robot.base_m[:2])
    for name, entry in config.zones.items():
        zone = entry.build(name)
        away_m = zone.polygon.distance(base)
        if math.hypot(away_m, max(0.0, zone.low_m - robot.base_m[2])) > robot.reaches_m:
            message = (
                f"has no effect: it is {away_m:.3f} m from the base, and the arm reaches "
                f"{robot.reaches_m:.3f} m. Move it, or leave it out."
            )
            yield Issue(message, ("zones", name), at_key=True)
        elif zone.high_m <= 0:
            message = (
                f"has no effect: its top, {zone.high_m:g} m, is not above the table. Give "
                "height_m, bottom and top."
            )
            yield Issue(message, ("zones", name, "height_m"))
        elif zone.speed_m_per_s is not None and config.cost == "distance":
            message = (
                "costs time, and the objective is the distance. Give 'cost: time' if it is to "
                "count."
            )
            yield Issue(message, ("zones", name, "speed_m_per_s"))


def list_zones(config: AssemblyConfig) -> Overview:
    """Return the zones with their effects and heights, as text and JSON."""
    zones = [_describe_zone(*item) for item in config.zones.items()]
    documents = [document for _, document in zones]
    return Overview({"zones": documents} if zones else {}, tuple(line for line, _ in zones))


def _describe_zone(name: str, entry: ZoneConfig) -> tuple[str, dict[str, Any]]:
    """Return a zone as a line and as JSON values."""
    zone = entry.build(name)
    document = {
        "zone": name,
        "keeps_out": list(zone.keeps_out),
        "speed_m_per_s": zone.speed_m_per_s,
        "low_m": zone.low_m,
        "high_m": None if _is_open(zone) else zone.high_m,
        "area_m2": round(float(zone.polygon.area), 6),
    }
    return f"zone       {name} {_describe_effect(zone)}, {_format_range(zone)}", document


def _describe_effect(zone: Zone) -> str:
    words = []
    if zone.keeps_out:
        movers = {"arm": "the arm", "load": "the load"}
        words.append(f"keeps out {' and '.join(movers[mover] for mover in zone.keeps_out)}")
    if zone.speed_m_per_s is not None:
        words.append(f"slows the tip to {zone.speed_m_per_s:g} m/s")
    return " and ".join(words)


def _is_open(zone: Zone) -> bool:
    return zone.high_m >= CEILING_M


def _format_range(zone: Zone) -> str:
    if not _is_open(zone):
        return f"{zone.low_m:g} to {zone.high_m:g} m high"
    return f"from {zone.low_m:g} m up" if zone.low_m else "from the table up"
