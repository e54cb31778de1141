"""Faults of an assembly's geometry: shapes off their bottom, overlaps, what is out of reach."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from itertools import combinations, product

from skillplan.collision.boxes import WorldBox, box_at
from skillplan.collision.solid import TOUCH_M, Solid
from skillplan.domains.assembly.holding import surface_m
from skillplan.domains.assembly.layout import (
    boxes_of,
    feeder_of,
    goal_pose,
    goal_solid,
    height_of,
    holder_of,
    hole_of,
    look_of,
    shapes_of,
    start_pose,
    start_solid,
)
from skillplan.domains.assembly.part_meshes import origin_hint
from skillplan.domains.assembly.part_schema import PartConfig, ScrewConfig
from skillplan.domains.assembly.resting import resting_issues
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.domains.assembly.schema_types import unit_of
from skillplan.errors import Issue
from skillplan.task.motion import AXES
from skillplan.task.pose import DOWN, Point, Pose, cross, dot, plus, same_direction, unit

# Points under the rim of a head, and how far out they are of its radius.
_RIM_POINTS = 12
_RIM_SHARE = 0.96
# From so far off a line is drawn along the axis [m].
_FAR_M = 0.002


def is_askew(screw: ScrewConfig) -> bool:
    """Whether a screw goes into its hole in another direction than straight down."""
    return not same_direction(unit_of(screw.axis), DOWN)


def rests_upright(screw: ScrewConfig, through: Solid, mouth: Point) -> bool:
    """Return whether the head of an upright screw rests on its part at the mouth of the hole.

    On the axis, where the part is drawn without a hole, else all round under the head's rim.

    Parameters
    ----------
    screw
        The screw.
    through
        The part at its goal.
    mouth
        Of the hole, in the world [m].
    """

    def lies(x_m: float, y_m: float) -> bool:
        top_m = through.top_m(x_m, y_m)
        return top_m is not None and abs(top_m - mouth[2]) <= TOUCH_M

    return lies(mouth[0], mouth[1]) or all(
        lies(mouth[0] + x_m, mouth[1] + y_m) for x_m, y_m in _rim(screw)
    )


def _rests_askew(config: AssemblyConfig, screw: ScrewConfig, pose: Pose) -> bool:
    """Return whether a head rests on its part, given the pose that leads into the part's frame."""
    into = pose.rotate(unit_of(screw.axis))
    mouth = pose.apply(hole_of(config, screw))
    shapes = shapes_of(config.parts[screw.through])

    def lies(point: Point) -> bool:
        met_m = surface_m(shapes, plus(point, into, -_FAR_M), into)
        return met_m is not None and abs(met_m - _FAR_M) <= TOUCH_M

    level = min(AXES.values(), key=lambda axis: abs(dot(axis, into)))
    one = unit(cross(into, level))
    other = cross(into, one)
    return lies(mouth) or all(
        lies(plus(plus(mouth, one, x_m), other, y_m)) for x_m, y_m in _rim(screw)
    )


def _rim(screw: ScrewConfig) -> list[tuple[float, float]]:
    """Return points under the rim of a head, from its axis on [m]."""
    radius_m = _RIM_SHARE * screw.head_diameter_m / 2
    turns = (2 * math.pi * number / _RIM_POINTS for number in range(_RIM_POINTS))
    return [(radius_m * math.cos(turn), radius_m * math.sin(turn)) for turn in turns]


