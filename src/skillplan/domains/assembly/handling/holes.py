"""Where the heads of screws rest, and holes that are not where their parts are."""

from __future__ import annotations

import math
from collections.abc import Iterator

from skillplan.collision.solids.solid import TOUCH_M, Solid
from skillplan.domains.assembly.handling.schema import unit_of
from skillplan.domains.assembly.handling.surface import surface_m
from skillplan.domains.assembly.layout import goal_pose, hole_of, shapes_of
from skillplan.domains.assembly.mesh_origins import origin_hint
from skillplan.domains.assembly.part_schema import ScrewConfig
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.errors import Issue
from skillplan.task.grasp import AXES
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
