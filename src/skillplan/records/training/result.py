"""Several training runs of one solver on one task: the document ``skillplan.training/1``."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

from skillplan.records import schemas
from skillplan.records.interval import Estimate, interquartile_mean, share
from skillplan.records.optimum import Optimum
from skillplan.records.training.published_runs import PublishedRun, published_runs
from skillplan.records.training.run_folder import WarmStartRecord
from skillplan.records.training.shortfall import Shortfall
from skillplan.solvers.gap import deviation
from skillplan.solvers.learning.learner import MODEL_BASED
from skillplan.task.task import Task

if TYPE_CHECKING:
    from skillplan.solvers.learning.learner import Episode


RECENT_STEPS = 2_000
"""A run's success at its end is that of the episodes that ended in so many last steps."""


class RunStatus(StrEnum):
    """How a run stands.

    ``complete``: its policy completes the task. ``incomplete``: it does not. ``failed``: the run
    could not go on, or nothing of it can be read.
    """

    COMPLETE = "complete"
    INCOMPLETE = "incomplete"
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class Tally:
    """How many episodes succeeded.

    Parameters
    ----------
    successes, episodes
        So many of so many, 0 <= successes <= episodes.

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
        """The share of successes, in [0, 1]; None of no episode."""
        return self.successes / self.episodes if self.episodes else None

    @property
    def estimate(self) -> Estimate | None:
        """The share with its interval after Wilson; None of no episode."""
        return share(self.successes, self.episodes)


@dataclass(frozen=True, slots=True)
class GreedyRollOut:
    """A policy that was followed without any chance of its own, on the model.

    Parameters
    ----------
    kept
        Which policy: the ``best`` that was kept during training, or the ``last``.
    actions, skills
        What it does while every outcome is the nominal one, by number and by name; a skill that
        could not be executed ends it.
    cost
        In the task's metric: of the sequence, or under chance what the policy costs on average,
        exactly. None where it does not complete the task with certainty.
    step
        After how many environment steps the policy was kept; None where nobody knows.
    reason
        Why it does not complete the task; empty where it does.

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
        """Whether it completes the task."""
        return self.cost is not None


@dataclass(frozen=True, slots=True)
class TrainingRecord:
    """What the episodes of a run came to while it learned.

    Parameters
    ----------
    steps
        Environment steps done, >= 0.
    every
        All episodes.
    recent
        Those that ended in the last `RECENT_STEPS` steps.
    first_success_step
        After how many steps the task was completed for the first time; None if never.
    best_cost
        The least that a successful episode cost; None without one.
    best_actions
        What was done in it, the first of equals.
    wall_s
        How long the run took [s], together with those that learned beside it; None where
        nobody has measured it.
    planned
        Number of episodes planned with a learned model.
    settled_step
        Environment steps after which a run that plans found no better plan; None before.
    explores
        Whether a run explored because a learned model does not fit the task.
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


def training_record(
    episodes: Sequence[Episode],
    steps: int,
    wall_s: float | None = None,
    figures: Mapping[str, float] = MappingProxyType({}),
) -> TrainingRecord:
    """Return what the episodes of one run came to.

    Parameters
    ----------
    episodes
        Of one run, in order.
    steps
        Environment steps that the run has done.
    wall_s
        How long that took [s].
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
    """One run of several.

    Parameters
    ----------
    run, seed
        Its number, from 0, and what governed its randomness.
    failure
        Why it could not go on, or cannot be read; empty where all is well.
    best, last
        Its policies, followed greedily; None where there is none.
    sampled
        Roll-outs of its reported policy, each action drawn by its score; None where none
        were made.
    training
        What its episodes came to; None where nobody knows.
    """

    run: int
    seed: int
    failure: str = ""
    best: GreedyRollOut | None = None
    last: GreedyRollOut | None = None
    sampled: Tally | None = None
    training: TrainingRecord | None = None

    @property
    def greedy(self) -> GreedyRollOut | None:
        """The roll-out of the run's reported policy: the best evaluated one, or else the last."""
        return self.last if self.best is None else self.best

    @property
    def status(self) -> RunStatus:
        """How it stands."""
        if self.failure:
            return RunStatus.FAILED
        complete = self.greedy is not None and self.greedy.complete
        return RunStatus.COMPLETE if complete else RunStatus.INCOMPLETE

    @property
    def reason(self) -> str:
        """Why it has failed, or does not complete the task; empty where it does."""
        if self.failure:
            return self.failure
        return "it has no policy" if self.greedy is None else self.greedy.reason

    @property
    def cost(self) -> float | None:
        """What its policy costs; None where it does not complete the task."""
        return None if self.greedy is None else self.greedy.cost

    @property
    def best_cost_seen(self) -> float | None:
        """The least that an episode of its training cost; None where none succeeded."""
        return None if self.training is None else self.training.best_cost

    @property
    def tally(self) -> Tally:
        """The episodes that its success rate is of: sampled ones, or else the last of training."""
        if self.sampled is not None:
            return self.sampled
        return Tally() if self.training is None else self.training.recent

    def document(self, optimum: float | None, *, seen_apart: bool = False) -> dict[str, Any]:
        """Return the run as JSON values.

        Parameters
        ----------
        optimum
            The proved optimum, or None.
        seen_apart
            Whether what was seen while learning is not to be held to it: it is an expected cost,
            or other layouts were learned on.
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
            "kept": None if greedy is None else greedy.kept,
            "kept_step": None if greedy is None else greedy.step,
            "last": None if self.last is None else _roll_out_document(self.last, optimum),
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
        """Return how a run planned with a learned model; empty for one that never did."""
        record = self.training
        if record is None or not (record.planned or record.explores):
            return {}
        return {
            "planned_episodes": record.planned,
            "settled_step": record.settled_step,
            "explores": record.explores,
        }


def _roll_out_document(one: GreedyRollOut, optimum: float | None) -> dict[str, Any]:
    return {
        "actions": list(one.actions),
        "skills": list(one.skills),
        "cost": one.cost,
        "deviation": deviation(one.cost, optimum),
        "reason": one.reason,
        "step": one.step,
    }


@dataclass(frozen=True, slots=True)
class LayoutOutcome:
    """What became of one layout.

    Parameters
    ----------
    name
        The layout's name, such as ``inverter-board/40``.
    optimum
        What it costs at least, and how long proving that took.
    answers
        What the policy of every run does, greedily.
    answer_s
        How long each of them took [s], the model's verdicts included.

    Raises
    ------
    ValueError
        If there are not as many times as answers.
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
        """How many policies complete it."""
        return sum(answer.complete for answer in self.answers)

    @property
    def deviations(self) -> list[float]:
        """Deviations of those that complete it; empty where no optimum is proved."""
        found = [deviation(answer.cost, self.optimum.cost) for answer in self.answers]
        return [one for one in found if one is not None]

    def document(self) -> dict[str, Any]:
        """Return the layout as JSON values."""
        return {
            "name": self.name,
            "optimum": self.optimum.cost,
            "optimum_reason": self.optimum.reason,
            "optimum_wall_s": self.optimum.wall_s,
            "completed": self.completed,
            "costs": [answer.cost for answer in self.answers],
            "deviations": [deviation(one.cost, self.optimum.cost) for one in self.answers],
            "actions": [list(one.actions) for one in self.answers],
            "answer_s": list(self.answer_s),
        }