def hole_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield holes that are not at the surface of the part that they go through."""
    for name, screw in config.screws.items():
        if not is_askew(screw):
            continue
        pose = goal_pose(config, screw.through).inverse()
        if not _rests_askew(config, screw, pose):
            message = (
                f"the hole does not lie on a surface of {screw.through!r} that its axis goes into. "
                f"Move it.{origin_hint(config, (screw.through,))}"
            )
            yield Issue(message, ("screws", name, "hole_m"))


_MAX_SHAPES = 1024
# More than twice the density of the densest chemical element [kg/m3].
_MOST_DENSITY_KG_M3 = 50_000.0


def shape_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield shapes that do not begin at their part's bottom, and masses that cannot be."""
    for name, part in config.parts.items():
        boxes = boxes_of(part)
        bottom_m = min(box.centre[2] - box.size[2] / 2 for box in boxes)
        if abs(bottom_m) > TOUCH_M:
            lowest = "mesh" if part.meshes is not None else "box"
            message = (
                f"the lowest {lowest} begins at {bottom_m:.4f} m, not at the part's bottom, 0. "
                "Shift 'centre_m'."
            )
            yield Issue(message, ("parts", name, part.shape_key))
        volume_m3 = sum(math.prod(box.size) for box in boxes)
        # What is left out is a guess, to which no shape has to answer.
        given = "mass_kg" in part.model_fields_set
        if given and part.mass_kg > _MOST_DENSITY_KG_M3 * volume_m3:
            message = (
                f"{part.mass_kg:g} kg in {volume_m3 * 1e6:.3g} cm3 at most is heavier than any "
                "metal. Is it in grams?"
            )
            yield Issue(message, ("parts", name, "mass_kg"))
    count = sum(len(part.boxes or part.meshes or (1,)) for part in config.parts.values())
    if count > _MAX_SHAPES:
        yield Issue(f"must have at most {_MAX_SHAPES} boxes in all.", ("parts",))


def payload_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield tools, parts and screws that are heavier than the arm carries."""
    robot = config.robot
    limit_kg = robot.arm.payload_kg if robot.payload_kg is None else robot.payload_kg
    if limit_kg is None:
        return
    source = f"payload of {robot.model}" if robot.payload_kg is None else "robot.payload_kg"
    most = f"more than the arm carries, {limit_kg:g} kg ({source})."
    on_flange_kg = {
        name: robot.hand.mass_kg if tool.mass_kg is None else tool.mass_kg
        for name, tool in config.tools.items()
    }
    for name, kg in on_flange_kg.items():
        if kg > limit_kg:
            given = config.tools[name].mass_kg is not None
            words = f"{kg:g} kg is {most}" if given else f"the hand, {kg:g} kg, is {most}"
            yield Issue(words, ("tools", name, "mass_kg") if given else ("robot", "payload_kg"))
    for section, items in (("parts", config.parts), ("screws", config.screws)):
        for name, item in items.items():
            kg = on_flange_kg[item.tool]
            if item.mass_kg + kg > limit_kg >= kg:
                words = f"{item.mass_kg:g} kg, with {kg:g} kg of {item.tool!r}, is {most}"
                yield Issue(words, (section, name, "mass_kg"))


def geometry_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield what is out of reach, overlaps, or hangs in the air, of parts that exist."""
    yield from _out_of_reach(config)
    yield from resting_issues(config)
    yield from hole_issues(config)
    for name, screw in config.screws.items():
        if is_askew(screw):
            continue
        through = goal_solid(config, screw.through)
        if not rests_upright(screw, through, hole_of(config, screw)):
            message = f"the hole does not lie over the top of {screw.through!r}. Move it"
            if "axis" not in screw.model_fields_set:
                message += ", or give 'axis' if the screw does not go straight down"
            message += f".{origin_hint(config, (screw.through,))}"
            yield Issue(message, ("screws", name, "hole_m"))


def distances_m(config: AssemblyConfig) -> dict[tuple[str, str, str], float]:
    """Return how far every lying part is at the start from where others lie and belong [m].

    In plan, along x or y, whichever is more; negative where they overlap. By the part, the
    other, and ``start`` or ``goal`` for where that is.
    """
    starts, goals = (
        {
            name: _hull(box_at(box, pose_of(config, name)) for box in boxes_of(part))
            for name, part in config.parts.items()
        }
        for pose_of in (start_pose, goal_pose)
    )
    lying = [name for name, part in config.parts.items() if part.feeder is None]
    between = {(a, b, "start"): _apart_m(starts[a], starts[b]) for a, b in combinations(lying, 2)}
    for a, b in product(lying, goals):
        if a != b:
            between[a, b, "goal"] = _apart_m(starts[a], goals[b])
    return between


