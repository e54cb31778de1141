"""Validation of an assembly beyond its schema: names, references, order, and then geometry."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from itertools import chain, islice

from skillplan.domains.assembly.alternatives import find_choice_issues, find_variant_issues
from skillplan.domains.assembly.cost_schema import find_cost_issues
from skillplan.domains.assembly.feeding import find_arrival_issues, find_feeder_issues
from skillplan.domains.assembly.geometry_faults import find_geometry_issues, find_shape_issues
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.domains.assembly.subassembly import find_subassembly_issues
from skillplan.domains.assembly.vocabulary import HOME, list_actions, list_facts, split_literal
from skillplan.domains.assembly.workholder_faults import find_holding_issues
from skillplan.domains.assembly.workholding import list_insertion_orientations
from skillplan.errors import Issue, name_hint
from skillplan.task.scene import WORLD

# More issues than a user reads at once. Looking for the nearest of many names takes a while each.
_MAX_ISSUES = 300


def find_issues(config: AssemblyConfig) -> list[Issue]:
    """Return the faults, a few hundred at most; geometry is checked only if the parts are sound."""
    held = list(find_holding_issues(config))
    issues = list(
        islice(
            chain(
                _check_references(config),
                _check_names(config),
                find_shape_issues(config),
                find_choice_issues(config),
                find_subassembly_issues(config),
                held,
                _check_cycles(config),
                # Names that stand twice would be facts that stand twice.
                () if held else _check_lists(config),
                _check_step_limit(config),
                _check_product_parts(config),
                find_cost_issues(
                    config.cost,
                    config.tools,
                    list_actions(config),
                    have_holders=bool(config.holders),
                ),
            ),
            _MAX_ISSUES,
        )
    )
    sections = ("parts", "fixtures", "screws", "buffers", "workholders", "holders")
    if not any(issue.path[0] in sections for issue in issues):
        issues += islice(find_geometry_issues(config), _MAX_ISSUES)
        issues += islice(find_variant_issues(config), _MAX_ISSUES)
        if not issues:
            issues += islice(find_feeder_issues(config), _MAX_ISSUES)
            issues += islice(find_arrival_issues(config), _MAX_ISSUES)
    return issues


def _check_names(config: AssemblyConfig) -> Iterator[Issue]:
    if config.robot.name == WORLD:
        message = f"the name {WORLD!r} is taken by the world frame. Choose another."
        yield Issue(message, ("robot", "name"))
    owners: dict[str, str] = {}
    for section in (
        *("tools", "feeders", "fixtures", "zones", "buffers", "parts", "screws", "works"),
        *("workholders", "holders"),
    ):
        for name in getattr(config, section):
            if name in owners:
                message = f"the name {name!r} is taken in {owners[name]!r}. Choose another."
                yield Issue(message, (section, name), at_key=True)
            elif name == HOME and section in ("feeders", "screws", "works"):
                message = f"the name {HOME!r} is taken by the robot. Choose another."
                yield Issue(message, (section, name), at_key=True)
            owners.setdefault(name, section)


def _check_references(config: AssemblyConfig) -> Iterator[Issue]:
    def check(
        name: str | None, known: Iterable[str], kind: str, *path: str | int
    ) -> Iterator[Issue]:
        names = list(known)
        if name is not None and name not in names:
            yield Issue(f"unknown {kind} {name!r}. {name_hint(name, names)}", path)

    yield from check(config.initial_tool, config.tools, "tool", "initial_tool")
    for name, part in config.parts.items():
        here = ("parts", name)
        if not part.fixed:
            yield from check(part.tool, config.tools, "tool", *here, "tool")
        yield from check(part.feeder, config.feeders, "feeder", *here, "feeder")
        for index, buffer in enumerate(part.buffers or ()):
            yield from check(buffer, config.buffers, "buffer", *here, "buffers", index)
            if buffer in (part.buffers or [])[:index]:
                yield Issue(f"{buffer!r} stands twice. Keep one.", (*here, "buffers", index))
        yield from _check_supports(config, name)
        if part.start_on in config.parts and config.parts[part.start_on].feeder is not None:
            message = f"{part.start_on!r} comes from a feeder; nothing can lie on it."
            yield Issue(message, (*here, "start_on"))
    for name, fixture in config.fixtures.items():
        here = ("fixtures", name)
        yield from check(fixture.stands_on, config.fixtures, "fixture", *here, "stands_on")
    used = {buffer for part in config.parts.values() for buffer in part.buffers or ()}
    for name, place in config.buffers.items():
        here = ("buffers", name)
        yield from check(place.stands_on, config.fixtures, "fixture", *here, "stands_on")
        if name not in used:
            message = f"no part names {name!r} in its 'buffers'. Name it there, or leave it out."
            yield Issue(message, here, at_key=True)
    for name, screw in config.screws.items():
        here = ("screws", name)
        yield from check(screw.tool, config.tools, "tool", *here, "tool")
        yield from check(screw.through, config.parts, "part", *here, "through")
        yield from check(screw.feeder, config.feeders, "feeder", *here, "feeder")
        yield from _check_threads(config, name)
    yield from _check_goal(config)
    components = [*config.moved_parts, *config.screws]
    for i, line in enumerate(config.chart):
        yield from check(line.before, components, "part or screw", "chart", i, "before")
        for j, before in enumerate(line.any_of or ()):
            yield from check(before, components, "part or screw", "chart", i, "any_of", j)
            if before in line.after:
                words = f"{before!r} cannot come before itself. Leave it out."
                yield Issue(words, ("chart", i, "any_of", j))
        for j, after in enumerate(line.after):
            yield from check(after, components, "part or screw", "chart", i, "after", j)
            if after == line.before:
                yield Issue(
                    f"{after!r} cannot come before itself. Leave it out.", ("chart", i, "after", j)
                )


def _check_goal(config: AssemblyConfig) -> Iterator[Issue]:
    if not config.moved_parts and not config.screws and not config.works:
        yield Issue(
            "all parts are fixed, so there is nothing to do. Let a hand move one.", ("parts",)
        )
    elif config.goal is None and not config.works:
        parts = all(part.optional for part in config.moved_parts.values())
        if parts and all(screw.optional for screw in config.screws.values()):
            yield Issue(
                "all parts and screws are optional, so the cheapest plan does nothing. Name facts "
                "in 'goal', such as placed(NAME), or leave out 'optional' of one.",
                ("parts",),
            )


def _check_threads(config: AssemblyConfig, name: str) -> Iterator[Issue]:
    """Yield unknown and repeated names of the bodies that a screw's thread goes into."""
    screw, bodies = config.screws[name], [*config.parts, *config.fixtures]
    names = screw.into_names
    for index, body in enumerate(names):
        path = ("screws", name, "into", index) if len(names) > 1 else ("screws", name, "into")
        if body not in bodies:
            kind = "part or fixture"
            yield Issue(f"unknown {kind} {body!r}. {name_hint(body, bodies)}", path)
        elif body == screw.through:
            yield Issue(f"{body!r} is 'through' already. Leave it out.", path)
        elif body in names[:index]:
            yield Issue(f"{body!r} stands twice. Keep one.", path)


