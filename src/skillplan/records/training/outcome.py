"""What became of one training run: its policies, followed greedily and by chance, and its record.

A run is judged by what its policy does on the model, never by what the learner says of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Any, Literal

from skillplan.records.interval import Estimate, share
from skillplan.solvers.gap import deviation

if TYPE_CHECKING:  # a table of results needs no environment
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
    """

    steps: int
    every: Tally = Tally()
    recent: Tally = Tally()
    first_success_step: int | None = None
    best_cost: float | None = None
    best_actions: tuple[int, ...] = ()
    wall_s: float | None = None


def training_record(
    episodes: Sequence[Episode], steps: int, wall_s: float | None = None
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
    """
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
