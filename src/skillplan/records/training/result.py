"""Results of several training runs: the documents ``skillplan.training/1`` and ``trainings/1``.

A run is judged by its policy on the model, never by a claim of its learner.
"""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

from skillplan.records import schemas
from skillplan.records.evaluation import Optimum
from skillplan.records.interval import Estimate, interquartile_mean, share
from skillplan.records.training.published_runs import PublishedRun, get_published_runs
from skillplan.records.training.run_folder import WarmStartRecord
from skillplan.records.training.shortfall import Shortfall
from skillplan.solvers.learning.learner import MODEL_BASED
from skillplan.solvers.learning.network_policy import GREEDY, ActionRule
from skillplan.solvers.solution import deviation
from skillplan.task.task import Task

if TYPE_CHECKING:
    from skillplan.solvers.learning.learner import Episode


RECENT_STEPS = 2_000
"""Length of the last part of a training that its success rate is of [steps]."""


def score_of(cost: float | None, reference: float) -> float:
    """Return reference / cost, at most 1; 0 for a run that does not complete the task.

    Parameters
    ----------
    reference
        Lowest cost, usually the proved optimum.
    """
    if cost is None:
        return 0.0
    return 1.0 if cost <= reference else reference / cost


class RunStatus(StrEnum):
    """Status of a run.

    ``complete``: its policy completes the task. ``incomplete``: it does not. ``failed``: the run
    could not continue, or cannot be read.
    """

    COMPLETE = "complete"
    INCOMPLETE = "incomplete"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class Tally:
    """Number of successful episodes.

    Raises
    ------
    ValueError
        If a count is out of range.
    """

    successes: int = 0
    episodes: int = 0

    def __post_init__(self) -> None:
        if not 0 <= self.successes <= self.episodes:
            raise ValueError(f"{self.successes} of {self.episodes} episodes make no sense.")

    def __add__(self, other: Tally) -> Tally:
        return Tally(self.successes + other.successes, self.episodes + other.episodes)

    @property
    def rate(self) -> float | None:
        """Success rate, in [0, 1]; None without episodes."""
        return self.successes / self.episodes if self.episodes else None

    @property
    def estimate(self) -> Estimate | None:
        """Success rate with Wilson's interval; None without episodes."""
        return share(self.successes, self.episodes)


@dataclass(frozen=True, slots=True)
class GreedyRollOut:
    """A policy that was followed greedily on the model.

    Parameters
    ----------
    kept
        Kind of the policy: the ``best`` of the training, or the ``last``.
    actions, skills
        Its actions under nominal outcomes, by number and by name; a skill that fails ends it.
    cost
        Cost in the task's metric, under chance the exact expected cost; None if the policy does not
        complete the task with certainty.
    step
        Environment step at which the policy was kept, if known.
    reason
        Why it does not complete the task; empty if it does.

    Raises
    ------
    ValueError
        If there is a cost and a reason against it, or neither.
    """

    kept: Literal["best", "last"]
    actions: tuple[int, ...]
    skills: tuple[str, ...]
    cost: float | None
    step: int | None = None
    reason: str = ""

    def __post_init__(self) -> None:
        if (self.cost is None) != bool(self.reason):
            raise ValueError("A roll-out either completes the task, or there is a reason.")

    @property
    def complete(self) -> bool:
        """True if it completes the task."""
        return self.cost is not None


@dataclass(frozen=True, slots=True)
class TrainingRecord:
    """Summary of the training episodes of a run.

    Parameters
    ----------
    recent
        Episodes that ended in the last `RECENT_STEPS` steps.
    first_success_step
        Environment step of the first success, if any.
    best_actions
        Actions of that episode; the first of equals.
    wall_s
        Duration of the run's group [s], if known.
    planned
        Number of episodes planned with a learned model.
    settled_step
        Environment steps after which a run that plans found no better plan; None before.
    explores
        True if a run explored because a learned model does not fit the task.
    """

    steps: int
    every: Tally = Tally()
    recent: Tally = Tally()
    first_success_step: int | None = None
    best_cost: float | None = None
    best_actions: tuple[int, ...] = ()
    wall_s: float | None = None
    planned: int = 0
    settled_step: int | None = None
    explores: bool = False