def _check_supports(config: AssemblyConfig, name: str) -> Iterator[Issue]:
    """Yield unknown, repeated and circular names of the supports and fits of a part."""
    part, supports = config.parts[name], [*config.parts, *config.fixtures]
    for key, named in (("start_on", part.start_on), ("goal_on", part.goal_on)):
        names = [named] if isinstance(named, str) else named or []
        for index, other in enumerate(names):
            path = ("parts", name, key, index) if len(names) > 1 else ("parts", name, key)
            if other not in supports:
                kind = "part or fixture" if config.fixtures else "part"
                yield Issue(f"unknown {kind} {other!r}. {name_hint(other, supports)}", path)
            elif other == name:
                yield Issue(f"{name!r} cannot lie on itself. Name another part.", path)
            elif other in names[:index]:
                yield Issue(f"{other!r} stands twice. Keep one.", path)
    for other in part.fits or ():
        if other == name or other not in (*config.parts, *config.screws):
            hint = name_hint(other, [*config.parts, *config.screws])
            yield Issue(f"unknown part {other!r}. {hint}", ("parts", name, "fits", other))


def _check_cycles(config: AssemblyConfig) -> Iterator[Issue]:
    for key in ("start_on", "goal_on"):
        beneath = {
            name: [named] if isinstance(named, str) else named
            for name, part in config.parts.items()
            if (named := getattr(part, key)) is not None
        }
        beneath = {name: [on for on in named if on != name] for name, named in beneath.items()}
        cycle = _find_cycle(beneath)
        if cycle:
            message = f"parts stand on each other in a cycle: {' on '.join(cycle)}."
            yield Issue(message, ("parts", cycle[0], key))
    stacked = {
        name: [fixture.stands_on]
        for name, fixture in config.fixtures.items()
        if fixture.stands_on is not None
    }
    cycle = _find_cycle(stacked)
    if cycle:
        message = f"fixtures stand on each other in a cycle: {' on '.join(cycle)}."
        yield Issue(message, ("fixtures", cycle[0], "stands_on"))
    before: dict[str, list[str]] = {}
    for line in config.chart:
        for after in line.after:
            if line.before is not None and after != line.before:
                before.setdefault(after, []).append(line.before)
    cycle = _find_cycle(before)
    if cycle:
        order = list(reversed(cycle))
        index = next(
            i
            for i, line in enumerate(config.chart)
            if line.before == order[0] and order[1] in line.after
        )
        yield Issue(f"the chart has a cycle: {' before '.join(order)}.", ("chart", index))


