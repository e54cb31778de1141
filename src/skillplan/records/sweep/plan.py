"""Plan of a parameter study: axes or ranges of options, settings, starts and seeds."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeVar

_T = TypeVar("_T")
Value = bool | int | float | str | None

ONE_AT_A_TIME, GRID = "one-at-a-time", "grid"
# A sampler chose the settings.
SAMPLED = "sampled"
DESIGNS = (ONE_AT_A_TIME, GRID, SAMPLED)


@dataclass(frozen=True, slots=True)
class Axis:
    """An option of the solver and its values.

    Parameters
    ----------
    values
        Distinct values, at least one, in display order.

    Raises
    ------
    ValueError
        If values are missing or repeated.
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
        """True if all values are numbers."""
        return all(
            isinstance(value, int | float) and not isinstance(value, bool) for value in self.values
        )


@dataclass(frozen=True, slots=True)
class Start:
    """A start of the task.

    Parameters
    ----------
    name
        A place, or facts joined by ``+``.
    optimum
        Proved optimum from there, if known.
    """

    name: str
    optimum: float | None = None

    def __post_init__(self) -> None:
        if self.optimum is not None and not self.optimum >= 0:
            raise ValueError(f"The optimum from {self.name!r} must be >= 0, not {self.optimum}.")


@dataclass(frozen=True)
class SweepPlan:
    """A parameter study.

    Parameters
    ----------
    cost_unit, step_limit
        Properties of the task. A run from a start fails beyond the step limit.
    design
        One of `DESIGNS`.
    axes
        The options that vary.
    centre
        Value of every option of `axes` while another option varies.
    fixed
        Other options: plugin to option to value.
    seeds
        One run per setting and seed; distinct, at least one.
    warm
        True to use verdicts stored on disk.
    seeded
        True if the solver depends on the seed; otherwise its runs are not samples.

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
    seeded: bool = True

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
        """The settings, each with a value of every option that varies; all distinct."""
        if self.design == GRID:
            settings: list[dict[str, Value]] = [{}]
            for axis in self.axes:
                settings = [
                    {**setting, axis.option: value} for setting in settings for value in axis.values
                ]
            return settings
        around = [
            {**self.centre, axis.option: value} for axis in self.axes for value in axis.values
        ]
        return list(
            {json.dumps(setting): setting for setting in around or [dict(self.centre)]}.values()
        )

    def about(self, setting: int) -> dict[str, Any]:
        """Return further properties of a setting as JSON values."""
        return {}

    def settings_along(self, axis: Axis) -> list[list[int]]:
        """Return the indices of the settings to show for every value of an axis.

        With `ONE_AT_A_TIME` this is the setting whose other options are at the centre; otherwise
        all settings with the value.
        """
        along = []
        for value in axis.values:
            at_centre = {**self.centre, axis.option: value}
            along.append(
                [
                    index
                    for index, setting in enumerate(self.settings)
                    if is_same(setting[axis.option], value)
                    and (self.design != ONE_AT_A_TIME or is_same(setting, at_centre))
                ]
            )
        return along

    def document(self) -> dict[str, Any]:
        """Return the identity of the study as JSON values."""
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
            "seeded": self.seeded,
        }


def _drop_repeated(values: Iterable[_T]) -> tuple[_T, ...]:
    """Return distinct JSON values in order; 1 and 1.0 are distinct."""
    return tuple({json.dumps(value): value for value in values}.values())


def is_same(first: object, second: object) -> bool:
    """Return True if two JSON values are equal, also in type: 1 equals neither 1.0 nor true."""
    return json.dumps(first, sort_keys=True) == json.dumps(second, sort_keys=True)


def format_setting(setting: Mapping[str, Value]) -> str:
    """Return a setting as a line such as ``gamma = 0.9, alpha = 0.1``."""
    values = (f"{name} = {format_value(value)}" for name, value in setting.items())
    return ", ".join(values) or "defaults"


def format_value(value: Value) -> str:
    """Format a value; numbers have up to six digits."""
    if isinstance(value, bool) or value is None:
        return json.dumps(value)
    return f"{value:.6g}" if isinstance(value, float) else str(value)


@dataclass(frozen=True, slots=True)
class Span:
    """All values between two ends.

    Parameters
    ----------
    low, high
        The ends, both included; low < high, finite.
    logarithmic
        True if logarithms are drawn uniformly; then low > 0.
    multiple_of
        Only multiples of this number are allowed, and both ends are such; None for all values.

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
    multiple_of: float | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise ValueError(f"A span of {self.option!r} needs low < high, both finite.")
        if self.logarithmic and self.low <= 0:
            raise ValueError(f"A logarithmic span of {self.option!r} begins above 0.")
        if self.multiple_of is not None and not all(map(self._is_multiple, (self.low, self.high))):
            raise ValueError(f"The ends of {self.option!r} are no multiples of {self.multiple_of}.")

    def holds(self, value: object) -> bool:
        """Return True if a value is in the span."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            return False
        fits = self.low <= value <= self.high and not (self.whole and isinstance(value, float))
        return fits and self._is_multiple(value)

    def _is_multiple(self, value: float) -> bool:
        return self.multiple_of is None or value == count_multiples(value, self.multiple_of)[1]

    def document(self) -> dict[str, Any]:
        """Return the span as JSON values."""
        return {
            "option": self.option,
            "low": self.low,
            "high": self.high,
            "whole": self.whole,
            "logarithmic": self.logarithmic,
            **({} if self.multiple_of is None else {"multiple_of": self.multiple_of}),
        }


def count_multiples(value: float, multiple_of: float) -> tuple[int, float]:
    """Return the number of multiples nearest to a value, and their product."""
    count = round(value / multiple_of)
    product = count * multiple_of
    return count, product if isinstance(multiple_of, int) else float(f"{product:.10g}")


@dataclass(frozen=True, slots=True)
class Choice:
    """A list of values.

    Parameters
    ----------
    values
        At least two, distinct.
    ordered
        True if neighbours are similar, like ascending numbers.

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
        """Return True if a value is in the list, also by type."""
        return any(type(known) is type(value) and known == value for known in self.values)

    def document(self) -> dict[str, Any]:
        """Return the choice as JSON values."""
        return {"option": self.option, "values": list(self.values), "ordered": self.ordered}


