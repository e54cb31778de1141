"""Results of a parameter study: its runs, and shares and means with intervals."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

from skillplan.files.json_file import parse_json
from skillplan.records import schemas
from skillplan.records.interval import Estimate, mean, share
from skillplan.records.result import Status, tolerance
from skillplan.records.sweep.plan import SweepPlan

_ARRIVED = (Status.OPTIMAL, Status.SOLVED)


@dataclass(frozen=True, slots=True)
class StartOutcome:
    """Outcome of a run from one start.

    Parameters
    ----------
    cost
        Cost of the replayed plan; None if it misses the goal.
    steps
        Number of its skills; None as above.
    reason
        Why it misses the goal.
    learning_s
        Time to find the plan or policy [s]; the same for all starts of a policy.

    Raises
    ------
    ValueError
        If numbers are missing, superfluous, negative or not finite.
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
        """True if the goal is reached within the step limit."""
        return self.status in _ARRIVED


@dataclass(frozen=True, slots=True)
class SweepRecord:
    """A finished run.

    Parameters
    ----------
    setting
        Index of the setting, >= 0.
    outcomes
        One per start; empty for a failed run.
    shared
        True if one policy answers from all starts.
    iterations
        Episodes, sweeps or nodes, as the solver counts them, if it does.
    error
        Why the run failed, if it did.
    back_end_failed
        True if the run failed by a back end or its process, not by its options or the solver.
    planned
        True if the run planned its episodes with a learned model, so that its seed is no sample.

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
    back_end_failed: bool = False
    planned: bool = False

    def __post_init__(self) -> None:
        if min(self.setting, self.seed, self.iterations or 0) < 0:
            raise ValueError("Setting, seed and iterations of a run must be >= 0.")
        if bool(self.outcomes) == (self.error is not None):
            raise ValueError("A run has either outcomes or an error.")
        if self.back_end_failed and self.error is None:
            raise ValueError("A run whose back end failed has an error.")

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


def parse_record(line: str) -> SweepRecord:
    """Parse a line of `SweepRecord.line`.

    Raises
    ------
    ValueError
        If the line is damaged.
    """
    try:
        content = parse_json(line)
        outcomes = tuple(
            StartOutcome(**{**entry, "status": Status(entry["status"])})
            for entry in content.pop("outcomes")
        )
        record = SweepRecord(outcomes=outcomes, **content)
    except (TypeError, KeyError, AttributeError) as error:
        raise ValueError(f"{type(error).__name__}: {error}") from None
    if not _has_valid_types(record):
        raise ValueError("a value is of another type than it should be")
    return record


def _has_valid_types(record: SweepRecord) -> bool:
    expected: Mapping[str, type | tuple[type, ...]] = {
        "setting": int,
        "seed": int,
        "shared": bool,
        "iterations": (int, type(None)),
        "error": (str, type(None)),
        "back_end_failed": bool,
        "planned": bool,
    }
    return all(isinstance(getattr(record, key), kind) for key, kind in expected.items()) and all(
        isinstance(outcome.start, str) and isinstance(outcome.reason, str)
        for outcome in record.outcomes
    )


@dataclass(frozen=True, slots=True)
class StartSummary:
    """Summary of the runs of some settings, from one start or from all.

    Parameters
    ----------
    start
        Name of the start; None for all together: a run must then reach the goal from each.
    arrived
        Number of runs that reach the goal; ``arrived_share`` is their share.
    best
        Number of runs at the proved optimum, if it is known; ``best_share`` is their share.
    steps, excess
        Mean number of skills, and mean cost above the optimum, of runs that reach the goal, if any;
        for all starts together sums over the starts.
    learning_s
        Mean time to find the plan or policy [s]; for all starts together of the whole run.
    """

    start: str | None
    runs: int
    arrived: int
    arrived_share: Estimate | None
    best: int | None
    best_share: Estimate | None
    steps: Estimate | None
    excess: Estimate | None
    learning_s: Estimate | None

    def document(self) -> dict[str, Any]:
        """Return the summary as JSON values."""
        figures = {
            "arrived_share": self.arrived_share,
            "best_share": self.best_share,
            "steps": self.steps,
            "excess": self.excess,
            "learning_s": self.learning_s,
        }
        return {
            "start": self.start,
            "runs": self.runs,
            "arrived": self.arrived,
            "best": self.best,
            **{
                key: None if figure is None else figure.document()
                for key, figure in figures.items()
            },
        }


@dataclass(frozen=True)
class SweepResult:
    """A study and its runs.

    Parameters
    ----------
    records
        Runs in any order, at most one per setting and seed.
    interrupted
        True if runs are missing because the study was stopped.

    Raises
    ------
    ValueError
        If a run occurs twice or does not belong to this study.
    """

    plan: SweepPlan
    records: Sequence[SweepRecord]
    interrupted: bool = False

    def __post_init__(self) -> None:
        keys = [record.key for record in self.records]
        if len(set(keys)) != len(keys):
            raise ValueError("A run of the study occurs twice.")
        names = [start.name for start in self.plan.starts]
        for record in self.records:
            known = record.setting < len(self.plan.settings) and record.seed in self.plan.seeds
            answered = [outcome.start for outcome in record.outcomes]
            if not known or (record.error is None and answered != names):
                raise ValueError(f"Run {record.key} is not of this study.")
        # The result must not depend on the order in which runs end.
        object.__setattr__(self, "records", tuple(sorted(self.records, key=lambda run: run.key)))

    @property
    def failed(self) -> list[SweepRecord]:
        """The failed runs."""
        return [record for record in self.records if record.error is not None]

    @property
    def missing(self) -> int:
        """Number of missing runs."""
        return len(self.plan.settings) * len(self.plan.seeds) - len(self.records)

    @property
    def shared(self) -> bool:
        """True if one policy answers from all starts in every run."""
        return all(record.shared for record in self._sound)

    @cached_property
    def _sound(self) -> list[SweepRecord]:
        return [record for record in self.records if record.error is None]

    def summary(self, settings: Sequence[int], start: str | None = None) -> StartSummary:
        """Summarise the runs of some settings.

        Parameters
        ----------
        start
            Name of a start; None for all starts together.
        """
        runs = [
            [outcome for outcome in record.outcomes if start is None or outcome.start == start]
            for record in self._sound
            if record.setting in settings
        ]
        arrived = [run for run in runs if all(outcome.arrived for outcome in run)]
        sampled = self.sampled(settings)

        def over_runs(estimate: Estimate | None) -> Estimate | None:
            return estimate if estimate is None or sampled else estimate.bare

        optima = {place.name: place.optimum for place in self.plan.starts}
        starts = list(optima) if start is None else [start]
        excess = None
        best = None
        if all(optima[name] is not None for name in starts):
            above = [[_above(outcome, optima[outcome.start]) for outcome in run] for run in arrived]
            best = sum(all(cost == 0.0 for cost in costs) for costs in above)
            excess = over_runs(mean([sum(costs) for costs in above]))
        return StartSummary(
            start,
            len(runs),
            len(arrived),
            over_runs(share(len(arrived), len(runs))),
            best,
            None if best is None else over_runs(share(best, len(runs))),
            over_runs(mean([float(sum(outcome.steps or 0 for outcome in run)) for run in arrived])),
            excess,
            mean([self._learning_s(run) for run in runs]),
        )

    def sampled(self, settings: Sequence[int]) -> bool:
        """Return whether the runs of settings are samples.

        They are not if the solver ignores the seed, or plans with a learned model.
        """
        return self.plan.seeded and not any(
            record.planned for record in self._sound if record.setting in settings
        )

    def _learning_s(self, run: Sequence[StartOutcome]) -> float:
        times_s = [outcome.learning_s for outcome in run]
        return max(times_s) if self.shared else sum(times_s)

    def document(self) -> dict[str, Any]:
        """Return the JSON document ``skillplan.sweep/1``."""
        settings = []
        for index, options in enumerate(self.plan.settings):
            starts = [self.summary([index], start.name) for start in self.plan.starts]
            settings.append(
                {
                    "options": dict(options),
                    **self.plan.about(index),
                    **self.summary([index]).document(),
                    "starts": [summary.document() for summary in starts],
                }
            )
        return {
            "schema": schemas.SWEEP,
            "name": self.plan.name,
            **self.plan.document(),
            "one_policy_for_all_starts": self.shared,
            "interrupted": self.interrupted,
            "missing": self.missing,
            "failed": len(self.failed),
            "settings": settings,
            "runs": [record.document() for record in self.records],
        }


def _above(outcome: StartOutcome, optimum: float | None) -> float:
    """Return the cost above the optimum; 0 for a rounding difference."""
    assert outcome.cost is not None
    assert optimum is not None
    return 0.0 if outcome.cost <= optimum + tolerance(optimum) else outcome.cost - optimum