def summarise_training(
    episodes: Sequence[Episode],
    steps: int,
    wall_s: float | None = None,
    figures: Mapping[str, float] = MappingProxyType({}),
) -> TrainingRecord:
    """Summarise the episodes of one run.

    Parameters
    ----------
    figures
        The run's latest figures.
    """
    settled = figures.get("settled_step")
    successes = [episode for episode in episodes if episode.success]
    recent = [episode for episode in episodes if episode.step > steps - RECENT_STEPS]
    best = min(successes, key=lambda episode: episode.cost, default=None)
    return TrainingRecord(
        steps,
        Tally(len(successes), len(episodes)),
        Tally(sum(episode.success for episode in recent), len(recent)),
        successes[0].step if successes else None,
        None if best is None else best.cost,
        () if best is None else best.actions,
        wall_s,
        sum(episode.planned for episode in episodes),
        None if settled is None else int(settled),
        "explores" in figures,
    )


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """Outcome of one run.

    Parameters
    ----------
    failure
        Why it could not continue or be read; empty if neither.
    best, last
        Greedy roll-outs of its policies, if any.
    sampled
        Sampled roll-outs of its reported policy, if any.
    followed
        Greedy roll-outs of its reported policy under chance, if any.
    training
        Summary of its episodes, if known.
    """

    run: int
    seed: int
    failure: str = ""
    best: GreedyRollOut | None = None
    last: GreedyRollOut | None = None
    sampled: Tally | None = None
    training: TrainingRecord | None = None
    followed: Tally | None = None

    @property
    def greedy(self) -> GreedyRollOut | None:
        """Roll-out of the reported policy: the best one, or else the last."""
        return self.last if self.best is None else self.best

    @property
    def status(self) -> RunStatus:
        """Status of the run."""
        if self.failure:
            return RunStatus.FAILED
        complete = self.greedy is not None and self.greedy.complete
        return RunStatus.COMPLETE if complete else RunStatus.INCOMPLETE

    @property
    def reason(self) -> str:
        """Why it has failed, or does not complete the task; empty if it does."""
        if self.failure:
            return self.failure
        return "it has no policy" if self.greedy is None else self.greedy.reason

    @property
    def cost(self) -> float | None:
        """Cost of its policy; None if it does not complete the task."""
        return None if self.greedy is None else self.greedy.cost

    @property
    def best_cost_seen(self) -> float | None:
        """Lowest cost of a training episode; None without success."""
        return None if self.training is None else self.training.best_cost

    @property
    def greedy_tally(self) -> Tally:
        """Greedy roll-outs: several under chance, otherwise one; none without a policy."""
        if self.followed is not None:
            return self.followed
        return Tally() if self.greedy is None else Tally(int(self.greedy.complete), 1)

    def score(self, reference: float | None) -> float | None:
        """Return reference / cost, 0 if the run does not complete the task.

        Parameters
        ----------
        reference
            Lowest cost, usually the proved optimum; None if it is unknown.
        """
        return None if reference is None else score_of(self.cost, reference)

    @property
    def tally(self) -> Tally:
        """Episodes of its success rate: sampled ones, or else the last of the training."""
        if self.sampled is not None:
            return self.sampled
        return Tally() if self.training is None else self.training.recent

    def document(self, optimum: float | None, *, seen_apart: bool = False) -> dict[str, Any]:
        """Return the run as JSON values.

        Parameters
        ----------
        seen_apart
            True if training episodes must not be compared with the optimum: it is an expected cost,
            or the training used other layouts.
        """
        greedy, training = self.greedy, self.training
        ci95 = None if (rate := self.tally.estimate) is None else [rate.low, rate.high]
        return {
            "run": self.run,
            "seed": self.seed,
            "status": self.status.value,
            "reason": self.reason,
            "actions": [] if greedy is None else list(greedy.actions),
            "skills": [] if greedy is None else list(greedy.skills),
            "cost": self.cost,
            "deviation": deviation(self.cost, optimum),
            "score": self.score(optimum),
            "kept": None if greedy is None else greedy.kept,
            "kept_step": None if greedy is None else greedy.step,
            "last": None if self.last is None else _roll_out_document(self.last, optimum),
            "greedy_success_rate": self.greedy_tally.rate,
            "success_rate": self.tally.rate,
            "success_ci95": ci95,
            "sampled_episodes": 0 if self.sampled is None else self.sampled.episodes,
            "training_success_rate": None if training is None else training.recent.rate,
            "episodes": None if training is None else training.every.episodes,
            "successes": None if training is None else training.every.successes,
            "best_cost_seen": self.best_cost_seen,
            "best_deviation_seen": deviation(self.best_cost_seen, None if seen_apart else optimum),
            "best_actions_seen": [] if training is None else list(training.best_actions),
            "completed_step": None if training is None else training.first_success_step,
            "steps": None if training is None else training.steps,
            "wall_s": None if training is None else training.wall_s,
            **self._plans_document(),
        }

    def _plans_document(self) -> dict[str, Any]:
        """Return the plans of the run as JSON values; empty without a learned model."""
        record = self.training
        if record is None or not (record.planned or record.explores):
            return {}
        return {
            "planned_episodes": record.planned,
            "settled_step": record.settled_step,
            "explores": record.explores,
        }


