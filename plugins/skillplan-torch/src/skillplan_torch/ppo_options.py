"""What proximal policy optimisation can be told; all of it stands in the manifest of a run."""

from __future__ import annotations

from pydantic import Field

from skillplan.solvers.learning.learner import LearnerOptions
from skillplan_torch.batched_network import BLOCK


class PpoOptions(LearnerOptions):
    """The defaults find the optimum of the inverter board with the mask of the applicable.

    Without a mask it takes novelty=3, failure=0.2 and gamma=0.8: then failing late is better
    than failing early, and what is new is worth failing for.
    """

    steps: int = Field(
        default=100_000,
        ge=1,
        le=1_000_000_000,
        description="environment steps of a run; `train --steps` goes before it [-]",
    )
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
    learning_rate: float = Field(
        default=1e-3, gt=0.0, le=1.0, description="step size of Adam, at first [-]"
    )
    learning_rate_end: float = Field(
        default=1e-4,
        gt=0.0,
        le=1.0,
        description="step size of Adam, in the end, approached linearly [-]",
    )
    max_gradient: float = Field(
        default=0.5,
        gt=0.0,
        le=1e6,
        description="length to which longer gradients of a network are cut [-]",
    )
    gamma: float = Field(
        default=1.0, ge=0.0, le=1.0, description="discount factor of later rewards [-]"
    )
    gae_lambda: float = Field(
        default=0.95,
        ge=0.0,
        le=1.0,
        description="how far advantages look: 0 one step, 1 to the end of the episode [-]",
    )
    # Exploration
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
        "under chance or with several boards, where one episode does not tell [-]",
    )
    novelty: float = Field(
        default=0.0,
        ge=0.0,
        le=1e6,
        description="paid at first for what was never done before where the run is, divided "
        "by the root of the count and falling linearly to 0 in the end [-]",
    )
    # Networks
    width: int = Field(
        default=64,
        ge=BLOCK,
        le=8_192,
        multiple_of=BLOCK,
        description="units of a hidden layer, a multiple of 32 [-]",
    )
    layers: int = Field(default=2, ge=0, le=8, description="hidden layers [-]")
    # What is learned from
    complete: float = Field(
        default=1.0,
        ge=0.0,
        le=1e6,
        description="worth of completing, instead of the reward [-]",
    )
    failure: float = Field(
        default=1.0,
        ge=0.0,
        le=1e6,
        description="loss by failing or running out of time, instead of the reward [-]",
    )
    steps_worth: float = Field(
        default=1.25,
        ge=0.0,
        le=1e6,
        description="loss by as many usual steps as the step limit allows: rewards of steps "
        "are multiplied so, and by the share of a run's latest episodes that completed, lest "
        "failing early is cheaper than trying [-]",
    )
    step_floor: float = Field(
        default=8.0,
        ge=1.0,
        le=1e6,
        description="no step loses more than so many usual ones [-]",
    )
    count_last_cost: bool = Field(
        default=True,
        description="count the cost of the skill that completes the task, too, for which Table "
        "II pays nothing but the completion [-]",
    )
