"""Paths between jobs where back ends tell what skills cost: only what may be cheapest is asked.

From each job the least costs to others are found by a search whose edges have lower bounds until
they come up (Dellin and Srinivasa, "A unifying formalism for shortest path problems with expensive
edge evaluations", 2016). What precedence rules out is not looked at.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan.model.component_jobs import ComponentJobs
from skillplan.model.job_connections import JobConnections
from skillplan.model.skill_model import SkillModel
from skillplan.task.skill import Skill

_Path = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Step:
    """A step on from the end of a path: a skill between jobs, or a job, which ends the path.

    Parameters
    ----------
    cost, situation, path
        Of the path: what it costs, the bits of the situation it leads to, and its skills.
    skill
        The skill between jobs; empty where the step is a job.
    job
        The job; -1 where the step is none.
    priced
        Whether its own cost counts, and not a lower bound.
    """

    cost: float
    situation: int
    path: _Path
    skill: str = ""
    job: int = -1
    priced: bool = False


class PricedConnections:
    """Least costs of coming to jobs and doing them, as back ends tell them.

    Parameters
    ----------
    model
        Asked for costs.
    structure
        The jobs of its task.
    bounds
        Lower bounds on these costs.
    needed
        Whether the cost of coming to a job is wanted, shape (n + 1, n); row 0 is the start.

    Attributes
    ----------
    costs
        From the initial state (row 0) and from each job, shape (n + 1, n); inf where a job cannot
        come right after another, or that is not needed.
    paths
        The skills from a job, or the start (-1), to a job, where there are any.
    """

    def __init__(
        self,
        model: SkillModel,
        structure: ComponentJobs,
        bounds: JobConnections,
        needed: NDArray[np.bool_],
    ) -> None:
        self._model = model
        self._structure = structure
        self._bounds = bounds
        self._skills = {skill.name: skill for skill in structure.connectors}
        self._kept: dict[tuple[str, int], float] = {}
        self.costs = np.full(needed.shape, math.inf)
        self.paths: dict[tuple[int, int], _Path] = {}
        initial = structure.task.initial.bits & structure.situation
        for source, situation in enumerate([initial, *(job.after for job in structure.jobs)]):
            wanted = set(np.flatnonzero(needed[source]).tolist()) - {source - 1}
            for job, (cost, path) in self._cheapest(situation, wanted).items():
                self.costs[source, job] = cost
                if path:
                    self.paths[source - 1, job] = path

    def _cheapest(self, situation: int, wanted: set[int]) -> dict[int, tuple[float, _Path]]:
        """Return least cost and path from a situation to each of some jobs that it leads to."""
        settled: dict[int, tuple[float, _Path]] = {}
        met = {situation}
        waiting = self._steps(_Step(0.0, situation, ()), wanted)
        # Of equally expensive ones the first found, which is the shortest.
        queue = [(cost, number, step) for number, (cost, step) in enumerate(waiting)]
        heapq.heapify(queue)
        pushed = len(queue)
        while queue and len(settled) < len(wanted):
            cost, _, step = heapq.heappop(queue)
            after = -1 if step.job >= 0 else self._after(step)
            if step.job in settled or after in met:
                continue
            if not step.priced:
                more = [(step.cost + self._price(step), _priced(step))]
            elif step.job >= 0:
                settled[step.job] = cost, step.path
                continue
            else:
                met.add(after)
                here = _Step(cost, after, (*step.path, step.skill))
                more = self._steps(here, wanted - set(settled))
            for total, following in more:
                if math.isfinite(total):
                    pushed += 1
                    heapq.heappush(queue, (total, pushed, following))
        return settled

    def _steps(self, here: _Step, wanted: set[int]) -> list[tuple[float, _Step]]:
        """Return what may follow at the end of a path, each with a lower bound on the whole."""
        row = self._bounds.row(here.situation)
        found = [
            (here.cost + float(row[job]), _Step(here.cost, here.situation, here.path, job=job))
            for job in sorted(wanted)
            if math.isfinite(row[job])
        ]
        for least, _, name in self._bounds.steps_from(here.situation):
            found.append((here.cost + least, _Step(here.cost, here.situation, here.path, name)))
        return found

    def _after(self, step: _Step) -> int:
        return self._bounds.following(self._skills[step.skill], step.situation)

    def _price(self, step: _Step) -> float:
        if step.job < 0:
            return self._cost(self._skills[step.skill], step.situation)
        situation, costs = step.situation, []
        for skill in self._structure.jobs[step.job].chain:
            costs.append(self._cost(skill, situation))
            situation = self._bounds.following(skill, situation)
        return sum(costs)

    def _cost(self, skill: Skill, situation: int) -> float:
        key = (skill.name, situation)
        if key not in self._kept:
            state = self._structure.task.facts.state(situation)
            self._kept[key] = self._model.cost(state, skill)
        return self._kept[key]


def needed_connections(
    jobs: int, all_before: Mapping[int, int], all_after: Mapping[int, int]
) -> NDArray[np.bool_]:
    """Return which job may come right after which, shape (n + 1, n); row 0 is the start.

    Parameters
    ----------
    jobs
        How many there are: n.
    all_before, all_after
        By job that every plan does the jobs that come before it and after it, as bits, in whatever
        number of steps. If there are others, all connections are needed.
    """
    if len(all_before) < jobs:
        return np.ones((jobs + 1, jobs), dtype=np.bool_)
    needed = np.zeros((jobs + 1, jobs), dtype=np.bool_)
    for job, before in all_before.items():
        needed[0, job] = not before
        for other in all_before:
            earlier = other == job or all_after[job] >> other & 1
            needed[1 + other, job] = not (earlier or before & all_after[other])
    return needed


def _priced(step: _Step) -> _Step:
    return _Step(step.cost, step.situation, step.path, step.skill, step.job, priced=True)
