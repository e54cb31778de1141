"""Several training runs of one solver on one task: the document ``skillplan.training/1``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from skillplan.records import schemas
from skillplan.records.interval import Estimate, interquartile_mean, share
from skillplan.records.optimum import Optimum
from skillplan.records.training.layouts_result import LayoutsResult
from skillplan.records.training.outcome import RunOutcome, RunStatus, Tally
from skillplan.records.training.published_runs import PublishedRun, published_runs
from skillplan.records.training.run_folder import WarmStartRecord
from skillplan.records.training.shortfall import Shortfall
from skillplan.solvers.gap import deviation
from skillplan.solvers.learning.learner import MODEL_BASED
from skillplan.task.task import Task

# A deviation below half of the last digit is printed as 0.00 %.
_ZERO_PERCENT, _ONE_PERCENT = 0.5e-4, 0.01


@dataclass(frozen=True, slots=True)
class RandomBaseline:
    """Episodes in which every action was drawn evenly among those that the mask allows.

    Parameters
    ----------
    tally
        How many of them completed the task.
    best_cost
        The least that one cost; None where none succeeded.
    mask
        What the choice was limited to: ``none``, ``applicable`` or ``feasible``.
    """

    tally: Tally
    best_cost: float | None
    mask: str


@dataclass(frozen=True, slots=True)
class Sampling:
    """How roll-outs were drawn: so many a run, by scores over a temperature, from a seed."""

    episodes: int
    temperature: float
    seed: int


@dataclass(frozen=True)
class TrainingResult:
    """Several runs of one solver on one task.

    Parameters
    ----------
    task
        What was learned, or what the policies were evaluated on.
    run_dir
        The folder of the runs, as the user named it.
    solver, options
        Who learned, and all its options.
    steps
        Environment steps that every run was to do.
    outcomes
        One for every run, in order.
    optimum
        What the task costs at least.
    physics, collision
        The back ends queried.
    baseline
        What chance alone achieves; None where nobody tried.
    sampling
        How roll-outs were drawn; None where success rates are those of the training.
    checks, executions
        Queries that back ends answered, and skills that an engine has executed for them.
    wall_s
        How long it all took [s].
    steps_per_s
        Environment steps of all runs together in a second; None where none were done.
    interrupted
        Whether the runs were stopped before they had done their steps.
    layouts
        What the policies do on layouts that they have not seen; None where nobody tried.
    shortfall
        Why runs do not complete the task; None where all do, or where nobody knows.
    family
        Whether the runs learned on other layouts than the task's own: what they saw while they
        learned is not to be held to its optimum.
    warm_start
        What the runs began with; None for networks that were drawn.
    notes
        What else is to be said below the table, each ``label      text``.
    """

    task: Task
    run_dir: str
    solver: str
    steps: int
    outcomes: tuple[RunOutcome, ...]
    optimum: Optimum
    options: Mapping[str, Any] = field(default_factory=dict)
    physics: str = ""
    collision: str = ""
    baseline: RandomBaseline | None = None
    sampling: Sampling | None = None
    checks: int = 0
    executions: int = 0
    wall_s: float = 0.0
    steps_per_s: float | None = None
    interrupted: bool = False
    layouts: LayoutsResult | None = None
    shortfall: Shortfall | None = None
    family: bool = False
    warm_start: WarmStartRecord | None = None
    notes: tuple[str, ...] = ()

    @property
    def learner(self) -> str:
        """The learner, and that it plans its episodes by search in a learned model, if it does."""
        return f"{self.solver}{MODEL_BASED if self.options.get('planning') else ''}"

    @property
    def success(self) -> Tally:
        """The episodes of all runs together: sampled ones, or else the last of training."""
        return sum((one.tally for one in self.outcomes), Tally())

    @property
    def training_success(self) -> Tally:
        """The last episodes of the training of all runs together."""
        known = [one.training.recent for one in self.outcomes if one.training is not None]
        return sum(known, Tally())

    @property
    def deviations(self) -> list[float]:
        """Deviations from the optimum of the runs that complete the task, in order."""
        found = [deviation(one.cost, self.optimum.cost) for one in self.outcomes]
        return [one for one in found if one is not None]

    @property
    def completed(self) -> int:
        """How many runs complete the task."""
        return sum(one.cost is not None for one in self.outcomes)

    @property
    def completion(self) -> Estimate | None:
        """Share of the runs that complete the task, with Wilson's interval; None of no runs."""
        return share(self.completed, len(self.outcomes))

    @property
    def failed(self) -> list[RunOutcome]:
        """The runs that could not go on or cannot be read."""
        return [one for one in self.outcomes if one.status is RunStatus.FAILED]

    @property
    def chance(self) -> bool:
        """Whether costs are expected ones: a single episode may cost less than the optimum."""
        return not self.task.deterministic

    @property
    def episode_optimum(self) -> float | None:
        """What no single episode can undercut; None under chance, or where nothing is proved."""
        return None if self.chance else self.optimum.cost

    @property
    def seen_optimum(self) -> float | None:
        """What no episode of training can undercut; None where other layouts were learned on."""
        return None if self.family else self.episode_optimum

    @property
    def best_seen(self) -> float | None:
        """The least that an episode of any run cost while it learned; None without success."""
        costs = [one.best_cost_seen for one in self.outcomes if one.best_cost_seen is not None]
        return min(costs, default=None)

    def at_most(self, excess: float) -> int | None:
        """Return how many runs deviate by no more; None where no optimum is proved."""
        if self.optimum.cost is None:
            return None
        return sum(one <= excess for one in self.deviations)

    @property
    def deviation_iqm(self) -> Estimate | None:
        """Interquartile mean of the deviations of the runs that complete the task."""
        return interquartile_mean(self.deviations)

    @property
    def cost_iqm(self) -> Estimate | None:
        """Interquartile mean of what the runs that complete the task cost."""
        return interquartile_mean([one.cost for one in self.outcomes if one.cost is not None])

    @property
    def success_iqm(self) -> Estimate | None:
        """Interquartile mean of the success rates of all runs that have one."""
        rates = [one.tally.rate for one in self.outcomes]
        return interquartile_mean([rate for rate in rates if rate is not None])

    @property
    def published(self) -> tuple[PublishedRun, ...]:
        """The paper's runs, where the task is the paper's; else none."""
        return published_runs(self.task, self.optimum.cost)

    def document(self) -> dict[str, Any]:
        """Return the JSON document ``skillplan.training/1``."""
        task, best = self.task, self.optimum
        success = self.success.estimate
        return {
            "schema": schemas.TRAINING,
            "run_dir": self.run_dir,
            "task": {"name": task.name, "kind": task.kind, "sha256": task.sha256},
            "solver": self.solver,
            "options": dict(self.options),
            "physics": self.physics,
            "collision": self.collision,
            "steps": self.steps,
            "cost_unit": task.metric.unit,
            "optimum": best.cost,
            "optimum_actions": list(best.actions),
            "optimum_solver": best.solver,
            "optimum_reason": best.reason,
            "optimum_wall_s": best.wall_s,
            "not_checked": list(best.not_checked),
            "runs": [
                one.document(best.cost, seen_apart=self.seen_optimum is None)
                for one in self.outcomes
            ],
            "success_rate": self.success.rate,
            "success_ci95": None if success is None else [success.low, success.high],
            "success_of": "training" if self.sampling is None else "sampled",
            "training_success_rate": self.training_success.rate,
            "sampling": None
            if self.sampling is None
            else {
                "episodes": self.sampling.episodes,
                "temperature": self.sampling.temperature,
                "seed": self.sampling.seed,
            },
            "completed_runs": self.completed,
            "completion": _estimate(self.completion),
            "optimal_runs": self.at_most(0.0),
            "zero_percent_runs": self.at_most(_ZERO_PERCENT),
            "one_percent_runs": self.at_most(_ONE_PERCENT),
            "failed_runs": [one.run for one in self.failed],
            "deviation_iqm": _estimate(self.deviation_iqm),
            "cost_iqm": _estimate(self.cost_iqm),
            "success_iqm": _estimate(self.success_iqm),
            "best_cost_seen": self.best_seen,
            "random_baseline": self._baseline_document(),
            "published": [
                {"actions": list(one.actions), "cost": one.cost, "deviation": one.deviation}
                for one in self.published
            ],
            "checks": self.checks,
            "executions": self.executions,
            "wall_s": self.wall_s,
            "steps_per_s": self.steps_per_s,
            "interrupted": self.interrupted,
            "layouts": None if self.layouts is None else self.layouts.document(),
            "shortfall": None if self.shortfall is None else self.shortfall.document(),
            "warm_start": None
            if self.warm_start is None
            else self.warm_start.model_dump(mode="json"),
            "notes": list(self.notes),
        }

    def _baseline_document(self) -> dict[str, Any] | None:
        if self.baseline is None:
            return None
        rate = self.baseline.tally.estimate
        return {
            "mask": self.baseline.mask,
            "episodes": self.baseline.tally.episodes,
            "successes": self.baseline.tally.successes,
            "success_rate": self.baseline.tally.rate,
            "success_ci95": None if rate is None else [rate.low, rate.high],
            "best_cost": self.baseline.best_cost,
            "deviation": deviation(self.baseline.best_cost, self.episode_optimum),
        }


def _estimate(one: Estimate | None) -> dict[str, Any] | None:
    return None if one is None else one.document()
