"""Names of facts, places and actions of an assembly, in their canonical order."""

from __future__ import annotations

from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.task.state import Facts

HAND_FREE = "hand_free"
NO_TOOL = "no_tool"
CHANGED_TOOL = "changed_tool"
HOME = "home"


def start_place(config: AssemblyConfig, part: str) -> str:
    """Return the name of the place where a part is picked up."""
    return config.parts[part].feeder or f"{part}.start"


def goal_place(part: str) -> str:
    """Return the name of the place where a part is set down."""
    return f"{part}.goal"


def missed_place(part: str) -> str:
    """Return the name of the place where the arm looks for a part whose grasp failed."""
    return f"{part}.missed"


def missed_parts(config: AssemblyConfig) -> list[str]:
    """Return the parts that the arm looks for elsewhere once their grasp has failed."""
    if config.robot.look_m is None:
        return []
    return [name for name, part in config.parts.items() if part.grasp_failure]


def holder_place(tool: str) -> str:
    """Return the name of the place where a tool hangs."""
    return f"{tool}.holder"


def at(place: str) -> str:
    """Return the fact that the arm stands at a place."""
    return f"at({place})"


def bare_hand(config: AssemblyConfig) -> bool:
    """Whether the arm may be without any tool."""
    return config.initial_tool is None or config.tool_change.style == "separate"


def places(config: AssemblyConfig) -> list[str]:
    """Return every place where the arm may stand."""
    names = [HOME]
    for part in config.parts:
        names += [start_place(config, part), goal_place(part)]
    names += [holder_place(tool) for tool in config.tools]
    names += list(config.screws)
    names += [missed_place(part) for part in missed_parts(config)]
    return list(dict.fromkeys(names))


def facts_of(config: AssemblyConfig) -> Facts:
    """Return the vocabulary of the task."""
    parts = [f"{fact}({part})" for part in config.parts for fact in ("at_start", "held", "placed")]
    screws = [f"fastened({screw})" for screw in config.screws]
    tools = [f"tool({tool})" for tool in config.tools]
    if bare_hand(config):
        tools.append(NO_TOOL)
    stands = [at(place) for place in places(config)]
    held = tuple(f"held({part})" for part in config.parts)
    whereabouts = tuple((f"at_start({p})", f"held({p})", f"placed({p})") for p in config.parts)
    return Facts(
        (*parts, *screws, *tools, HAND_FREE, CHANGED_TOOL, *stands),
        ((HAND_FREE, *held), tuple(tools), tuple(stands), *whereabouts),
    )


def action_names(config: AssemblyConfig) -> list[str]:
    """Return all actions in file order: pick and place by part, tool changes, fastenings."""
    names = [f"{kind}({part})" for part in config.parts for kind in ("pick", "place")]
    for tool in config.tools:
        if config.tool_change.style == "separate":
            names.append(f"offload({tool})")
        names.append(f"load({tool})")
    return names + [f"fasten({screw})" for screw in config.screws]


def literal_parts(text: str) -> tuple[str, bool]:
    """Return the fact of an observation entry, and whether it stands for its truth."""
    words = text.split()
    if len(words) == 2 and words[0] == "not":
        return words[1], False
    return text, True
