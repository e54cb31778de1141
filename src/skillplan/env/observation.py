"""What a learner sees of a state: the bits that a task lists, where its robots stand, costs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Space
from numpy.typing import NDArray

from skillplan.env.env_options import ObservationKind, checked_name
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Literal, Task


@dataclass(frozen=True)
class Observation:
    """What is observed of a state.

    Parameters
    ----------
    kind
        ``paper``, the bits that the task lists, or all facts where it lists none: on the board
        those of Moller et al., Fig. 5. ``markov``, these and, where they do not say so, where
        the robots stand, on which costs depend. ``layout``, these and what every skill would
        cost from here, applicable or not: what distinguishes one board of a family from another.
        Those are the task's own figures, also where a back end tells costs.
    literals
        The bits, in order.
    priced
        The skills whose costs are observed, in order; after the bits.

    Raises
    ------
    ValueError
        If nothing is observed.
    """

    kind: ObservationKind
    literals: tuple[Literal, ...]
    priced: tuple[Skill, ...] = ()

    def __post_init__(self) -> None:
        if not self.width:
            raise ValueError("An observation has at least one feature.")

    @classmethod
    def of(cls, task: Task, kind: str) -> Observation:
        """Return the observation of a task's states.

        Raises
        ------
        OptionError
            If there is no such kind.
        """
        named: ObservationKind = checked_name("observation", kind, ObservationKind)
        literals = task.observation or tuple(Literal(name) for name in task.facts.names)
        if named != "paper":
            seen = {literal.fact for literal in literals}
            places = {fact for robot in task.scene.robots for fact in robot.places}
            places |= set(task.places)
            literals += tuple(Literal(name) for name in task.facts.names if name in places - seen)
        return cls(named, literals, task.skills if named == "layout" else ())

    @property
    def width(self) -> int:
        """How many features there are."""
        return len(self.literals) + len(self.priced)

    @property
    def features(self) -> tuple[str, ...]:
        """What every feature means, such as ``not hand_free`` or ``cost(pick(pcb))``."""
        return (*map(str, self.literals), *(f"cost({skill.name})" for skill in self.priced))

    @property
    def space(self) -> Space[NDArray[np.float32]]:
        """The space of observations, shape (width,): bits are at most 1, costs have no bound."""
        highest = np.ones(self.width, dtype=np.float32)
        highest[len(self.literals) :] = np.finfo(np.float32).max
        box: Space[Any] = Box(np.zeros_like(highest), highest, dtype=np.float32)
        return box

    def encode(self, state: State) -> NDArray[np.float32]:
        """Return the features of a state, shape (width,), float32.

        Bits are 0 or 1, costs are in the task's metric; a cost that the state leaves undefined,
        as of loading a tool that is attached, is 0.
        """
        costs = (_cost(skill, state) for skill in self.priced)
        bits = (literal.value(state) for literal in self.literals)
        return np.array([*bits, *costs], dtype=np.float32)


def _cost(skill: Skill, state: State) -> float:
    try:
        return skill.cost.at(state)
    except ValueError:
        return 0.0
