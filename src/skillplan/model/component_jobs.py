"""Jobs: sequences of skills that bring one component of a product to its goal.

None of this queries a back end: the facts that only a component's own skills change, the order of
these skills, and the situation after the last one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import reduce
from graphlib import CycleError, TopologicalSorter
from operator import or_

from skillplan.errors import NotASequencing
from skillplan.model.fact_analysis import (
    CostBasis,
    effects,
    find_live_skills,
    iterate_bits,
    map_exclusive_bits,
    map_named_bits,
)
from skillplan.task.skill import Skill
from skillplan.task.task import Task
from skillplan.task.verdict import Verdict


@dataclass(frozen=True, slots=True)
class Job:
    """The skills that finish one component, in order.

    Parameters
    ----------
    chain
        The skills, at least one.
    own
        Bits of the facts that only these skills change.
    stages
        Own bits that hold before each skill and after the last one.
    known
        Bits of other facts that certainly hold, and certainly do not hold, before each skill.
    after
        Bits of the situation after the last skill.
    """

    component: str
    chain: tuple[Skill, ...]
    own: int
    stages: tuple[int, ...]
    known: tuple[tuple[int, int], ...]
    after: int

    @property
    def change(self) -> int:
        """Own bits that the job changes."""
        return self.stages[0] ^ self.stages[-1]


@dataclass(frozen=True, slots=True)
class Gate:
    """A skill that every plan uses once, after some jobs and before others, such as a turn.

    Parameters
    ----------
    earlier, later
        Jobs on either side, as sets.
    """

    earlier: int
    later: int


class ComponentJobs:
    """The jobs of a task, and the skills between jobs.

    Facts that belong to no job form the *situation*, such as the place and tool of an arm. The
    situation after a job is always the same.

    Parameters
    ----------
    told_basis
        Bits of further facts that costs from back ends depend on.

    Attributes
    ----------
    jobs
        Jobs in the order of the task's components, those outside the goal included.
    goal
        Indices of the jobs that the goal needs.
    connectors
        Skills outside of all jobs, such as tool changes.
    gates
        Connectors that need jobs, by name.

    Raises
    ------
    NotASequencing
        If the task does not have this structure; the message gives the reason.
    """

    def __init__(self, task: Task, told_basis: int = 0) -> None:
        self.task = task
        self._told_basis = told_basis
        if not task.deterministic:
            raise self.no("skills may have several outcomes")
        if any(skill.cases for skill in task.skills):
            raise self.no("what a skill brings about depends on the state")
        self._exclusive = map_exclusive_bits(task)
        self._initial = task.initial.bits
        self._live = find_live_skills(task)
        self._named = self._named_bits()
        chains = self._chains()
        self.connectors = self._connectors(chains)
        own = self._own_bits(chains)
        self.situation = task.facts.all_bits & ~reduce(or_, own.values(), 0)
        changed = reduce(or_, (effects(skill) for skill in self._live), 0)
        self._constant = self.situation & ~changed
        self.jobs = tuple(self._job(name, chain, own[name]) for name, chain in chains.items())
        goal_facts = {fact for fact in task.goal.requires if fact not in task.initial}
        self.goal = tuple(
            i for i, job in enumerate(self.jobs) if task.operations[job.component] in goal_facts
        )
        self.gates = self._find_gates()
        self._check_runs()

    def no(self, reason: str) -> NotASequencing:
        """Return the error with the reason why the task does not have the structure."""
        return NotASequencing(f"{self.task.name!r} is not a sequencing problem: {reason}.")

    def settled(self, job: int, position: int) -> tuple[int, int]:
        """Return the bits of the situation that hold, and that do not, before a skill of a job."""
        holds, lacks = self.jobs[job].known[position]
        return holds | self._constant & self._initial, lacks | self._constant & ~self._initial

    def find_open_bits(self, job: int, position: int, verdict: Verdict) -> int:
        """Return the bits that vary of the situation that a verdict on a skill rests on."""
        holds, lacks = self.settled(job, position)
        assert verdict.present is not None
        assert verdict.absent is not None
        rests_on = verdict.present.bits & ~holds | verdict.absent.bits & ~lacks
        return rests_on & self.situation

    def _named_bits(self) -> dict[str, int]:
        """Return the bits of the facts of each component, without facts that costs depend on."""
        basis, depended = CostBasis(), self._told_basis
        for skill in self._live:
            bits = basis.bits(skill.cost)
            if bits is None:
                raise self.no(f"nothing is known of what the cost of {skill.name} depends on")
            depended |= bits
        return {name: bits & ~depended for name, bits in map_named_bits(self.task).items()}

    def _chains(self) -> dict[str, tuple[Skill, ...]]:
        """Return the skills of each unfinished component, in order."""
        task = self.task
        goal = task.goal.requires.bits
        facts = {component: task.facts.bit(fact) for component, fact in task.operations.items()}
        if goal & ~reduce(or_, facts.values(), 0) or task.goal.forbids.bits:
            raise self.no("its goal is not just to finish components of the product")
        if len(set(facts.values())) != len(facts):
            raise self.no("one fact finishes several components")
        makers: dict[int, list[Skill]] = {}
        for skill in self._live:
            for bit in iterate_bits(skill.prediction.add.bits):
                makers.setdefault(bit.bit_length(), []).append(skill)
        chains = {}
        for component, bit in facts.items():
            if bit & self._initial:
                undoing = [s.name for s in self._live if bit & s.prediction.delete.bits]
                if undoing:
                    fact = task.operations[component]
                    raise self.no(f"{fact} holds from the start and {undoing[0]} ends it")
            elif bit & goal or makers.get(bit.bit_length()):
                chains[component] = self._chain(bit, self._named[component], makers)
        return chains

    def _chain(self, bit: int, named: int, makers: dict[int, list[Skill]]) -> tuple[Skill, ...]:
        """Return the skills that reach a fact of a component, in order."""
        chain: list[Skill] = []
        while True:
            candidates = makers.get(bit.bit_length(), [])
            if len(candidates) != 1:
                fact = self.task.facts.names_of(bit)[0]
                raise self.no(f"{len(candidates)} skills bring about {fact}")
            maker = candidates[0]
            if any(maker.name == skill.name for skill in chain):
                raise self.no(f"{maker.name} needs what only {maker.name} leads to")
            chain.insert(0, maker)
            bit = maker.precondition.requires.bits & named & ~self._initial
            if not bit:
                return tuple(chain)
            if bit & (bit - 1):
                names = " and ".join(self.task.facts.names_of(bit))
                raise self.no(f"{maker.name} needs {names}, which come about apart")

    def _connectors(self, chains: dict[str, tuple[Skill, ...]]) -> tuple[Skill, ...]:
        inside: dict[str, str] = {}
        for component, chain in chains.items():
            for skill in chain:
                if skill.name in inside:
                    raise self.no(f"{skill.name} is part of {inside[skill.name]} and {component}")
                inside[skill.name] = component
        return tuple(skill for skill in self._live if skill.name not in inside)

    def _own_bits(self, chains: dict[str, tuple[Skill, ...]]) -> dict[str, int]:
        """Return the bits of the facts of a component that only its own skills change."""
        touched = {
            component: reduce(or_, (effects(skill) for skill in chain), 0)
            for component, chain in chains.items()
        }
        shared = reduce(or_, (effects(skill) for skill in self.connectors), 0)
        seen = 0
        for bits in touched.values():
            shared |= seen & bits
            seen |= bits
        own = {
            component: self._named[component] & bits & ~shared
            for component, bits in touched.items()
        }
        for component, bits in own.items():
            fact = self.task.operations[component]
            if not self.task.facts.bit(fact) & bits:
                raise self.no(f"{fact} is changed by more than the skills of {component}")
        return own

    def _job(self, component: str, chain: tuple[Skill, ...], own: int) -> Job:
        """Return a job, whose skills must run in order and once."""
        stages = [self._initial & own]
        for skill in chain:
            kept = stages[-1] & ~skill.prediction.delete.bits
            stages.append(kept | skill.prediction.add.bits & own)
        for position, stage in enumerate(stages):
            for turn, skill in enumerate(chain):
                needs, bars = skill.precondition.requires.bits, skill.precondition.forbids.bits
                enabled = stage & needs == needs & own and not stage & bars
                if enabled and turn != position:
                    raise self.no(f"{skill.name} may be done again, or before its turn")
                if not enabled and turn == position:
                    raise self.no(f"{skill.name} cannot follow what {component} needs before")
        bit = self.task.facts.bit(self.task.operations[component])
        if any(stage & bit for stage in stages[:-1]) or not stages[-1] & bit:
            raise self.no(f"{chain[-1].name} is not what finishes {component}")
        known = []
        holds = lacks = 0
        for skill in chain:
            holds |= skill.precondition.requires.bits & self.situation
            lacks |= skill.precondition.forbids.bits & self.situation | self._excluded(holds)
            if holds & lacks:
                raise self.no(f"{skill.name} cannot follow what {component} needs before")
            known.append((holds, lacks))
            holds, lacks = self._after(holds, lacks, skill)
        for position in range(len(chain) - 2, -1, -1):
            # A later skill's condition that no skill of the job changes held before.
            changed = effects(chain[position])
            known[position] = (
                known[position][0] | known[position + 1][0] & ~changed,
                known[position][1] | known[position + 1][1] & ~changed,
            )
        after = self._constant & self._initial | holds
        unsure = self.situation & ~(holds | lacks | self._constant)
        if unsure:
            fact = self.task.facts.names_of(unsure)[0]
            raise self.no(f"whether {fact} holds after {chain[-1].name} depends on what was before")
        return Job(component, chain, own, tuple(stages), tuple(known), after)

    def _after(self, holds: int, lacks: int, skill: Skill) -> tuple[int, int]:
        """Return the known bits of the situation after a skill, given those before."""
        add = skill.prediction.add.bits & self.situation
        delete = skill.prediction.delete.bits & self.situation
        holds = holds & ~delete | add
        return holds, lacks & ~add | delete | self._excluded(holds)

    def _excluded(self, holds: int) -> int:
        """Return the bits of facts that some facts exclude."""
        excluded = (self._exclusive.get(bit.bit_length(), 0) for bit in iterate_bits(holds))
        return reduce(or_, excluded, 0)

    def _find_gates(self) -> dict[str, Gate]:
        """Return the skills between jobs that depend on jobs, with the jobs on either side."""
        owned = self.task.facts.all_bits & ~self.situation
        added = reduce(or_, (skill.prediction.add.bits for skill in self._live), 0)
        gates: dict[str, Gate] = {}
        for skill in self.connectors:
            needs = skill.precondition.requires.bits & owned
            bars = skill.precondition.forbids.bits & owned
            # A fact that ends for good: the jobs that need it come before.
            gone = skill.prediction.delete.bits & self.situation & ~added
            earlier = self._select_jobs(gone)
            unmet = bars | needs & ~reduce(or_, (self.jobs[i].stages[-1] for i in earlier), 0)
            if unmet:
                fact = self.task.facts.names_of(unmet)[0]
                raise self.no(f"{skill.name} is no part of a job and depends on {fact}")
            if needs:
                done = [i for i in earlier if self.jobs[i].stages[-1] & needs]
                later = self._select_jobs(self._list_only_after(skill))
                gates[skill.name] = Gate(_make_set(done), _make_set(later))
        return gates

    def _select_jobs(self, facts: int) -> list[int]:
        """Return the jobs that need one of some facts of the situation."""
        return [i for i, job in enumerate(self.jobs) if job.known[-1][0] & facts]

    def _list_only_after(self, first: Skill) -> int:
        """Return the bits of the facts that come about after a skill between jobs only."""
        after, grows = 0, True
        while grows:
            others = [
                skill
                for skill in self._live
                if skill.name != first.name and not skill.precondition.requires.bits & after
            ]
            reached = reduce(or_, (skill.prediction.add.bits for skill in others), self._initial)
            before, after = after, self.situation & ~reached & self.task.facts.all_bits
            grows = after != before
        return after

    def _check_runs(self) -> None:
        """Check that no other skill can run between the skills of a job.

        Only connectors and first skills of jobs matter: later skills wait for their first, which
        cannot run either.
        """
        starters: dict[tuple[int, int], list[tuple[int, str]]] = {}
        beginnings = [(-1, skill) for skill in self.connectors]
        beginnings += [(i, job.chain[0]) for i, job in enumerate(self.jobs)]
        for owner, skill in beginnings:
            needs = skill.precondition.requires.bits & self.situation
            bars = skill.precondition.forbids.bits & self.situation
            starters.setdefault((needs, bars), []).append((owner, skill.name))
        for i, job in enumerate(self.jobs):
            for position, skill in enumerate(job.chain[:-1]):
                holds, lacks = self._after(*self.settled(i, position), skill)
                for (needs, bars), those in starters.items():
                    others = (name for owner, name in those if owner != i)
                    other = None if needs & lacks or bars & holds else next(others, None)
                    if other is not None:
                        following = job.chain[position + 1].name
                        raise self.no(f"{other} may come between {skill.name} and {following}")


class DoneSets:
    """States in which some jobs are done. The bits of an integer represent a set of jobs."""

    def __init__(self, structure: ComponentJobs) -> None:
        self.structure = structure
        self._undone = reduce(or_, (job.stages[0] for job in structure.jobs), 0)
        self._telling = reduce(or_, (job.change for job in structure.jobs), 0)
        self._owner = {
            bit.bit_length(): i
            for i, job in enumerate(structure.jobs)
            for bit in iterate_bits(job.own)
        }

    def state_bits(self, done: int) -> int:
        """Return the own facts of all jobs if exactly some jobs are done."""
        bits = self._undone
        for i in list_members(done):
            bits ^= self.structure.jobs[i].change
        return bits

    def named(self, verdict: Verdict) -> int:
        """Return the jobs whose being done, or not, a verdict rests on."""
        assert verdict.present is not None
        assert verdict.absent is not None
        bits = (verdict.present.bits | verdict.absent.bits) & self._telling
        return reduce(or_, (1 << self._owner[bit.bit_length()] for bit in iterate_bits(bits)), 0)

    def demands(self, job: int) -> tuple[int, int]:
        """Return the jobs that preconditions of a job require to be done, and not done.

        Raises
        ------
        NotASequencing
            If a precondition holds neither before nor after another job.
        """
        structure = self.structure
        own, done, undone = structure.jobs[job].own, 0, 0
        foreign = structure.task.facts.all_bits & ~structure.situation & ~own
        for gate in structure.gates.values():
            done |= gate.earlier if gate.later >> job & 1 else 0
            undone |= gate.later if gate.earlier >> job & 1 else 0
        for skill in structure.jobs[job].chain:
            needs = skill.precondition.requires.bits & foreign
            bars = skill.precondition.forbids.bits & foreign
            for bit in iterate_bits(needs | bars):
                must_hold = bool(bit & needs)
                other = self._owner[bit.bit_length()]
                stages = structure.jobs[other].stages
                may = bool(stages[0] & bit) == must_hold, bool(stages[-1] & bit) == must_hold
                if not any(may):
                    fact = structure.task.facts.names_of(bit)[0]
                    missing = fact if must_hold else f"not {fact}"
                    raise structure.no(f"{skill.name} is never feasible (needs {missing})")
                done |= (not may[0]) << other
                undone |= (not may[1]) << other
        return done, undone


def _make_set(jobs: Iterable[int]) -> int:
    """Return some jobs as a set."""
    return sum(1 << job for job in jobs)


def list_members(jobs: int) -> Iterator[int]:
    """Yield the indices of a set of jobs."""
    for bit in iterate_bits(jobs):
        yield bit.bit_length() - 1


def close_relation(
    structure: ComponentJobs, before: Mapping[int, int]
) -> tuple[dict[int, int], dict[int, int]]:
    """Return all direct and indirect predecessors and successors of each job.

    Parameters
    ----------
    before
        Direct predecessors of each job.

    Raises
    ------
    NotASequencing
        If the precedence has a cycle.
    """
    direct = {i: list(list_members(jobs)) for i, jobs in before.items()}
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
