"""Whether bodies stay where a state has them, before the robot moves: each on its supports."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from skillplan.task.shape import Mesh
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan_pinocchio.kinematics.fixed_order import length
from skillplan_simulation.execution.fastenings import Fastenings
from skillplan_simulation.execution.surroundings import (
    Located,
    Neighbourhood,
    Surroundings,
)
from skillplan_simulation.simulator import World

# Bodies that move by more than this in so many steps do not stay [m].
_FALLEN_M = 0.001
_STEPS = 48


@dataclass(frozen=True, slots=True)
class Fallen:
    """A body that did not stay.

    Parameters
    ----------
    body
        Its name.
    reason
        In words.
    present, absent
        The facts that this rests on.
    """

    body: str
    reason: str
    present: State
    absent: State


class SupportTrials:
    """Lets bodies go in small worlds of their own; remembers what came of it.

    Parameters
    ----------
    task
        Whose bodies they are.
    surroundings
        Knows the supports.
    world
        Makes worlds.
    """

    def __init__(self, task: Task, surroundings: Surroundings, world: Callable[[], World]) -> None:
        self.task, self.surroundings, self.world = task, surroundings, world
        self.fastenings = Fastenings(task)
        self._known: dict[tuple[str, int], float] = {}

    def fallen(self, around: Neighbourhood, state: State) -> Fallen | None:
        """Return the first body of a neighbourhood that does not stay, or None.

        That rests on its supports, and on the bodies that were looked at before it.
        """
        facts = self.task.facts
        present = absent = facts.none
        for one in around.near:
            if one.placement.fact not in state:
                absent |= facts.of(one.placement.fact)
                continue
            name = one.body.name
            beneath = self.surroundings.support(one, state)
            present |= beneath.present
            absent |= beneath.absent
            moved_m = self._moved_m(one, beneath)
            if moved_m > _FALLEN_M:
                below = [other.body.name for other in beneath.bodies if other is not one]
                on = f"does not stay on {', '.join(below)}" if below else "has nothing beneath it"
                return Fallen(
                    name,
                    f"{name} {on}: it falls before the robot has moved",
                    present,
                    absent,
                )
        return None

    def _moved_m(self, one: Located, beneath: Neighbourhood) -> float:
        is_simple = (
            one.is_boxy and len(one.body.shapes) == 1 and not isinstance(one.body.shapes[0], Mesh)
        )
        if is_simple and self.surroundings.stands_on_table(one) and len(beneath.bodies) == 1:
            return 0.0
        key = (one.body.name, beneath.present.bits)
        if key not in self._known:
            with self.world() as world:
                for other in beneath.bodies:
                    world.add(other.body, other.placement.pose, stands=other is not one)
                self.fastenings.fasten(
                    world, ((other.body.name, other.placement) for other in beneath.bodies)
                )
                for _ in range(_STEPS):
                    world.step()
                if not world.is_sane():
                    self._known[key] = math.inf
                    return math.inf
                now = np.array(world.pose(one.body.name).position)
                away = now - np.array(one.placement.pose.position)
                self._known[key] = length(away)
        return self._known[key]
