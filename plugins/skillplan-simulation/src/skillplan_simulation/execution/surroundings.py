"""Which bodies can matter to a skill, and the facts that say whether they are there.

A body matters where a box about it comes near a box about what moves, or where it supports one
that does. Nothing else is put into the simulated world, so that an execution is a function of
the skill and of those facts.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from skillplan.collision.boxes import WorldBox, contact_area, sweep_hits, world_boxes
from skillplan.physics.linear_motions import LinearMotion
from skillplan.task.motion import Event
from skillplan.task.scene import WORLD, Body, Placement
from skillplan.task.skill import Skill
from skillplan.task.state import State
from skillplan.task.task import Task
from skillplan_simulation.arm.planned_motion import ArmMotion
from skillplan_simulation.execution.sweeps import Sweeps

# Two bodies that are this close may touch when the hand is off its path [m].
MARGIN_M = 0.003
_TOUCH_M = 2e-4
_STILL = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Located:
    """A body at one of its places, and the boxes about it."""

    body: Body
    placement: Placement
    boxes: tuple[WorldBox, ...]

    @property
    def is_boxy(self) -> bool:
        """Whether the boxes about it say what it stands on, and what stands on it."""
        return self.placement.pose.is_upright and not self.body.surfaces


@dataclass(frozen=True, slots=True)
class Neighbourhood:
    """What may be in the world of an execution.

    Parameters
    ----------
    bodies
        Those that are, with the poses they have, in the order of the task.
    present, absent
        The facts that decide it.
    near
        The places near what moves, whether anything is there or not; a support is in the world
        because of the body on it.
    """

    bodies: tuple[Located, ...]
    present: State
    absent: State
    near: tuple[Located, ...]

    def resting_on(self, present: State, absent: State) -> Neighbourhood:
        """Return the same, resting on more facts, by their truth."""
        return replace(self, present=self.present | present, absent=self.absent | absent)


class Surroundings:
    """Knows what is near the motions of a task.

    Parameters
    ----------
    task
        With one robot.
    clearance_m
        How far open jaws stand off a part on either side [m].
    press_travel_m
        How far beyond its mouth a hole is felt for [m].
    """

    def __init__(self, task: Task, clearance_m: float, press_travel_m: float) -> None:
        self.task = task
        self._located = tuple(
            Located(body, placement, world_boxes(body, placement.pose))
            for body in task.scene.bodies
            for placement in body.placements
            if placement.solid and placement.frame == WORLD
        )
        self._supports = {
            (one.body.name, one.placement.fact): tuple(self._beneath(one)) for one in self._located
        }
        self._near: dict[
            tuple[str, tuple[LinearMotion, ...], tuple[bytes, ...], bytes], tuple[Located, ...]
        ] = {}
        self.sweeps = Sweeps(task, clearance_m, press_travel_m)

    def around(
        self,
        skill: Skill,
        planned: Sequence[ArmMotion],
        state: State,
    ) -> Neighbourhood:
        """Return what may matter to a skill in a state.

        Parameters
        ----------
        skill
            With a motion.
        planned
            How the arm follows the skill's motions.
        state
            Where it starts.
        """
        motions = tuple(one.motion for one in planned)
        ways = tuple(one.travel.nodes_rad.tobytes() for one in planned if one.matters)
        key = (skill.name, motions, ways, planned[0].approach[0].tobytes())
        if key not in self._near:
            self._near[key] = tuple(self._close_to(planned))
        handled = {motion.visit.subject for motion in motions}
        own = [
            one for one in self._located if one.body.name in handled and one.placement.fact in state
        ]
        return self._reaching_down([*own, *self._near[key]], state)

    def support(self, body: Located, state: State) -> Neighbourhood:
        """Return a body and its supports, direct or not."""
        return self._reaching_down([body], state)

    def stands_on_table(self, body: Located) -> bool:
        """Whether a body's bottom is on the table."""
        return min(box.low[2] for box in body.boxes) <= _TOUCH_M

    def _reaching_down(self, above: Sequence[Located], state: State) -> Neighbourhood:
        """Return bodies and the supports of those that are there, direct or not."""
        todo = sorted(above, key=self._located.index)
        looked_at: list[Located] = []
        while todo:
            one = todo.pop(0)
            if one not in looked_at:
                looked_at.append(one)
                if one.placement.fact in state:
                    todo += self._supports[one.body.name, one.placement.fact]
        looked_at.sort(key=self._located.index)
        there = tuple(one for one in looked_at if one.placement.fact in state)
        missing = [one.placement.fact for one in looked_at if one not in there]
        facts = self.task.facts
        present = facts.of(*(one.placement.fact for one in there))
        return Neighbourhood(there, present, facts.of(*missing), tuple(above))

    def _beneath(self, one: Located) -> Iterator[Located]:
        floor_m = min(box.low[2] for box in one.boxes)
        feet = [box for box in one.boxes if box.low[2] - floor_m <= _TOUCH_M]
        for other in self._located:
            if other.body.name == one.body.name:
                continue
            if one.is_boxy and other.is_boxy:
                bears = any(
                    contact_area(foot, top, _TOUCH_M) is not None
                    for foot in feet
                    for top in other.boxes
                )
            else:
                # A box about what is turned says no more than that the two may touch.
                bears = any(
                    sweep_hits(box, _STILL, top, -_TOUCH_M)
                    for box in one.boxes
                    for top in other.boxes
                )
            if bears:
                yield other

    def _close_to(self, planned: Sequence[ArmMotion]) -> list[Located]:
        near: list[Located] = []
        moving = self.sweeps.of_skill(planned)
        motions = [one.motion for one in planned]
        spared = {
            motion.visit.subject for motion in motions if motion.visit.event is not Event.DRIVE
        }
        for one in self._located:
            if one.body.name in spared:
                continue
            if any(
                sweep_hits(box, by, obstacle, -MARGIN_M)
                for box, by in moving
                for obstacle in one.boxes
            ):
                near.append(one)
        if any(motion.visit.event is Event.DRIVE for motion in motions):
            # What is pressed may tip, and what stands on it then counts.
            pressed = list(near)
            near += [
                one
                for one in self._located
                if one not in near
                and any(
                    support in pressed
                    for support in self._supports[one.body.name, one.placement.fact]
                )
            ]
        return near
