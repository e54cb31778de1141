"""What ``check`` shows of an assembly: how parts may be held and brought into place."""

from __future__ import annotations

from typing import Any

from skillplan.domains.assembly.gripping import grasps_of_part
from skillplan.domains.assembly.handling.insertion import directions_of, insertion_m
from skillplan.domains.assembly.handling.sides import direction_name
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.domains.domain import Overview


def way_overview(config: AssemblyConfig) -> Overview:
    """Return how parts of a faultless assembly go in and are held, in words and as JSON values.

    Only of parts that say in which direction they go in, or may be held in several ways.
    """
    lines, entries = [], []
    for name, part in config.parts.items():
        grasps = [grasp.name for grasp in grasps_of_part(config, name) if grasp.name]
        directions = () if part.insert_along is None else directions_of(config, name)
        if not grasps and not directions:
            continue
        stretches: list[dict[str, Any]] = []
        words = []
        for direction in directions:
            length_m = insertion_m(config, name, direction)
            stretches.append({"along": list(direction), "insert_m": length_m})
            far = "" if length_m is None else f" over {1000 * length_m:,.1f} mm"
            words.append(f"along {direction_name(direction)}{far}")
        said = [f"goes in {' or '.join(words)}"] if words else []
        said += [f"is held at {' or '.join(grasps)}"] if grasps else []
        lines.append(f"ways       {name} {', '.join(said)}")
        entries.append({"part": name, "directions": stretches, "grasps": grasps})
    return Overview({"ways": entries} if entries else {}, tuple(lines))
