"""Trials of collision detectors on executions that are known to be right or wrong.

An execution is right if the hand-made chart allows it or, without a chart, if more than half of the
back ends accept it. Wrong executions have an injected fault
(:mod:`skillplan.trials.fault_injection`), or an order in which a part passes through another or is
set down without support.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain, cycle

from skillplan.chart.hypothetical_state import HypotheticalStates
from skillplan.checks.single_check import check, introduce
from skillplan.checks.verdict_cache import VerdictCache
from skillplan.collision.boxes import WorldBox, contact_area, sweep_hits, world_boxes
from skillplan.collision.precedence import PrecedenceDetector
from skillplan.task.back_end import BackEnd
from skillplan.task.motion import Event, Visit
from skillplan.task.scene import Pose
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict, VerdictStatus
from skillplan.trials.fault_injection import (
    LEAST_HIT_M,
    Trial,
    Truth,
    find_standing_boxes,
    inject_collisions,
    inject_near_misses,
    is_possible,
)

# A part with this gap below it, and this room around it, touches nothing [m].
_GAP_M = 0.001
_ROOM_M = 0.005


def find_wrong_orders(task: Task, legitimate: Sequence[Trial]) -> Iterator[Trial]:
    """Yield executions that go wrong because of earlier or missing operations.

    After another operation, the held part may come down on a part. Without a support, it falls
    without contact.
    """
    hypothetical = HypotheticalStates(task)
    seen: set[tuple[str, str, frozenset[str]]] = set()
    for trial in legitimate:
        skill = trial.skill
        visit = _get_last_visit(skill, trial.state)
        if visit is None or visit.event not in (Event.RELEASE, Event.DRIVE):
            continue
        done = {operation for operation, fact in task.operations.items() if fact in trial.state}
        fewer = [frozenset(done - {operation}) for operation in sorted(done)]
        more = [
            frozenset(done | {operation})
            for operation in task.operations
            if operation != visit.subject
        ]
        for others in dict.fromkeys([frozenset(), *fewer, *more]):
            if others == done:
                continue
            state = hypothetical.before(skill, others)
            standing = find_standing_boxes(task, state)
            if not is_possible(standing):
                continue
            fault = _find_fault(task, skill, visit, standing)
            key = (skill.name, fault[1] if fault else "", frozenset(standing))
            if fault is None or key in seen or not skill.applicable(state):
                continue
            seen.add(key)
            truth, words, kind = fault
            yield Trial(task, skill, state, truth, kind, words)


def _find_fault(
    task: Task, skill: Skill, visit: Visit, standing: dict[str, tuple[WorldBox, ...]]
) -> tuple[Truth, str, str] | None:
    """Return truth, words and kind of a fault that geometry alone proves; None without one."""
    assert skill.motion is not None
    safe_m = task.scene.robot(skill.motion.robot).safe_height_m
    body = task.scene.body(visit.subject)
    boxes = world_boxes(body, Pose.upright(visit.position, visit.yaw_rad))
    by = (0.0, 0.0, safe_m - visit.position[2])
    others = {name: solids for name, solids in standing.items() if name != body.name}
    for name, obstacles in others.items():
        if any(sweep_hits(box, by, other, LEAST_HIT_M) for box in boxes for other in obstacles):
            return Truth.COLLISION, f"{name} stands in the way of {body.name}", "wrong order"
    floor_m = min(box.low[2] for box in boxes)
    solids = [box for obstacles in others.values() for box in obstacles]
    supported = floor_m <= _GAP_M or any(
        contact_area(box, top, _GAP_M) for box in boxes for top in solids
    )
    crowded = any(sweep_hits(_grow(box), by, other, 0.0) for box in boxes for other in solids)
    if supported or crowded:
        return None
    # It must fall on the table: a body below it would be hit.
    drop = (0.0, 0.0, -floor_m)
    if any(sweep_hits(_grow(box), drop, other, 0.0) for box in boxes for other in solids):
        return None
    return Truth.OUTCOME, f"{body.name} has nothing beneath it", "no support"


def _grow(box: WorldBox) -> WorldBox:
    low, high = box.low, box.high
    return WorldBox(
        (low[0] - _ROOM_M, low[1] - _ROOM_M, low[2]),
        (high[0] + _ROOM_M, high[1] + _ROOM_M, high[2]),
    )


def _get_last_visit(skill: Skill, state: State) -> Visit | None:
    return None if skill.motion is None else skill.motion.visits(state)[-1]


CHART = "the hand-made chart"


@dataclass(frozen=True)
class CheckedTrial:
    """A trial and the verdicts on it, by back end."""

    trial: Trial
    verdicts: dict[str, Verdict] = field(hash=False)


@dataclass(frozen=True)
class DetectorTrials:
    """Checked trials of a task.

    Parameters
    ----------
    engine
        Name of the engine; it also gives verdicts on cases that detectors leave to it.
    reference
        Criterion of right executions, as text.
    checked
        The trials in the order of the checks.
    stopped
        True if the checks ended early.
    """

    task: Task
    engine: str
    detectors: tuple[str, ...]
    reference: str
    checked: tuple[CheckedTrial, ...]
    stopped: bool = False

    def of(self, truth: Truth) -> list[CheckedTrial]:
        """Return the checked trials with a given truth."""
        return [checked for checked in self.checked if checked.trial.truth is truth]

    def count(self, truth: Truth, name: str, status: VerdictStatus) -> int:
        """Return the number of trials with a given truth on which a back end has this verdict."""
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
    make
        Makes the engine and the detectors for a task, the engine first. Called again for every task
        with an injected fault.
    faults
        Largest number of injected collisions, and of near misses, >= 0, spread over kinds and
        skills.
    note
        Called after every trial.
    stopped
        Called before every trial; returns True to stop.

    Raises
    ------
    BackEndError
        If a back end fails.
    """
    back_ends = list(make(task))
    introduce(back_ends)
    results: list[CheckedTrial] = []
    legitimate: list[Trial] = []
    interrupted = False

    def try_one(trial: Trial, checkers: Sequence[BackEnd]) -> bool:
        verdicts = {
            checker.name: check(checker, trial.skill, trial.state).verdict for checker in checkers
        }
        results.append(CheckedTrial(trial, verdicts))
        note()
        return not stopped()

    for checked in _check_right_executions(task, back_ends):
        results.append(checked)
        legitimate.append(checked.trial)
        note()
        if stopped():
            interrupted = True
            break
    if not interrupted:
        for trial in chain(
            _choose_faults(legitimate, inject_near_misses, faults),
            find_wrong_orders(task, legitimate),
            _choose_faults(legitimate, inject_collisions, faults),
        ):
            checkers = back_ends
            if trial.task is not task:
                checkers = list(make(trial.task))
                introduce(checkers)
            if not try_one(trial, checkers):
                interrupted = True
                break
    reference = CHART if task.chart else "more than half of the back ends grant"
    names = tuple(back_end.name for back_end in back_ends[1:])
    return DetectorTrials(task, back_ends[0].name, names, reference, tuple(results), interrupted)


