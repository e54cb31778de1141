"""Detectors tried on executions of which it is known whether they are right.

Right are those that the hand-made chart allows or, where a task has none, those that more than
half of the back ends accept. Wrong ones have an injected fault, see
:mod:`skillplan.trials.fault_injection`, or an order in which a part is put through another or
set down on nothing, see :mod:`skillplan.trials.detector_trials`.
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
    injected_collisions,
    is_possible,
    near_misses,
    standing_boxes,
)

# What has this gap beneath it, and this room around it, touches nothing [m].
_GAP_M = 0.001
_ROOM_M = 0.005


def wrong_orders(task: Task, legitimate: Sequence[Trial]) -> Iterator[Trial]:
    """Yield executions that go wrong because of what was done, or not done, before.

    Where something else is done already, the part in the hand may come down on it. Where nothing
    supports what is set down, it falls without touching anything.
    """
    hypothetical = HypotheticalStates(task)
    seen: set[tuple[str, str, frozenset[str]]] = set()
    for trial in legitimate:
        skill = trial.skill
        visit = _last_visit(skill, trial.state)
        if visit is None or visit.event not in (Event.RELEASE, Event.DRIVE):
            continue
        done = {one for one, fact in task.operations.items() if fact in trial.state}
        fewer = [frozenset(done - {one}) for one in sorted(done)]
        more = [
            frozenset(done | {operation})
            for operation in task.operations
            if operation != visit.subject
        ]
        for others in dict.fromkeys([frozenset(), *fewer, *more]):
            if others == done:
                continue
            state = hypothetical.before(skill, others)
            standing = standing_boxes(task, state)
            if not is_possible(standing):
                continue
            fault = _fault(task, skill, visit, standing)
            key = (skill.name, fault[1] if fault else "", frozenset(standing))
            if fault is None or key in seen or not skill.applicable(state):
                continue
            seen.add(key)
            truth, words, kind = fault
            yield Trial(task, skill, state, truth, kind, words)


def _fault(
    task: Task, skill: Skill, visit: Visit, standing: dict[str, tuple[WorldBox, ...]]
) -> tuple[Truth, str, str] | None:
    """Return what is certain to go wrong, in words, as far as geometry alone says."""
    assert skill.motion is not None
    safe_m = task.scene.robot(skill.motion.robot).safe_height_m
    body = task.scene.body(visit.subject)
    boxes = world_boxes(body, Pose.upright(visit.position, visit.yaw_rad))
    by = (0.0, 0.0, safe_m - visit.position[2])
    others = {name: found for name, found in standing.items() if name != body.name}
    for name, obstacles in others.items():
        if any(sweep_hits(one, by, other, LEAST_HIT_M) for one in boxes for other in obstacles):
            return Truth.COLLISION, f"{name} stands in the way of {body.name}", "wrong order"
    floor_m = min(box.low[2] for box in boxes)
    solids = [box for obstacles in others.values() for box in obstacles]
    supported = floor_m <= _GAP_M or any(
        contact_area(one, top, _GAP_M) for one in boxes for top in solids
    )
    crowded = any(sweep_hits(_grown(one), by, other, 0.0) for one in boxes for other in solids)
    if supported or crowded:
        return None
    # It may fall on the table only: anything else that it lands on would be hit.
    drop = (0.0, 0.0, -floor_m)
    if any(sweep_hits(_grown(one), drop, other, 0.0) for one in boxes for other in solids):
        return None
    return Truth.OUTCOME, f"{body.name} has nothing beneath it", "no support"


def _grown(box: WorldBox) -> WorldBox:
    low, high = box.low, box.high
    return WorldBox(
        (low[0] - _ROOM_M, low[1] - _ROOM_M, low[2]),
        (high[0] + _ROOM_M, high[1] + _ROOM_M, high[2]),
    )


def _last_visit(skill: Skill, state: State) -> Visit | None:
    return None if skill.motion is None else skill.motion.visits(state)[-1]


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
        verdicts = {
            checker.name: check(checker, trial.skill, trial.state).verdict for checker in checkers
        }
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
    names = tuple(back_end.name for back_end in back_ends[1:])
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
                    most = 2 * sum(verdict.is_feasible for verdict in verdicts.values()) > len(
                        back_ends
                    )
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
            new = next((trial for trial in trials if (name, trial.fault) not in said), None)
            if new is None:
                del remaining[name]
                continue
            said.add((name, new.fault))
            trials.remove(new)
            yield new
