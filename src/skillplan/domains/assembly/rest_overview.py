"""Lines of ``check`` on the parts of an assembly: supports, moved meshes, convex pieces."""

from __future__ import annotations

from typing import Any

from skillplan.domains.assembly.concave_parts import piece_lines
from skillplan.domains.assembly.mesh_origins import origin_lines
from skillplan.domains.assembly.resting import Rest, rests_at_goal, rests_at_start
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.domains.domain import Overview


def rest_overview(config: AssemblyConfig) -> Overview:
    """Return what every part of a faultless assembly rests on, in words and as JSON values."""
    lines, entries = [], []
    for name, part in config.parts.items():
        start, goal = rests_at_start(config, name), rests_at_goal(config, name)
        before = f"in {part.feeder}" if part.feeder is not None else f"on {_words(start)}"
        lines.append(f"rests      {name} on {_words(goal)}; at the start {before}")
        entries.append({"part": name, "start": _document(start), "goal": _document(goal)})
    origins, meshes = origin_lines(config)
    more, pieces = piece_lines(config)
    found = {"meshes": meshes, "pieces": pieces}
    document = {"rests": entries, **{key: values for key, values in found.items() if values}}
    return Overview(document, (*lines, *origins, *more))


def _words(rests: list[Rest]) -> str:
    return ", ".join(f"{rest.on} ({rest.area_m2 * 1e6:,.1f} mm2)" for rest in rests)


def _document(rests: list[Rest]) -> list[dict[str, Any]]:
    return [{"on": rest.on, "area_mm2": round(rest.area_m2 * 1e6, 3)} for rest in rests]
