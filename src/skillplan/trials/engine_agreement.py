"""Comparison of engines: every applicable skill in every state that any engine can reach."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from skillplan.checks.feasibility import Feasibility
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict

Query = tuple[Skill, State]


@dataclass(frozen=True)
class Contradiction:
    """A query on which engines differ.

    Parameters
    ----------
    skill, state
        The skill, and the first such state.
    stages
        By engine, the verdicts of all its back ends, also beyond the deciding one.
    states
        Number of states with the same verdicts on this skill.
    """

    skill: Skill
    state: State
    verdicts: Mapping[str, Verdict] = field(hash=False)
    stages: Mapping[str, tuple[Verdict, ...]] = field(hash=False)
    states: int = 1


@dataclass(frozen=True)
class EngineAgreement:
    """Result of a comparison of engines.

    Parameters
    ----------
    back_ends
        By engine, the names of its back ends in order.
    states
        Number of states in which skills were checked.
    questions
        Number of pairs of such a state and an applicable skill.
    agree
        Number of pairs with the same verdict of all engines.
    contradictions
        The other pairs, in the order of the search.
    executions
        Number of computed verdicts by engine; others were reused.
    seconds
        Duration by engine [s].
    complete
        True if the comparison was not stopped.
    """

    task: Task
    back_ends: Mapping[str, tuple[str, ...]]
    states: int
    questions: int
    agree: int
    contradictions: tuple[Contradiction, ...]
    executions: Mapping[str, int]
    seconds: Mapping[str, float]
    complete: bool


def compare_engines(
    task: Task,
    engines: Mapping[str, Feasibility],
    *,
    at_once: int = 1,
    note: Callable[[], None] = lambda: None,
    stopped: Callable[[], bool] = lambda: False,
) -> EngineAgreement:
    """Compare engines on every applicable skill in every state that any of them can reach.

    The search is breadth-first within the task's step limit. It also follows skills that only one
    engine grants, and ends in goal states.

    Parameters
    ----------
    engines
        Feasibility checkers by engine, without verdicts.
    at_once
        Number of queries per batch, >= 1.
    note
        Called after every query.
    stopped
        Called before every batch; returns True to stop.

    Raises
    ------
    BackEndError
        If an engine fails.
    """
    findings = _Findings(task, engines)
    level = list(dict.fromkeys((task.initial, *task.starts)))
    seen, complete = set(level), True
    for _ in range(task.step_limit):
        queries = [
            (skill, state)
            for state in level
            if not task.goal.holds(state)
            for skill in task.skills
            if skill.applicable(state)
        ]
        following: dict[State, None] = {}
        for begin in range(0, len(queries), at_once):
            batch = queries[begin : begin + at_once]
            if stopped():
                complete = False
                break
            for (skill, state), granted in zip(batch, findings.check(batch), strict=True):
                note()
                if granted:
                    for outcome in skill.outcomes_in(state):
                        following[outcome.apply(state)] = None
        findings.states += len({state for _, state in queries}) if complete else 0
        level = [state for state in following if state not in seen]
        seen.update(level)
        if not (complete and level):
            break
    return findings.agreement(complete)


class _Findings:
    """Verdicts of the engines so far."""

    def __init__(self, task: Task, engines: Mapping[str, Feasibility]) -> None:
        self.task, self.engines = task, engines
        self.states = self.questions = self.agree = 0
        self.seconds = dict.fromkeys(engines, 0.0)
        self._first: dict[object, Contradiction] = {}
        self._count: dict[object, int] = {}

    def check(self, queries: Sequence[Query]) -> list[bool]:
        """Return a flag per query, true if any engine grants it; record contradictions."""
        verdicts_by_engine = dict[str, list[Verdict]]()
        for name, engine in self.engines.items():
            begin_s = time.perf_counter()
            verdicts_by_engine[name] = engine.verdicts(queries)
            self.seconds[name] += time.perf_counter() - begin_s
        every = zip(*verdicts_by_engine.values(), strict=True)
        granted = []
        for (skill, state), verdicts in zip(queries, every, strict=True):
            self.questions += 1
            if len({verdict.status for verdict in verdicts}) == 1:
                self.agree += 1
            else:
                self._note(skill, state, dict(zip(verdicts_by_engine, verdicts, strict=True)))
            granted.append(any(verdict.is_feasible for verdict in verdicts))
        return granted

    def _note(self, skill: Skill, state: State, verdicts: Mapping[str, Verdict]) -> None:
        words = [
            (verdict.status, verdict.reason, verdict.present, verdict.absent)
            for verdict in verdicts.values()
        ]
        key = (skill.name, *words)
        if key not in self._first:
            stages = {
                name: tuple(engine.stages(skill, state)) for name, engine in self.engines.items()
            }
            self._first[key] = Contradiction(skill, state, verdicts, stages)
        self._count[key] = self._count.get(key, 0) + 1

    def agreement(self, complete: bool) -> EngineAgreement:
        """Return the result."""
        contradictions = tuple(
            replace(first, states=self._count[key]) for key, first in self._first.items()
        )
        names = {
            name: tuple(back_end.name for back_end in engine.back_ends)
            for name, engine in self.engines.items()
        }
        executions = {name: engine.executions for name, engine in self.engines.items()}
        return EngineAgreement(
            self.task,
            names,
            self.states,
            self.questions,
            self.agree,
            contradictions,
            executions,
            self.seconds,
            complete,
        )
