"""Detectors tried on executions of which it is known whether they are right.

Right are those that the hand-made chart allows or, where a task has none, those that more than
half of the back ends grant. Wrong ones are staged, see
:mod:`skillplan.trials.fault_injection`, or come of orders in which a part is put through
another or down on nothing, see :mod:`skillplan.trials.wrong_orders`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain, cycle

from skillplan.checks.single_check import check, introduce
from skillplan.checks.verdict_cache import VerdictCache
from skillplan.collision.precedence import PrecedenceDetector
from skillplan.task.back_end import BackEnd
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict, VerdictStatus
from skillplan.trials.detector_trial import Trial, Truth
from skillplan.trials.fault_injection import injected_collisions, near_misses
from skillplan.trials.wrong_orders import wrong_orders

CHART = "the hand-made chart"


@dataclass(frozen=True)
class Ruling:
    """What the back ends say of one trial.

    Parameters
    ----------
    trial
        The execution.
    verdicts
        By the back end's name.
    """

    trial: Trial
    verdicts: dict[str, Verdict] = field(hash=False)


@dataclass(frozen=True)
class DetectorTrials:
    """Rulings on trials, as far as they were asked.

    Parameters
    ----------
    task
        What the trials are made of.
    engine
        The engine's name: it rules as well, on what detectors leave to it.
    detectors
        Their names.
    reference
        What says that an execution is right, in words.
    rulings
        In the order of asking.
    stopped
        Whether the asking was ended early.
    """

    task: Task
    engine: str
    detectors: tuple[str, ...]
    reference: str
    rulings: tuple[Ruling, ...]
    stopped: bool = False

    def of(self, truth: Truth) -> list[Ruling]:
        """Return the rulings on trials of one truth."""
        return [ruling for ruling in self.rulings if ruling.trial.truth is truth]

    def count(self, truth: Truth, name: str, status: VerdictStatus) -> int:
        """Return on how many trials of one truth a back end rules so."""
        return sum(ruling.verdicts[name].status is status for ruling in self.of(truth))


def try_detectors(
    task: Task,
    make: Callable[[Task], Sequence[BackEnd]],
    staged: int = 40,
    *,
    note: Callable[[], None] = lambda: None,
    stopped: Callable[[], bool] = lambda: False,
) -> DetectorTrials:
    """Try detectors on right executions, collisions and wrong outcomes of a task.

    Parameters
    ----------
    task
        With bodies.
    make
        Returns engine and detectors for a task, the engine first; asked again for every task in
        which something stands that should not.
    staged
        How many collisions are staged at most, >= 0, of all kinds and skills in turn; and how
        many near misses.
    note
        Called after every trial.
    stopped
        Asked before every trial; once true, what is known is returned.

    Raises
    ------
    BackEndError
        If a back end fails.
    """
    back_ends = list(make(task))
    introduce(back_ends)
    rulings: list[Ruling] = []
    legitimate: list[Trial] = []
    told_to_stop = False

    def rule(trial: Trial, asked: Sequence[BackEnd]) -> bool:
        verdicts = {one.name: check(one, trial.skill, trial.state).verdict for one in asked}
        rulings.append(Ruling(trial, verdicts))
        note()
        return not stopped()

    for ruling in _legitimate(task, back_ends):
        rulings.append(ruling)
        legitimate.append(ruling.trial)
        note()
        if stopped():
            told_to_stop = True
            break
    if not told_to_stop:
        for trial in chain(
            _chosen(legitimate, near_misses, staged),
            wrong_orders(task, legitimate),
            _chosen(legitimate, injected_collisions, staged),
        ):
            asked = back_ends
            if trial.task is not task:
                asked = list(make(trial.task))
                introduce(asked)
            if not rule(trial, asked):
                told_to_stop = True
                break
    reference = CHART if task.chart else "more than half of the back ends grant"
    names = tuple(one.name for one in back_ends[1:])
    return DetectorTrials(task, back_ends[0].name, names, reference, tuple(rulings), told_to_stop)


def _legitimate(task: Task, back_ends: Sequence[BackEnd]) -> Iterator[Ruling]:
    """Yield a ruling for every class of right executions, breadth first.

    Of executions that agree on all facts that a back end's verdict rests on, one is enough.
    """
    chart = PrecedenceDetector(task) if task.chart else None
    cache = VerdictCache()
    level, seen = [task.initial], {task.initial}
    while level:
        following = []
        for state in level:
            for skill in (one for one in task.skills if one.applicable(state)):
                if chart is not None and not chart.check(skill, state).is_feasible:
                    continue
                known = {one.name: cache.find(one, skill, state) for one in back_ends}
                verdicts = dict[str, Verdict]()
                for back_end in back_ends:
                    verdict = known[back_end.name]
                    if verdict is None:
                        checked = check(back_end, skill, state)
                        cache.keep(back_end, skill, checked, state)
                        verdict = checked.verdict
                    verdicts[back_end.name] = verdict
                granted = sum(verdict.is_feasible for verdict in verdicts.values())
                if chart is None and 2 * granted <= len(back_ends):
                    continue
                if None in known.values():
                    yield Ruling(Trial(task, skill, state, Truth.LEGITIMATE), verdicts)
                after = skill.prediction_in(state).apply(state)
                if after not in seen and not task.goal.holds(state):
                    seen.add(after)
                    following.append(after)
        level = following


def _chosen(
    legitimate: Sequence[Trial],
    stage: Callable[[Task, Skill, State], Iterator[Trial]],
    most: int,
) -> Iterator[Trial]:
    """Yield what is staged of all kinds in turn, and of a kind of all skills in turn."""
    by_kind: dict[str, dict[str, list[Trial]]] = {}
    for trial in legitimate:
        for staged in stage(trial.task, trial.skill, trial.state):
            skills = by_kind.setdefault(staged.kind, {})
            skills.setdefault(staged.skill.name, []).append(staged)
    queues = {
        # Every kind begins with another skill, so that few trials show many skills.
        kind: _in_turn(skills, begin)
        for begin, (kind, skills) in enumerate(sorted(by_kind.items()))
    }
    given = 0
    for kind in cycle(tuple(queues)):
        if given == most or not queues:
            return
        if kind not in queues:
            continue
        following = next(queues[kind], None)
        if following is None:
            del queues[kind]
            continue
        given += 1
        yield following


def _in_turn(skills: dict[str, list[Trial]], begin: int) -> Iterator[Trial]:
    """Yield one trial of every skill, then the next of every skill, with other words each time."""
    said: set[tuple[str, str]] = set()
    names = list(skills)
    begin %= len(names)
    remaining = {name: list(skills[name]) for name in (*names[begin:], *names[:begin])}
    while remaining:
        for name in list(remaining):
            trials = remaining[name]
            new = next((one for one in trials if (name, one.staged) not in said), None)
            if new is None:
                del remaining[name]
                continue
            said.add((name, new.staged))
            trials.remove(new)
            yield new
