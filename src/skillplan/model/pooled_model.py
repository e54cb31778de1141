"""States and jobs in which interchangeable bodies have no names.

Bodies of a `Pool` keep their names in facts and skills, so every back end, engine and table handles
ordinary bodies. For a search, all states are the same in which the same starts are empty, the same
places are filled, and the hand holds any body of the pool: with n bodies taken, these are n!
states.

In a task with a `Pool`, any of n bodies may fill a place, so no fixed sequence of skills does.
Without names, taking a body from start k is a job, and filling place j with the body in the hand is
another: 2 n jobs instead of n * n pairs, and no assignment beside their order. Every query is put
to the named model in a state with named bodies, and its verdict is translated back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from operator import or_

from skillplan.checks.foresight import Likely
from skillplan.errors import NotASequencing
from skillplan.model.fact_analysis import iterate_bits
from skillplan.model.skill_model import SkillModel
from skillplan.task.skill import Skill
from skillplan.task.state import Condition, Facts, State
from skillplan.task.task import Pool, Task
from skillplan.task.verdict import Verdict

# Greatest number of attempts to find bodies that a verdict does not rest on.
_MOST_TRIES = 8


class _PoolBits:
    """Bits and skills of a pool."""

    def __init__(self, task: Task, pool: Pool) -> None:
        facts = task.facts
        self.starts = [facts.bit(fact) for fact in pool.starts]
        self.held = [facts.bit(fact) for fact in pool.held]
        self.places = [facts.bit(task.operations[place]) for place in pool.places]
        self.located = [[facts.bit(fact) for fact in row] for row in pool.located]
        self.any_held = reduce(or_, self.held)
        self.any_located = reduce(or_, (bit for row in self.located for bit in row))
        # Skill that takes each body, and skills that fill each place, by the body.
        self.picks: dict[int, Skill] = {}
        self.fills: dict[int, dict[int, Skill]] = {}
        for skill in task.skills:
            added = skill.prediction.add.bits
            for body, bit in enumerate(self.held):
                if added & bit:
                    _set_once(self.picks, body, skill, task)
            for body, row in enumerate(self.located):
                for place, bit in enumerate(row):
                    if added & bit:
                        _set_once(self.fills.setdefault(place, {}), body, skill, task)
        # Place of the arm after each body has been taken.
        self.stands = [
            self.picks[body].prediction.add.bits & ~bit if body in self.picks else 0
            for body, bit in enumerate(self.held)
        ]


def _set_once(skills: dict[int, Skill], key: int, skill: Skill, task: Task) -> None:
    if key in skills:
        raise _refuse(task, f"{skills[key].name} and {skill.name} do the same")
    skills[key] = skill


def _refuse(task: Task, reason: str) -> NotASequencing:
    return NotASequencing(f"{task.name!r} is not a sequencing problem: {reason}.")


def make_symmetry_key(task: Task) -> Callable[[int], int]:
    """Return a function of a state's bits that is equal for states of equal cost to go."""
    pools = [
        (
            reduce(or_, (task.facts.bit(fact) for row in pool.located for fact in row), 0),
            reduce(or_, (task.facts.bit(fact) for fact in pool.held), 0),
        )
        for pool in task.pools
    ]
    if not pools:
        return _get_bits

    def key(bits: int) -> int:
        for located, held in pools:
            bits &= ~located
            if bits & held:
                bits = bits & ~held | held & -held
        return bits

    return key


def _get_bits(bits: int) -> int:
    return bits


