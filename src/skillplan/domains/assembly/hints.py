"""What is valid in an assembly file, but found out late: feeders under what lies at its start."""

from __future__ import annotations

from collections.abc import Iterator

from skillplan.collision.boxes import WorldBox, sweep_hits, world_box
from skillplan.domains.assembly.layout import boxes_of, feeder_of, start_of
from skillplan.domains.assembly.part_schema import PartConfig
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.errors import Issue
from skillplan.task.motion import Point

_TOUCH_M = 2e-4


def hints(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield the parts that block a feeder from the start on, each with the path of its start."""
    lying = {
        name: _boxes_at(part, start_of(config, name), part.start_yaw_rad)
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
        name: _boxes_at(part, place, part.start_yaw_rad)
        for name, part in config.parts.items()
        if part.feeder == feeder
    }
    heads = {
        name: (_head(place, screw.head_diameter_m, screw.head_height_m),)
        for name, screw in config.screws.items()
        if screw.feeder == feeder
    }
    return {**parts, **heads}


def _boxes_at(part: PartConfig, origin: Point, yaw_rad: float) -> tuple[WorldBox, ...]:
    return tuple(world_box(box, origin, yaw_rad) for box in boxes_of(part))


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