@dataclass(frozen=True)
class LayoutsResult:
    """Several layouts of a family that no policy has learned on.

    Parameters
    ----------
    rows
        One for every layout, at least one.
    learned_on
        On how many layouts of the family the policies were learned; 0 on the file's own alone.
    training_s
        How long the training of all runs took [s]; None where nobody knows.
    """

    rows: tuple[LayoutOutcome, ...]
    learned_on: int
    training_s: float | None = None

    @property
    def complete_share(self) -> Estimate | None:
        """The share of answers that complete their layout."""
        answers = sum(len(row.answers) for row in self.rows)
        return share(sum(row.completed for row in self.rows), answers)

    @property
    def deviation_iqm(self) -> Estimate | None:
        """Interquartile mean over the layouts of the mean deviation of answers that complete."""
        means = [statistics.fmean(row.deviations) for row in self.rows if row.deviations]
        return interquartile_mean(means)

    @property
    def answer_s(self) -> float | None:
        """Median time of an answer [s]."""
        times = [one for row in self.rows for one in row.answer_s]
        return statistics.median(times) if times else None

    @property
    def proof_s(self) -> float | None:
        """Median time in which an optimum was proved [s]; None where none was."""
        times = [
            row.optimum.wall_s
            for row in self.rows
            if row.optimum.cost is not None and row.optimum.wall_s is not None
        ]
        return statistics.median(times) if times else None

    def at_most(self, excess: float) -> int:
        """Return how many answers deviate by no more."""
        return sum(one <= excess for row in self.rows for one in row.deviations)

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
        return sum((outcome.tally for outcome in self.outcomes), Tally())

    @property
    def training_success(self) -> Tally:
        """The last episodes of the training of all runs together."""
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
        """Deviations from the optimum of the runs that complete the task, in order."""
        found = [deviation(outcome.cost, self.optimum.cost) for outcome in self.outcomes]
        return [one for one in found if one is not None]

    @property
    def completed(self) -> int:
        """How many runs complete the task."""
        return sum(outcome.cost is not None for outcome in self.outcomes)

    @property
    def completion(self) -> Estimate | None:
        """Share of the runs that complete the task, with Wilson's interval; None of no runs."""
        return share(self.completed, len(self.outcomes))

    @property
    def failed(self) -> list[RunOutcome]:
        """The runs that could not go on or cannot be read."""
        return [outcome for outcome in self.outcomes if outcome.status is RunStatus.FAILED]

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
        costs = [
            outcome.best_cost_seen
            for outcome in self.outcomes
            if outcome.best_cost_seen is not None
        ]
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
        return interquartile_mean(
            [outcome.cost for outcome in self.outcomes if outcome.cost is not None]
        )

    @property
    def success_iqm(self) -> Estimate | None:
        """Interquartile mean of the success rates of all runs that have one."""
        rates = [outcome.tally.rate for outcome in self.outcomes]
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
                outcome.document(best.cost, seen_apart=self.seen_optimum is None)
                for outcome in self.outcomes
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


def trainings_document(results: Sequence[TrainingResult]) -> dict[str, Any]:
    """Return the document: a training's own for each."""
    return {"schema": schemas.TRAININGS, "rows": [result.document() for result in results]}
