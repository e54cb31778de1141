"""Options, rewards and trainings that `dqn` and `ppo` share."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import Field, model_validator

from skillplan.env.observation import RewardFunction
from skillplan.env.skill_vector_env import SkillVectorEnv
from skillplan.env.transition_table import COMPLETE, GOES_ON, OUT_OF_TIME
from skillplan.errors import OptionError
from skillplan.model.skill_model import SkillModel
from skillplan.solvers.learned_model import can_model
from skillplan.solvers.learning.episode_training import EpisodeTraining
from skillplan.solvers.learning.learner import (
    MODEL_BASED,
    Learner,
    LearnerOptions,
    is_certain,
    usual_steps,
)
from skillplan.task.task import Task
from skillplan_torch.networks import BLOCK

Width = Annotated[
    int, Field(ge=BLOCK, le=8_192, multiple_of=BLOCK, description="units of a hidden layer [-]")
]
Layers = Annotated[int, Field(ge=0, le=8, description="hidden layers [-]")]
FinalLearningRate = Annotated[
    float, Field(gt=0.0, le=1.0, description="final learning rate of Adam [-]")
]
GoalReward = Annotated[
    float, Field(ge=0.0, le=1e6, description="reward for completing the task [-]")
]
FailureLoss = Annotated[
    float, Field(ge=0.0, le=1e6, description="loss for a skill that cannot be executed [-]")
]
StepsWorth = Annotated[
    float,
    Field(
        ge=0.0,
        le=1e6,
        description="loss for as many typical steps as the step limit allows; scales the rewards "
        "of steps [-]",
    ),
]
StepFloor = Annotated[
    float, Field(ge=1.0, le=1e6, description="greatest loss of a step, in typical steps [-]")
]


class NetworkOptions(LearnerOptions):
    """Options of a learner that trains networks on scaled rewards."""

    # Values of options that a training of version 0.2 does not list; it lists all others.
    LEGACY: ClassVar[Mapping[str, Any]] = {}
    # Values of options that trainings before the release of 0.3.0 do not list.
    NEW: ClassVar[Mapping[str, Any]] = {}

    width: Width = 256
    layers: Layers = 1
    learning_rate: float = Field(
        default=1e-3, gt=0.0, le=1.0, description="initial learning rate of Adam [-]"
    )
    learning_rate_end: FinalLearningRate = 2e-5
    gamma: float = Field(default=1.0, ge=0.0, le=1.0, description="discount factor [-]")
    complete: GoalReward = 4.0
    failure: FailureLoss = 1.0
    steps_worth: StepsWorth = 4.0
    step_floor: StepFloor = 4.0
    count_last_cost: bool = Field(
        default=True,
        description="include the cost of the last skill in the reward; Table II of Moller et al. "
        "gives only the reward for completing [-]",
    )
    planning: bool = Field(
        default=False,
        description="addition: plan episodes with learned action schemas, as learned-model does, "
        "until no better plan is found; needs one task without chance [-]",
    )
    plan_width: int = Field(
        default=32,
        ge=1,
        le=4_096,
        description="planning: plans that the first search expands at equal progress [-]",
    )

    @model_validator(mode="before")
    @classmethod
    def _upgrade(cls, values: Any) -> Any:
        return cls.upgrade(values) if isinstance(values, Mapping) else values

    @classmethod
    def upgrade(cls, stored: Mapping[str, Any]) -> dict[str, Any]:
        """Return the options of a stored training, with the behaviour of its version."""
        missing = cls.model_fields.keys() - stored.keys() - cls.NEW.keys()
        if not missing:
            return {**cls.NEW, **stored}
        legacy = bool(cls.LEGACY) and missing == cls.LEGACY.keys()
        return {**cls.NEW, **cls.LEGACY, **stored} if legacy else dict(stored)


class NetworkLearner(Learner):
    """A learner that trains networks on scaled rewards.

    Attributes
    ----------
    steps_factor
        Factor on the usual number of steps.
    """

    Options = NetworkOptions
    options: NetworkOptions
    steps_factor = 1.0

    @property
    def hidden_layers(self) -> tuple[int, ...]:
        """Units of every hidden layer."""
        return (self.options.width,) * self.options.layers

    def derived(self, tasks: Sequence[Task]) -> dict[str, Any]:
        """Return the values of options that are null.

        Raises
        ------
        OptionError
            If plans are wanted that learned action schemas cannot give, or an episode is to be
            imitated whose cost is left to chance.
        """
        if self.options.planning and not can_model(tasks, self.options.observation):
            raise OptionError(
                f"-O {self.name}.planning=true: plans need one task without chance, and "
                "observation=paper or markov. Leave planning out."
            )
        imitation = getattr(self.options, "imitation", 0.0)
        if imitation and not is_certain(tasks):
            raise OptionError(
                f"-O {self.name}.imitation={imitation:g}: the cheapest episode is the "
                "best one on one task without chance only. Leave imitation out."
            )
        return self.where_null(steps=usual_steps(tasks, self.steps_factor))

    def figures(self, model: SkillModel) -> dict[str, Any]:
        """Return the learner's full name if it plans its episodes."""
        return {"learner": f"{self.name}{MODEL_BASED}"} if self.options.planning else {}

    def where_null(self, **values: Any) -> dict[str, Any]:
        """Return the values of options that are null."""
        return {
            name: value for name, value in values.items() if getattr(self.options, name) is None
        }


