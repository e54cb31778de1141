"""Goals that no sequence of skills can bring about, found before any search.

The usual delete relaxation: a fact, once true, stays true. What is out of reach even so is out
of reach indeed.
"""

from __future__ import annotations

from skillplan.task.skill import Skill
from skillplan.task.task import Task


def unreachable_facts(task: Task) -> dict[str, str]:
    """Return the goal facts out of reach, each with the first reason found."""
    reached = task.initial.bits
    waiting = list(task.skills)
    while True:
        ready: list[Skill] = []
        still: list[Skill] = []
        for skill in waiting:
            lacking = skill.precondition.requires.bits & ~reached
            (still if lacking else ready).append(skill)
        if not ready:
            break
        waiting = still
        for skill in ready:
            for outcome in skill.outcomes:
                reached |= outcome.add.bits
    lost = {}
    for fact in task.goal.requires:
        bit = task.facts.bit(fact)
        if bit & reached:
            continue
        makers = [s for s in waiting if any(o.add.bits & bit for o in s.outcomes)]
        if not makers:
            lost[fact] = "no action brings it about. Add one, or change the goal."
        else:
            missing = task.facts.names_of(makers[0].precondition.requires.bits & ~reached)
            lost[fact] = f"{makers[0].name} needs {', '.join(missing)}, which nothing brings about."
    return lost
