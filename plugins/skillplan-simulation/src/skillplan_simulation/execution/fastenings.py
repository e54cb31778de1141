"""Screws that are driven from the side or from below: threads hold them against gravity.

A screw that stands upright rests on what it fastens. In any other pose its thread has to hold it,
which a fixed joint to what its head bears on does here.
"""

from __future__ import annotations

from collections.abc import Iterable

from skillplan.task.motion import Event
from skillplan.task.pose import DOWN, same_direction
from skillplan.task.scene import Placement
from skillplan.task.task import Task
from skillplan_simulation.simulator import World


class Fastenings:
    """Knows where screws of a task are held by their threads.

    Parameters
    ----------
    task
        Whose skills drive them.
    """

    def __init__(self, task: Task) -> None:
        self._facts: set[tuple[str, str]] = set()
        for skill in task.skills:
            motions = (skill.motion, *(way.motion for way in skill.ways))
            routes = (route for motion in motions if motion is not None for route in motion.routes)
            for visit in (visit for route in routes for visit in route.visits):
                if visit.event is Event.DRIVE and not same_direction(visit.along, DOWN):
                    self._facts |= {(visit.subject, fact) for fact in skill.prediction.add}

    def hold(self, body: str, placement: Placement) -> bool:
        """Whether a thread holds a body at one of its places."""
        return (body, placement.fact) in self._facts

    def fasten(self, world: World, there: Iterable[tuple[str, Placement]]) -> None:
        """Fix the screws among the bodies of a world to what their heads bear on.

        Parameters
        ----------
        world
            With the bodies where they are.
        there
            Their names, and at which of their places they are.
        """
        for name, placement in there:
            if self.hold(name, placement):
                other = world.nearest(name)
                if other is not None:
                    world.fasten(name, other)
