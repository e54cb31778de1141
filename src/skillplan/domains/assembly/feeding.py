"""Feeders that need time to present the next part or run empty, and parts that arrive.

The state determines the time since the last take only if the arm comes straight from the place of
that part. So a cycle is accepted if it is over, whatever else is done in between: a longer wait
would depend on more than the state. A time of arrival needs the time since the begin of the plan,
which solvers and replay add up.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

from skillplan.domains.assembly.layout import get_layout
from skillplan.domains.assembly.schema import AssemblyConfig, choose_variant
from skillplan.domains.assembly.schema_types import find_dwell_s
from skillplan.domains.assembly.screw_holes import find_driving
from skillplan.domains.assembly.vocabulary import list_place_options, name_attached, name_start
from skillplan.domains.assembly.works import list_work_points
from skillplan.errors import Issue
from skillplan.task.cost import WaitingCost, WeightedCost, compute_planar_distance
from skillplan.task.pose import Point
from skillplan.task.skill import Skill, Supply
from skillplan.task.state import Facts

# Keys of parts that hide from the state when the last part was taken.
_HIDING = ("grasp_failure", "buffers", "other_goals", "other_tools")


def add_waits(
    config: AssemblyConfig, skills: Mapping[str, Skill], facts: Facts
) -> dict[str, Skill]:
    """Return the skills with picks that wait for a feeder, in the order given."""
    waiting = dict(skills)
    for feeder, entry in config.feeders.items():
        parts = {name: part for name, part in config.moved_parts.items() if part.feeder == feeder}
        if entry.cycle_s is None or not all(f"place({name})" in skills for name in parts):
            continue
        after = {}
        for name, part in parts.items():
            place = skills[f"place({name})"]
            begins = facts.of(f"held({name})", name_attached(config, part.tool), f"at({feeder})")
            after[facts.bit(f"at({name}.goal)")] = place.name, place.duration_s.at(begins)
        for name in parts:
            pick = skills.get(f"pick({name})")
            if pick is None:
                continue
            duration_s = WaitingCost(pick.duration_s, entry.cycle_s, after)
            cost = duration_s if config.cost == "time" else pick.cost
            if isinstance(cost, WeightedCost):
                cost = replace(cost, duration_s=duration_s)
            waiting[pick.name] = replace(pick, cost=cost, duration_s=duration_s)
    return waiting


def find_supply(config: AssemblyConfig, name: str) -> Supply | None:
    """Return when a part is there; None if it is there from the start."""
    part = config.parts[name]
    feeder = None if part.feeder is None else config.feeders[part.feeder]
    cycle_s = 0.0 if feeder is None else feeder.cycle_s or 0.0
    if not cycle_s and not part.arrives_s:
        return None
    return Supply(name_start(config, name), part.arrives_s or 0.0, cycle_s)


def find_arrival_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield times of arrival that the time since the begin of a plan does not decide."""
    failing = next((name for name, part in config.parts.items() if part.grasp_failure), None)
    for name, part in config.moved_parts.items():
        here = ("parts", name, "arrives_s")
        if part.arrives_s is None:
            continue
        if failing is not None:
            words = f"the grasp of {failing!r} may fail, so the time of a plan is not known."
            yield Issue(f"{words} Leave out 'arrives_s' or 'grasp_failure'.", here)
        if part.feeder is not None and config.feeders[part.feeder].cycle_s is not None:
            words = f"{part.feeder!r} has 'cycle_s', which determines when its parts are there."
            yield Issue(f"{words} Leave one of the two out.", here)


