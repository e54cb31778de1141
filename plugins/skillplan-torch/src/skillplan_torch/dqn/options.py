"""The options of deep Q-learning; the manifest of a run holds all of them."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from skillplan_torch.batched_network import BLOCK
from skillplan_torch.network_options import NetworkOptions


class DqnOptions(NetworkOptions):
    """The defaults complete and optimise the inverter board with and without masks."""

    # Exploration
    exploration: Literal["epsilon", "count"] | None = Field(
        default=None,
        description="how actions are tried beside plans: epsilon, at random with that "
        "probability; count, those tried seldom count for better. null: count without a mask where "
        "nothing is planned, else epsilon [-]",
    )
    epsilon: float = Field(
        default=0.3, ge=0.0, le=1.0, description="probability of an action at random, at first [-]"
    )
    epsilon_end: float = Field(default=0.01, ge=0.0, le=1.0, description="epsilon in the end [-]")
    explore_until: float = Field(
        default=0.6,
        gt=0.0,
        le=1.0,
        description="share of the steps after which epsilon is epsilon_end, and the bonus of count "
        "is gone [-]",
    )
    branching: float = Field(
        default=0.9,
        ge=0.0,
        le=1.0,
        description="share of the episodes that leave the policy once, at a random depth, for "
        "the most promising of its other actions; for one never tried there, until the task "
        "has been completed [-]",
    )
    # What is learned from
    capacity: int = Field(
        default=100_000, ge=1, le=100_000_000, description="most transitions remembered [-]"
    )
    imitation: float = Field(
        default=1.0,
        ge=0.0,
        le=1e6,
        description="weight of the loss by which actions of the cheapest episode stand out by a "
        "margin, from 0.65 of the steps on; only of one deterministic task is there such an "
        "episode [-]",
    )
    # Updates
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
