"""Faults of an assembly's geometry, in the order of the checks: shapes, loads, grasps, places."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations, product
from statistics import fmean

from skillplan.collision.boxes import WorldBox, box_at
from skillplan.collision.solid import TOUCH_M, Solid
from skillplan.domains.assembly.gripping import choose_tool_kind, find_grasp_issues
from skillplan.domains.assembly.holding import trace_ray_m
from skillplan.domains.assembly.insertion import find_insertion_issues
from skillplan.domains.assembly.layout import LEAST_RIM, get_layout, list_rim
from skillplan.domains.assembly.part_meshes import build_origin_hint, find_piece_issues
from skillplan.domains.assembly.part_schema import PartConfig, Shaped
from skillplan.domains.assembly.resting import find_buffer_issues, find_resting_issues
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.domains.assembly.screw_holes import find_shank_issues
from skillplan.domains.assembly.screw_schema import ScrewConfig
from skillplan.domains.assembly.workholding import (
    list_goal_poses,
    list_insertion_orientations,
    turn_pose,
)
from skillplan.domains.assembly.works import find_work_issues, list_work_points
from skillplan.domains.assembly.zone_faults import find_zone_issues
from skillplan.errors import Issue
from skillplan.task.motion import AXES
from skillplan.task.pose import DOWN, Point, cross, dot, is_same_direction, plus, unit

_MAX_SHAPES = 1024
# More than twice the density of the densest chemical element [kg/m3].
_MOST_DENSITY_KG_M3 = 50_000.0
# Ring about the head of a screw that is still on its part, in its radii.
_FAR_RIM = 3.0
# Radii of the ring on which a head rests, in radii of its rim; the second is within the flats of a
# hexagon.
_BEARING = (1.0, 0.8)
# Least share of such a ring that bears a head on both sides of its axis, and most by which the
# middle of what bears it is off the axis, in radii of the head.
_LEAST_ON_BOTH_SIDES, _OFF_AXIS = 0.25, 0.2
# Start of a ray above the mouth of a hole [m].
_FAR_M = 0.002


def find_shape_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield shapes off their part's bottom, impossible masses and indivisible concave meshes."""
    owners: list[tuple[str, str, Shaped]] = [("parts", *item) for item in config.parts.items()]
    owners += [("fixtures", *item) for item in config.fixtures.items()]
    for section, name, body in owners:
        boxes = body.bounding_boxes
        bottom_m = min(box.centre[2] - box.size[2] / 2 for box in boxes)
        if abs(bottom_m) > TOUCH_M:
            lowest = "mesh" if body.meshes is not None else "box"
            message = (
                f"the lowest {lowest} begins at {bottom_m:.4f} m, not at the {section[:-1]}'s "
                "bottom, 0. Shift 'centre_m'."
            )
            yield Issue(message, (section, name, body.shape_key))
    for name, part in config.parts.items():
        boxes = part.bounding_boxes
        volume_m3 = sum(math.prod(box.size) for box in boxes)
        # The default mass is a guess and need not fit the shape.
        given = "mass_kg" in part.model_fields_set
        if given and part.mass_kg > _MOST_DENSITY_KG_M3 * volume_m3:
            message = (
                f"{part.mass_kg:g} kg in {volume_m3 * 1e6:.3g} cm3 at most is heavier than any "
                "metal. Is it in grams?"
            )
            yield Issue(message, ("parts", name, "mass_kg"))
    count = sum(len(body.boxes or body.meshes or (1,)) for _, _, body in owners)
    if count > _MAX_SHAPES:
        yield Issue(f"must have at most {_MAX_SHAPES} boxes in all.", ("parts",))
    yield from find_piece_issues(config)


