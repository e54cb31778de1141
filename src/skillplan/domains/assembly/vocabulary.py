"""Names of facts, places and actions of an assembly, in their canonical order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from skillplan.domains.assembly.holding import name_side
from skillplan.domains.assembly.part_schema import PartConfig
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.domains.assembly.schema_types import make_unit
from skillplan.domains.assembly.screw_schema import ScrewConfig
from skillplan.domains.assembly.workholding import (
    list_holds,
    list_insertion_orientations,
    list_turn_targets,
    name_holding,
    name_open,
    name_turned,
)
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


def list_buffered(config: AssemblyConfig) -> dict[str, list[str]]:
    """Return the buffers of the parts that have some, by part."""
    return {name: part.buffers for name, part in config.moved_parts.items() if part.buffers}


def name_holds(config: AssemblyConfig, part: str) -> list[str]:
    """Return short names of the grasps of a part with buffers, in order; "" for its only one."""
    given = config.parts[part].grasp
    if not isinstance(given, list) or len(given) == 1:
        return [""]
    names: list[str] = []
    for grasp in given:
        words = name_side(make_unit(grasp.approach))
        words += "" if grasp.hold == "outer" else f"_{grasp.hold}"
        if isinstance(grasp.closing_axis, str) and grasp.closing_axis != "auto":
            words += f"_{grasp.closing_axis}"
        name = words.strip("()").replace(" ", "_")
        names.append(f"{name}_{len(names) + 1}" if name in names else name)
    return names


def list_picks(config: AssemblyConfig, part: str) -> list[tuple[str, str | None, str]]:
    """Return name, buffer and grasp of each pick of a part; no buffer at its start."""
    return [
        (".".join(word for word in (part, buffer, hold) if word), buffer, hold)
        for buffer in (None, *list_buffered(config).get(part, ()))
        for hold in (name_holds(config, part) if part in list_buffered(config) else [""])
    ]


def list_missed_parts(config: AssemblyConfig) -> list[str]:
    """Return the parts that the arm looks for from another place after a failed grasp."""
    if config.robot.look_m is None:
        return []
    return [name for name, part in config.parts.items() if part.grasp_failure]


def allows_bare_hand(config: AssemblyConfig) -> bool:
    """Return True if the arm may be without any tool."""
    return config.initial_tool is None or config.tool_change.style == "separate"


class PlaceOption(NamedTuple):
    """One of the places that a part may be put at.

    Parameters
    ----------
    label
        Suffix of the names of its facts and skills: empty for the part's own goal.
    place
        Name of the place of the arm.
    done
        Component whose operation is completed: the place's for interchangeable parts.
    """

    label: str
    place: str
    done: str


def list_interchangeable(config: AssemblyConfig, part: str) -> list[str]:
    """Return the parts that may take each other's goals, the part included."""
    own = config.parts[part].interchangeable
    if own is None:
        return [part]
    return [name for name, other in config.parts.items() if other.interchangeable == own]


def list_place_options(config: AssemblyConfig, part: str) -> list[PlaceOption]:
    """Return the places that a part may be put at, its own goal first."""
    options = [PlaceOption("", f"{part}.goal", part)]
    for other in list_interchangeable(config, part):
        if other != part:
            options.append(PlaceOption(f"@{other}", f"{other}.goal", other))
    for number in range(2, 2 + len(config.parts[part].other_goals or ())):
        options.append(PlaceOption(f"@{number}", f"{part}.goal_{number}", part))
    return options


def list_tool_labels(owner: PartConfig | ScrewConfig) -> list[tuple[str, str]]:
    """Return the tools of a part or screw, each with the suffix of its skills' names."""
    first, *others = owner.tools
    return [("", first), *((f":{tool}", tool) for tool in others)]


def list_facts(config: AssemblyConfig) -> Facts:
    """Return the facts of the task with their exclusive groups."""
    moved = config.moved_parts
    options = {part: list_place_options(config, part) for part in moved}
    parts = [
        f"{fact}({name})"
        for name, part in config.parts.items()
        for fact in (("placed",) if part.fixed else ("at_start", "held", "placed"))
    ]
    screws = [f"fastened({screw})" for screw in config.screws]
    works = [name_work(config, name)[1] for name in config.works]
    tools = [name_attached(config, tool) for tool in config.carriers]
    if allows_bare_hand(config):
        tools.append(NO_TOOL)
    stands = [f"at({place})" for place in dict.fromkeys(_list_places(config, options))]
    buffered = {
        part: [f"in_buffer({part}.{buffer})" for buffer in buffers]
        for part, buffers in list_buffered(config).items()
    }
    holds = {
        part: [f"grasp({part}.{hold})" for hold in name_holds(config, part) if hold]
        for part in buffered
    }
    located = {
        part: [f"at_goal({part}{option.label})" for option in goals]
        for part, goals in options.items()
        if len(goals) > 1
    }
    devices = _list_device_facts(config)
    # Members of a sub-assembly are bodies by themselves until it is joined, and then it exists.
    single = [f"single({member})" for member in config.joined_in]
    apart = [f"apart({p})" for p, part in moved.items() if part.made_of]
    standing = [name for name, screw in config.screws.items() if screw.start_m is not None]
    fixed = [FIXED] if config.fixtures else []
    more = [fact for facts in (*buffered.values(), *holds.values(), *devices) for fact in facts]
    more += [*single, *apart, *(f"at_start({name})" for name in standing)]
    where = [fact for facts in located.values() for fact in facts]
    return Facts(
        (*parts, *screws, *works, *tools, HAND_FREE, CHANGED_TOOL, *stands, *fixed, *more, *where),
        (
            (HAND_FREE, *(f"held({part})" for part in moved)),
            tuple(tools),
            tuple(stands),
            *_list_whereabouts(config, options, buffered, located),
            *((f"at_start({name})", f"fastened({name})") for name in standing),
            *(tuple(group) for group in holds.values() if len(group) > 1),
            *devices,
        ),
    )


