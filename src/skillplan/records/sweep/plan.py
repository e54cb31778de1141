"""What a parameter study varies: axes, settings, starts and seeds."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
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
            "starts": [{"start": start.name, "optimum": start.optimum} for start in self.starts],
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


@dataclass(frozen=True, slots=True)
class Span:
    """All values between two ends.

    Parameters
    ----------
    option
        The option's name.
    low, high
        The ends, which belong to it; low < high, finite.
    whole
        Whether values are whole numbers.
    logarithmic
        Whether logarithms are drawn evenly; then low > 0.

    Raises
    ------
    ValueError
        If the ends do not fit.
    """

    option: str
    low: float
    high: float
    whole: bool = False
    logarithmic: bool = False

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise ValueError(f"A span of {self.option!r} needs low < high, both finite.")
        if self.logarithmic and self.low <= 0:
            raise ValueError(f"A logarithmic span of {self.option!r} begins above 0.")

    def holds(self, value: object) -> bool:
        """Whether a value is one of it."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            return False
        return self.low <= value <= self.high and not (self.whole and isinstance(value, float))

    def document(self) -> dict[str, Any]:
        """Return the span as JSON values."""
        return {
            "option": self.option,
            "low": self.low,
            "high": self.high,
            "whole": self.whole,
            "logarithmic": self.logarithmic,
        }


@dataclass(frozen=True, slots=True)
class Choice:
    """Some values.

    Parameters
    ----------
    option
        The option's name.
    values
        At least two, distinct.
    ordered
        Whether neighbours in the list are alike, as numbers that ascend are.

    Raises
    ------
    ValueError
        If there are fewer than two values.
    """

    option: str
    values: tuple[Value, ...]
    ordered: bool = False

    def __post_init__(self) -> None:
        if len(self.values) < 2:
            raise ValueError(f"A choice of {self.option!r} needs at least two values.")

    def holds(self, value: object) -> bool:
        """Whether a value is one of them, also in type."""
        return any(type(one) is type(value) and one == value for one in self.values)

    def document(self) -> dict[str, Any]:
        """Return the choice as JSON values."""
        return {"option": self.option, "values": list(self.values), "ordered": self.ordered}


Dimension = Span | Choice


# What may be minimised, in words.
AIMS = {
    "cost": "mean cost of the runs that arrive, summed over the starts",
    "steps": "mean number of skills of the runs that arrive, summed over the starts",
    "seconds": "mean time to find the plan or policy [s]",
}


@dataclass(frozen=True, slots=True)
class Trial:
    """A setting that a sampler chose.

    Parameters
    ----------
    number
        Which it is, >= 0; no other of the study has it, in whatever process it was tried.
    values
        A value of every option that varies.
    """

    number: int
    values: Mapping[str, Value]


@dataclass(frozen=True)
class TriedSetting:
    """A trial that is over.

    Parameters
    ----------
    trial
        Its setting.
    value
        What was to be minimised; None where no run went well.
    """

    trial: Trial
    value: float | None


@dataclass(frozen=True)
class SampledPlan(SweepPlan):
    """A study whose settings a sampler chooses.

    Parameters
    ----------
    space
        What the options that vary may be; at least one.
    minimise
        One of `AIMS`.
    sampler
        Name of the plugin that chooses.
    tried
        The settings that have been tried, best first.

    Raises
    ------
    ValueError
        If nothing varies or the aim is unknown.
    """

    space: tuple[Dimension, ...] = ()
    minimise: str = "cost"
    sampler: str = ""
    tried: tuple[TriedSetting, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.space:
            raise ValueError("A sampler needs an option that varies.")
        if self.minimise not in AIMS:
            raise ValueError(f"What is minimised is one of {', '.join(AIMS)}.")

    @cached_property
    def settings(self) -> list[dict[str, Value]]:
        """The settings that have been tried, best first; the same one may be tried twice."""
        return [dict(one.trial.values) for one in self.tried]

    def about(self, setting: int) -> dict[str, Any]:
        """Return number and value of a setting's trial."""
        one = self.tried[setting]
        return {"trial": one.trial.number, "value": one.value}

    def with_tried(self, tried: list[TriedSetting]) -> SampledPlan:
        """Return the study with what has been tried, the best first."""
        ordered = sorted(
            tried, key=lambda one: (one.value is None, one.value or 0.0, one.trial.number)
        )
        axes = []
        for axis in self.axes:
            met = [one.trial.values[axis.option] for one in ordered] or list(axis.values)
            distinct = list({json.dumps(value): value for value in met}.values())
            if all(isinstance(one, int | float) and not isinstance(one, bool) for one in distinct):
                distinct.sort(key=lambda one: float(one or 0))
            axes.append(Axis(axis.option, tuple(distinct)))
        return replace(self, axes=tuple(axes), tried=tuple(ordered))

    def document(self) -> dict[str, Any]:
        """Return as JSON values what makes this study this one, and what was tried."""
        return {
            **super().document(),
            "space": [one.document() for one in self.space],
            "minimise": self.minimise,
            "sampler": self.sampler,
        }