def find_feeder_issues(config: AssemblyConfig) -> Iterator[Issue]:
    """Yield feeders that run empty, and cycles that are too long for the state."""
    for feeder, entry in config.feeders.items():
        here = ("feeders", feeder)
        parts = [name for name, part in config.moved_parts.items() if part.feeder == feeder]
        screws = [name for name, screw in config.screws.items() if screw.feeder == feeder]
        needed = len(parts) + len(screws)
        if entry.capacity is not None and entry.capacity < needed:
            words = f"it holds {entry.capacity}, and {needed} come from it. Fill it, or add another"
            yield Issue(f"{words} feeder.", (*here, "capacity"))
        if entry.cycle_s is None:
            continue
        if needed < 2:
            yield Issue(
                "has no effect, as fewer than two come from it. Leave it out.", (*here, "cycle_s")
            )
        for name in parts:
            for key in _HIDING:
                if getattr(config.parts[name], key):
                    words = f"its part {name!r} has {key!r}, which hides when the last was taken."
                    yield Issue(f"{words} Leave one of the two out.", (*here, "cycle_s"))
        if parts and screws:
            words = "parts and screws come from it. With a cycle, give each kind a feeder."
            yield Issue(words, (*here, "cycle_s"))
            continue
        least_s, pair = _find_least_time_s(config, feeder, parts, screws)
        if entry.cycle_s > least_s:
            most_s = math.floor(least_s * 10) / 10
            words = (
                f"{entry.cycle_s:g} s is more than the {least_s:.3g} s that {pair} at least. The "
                f"wait would depend on more than the last skill: give at most {most_s:g} s"
            )
            yield Issue(f"{words}, or a feeder for some of the parts.", (*here, "cycle_s"))


def _find_least_time_s(
    config: AssemblyConfig, feeder: str, parts: list[str], screws: list[str]
) -> tuple[float, str]:
    """Return the least time between two takes unless one part follows the other directly [s].

    Also a reason, in words. No skill counts as faster than at the speed of travels.
    """
    layout, place = get_layout(config), config.feeders[feeder].position
    goals = {name: layout.goal(name).pose.position for name in parts}

    def part_s(kind: str, names: list[str]) -> float:
        owners = [config.parts[name] for name in names]
        return min(
            find_dwell_s(kind, config.durations_s, part, config.tools[tool])
            for part in owners
            for tool in part.tools
        )

    def driving_s(name: str) -> float:
        return min(
            find_driving(choose_variant(config, name, tool=tool), name).takes_s
            for tool in config.screws[name].tools
        )

    if screws:
        fetch_s = min(
            find_dwell_s("fetch", config.durations_s, screw, config.tools[tool])
            for screw in map(config.screws.__getitem__, screws)
            for tool in screw.tools
        )
        return fetch_s + min(map(driving_s, screws)), "fetching and driving a screw takes"
    others = [*_list_others(config, parts, part_s, driving_s)]
    return min(
        (
            _travel_s(config, place, goal)
            + part_s("place", [name])
            + _travel_s(config, goal, begin)
            + inside_s
            + _travel_s(config, end, place)
            + part_s("pick", [n for n in parts if n != name])
            for name, goal in goals.items()
            for begin, inside_s, end in others
        ),
        default=0.0,
    ), "a part and another skill take"


def _list_others(
    config: AssemblyConfig,
    parts: list[str],
    part_s: Callable[[str, list[str]], float],
    driving_s: Callable[[str], float],
) -> Iterator[tuple[Point, float, Point]]:
    """Yield begin, least time and end of everything that may come between two takes of a feeder."""
    layout = get_layout(config)
    for tool in config.carriers.values():
        least_s = min(find_dwell_s(kind, config.durations_s, tool) for kind in ("load", "offload"))
        yield tool.holder, least_s, tool.holder
    for name, screw in config.screws.items():
        hole = layout.hole(screw)
        begin = layout.fetch(screw) or hole
        yield begin, _travel_s(config, begin, hole) + driving_s(name), hole
    for name in config.works:
        points = list_work_points(config, name)
        yield points[0], 0.0, points[-1]
    for name, part in config.moved_parts.items():
        if name in parts:
            continue
        start = layout.start(name).pose.position
        if part.grasp_failure or part.buffers:
            yield start, part_s("pick", [name]), start
            continue
        for option in list_place_options(config, name):
            where = choose_variant(config, option.done, option.label)
            goal = get_layout(where).goal(option.done).pose.position
            took_s = part_s("pick", [name]) + part_s("place", [name])
            yield start, took_s + _travel_s(config, start, goal), goal


def _travel_s(config: AssemblyConfig, begin: Point, end: Point) -> float:
    return compute_planar_distance(begin, end) / config.robot.travel_speed_m_per_s
