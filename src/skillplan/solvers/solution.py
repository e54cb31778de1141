"""A solver's answer: a plan or a policy, and the claims that the referee checks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from skillplan.task.skill import Skill
from skillplan.task.state import State


@dataclass(frozen=True, slots=True)
class Plan:
    """A sequence of skills.

    Parameters
    ----------
    skills
        Names, in order.
    cost
        What the solver claims it costs; the referee checks it. None for no claim.

    Raises
    ------
    ValueError
        If the skills are not a tuple of names.
    """

    skills: tuple[str, ...]
    cost: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.skills, tuple) or not all(isinstance(s, str) for s in self.skills):
            raise ValueError("A plan is a tuple of skill names.")

    def __len__(self) -> int:
        return len(self.skills)


class Policy(Mapping[State, Skill]):
    """A mapping from states to skills; not every state need be in it.

    Parameters
    ----------
    choices
        The skill to take in a state.
    """

    def __init__(self, choices: Mapping[State, Skill]) -> None:
        self._choices = dict(choices)

    def __getitem__(self, state: State) -> Skill:
        return self._choices[state]

    def __iter__(self) -> Iterator[State]:
        return iter(self._choices)

    def __len__(self) -> int:
        return len(self._choices)

    def __repr__(self) -> str:
        return f"Policy({len(self)} states)"


@dataclass(frozen=True)
class Solution:
    """What a solver found and what it claims to have proved.

    Parameters
    ----------
    found
        A plan, a policy (any mapping from states to skills), or None where nothing was found.
    lower_bound
        Claimed lower bound on the cost of every plan; None for no claim.
    proved
        Whether a plan is claimed to be optimal or, without a plan, that there is none.
    trace
        Figures of the search worth showing, JSON values only.

    Raises
    ------
    ValueError
        If the bound is not a number.
    """

    found: Plan | Mapping[State, Skill] | None = None
    lower_bound: float | None = None
    proved: bool = False
    trace: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.lower_bound is not None and math.isnan(self.lower_bound):
            raise ValueError("A lower bound must be a number.")

    @property
    def plan(self) -> Plan | None:
        """The plan, where there is one."""
        return self.found if isinstance(self.found, Plan) else None

    @property
    def policy(self) -> Mapping[State, Skill] | None:
        """The policy, where there is one."""
        return self.found if isinstance(self.found, Mapping) else None
