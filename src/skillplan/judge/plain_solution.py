"""A solution as plain values: what a solver hands over may be of classes of its own.

A float that compares as it likes, a tuple that is another one when it is read again, a policy that
changes its mind: the referee looks at each once, and judges and keeps what it has seen.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from skillplan.files.plain_json import json_fault
from skillplan.solvers.solution import Plan, Policy, Solution
from skillplan.task.skill import Skill
from skillplan.task.state import State


def plain_solution(solution: Solution) -> Solution:
    """Return a solution of plain values that claims the same.

    Raises
    ------
    ValueError
        If a claim is no number or no JSON; in words.
    """
    found, proved = solution.found, solution.proved
    if not isinstance(proved, bool):
        raise ValueError(f"its claim of a proof is {proved!r}, neither True nor False")
    trace = _plain(dict(solution.trace))
    fault = json_fault(trace)
    if fault is not None:
        raise ValueError(f"its trace is not JSON: {fault}")
    bound = _number(solution.lower_bound, "lower bound")
    if bound is not None and math.isnan(bound):
        raise ValueError("its lower bound is not a number")
    return Solution(
        plain_plan(found) if isinstance(found, Plan) else _policy(found), bound, proved, trace
    )


def plain_plan(plan: Plan) -> Plan:
    """Return a plan of plain values; errors are those of `plain_solution`."""
    skills = plan.skills
    if not isinstance(skills, tuple) or not all(
        isinstance(one, str) for one in tuple.__iter__(skills)
    ):
        raise ValueError("its plan is no tuple of skill names")
    names = tuple(str.__str__(one) for one in tuple.__iter__(skills))
    return Plan(names, _number(plan.cost, "cost"))


def _number(value: Any, what: str) -> float | None:
    """Return a number as the plain float that it is, whatever a subclass says it is."""
    if value is None:
        return None
    plain = _without_class(value)
    if plain is not None:
        return float(plain)
    try:
        # Such as a scalar of numpy, which is no subclass.
        return _without_class(float(value))
    except Exception:
        raise ValueError(f"its {what} is a {type(value).__name__}, not a number") from None


def _without_class(value: Any) -> float | int | None:
    """Return a float or an int as Python itself has it; None of anything else."""
    if isinstance(value, float):
        return float.__add__(value, 0.0)
    if isinstance(value, int) and not isinstance(value, bool):
        return int.__add__(value, 0)
    return None


def _plain(value: Any) -> Any:
    """Return a JSON value read once, without the classes of whoever made it."""
    if isinstance(value, Mapping):
        return {_plain(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_plain(item) for item in list.__iter__(value)]
    if isinstance(value, tuple):
        return tuple(_plain(item) for item in tuple.__iter__(value))
    if isinstance(value, str):
        return str.__str__(value)
    number = _without_class(value)
    # Whatever else there is, JSON does not know.
    return value if number is None else number


def _policy(found: Mapping[State, Skill] | None) -> Mapping[State, Skill] | None:
    # What is no policy either is for the referee to reject.
    if not isinstance(found, Mapping) or type(found) in (Policy, dict):
        return found
    return _Remembered(found)


class _Remembered(Mapping[State, Skill]):
    """A policy that is asked once about each state.

    Parameters
    ----------
    policy
        Of a class of the solver's own.
    """

    def __init__(self, policy: Mapping[State, Skill]) -> None:
        self._policy = policy
        self._said: dict[State, Skill | None] = {}

    def __getitem__(self, state: State) -> Skill:
        if state not in self._said:
            self._said[state] = self._policy.get(state)
        said = self._said[state]
        if said is None:
            raise KeyError(state)
        return said

    def __iter__(self) -> Iterator[State]:
        return iter(self._policy)

    def __len__(self) -> int:
        return len(self._policy)
