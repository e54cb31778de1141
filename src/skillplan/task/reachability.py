"""Goals that no sequence of skills can bring about, found before any search.

The usual delete relaxation: a fact, once true, stays true. What is out of reach even so is out
of reach indeed.
"""

from __future__ import annotations

from skillplan.task.skill import Skill
from skillplan.task.task import Task


def unreachable_facts(task: Task) -> dict[str, str]:
    """Return the goal facts out of reach, each with the first reason found."""
    reached, before = task.initial.bits, -1
    while reached != before:
        before = reached
        for skill in task.skills:
            if not skill.precondition.requires.bits & ~reached:
                reached |= _added(skill, reached)
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


def _added(skill: Skill, reached: int) -> int:
    """Return the facts that a skill may bring about once the facts in `reached` may hold."""
    bits = 0
    for outcome in skill.outcomes:
        bits |= outcome.add.bits
    for case in skill.cases:
        if case.fact.bits & reached:
            for outcome in case.outcomes:
                bits |= outcome.add.bits
    return bits