def _apart_m(one: WorldBox, other: WorldBox) -> float:
    return max(
        max(one.low[axis] - other.high[axis], other.low[axis] - one.high[axis]) for axis in (0, 1)
    )


def _out_of_reach(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield places out of the arm's reach, at their own height or at the safe height above."""
    robot = config.robot
    safe_m, reach_m = robot.safe_height_m, robot.reaches_m
    base = (robot.base_m[0], robot.base_m[1], robot.base_m[2])
    places = [*_places(config)]
    above: list[tuple[tuple[str | int, ...], str, float]] = []
    for path, (x_m, y_m, z_m), lift_m in places:
        apart_m = math.dist(base, (x_m, y_m, z_m + lift_m))
        lifted_m = math.dist(base, (x_m, y_m, max(safe_m, z_m) + lift_m))
        if apart_m > reach_m:
            yield Issue(f"out of reach: {_too_far(apart_m, reach_m)}.", path)
        elif lifted_m > reach_m:
            across_m = math.hypot(x_m - base[0], y_m - base[1])
            highest_m = base[2] + math.sqrt(reach_m**2 - across_m**2) - lift_m
            above.append((path, _too_far(lifted_m, reach_m), highest_m))
    if 2 * len(above) > len(places):
        (path, words, _), highest_m = above[0], min(limit_m for *_, limit_m in above)
        where = ".".join(map(str, path))
        remedy = f" At {math.floor(highest_m * 1e3) / 1e3:g} m or less all are within reach."
        yield Issue(
            f"{safe_m:g} m is too high: {len(above)} of {len(places)} places are out of reach "
            f"there, such as {where}, {words}.{remedy if highest_m > 0 else ''}",
            ("robot", "safe_height_m"),
        )
        return
    for path, words, _ in above:
        yield Issue(f"out of reach at robot.safe_height_m, {safe_m:g} m: {words}.", path)


def _too_far(apart_m: float, reach_m: float) -> str:
    return f"{apart_m:.3f} m from the base, where {reach_m:.3f} m is the most"


def _places(config: AssemblyConfig) -> Iterator[tuple[tuple[str | int, ...], Point, float]]:
    """Yield each place that the arm goes to: its key, the point, and the height of the load [m]."""
    robot = config.robot
    # The arm is at home at the safe height only.
    yield ("robot", "home_m"), (robot.home_m[0], robot.home_m[1], robot.base_m[2]), 0.0
    if robot.look_m is not None:
        yield ("robot", "look_m"), look_of(config), 0.0
    for tool in config.tools:
        yield ("tools", tool, "holder_m"), holder_of(config, tool), 0.0
    for feeder in config.feeders:
        yield ("feeders", feeder, "position_m"), feeder_of(config, feeder), 0.0
    for name, part in config.parts.items():
        if part.feeder is None:
            key = "start_m" if part.start_m is not None else "start_on"
            yield ("parts", name, key), *_lifted(start_solid(config, name), part)
        yield ("parts", name, "goal_m"), *_lifted(goal_solid(config, name), part)
    for name, screw in config.screws.items():
        yield ("screws", name, "hole_m"), hole_of(config, screw), 0.0


def _lifted(solid: Solid, part: PartConfig) -> tuple[Point, float]:
    """Return where the bottom of a part is, and how high it is [m]."""
    if solid.pose.is_upright:
        return solid.pose.position, height_of(part)
    x_m, y_m, _ = solid.pose.position
    low_m, high_m = solid.box.low[2], solid.box.high[2]
    return (x_m, y_m, low_m), high_m - low_m


def _hull(boxes: Iterable[WorldBox]) -> WorldBox:
    lows, highs = zip(*((box.low, box.high) for box in boxes), strict=True)
    low = tuple(min(values) for values in zip(*lows, strict=True))
    high = tuple(max(values) for values in zip(*highs, strict=True))
    return WorldBox((low[0], low[1], low[2]), (high[0], high[1], high[2]))
