"""A parameter study whose settings a sampler chose, one after another."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from skillplan.records.sweep.plan import Axis, SweepPlan, Value
from skillplan.records.sweep.space import Dimension

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