def _check_right_executions(task: Task, back_ends: Sequence[BackEnd]) -> Iterator[CheckedTrial]:
    """Yield a checked trial for every class of right executions, breadth-first.

    Executions belong to one class if they agree on all facts that the verdicts rest on.
    """
    chart = PrecedenceDetector(task) if task.chart else None
    cache = VerdictCache()
    level, seen = [task.initial], {task.initial}
    while level:
        following = []
        for state in level:
            for skill in task.skills:
                if not skill.applicable(state):
                    continue
                if chart is not None and not chart.check(skill, state).is_feasible:
                    continue
                for variant in [skill.by(way) for way in skill.ways] or [skill]:
                    new, verdicts = _query(cache, back_ends, variant, state)
                    accepted = sum(verdict.is_feasible for verdict in verdicts.values())
                    if 2 * accepted > len(back_ends) or (chart is not None and not skill.ways):
                        break
                else:
                    continue
                if new:
                    yield CheckedTrial(Trial(task, variant, state, Truth.LEGITIMATE), verdicts)
                after = skill.prediction_in(state).apply(state)
                if after not in seen and not task.goal.holds(state):
                    seen.add(after)
                    following.append(after)
        level = following


def _query(
    cache: VerdictCache, back_ends: Sequence[BackEnd], skill: Skill, state: State
) -> tuple[bool, dict[str, Verdict]]:
    """Return True if a back end had to be queried, and the verdicts by back end."""
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


def _choose_faults(
    legitimate: Sequence[Trial], inject: Callable[[Task, Skill, State], Iterator[Trial]], most: int
) -> Iterator[Trial]:
    """Yield injected faults of all kinds in turn, and within a kind of all skills in turn."""
    by_kind: dict[str, dict[str, list[Trial]]] = {}
    for trial in legitimate:
        for injected in inject(trial.task, trial.skill, trial.state):
            skills = by_kind.setdefault(injected.kind, {})
            skills.setdefault(injected.skill.name, []).append(injected)
    queues = {
        # Each kind begins with another skill, so that few trials cover many skills.
        kind: _alternate(skills, begin)
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


def _alternate(skills: dict[str, list[Trial]], begin: int) -> Iterator[Trial]:
    """Yield one trial per skill, then the next per skill, each time with a new description."""
    used: set[tuple[str, str]] = set()
    names = list(skills)
    begin %= len(names)
    remaining = {name: list(skills[name]) for name in (*names[begin:], *names[:begin])}
    while remaining:
        for name in list(remaining):
            trials = remaining[name]
            new = next((trial for trial in trials if (name, trial.fault) not in used), None)
            if new is None:
                del remaining[name]
                continue
            used.add((name, new.fault))
            trials.remove(new)
            yield new
