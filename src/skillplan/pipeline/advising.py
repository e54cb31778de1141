"""Advice on a cell: changes of its file are tried, and the largest savings are listed with proof.

Each change makes a task of its own: it passes the checks of `load_problem`, and the same solver and
back ends solve it. Kinds of changes take turns. Places come in the order in which they shorten the
plan of the file, by costs without back ends, so a few tries find most savings.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby

from skillplan.checks.feasibility import Feasibility
from skillplan.checks.verdict_cache import VerdictCache
from skillplan.domains.domain import CellChange
from skillplan.domains.load import Problem
from skillplan.errors import OptionError, PluginError, SkillplanError
from skillplan.model.replay import replay
from skillplan.model.skill_model import SkillModel
from skillplan.pipeline.setup import Setup, load_problem
from skillplan.pipeline.solving import solve, solve_problem
from skillplan.records.advice import Advice, TimeShares, Tip
from skillplan.records.result import Result, Status, tolerance
from skillplan.solvers.solution import Plan
from skillplan.solvers.stop import Stop
from skillplan.task.scene import WORLD
from skillplan.task.task import Task

MOST_LISTED = 10
"""Number of changes that are listed."""
TRIES = 60
"""Default number of changed tasks that are solved."""
# Turns of a kind of change in each round; 1 for others.
_TURNS = {"place": 3}
# Greatest number of shifts of a place without a plan in one turn.
_MOST_IN_VAIN = 2
# Distance at which a hand next to a body meets it [m].
_CLOSE_M = 0.03
_AXES = ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0))
# Kinds of skills that change the tool.
_TOOL_CHANGES = ("load", "offload", "turn")


@dataclass(frozen=True, slots=True)
class Try:
    """A change that was tried.

    Parameters
    ----------
    number, most
        Number of the try from 1, and the greatest number of tries.
    saving
        None if the changed task has no plan.
    """

    number: int
    most: int
    words: str
    saving: float | None


@dataclass
class _Item:
    """The changes of one thing, the most promising first."""

    kind: str
    name: str
    changes: list[CellChange]
    promise: float = 0.0


@dataclass
class _Tally:
    proposed: int = 0
    tried: int = 0
    refused: int = 0
    useless: int = 0
    longer: int = 0
    wrong: int = 0
    cut: int = 0
    planned: int = 0
    best: dict[str, Tip] = field(default_factory=dict)

    def add(self, change: CellChange, result: Result, base_cost: float) -> float | None:
        """Count the result of a change, and return its saving; None without a plan."""
        self.tried += 1
        self.wrong += result.status is Status.WRONG
        self.planned += result.cost is not None
        saving = None if result.cost is None else base_cost - result.cost
        if saving is None or saving <= tolerance(base_cost):
            self.useless += 1
        else:
            tip = Tip(change.item, change.words, change.changes, result, saving)
            now = self.best.get(change.item)
            if now is None or saving > now.saving:
                self.best[change.item] = tip
        return saving


def advise(
    problem: Problem,
    setup: Setup = Setup(),
    *,
    changes: Mapping[str, str] | None = None,
    solver: str | None = None,
    start: Sequence[str] | None = None,
    within_m: float = 0.2,
    tries: int = TRIES,
    stop: Stop | None = None,
    cache: VerdictCache | None = None,
    jobs: int = 1,
    on_try: Callable[[Try], None] = lambda done: None,
) -> Advice:
    """Return the changes of a cell that save most.

    Parameters
    ----------
    problem
        A file with a single task.
    changes
        Changes with which `problem` was loaded, as for `load_problem`.
    solver
        A solver's name; None for the default of the kind of task.
    start
        Skills of a known plan of the file.
    within_m
        Greatest shift of a place along x and along y [m], > 0.
    tries
        Greatest number of changed tasks that are solved, >= 1.
    stop
        Limits of the whole search; advice so far is returned at the end.

    Raises
    ------
    OptionError
        If a number is out of range, or the kind of task has no changes to propose.
    TaskError
        If the file describes a chain.
    """
    if not within_m > 0 or tries < 1:
        raise OptionError(f"Advice needs within > 0 and tries >= 1, not {within_m} and {tries}.")
    stop, begin_s = stop or Stop(), time.perf_counter()
    task = problem.part(None)
    proposals = list(list_changes(problem, within_m))
    if not proposals:
        raise OptionError(f"A task of kind {problem.kind!r} has no changes to try.")
    solver = solver or problem.domain.default_solver(problem.config)
    known = None if start is None else Plan(tuple(start))
    base = solve_problem(
        problem, None, solver, setup, stop=stop, cache=cache, jobs=jobs, start=known
    )
    assert isinstance(base, Result)
    shares = None if base.cost is None else share_times(task, base)
    advice = Advice(base, shares, within_m, interrupted=stop.interrupted, proposed=len(proposals))
    advice = replace(advice, decimals=task.metric.decimals)
    if base.cost is None:
        return replace(advice, reason="the file as it is has no plan to compare with")
    tally = _Tally(len(proposals))
    items = _rank(problem, base, proposals, tally)
    for change in _take_turns(items, tally, tries, stop):
        result = _solve_changed(
            problem, {**(changes or {}), **change.changes}, solver, setup, stop, jobs
        )
        if stop.reason is not None and (result is None or result.status is not Status.OPTIMAL):
            # Cut short: its plan may be far from the best.
            stop.renew()
            if stop():
                break
            # By a limit of the solver for this task alone.
            tally.tried += result is not None
            tally.cut += result is not None
            tally.refused += result is None
            continue
        if result is None:
            tally.refused += 1
            continue
        saving = tally.add(change, result, base.cost)
        on_try(Try(tally.tried, tries, change.words, saving))
    left = sum(len(item.changes) for item in items)
    tips = sorted(tally.best.values(), key=lambda tip: -tip.saving)[:MOST_LISTED]
    return replace(
        advice,
        tips=tuple(tips),
        tried=tally.tried,
        refused=tally.refused,
        useless=tally.useless,
        longer=tally.longer,
        wrong=tally.wrong,
        cut=tally.cut,
        reason=(stop.reason or f"limit of {tries} tries") if left else "",
        interrupted=stop.interrupted,
        stats={"wall_s": time.perf_counter() - begin_s},
    )


def share_times(task: Task, result: Result) -> TimeShares:
    """Return the time of a plan by travel, work, tool change and waiting."""
    travel_s = work_s = change_s = wait_s = 0.0
    state = task.initial
    for step in result.steps:
        skill = task.skill(step.skill)
        if skill.kind in _TOOL_CHANGES:
            change_s += step.duration_s
        else:
            visits = () if skill.motion is None else skill.motion.visits(state)
            busy_s = step.duration_s - step.wait_s
            dwell_s = min(busy_s, sum(visit.acts_s for visit in visits))
            work_s += dwell_s
            travel_s += busy_s - dwell_s
            wait_s += step.wait_s
        state = skill.prediction_in(state).apply(state)
    return TimeShares(travel_s, work_s, change_s, wait_s)


def list_changes(problem: Problem, within_m: float) -> Iterator[CellChange]:
    """Yield the changes of a file that may save cost, named by its own entries.

    The parts of a count change together, as their first. What follows from another entry, such as
    the start in a tray, is no change of its own.
    """
    document = problem.document
    first: dict[tuple[str | int, ...], tuple[str | int, ...]] = {}
    for target, source in document.sources.items():
        first.setdefault(source, target)
    for change in problem.domain.list_changes(problem.config, within_m):
        values, words, item = {}, change.words, change.item
        for key, value in change.changes.items():
            path = tuple(key.split("."))
            lengths = [n for n in range(len(path), 0, -1) if path[:n] in document.sources]
            if not lengths:
                values[key] = value
                continue
            target = path[: lengths[0]]
            source = document.sources[target]
            entry = document.sources.get(path[:2], source)
            if lengths[0] > len(entry) or first[entry] != path[:2]:
                continue
            values[".".join(map(str, (*source, *path[lengths[0] :])))] = value
            words, item = (_rename(text, path[:2], entry) for text in (words, item))
        if values:
            yield replace(change, item=item, words=words, changes=values)


def _rename(text: str, target: Sequence[str], source: Sequence[str | int]) -> str:
    """Return a text with the name and section of an entry as the file has them."""
    (section, name), (own_section, own_name, *_) = target, map(str, source)
    if section != own_section:
        text = text.replace(f"{section.rstrip('s')} {name}", f"{own_section.rstrip('s')} {name}")
    return re.sub(rf"(?<!\w){re.escape(name)}(?!\w)", own_name, text)


def _rank(
    problem: Problem, base: Result, proposals: Sequence[CellChange], tally: _Tally
) -> list[_Item]:
    """Return the items with their changes, the most promising first.

    The promise of a place is the saving of the plan of the file by the costs of the changed file,
    without back ends. Places that do not shorten this plan are dropped, and so are values that the
    schema refuses, or with which the plan is not applicable.
    """
    plan = [step.skill for step in base.steps]
    unchanged = _price_plan(problem.task, plan)
    items = []
    ordered = sorted(proposals, key=lambda change: (change.kind, change.item))
    for (kind, name), group in groupby(ordered, key=lambda change: (change.kind, change.item)):
        changes = list(group)
        promises = dict.fromkeys(range(len(changes)), 0.0)
        if kind == "place" and unchanged is not None:
            crowded = dict.fromkeys(promises, 0)
            for index, change in enumerate(changes):
                task = problem.ground_with(change.changes)
                price = None if task is None else _price_plan(task, plan)
                if task is not None and price is not None:
                    promises[index] = unchanged - price
                    crowded[index] = _count_crowded(task)
                    tally.longer += promises[index] <= tolerance(unchanged)
                else:
                    tally.refused += 1
            kept = [i for i in promises if promises[i] > tolerance(unchanged)]
            # Where the product is built, things are in the way: such places come last.
            changes = [changes[i] for i in sorted(kept, key=lambda i: (crowded[i], -promises[i]))]
        items.append(_Item(kind, name, changes, max(promises.values())))
    return sorted(items, key=lambda item: -item.promise)


def _count_crowded(task: Task) -> int:
    """Return the number of starts and stations that are at, or next to, a goal of a body."""
    goals: list[tuple[str, list[float]]] = []
    starts: list[tuple[str, list[float]]] = []
    for body in task.scene.bodies:
        for placement in body.placements:
            if placement.frame == WORLD and placement.solid:
                kind = goals if placement.fact.startswith("placed(") else starts
                ends = [body.reach_m(placement.pose, axis) for axis in _AXES]
                kind.append((body.name, ends))
    stations = [
        (name, [x_m, -x_m, y_m, -y_m]) for name, (x_m, y_m, _) in task.scene.stations.items()
    ]
    return sum(
        name != other and all(_overlaps(start[k : k + 2], goal[k : k + 2]) for k in (0, 2))
        for name, start in (*starts, *stations)
        for other, goal in goals
    )


def _overlaps(ends: Sequence[float], others: Sequence[float]) -> bool:
    """Return True if two intervals, as their upper and negative lower end, are close."""
    return ends[0] + others[1] > -_CLOSE_M and others[0] + ends[1] > -_CLOSE_M


def _price_plan(task: Task, plan: Sequence[str]) -> float | None:
    """Return the cost of a plan by the task alone, or None if it cannot be executed."""
    try:
        walked = replay(SkillModel(Feasibility(task)), [task.skill(name) for name in plan])
    except OptionError:
        return None
    return walked.cost if walked.complete else None


def _take_turns(
    items: Sequence[_Item], tally: _Tally, tries: int, stop: Stop
) -> Iterator[CellChange]:
    """Yield changes: kinds in turn, within a kind the items, until the limits end it.

    A place is left once a plan was found for one of its shifts; the others come at the end.
    """
    kinds = list(dict.fromkeys(item.kind for item in items))
    for later in (False, True):
        queues = {kind: [item for item in items if item.kind == kind] for kind in kinds}
        while any(queues.values()):
            for kind in [name for name in kinds for _ in range(_TURNS.get(name, 1))]:
                if not queues[kind]:
                    continue
                item = queues[kind].pop(0)
                before, first_try = tally.planned, tally.tried
                while item.changes and (later or tally.planned == before):
                    if tally.tried >= tries or stop():
                        return
                    yield item.changes.pop(0)
                    # Changes of other items than places differ in kind: they take turns, too.
                    if item.kind != "place" or tally.tried - first_try > _MOST_IN_VAIN:
                        break
                if item.changes and (later or item.kind != "place" or tally.planned == before):
                    queues[kind].append(item)


def _solve_changed(
    problem: Problem, changes: Mapping[str, str], solver: str, setup: Setup, stop: Stop, jobs: int
) -> Result | None:
    """Return the result of a changed file, or None if its checks or a back end refuse it."""
    stop.renew()
    named = {} if setup.physics is None else {"physics": [setup.physics]}
    if setup.collision:
        named["collision"] = list(setup.collision)
    try:
        changed = load_problem(problem.source, named, changes)
        task = changed.part(None)
        back_ends = setup.back_ends(task, changed.spare_back_ends)
        return solve(task, solver, setup, stop=stop, jobs=jobs, back_ends=back_ends)
    except PluginError:
        raise
    except SkillplanError:
        # A fault of the changed file, or a back end that cannot serve it.
        return None