def find_geometry_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield faults of loads, grasps and places of an assembly with sound names and shapes."""
    yield from _find_overloads(config)
    yield from find_grasp_issues(config)
    yield from find_work_issues(config)
    yield from find_insertion_issues(config)
    yield from _find_unreachable_places(config)
    yield from find_resting_issues(config)
    yield from find_buffer_issues(config)
    yield from find_zone_issues(config)
    yield from _find_far_fits(config)
    holes = list(_find_hole_issues(config))
    yield from holes or find_shank_issues(config)


def measure_distances_m(config: AssemblyConfig) -> dict[tuple[str, str, str], float]:
    """Return the distances of parts at the start from the places of other bodies [m].

    Distances are in plan, along x or y, the larger one; negative if the bodies overlap. Keys are
    the part, the other part or fixture, and ``start`` or ``goal`` of the other one; a fixture is
    where it starts.
    """
    layout = get_layout(config)
    starts, goals = (
        {
            name: _find_hull(box_at(box, place(name).pose) for box in part.bounding_boxes)
            for name, part in config.parts.items()
        }
        for place in (layout.start, layout.goal)
    )
    fixed = {
        name: _find_hull(box_at(box, layout.fixture(name).pose) for box in fixture.bounding_boxes)
        for name, fixture in config.fixtures.items()
    }
    lying = [name for name, part in config.parts.items() if part.feeder is None]
    pairs = {
        (a, b, "start"): _measure_distance_m(starts[a], starts[b])
        for a, b in combinations(lying, 2)
    }
    for a, b in product(lying, fixed):
        pairs[a, b, "start"] = _measure_distance_m(starts[a], fixed[b])
    for a, b in product(lying, goals):
        if a != b:
            pairs[a, b, "goal"] = _measure_distance_m(starts[a], goals[b])
    return pairs


def _find_overloads(config: AssemblyConfig) -> Iterator[Issue]:
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
    own_kg = dict(on_flange_kg)
    for name in config.tools:
        mates = [n for n in own_kg if config.find_carrier(n) == config.find_carrier(name)]
        on_flange_kg[name] = sum(own_kg[mate] for mate in mates)
    for name, kg in on_flange_kg.items():
        if kg > limit_kg:
            given = config.tools[name].mass_kg is not None
            words = f"{kg:g} kg is {most}" if given else f"the hand, {kg:g} kg, is {most}"
            yield Issue(words, ("tools", name, "mass_kg") if given else ("robot", "payload_kg"))
    for section, items in (("parts", config.moved_parts), ("screws", config.screws)):
        for name, item in items.items():
            for tool in item.tools:
                kg = on_flange_kg[tool]
                if item.mass_kg + kg > limit_kg >= kg:
                    words = f"{item.mass_kg:g} kg, with {kg:g} kg of {tool!r}, is {most}"
                    yield Issue(words, (section, name, "mass_kg"))


def _find_unreachable_places(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield places out of the arm's reach, at their own height or at the safe height above."""
    robot = config.robot
    safe_m, reach_m = robot.safe_height_m, robot.reaches_m
    base = (robot.base_m[0], robot.base_m[1], robot.base_m[2])
    places = [*_list_places(config)]
    above: list[tuple[tuple[str | int, ...], str, float]] = []
    for path, (x_m, y_m, z_m), lift_m, spare_m in places:
        distance_m, lifted_m = _measure_ways_m(config, (x_m, y_m, z_m), lift_m, spare_m)
        if distance_m > reach_m:
            yield Issue(f"out of reach: {_compare_m(distance_m, reach_m)}.", path)
        elif lifted_m > reach_m:
            across_m = math.hypot(x_m - base[0], y_m - base[1])
            highest_m = base[2] + math.sqrt(reach_m**2 - across_m**2) - lift_m
            above.append((path, _compare_m(lifted_m, reach_m), highest_m))
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


def _measure_ways_m(
    config: AssemblyConfig, point: Point, lift_m: float, spare_m: float
) -> tuple[float, float]:
    """Return the distances of a place from the base, at its own and at the safe height [m]."""
    x_m, y_m, z_m = point
    base, safe_m = config.robot.base_m, config.robot.safe_height_m
    heights_m = z_m + lift_m, max(safe_m, z_m) + lift_m
    distance_m, lifted_m = (math.dist(base, (x_m, y_m, at_m)) - spare_m for at_m in heights_m)
    return distance_m, lifted_m


def _compare_m(distance_m: float, reach_m: float) -> str:
    return f"{distance_m:.3f} m from the base, where {reach_m:.3f} m is the most"