class PooledModel(SkillModel):
    """The model without names of interchangeable bodies.

    Attributes
    ----------
    assigned
        Skill of the named task by the name of a skill that fills a place, and by that of the skill
        that took the body.

    Raises
    ------
    NotASequencing
        If not all places of a pool are in the goal.
    """

    def __init__(self, model: SkillModel) -> None:
        super().__init__(model.feasibility)
        self._named = model
        self._task = model.task
        self._pools = [_PoolBits(model.task, pool) for pool in model.task.pools]
        self._held = reduce(or_, (pool.any_held for pool in self._pools))
        self._located = reduce(or_, (pool.any_located for pool in self._pools))
        self._skills: dict[str, tuple[_PoolBits, dict[int, Skill]]] = {}
        self.assigned: dict[str, dict[str, str]] = {}
        self.task = self._build_task()

    def verdict(self, state: State, skill: Skill, likely: Likely | None = None) -> Verdict:
        """Return the verdict on `skill`; see `SkillModel.verdict`."""
        for bits, taken in self._name_bodies(state.bits, skill):
            named = self._task.facts.state(bits)
            verdict = self._named.verdict(named, self._find_skill(skill, bits))
            if not _rests_on(verdict, taken):
                return self._translate(verdict, state.bits)
        raise _refuse(self._task, f"{skill.name} depends on which parts of a tray are taken")

    def verdicts(self, queries: Sequence[tuple[Skill, State]], /) -> list[Verdict]:
        """Return the verdicts on pairs of skill and state, in order."""
        return [self.verdict(state, skill) for skill, state in queries]

    def cost(self, state: State, skill: Skill) -> float:
        """Return the cost of `skill` in `state`; see `SkillModel.cost`."""
        bits, _ = next(self._name_bodies(state.bits, skill))
        return self._named.cost(self._task.facts.state(bits), self._find_skill(skill, bits))

    def least_cost(self, skill: Skill, true_bits: int, false_bits: int) -> float:
        """Return a lower bound on the cost of a skill; see `SkillModel.least_cost`."""
        bits, _ = next(self._name_bodies(true_bits, skill))
        absent = false_bits & self._task.facts.all_bits & ~(self._held | self._located)
        return self._named.least_cost(self._find_skill(skill, bits), bits, absent)

    def _build_task(self) -> Task:
        """Return the task of the jobs: take each body, and fill each place."""
        task = self._task
        names = list(task.facts.names)
        taken: list[str] = []
        operations = dict(task.operations)
        for number, (pool, listed) in enumerate(zip(self._pools, task.pools, strict=True)):
            # Bits stay where they are, because costs refer to them.
            for bits in (pool.any_held, pool.any_located):
                for bit in iterate_bits(bits):
                    names[bit.bit_length() - 1] = f"unused({bit.bit_length()})"
            names[pool.held[0].bit_length() - 1] = f"held(any of {number + 1})"
            for place, bit in zip(listed.places, pool.starts, strict=True):
                names[bit.bit_length() - 1] = f"at_start({place}.start)"
                taken.append(f"taken({place}.start)")
                operations[f"{place}.start"] = taken[-1]
            missing = [place for place in pool.places if not place & task.goal.requires.bits]
            if missing:
                fact = task.facts.names_of(missing[0])[0]
                raise _refuse(task, f"{fact} is not in the goal, of interchangeable parts")
        exclusive = []
        for group in task.facts.exclusive:
            bits = task.facts.of(*group).bits
            if not bits & self._located:
                exclusive.append(tuple(names[b.bit_length() - 1] for b in iterate_bits(bits)))
        facts = Facts((*names, *taken), tuple(exclusive))
        skills = list(self._build_skills(facts))
        return task.replace(
            facts=facts,
            skills=tuple(skills),
            initial=State(task.initial.bits, facts),
            goal=Condition(
                State(task.goal.requires.bits | facts.of(*taken).bits, facts),
                State(task.goal.forbids.bits, facts),
            ),
            operations=operations,
            observation=(),
            chart=(),
            starts=(),
            pools=(),
        )

    def _build_skills(self, facts: Facts) -> Iterator[Skill]:
        picks = {s.name: (p, b) for p in self._pools for b, s in p.picks.items()}
        fills = {
            skill.name: (pool, place, body)
            for pool in self._pools
            for place, skills in pool.fills.items()
            for body, skill in skills.items()
        }
        for skill in self._task.skills:
            more = 0
            if skill.name in picks:
                pool, body = picks[skill.name]
                start = facts.names[pool.starts[body].bit_length() - 1]
                more = facts.bit(start.replace("at_start", "taken"))
            elif skill.name in fills:
                pool, place, body = fills[skill.name]
                if body != min(pool.fills[place]):
                    continue
                by_body = pool.fills[place]
                self._skills[skill.name] = pool, by_body
                self.assigned[skill.name] = {
                    pool.picks[body].name: fill.name for body, fill in by_body.items()
                }
            condition = skill.precondition
            yield replace(
                skill,
                precondition=Condition(
                    self._unname(condition.requires, facts), self._unname(condition.forbids, facts)
                ),
                outcomes=tuple(
                    replace(
                        outcome,
                        add=State(self._unname(outcome.add, facts).bits | more, facts),
                        delete=self._unname(outcome.delete, facts),
                    )
                    for outcome in skill.outcomes
                ),
            )

    def _unname(self, state: State, facts: Facts) -> State:
        """Return a set of facts without the names of bodies."""
        bits = state.bits & ~(self._held | self._located)
        for pool in self._pools:
            if state.bits & pool.any_held:
                bits |= pool.held[0]
        return State(bits, facts)

    def _find_skill(self, skill: Skill, bits: int) -> Skill:
        """Return the skill of the named task for the body in the hand."""
        if skill.name not in self._skills:
            return self._task.skill(skill.name)
        pool, by_body = self._skills[skill.name]
        return by_body[next(i for i, held in enumerate(pool.held) if bits & held)]

    def _name_bodies(self, bits: int, skill: Skill) -> Iterator[tuple[int, int]]:
        """Yield named states of a state, and the starts that were emptied to have enough bodies.

        In hypothetical states, more places may be filled than bodies were taken.
        """
        named = bits & self._task.facts.all_bits & ~(self._held | self._located)
        for turn in range(_MOST_TRIES):
            state, emptied = named, 0
            for pool in self._pools:
                own = next(
                    (body for body, pick in pool.picks.items() if pick.name == skill.name), None
                )
                held = None
                if bits & pool.held[0]:
                    held = self._find_held(pool, bits)
                    state |= pool.held[held]
                needed = [place for place, bit in enumerate(pool.places) if bits & bit]
                others = [b for b in range(len(pool.starts)) if b not in (own, held)]
                # Bodies still at their starts serve last, and each attempt takes others first.
                others.sort(key=lambda body: bool(bits & pool.starts[body]))
                free = [body for body in others if not bits & pool.starts[body]]
                lying = [body for body in others if bits & pool.starts[body]]
                shift = turn * max(1, len(lying) // _MOST_TRIES) % max(1, len(lying))
                bodies = [*free, *lying[shift:], *lying[:shift]][: len(needed)]
                bodies_used = [*bodies, held] if held is not None else bodies
                for body in bodies_used:
                    emptied |= state & pool.starts[body]
                    state &= ~pool.starts[body]
                # A body stays at its own goal if it can.
                for place in needed:
                    if place in bodies:
                        bodies.remove(place)
                        state |= pool.located[place][place]
                for place in (p for p in needed if not state & pool.located[p][p]):
                    if bodies:
                        state |= pool.located[bodies.pop(0)][place]
            yield state, emptied
            if not emptied:
                return

    @staticmethod
    def _find_held(pool: _PoolBits, bits: int) -> int:
        """Return the body in the hand: the one at whose start the arm is, or another."""
        stands = [body for body, bit in enumerate(pool.stands) if bit and bits & bit == bit]
        taken = [body for body, bit in enumerate(pool.starts) if not bits & bit]
        return next(iter([*stands, *reversed(taken), len(pool.starts) - 1]))

    def _translate(self, verdict: Verdict, bits: int) -> Verdict:
        """Return a verdict that rests on facts without names.

        A verdict that rests on where bodies of a pool are rests on which places are filled.
        """
        if verdict.present is None or verdict.absent is None:
            return verdict
        named = verdict.present.bits | verdict.absent.bits
        basis = named & ~(self._held | self._located)
        for pool in self._pools:
            if named & pool.any_held:
                basis |= pool.held[0]
            for place, bit in enumerate(pool.places):
                if any(named & row[place] for row in pool.located):
                    basis |= bit
        facts = self.task.facts
        return replace(
            verdict, present=State(basis & bits, facts), absent=State(basis & ~bits, facts)
        )


def _rests_on(verdict: Verdict, bits: int) -> bool:
    """Return whether a verdict rests on some facts, or on all."""
    if not bits:
        return False
    if verdict.present is None or verdict.absent is None:
        return True
    return bool((verdict.present.bits | verdict.absent.bits) & bits)


def assign(plan: Sequence[str], assigned: Mapping[str, Mapping[str, str]]) -> tuple[str, ...]:
    """Return a plan with the names of bodies: each place is filled by the body taken last."""
    picks = {pick for fills in assigned.values() for pick in fills}
    names: list[str] = []
    last = ""
    for name in plan:
        if name in picks:
            last = name
        names.append(assigned[name][last] if name in assigned else name)
    return tuple(names)
