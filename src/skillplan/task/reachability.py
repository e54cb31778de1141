"""Goals that no sequence of skills can bring about, found before any search.

The usual delete relaxation: a fact, once true, stays true. What is out of reach even so is out
of reach indeed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from skillplan.task.skill import Outcome, Skill
from skillplan.task.task import Task


def unreachable_facts(task: Task) -> dict[str, str]:
    """Return the goal facts out of reach, each with the first reason found."""
    reached = _reached(task)
    lost = {}
    for fact in task.goal.requires:
        bit = task.facts.bit(fact)
        if bit & reached:
            continue
        makers = [s for s in task.skills if any(o.add.bits & bit for o in s.effects)]
        if not makers:
            lost[fact] = "no action brings it about. Add one, or change the goal."
        else:
            needed = makers[0].precondition.requires.bits
            for case in makers[0].cases:
                if any(outcome.add.bits & bit for outcome in case.outcomes):
                    needed |= case.fact.bits
            missing = task.facts.names_of(needed & ~reached)
            lost[fact] = f"{makers[0].name} needs {', '.join(missing)}, which nothing brings about."
    return lost


def _reached(task: Task) -> int:
    """Return the facts that may come to hold; time grows linearly with skills and cases."""
    reached = task.initial.bits
    effects = [effect for skill in task.skills for effect in _effects(skill)]
    # By a fact that they lack, the effects that are looked at again once it may hold.
    waiting: dict[int, list[tuple[int, int]]] = {}
    while effects:
        needed, added = effects.pop()
        missing = needed & ~reached
        if missing:
            waiting.setdefault(missing & -missing, []).append((needed, added))
            continue
        new = added & ~reached
        reached |= new
        while new:
            bit = new & -new
            effects += waiting.pop(bit, ())
            new ^= bit
    return reached


def _effects(skill: Skill) -> Iterator[tuple[int, int]]:
    """Yield what a skill, or each of its cases, needs and may bring about."""
    needed = skill.precondition.requires.bits
    if not skill.cases:
        yield needed, _added(skill.outcomes)
    for case in skill.cases:
        yield needed | case.fact.bits, _added(case.outcomes)


def _added(outcomes: Sequence[Outcome]) -> int:
    bits = 0
    for outcome in outcomes:
        bits |= outcome.add.bits
    return bits