def _list_places(
    config: AssemblyConfig,
) -> Iterator[tuple[tuple[str | int, ...], Point, float, float]]:
    """Yield each place that the arm goes to: key path, point, height of the arm's tip above it [m].

    The last number is the distance by which a tool may bring the arm's tip nearer to the base [m]:
    it is beyond the arm's tip, and in some direction. On a workholder it is the place in the best
    orientation.
    """

    def find_farther_m(place: tuple[Point, float, float]) -> float:
        return max(_measure_ways_m(config, *place))

    robot, layout = config.robot, get_layout(config)
    beyond_m = {}
    for name, tool in config.tools.items():
        kind = choose_tool_kind(config, name)
        mount = tool.find_mount(kind, robot.hand)
        beyond_m[name] = tool.measure_beyond_m(kind, robot.hand)
        if mount is not None:
            # In any direction, as the hand turns.
            beyond_m[name] = -math.hypot(*mount.position)
    most_m = max(map(abs, beyond_m.values()))
    # The arm is at home at the safe height only.
    yield ("robot", "home_m"), (robot.home_m[0], robot.home_m[1], robot.base_m[2]), 0.0, most_m
    if robot.look_m is not None:
        yield ("robot", "look_m"), robot.look, 0.0, most_m
    for name, workholder in config.workholders.items():
        if workholder.stand_m is not None:
            x_m, y_m = workholder.stand_m
            yield ("workholders", name, "stand_m"), (x_m, y_m, robot.base_m[2]), 0.0, most_m
    for name, tool in config.carriers.items():
        yield ("tools", name, "holder_m"), tool.holder, beyond_m[name], 0.0
    for name, feeder in config.feeders.items():
        yield ("feeders", name, "position_m"), feeder.position, 0.0, most_m
    for name, part in config.moved_parts.items():
        spare_m = abs(beyond_m[part.tool])
        if part.feeder is None:
            key = "start_m" if part.start_m is not None else "start_on"
            yield ("parts", name, key), *_measure_load(layout.start(name), part, spare_m)
        goal = layout.goal(name)
        turned = [replace(goal, pose=pose) for pose in list_goal_poses(config, name, goal.pose)]
        loads = [_measure_load(solid, part, spare_m) for solid in turned]
        yield ("parts", name, "goal_m"), *min(loads, key=find_farther_m)
        for buffer in part.buffers or ():
            solid = layout.buffered(name, buffer)
            yield ("buffers", buffer, "at_m"), *_measure_load(solid, part, spare_m)
    for name, screw in config.screws.items():
        spare_m = abs(beyond_m[screw.tool])
        hole = layout.hole_pose(screw)
        turns = list_insertion_orientations(config, name)
        holes = [(turn_pose(hole, turn.motion).position, 0.0, spare_m) for turn in turns]
        yield ("screws", name, "hole_m"), *min(holes, key=find_farther_m)
        if screw.start_m is not None and (place := layout.fetch(screw)) is not None:
            yield ("screws", name, "start_m"), place, 0.0, spare_m
    for path, point in _list_work_places(config):
        name = config.works[str(path[1])].tool
        is_mounted = config.tools[name].mounted_on is not None
        lift_m, spare_m = (0.0, beyond_m[name]) if is_mounted else (beyond_m[name], 0.0)
        yield path, point, lift_m, abs(spare_m)


def _list_work_places(config: AssemblyConfig) -> Iterator[tuple[tuple[str | int, ...], Point]]:
    """Yield the points of works on known parts."""
    for name, work in config.works.items():
        if work.part in config.parts and work.tool in config.tools:
            for point in list_work_points(config, name):
                yield ("works", name, "at_m" if work.path_m is None else "path_m"), point


def _measure_load(solid: Solid, part: PartConfig, spare_m: float) -> tuple[Point, float, float]:
    """Return the bottom of a part, its height [m], and `spare_m`."""
    if solid.pose.is_upright:
        return solid.pose.position, part.height_m, spare_m
    x_m, y_m, _ = solid.pose.position
    low_m, high_m = solid.box.low[2], solid.box.high[2]
    return (x_m, y_m, low_m), high_m - low_m, spare_m


def _find_hole_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield holes that are not at the surface of their part, oblique ones first."""
    oblique = [item for item in config.screws.items() if not _is_vertical(item[1])]
    vertical = [item for item in config.screws.items() if _is_vertical(item[1])]
    for name, screw in (*oblique, *vertical):
        is_oblique = not _is_vertical(screw)
        rise_m = (_measure_oblique if is_oblique else _measure_upright)(config, screw)
        # The hole may not be modelled.
        if abs(rise_m(0.0, 0.0)) <= TOUCH_M or _bears_head(screw, rise_m):
            continue
        head = f"the head of {name!r}, {screw.head_diameter_m * 1e3:.1f} mm wide,"
        if _bears_head(screw, rise_m, _BEARING[1:]):
            message = (
                f"{head} runs into {screw.through!r} next to its seat. Give a narrower head, or "
                "move the hole."
            )
        elif is_oblique:
            message = (
                f"the hole does not lie on a surface of {screw.through!r} that its axis goes into. "
                f"Move it.{build_origin_hint(config, (screw.through,))}"
            )
        elif _falls_in(config, screw):
            message = (
                f"{head} falls into the hole in {screw.through!r}. Give 'size', or a wider head."
            )
        else:
            message = f"the hole does not lie over the top of {screw.through!r}. Move it"
            if "axis" not in screw.model_fields_set:
                message += ", or give 'axis' if the screw does not go straight down"
            message += f".{build_origin_hint(config, (screw.through,))}"
        yield Issue(message, ("screws", name, "hole_m"))


def _is_vertical(screw: ScrewConfig) -> bool:
    return is_same_direction(screw.direction, DOWN)


def _measure_upright(config: AssemblyConfig, screw: ScrewConfig) -> Callable[[float, float], float]:
    """Return the height of a part's top above the seat of an upright screw, as a function."""
    layout = get_layout(config)
    through, (x_m, y_m, z_m) = layout.goal(screw.through), layout.hole(screw)

    def rise_m(dx_m: float, dy_m: float) -> float:
        top_m = through.top_m(x_m + dx_m, y_m + dy_m)
        return -math.inf if top_m is None else top_m - z_m

    return rise_m


