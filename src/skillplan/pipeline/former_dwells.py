"""Stored results of versions in which back ends had dwell times of their own.

Such a result is checked by the rule of its time: a back end that told times added its own dwells.
Without one, dwells were added once a skill, so that a tool that was put back in a swap, and a screw
that was fetched, took none. A bit went down to the feeder, not to the head of a screw that stands
on it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from skillplan.domains.load import Problem
from skillplan.errors import OptionError
from skillplan.pipeline import registry
from skillplan.pipeline.setup import BACK_END_KINDS, Setup
from skillplan.records.origin import Origin
from skillplan.task.back_end import RemovedDwell
from skillplan.task.cost import Cost, DistanceCost
from skillplan.task.motion import Event, Motion, Visit
from skillplan.task.skill import Skill
from skillplan.task.task import BackEndChoice, Task

Options = Mapping[str, Mapping[str, Any]]


def without_removed(origin: Origin) -> tuple[Origin, Options]:
    """Return an origin without options that were removed since, and these, by plugin."""
    kept, removed = {}, {}
    for plugin, values in origin.options.items():
        known = _removed_options(plugin)
        removed[plugin] = {key: value for key, value in values.items() if key in known}
        kept[plugin] = {key: value for key, value in values.items() if key not in known}
    return replace(origin, options=kept), removed


def with_former_dwells(
    path: str, problem: Problem, setup: Setup, removed: Options
) -> tuple[Problem, str]:
    """Return a problem with the dwell times of earlier versions, and a sentence about them.

    Parameters
    ----------
    path
        The result, for messages.
    problem
        As it is loaded now; its hash stays.
    setup
        The back ends under which the result was made.
    removed
        The removed options that the result names, by plugin.

    Raises
    ------
    OptionError
        If a removed option is not a time.
    """
    tasks, sentences = [], []
    for task in problem.tasks:
        if not task.dwells_from:
            tasks.append(task)
            continue
        timer = setup.timed_by(task).partition(",")[0]
        chosen = {choice.name: choice.options for choice in task.collision}
        given = {**chosen.get(timer, {}), **removed.get(timer, {})}
        known = _removed_options(timer)
        dwells_s = {one.event: _time_s(path, key, given, one) for key, one in known.items()}
        tasks.append(_with_dwells(task, dwells_s))
        words = ", ".join(f"{key} {dwells_s[one.event]:g} s" for key, one in known.items())
        words = f"the options of {timer} at that time ({words})" if known else "one dwell a skill"
        sentences.append(
            f"today's durations_s: the result is of an earlier version, and its times are those "
            f"with {words}"
        )
    return replace(problem, tasks=tuple(tasks), spare_back_ends=[]), "; ".join(sentences)


def _removed_options(plugin: str) -> Mapping[str, RemovedDwell]:
    for kind in BACK_END_KINDS:
        if plugin in registry.names(kind):
            removed: Mapping[str, RemovedDwell] = registry.load(kind, plugin).removed_options
            return removed
    return {}


def _time_s(path: str, key: str, given: Mapping[str, Any], option: RemovedDwell) -> float:
    try:
        value_s = float(given.get(key, option.default_s))
    except (TypeError, ValueError):
        value_s = math.nan
    if not 0 <= value_s < math.inf:
        raise OptionError(f"{path}: is damaged: its option {key} is {given[key]!r}, no time.")
    return value_s


def _with_dwells(task: Task, dwells_s: Mapping[Event, float]) -> Task:
    """Return a task with other dwells and without removed options; its hash stays."""

    def dwell_s(visit: Visit, last: Visit) -> float:
        if dwells_s:
            return dwells_s.get(visit.event, visit.dwell_s)
        return visit.dwell_s if visit is last else 0.0

    bare_bit = Event.FETCH in dwells_s
    skills = tuple(_redwelt(skill, dwell_s, bare_bit=bare_bit) for skill in task.skills)
    collision = tuple(
        BackEndChoice(
            choice.name,
            {k: v for k, v in choice.options.items() if k not in _removed_options(choice.name)},
        )
        for choice in task.collision
    )
    return task.replace(skills=skills, collision=collision, sha256=task.sha256)


def _redwelt(skill: Skill, dwell_s: Callable[[Visit, Visit], float], *, bare_bit: bool) -> Skill:
    def former(visit: Visit) -> Visit:
        # The bit went down to the feeder itself, and the screw that it took was not modelled: as
        # if it took up its own tool there.
        if bare_bit and visit.event is Event.FETCH:
            return replace(visit, event=Event.LOAD, subject=skill.parameters["tool"])
        return visit

    def moved(motion: Motion) -> Motion:
        routes = [
            replace(
                route,
                visits=tuple(
                    former(replace(visit, dwell_s=dwell_s(visit, route.visits[-1])))
                    for visit in route.visits
                ),
            )
            for route in motion.routes
        ]
        return replace(motion, routes=tuple(routes))

    def timed(cost: Cost) -> Cost:
        is_time = isinstance(cost, DistanceCost) and cost.dwells
        return replace(cost, motion=moved(cost.motion)) if is_time else cost  # type: ignore

    return replace(
        skill,
        motion=None if skill.motion is None else moved(skill.motion),
        ways=tuple(replace(way, motion=moved(way.motion)) for way in skill.ways),
        cost=timed(skill.cost),
        duration_s=timed(skill.duration_s),
    )
