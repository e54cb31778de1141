"""The options of `imitate`."""

from __future__ import annotations

from pydantic import Field

from skillplan.env.env_options import MaskKind, ObservationKind
from skillplan.task import back_end
from skillplan_torch.network_options import Layers, Width


class ImitateOptions(back_end.Options):
    """How the teacher is asked, and how the network learns."""

    width: Width = 256
    layers: Layers = 1
    observation: ObservationKind = Field(
        default="markov", description="what the network sees of a state"
    )
    mask: MaskKind = Field(default="applicable", description="what its choice is limited to")
    rounds: int = Field(
        default=4,
        ge=1,
        le=100,
        description="rounds of asking the teacher where the network gets to, and learning from "
        "all it has said [-]",
    )
    roll_outs: int = Field(
        default=50, ge=1, le=100_000, description="roll-outs of a round to meet states in [-]"
    )
    slips: float = Field(
        default=0.05,
        ge=0.0,
        le=1.0,
        description="share of skills taken at random among the feasible ones in a round, so that "
        "the teacher also says what to do off its way [-]",
    )
    epochs: int = Field(
        default=300, ge=1, le=100_000, description="updates from all that is known, a round [-]"
    )
    learning_rate: float = Field(
        default=3e-3, gt=0.0, le=1.0, description="step size of Adam in imitation [-]"
    )
    reinforcements: int = Field(
        default=40,
        ge=0,
        le=100_000,
        description="updates by policy gradient after imitation; 0 for imitation alone [-]",
    )
    batch: int = Field(
        default=50, ge=2, le=100_000, description="roll-outs for one policy gradient [-]"
    )
    reinforcement_rate: float = Field(
        default=3e-4, gt=0.0, le=1.0, description="step size of Adam in reinforcement [-]"
    )
