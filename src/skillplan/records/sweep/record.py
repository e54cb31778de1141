"""One run of a parameter study: one setting, one seed, every start."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from skillplan.files.strict_json import parse_json
from skillplan.records.result import Status

_ARRIVED = (Status.OPTIMAL, Status.SOLVED)


@dataclass(frozen=True, slots=True)
class StartOutcome:
    """What a run came to from one start.

    Parameters
    ----------
    start
        The start's name.
    status
        What the referee grants.
    cost
        Of the replayed plan; None where it does not arrive.
    steps
        Its number of skills; None where it does not arrive.
    reason
        Why it does not arrive.
    learning_s
        Time that was spent to find it [s]; the same for all starts of one policy.

    Raises
    ------
    ValueError
        If figures are missing, left over, negative or not finite.
    """

    start: str
    status: Status
    cost: float | None
    steps: int | None
    reason: str
    learning_s: float

    def __post_init__(self) -> None:
        if {self.cost is None, self.steps is None} != {not self.arrived}:
            raise ValueError(f"Start {self.start!r}: {self.status!s} does not fit its cost.")
        figures = (self.cost or 0.0, self.steps or 0, self.learning_s)
        if not all(math.isfinite(figure) and figure >= 0 for figure in figures):
            raise ValueError(f"Start {self.start!r}: figures must be finite and >= 0: {figures}.")

    @property
    def arrived(self) -> bool:
        """Whether the goal is reached within the step limit."""
        return self.status in _ARRIVED


@dataclass(frozen=True, slots=True)
class SweepRecord:
    """A finished run.

    Parameters
    ----------
    setting
        Index of the setting, >= 0.
    seed
        Its seed, >= 0.
    outcomes
        One for each start; empty for a run that failed.
    shared
        Whether one policy answers from all starts.
    iterations
        Episodes, sweeps or nodes, whatever the solver counts; None where it counts nothing.
    error
        Why the run failed, or None.

    Raises
    ------
    ValueError
        If a number is negative, or a run has both outcomes and an error, or neither.
    """

    setting: int
    seed: int
    outcomes: tuple[StartOutcome, ...] = ()
    shared: bool = False
    iterations: int | None = None
    error: str | None = None

    def __post_init__(self) -> None:
        if min(self.setting, self.seed, self.iterations or 0) < 0:
            raise ValueError("Setting, seed and iterations of a run must be >= 0.")
        if bool(self.outcomes) == (self.error is not None):
            raise ValueError("A run has either outcomes or an error.")

    @property
    def key(self) -> tuple[int, int]:
        """Setting and seed."""
        return self.setting, self.seed

    def line(self) -> str:
        """Return the record as one line of JSON."""
        return json.dumps(asdict(self), allow_nan=False)

    def document(self) -> dict[str, Any]:
        """Return the record as JSON values."""
        content: dict[str, Any] = parse_json(self.line())
        return content


def record_of(line: str) -> SweepRecord:
    """Return the record of a line that `SweepRecord.line` wrote.

    Raises
    ------
    ValueError
        If the line is damaged.
    """
    try:
        content = parse_json(line)
        outcomes = tuple(
            StartOutcome(**{**one, "status": Status(one["status"])})
            for one in content.pop("outcomes")
        )
        record = SweepRecord(outcomes=outcomes, **content)
    except (TypeError, KeyError, AttributeError) as error:
        raise ValueError(f"{type(error).__name__}: {error}") from None
    if not _sound(record):
        raise ValueError("a value is of another type than it should be")
    return record


def _sound(record: SweepRecord) -> bool:
    expected: Mapping[str, type | tuple[type, ...]] = {
        "setting": int,
        "seed": int,
        "shared": bool,
        "iterations": (int, type(None)),
        "error": (str, type(None)),
    }
    return all(isinstance(getattr(record, key), kind) for key, kind in expected.items()) and all(
        isinstance(one.start, str) and isinstance(one.reason, str) for one in record.outcomes
    )
