"""One query to one back end: whatever it does wrong is said in words that name it."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, NoReturn

from pydantic import BaseModel

from skillplan.errors import BackEndError
from skillplan.files.plain_json import json_fault
from skillplan.plugins.blame import blame
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict
from skillplan.workers.supervised import doing


@dataclass(frozen=True, slots=True)
class Checked:
    """What a back end said, and how long it took.

    Parameters
    ----------
    verdict
        Named after the back end and resting on facts; its evidence as JSON gives it back.
    took_s
        Time of the check [s], >= 0.

    Raises
    ------
    ValueError
        If the time is negative.
    """

    verdict: Verdict
    took_s: float

    def __post_init__(self) -> None:
        if not self.took_s >= 0:
            raise ValueError(f"A check cannot take {self.took_s} s.")


@dataclass(frozen=True, slots=True)
class CheckRequest:
    """A check to be made.

    Parameters
    ----------
    back_end
        Index of the back end.
    skill, state
        What it is queried about.
    goes_on
        Whether another back end has just been queried about the same: then the process that did it
        is the one to query, for what it may remember.
    """

    back_end: int
    skill: Skill
    state: State
    goes_on: bool = False


class IntroducedBackEnds(tuple[BackEnd, ...]):
    """Back ends that have been introduced to each other, which is done once."""

    __slots__ = ()


class Recipe(NamedTuple):
    """What it takes to make a back end again in another process.

    Parameters
    ----------
    plugin, options
        Its class, and how it is made.
    screens
        As of the back end.
    """

    plugin: type[BackEnd]
    options: BaseModel
    screens: bool

    @classmethod
    def of(cls, back_end: BackEnd) -> Recipe:
        """Return that of a back end."""
        return cls(type(back_end), back_end.options, back_end.screens)


def construct(task: Task, wanted: Iterable[Recipe]) -> list[BackEnd]:
    """Return back ends, made in a process of their own.

    Raises
    ------
    BackEndError
        If one fails to start.
    """
    made = []
    for recipe in wanted:
        try:
            made.append(recipe.plugin(task, recipe.options))
        except BaseException as error:
            _blame(error, recipe.plugin, " to start in a process of its own")
        made[-1].screens = recipe.screens
    return made


def introduce(back_ends: Sequence[BackEnd]) -> IntroducedBackEnds:
    """Introduce the back ends that are queried together to each other.

    Returns
    -------
    IntroducedBackEnds
        The back ends in the given order.

    Raises
    ------
    BackEndError
        If one raises, or what its answers depend on is not JSON.
    """
    for back_end in back_ends:
        try:
            back_end.beside([other for other in back_ends if other is not back_end])
            fault = json_fault(back_end.basis)
        except BaseException as error:
            _blame(error, back_end)
        if fault is not None:
            raise BackEndError(f"The basis of back end {back_end.name!r} is not JSON: {fault}.")
    return IntroducedBackEnds(back_ends)


def list_not_checked(back_ends: Sequence[BackEnd]) -> tuple[str, ...]:
    """Return the sentences of all back ends about what they leave unchecked, each once.

    Raises
    ------
    BackEndError
        If one raises.
    """
    sentences: dict[str, None] = {}
    for back_end in back_ends:
        try:
            sentences.update(dict.fromkeys(map(str, back_end.not_checked())))
        except BaseException as error:
            _blame(error, back_end)
    return tuple(sentences)


def check(back_end: BackEnd, skill: Skill, state: State) -> Checked:
    """Query a back end about a skill that is applicable in a state.

    Raises
    ------
    BackEndError
        If it raises instead of checking, returns something else than a verdict, or its verdict
        rests on facts that do not hold.
    """
    begin_s = time.perf_counter()
    try:
        verdict = _query(back_end, skill, state)
    except BaseException as error:
        _blame(error, back_end, f" on {skill.name} in {state}")
    took_s = time.perf_counter() - begin_s
    if not isinstance(verdict, Verdict):
        raise BackEndError(
            f"Back end {back_end.name!r} returned {type(verdict).__name__} for "
            f"{skill.name}, not a Verdict."
        )
    if verdict.evidence:
        fault = json_fault(verdict.evidence)
        if fault is not None:
            raise BackEndError(
                f"The evidence of back end {back_end.name!r} for {skill.name} is not JSON: {fault}."
            )
        # As a file or another process gives it back: lists for tuples, plain numbers.
        verdict = replace(verdict, evidence=json.loads(json.dumps(dict(verdict.evidence))))
    verdict = verdict.grounded(state, back_end.name)
    if not verdict.applies_in(state):
        raise BackEndError(
            f"Back end {back_end.name!r} says its verdict on {skill.name} rests on facts "
            f"that do not hold in {state}: {', '.join(verdict.facts)}."
        )
    return Checked(verdict, took_s)


def _query(back_end: BackEnd, skill: Skill, state: State) -> Verdict:
    """Return the verdict; a process that crashes or hangs meanwhile names a back end of others."""
    if type(back_end).__module__.startswith("skillplan"):
        return back_end.check(skill, state)
    with doing(f"a check of {skill.name} by the back end {back_end.name!r}"):
        return back_end.check(skill, state)


def execution_time_s(back_end: BackEnd, skill: Skill, state: State) -> float | None:
    """Return how long a back end says that a skill takes from a state [s], or None.

    Raises
    ------
    BackEndError
        If it raises, or says what is no time.
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


def least_execution_time_s(
    back_end: BackEnd, skill: Skill, true_bits: int, false_bits: int
) -> float:
    """Return a back end's lower bound on how long a skill takes [s]; see `least_duration_s`.

    Raises
    ------
    BackEndError
        If it raises, or says what is no time.
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


def tells_time(back_end: type[BackEnd]) -> bool:
    """Whether back ends of a class may know how long skills take."""
    return back_end.duration_s is not BackEnd.duration_s


def _blame(error: BaseException, back_end: BackEnd | type[BackEnd], on: str = "") -> NoReturn:
    blame(
        error,
        back_end if isinstance(back_end, type) else type(back_end),
        lambda words: f"Back end {back_end.name!r} failed{on}: {words}",
        BackEndError,
        BackEndError,
    )