def _roll_out_document(roll_out: GreedyRollOut, optimum: float | None) -> dict[str, Any]:
    return {
        "actions": list(roll_out.actions),
        "skills": list(roll_out.skills),
        "cost": roll_out.cost,
        "deviation": deviation(roll_out.cost, optimum),
        "reason": roll_out.reason,
        "step": roll_out.step,
    }


@dataclass(frozen=True, slots=True)
class LayoutOutcome:
    """Results of all policies on one unseen layout.

    Parameters
    ----------
    optimum
        Its proved optimum, and the duration of the proof.
    answers
        Greedy roll-outs, one per run.
    answer_s
        Duration of each roll-out [s], including the model's verdicts.

    Raises
    ------
    ValueError
        If there are not as many durations as roll-outs.
    """

    name: str
    optimum: Optimum
    answers: tuple[GreedyRollOut, ...]
    answer_s: tuple[float, ...]

    def __post_init__(self) -> None:
        if len(self.answers) != len(self.answer_s):
            raise ValueError(f"Layout {self.name!r} has answers without a time.")

    @property
    def completed(self) -> int:
        """Number of policies that complete it."""
        return sum(answer.complete for answer in self.answers)

    @property
    def deviations(self) -> list[float]:
        """Deviations of the policies that complete it; empty without a proved optimum."""
        values = [deviation(answer.cost, self.optimum.cost) for answer in self.answers]
        return [value for value in values if value is not None]

    def document(self) -> dict[str, Any]:
        """Return the layout as JSON values."""
        return {
            "name": self.name,
            "optimum": self.optimum.cost,
            "optimum_reason": self.optimum.reason,
            "optimum_wall_s": self.optimum.wall_s,
            "completed": self.completed,
            "costs": [answer.cost for answer in self.answers],
            "deviations": [deviation(answer.cost, self.optimum.cost) for answer in self.answers],
            "actions": [list(answer.actions) for answer in self.answers],
            "answer_s": list(self.answer_s),
        }


@dataclass(frozen=True)
class LayoutsResult:
    """Results on layouts of a family that no policy has learned on.

    Parameters
    ----------
    learned_on
        Number of layouts of the family in the training; 0 for the file's own alone.
    training_s
        Duration of the training of all runs [s], if known.
    """

    rows: tuple[LayoutOutcome, ...]
    learned_on: int
    training_s: float | None = None

    @property
    def complete_share(self) -> Estimate | None:
        """Share of answers that complete their layout."""
        answers = sum(len(row.answers) for row in self.rows)
        return share(sum(row.completed for row in self.rows), answers)

    @property
    def deviation_iqm(self) -> Estimate | None:
        """Interquartile mean over the layouts of the mean deviation of complete answers."""
        means = [statistics.fmean(row.deviations) for row in self.rows if row.deviations]
        return interquartile_mean(means)

    @property
    def answer_s(self) -> float | None:
        """Median duration of an answer [s]."""
        times = [answer_s for row in self.rows for answer_s in row.answer_s]
        return statistics.median(times) if times else None

    @property
    def proof_s(self) -> float | None:
        """Median duration of a successful proof [s], if any."""
        times = [
            row.optimum.wall_s
            for row in self.rows
            if row.optimum.cost is not None and row.optimum.wall_s is not None
        ]
        return statistics.median(times) if times else None

    def at_most(self, excess: float) -> int:
        """Return the number of answers with at most this deviation."""
        return sum(value <= excess for row in self.rows for value in row.deviations)

    def document(self) -> dict[str, Any]:
        """Return the layouts as JSON values."""
        complete, off = self.complete_share, self.deviation_iqm
        return {
            "learned_on": self.learned_on,
            "answers": sum(len(row.answers) for row in self.rows),
            "complete_share": None if complete is None else complete.document(),
            "deviation_iqm": None if off is None else off.document(),
            "one_percent_answers": self.at_most(0.01),
            "answer_s": self.answer_s,
            "proof_s": self.proof_s,
            "training_s": self.training_s,
            "rows": [row.document() for row in self.rows],
        }


# A deviation below half of the last digit is printed as 0.00 %.
_ZERO_PERCENT, _ONE_PERCENT = 0.5e-4, 0.01


