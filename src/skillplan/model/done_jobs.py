"""Sets of jobs that are done, as the bits of whole numbers, and the states in which they are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import reduce
from graphlib import CycleError, TopologicalSorter
from operator import or_

from skillplan.model.component_jobs import ElementJobs
from skillplan.model.fact_analysis import each_bit
from skillplan.task.verdict import Verdict


class DoneSets:
    """States in which some jobs are done; sets of jobs are the bits of whole numbers.

    Parameters
    ----------
    structure
        The jobs.
    """

    def __init__(self, structure: ElementJobs) -> None:
        self.structure = structure
        self._undone = reduce(or_, (job.stages[0] for job in structure.jobs), 0)
        self._telling = reduce(or_, (job.change for job in structure.jobs), 0)
        self._owner = {
            bit.bit_length(): i for i, job in enumerate(structure.jobs) for bit in each_bit(job.own)
        }

    def state_bits(self, done: int) -> int:
        """Return the own facts of all jobs where exactly some are done."""
        bits = self._undone
        for i in members(done):
            bits ^= self.structure.jobs[i].change
        return bits

    def named(self, verdict: Verdict) -> int:
        """Return the jobs of which a verdict says something only while they are done, or not."""
        assert verdict.present is not None
        assert verdict.absent is not None
        bits = (verdict.present.bits | verdict.absent.bits) & self._telling
        return reduce(or_, (1 << self._owner[bit.bit_length()] for bit in each_bit(bits)), 0)

    def demands(self, job: int) -> tuple[int, int]:
        """Return the jobs that preconditions want done, and not done, while a job is done.

        Raises
        ------
        NotASequencing
            If one wants what holds neither way.
        """
        structure = self.structure
        own, done, undone = structure.jobs[job].own, 0, 0
        foreign = structure.task.facts.all_bits & ~structure.situation & ~own
        for skill in structure.jobs[job].chain:
            needs = skill.precondition.requires.bits & foreign
            bars = skill.precondition.forbids.bits & foreign
            for bit in each_bit(needs | bars):
                wanted = bool(bit & needs)
                other = self._owner[bit.bit_length()]
                stages = structure.jobs[other].stages
                may = bool(stages[0] & bit) == wanted, bool(stages[-1] & bit) == wanted
                if not any(may):
                    fact = structure.task.facts.names_of(bit)[0]
                    amiss = fact if wanted else f"not {fact}"
                    raise structure.no(f"{skill.name} is never feasible (needs {amiss})")
                done |= (not may[0]) << other
                undone |= (not may[1]) << other
        return done, undone


def members(jobs: int) -> Iterator[int]:
    """Yield the indices of a set of jobs."""
    for bit in each_bit(jobs):
        yield bit.bit_length() - 1


def closed(
    structure: ElementJobs, before: Mapping[int, int]
) -> tuple[dict[int, int], dict[int, int]]:
    """Return by job the jobs before and after it in whatever number of steps.

    Parameters
    ----------
    structure
        The jobs.
    before
        By job those that must be done before it.

    Raises
    ------
    NotASequencing
        If they would have to come before each other.
    """
    direct = {i: list(members(jobs)) for i, jobs in before.items()}
    try:
        order = list(TopologicalSorter(direct).static_order())
    except CycleError as error:
        names = (structure.jobs[i].component for i in error.args[1])
        raise structure.no(f"it has no order, {' before '.join(names)}") from None
    all_before, all_after = dict.fromkeys(order, 0), dict.fromkeys(order, 0)
    for i in order:
        for other in direct[i]:
            all_before[i] |= all_before[other] | 1 << other
    for i in reversed(order):
        for other in direct[i]:
            all_after[other] |= all_after[i] | 1 << i
    return all_before, all_after
