"""The sets of jobs that may be done, where a task is one of putting jobs in order.

There are far fewer of them than states: what is held, where the arm stands and with which tool are
left out of them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skillplan.errors import NotASequencing
from skillplan.model.component_jobs import ComponentJobs
from skillplan.model.done_jobs import DoneSets
from skillplan.model.job_connections import JobConnections
from skillplan.model.sequencing import SequencingProblem
from skillplan.model.skill_model import SkillModel
from skillplan.solvers.stop import Stop
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict

Sets = NDArray[np.uint64]

# Sets are whole numbers of 64 bits.
_MOST_JOBS = 63
_COST_BYTES = 8


class CertainModel(SkillModel):
    """A model of the same task whose skills always succeed; asks what the model itself does.

    Parameters
    ----------
    model
        Of the task as it is.
    certain
        The task of the same skills without failures.

    Attributes
    ----------
    questions
        Bits of the facts that verdicts rested on.
    """

    def __init__(self, model: SkillModel, certain: Task) -> None:
        super().__init__(model.feasibility)
        self.task = certain
        self.questions = 0
        self._model = model
        self._with_failures = {skill.name: skill for skill in model.task.skills}

    def verdict(self, state: State, skill: Skill, likely: object = None) -> Verdict:
        """Return the verdict on a skill, as it is with its failures, in `state`."""
        return self.verdicts([(skill, state)])[0]

    def verdicts(self, queries: Sequence[tuple[Skill, State]], /) -> list[Verdict]:
        """Return the verdicts on several skills in states, in order."""
        own = [(self._with_failures[skill.name], state) for skill, state in queries]
        found = self._model.verdicts(own)
        for verdict in found:
            if verdict.present is None or verdict.absent is None:
                self.questions = self.task.facts.all_bits
            else:
                self.questions |= verdict.present.bits | verdict.absent.bits
        return found


class JobSets:
    """The jobs of a task and the sets of them that may be done, and what a state says of them.

    Parameters
    ----------
    model
        Of the certain task.
    most_sets
        More sets of jobs are refused.
    stop
        When to give up.

    Attributes
    ----------
    problem
        Jobs, costs between them, and precedence.
    jobs, chosen
        The n jobs, and their places among all jobs of the task.
    needs
        By job the set of those that must be done before it.
    layers
        The sets that may be done, by size.
    sets
        How many there are.
    connections
        The ways between jobs.
    situation, initial
        Bits of the facts that are no job's own, and of the initial state.

    Raises
    ------
    NotASequencing
        If the task is not one of putting at most 63 jobs in order, or there are more sets, or it
        was given up.
    """

    def __init__(self, model: CertainModel, most_sets: int, stop: Stop) -> None:
        self.problem = SequencingProblem.from_model(model)
        self._structure = structure = ComponentJobs(model.task)
        self.situation = structure.situation
        self.initial = model.task.initial.bits
        place = {job.component: index for index, job in enumerate(structure.jobs)}
        self.chosen = [place[name] for name in self.problem.jobs]
        self.jobs = [structure.jobs[index] for index in self.chosen]
        self.connections = JobConnections(model, structure, DoneSets(structure))
        self.connections.matrix()
        count = len(self.jobs)
        if count < len(structure.jobs):
            raise structure.no("a component is not in the goal, and its job might be of use")
        if count > _MOST_JOBS:
            raise structure.no(f"{count} jobs are more than {_MOST_JOBS}")
        self.needs = [0] * count
        for before, after in self.problem.precedence:
            self.needs[after] |= 1 << before
        self.layers = feasible_sets(self.needs, _afforded(most_sets, count, stop), stop)
        if not self.layers:
            raise structure.no(f"more than {most_sets:,} sets of jobs may be done")
        self.sets = sum(len(layer) for layer in self.layers)

    def no(self, reason: str) -> NotASequencing:
        """Return the error that says why nothing is worked out."""
        return self._structure.no(reason)

    def of(self, state: State) -> tuple[int, int, int] | None:
        """Return the set done in a state, the job begun or -1, and how many of its skills are done.

        None where more than one job is begun.
        """
        done, begun, position = 0, -1, 0
        for index, job in enumerate(self.jobs):
            own = state.bits & job.own
            if own == job.stages[-1]:
                done |= 1 << index
            elif own != job.stages[0]:
                if begun >= 0 or own not in job.stages:
                    return None
                begun, position = index, job.stages.index(own)
        return done, begun, position


def _afforded(most_sets: int, count: int, stop: Stop) -> int:
    """Return of how many sets there is memory for a table, at most `most_sets`."""
    left = stop.memory_left_bytes()
    if left is None or not count:
        return most_sets
    # Half of it: a table is filled from another one.
    return min(most_sets, left // (2 * _COST_BYTES * (count + 1)))


def feasible_sets(needs: Sequence[int], most: int, stop: Stop) -> list[Sets]:
    """Return the sets that hold with every job all that it needs, by size, in ascending order.

    Parameters
    ----------
    needs
        By job the set of those that must be done before it.
    most
        With more sets than this nothing is returned.
    stop
        When to give up; then nothing is returned.
    """
    layers: list[Sets] = [np.zeros(1, dtype=np.uint64)]
    total = 1
    for _ in needs:
        here = layers[-1]
        following = [here[open_in(here, job, set_)] | bit_of(job) for job, set_ in enumerate(needs)]
        layers.append(np.unique(np.concatenate(following)))
        total += len(layers[-1])
        if total > most or stop():
            return []
    return layers


def open_in(sets: Sets, job: int, needs: int) -> NDArray[np.bool_]:
    """Return in which sets a job is not done, and all that it needs is."""
    needed = np.uint64(needs)
    found: NDArray[np.bool_] = ((sets & bit_of(job)) == 0) & ((sets & needed) == needed)
    return found


def bit_of(job: int) -> np.uint64:
    """Return the set of one job."""
    return np.uint64(1 << job)
