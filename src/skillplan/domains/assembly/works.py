"""Works of presses and dispensers on parts that stand at their goals: points and faults."""

from __future__ import annotations

from collections.abc import Iterator

from skillplan.collision.solid import Solid
from skillplan.domains.assembly.layout import get_layout
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.domains.assembly.tool_schema import WorkConfig
from skillplan.domains.assembly.vocabulary import list_place_options
from skillplan.domains.assembly.workholding import Orientation, list_orientations
from skillplan.errors import Issue, name_hint
from skillplan.task.pose import Point
from skillplan.task.scene import ToolKind


def list_work_points(config: AssemblyConfig, name: str) -> list[Point]:
    """Return the points of the tool's tip in a work on a part of a sound file [m]."""
    work = config.works[name]
    solid = get_layout(config).goal(work.part)
    gap_m = 0.0 if work.force_n is not None else work.gap_m
    motion = find_work_orientation(config, name).motion
    corners = work.corners
    if motion is not None:
        height_m = solid.box.high[2]
        corners = [motion.apply((x, y, height_m))[:2] for x, y in corners]
        solid = Solid(solid.shapes, motion.then(solid.pose))
    return [(x, y, (solid.top_m(x, y) or 0.0) + gap_m) for x, y in corners]


def find_work_orientation(config: AssemblyConfig, name: str) -> Orientation:
    """Return the orientation of the product in which a work of a sound file is done."""
    work = config.works[name]
    orientations = list_orientations(config, work.part)
    given = f".{work.orientation}"
    return next((item for item in orientations if item.label == given), orientations[0])


def find_work_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield faults of works: names, types of tools, forces and places."""
    later = [*config.moved_parts, *config.screws]
    for name, work in config.works.items():
        path = ("works", name)
        if work.tool not in config.tools:
            hint = name_hint(work.tool, config.tools)
            yield Issue(f"unknown tool {work.tool!r}. {hint}", (*path, "tool"))
            continue
        if work.part not in config.parts:
            hint = name_hint(work.part, config.parts)
            yield Issue(f"unknown part {work.part!r}. {hint}", (*path, "part"))
            continue
        moved = work.part in config.moved_parts
        if moved and len(list_place_options(config, work.part)) > 1:
            words = f"{work.part!r} has several goals. Name a part with one."
            yield Issue(words, (*path, "part"))
            continue
        tool = config.tools[work.tool]
        if tool.type not in (ToolKind.PRESS, ToolKind.DISPENSER):
            words = f"{work.tool!r} is no press or dispenser. Give it a type, or name another."
            yield Issue(words, (*path, "tool"))
            continue
        yield from (
            issue.under(*path) for issue in _find_force_issues(work, tool.type, tool.force_n)
        )
        for index, other in enumerate(work.before or ()):
            if other == work.part or other not in later:
                hint = name_hint(other, [item for item in later if item != work.part])
                yield Issue(
                    f"is no part or screw that can come later: {other!r}. {hint}",
                    (*path, "before", index),
                )
        solid = get_layout(config).goal(work.part)
        key = "at_m" if work.path_m is None else "path_m"
        for index, (x_m, y_m) in enumerate(work.corners):
            if solid.top_m(x_m, y_m) is None:
                place = (key,) if work.path_m is None else (key, index)
                yield Issue(
                    f"does not lie over the top of {work.part!r}. Move it.", (*path, *place)
                )


def _find_force_issues(work: WorkConfig, kind: str, most_n: float | None) -> Iterator[Issue]:
    given = work.model_fields_set
    if kind == ToolKind.DISPENSER:
        if work.force_n is not None:
            yield Issue("a dispenser does not press. Leave it out.", ("force_n",))
        if work.path_m is None and "speed_m_per_s" in given:
            yield Issue("without 'path_m' nothing moves at it. Leave it out.", ("speed_m_per_s",))
        if work.path_m is not None and "dwell_s" in given:
            yield Issue("the time is that of the path at its speed. Leave it out.", ("dwell_s",))
        return
    for key in ("path_m", "speed_m_per_s", "gap_m"):
        if key in given:
            yield Issue("only a dispenser has it. Leave it out.", (key,))
    if work.force_n is None:
        yield Issue("a press needs its force. Give it.", ("force_n",))
    elif most_n is not None and work.force_n > most_n:
        words = f"{work.force_n:g} N is more than {work.tool!r} has, {most_n:g} N."
        yield Issue(words, ("force_n",))
