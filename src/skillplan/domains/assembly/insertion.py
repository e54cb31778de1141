"""Visits of picks and places: directions and lengths of insertion, with each grasp."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from skillplan.domains.assembly.gripping import list_grasps
from skillplan.domains.assembly.holding import name_direction
from skillplan.domains.assembly.layout import get_layout
from skillplan.domains.assembly.part_schema import PartConfig
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.domains.assembly.schema_types import find_dwell_s, make_unit
from skillplan.domains.assembly.workholding import turn_visit
from skillplan.errors import Issue
from skillplan.task.motion import AXES, Event, Grasp, Visit
from skillplan.task.pose import DOWN, Point, Pose, cross, dot, is_same_direction, unit

# Overlap that still counts as touching: coordinates of a file are rounded [m].
_TOUCH_M = 2e-4
# Clearance between a part and its neighbours where the insertion begins [m].
_CLEARANCE_M = 0.005
# Length of an insertion into nothing [m].
_LEAST_M = 0.01


def list_directions(config: AssemblyConfig, name: str) -> tuple[Point, ...]:
    """Return the directions in the world in which a part may go in; straight down by default."""
    part = config.parts[name]
    given = _list_given_directions(part)
    if part.frame == "goal":
        goal = get_layout(config).goal(name).pose
        return tuple(unit(goal.rotate(vector)) for vector in given)
    return given


def find_insertion_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield directions that are listed twice."""
    for name, part in config.parts.items():
        directions = _list_given_directions(part)
        for index, direction in enumerate(directions):
            earlier = next(
                i for i, other in enumerate(directions) if is_same_direction(other, direction)
            )
            if earlier != index:
                message = f"is the direction of entry {earlier}. Leave one out."
                yield Issue(message, ("parts", name, "insert_along", index))


def list_pick_visits(config: AssemblyConfig, name: str) -> list[tuple[str, Visit]]:
    """Return a visit with its label for each grasp of a part at the start."""
    pose = get_layout(config).start(name).pose
    part = config.parts[name]
    takes_s = find_dwell_s("pick", config.durations_s, part, config.tools[part.tool])
    return [
        (_label(None, grasp), Visit(pose, Event.GRASP, name, _get_named(grasp), dwell_s=takes_s))
        for grasp in list_grasps(config, name)
    ]


def list_buffer_visits(
    config: AssemblyConfig, name: str, buffer: str | None, event: Event
) -> list[Visit]:
    """Return the visits of a part in a buffer, or at its start, one for each grasp."""
    layout, part = get_layout(config), config.parts[name]
    solid = layout.start(name) if buffer is None else layout.buffered(name, buffer)
    kind = "pick" if event is Event.GRASP else "place"
    takes_s = find_dwell_s(kind, config.durations_s, part, config.tools[part.tool])
    return [
        Visit(solid.pose, event, name, _get_named(grasp), dwell_s=takes_s, at_goal=False)
        for grasp in list_grasps(config, name)
    ]


def list_place_visits(config: AssemblyConfig, name: str) -> list[tuple[str, Visit]]:
    """Return a visit with its label for each grasp and direction of a part at its goal."""
    pose = get_layout(config).goal(name).pose
    directions = list_directions(config, name)
    part = config.parts[name]
    takes_s = find_dwell_s("place", config.durations_s, part, config.tools[part.tool])
    takes_s += max((fit.wait_s or 0.0 for fit in (part.fits or {}).values()), default=0.0)
    visits = []
    for grasp in list_grasps(config, name):
        for direction in directions:
            label = _label(direction if len(directions) > 1 else None, grasp)
            length_m = measure_insertion_m(config, name, direction)
            visit = Visit(
                pose, Event.RELEASE, name, _get_named(grasp), direction, length_m, takes_s
            )
            visits.append((label, visit))
    return visits


def measure_insertion_m(config: AssemblyConfig, name: str, direction: Point) -> float | None:
    """Return the length of an insertion [m].

    It is as given, or the length to clear every part at its goal, and every fixture, that the part
    goes into, plus 5 mm. None for a part that comes straight down from above everything.
    """
    given_m = config.parts[name].insert_m
    if given_m is not None or is_same_direction(direction, DOWN):
        return given_m
    return _measure_clearing_m(config, name, direction)


def turn_place_visit(config: AssemblyConfig, visit: Visit, motion: Pose | None) -> Visit:
    """Return the visit of a place after a motion of the product from its first orientation."""
    turned = turn_visit(visit, motion)
    if turned.insert_m is not None or is_same_direction(turned.along, DOWN):
        return turned
    return replace(turned, insert_m=_measure_clearing_m(config, visit.subject, visit.along))


def _measure_clearing_m(config: AssemblyConfig, name: str, direction: Point) -> float:
    """Return the length of an insertion that clears the parts around [m]."""
    lengths_m = [_LEAST_M]
    level = min(AXES.values(), key=lambda axis: abs(dot(axis, direction)))
    across = unit(cross(direction, level))
    axes = (across, cross(direction, across), direction)
    for other in (*config.parts, *config.fixtures):
        if other != name and all(
            _measure_overlap_m(config, name, other, axis) > _TOUCH_M for axis in axes
        ):
            front_m = _measure_reach_m(config, name, direction)
            begins_m = -_measure_reach_m(config, other, _negate(direction))
            lengths_m.append(front_m - begins_m + _CLEARANCE_M)
    return round(max(lengths_m), 9)


def _list_given_directions(part: PartConfig) -> tuple[Point, ...]:
    """Return the directions of a part in the frame of its file."""
    if part.insert_along is None:
        return (DOWN,)
    vectors = part.insert_along
    listed = vectors if isinstance(vectors[0], list) else [vectors]
    return tuple(make_unit(vector) for vector in listed)


def _measure_overlap_m(config: AssemblyConfig, name: str, other: str, axis: Point) -> float:
    """Return the overlap of a part at its goal with another body along a direction [m]."""
    back = _negate(axis)
    high_m = min(_measure_reach_m(config, name, axis), _measure_reach_m(config, other, axis))
    return high_m + min(_measure_reach_m(config, name, back), _measure_reach_m(config, other, back))


def _measure_reach_m(config: AssemblyConfig, name: str, direction: Point) -> float:
    """Return the extent of a part at its goal, or of a fixture, along a direction [m]."""
    pose = get_layout(config).goal(name).pose
    own = pose.inverse().rotate(direction)
    body = config.fixtures.get(name) or config.parts[name]
    extent_m = max(shape.reach_m(own) for shape in body.shapes)
    return dot(pose.position, direction) + extent_m


def _negate(direction: Point) -> Point:
    return (-direction[0], -direction[1], -direction[2])


def _get_named(grasp: Grasp) -> Grasp | None:
    """Return a grasp chosen among several; the scene's body holds a single grasp itself."""
    return grasp if grasp.name else None


def _label(direction: Point | None, grasp: Grasp) -> str:
    words = [] if direction is None else [f"along {name_direction(direction)}"]
    return ", ".join(words + ([f"grasp {grasp.name}"] if grasp.name else []))