Dimension = Span | Choice


# Quantities to minimise, with their descriptions.
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
        Number of the trial, >= 0, unique over all processes of the study.
    """

    number: int
    values: Mapping[str, Value]


@dataclass(frozen=True)
class TriedSetting:
    """A finished trial.

    Parameters
    ----------
    value
        The minimised quantity; None if every run failed.
    """

    trial: Trial
    value: float | None


@dataclass(frozen=True)
class SampledPlan(SweepPlan):
    """A study whose settings a sampler chooses.

    Parameters
    ----------
    space
        Ranges of the options that vary, at least one.
    minimise
        One of `AIMS`.
    tried
        The settings of finished trials, best first.

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
            raise ValueError(f"The quantity to minimise is one of {', '.join(AIMS)}.")

    @cached_property
    def settings(self) -> list[dict[str, Value]]:
        """The settings of finished trials, best first, possibly with repetitions."""
        return [dict(setting.trial.values) for setting in self.tried]

    def about(self, setting: int) -> dict[str, Any]:
        """Return number and value of a setting's trial."""
        tried = self.tried[setting]
        return {"trial": tried.trial.number, "value": tried.value}

    def with_tried(self, tried: list[TriedSetting]) -> SampledPlan:
        """Return the study with finished trials, sorted from best to worst."""
        ordered = sorted(
            tried, key=lambda done: (done.value is None, done.value or 0.0, done.trial.number)
        )
        axes = []
        for axis in self.axes:
            values = [done.trial.values[axis.option] for done in ordered] or list(axis.values)
            distinct = Axis(axis.option, _drop_repeated(values))
            if distinct.numeric:
                numbers = sorted(distinct.values, key=lambda value: float(value or 0))
                distinct = Axis(axis.option, tuple(numbers))
            axes.append(distinct)
        return replace(self, axes=tuple(axes), tried=tuple(ordered))

    def document(self) -> dict[str, Any]:
        """Return the identity of the study as JSON values."""
        return {
            **super().document(),
            "space": [dimension.document() for dimension in self.space],
            "minimise": self.minimise,
            "sampler": self.sampler,
        }
