"""What a parameter study varies: axes, settings, starts and seeds."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

Value = bool | int | float | str | None

ONE_AT_A_TIME, GRID = "one-at-a-time", "grid"
# The settings are those that a sampler chose.
SAMPLED = "sampled"
DESIGNS = (ONE_AT_A_TIME, GRID, SAMPLED)


@dataclass(frozen=True, slots=True)
class Axis:
    """An option of the solver and the values it takes.

    Parameters
    ----------
    option
        The option's name.
    values
        Distinct values, at least one, in the order in which they are shown.

    Raises
    ------
    ValueError
        If there is no value, or one twice.
    """

    option: str
    values: tuple[Value, ...]

    def __post_init__(self) -> None:
        if not self.values:
            raise ValueError(f"Axis {self.option!r} has no values.")
        if len(set(map(json.dumps, self.values))) != len(self.values):
            raise ValueError(f"Axis {self.option!r} has a value twice: {self.values}.")

    @property
    def numeric(self) -> bool:
        """Whether all values are numbers."""
        return all(
            isinstance(value, int | float) and not isinstance(value, bool) for value in self.values
        )


@dataclass(frozen=True, slots=True)
class Start:
    """Where the task is done from.

    Parameters
    ----------
    name
        A place, or facts joined by ``+``.
    optimum
        Cost of the best plan from there, proved by exact search; None where it is not known.

    Raises
    ------
    ValueError
        If the optimum is negative.
    """

    name: str
    optimum: float | None = None

    def __post_init__(self) -> None:
        if self.optimum is not None and not self.optimum >= 0:
            raise ValueError(f"The optimum from {self.name!r} must be >= 0, not {self.optimum}.")


@dataclass(frozen=True)
class SweepPlan:
    """A parameter study as it was planned.

    Parameters
    ----------
    name
        Of the study, for people.
    task, kind, sha256
        The task, its domain and the hash of its content.
    cost_unit, step_limit
        Of the task; from a start that takes more skills than the limit, the solver failed.
    solver
        Who is studied.
    physics, collision
        Back ends that are queried.
    design
        One of `DESIGNS`: every option varied alone around the centre, all combinations, or what a
        sampler chose.
    axes
        The options that vary.
    centre
        The value of every option of `axes` while another one varies.
    fixed
        Other options that were given: plugin to option to value.
    starts
        At least one.
    seeds
        One run of every setting for each, distinct, at least one.
    warm
        Whether verdicts kept on disk were used.

    Raises
    ------
    ValueError
        If the design is unknown, an axis occurs twice or has no centre, or starts or seeds are
        missing or repeated.
    """

    name: str
    task: str
    kind: str
    sha256: str
    cost_unit: str
    step_limit: int
    solver: str
    physics: str
    collision: str
    design: str
    axes: tuple[Axis, ...]
    centre: Mapping[str, Value]
    fixed: Mapping[str, Mapping[str, Any]]
    starts: tuple[Start, ...]
    seeds: tuple[int, ...]
    warm: bool = False

    def __post_init__(self) -> None:
        if self.design not in DESIGNS:
            raise ValueError(f"A design is one of {', '.join(DESIGNS)}, not {self.design!r}.")
        options = [axis.option for axis in self.axes]
        if len(set(options)) != len(options):
            raise ValueError(f"An axis occurs twice: {', '.join(options)}.")
        if set(options) != set(self.centre):
            raise ValueError("The centre must hold the options of the axes and no others.")
        for name, things in (
            ("starts", [start.name for start in self.starts]),
            ("seeds", list(self.seeds)),
        ):
            if not things or len(set(things)) != len(things):
                raise ValueError(f"The {name} must be distinct, and at least one: {things}.")

    @cached_property
    def settings(self) -> list[dict[str, Value]]:
        """The settings, each with a value of every option that varies, and none twice."""
        if self.design == GRID:
            found: list[dict[str, Value]] = [{}]
            for axis in self.axes:
                found = [{**one, axis.option: value} for one in found for value in axis.values]
            return found
        around = [
            {**self.centre, axis.option: value} for axis in self.axes for value in axis.values
        ]
        return list({json.dumps(one): one for one in around or [dict(self.centre)]}.values())

    def about(self, setting: int) -> dict[str, Any]:
        """Return as JSON values what there is to say of a setting beside its options."""
        return {}

    def settings_along(self, axis: Axis) -> list[list[int]]:
        """Return for every value of an axis the indices of the settings to be shown for it.

        With `ONE_AT_A_TIME` that is the one in which all other options are at the centre; else all
        settings of that value, whatever the others are.
        """
        along = []
        for value in axis.values:
            wanted = {**self.centre, axis.option: value}
            along.append(
                [
                    index
                    for index, setting in enumerate(self.settings)
                    if same(setting[axis.option], value)
                    and (self.design != ONE_AT_A_TIME or same(setting, wanted))
                ]
            )
        return along

    def document(self) -> dict[str, Any]:
        """Return as JSON values what makes this study this one and no other."""
        return {
            "task": {"name": self.task, "kind": self.kind, "sha256": self.sha256},
            "cost_unit": self.cost_unit,
            "step_limit": self.step_limit,
            "solver": self.solver,
            "physics": self.physics,
            "collision": self.collision,
            "warm": self.warm,
            "design": self.design,
            "axes": [{"option": axis.option, "values": list(axis.values)} for axis in self.axes],
            "centre": dict(self.centre),
            "fixed": {plugin: dict(values) for plugin, values in self.fixed.items()},
            "starts": [{"start": one.name, "optimum": one.optimum} for one in self.starts],
            "seeds": list(self.seeds),
        }


def same(one: object, other: object) -> bool:
    """Whether two JSON values are equal, also in type: 1 is neither 1.0 nor true."""
    return json.dumps(one, sort_keys=True) == json.dumps(other, sort_keys=True)


def setting_text(setting: Mapping[str, Value], options: Sequence[str] | None = None) -> str:
    """Return a setting in a line, such as ``gamma = 0.9, alpha = 0.1``."""
    shown = setting if options is None else {name: setting[name] for name in options}
    return ", ".join(f"{name} = {value_text(value)}" for name, value in shown.items()) or "defaults"


def value_text(value: Value) -> str:
    """Return a value for people: numbers with up to six digits."""
    if isinstance(value, bool) or value is None:
        return json.dumps(value)
    return f"{value:.6g}" if isinstance(value, float) else str(value)
