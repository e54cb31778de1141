"""One query to one back end; every fault of it becomes an error that names the back end."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, NoReturn

from pydantic import BaseModel

from skillplan.errors import BackEndError
from skillplan.files.json_file import find_json_fault
from skillplan.plugins.blame import blame
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict
from skillplan.workers.supervised import doing


@dataclass(frozen=True, slots=True)
class Checked:
    """The answer of a back end.

    Parameters
    ----------
    verdict
        Names the back end as its stage and rests on facts; its evidence is plain JSON.
    took_s
        Duration of the check [s], >= 0.
    """

    verdict: Verdict
    took_s: float

    def __post_init__(self) -> None:
        if not self.took_s >= 0:
            raise ValueError(f"A check cannot take {self.took_s} s.")


class CheckRequest(NamedTuple):
    """A check for a worker.

    Parameters
    ----------
    goes_on
        True if the last check was about the same skill and state. Then the same worker should
        check, because it may have kept intermediate results.
    """

    back_end: int
    skill: Skill
    state: State
    goes_on: bool = False


class IntroducedBackEnds(tuple[BackEnd, ...]):
    """Back ends that know each other."""

    __slots__ = ()


class Recipe(NamedTuple):
    """The class and settings with which another process makes a back end again."""

    plugin: type[BackEnd]
    options: BaseModel
    screens: bool

    @classmethod
    def of(cls, back_end: BackEnd) -> Recipe:
        """Return the recipe of a back end."""
        return cls(type(back_end), back_end.options, back_end.screens)


def construct(task: Task, recipes: Iterable[Recipe]) -> list[BackEnd]:
    """Return back ends made from recipes, in a worker process.

    Raises
    ------
    BackEndError
        If a back end fails to start.
    """
    back_ends = []
    for recipe in recipes:
        try:
            back_end = recipe.plugin(task, recipe.options)
        except BaseException as error:
            _blame(error, recipe.plugin, " to start in a process of its own")
        back_end.screens = recipe.screens
        back_ends.append(back_end)
    return back_ends


def introduce_back_ends(back_ends: Iterable[BackEnd]) -> IntroducedBackEnds:
    """Return back ends that know each other, the cheapest first.

    Raises
    ------
    BackEndError
        If two back ends are incompatible.
    """
    if isinstance(back_ends, IntroducedBackEnds):
        return back_ends
    return introduce(sorted(back_ends, key=lambda back_end: back_end.expected_s))


def introduce(back_ends: Sequence[BackEnd]) -> IntroducedBackEnds:
    """Return back ends that know each other, in the given order.

    Raises
    ------
    BackEndError
        If a back end raises, or its basis is not JSON.
    """
    for back_end in back_ends:
        try:
            back_end.beside([other for other in back_ends if other is not back_end])
            fault = find_json_fault(back_end.basis)
        except BaseException as error:
            _blame(error, back_end)
        if fault is not None:
            raise BackEndError(f"The basis of back end {back_end.name!r} is not JSON: {fault}.")
    return IntroducedBackEnds(back_ends)


def list_not_checked(back_ends: Sequence[BackEnd]) -> tuple[str, ...]:
    """Return the sentences about what back ends leave unchecked, without duplicates.

    Raises
    ------
    BackEndError
        If a back end raises.
    """
    sentences: dict[str, None] = {}
    for back_end in back_ends:
        try:
            sentences.update(dict.fromkeys(map(str, back_end.not_checked())))
        except BaseException as error:
            _blame(error, back_end)
    return tuple(sentences)


def check(back_end: BackEnd, skill: Skill, state: State) -> Checked:
    """Return the answer of a back end on an applicable skill.

    Raises
    ------
    BackEndError
        If the back end raises, does not return a verdict, or returns a verdict that
        rests on false facts.
    """
    begin_s = time.perf_counter()
    try:
        if type(back_end).__module__.startswith("skillplan"):
            verdict = back_end.check(skill, state)
        else:
            # If the process crashes or hangs, its supervisor names this back end.
            with doing(f"a check of {skill.name} by the back end {back_end.name!r}"):
                verdict = back_end.check(skill, state)
    except BaseException as error:
        _blame(error, back_end, f" on {skill.name} in {state}")
    took_s = time.perf_counter() - begin_s
    if not isinstance(verdict, Verdict):
        raise BackEndError(
            f"Back end {back_end.name!r} returned {type(verdict).__name__} for "
            f"{skill.name}, not a Verdict."
        )
    if verdict.evidence:
        fault = find_json_fault(verdict.evidence)
        if fault is not None:
            raise BackEndError(
                f"The evidence of back end {back_end.name!r} for {skill.name} is not JSON: {fault}."
            )
        # The same values as from a file or another process: lists for tuples, plain numbers.
        verdict = replace(verdict, evidence=json.loads(json.dumps(dict(verdict.evidence))))
    verdict = verdict.grounded(state, back_end.name)
    if not verdict.applies_in(state):
        raise BackEndError(
            f"Back end {back_end.name!r} says its verdict on {skill.name} rests on facts "
            f"that do not hold in {state}: {', '.join(verdict.facts)}."
        )
    return Checked(verdict, took_s)


def query_execution_time_s(back_end: BackEnd, skill: Skill, state: State) -> float | None:
    """Return the execution time of a skill by a back end [s], or None if it cannot time it.

    Raises
    ------
    BackEndError
        If the back end raises or returns no time.
    """
    try:
        duration_s = back_end.duration_s(skill, state)
    except BaseException as error:
        _blame(error, back_end, f" to time {skill.name} in {state}")
    if duration_s is None:
        return None
    if not isinstance(duration_s, int | float) or not 0 <= duration_s < math.inf:
        raise BackEndError(
            f"Back end {back_end.name!r} says that {skill.name} takes {duration_s!r} s in {state}."
        )
    return float(duration_s)


def bound_execution_time_s(
    back_end: BackEnd, skill: Skill, true_bits: int, false_bits: int
) -> float:
    """Return the lower bound of a back end on an execution time [s]; see `least_duration_s`.

    Raises
    ------
    BackEndError
        If the back end raises or returns no time.
    """
    try:
        least_s = back_end.least_duration_s(skill, true_bits, false_bits)
    except BaseException as error:
        _blame(error, back_end, f" to bound the time of {skill.name}")
    if not isinstance(least_s, int | float) or not least_s >= 0:
        raise BackEndError(
            f"Back end {back_end.name!r} says that {skill.name} takes {least_s!r} s at least."
        )
    return float(least_s)


def can_time(back_end: type[BackEnd]) -> bool:
    """Return whether back ends of a class can time skills."""
    return back_end.duration_s is not BackEnd.duration_s


def _blame(error: BaseException, back_end: BackEnd | type[BackEnd], attempt: str = "") -> NoReturn:
    blame(
        error,
        back_end if isinstance(back_end, type) else type(back_end),
        lambda message: f"Back end {back_end.name!r} failed{attempt}: {message}",
        BackEndError,
        BackEndError,
    )