def _list_places(config: AssemblyConfig, options: Mapping[str, Sequence[PlaceOption]]) -> list[str]:
    """Return the places at which the arm may end a skill, some of them twice."""
    places = [HOME]
    for part, goals in options.items():
        own = (
            f"{option.place}{orientation.label}"
            for option in goals
            if option.done == part
            for orientation in list_insertion_orientations(config, part)
        )
        places += [name_start(config, part), *own]
    for part in list_buffered(config):
        places += list_pick_places(config, part)
    places += [f"{tool}.holder" for tool in config.carriers]
    places += [
        f"{screw}{orientation.label}"
        for screw in config.screws
        for orientation in list_insertion_orientations(config, screw)
    ]
    places += config.works
    places += [f"{part}.missed" for part in list_missed_parts(config)]
    return places + [name_turn_stand(config, name) for name in config.workholders]


def _list_whereabouts(
    config: AssemblyConfig,
    options: Mapping[str, Sequence[PlaceOption]],
    buffered: Mapping[str, Sequence[str]],
    located: Mapping[str, Sequence[str]],
) -> list[tuple[str, ...]]:
    """Return the exclusive facts about the place of each part, and about what fills each place."""
    whereabouts: list[tuple[str, ...]] = [
        (
            *([f"apart({p})"] if part.made_of else []),
            *(f"at_start({p})", f"held({p})", f"placed({p})", *buffered.get(p, ())),
        )
        for p, part in config.moved_parts.items()
        if len(list_interchangeable(config, p)) == 1
    ]
    whereabouts += [(f"at_start({p})", f"held({p})", *facts) for p, facts in located.items()]
    filled: dict[str, list[str]] = {}
    for part in located:
        for option in options[part]:
            filled.setdefault(option.done, []).append(f"at_goal({part}{option.label})")
    return whereabouts + [tuple(facts) for facts in filled.values() if len(facts) > 1]


def _list_device_facts(config: AssemblyConfig) -> list[tuple[str, ...]]:
    """Return the exclusive facts about each workholder and then each holder."""
    turned = [
        tuple(name_turned(name, orientation) for orientation in entry.orientations)
        for name, entry in config.workholders.items()
    ]
    return turned + [
        (*(name_holding(name, part) for part in holder.parts), name_open(name))
        for name, holder in config.holders.items()
    ]


def list_pick_places(config: AssemblyConfig, part: str) -> list[str]:
    """Return the places of the arm of a part with buffers, other than its start and goal.

    A hand at the same target stands elsewhere with another grasp.
    """
    places = []
    for name, buffer, hold in list_picks(config, part):
        if buffer is not None and f"{part}.{buffer}" not in places:
            places.append(f"{part}.{buffer}")
        if hold:
            places.append(name)
    return places


def list_actions(config: AssemblyConfig) -> list[str]:
    """Return all actions in file order: pick and place by part, tool changes, fastenings."""
    names: list[str] = []
    buffered = list_buffered(config)
    for name, part in config.moved_parts.items():
        turns = [orientation.label for orientation in list_insertion_orientations(config, name)]
        if part.made_of:
            names.append(f"join({name})")
        if name in buffered:
            names += [f"pick({pick})" for pick, _, _ in list_picks(config, name)]
            names += [f"place({name}.{buffer})" for buffer in buffered[name]]
            names += [f"place({name}{turn})" for turn in turns]
            continue
        for by, _ in list_tool_labels(part):
            names.append(f"pick({name}{by})")
            names += [
                f"place({name}{at.label}{turn}{by})"
                for at in list_place_options(config, name)
                for turn in turns
            ]
    for tool in config.carriers:
        if config.tool_change.style == "separate":
            names.append(f"offload({tool})")
        names.append(f"load({tool})")
    names += [
        f"fasten({name}{turn.label}{by})"
        for name, screw in config.screws.items()
        for turn in list_insertion_orientations(config, name)
        for by, _ in list_tool_labels(screw)
    ]
    names += [name_work(config, name)[0] for name in config.works]
    names += [
        f"turn({name}.{orientation})"
        for name in config.workholders
        for orientation in list_turn_targets(config, name)
    ]
    for holder, held, by in list_holds(config):
        names += [f"{config.holders[holder].kind}({held}{by})", f"release({held}{by})"]
    return names


def name_turn_stand(config: AssemblyConfig, workholder: str) -> str:
    """Return the name of the place where the arm waits during turns of a workholder."""
    return HOME if config.workholders[workholder].stand_m is None else f"{workholder}.stand"


def name_attached(config: AssemblyConfig, tool: str) -> str:
    """Return the fact that a tool is attached: that of the hand that it is on."""
    return f"tool({config.find_carrier(tool)})"


def name_work(config: AssemblyConfig, name: str) -> tuple[str, str]:
    """Return the action of a work, and the fact that it is done."""
    tool = config.tools.get(config.works[name].tool)
    if tool is not None and tool.type == "press":
        return f"press({name})", f"pressed({name})"
    return f"dispense({name})", f"dispensed({name})"


def split_literal(text: str) -> tuple[str, bool]:
    """Return the fact of an observation entry, and False if the entry negates it."""
    words = text.split()
    if len(words) == 2 and words[0] == "not":
        return words[1], False
    return text, True