class NetworkTraining(EpisodeTraining):
    """Runs in progress that train networks on scaled rewards.

    Parameters
    ----------
    options, env, seeds, steps
        As for `EpisodeTraining`.
    """

    def __init__(
        self, options: NetworkOptions, env: SkillVectorEnv, seeds: Sequence[int], steps: int
    ) -> None:
        # Sums must not depend on the number of cores; for small ones, one thread is fastest.
        torch.set_num_threads(1)
        super().__init__(options, env, seeds, steps)
        self._scaling = RewardScaling.of(
            env.models[0].task, options.objective, counts_last=options.count_last_cost
        )

    def _fail(self, run: int) -> None:
        """Mark a run whose network diverged."""
        reason = f"its network is no longer finite after {self.steps:,} steps; lower learning_rate"
        self.failed.setdefault(run, reason)


@dataclass(frozen=True)
class RewardScaling:
    """Splits rewards into step rewards, for costs, and end rewards.

    Rewards of the two kinds differ a thousandfold. Learners therefore scale rewards of steps to
    a typical one, and have their own rewards for ends.

    Parameters
    ----------
    complete, out_of_time
        The environment's reward for completing, and for reaching the step limit.
    per_cost
        Factor of the reward for the last skill's cost that the environment left out; 0 if it gave
        that reward.
    counts_last
        True to add that reward on completion. Without it, as in Table II of Moller et al., the
        path of most reward ends with a long motion.
    typical
        Mean loss of a skill at the start of the task, >= 0.
    """

    complete: float
    out_of_time: float
    per_cost: float
    counts_last: bool
    typical: float

    @classmethod
    def of(cls, task: Task, objective: str, *, counts_last: bool) -> RewardScaling:
        """Return the scaling of a task's rewards."""
        rewards = RewardFunction.of(task, objective)
        by_scheme = rewards.scheme is not None
        per_cost = float(getattr(task.reward, "per_cost", 0.0)) if by_scheme else 0.0
        late = rewards.out_of_time
        if by_scheme and not hasattr(rewards.scheme, "out_of_time"):
            late = 0.0  # the step at the limit is rewarded as any other
        losses = list(_losses(task, rewards))
        typical = sum(losses) / max(1, len(losses))
        return cls(rewards.complete, late, per_cost, counts_last, typical)

    def of_steps(
        self, rewards: NDArray[np.float64], costs: NDArray[np.float64], ends: NDArray[np.int8]
    ) -> NDArray[np.float64]:
        """Return the rewards of steps for their costs, 0 for failures; all of shape (n,)."""
        last = self.per_cost * costs
        completing = rewards - self.complete + last * self.counts_last
        late = rewards - self.out_of_time + last
        over = np.where(ends == OUT_OF_TIME, late, 0.0)
        over = np.where(ends == COMPLETE, completing, over)
        return np.where(ends == GOES_ON, rewards, over)

    def factor(self, steps_worth: float, step_limit: int) -> float:
        """Return the factor on rewards of steps; 0 if no step costs anything."""
        return steps_worth / (step_limit * self.typical) if self.typical else 0.0


def _losses(task: Task, rewards: RewardFunction) -> Iterator[float]:
    """Yield the loss of every skill at the start of the task, if its cost is defined there."""
    start = task.initial
    for skill in task.skills:
        try:
            cost = skill.cost.at(start)
        except ValueError:
            continue  # no path leads there, such as to a tool that is attached already
        yield abs(rewards.of_step(start, skill.name, cost, goal=False, out_of_time=False))
