"""In which directions a part may go into its place, and how long it goes there."""

from __future__ import annotations

from collections.abc import Iterator

from skillplan.domains.assembly.gripping import grasps_of_part
from skillplan.domains.assembly.holding import direction_name
from skillplan.domains.assembly.layout import goal_pose, shapes_of, start_pose
from skillplan.domains.assembly.part_schema import PartConfig
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.domains.assembly.schema_types import dwell_s, unit_of
from skillplan.errors import Issue
from skillplan.task.motion import AXES, Event, Grasp, Visit
from skillplan.task.pose import DOWN, Point, cross, dot, same_direction, unit

# What touches is not inside; coordinates of a file are rounded so far [m].
_TOUCH_M = 2e-4
# What is left between a part and what it goes into where it begins to go in [m].
_CLEARANCE_M = 0.005
# A part that goes into nothing is pushed so far all the same [m].
_LEAST_M = 0.01


def directions_of(config: AssemblyConfig, name: str) -> tuple[Point, ...]:
    """Return the directions in the world in which a part may go into place, as the file has them.

    Straight down where it says nothing.
    """
    part = config.parts[name]
    given = listed_directions(part)
    if part.frame == "goal":
        turned = goal_pose(config, name)
        return tuple(unit(turned.rotate(vector)) for vector in given)
    return given


def listed_directions(part: PartConfig) -> tuple[Point, ...]:
    """Return the directions of a part in the frame that the file gives them in."""
    if part.insert_along is None:
        return (DOWN,)
    vectors = part.insert_along
    listed = vectors if isinstance(vectors[0], list) else [vectors]
    return tuple(unit_of(vector) for vector in listed)


def insertion_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield directions that stand twice."""
    for name, part in config.parts.items():
        directions = listed_directions(part)
        for index, direction in enumerate(directions):
            earlier = next(i for i, one in enumerate(directions) if same_direction(one, direction))
            if earlier != index:
                message = f"is the direction of entry {earlier}. Leave one out."
                yield Issue(message, ("parts", name, "insert_along", index))


def pick_visits(config: AssemblyConfig, name: str) -> list[tuple[str, Visit]]:
    """Return how a part may be picked: one visit for every grasp, with the way in words."""
    pose = start_pose(config, name)
    part = config.parts[name]
    takes_s = dwell_s("pick", config.durations_s, part, config.tools[part.tool])
    return [
        (_label(None, grasp), Visit(pose, Event.GRASP, name, _chosen(grasp), dwell_s=takes_s))
        for grasp in grasps_of_part(config, name)
    ]


def place_visits(config: AssemblyConfig, name: str) -> list[tuple[str, Visit]]:
    """Return how a part may be placed: by every grasp, in every direction, with it in words."""
    pose = goal_pose(config, name)
    directions = directions_of(config, name)
    part = config.parts[name]
    takes_s = dwell_s("place", config.durations_s, part, config.tools[part.tool])
    found = []
    for grasp in grasps_of_part(config, name):
        for direction in directions:
            label = _label(direction if len(directions) > 1 else None, grasp)
            length_m = insertion_m(config, name, direction)
            visit = Visit(pose, Event.RELEASE, name, _chosen(grasp), direction, length_m, takes_s)
            found.append((label, visit))
    return found


def insertion_m(config: AssemblyConfig, name: str, direction: Point) -> float | None:
    """Return how long a part goes in a direction into its place [m].

    As the file says, or from where it is free of every part at its goal that it goes into, and
    5 mm before. None for one that comes straight down from above everything.
    """
    given_m = config.parts[name].insert_m
    if given_m is not None or same_direction(direction, DOWN):
        return given_m
    out_m = [_LEAST_M]
    one, other = _crosswise(direction)
    for beside in config.parts:
        across = beside != name and all(
            _overlap_m(config, name, beside, axis) > _TOUCH_M for axis in (one, other)
        )
        if across and _overlap_m(config, name, beside, direction) > _TOUCH_M:
            front_m = _reach_m(config, name, direction)
            begins_m = -_reach_m(config, beside, _opposite(direction))
            out_m.append(front_m - begins_m + _CLEARANCE_M)
    return round(max(out_m), 9)


def _overlap_m(config: AssemblyConfig, one: str, other: str, axis: Point) -> float:
    """Return how far two parts at their goals overlap along a direction [m]."""
    back = _opposite(axis)
    high_m = min(_reach_m(config, one, axis), _reach_m(config, other, axis))
    return high_m + min(_reach_m(config, one, back), _reach_m(config, other, back))


def _reach_m(config: AssemblyConfig, name: str, direction: Point) -> float:
    """Return how far a part at its goal reaches along a direction of the world [m]."""
    pose = goal_pose(config, name)
    own = pose.inverse().rotate(direction)
    away_m = max(shape.reach_m(own) for shape in shapes_of(config.parts[name]))
    return dot(pose.position, direction) + away_m


def _crosswise(direction: Point) -> tuple[Point, Point]:
    level = min(AXES.values(), key=lambda axis: abs(dot(axis, direction)))
    one = unit(cross(direction, level))
    return one, cross(direction, one)


def _opposite(direction: Point) -> Point:
    return (-direction[0], -direction[1], -direction[2])


def _chosen(grasp: Grasp) -> Grasp | None:
    """Return a grasp that was chosen among several; of a single one the body knows itself."""
    return grasp if grasp.name else None


def _label(direction: Point | None, grasp: Grasp) -> str:
    words = [] if direction is None else [f"along {direction_name(direction)}"]
    return ", ".join(words + ([f"grasp {grasp.name}"] if grasp.name else []))