def _falls_in(config: AssemblyConfig, screw: ScrewConfig) -> bool:
    """Return True if a hole in a part is wider than the head, all round."""
    layout = get_layout(config)
    through, (x_m, y_m, z_m) = layout.goal(screw.through), layout.hole(screw)

    def is_open(share: float) -> bool:
        rim = [(x_m + share * dx_m, y_m + share * dy_m) for dx_m, dy_m in list_rim(screw)]
        tops_m = [through.top_m(*point) for point in rim]
        return all(top_m is None or top_m < z_m - TOUCH_M for top_m in tops_m)

    return is_open(1.0) and not is_open(_FAR_RIM)


def _bears_head(
    screw: ScrewConfig, rise_m: Callable[[float, float], float], shares: Sequence[float] = _BEARING
) -> bool:
    """Return True if a head rests on the part, and its rim nowhere enters it.

    It rests on its rim, or on a ring within, of a boss that is narrower. A slot, or seams of convex
    pieces, may be beneath a sixth of the ring. More may be free alike on both sides of the axis, as
    on a narrow flange or a round bar.

    Parameters
    ----------
    rise_m
        Function that returns the height of the part's surface above the seat, by the place from the
        axis [m].
    shares
        Radii of the rings, in radii of the rim.
    """
    rim = list_rim(screw)
    for share in shares:
        rises_m = [rise_m(share * x_m, share * y_m) for x_m, y_m in rim]
        if max(rises_m) > TOUCH_M:
            return False
        touched = [at for at, rise in zip(rim, rises_m, strict=True) if abs(rise) <= TOUCH_M]
        if len(touched) >= LEAST_RIM * len(rim):
            return True
        if len(touched) >= _LEAST_ON_BOTH_SIDES * len(rim):
            x_m, y_m = (fmean(values) for values in zip(*touched, strict=True))
            if math.hypot(x_m, y_m) <= _OFF_AXIS * screw.head_diameter_m / 2:
                return True
    return False


def _measure_oblique(config: AssemblyConfig, screw: ScrewConfig) -> Callable[[float, float], float]:
    """Return the height of a part's surface above the seat of an oblique screw, as a function."""
    to_part = get_layout(config).goal(screw.through).pose.inverse()
    into, mouth = to_part.rotate(screw.direction), to_part.apply(get_layout(config).hole(screw))
    shapes = config.parts[screw.through].shapes
    level = min(AXES.values(), key=lambda axis: abs(dot(axis, into)))
    across = unit(cross(into, level))
    other = cross(into, across)

    def rise_m(x_m: float, y_m: float) -> float:
        place = plus(plus(mouth, across, x_m), other, y_m)
        met_m = trace_ray_m(shapes, plus(place, into, -_FAR_M), into)
        return -math.inf if met_m is None else _FAR_M - met_m

    return rise_m


# Gap of two parts beyond their clearance at which a fit acts on nothing [m].
_FAR_FIT_M = 5e-4


def _find_far_fits(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield fits in parts and screws that are elsewhere at the end."""
    layout = get_layout(config)
    for name, part in config.parts.items():
        own = layout.goal(name).box if part.fits else None
        for other, fit in (part.fits or {}).items():
            if own is None or fit.kind is None or other not in config.parts:
                continue
            box = layout.goal(other).box
            gaps_m = [
                max(low - top, bottom - high)
                for low, high, bottom, top in zip(own.low, own.high, box.low, box.high, strict=True)
            ]
            if max(gaps_m) > max(fit.drawn_m, 0.0) + _FAR_FIT_M:
                message = (
                    f"is {max(gaps_m) * 1e3:.1f} mm from {name!r} at its goal, so the fit acts on "
                    "nothing. Name the part that it goes in, or leave it out."
                )
                yield Issue(message, ("parts", name, "fits", other))


def _measure_distance_m(box: WorldBox, other: WorldBox) -> float:
    return max(
        max(box.low[axis] - other.high[axis], other.low[axis] - box.high[axis]) for axis in (0, 1)
    )


def _find_hull(boxes: Iterable[WorldBox]) -> WorldBox:
    lows, highs = zip(*((box.low, box.high) for box in boxes), strict=True)
    low = tuple(min(values) for values in zip(*lows, strict=True))
    high = tuple(max(values) for values in zip(*highs, strict=True))
    return WorldBox((low[0], low[1], low[2]), (high[0], high[1], high[2]))
