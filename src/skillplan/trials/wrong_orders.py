"""Executions that go wrong for what is done, or not done, before, as geometry alone tells."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from skillplan.chart.hypothetical_state import HypotheticalStates
from skillplan.collision.boxes import WorldBox, contact_area, sweep_hits, world_boxes
from skillplan.task.motion import Event, Visit
from skillplan.task.scene import Pose
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.trials.detector_trial import Trial, Truth
from skillplan.trials.fault_injection import LEAST_HIT_M, is_possible, standing_boxes

# What has a gap this wide beneath it, and that much room around it, touches nothing [m].
_GAP_M = 0.001
_ROOM_M = 0.005


def wrong_orders(task: Task, legitimate: Sequence[Trial]) -> Iterator[Trial]:
    """Yield executions that go wrong for what is done, or not done, before.

    Where something else is done besides, the part in the hand may come down on it; where
    nothing bears what is set down, it falls without touching anything.
    """
    hypothetical = HypotheticalStates(task)
    told: set[tuple[str, str, frozenset[str]]] = set()
    for trial in legitimate:
        skill = trial.skill
        visit = _last_visit(skill, trial.state)
        if visit is None or visit.event not in (Event.RELEASE, Event.DRIVE):
            continue
        done = {one for one, fact in task.operations.items() if fact in trial.state}
        fewer = [frozenset(done - {one}) for one in sorted(done)]
        more = [frozenset(done | {one}) for one in task.operations if one != visit.subject]
        for others in dict.fromkeys([frozenset(), *fewer, *more]):
            if others == done:
                continue
            state = hypothetical.before(skill, others)
            standing = standing_boxes(task, state)
            if not is_possible(standing):
                continue
            found = _fault(task, skill, visit, standing)
            key = (skill.name, found[1] if found else "", frozenset(standing))
            if found is None or key in told or not skill.applicable(state):
                continue
            told.add(key)
            truth, words, kind = found
            yield Trial(task, skill, state, truth, kind, words)


def _fault(
    task: Task, skill: Skill, visit: Visit, standing: dict[str, tuple[WorldBox, ...]]
) -> tuple[Truth, str, str] | None:
    """Return what goes wrong for sure, in words, where geometry alone tells."""
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
    borne = floor_m <= _GAP_M or any(
        contact_area(one, top, _GAP_M) for one in boxes for top in solids
    )
    crowded = any(sweep_hits(_grown(one), by, other, 0.0) for one in boxes for other in solids)
    if borne or crowded:
        return None
    # Nor may it land on anything but the table, or what it falls on would be hit.
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