def _find_cycle(predecessors: Mapping[str, list[str]]) -> list[str]:
    try:
        TopologicalSorter(predecessors).prepare()
    except CycleError as error:
        # graphlib lists each node before its successor; this list is the other way round.
        cycle: list[str] = list(reversed(error.args[1]))
        return cycle
    return []


def _check_lists(config: AssemblyConfig) -> Iterator[Issue]:
    named = [part.buffers or [] for part in config.parts.values()]
    if any(
        len(set(names)) < len(names) or not config.buffers.keys() >= set(names) for names in named
    ):
        return
    facts = list_facts(config)
    actions = list_actions(config)
    for key, entries, known in (
        ("goal", config.goal, facts.names),
        ("actions", config.actions, actions),
        ("observation", config.observation, facts.names),
    ):
        names = frozenset(known)
        seen: dict[str, int] = {}
        for i, entry in enumerate(entries or ()):
            name = split_literal(entry)[0] if key == "observation" else entry
            kind = "action" if key == "actions" else "fact"
            if name not in names:
                yield Issue(f"unknown {kind} {name!r}. {name_hint(name, known)}", (key, i))
            if entry in seen:
                message = f"{entry!r} stands twice, first as entry {seen[entry]}. Keep one."
                yield Issue(message, (key, i))
            seen.setdefault(entry, i)
    goal = set(config.goal or ())
    for group in facts.exclusive:
        both = sorted((config.goal or []).index(fact) for fact in group if fact in goal)
        if len(both) > 1:
            fact, other = (config.goal or [])[both[0]], (config.goal or [])[both[1]]
            message = f"{fact} and {other} cannot both hold. Leave one out."
            yield Issue(message, ("goal", both[1]))
    if config.actions is not None:
        listed = frozenset(config.actions)
        for name, fact in _list_needed_actions(config).items():
            if name not in listed:
                message = f"{name} is missing, without which {fact} cannot hold. Add it."
                yield Issue(message, ("actions",))


def _list_needed_actions(config: AssemblyConfig) -> dict[str, str]:
    """Return the actions that every plan must contain, each with a fact of the goal."""
    labels = {
        name: [turn.label for turn in list_insertion_orientations(config, name)]
        for name in (*config.moved_parts, *config.screws)
    }
    jobs = [
        (
            f"placed({name})",
            # A part with buffers may be picked in several ways.
            [*([] if part.buffers else [f"pick({name})"]), f"place({name}{labels[name][0]})"],
            part.tool,
        )
        for name, part in config.moved_parts.items()
        if not (part.other_goals or part.other_tools or part.interchangeable or part.optional)
        and len(labels[name]) == 1
    ]
    jobs += [
        (f"fastened({name})", [f"fasten({name}{labels[name][0]})"], s.tool)
        for name, s in config.screws.items()
        if not (s.other_tools or s.optional) and len(labels[name]) == 1
    ]
    goal = None if config.goal is None else set(config.goal)
    initial = None if config.initial_tool is None else config.find_carrier(config.initial_tool)
    needed: dict[str, str] = {}
    for fact, actions, tool in jobs:
        if goal is None or fact in goal:
            carrier = config.find_carrier(tool)
            if carrier != initial:
                actions.append(f"load({carrier})")
            for action in actions:
                needed.setdefault(action, fact)
    return needed


def _check_product_parts(config: AssemblyConfig) -> Iterator[Issue]:
    count = config.component_count
    if config.product_parts is not None and config.product_parts < count:
        yield Issue(
            f"{config.product_parts} is too few: the task has {count} parts and screws.",
            ("product_parts",),
        )


def _check_step_limit(config: AssemblyConfig) -> Iterator[Issue]:
    if config.goal is not None or config.step_limit is None:
        return
    parts = [part for part in config.moved_parts.values() if not part.optional]
    screws = [screw for screw in config.screws.values() if not screw.optional]
    steps = 2 * len(parts) + len(screws)
    tools = {part.tool for part in parts if not part.other_tools}
    tools |= {screw.tool for screw in screws if not screw.other_tools}
    if config.initial_tool is not None:
        tools.add(config.initial_tool)
    hands = {config.find_carrier(tool) for tool in tools if tool in config.tools}
    changes = len(hands) - (config.initial_tool is not None)
    if config.tool_change.style == "separate" and config.initial_tool is not None:
        changes *= 2
    if config.step_limit < steps + changes:
        yield Issue(
            f"{config.step_limit} is too few: parts, screws and their tools need at least "
            f"{steps + changes} skills.",
            ("step_limit",),
        )
