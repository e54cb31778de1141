"""Changes of a cell that may save cost: places, tools, grips, order, travels.

Each is a set of values by key path, as ``--set`` takes them. The checks of the changed file decide
whether a change is possible.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Any

from skillplan.domains.assembly.gripping import choose_tool_kind
from skillplan.domains.assembly.schema import AssemblyConfig
from skillplan.domains.assembly.schema_types import GraspConfig
from skillplan.domains.domain import CellChange
from skillplan.task.scene import ToolKind

# Shifts of a place, as shares of the greatest one: a grid without its centre.
_SHARES = (-1.0, -0.5, -0.25, 0.0, 0.25, 0.5, 1.0)
_DECIMALS = 3
# Steps of the travels: a quarter faster, and 50 mm lower, at least 50 mm high.
_FASTER, _LOWER_M, _LOWEST_M = 1.25, 0.05, 0.05
_GRASPS: tuple[dict[str, Any], ...] = (
    {"type": "jaws", "closing_axis": "x"},
    {"type": "jaws", "closing_axis": "y"},
    {"type": "suction"},
)


def list_changes(config: AssemblyConfig, within_m: float) -> Iterator[CellChange]:
    """Yield the changes of a cell.

    Parameters
    ----------
    config
        A file without issues.
    within_m
        Greatest shift of a place along x and along y [m], > 0.
    """
    yield from _list_tools(config)
    yield from _list_order(config)
    yield from _list_grips(config)
    yield from _list_travels(config)
    for item, places in _list_places(config):
        for shift_m in _list_shifts(within_m):
            words = f"move {item} by {_format_shift(shift_m)}"
            yield CellChange(
                "place",
                item,
                words,
                {key: _dump(_shift(place, shift_m)) for key, place in places.items()},
            )


def _list_tools(config: AssemblyConfig) -> Iterator[CellChange]:
    """Yield other first tools, two tools on one hand, and parts that another tool handles."""
    for tool in config.carriers:
        if config.initial_tool not in (None, tool):
            words = f"start with {tool} attached"
            yield CellChange("tool", f"first tool {tool}", words, {"initial_tool": _dump(tool)})
    drivers = {t for t in config.tools if choose_tool_kind(config, t) is ToolKind.SCREWDRIVER}
    for name, part in config.moved_parts.items():
        for tool in config.tools:
            if tool == part.tool or tool in drivers:
                continue
            changes = {f"parts.{name}.tool": _dump(tool), f"parts.{name}.grasp": _dump("auto")}
            yield CellChange("tool", f"tool of {name}", f"handle {name} with {tool}", changes)
    for name, screw in config.screws.items():
        for tool in config.tools:
            if tool != screw.tool and tool in drivers:
                changes = {f"screws.{name}.tool": _dump(tool)}
                yield CellChange("tool", f"tool of {name}", f"drive {name} with {tool}", changes)


def _list_order(config: AssemblyConfig) -> Iterator[CellChange]:
    """Yield the chart without one of its relations."""
    for index, line in enumerate(config.chart):
        for after in line.after if line.before else ():
            kept = [
                {
                    **({"before": other.before} if other.before else {"any_of": other.any_of}),
                    "after": [a for a in other.after if number != index or a != after],
                }
                for number, other in enumerate(config.chart)
            ]
            chart = [entry for entry in kept if entry["after"]]
            words = f"drop the rule that {line.before} comes before {after}"
            yield CellChange(
                "order", f"rule {line.before}, {after}", words, {"chart": _dump(chart)}
            )


def _list_grips(config: AssemblyConfig) -> Iterator[CellChange]:
    """Yield other grasps of each part."""
    for name, part in config.moved_parts.items():
        now = part.grasp if isinstance(part.grasp, GraspConfig) else None
        for grasp in _GRASPS:
            same = now is not None and all(getattr(now, key) == grasp[key] for key in grasp)
            if not same:
                how = grasp.get("closing_axis")
                words = f"grasp {name} " + (f"by jaws along {how}" if how else "by suction")
                yield CellChange(
                    "grip", f"grip of {name}", words, {f"parts.{name}.grasp": _dump(grasp)}
                )


def _list_travels(config: AssemblyConfig) -> Iterator[CellChange]:
    robot = config.robot
    speed = round(robot.travel_speed_m_per_s * _FASTER, _DECIMALS)
    yield CellChange(
        "travel",
        "travel speed",
        f"travel at {speed:g} m/s instead of {robot.travel_speed_m_per_s:g} m/s",
        {"robot.travel_speed_m_per_s": _dump(speed)},
    )
    height_m = round(robot.safe_height_m - _LOWER_M, _DECIMALS)
    if height_m >= _LOWEST_M:
        yield CellChange(
            "travel",
            "safe height",
            f"travel at a safe height of {height_m:g} m instead of {robot.safe_height_m:g} m",
            {"robot.safe_height_m": _dump(height_m)},
        )


def _list_places(config: AssemblyConfig) -> Iterator[tuple[str, dict[str, Sequence[float]]]]:
    """Yield movable things, each with the keys and values that move with it."""
    holders: dict[tuple[float, ...], list[str]] = {}
    for name, tool in config.carriers.items():
        holders.setdefault(tool.holder[:2], []).append(name)
    for place, tools in holders.items():
        noun = "the holder of" if len(tools) == 1 else "the holders of"
        keys: dict[str, Sequence[float]] = {f"tools.{tool}.holder_m": place for tool in tools}
        yield f"{noun} {' and '.join(tools)}", keys
    for name, feeder in config.feeders.items():
        yield f"the feeder {name}", {f"feeders.{name}.position_m": feeder.position_m}
    goals = _list_supports_of_goals(config)
    for name, fixture in config.fixtures.items():
        if fixture.stands_on is None and not goals & set(_list_stack(config, name)):
            yield f"the fixture {name}", _collect_places(config, name)
    for name, part in config.moved_parts.items():
        if part.start_m is not None and part.start_on is None and not part.made_of:
            yield f"the start of {name}", _collect_places(config, name)
    yield "home", {"robot.home_m": config.robot.home_m}


def _list_stack(config: AssemblyConfig, lowest: str) -> list[str]:
    """Return a fixture or part and everything on top of it at the start."""
    stack = [lowest]
    for name in stack:
        stack += [n for n, fixture in config.fixtures.items() if fixture.stands_on == name]
        stack += [n for n, part in config.parts.items() if part.start_on == name]
    return stack


def _collect_places(config: AssemblyConfig, lowest: str) -> dict[str, Sequence[float]]:
    places: dict[str, Sequence[float]] = {}
    for name in _list_stack(config, lowest):
        if name in config.fixtures:
            places[f"fixtures.{name}.at_m"] = config.fixtures[name].at_m
        elif (start_m := config.parts[name].start_m) is not None:
            places[f"parts.{name}.start_m"] = start_m
    return places


def _list_supports_of_goals(config: AssemblyConfig) -> set[str]:
    """Return the names on which parts stand at their goals."""
    named = [part.goal_on for part in config.parts.values() if part.goal_on is not None]
    return {name for names in named for name in ([names] if isinstance(names, str) else names)}


def _list_shifts(within_m: float) -> Iterator[tuple[float, float]]:
    for x in _SHARES:
        for y in _SHARES:
            if x or y:
                yield round(x * within_m, _DECIMALS), round(y * within_m, _DECIMALS)


def _shift(place: Sequence[float], shift_m: tuple[float, float]) -> list[float]:
    moved = [round(place[0] + shift_m[0], 9), round(place[1] + shift_m[1], 9)]
    return [*moved, *place[2:]]


def _format_shift(shift_m: tuple[float, float]) -> str:
    named = [f"{value:+g} m in {axis}" for value, axis in zip(shift_m, "xy", strict=True) if value]
    return " and ".join(named)


def _dump(value: Any) -> str:
    # JSON is YAML.
    return json.dumps(value)
