"""Faults of choices that a file leaves to the search: goals, tools, and interchangeable parts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from skillplan.domains.assembly.geometry_faults import find_geometry_issues
from skillplan.domains.assembly.gripping import list_grasps
from skillplan.domains.assembly.schema import AssemblyConfig, choose_variant
from skillplan.domains.assembly.vocabulary import list_interchangeable
from skillplan.domains.assembly.zone_faults import list_closed_goals
from skillplan.errors import Issue, name_hint

MOST_INTERCHANGEABLE = 64
"""Greatest number of parts of one class: each may go to each place."""

# Keys in which interchangeable parts agree.
_SAME = (
    *("size_m", "boxes", "cylinder", "meshes", "tool", "other_tools", "mass_kg", "grasp"),
    *("grasp_failure", "fits", "durations_s", "optional", "release_m"),
)


def find_choice_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield unknown tools, choices that exclude each other, and parts that are not the same."""
    for section in ("parts", "screws"):
        for name, owner in getattr(config, section).items():
            here = (section, name, "other_tools")
            named = owner.other_tools or []
            for index, tool in enumerate(named):
                if tool not in config.tools:
                    hint = name_hint(tool, list(config.tools))
                    yield Issue(f"unknown tool {tool!r}. {hint}", (*here, index))
                elif tool == owner.tool or tool in named[:index]:
                    yield Issue(f"{tool!r} stands twice. Keep one.", (*here, index))
    yield from _find_shared_hands(config)
    for name, part in config.parts.items():
        for key in ("other_goals", "other_tools", "interchangeable"):
            if part.buffers and getattr(part, key) is not None:
                words = "a part with buffers has one goal and one tool. Leave one of the two out."
                yield Issue(words, ("parts", name, key))
        if part.other_goals is None:
            continue
        here = ("parts", name, "other_goals")
        above = [n for n, p in config.parts.items() if name in (p.goal_on or ())]
        above += [n for n, screw in config.screws.items() if screw.through == name]
        if above:
            words = f"{above[0]!r} stands on or goes through it, so it has one goal. Leave it out."
            yield Issue(words, here)
        if part.interchangeable is not None:
            words = "interchangeable parts choose among their own goals. Leave one of the two out."
            yield Issue(words, here)
        for index, goal in enumerate(part.other_goals):
            for other in goal.goal_on or ():
                if other not in (*config.parts, *config.fixtures) or other == name:
                    hint = name_hint(other, [*config.parts, *config.fixtures])
                    yield Issue(f"unknown part {other!r}. {hint}", (*here, index, "goal_on"))
    yield from _find_different_parts(config)
    yield from _find_named_parts(config)


def _find_shared_hands(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield tools of one part on one hand: no fact says which of them has the part."""
    for name, part in config.parts.items():
        tool_of = dict[str, str]()
        for index, tool in enumerate((part.tool, *(part.other_tools or ()))):
            if tool not in config.tools:
                continue
            first = tool_of.setdefault(config.find_carrier(tool), tool)
            if first != tool:
                words = f"{tool!r} and {first!r} are on one hand, and one of them has to pick and "
                yield Issue(
                    f"{words}place the part. Name only one.",
                    ("parts", name, "other_tools", index - 1),
                )


def _find_named_parts(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield keys that name one of several interchangeable parts, any of which may be there."""

    def check(named: Iterable[str], *path: str) -> Iterator[Issue]:
        for other in named:
            if other in config.parts and config.parts[other].interchangeable is not None:
                words = f"{other!r} may be at another place, as it is interchangeable."
                yield Issue(f"{words} Give it 'interchangeable: false'.", path)

    for name, screw in config.screws.items():
        yield from check(screw.into_names, "screws", name, "into")
        if screw.length_m is not None:
            yield from check([screw.through], "screws", name, "through")
    for name, part in config.parts.items():
        yield from check(part.fits or (), "parts", name, "fits")
    for name, work in config.works.items():
        named = set(work.before or ())
        some = [n for n in named & config.parts.keys() if config.parts[n].interchangeable]
        # If all of a class wait for the work, it does not matter which is where.
        some = [n for n in some if not named.issuperset(list_interchangeable(config, n))]
        yield from check(sorted(some), "works", name, "before")


def _find_different_parts(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield parts of one class that are not the same."""
    for name, part in config.parts.items():
        if part.interchangeable is None:
            continue
        here = ("parts", name, "interchangeable")
        members = list_interchangeable(config, name)
        if len(members) > MOST_INTERCHANGEABLE and members[0] == name:
            words = f"{len(members)} parts, where {MOST_INTERCHANGEABLE} are the most"
            yield Issue(f"{words} that are assigned. Divide them into classes.", here)
        if len(members) == 1:
            yield Issue("no other part has this class. Leave it out.", here)
        if part.feeder is not None:
            words = "a part of a feeder needs no assignment: the next one goes to any goal."
            yield Issue(f"{words} Leave it out.", here)
        first = config.parts[members[0]]
        for key in _SAME:
            if getattr(part, key) != getattr(first, key):
                words = f"is the class of {members[0]!r}, which has another {key!r}."
                yield Issue(f"{words} Make them the same, or leave it out.", here)
                break


# Keys that give one operation several skills, in words.
_CHOICES = {
    "other_goals": "'other_goals'",
    "other_tools": "several tools",
    "interchangeable": "interchangeable parts",
}


def find_variant_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield geometric faults of the other goals and tools of parts with sound names and shapes."""
    for name, part in config.moved_parts.items():
        key = next((key for key in _CHOICES if getattr(part, key)), None)
        if key is not None and len(list_grasps(config, name)) > 1:
            words = f"with {_CHOICES[key]} a pick and a place would choose their grasps apart"
            yield Issue(f"{words}. Give one grasp.", ("parts", name, "grasp"))
    chosen = {n: p for n, p in config.moved_parts.items() if p.other_goals or p.other_tools}
    known = {issue.message for issue in find_geometry_issues(config)} if chosen else set()
    # The search takes another goal.
    known |= set(list_closed_goals(config).values())
    for name, part in chosen.items():
        for index in range(len(part.other_goals or ())):
            variant = choose_variant(config, name, f"@{index + 2}")
            for issue in find_geometry_issues(variant):
                if issue.message not in known and issue.path[:2] == ("parts", name):
                    keys = issue.path[2:] if str(issue.path[2]).startswith("goal_") else ()
                    yield replace(issue, path=("parts", name, "other_goals", index, *keys))
        for index, tool in enumerate(part.other_tools or ()):
            variant = choose_variant(config, name, tool=tool)
            for issue in find_geometry_issues(variant):
                if issue.message not in known and issue.path[:2] == ("parts", name):
                    message = f"with {tool!r}: {issue.message}"
                    yield replace(
                        issue, message=message, path=("parts", name, "other_tools", index)
                    )
    for name, part in config.moved_parts.items():
        members = list_interchangeable(config, name)
        if part.grasp != "auto" or members[0] == name:
            continue
        if list_grasps(config, name) != list_grasps(config, members[0]):
            words = f"finds other grasps than of {members[0]!r}, with which it is interchangeable"
            yield Issue(f"{words}. Give the grasp.", ("parts", name, "grasp"))
