"""The options of proximal policy optimisation; the manifest of a run holds all of them."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from skillplan_torch.batched_network import BLOCK
from skillplan_torch.network_options import (
    FailureLoss,
    FinalLearningRate,
    GoalReward,
    Layers,
    NetworkOptions,
    StepFloor,
    StepsWorth,
    Width,
)


class PpoOptions(NetworkOptions):
    """The defaults find the optimum of the inverter board, with and without a mask.

    Where there is no mask and nothing can be planned it takes novelty=3, failure=0.2 and gamma=0.8:
    then failing late is better than failing early, and what is new is worth failing for.
    """

    width: Width = 64
    layers: Layers = 2
    learning_rate_end: Annotated[
        FinalLearningRate,
        Field(description="step size of Adam, in the end, approached linearly [-]"),
    ] = 1e-4
    complete: GoalReward = 1.0
    failure: Annotated[
        FailureLoss,
        Field(
            description="loss by failing or running out of time, in place of the environment's "
            "reward [-]"
        ),
    ] = 1.0
    steps_worth: Annotated[
        StepsWorth,
        Field(
            description="loss by as many typical steps as the step limit allows: rewards of "
            "steps are scaled to it, and by the share of a run's latest episodes that "
            "completed the task, lest failing early is cheaper than trying [-]"
        ),
    ] = 1.25
    step_floor: StepFloor = 8.0
    # Updates
    rollout: int = Field(
        default=512,
        ge=BLOCK,
        le=1_048_576,
        multiple_of=BLOCK,
        description="environment steps between updates, a multiple of 32 [-]",
    )
    epochs: int = Field(
        default=8, ge=1, le=1_000, description="passes of an update over these steps [-]"
    )
    batch: int = Field(
        default=128,
        ge=BLOCK,
        le=1_048_576,
        multiple_of=BLOCK,
        description="steps that a gradient is taken of, a multiple of 32 [-]",
    )
    clip: float = Field(
        default=0.2,
        gt=0.0,
        le=1.0,
        description="share by which an update may change a probability and still gain [-]",
    )
    max_gradient: float = Field(
        default=0.5,
        gt=0.0,
        le=1e6,
        description="length to which longer gradients of a network are cut [-]",
    )
    gae_lambda: float = Field(
        default=0.95,
        ge=0.0,
        le=1.0,
        description="how far advantages look: 0 one step, 1 to the end of the episode [-]",
    )
    # Exploration
    imitation: float = Field(
        default=1.0,
        ge=0.0,
        le=1e6,
        description="weight of the cross entropy to the cheapest episode that completed a "
        "deterministic task [-]",
    )
    entropy: float = Field(
        default=0.1,
        ge=0.0,
        le=1e3,
        description="weight of the policy's entropy beside normalised advantages, at first [-]",
    )
    entropy_end: float = Field(
        default=0.0,
        ge=0.0,
        le=1e3,
        description="that weight in the end, approached linearly [-]",
    )
    follow: bool = Field(
        default=True,
        description="after every update one episode follows the policy without exploration, "
        "to be kept if it is the best so far, and is not learned from; its steps count. Never "
        "under chance or with several boards, where one episode does not suffice [-]",
    )
    novelty: float = Field(
        default=0.0,
        ge=0.0,
        le=1e6,
        description="reward at first for what was never done before where the run is, divided "
        "by the root of the count and falling linearly to 0 in the end [-]",
    )
