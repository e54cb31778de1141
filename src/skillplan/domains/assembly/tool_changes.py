"""Tool changes: what they need and do, and by which holders the arm goes, which is their cost.

A change costs the planar distance that the arm goes for it: from where it stands to the holder of
the attached tool, if that is put back, and on to the holder of the one that is loaded.
"""

from __future__ import annotations

from collections.abc import Iterator

from skillplan.domains.assembly import vocabulary
from skillplan.domains.assembly.handling.durations import dwell_s
from skillplan.domains.assembly.layout import holder_of
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.domains.assembly.skill_draft import SkillDraft
from skillplan.domains.assembly.vocabulary import CHANGED_TOOL, HAND_FREE, NO_TOOL
from skillplan.task.motion import Event, Visit
from skillplan.task.pose import Pose


def tool_changes(config: AssemblyConfig) -> Iterator[SkillDraft]:
    """Yield the tool changes of an assembly in the style that its file says."""
    for tool in config.tools:
        if config.tool_change.style == "separate":
            yield _offload(config, tool)
            yield _load(config, tool)
        else:
            yield _swap(config, tool)


def _swap(config: AssemblyConfig, tool: str) -> SkillDraft:
    """Return the action that offloads whatever is attached and loads `tool`."""
    load = _visit(config, Event.LOAD, tool)
    routes: dict[str | None, list[Visit]] = {}
    for other in config.tools:
        if other != tool or config.tool_change.reload:
            offload = _visit(config, Event.OFFLOAD, other)
            routes[f"tool({other})"] = [offload, load]
    if vocabulary.bare_hand(config):
        routes[NO_TOOL] = [load]
    others = [f"tool({other})" for other in config.tools if other != tool]
    return SkillDraft(
        kind="load",
        subject=tool,
        requires=[HAND_FREE],
        forbids=[] if config.tool_change.reload else [f"tool({tool})"],
        add=[f"tool({tool})", CHANGED_TOOL],
        delete=others + ([NO_TOOL] if vocabulary.bare_hand(config) else []),
        ends_at=vocabulary.holder_place(tool),
        routes=routes or {None: [load]},
        parameters={"tool": tool},
    )


def _offload(config: AssemblyConfig, tool: str) -> SkillDraft:
    """Return the action that puts `tool` back."""
    return SkillDraft(
        kind="offload",
        subject=tool,
        requires=[HAND_FREE, f"tool({tool})"],
        add=[NO_TOOL],
        delete=[f"tool({tool})"],
        ends_at=vocabulary.holder_place(tool),
        routes={None: [_visit(config, Event.OFFLOAD, tool)]},
        parameters={"tool": tool},
    )


def _load(config: AssemblyConfig, tool: str) -> SkillDraft:
    """Return the action that attaches `tool` where there is none."""
    return SkillDraft(
        kind="load",
        subject=tool,
        requires=[HAND_FREE, NO_TOOL],
        add=[f"tool({tool})", CHANGED_TOOL],
        delete=[NO_TOOL],
        ends_at=vocabulary.holder_place(tool),
        routes={None: [_visit(config, Event.LOAD, tool)]},
        parameters={"tool": tool},
    )


def _visit(config: AssemblyConfig, event: Event, tool: str) -> Visit:
    """Return the visit of a tool's holder."""
    takes_s = dwell_s(event.value, config.durations_s, config.tools[tool])
    return Visit(Pose(holder_of(config, tool)), event, tool, dwell_s=takes_s)
