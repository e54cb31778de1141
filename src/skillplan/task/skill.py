"""Robot skills, after the standard robot skill model.

Bogh et al., "Does your robot have skills?" (2012), and Moller et al., section 3.3: a skill has
parameters, a precondition, an execution, a prediction of what it will bring about, and a
postcondition by which its success is judged.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any

from skillplan.task.condition import Condition
from skillplan.task.cost import Cost
from skillplan.task.motion import Motion
from skillplan.task.state import State

_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True)
class Outcome:
    """One thing that may come of a skill.

    Parameters
    ----------
    probability
        In (0, 1].
    add, delete
        Facts that become true and false.

    Raises
    ------
    ValueError
        If the probability is out of range or a fact is both added and deleted.
    """

    probability: float
    add: State
    delete: State

    def __post_init__(self) -> None:
        if not 0 < self.probability <= 1:
            raise ValueError(f"Outcome probability must be in (0, 1], not {self.probability}.")
        both = self.add & self.delete
        if both.bits:
            raise ValueError(f"Outcome adds and deletes the same facts: {both}.")

    def apply(self, state: State) -> State:
        """Return the state after this outcome."""
        return State(state.bits & ~self.delete.bits | self.add.bits, state.facts)


@dataclass(frozen=True)
class Skill:
    """A grounded robot skill: one arrow label of the transition model.

    Parameters
    ----------
    name
        ``kind(argument)``, such as ``pick(pcb)``; unique in its task.
    kind
        The skill of the portfolio it is an instance of, such as ``pick``.
    agents
        The robots it occupies, at least one.
    precondition
        Where it is *applicable*: symbolic, free to ask.
    outcomes
        The *prediction*; probabilities sum to 1, the nominal outcome first.
    cost
        Value in the task's metric, >= 0, possibly depending on the state.
    duration_s
        Time it takes [s].
    motion
        The *execution*; None for a skill without motion.
    parameters
        What it was grounded with, such as ``{"part": "pcb", "tool": "gripper"}``.

    Raises
    ------
    ValueError
        If the name is empty, no agent or outcome is given, or the probabilities do not sum to 1.
    """

    name: str
    kind: str
    agents: tuple[str, ...]
    precondition: Condition
    outcomes: tuple[Outcome, ...]
    cost: Cost
    duration_s: Cost
    motion: Motion | None = None
    parameters: Mapping[str, str] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        if not self.name:
            raise ValueError("Skill name must not be empty.")
        if not self.agents:
            raise ValueError(f"Skill {self.name!r} needs at least one agent.")
        if not self.outcomes:
            raise ValueError(f"Skill {self.name!r} needs at least one outcome.")
        total = math.fsum(outcome.probability for outcome in self.outcomes)
        if abs(total - 1) > _TOLERANCE:
            raise ValueError(f"Skill {self.name!r}: outcome probabilities sum to {total}, not 1.")
        object.__setattr__(self, "parameters", MappingProxyType(dict(self.parameters)))

    def __reduce__(self) -> tuple[type[Skill], tuple[Any, ...]]:
        # A mapping proxy cannot be pickled; its content can.
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        return Skill, tuple({**values, "parameters": dict(self.parameters)}.values())

    @property
    def prediction(self) -> Outcome:
        """The nominal outcome."""
        return self.outcomes[0]

    @property
    def postcondition(self) -> Condition:
        """What must hold after a successful execution."""
        return Condition(self.prediction.add, self.prediction.delete)

    @property
    def deterministic(self) -> bool:
        """Whether only one thing can come of it."""
        return len(self.outcomes) == 1

    def __str__(self) -> str:
        return self.name
