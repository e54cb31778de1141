"""Complete feasibility of a task: every applicable skill in every reachable state."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from skillplan.checks.feasibility import Feasibility
from skillplan.model.skill_model import SkillModel
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.verdict import VerdictStatus

Query = tuple[Skill, State]


@dataclass(frozen=True, slots=True)
class Enumeration:
    """Numbers of queries and verdicts.

    Parameters
    ----------
    states
        States in which skills were checked.
    queries
        Pairs of such a state and an applicable skill.
    feasible, unknown
        Queries with these verdicts.
    checks
        Queries that made at least one back end check.
    hits
        Queries that kept verdicts answered.
    executions
        Queries that made an expensive back end check, or any back end if none is expensive.
    executions_by_state
        The same number if verdicts were kept by state and skill instead of by facts.
    complete
        True if the enumeration was completed.
    """

    states: int
    queries: int
    feasible: int
    unknown: int
    checks: int
    hits: int
    executions: int
    executions_by_state: int
    complete: bool

    def __post_init__(self) -> None:
        counts = [getattr(self, name) for name in self.__slots__ if name != "complete"]
        if min(counts) < 0:
            raise ValueError("There cannot be fewer than 0 states, queries or checks.")


def enumerate_feasibility(
    feasibility: Feasibility, stopped: Callable[[], bool] = lambda: False
) -> Enumeration:
    """Check all states that feasible skills reach within the step limit.

    Breadth first, all states of one distance together. Idle workers check ahead, for the next
    distances, as if all unknown verdicts were feasible. Goal states are not expanded.

    Parameters
    ----------
    feasibility
        A new chain of checks.
    stopped
        Returns True to stop; called several times a second. Checks in progress are aborted.

    Raises
    ------
    BackEndError
        If a back end fails.
    """
    model = SkillModel(feasibility)
    task = feasibility.task
    level = list(dict.fromkeys((task.initial, *task.starts)))
    seen = set(level)
    states = queries = feasible = unknown = 0
    complete = True

    def poll() -> None:
        if stopped():
            raise _Stopped

    for _ in range(task.step_limit):
        checks = _queries(model, level)
        try:
            poll()
            likely = partial(_likely, feasibility, model, checks, frozenset(seen))
            verdicts = feasibility.verdicts(checks, poll, likely)
        except _Stopped:
            complete = False
            break
        states += len(level)
        queries += len(checks)
        unknown += sum(verdict.status is VerdictStatus.UNKNOWN for verdict in verdicts)
        following: dict[State, None] = {}
        for (skill, state), verdict in zip(checks, verdicts, strict=True):
            if verdict.is_feasible:
                feasible += 1
                for outcome in skill.outcomes_in(state):
                    following[outcome.apply(state)] = None
        level = [state for state in following if state not in seen]
        seen.update(level)
        if not level:
            break
    return Enumeration(
        states,
        queries,
        feasible,
        unknown,
        feasibility.checks,
        feasibility.hits,
        feasibility.executions,
        feasibility.reached,
        complete,
    )


def _queries(model: SkillModel, level: Iterable[State]) -> list[Query]:
    """Return the queries about states."""
    return [
        (skill, state)
        for state in level
        if not model.is_goal(state)
        for skill in model.applicable(state)
    ]


def _likely(
    feasibility: Feasibility, model: SkillModel, queries: Sequence[Query], seen: Collection[State]
) -> Iterator[tuple[State, Skill]]:
    """Yield the queries of the next distances, as if all unknown verdicts were feasible."""
    foresight = feasibility.foresight
    assert foresight is not None
    seen = set(seen)
    while queries:
        following: dict[State, None] = {}
        for skill, state in queries:
            if foresight.expected(skill, state) is not False:
                for outcome in skill.outcomes_in(state):
                    following[outcome.apply(state)] = None
        level = [state for state in following if state not in seen]
        seen.update(level)
        queries = _queries(model, level)
        for skill, state in queries:
            if foresight.expected(skill, state) is None:
                yield state, skill


class _Stopped(Exception):
    """Ends the enumeration early."""