@dataclass(frozen=True, slots=True)
class RandomBaseline:
    """Episodes with uniformly random actions among the allowed ones.

    Parameters
    ----------
    mask
        Restriction of the actions: ``none``, ``applicable`` or ``feasible``.
    """

    tally: Tally
    best_cost: float | None
    mask: str


@dataclass(frozen=True, slots=True)
class Sampling:
    """Sampled roll-outs.

    Parameters
    ----------
    episodes
        Number per run.
    temperature
        Temperature for all policies; None for their own rule.
    own_rule
        How the policies drew their actions at the end of the training.
    """

    episodes: int
    temperature: float | None
    seed: int
    own_rule: ActionRule = GREEDY

    @property
    def rule(self) -> ActionRule:
        """The rule in use."""
        if self.temperature is None:
            return self.own_rule
        return ActionRule("softmax", self.temperature)

    def document(self) -> dict[str, Any]:
        """Return the roll-outs as JSON values."""
        rule = self.rule
        return {
            "episodes": self.episodes,
            "temperature": rule.value if rule.kind == "softmax" else None,
            "epsilon": None if rule.kind == "softmax" else rule.value,
            "own": self.temperature is None,
            "seed": self.seed,
        }


@dataclass(frozen=True)
class TrainingResult:
    """Several runs of one learner on one task.

    Parameters
    ----------
    task
        The task that was learned, or that the policies were evaluated on.
    run_dir
        Folder of the runs as the user named it.
    steps
        Environment steps requested per run.
    baseline
        Result of random actions, if measured.
    sampling
        Sampled roll-outs; None if success rates refer to the training.
    checks, executions
        Queries answered by back ends, and skills executed by an engine for them.
    steps_per_s
        Environment steps of all runs per second, if any were done.
    interrupted
        True if the runs stopped before they had done their steps.
    layouts
        Results on unseen layouts, if any.
    shortfall
        Analysis of the runs that do not complete the task, if any.
    family
        True if the runs learned on other layouts: their training episodes must not be compared with
        the optimum of the task.
    warm_start
        Networks that the runs started from. Default: random ones.
    notes
        Further lines below the table, each ``label      text``.
    """

    task: Task
    run_dir: str
    solver: str
    steps: int
    outcomes: tuple[RunOutcome, ...]
    optimum: Optimum
    options: Mapping[str, Any] = field(default_factory=dict)
    derived_options: tuple[str, ...] | None = None
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
        """Name of the learner, marked if it plans its episodes in a learned model."""
        return f"{self.solver}{MODEL_BASED if self.options.get('planning') else ''}"

    @property
    def planned(self) -> bool:
        """True if runs planned their episodes with a learned model.

        Their plans depend little on the seed, so costs of several seeds get no
        interval.
        """
        records = [run.training for run in self.outcomes if run.training is not None]
        return any(record.planned and not record.explores for record in records)

    @property
    def acts_alike(self) -> bool:
        """True if all sampled roll-outs of a policy are the same: no rule or task is random."""
        rule = None if self.sampling is None else self.sampling.rule
        return rule is not None and rule == GREEDY and not self.chance

    @property
    def greedy_success(self) -> Tally:
        """Greedy roll-outs of all runs together."""
        return sum((outcome.greedy_tally for outcome in self.outcomes), Tally())

    def scores(self, reference: float | None) -> list[float]:
        """Return the score of every run: see `RunOutcome.score`."""
        scores = [outcome.score(reference) for outcome in self.outcomes]
        return [score for score in scores if score is not None]

    @property
    def score_iqm(self) -> Estimate | None:
        """Interquartile mean of the scores of all runs; None without a proved optimum."""
        return self._over_runs(interquartile_mean(self.scores(self.optimum.cost)))

    @property
    def success(self) -> Tally:
        """Episodes of all runs together: sampled ones, or else the last of the training."""
        return sum((outcome.tally for outcome in self.outcomes), Tally())

    @property
    def training_success(self) -> Tally:
        """Last training episodes of all runs together."""
        known = [
            outcome.training.recent for outcome in self.outcomes if outcome.training is not None
        ]
        return sum(known, Tally())

    @property
    def recent_steps(self) -> int:
        """Length of the last part of the training that success rates are of [steps]."""
        done = [outcome.training.steps for outcome in self.outcomes if outcome.training is not None]
        return min(RECENT_STEPS, max(done, default=RECENT_STEPS))

    @property
    def deviations(self) -> list[float]:
        """Deviations of the complete runs from the optimum, in order."""
        values = [deviation(outcome.cost, self.optimum.cost) for outcome in self.outcomes]
        return [value for value in values if value is not None]

    @property
    def completed(self) -> int:
        """Number of runs that complete the task."""
        return sum(outcome.cost is not None for outcome in self.outcomes)

    @property
    def completion(self) -> Estimate | None:
        """Share of runs that complete the task; None without runs.

        It has Wilson's interval unless the runs planned.
        """
        return self._over_runs(share(self.completed, len(self.outcomes)))

    @property
    def failed(self) -> list[RunOutcome]:
        """The runs that could not continue or cannot be read."""
        return [outcome for outcome in self.outcomes if outcome.status is RunStatus.FAILED]

    @property
    def chance(self) -> bool:
        """True if costs are expected costs, so that one episode may cost less than the optimum."""
        return not self.task.deterministic

    @property
    def episode_optimum(self) -> float | None:
        """Lower bound on the cost of one episode; None under chance, or without a proof."""
        return None if self.chance else self.optimum.cost

    @property
    def seen_optimum(self) -> float | None:
        """Lower bound on the cost of a training episode; None after a training on other layouts."""
        return None if self.family else self.episode_optimum

    @property
    def best_seen(self) -> float | None:
        """Lowest cost of a training episode of any run; None without success."""
        costs = [
            outcome.best_cost_seen
            for outcome in self.outcomes
            if outcome.best_cost_seen is not None
        ]
        return min(costs, default=None)

    def at_most(self, excess: float) -> int | None:
        """Return the number of runs with at most this deviation; None without a proved optimum."""
        if self.optimum.cost is None:
            return None
        return sum(value <= excess for value in self.deviations)

    @property
    def deviation_iqm(self) -> Estimate | None:
        """Interquartile mean of the deviations of complete runs."""
        return self._over_runs(interquartile_mean(self.deviations))

    @property
    def cost_iqm(self) -> Estimate | None:
        """Interquartile mean of the costs of complete runs."""
        costs = [outcome.cost for outcome in self.outcomes if outcome.cost is not None]
        return self._over_runs(interquartile_mean(costs))

    @property
    def success_iqm(self) -> Estimate | None:
        """Interquartile mean of the success rates of all runs that have one."""
        rates = [outcome.tally.rate for outcome in self.outcomes]
        return self._over_runs(interquartile_mean([rate for rate in rates if rate is not None]))

    def _over_runs(self, estimate: Estimate | None) -> Estimate | None:
        """Return an estimate over the runs, without its interval if they planned."""
        return estimate.bare if estimate is not None and self.planned else estimate

    @property
    def published(self) -> tuple[PublishedRun, ...]:
        """The paper's runs, if the task is the paper's; otherwise none."""
        return get_published_runs(self.task, self.optimum.cost)

    def document(self) -> dict[str, Any]:
        """Return the JSON document ``skillplan.training/1``."""
        task, best = self.task, self.optimum
        success = None if self.acts_alike else self.success.estimate
        return {
            "schema": schemas.TRAINING,
            "run_dir": self.run_dir,
            "task": {"name": task.name, "kind": task.kind, "sha256": task.sha256},
            "solver": self.solver,
            "options": dict(self.options),
            "derived_options": None if self.derived_options is None else list(self.derived_options),
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
                outcome.document(best.cost, seen_apart=self.seen_optimum is None)
                for outcome in self.outcomes
            ],
            "success_rate": self.success.rate,
            "success_ci95": None if success is None else [success.low, success.high],
            "success_of": "training" if self.sampling is None else "sampled",
            "training_success_rate": self.training_success.rate,
            "sampling": None if self.sampling is None else self.sampling.document(),
            "greedy_success_rate": self.greedy_success.rate,
            "deterministic": self.planned,
            "completed_runs": self.completed,
            "completion": _estimate(self.completion),
            "optimal_runs": self.at_most(0.0),
            "zero_percent_runs": self.at_most(_ZERO_PERCENT),
            "one_percent_runs": self.at_most(_ONE_PERCENT),
            "failed_runs": [outcome.run for outcome in self.failed],
            "score_iqm": _estimate(self.score_iqm),
            "deviation_iqm": _estimate(self.deviation_iqm),
            "cost_iqm": _estimate(self.cost_iqm),
            "success_iqm": _estimate(self.success_iqm),
            "best_cost_seen": self.best_seen,
            "random_baseline": self._baseline_document(),
            "published": [
                {"actions": list(run.actions), "cost": run.cost, "deviation": run.deviation}
                for run in self.published
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


def _estimate(estimate: Estimate | None) -> dict[str, Any] | None:
    return None if estimate is None else estimate.document()
