"""The options of deep Q-learning; the manifest of a run holds all of them."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from skillplan_torch.batched_network import BLOCK
from skillplan_torch.network_options import NetworkOptions


class DqnOptions(NetworkOptions):
    """The defaults complete and optimise the inverter board with and without masks."""

    # Exploration
    exploration: Literal["count", "boltzmann", "epsilon"] = Field(
        default="count",
        description="how actions are tried: those taken seldom first; by exp(value / "
        "temperature); at random with probability epsilon [-]",
    )
    bonus: float | None = Field(
        default=None,
        ge=0.0,
        le=1e6,
        description="count: added to the value of an untried action; values are about -1 to 4. "
        "null for 5 with a mask, where all is tried, and 1 without, where what looks like "
        "failing is not [-]",
    )
    bonus_power: float = Field(
        default=10.0,
        gt=0.0,
        le=100.0,
        description="count: after n tries the bonus is divided by (n + 1) to this power [-]",
    )
    temperature: float = Field(
        default=0.2, gt=0.0, le=1e6, description="boltzmann: temperature at first [-]"
    )
    temperature_end: float = Field(
        default=0.001, gt=0.0, le=1e6, description="boltzmann: temperature in the end [-]"
    )
    epsilon: float = Field(
        default=0.3, ge=0.0, le=1.0, description="epsilon: probability at first [-]"
    )
    epsilon_end: float = Field(
        default=0.01, ge=0.0, le=1.0, description="epsilon: probability in the end [-]"
    )
    explore_until: float = Field(
        default=0.6,
        gt=0.0,
        le=1.0,
        description="share of the steps by which bonus, temperature or epsilon have come to "
        "their end [-]",
    )
    branching: float = Field(
        default=0.9,
        ge=0.0,
        le=1.0,
        description="share of the episodes that leave the policy once, at a random depth, for "
        "the most promising of its other actions; for one never tried there, until the task "
        "has been completed [-]",
    )
    branch_bonus: float = Field(
        default=5.0,
        ge=0.0,
        le=1e6,
        description="then added to the value of an action, divided by the root of one more "
        "than its tries [-]",
    )
    branch_until: float = Field(
        default=0.88, ge=0.0, le=1.0, description="share of the steps during which they do [-]"
    )
    tell_last_action: bool = Field(
        default=True,
        description="distinguish observations by the action before them when counting and "
        "remembering; the network never sees it [-]",
    )
    # Replay memory
    replay: Literal["distinct", "recent"] = Field(
        default="distinct",
        description="remember every distinct transition once, or the last ones [-]",
    )
    capacity: int = Field(
        default=100_000, ge=1, le=100_000_000, description="most transitions remembered [-]"
    )
    priority: float = Field(
        default=0.0,
        ge=0.0,
        le=2.0,
        description="exponent of the error by which transitions are drawn; 0 draws evenly [-]",
    )
    n_step: int = Field(
        default=1, ge=1, le=1_000, description="steps between a value and its target's [-]"
    )
    best_return: float | None = Field(
        default=None,
        ge=0.0,
        le=1.0,
        description="share of the best return seen in a target, beside the next value; null "
        "for 0.9 where every skill has one outcome, and 0 under chance; for gamma 1 only [-]",
    )
    imitate_from: float = Field(
        default=0.65,
        ge=0.0,
        le=1.0,
        description="share of the steps after which the best return comes in [-]",
    )
    imitation: float = Field(
        default=1.0,
        ge=0.0,
        le=1e6,
        description="weight of a loss by which, from then on, the actions of the cheapest episode "
        "that completed a deterministic task stand out by a margin [-]",
    )
    imitation_margin: float = Field(
        default=0.2,
        ge=0.0,
        le=1e6,
        description="by which their values do; values are about -1 to 4 [-]",
    )
    # Updates
    dueling: bool = Field(
        default=False,
        description="learn the value of a state apart from the advantages of its actions [-]",
    )
    batch: int = Field(
        default=64,
        ge=BLOCK,
        le=65_536,
        multiple_of=BLOCK,
        description="transitions that an update learns from, a multiple of 32 [-]",
    )
    updates: float | None = Field(
        default=None,
        gt=0.0,
        le=100.0,
        description="updates for every environment step; null for 0.5 where every skill has one "
        "outcome, and 1 under chance [-]",
    )
    warm_up: int = Field(
        default=100, ge=1, le=1_000_000, description="steps before the first update [-]"
    )
    decay_from: float = Field(
        default=0.6,
        ge=0.0,
        lt=1.0,
        description="share of the steps after which the learning rate falls [-]",
    )
    target_rate: float = Field(
        default=0.02,
        gt=0.0,
        le=1.0,
        description="share by which every update moves the target network to the other [-]",
    )
    late_is_failure: bool = Field(
        default=False,
        description="take the step limit for a failure of the last skill; otherwise what is "
        "learned of it goes on with the state after it, as no one observes the time [-]",
    )
