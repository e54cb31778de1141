"""What is valid in an assembly file, but found out late: wide grasps, blocked feeders, dwells."""

from __future__ import annotations

from collections.abc import Iterator

from skillplan.collision.boxes import WorldBox, box_at, sweep_hits
from skillplan.domains.assembly.gripping import grasps_of_part
from skillplan.domains.assembly.handling.durations import given_kinds
from skillplan.domains.assembly.handling.schema import GraspConfig
from skillplan.domains.assembly.handling.sides import direction_name
from skillplan.domains.assembly.layout import boxes_of, feeder_of, start_pose
from skillplan.domains.assembly.part_schema import PartConfig
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.errors import Issue
from skillplan.physics.linear_motions import jaws_about
from skillplan.task.motion import Point
from skillplan.task.pose import Pose
from skillplan.task.scene import Grasp, GraspKind

_TOUCH_M = 2e-4
_ROUNDING_M = 1e-6


def hints(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield parts that a hand cannot grasp or that block a feeder, and dwells without effect."""
    yield from _wide_grasps(config)
    yield from _blocked_feeders(config)
    yield from _idle_dwells(config)


def _idle_dwells(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield dwell times that are in no skill."""
    for name, screw in config.screws.items():
        if screw.feeder is None and "fetch" in given_kinds(screw):
            message = f"has no effect, as {name!r} comes from no feeder. Give one, or leave it out."
            yield Issue(message, ("screws", name, "durations_s", "fetch"))
    for name, tool in config.tools.items():
        screws = [screw for screw in config.screws.values() if screw.tool == name]
        fetched = any(screw.feeder is not None for screw in screws)
        holds = any(part.tool == name for part in config.parts.values())
        does = {"pick": holds, "place": holds, "fasten": bool(screws), "fetch": fetched}
        for kind in given_kinds(tool):
            if not does.get(kind, True):
                message = f"has no effect, as no skill with {name!r} has this dwell. Leave it out."
                yield Issue(message, ("tools", name, "durations_s", kind))


def _wide_grasps(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield the parts that are wider along their closing axis than the jaws of an engine open."""
    for name, part in config.parts.items():
        grasps = grasps_of_part(config, name)
        tool = config.tools[part.tool]
        opening_m = (tool.hand_on(config.robot.hand) or config.robot.hand).opening_m
        if any(_fits(grasp, opening_m) for grasp in grasps):
            continue
        grasp = grasps[0]
        axis = grasp.closing_axis or direction_name(grasp.closing)
        given = part.grasp if isinstance(part.grasp, GraspConfig) else None
        turned = ""
        if given is not None and grasp.from_above and axis in ("x", "y"):
            # The other axis, at the same depth, helps where the part is narrow enough.
            other = "yx"["xy".index(axis)]
            if jaws_about(boxes_of(part), other, given.depth_m).width_m <= opening_m:
                turned = f"{{closing_axis: {other}}} or "
        message = (
            f"{grasp.width_m:.3f} m wide along {axis}, where jaws of {part.tool!r} close; those "
            f"that engines simulate open {opening_m:.3f} m. Give grasp: {turned}{{type: suction}}."
        )
        own = given is None or given.model_fields_set & {"approach", "closing_axis"}
        yield Issue(message, ("parts", name, "grasp" if own else part.shape_key))


def _fits(grasp: Grasp, opening_m: float) -> bool:
    return grasp.kind is GraspKind.SUCTION or grasp.width_m <= opening_m + _ROUNDING_M


def _blocked_feeders(config: AssemblyConfig) -> Iterator[Issue]:
    lying = {
        name: _boxes_at(part, start_pose(config, name))
        for name, part in config.parts.items()
        if part.feeder is None
    }
    for feeder in config.feeders:
        handed_out = _handed_out(config, feeder)
        blocked = {
            name: [what for what, boxes in handed_out.items() if _meet(boxes, own, config)]
            for name, own in lying.items()
        }
        for name, waiting in blocked.items():
            if waiting:
                message = (
                    f"{name!r} lies where {feeder!r} hands out {_listed(waiting)}, which cannot be "
                    "taken before it is gone. Move one of them."
                )
                key = "start_on" if config.parts[name].start_m is None else "start_m"
                yield Issue(message, ("parts", name, key))


def _handed_out(config: AssemblyConfig, feeder: str) -> dict[str, tuple[WorldBox, ...]]:
    """Return what a feeder hands out, by the boxes about it where it is taken."""
    place = feeder_of(config, feeder)
    parts = {
        name: _boxes_at(part, start_pose(config, name))
        for name, part in config.parts.items()
        if part.feeder == feeder
    }
    heads = {
        name: (_head(place, screw.head_diameter_m, screw.head_height_m),)
        for name, screw in config.screws.items()
        if screw.feeder == feeder
    }
    return {**parts, **heads}


def _boxes_at(part: PartConfig, pose: Pose) -> tuple[WorldBox, ...]:
    return tuple(box_at(box, pose) for box in boxes_of(part))


def _head(place: Point, diameter_m: float, height_m: float) -> WorldBox:
    x_m, y_m, z_m = place
    radius_m = diameter_m / 2
    return WorldBox(
        (x_m - radius_m, y_m - radius_m, z_m), (x_m + radius_m, y_m + radius_m, z_m + height_m)
    )


def _meet(taken: tuple[WorldBox, ...], lying: tuple[WorldBox, ...], config: AssemblyConfig) -> bool:
    """Whether what is lifted straight up to safe height meets what lies there."""
    lift = (0.0, 0.0, config.robot.safe_height_m)
    return any(sweep_hits(own, lift, other, _TOUCH_M) for own in taken for other in lying)


def _listed(names: list[str]) -> str:
    shown = ", ".join(repr(name) for name in names[:4])
    return f"{shown} and {len(names) - 4} more" if len(names) > 4 else shown
