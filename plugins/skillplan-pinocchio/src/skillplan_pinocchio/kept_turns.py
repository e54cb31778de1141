"""Which motions handle the same part held the same way: the hand keeps its turn in all of them.

Jaws close alike when the hand is turned by half a turn, and a cup holds in any turn; but a part
that is picked up in one turn and let go in the other would lie turned by half.
"""

from __future__ import annotations

from collections.abc import Mapping

from skillplan.physics.linear_motions import LinearMotion, linear_motions
from skillplan.task.motion import Event, Grasp
from skillplan.task.task import Task

Hold = tuple[str, Grasp | None]
"""A part, and how it is held where that is a matter of choice."""


def hold_of(motion: LinearMotion) -> Hold | None:
    """Return what a motion takes or lets go, and how it is held; None for any other."""
    visit = motion.visit
    return (visit.subject, visit.grasp) if visit.event in (Event.GRASP, Event.RELEASE) else None


def holds_of(task: Task, drop_height_m: float) -> Mapping[Hold, tuple[LinearMotion, ...]]:
    """Return the motions of a task by what they hold, in the order of its skills.

    Parameters
    ----------
    task
        The task.
    drop_height_m
        From how high above its goal a part is let go [m], >= 0.
    """
    found: dict[Hold, dict[LinearMotion, None]] = {}
    for skill in task.skills:
        for one in [skill.by(way) for way in skill.ways] or [skill]:
            for route in () if one.motion is None else one.motion.routes:
                state = one.precondition.requires | route.when
                for motion in linear_motions(task, one, state, drop_height_m):
                    hold = hold_of(motion)
                    if hold is not None:
                        found.setdefault(hold, {})[motion] = None
    return {hold: tuple(motions) for hold, motions in found.items()}
