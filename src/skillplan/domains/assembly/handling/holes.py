"""Holes whose axes are not straight down, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Iterator

from skillplan.domains.assembly.handling.schema import unit_of
from skillplan.domains.assembly.handling.surface import surface_m
from skillplan.domains.assembly.layout import goal_pose, hole_of, shapes_of
from skillplan.domains.assembly.part_schema import ScrewConfig
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.errors import Issue
from skillplan.task.pose import DOWN, plus, same_direction

# So far from the surface of its part, the mouth of a hole still lies on it [m].
_TOUCH_M = 2e-4
# From so far off a line is drawn along the axis [m].
_FAR_M = 0.002


def is_askew(screw: ScrewConfig) -> bool:
    """Whether a screw goes into its hole in another direction than straight down."""
    return not same_direction(unit_of(screw.axis), DOWN)


def hole_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield holes that are not at the surface of the part that they go through."""
    for name, screw in config.screws.items():
        if not is_askew(screw):
            continue
        pose = goal_pose(config, screw.through).inverse()
        into = pose.rotate(unit_of(screw.axis))
        before = plus(pose.apply(hole_of(config, screw)), into, -_FAR_M)
        met_m = surface_m(shapes_of(config.parts[screw.through]), before, into)
        if met_m is None or abs(met_m - _FAR_M) > _TOUCH_M:
            message = (
                f"the hole does not lie on a surface of {screw.through!r} that its axis goes into. "
                "Move it."
            )
            yield Issue(message, ("screws", name, "hole_m"))
