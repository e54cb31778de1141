"""Detectors tried on executions of which it is known whether they are right.

Right are those that the hand-made chart allows or, where a task has none, those that more than
half of the back ends accept. Wrong ones have an injected fault, see
:mod:`skillplan.trials.fault_injection`, or an order in which a part is put through another or
set down on nothing, see :mod:`skillplan.trials.wrong_orders`.
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
class CheckedTrial:
    """A trial and the verdicts of the back ends on it.

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
    """Trials and their verdicts, as far as they were checked.

    Parameters
    ----------
    task
        What the trials are made of.
    engine
        The engine's name. It gives verdicts, too, on what detectors leave to it.
    detectors
        Their names.
    reference
        What says that an execution is right, in words.
    checked
        In the order of the checks.
    stopped
        Whether the checks were ended early.
    """

    task: Task
    engine: str
    detectors: tuple[str, ...]
    reference: str
    checked: tuple[CheckedTrial, ...]
    stopped: bool = False

    def of(self, truth: Truth) -> list[CheckedTrial]:
        """Return the checked trials of one truth."""
        return [checked for checked in self.checked if checked.trial.truth is truth]

    def count(self, truth: Truth, name: str, status: VerdictStatus) -> int:
        """Return on how many trials of one truth a back end gives this verdict."""
        return sum(checked.verdicts[name].status is status for checked in self.of(truth))


def try_detectors(
    task: Task,
    make: Callable[[Task], Sequence[BackEnd]],
    faults: int = 40,
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
        Returns engine and detectors for a task, the engine first. Called again for every task
        with an injected fault.
    faults
        How many collisions are injected at most, >= 0, of all kinds and skills in turn; and how
        many near misses.
    note
        Called after every trial.
    stopped
        Called before every trial; once true, what is known is returned.

    Raises
    ------
    BackEndError
        If a back end fails.
    """
    back_ends = list(make(task))
    introduce(back_ends)
    found: list[CheckedTrial] = []
    legitimate: list[Trial] = []
    interrupted = False

    def try_one(trial: Trial, checkers: Sequence[BackEnd]) -> bool:
        verdicts = {one.name: check(one, trial.skill, trial.state).verdict for one in checkers}
        found.append(CheckedTrial(trial, verdicts))
        note()
        return not stopped()

    for checked in _legitimate(task, back_ends):
        found.append(checked)
        legitimate.append(checked.trial)
        note()
        if stopped():
            interrupted = True
            break
    if not interrupted:
        for trial in chain(
            _chosen(legitimate, near_misses, faults),
            wrong_orders(task, legitimate),
            _chosen(legitimate, injected_collisions, faults),
        ):
            checkers = back_ends
            if trial.task is not task:
                checkers = list(make(trial.task))
                introduce(checkers)
            if not try_one(trial, checkers):
                interrupted = True
                break
    reference = CHART if task.chart else "more than half of the back ends grant"
    names = tuple(one.name for one in back_ends[1:])
    return DetectorTrials(task, back_ends[0].name, names, reference, tuple(found), interrupted)


def _legitimate(task: Task, back_ends: Sequence[BackEnd]) -> Iterator[CheckedTrial]:
    """Yield a checked trial for every class of right executions, breadth first.

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
                for one in [skill.by(way) for way in skill.ways] or [skill]:
                    new, verdicts = _asked(cache, back_ends, one, state)
                    most = 2 * sum(said.is_feasible for said in verdicts.values()) > len(back_ends)
                    if most or (chart is not None and not skill.ways):
                        break
                else:
                    continue
                if new:
                    yield CheckedTrial(Trial(task, one, state, Truth.LEGITIMATE), verdicts)
                after = skill.prediction_in(state).apply(state)
                if after not in seen and not task.goal.holds(state):
                    seen.add(after)
                    following.append(after)
        level = following


def _asked(
    cache: VerdictCache, back_ends: Sequence[BackEnd], skill: Skill, state: State
) -> tuple[bool, dict[str, Verdict]]:
    """Return whether a back end had to be queried, and what each says by its name."""
    new = False
    verdicts = dict[str, Verdict]()
    for back_end in back_ends:
        verdict = cache.find(back_end, skill, state)
        if verdict is None:
            new = True
            checked = check(back_end, skill, state)
            cache.keep(back_end, skill, checked, state)
            verdict = checked.verdict
        verdicts[back_end.name] = verdict
    return new, verdicts


def _chosen(
    legitimate: Sequence[Trial],
    inject: Callable[[Task, Skill, State], Iterator[Trial]],
    most: int,
) -> Iterator[Trial]:
    """Yield injected faults of all kinds in turn, and of a kind those of all skills in turn."""
    by_kind: dict[str, dict[str, list[Trial]]] = {}
    for trial in legitimate:
        for injected in inject(trial.task, trial.skill, trial.state):
            skills = by_kind.setdefault(injected.kind, {})
            skills.setdefault(injected.skill.name, []).append(injected)
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
            new = next((one for one in trials if (name, one.fault) not in said), None)
            if new is None:
                del remaining[name]
                continue
            said.add((name, new.fault))
            trials.remove(new)
            yield new
