"""The answer of a solver, with the claims that the referee checks, and the gap of a plan."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from skillplan.files.json_file import find_json_fault
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
        Claimed cost, which the referee checks; None for no claim.

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
    """A mapping from states to skills, which need not cover every state."""

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
    """The answer of a solver and its claims.

    Parameters
    ----------
    found
        A plan, a policy (any mapping from states to skills), or None.
    lower_bound
        Claimed lower bound on the cost of every plan; None for no claim.
    proved
        True if a plan is claimed to be optimal or, without a plan, that none exists.
    trace
        Figures of the search, JSON values only.

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

    def with_plain_numbers(self) -> Solution:
        """Return the solution with Python's own numbers in place of scalars such as NumPy's.

        Raises
        ------
        ValueError
            If the cost or bound is not a number, the proof not a bool, or the trace not JSON.
        """
        if not isinstance(self.proved, bool):
            raise ValueError(f"its claim of a proof is {self.proved!r}, neither True nor False")
        trace = dict(self.trace)
        fault = find_json_fault(trace)
        if fault is not None:
            raise ValueError(f"its trace is not JSON: {fault}")
        answer = self.found
        if isinstance(answer, Plan):
            answer = Plan(answer.skills, _plain_number(answer.cost, "cost"))
        bound = _plain_number(self.lower_bound, "lower bound")
        return Solution(answer, bound, self.proved, trace)

    @property
    def plan(self) -> Plan | None:
        """The plan, if there is one."""
        return self.found if isinstance(self.found, Plan) else None

    @property
    def policy(self) -> Mapping[State, Skill] | None:
        """The policy, if there is one."""
        return self.found if isinstance(self.found, Mapping) else None


def _plain_number(value: Any, name: str) -> float | None:
    if value is None:
        return None
    if not hasattr(value, "__float__"):
        raise ValueError(f"its {name} is a {type(value).__name__}, not a number")
    return float(value)


# A proof of optimality may leave this share of the optimum open.
_PROOF_GAP: Final = 1e-6


def relative_gap(cost: float | None, lower_bound: float | None) -> float | None:
    """Return (cost - lower bound) / cost, at least 0; None if either is missing."""
    if cost is None or lower_bound is None or not math.isfinite(lower_bound):
        return None
    if cost <= lower_bound or cost == 0:
        return 0.0
    return (cost - lower_bound) / cost


def deviation(cost: float | None, optimum: float | None) -> float | None:
    """Return the excess over the optimum as a fraction of it; None if either is missing.

    An excess within the gap of a proof, 1e-6 of the optimum, is 0.
    """
    if cost is None or optimum is None:
        return None
    if abs(cost - optimum) <= _PROOF_GAP * max(1e-3, optimum):
        return 0.0
    return cost / optimum - 1 if optimum > 0 else None
