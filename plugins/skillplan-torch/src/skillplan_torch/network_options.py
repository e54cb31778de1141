"""The options that every learner of this plugin has, written once.

An algorithm with another default assigns it to the same type, such as ``width: Width = 64``; one
where an option means more says so by ``Annotated[Width, Field(description=...)]``.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from skillplan.solvers.learning.learner import LearnerOptions
from skillplan_torch.batched_network import BLOCK

Width = Annotated[
    int,
    Field(
        ge=BLOCK,
        le=8_192,
        multiple_of=BLOCK,
        description="units of a hidden layer, a multiple of 32 [-]",
    ),
]
Layers = Annotated[int, Field(ge=0, le=8, description="hidden layers [-]")]
FinalLearningRate = Annotated[
    float, Field(gt=0.0, le=1.0, description="step size of Adam, in the end [-]")
]
GoalReward = Annotated[
    float,
    Field(
        ge=0.0,
        le=1e6,
        description="reward for completing the task, in place of the environment's [-]",
    ),
]
FailureLoss = Annotated[
    float,
    Field(ge=0.0, le=1e6, description="loss by failing, in place of the environment's reward [-]"),
]
StepsWorth = Annotated[
    float,
    Field(
        ge=0.0,
        le=1e6,
        description="loss by as many typical steps as the step limit allows, to which the "
        "rewards of steps are scaled [-]",
    ),
]
StepFloor = Annotated[
    float,
    Field(ge=1.0, le=1e6, description="no step loses more than this many typical ones [-]"),
]


class NetworkOptions(LearnerOptions):
    """Options of a learner that trains networks on scaled rewards."""

    width: Width = 256
    layers: Layers = 1
    learning_rate: float = Field(
        default=1e-3, gt=0.0, le=1.0, description="step size of Adam, at first [-]"
    )
    learning_rate_end: FinalLearningRate = 2e-5
    gamma: float = Field(
        default=1.0, ge=0.0, le=1.0, description="discount factor of later rewards [-]"
    )
    complete: GoalReward = 4.0
    failure: FailureLoss = 1.0
    steps_worth: StepsWorth = 4.0
    step_floor: StepFloor = 4.0
    count_last_cost: bool = Field(
        default=True,
        description="count the cost of the skill that completes the task, too; Table II of "
        "Moller et al. gives nothing for it but the completion [-]",
    )
    planning: bool | None = Field(
        default=None,
        description="model-based planning: plan episodes by search in a model learned from the own "
        "steps, until nothing better is in sight. null: "
        "for one deterministic task, unless observation is layout; nothing is planned elsewhere "
        "[-]",
    )
    plan_width: int = Field(
        default=32,
        ge=1,
        le=4_096,
        description="how many plans a search for a better one goes on with at first [-]",
    )
