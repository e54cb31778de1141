"""Engines asked the same: every applicable skill in every state that any of them leads to."""

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
        What was asked, and where it was asked first.
    verdicts
        By the engine's name.
    stages
        By the engine's name, the verdicts of all that was asked of it, also beyond what decided.
    states
        In how many states engines differ by the same verdicts on this skill.
    """

    skill: Skill
    state: State
    verdicts: Mapping[str, Verdict] = field(hash=False)
    stages: Mapping[str, tuple[Verdict, ...]] = field(hash=False)
    states: int = 1


@dataclass(frozen=True)
class EngineAgreement:
    """What engines say of a task, as far as they were asked.

    Parameters
    ----------
    task
        Whose skills were checked.
    back_ends
        By the engine's name, the names of all that was asked of it, in that order.
    states
        States in which skills were checked.
    questions
        Pairs of such a state and a skill that is applicable there.
    agree
        Those on which all engines give the same verdict.
    contradictions
        The others, in the order in which they were met.
    executions
        By the engine's name, how many of its verdicts were worked out; the others were reused.
    seconds
        By the engine's name, how long that took [s].
    complete
        Whether it came to its end.
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
    """Ask engines about every applicable skill in every state that any of them leads to.

    Breadth first, within the task's step limit; a skill that only one of them grants is followed,
    too. Where the task is done, nothing is asked any more.

    Parameters
    ----------
    task
        With bodies.
    engines
        The checks of each, by its name, fresh.
    at_once
        How many queries an engine is given at a time, >= 1.
    note
        Called after every query.
    stopped
        Called before every few queries; once true, what is known is returned.

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
            few = queries[begin : begin + at_once]
            if stopped():
                complete = False
                break
            for (skill, state), granted in zip(few, findings.ask(few), strict=True):
                note()
                if granted:
                    following |= {one.apply(state): None for one in skill.outcomes_in(state)}
        findings.states += len({state for _, state in queries}) if complete else 0
        level = [state for state in following if state not in seen]
        seen.update(level)
        if not (complete and level):
            break
    return findings.agreement(complete)


class _Findings:
    """What engines said so far."""

    def __init__(self, task: Task, engines: Mapping[str, Feasibility]) -> None:
        self.task, self.engines = task, engines
        self.states = self.questions = self.agree = 0
        self.seconds = dict.fromkeys(engines, 0.0)
        self._first: dict[object, Contradiction] = {}
        self._count: dict[object, int] = {}

    def ask(self, queries: Sequence[Query]) -> list[bool]:
        """Return whether any engine grants each of some queries; note where they differ."""
        said = dict[str, list[Verdict]]()
        for name, engine in self.engines.items():
            begin_s = time.perf_counter()
            said[name] = engine.verdicts(queries)
            self.seconds[name] += time.perf_counter() - begin_s
        every = zip(*said.values(), strict=True)
        found = []
        for (skill, state), verdicts in zip(queries, every, strict=True):
            self.questions += 1
            if len({verdict.status for verdict in verdicts}) == 1:
                self.agree += 1
            else:
                self._note(skill, state, dict(zip(said, verdicts, strict=True)))
            found.append(any(verdict.is_feasible for verdict in verdicts))
        return found

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
        """Return it."""
        contradictions = tuple(
            replace(one, states=self._count[key]) for key, one in self._first.items()
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
