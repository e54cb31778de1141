"""Names of facts, places and actions of an assembly, in their canonical order."""

from __future__ import annotations

from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.task.state import Facts

HAND_FREE = "hand_free"
NO_TOOL = "no_tool"
CHANGED_TOOL = "changed_tool"
HOME = "home"
FIXED = "fixed"
"""Fact that always holds where a file has fixtures; they are there while it does."""


def name_start(config: AssemblyConfig, part: str) -> str:
    """Return the name of the place where a part is picked up."""
    return config.parts[part].feeder or f"{part}.start"


def list_missed_parts(config: AssemblyConfig) -> list[str]:
    """Return the parts that the arm looks for from another place after a failed grasp."""
    if config.robot.look_m is None:
        return []
    return [name for name, part in config.parts.items() if part.grasp_failure]


def allows_bare_hand(config: AssemblyConfig) -> bool:
    """Return True if the arm may be without any tool."""
    return config.initial_tool is None or config.tool_change.style == "separate"


def list_facts(config: AssemblyConfig) -> Facts:
    """Return the facts of the task with their exclusive groups."""
    places = [HOME]
    for part in config.moved_parts:
        places += [name_start(config, part), f"{part}.goal"]
    places += [f"{tool}.holder" for tool in config.tools]
    places += list(config.screws)
    places += [f"{part}.missed" for part in list_missed_parts(config)]
    parts = [
        f"{fact}({name})"
        for name, part in config.parts.items()
        for fact in (("placed",) if part.fixed else ("at_start", "held", "placed"))
    ]
    screws = [f"fastened({screw})" for screw in config.screws]
    tools = [f"tool({tool})" for tool in config.tools]
    if allows_bare_hand(config):
        tools.append(NO_TOOL)
    stands = [f"at({place})" for place in dict.fromkeys(places)]
    moved = config.moved_parts
    held = tuple(f"held({part})" for part in moved)
    whereabouts = tuple((f"at_start({p})", f"held({p})", f"placed({p})") for p in moved)
    fixed = [FIXED] if config.fixtures else []
    return Facts(
        (*parts, *screws, *tools, HAND_FREE, CHANGED_TOOL, *stands, *fixed),
        ((HAND_FREE, *held), tuple(tools), tuple(stands), *whereabouts),
    )


def list_actions(config: AssemblyConfig) -> list[str]:
    """Return all actions in file order: pick and place by part, tool changes, fastenings."""
    names = [f"{kind}({part})" for part in config.moved_parts for kind in ("pick", "place")]
    for tool in config.tools:
        if config.tool_change.style == "separate":
            names.append(f"offload({tool})")
        names.append(f"load({tool})")
    return names + [f"fasten({screw})" for screw in config.screws]


def split_literal(text: str) -> tuple[str, bool]:
    """Return the fact of an observation entry, and False if the entry negates it."""
    words = text.split()
    if len(words) == 2 and words[0] == "not":
        return words[1], False
    return text, True
