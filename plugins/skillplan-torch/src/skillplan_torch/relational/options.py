"""The options of `relational`."""

from __future__ import annotations

from pydantic import Field

from skillplan.task import back_end


class RelationalOptions(back_end.Options):
    """How much is learned, how large the network is, and what a stored one follows."""

    run: str = Field(
        default="",
        description="where it solves a task: the folder of a policy that `train --family "
        "generated:LEAST-MOST` has written",
    )
    boards: int = Field(
        default=600, ge=1, le=100_000, description="how many boards are learned on [-]"
    )
    rounds: int = Field(
        default=6,
        ge=1,
        le=1_000,
        description="rounds of walking on all boards and learning from all that was met [-]",
    )
    updates: int = Field(default=400, ge=1, le=1_000_000, description="updates of a round [-]")
    batch: int = Field(default=256, ge=1, le=65_536, description="states of an update [-]")
    learning_rate: float = Field(
        default=1e-3, gt=0.0, le=1.0, description="step size of Adam at first; it falls to 0 [-]"
    )
    slips: float = Field(
        default=0.15,
        ge=0.0,
        le=1.0,
        description="share of choices at random on a walk, so that the teacher also says what to "
        "do off the network's way [-]",
    )
    sharpness: float = Field(
        default=100.0,
        gt=0.0,
        le=1e6,
        description="how much a choice is to be preferred, per share of the board's cost that it "
        "spares [-]",
    )
    width: int = Field(
        default=64, ge=4, le=1024, multiple_of=4, description="width of the network [-]"
    )
    layers: int = Field(default=3, ge=1, le=12, description="layers of attention [-]")
