"""Bodies that are fixed: by threads, fits, holders and workholders; and turns, which move them."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

from skillplan.task.motion import Event
from skillplan.task.pose import DOWN, Pose, is_same_direction
from skillplan.task.scene import WORLD, Body, Placement, Workholder
from skillplan.task.skill import Skill
from skillplan.task.state import AND, State
from skillplan.task.task import Task
from skillplan_simulation.simulator import TABLE, World

# Greatest distance of two bodies with a fit at their goals [m].
_FIT_REACH_M = 0.0005


@dataclass(frozen=True, slots=True)
class Turn:
    """A turn of a workholder.

    Parameters
    ----------
    begin, end
        Facts of its orientations before and after.
    carried
        Bodies that the task has on it.
    held
        Bodies of `carried` that it holds: its own, and parts in its holders.
    """

    workholder: Workholder
    begin: str
    end: str
    carried: frozenset[str]
    held: frozenset[str]

    def at(self, time_share: float) -> Pose:
        """Return the motion of its bodies since the begin, after a share of the time in [0, 1]."""
        return self.workholder.move(self.begin, self.end, time_share)

    @property
    def pivot(self) -> Pose:
        """Pose of the fixed point at the begin."""
        return Pose(self.workholder.orientations[self.begin].apply(self.workholder.pivot))


@dataclass(frozen=True, slots=True)
class Rearrangement:
    """Bodies that a skill without motion fixes, frees, adds and removes.

    Parameters
    ----------
    fixed, freed
        Parts that holders take and let go; new jaws are fixed, too.
    passes
        New jaws, each with the part between them.
    appears
        New bodies with their poses: closed jaws, and a joined part.
    vanishes
        Open jaws, and the members of a joined part.
    lead
        A member that vanishes, and its pose in the task; None if no parts are joined.
    """

    fixed: tuple[str, ...]
    freed: tuple[str, ...]
    passes: tuple[tuple[str, str], ...]
    appears: tuple[tuple[Body, Pose], ...]
    vanishes: tuple[str, ...]
    lead: tuple[str, Pose] | None


class Fastenings:
    """Screws of a task that are held by their threads, and parts that are held in place."""

    def __init__(self, task: Task) -> None:
        self.task, scene = task, task.scene
        # Without holders, gravity alone holds parts with screws from above.
        self._holds_product = bool(scene.workholders or scene.holders)
        released = {
            (visit.subject, fact)
            for skill in task.skills
            if skill.motion is not None
            for route in skill.motion.routes
            for visit in route.visits
            if visit.is_fitted
            for fact in skill.prediction.add
        }
        self._fits: dict[tuple[str, str], tuple[str, ...]] = {}
        for body in scene.bodies:
            into = tuple(fit.into for fit in body.fits if fit.fastens)
            for placement in body.placements if into else ():
                is_goal = body.fixed or _is_among(body.name, placement, released)
                if is_goal and placement.frame == WORLD:
                    self._fits[body.name, placement.fact] = into
        driven: set[tuple[str, str]] = set()
        for skill in task.skills:
            motions = (skill.motion, *(way.motion for way in skill.ways))
            routes = (route for motion in motions if motion is not None for route in motion.routes)
            for visit in (visit for route in routes for visit in route.visits):
                is_held = self._holds_product or not is_same_direction(visit.along, DOWN)
                if visit.event is Event.DRIVE and is_held:
                    driven |= {(visit.subject, fact) for fact in skill.prediction.add}
        self._threads = {
            (body.name, placement.fact)
            for body in scene.bodies
            for placement in body.placements
            if _is_among(body.name, placement, driven)
        }
        self._parts = {
            fact: part for holder in scene.holders for part, fact in holder.facts.items()
        }
        # Jaws of holders with the parts between them; and bodies of workholders.
        self._jaws = {
            body.name: self._parts[term]
            for body in scene.bodies
            for placement in body.placements
            for term in placement.fact.split(AND)
            if term in self._parts
        }
        self._own = {name for workholder in scene.workholders for name in workholder.own}

    def hold(self, body: str, placement: Placement) -> bool:
        """Return whether a thread holds a body at one of its places."""
        return (body, placement.fact) in self._threads

    def list_still(self, state: State) -> set[str]:
        """Return the bodies that nothing moves: parts in holders, jaws, and workholders."""
        if not self._holds_product:
            return set()
        return {*self._list_in_holders(state), *self._jaws, *self._own}

    def _list_in_holders(self, state: State) -> set[str]:
        """Return the parts at their goals that holders keep there; others are still to come."""
        goals = self.task.operations
        held = self.task.scene.list_held(state)
        return {part for part in held if part in goals and goals[part] in state}

    def basis(self, names: Collection[str], state: State) -> tuple[State, State]:
        """Return the facts that decide whether bodies are held, by their truth."""
        facts = [fact for fact, part in self._parts.items() if part in names]
        present = [fact for fact in facts if fact in state]
        return self.task.facts.of(*present), state.find_missing(*facts)

    def fasten(self, world: World, there: Iterable[tuple[str, Placement]], state: State) -> None:
        """Fix the bodies of a world that threads, fits and holders hold.

        Parameters
        ----------
        world
            World with the bodies in place.
        there
            Names of the bodies, and their placements.
        """
        still = self.list_still(state)
        for name, placement in there:
            for into in self._fits.get((name, placement.fact), ()):
                if into in world.numbers and world.is_near(name, into, _FIT_REACH_M):
                    world.fasten(name, into)
            if self.hold(name, placement):
                other = world.nearest(name)
                if other is not None:
                    world.fasten(name, other)
                if self._holds_product:
                    fix_joined(world, self.task.scene.body(name))
            if name in still:
                fix_in_place(world, name)
            if name in self._jaws:
                world.part(name, [self._jaws[name]])

    def find_turn(self, skill: Skill, state: State) -> Turn | None:
        """Return the turn of a skill, or None."""
        visits = () if skill.motion is None else skill.motion.visits(state)
        subject = next((visit.subject for visit in visits if visit.event is Event.TURN), None)
        if subject is None:
            return None
        scene = self.task.scene
        workholder = scene.find_workholder(subject)
        begin = workholder.find_orientation(state)
        after = skill.prediction_in(state).apply(state)
        carried = scene.list_carried(workholder, state)
        own = {
            part
            for part, holder in scene.list_held(state).items()
            if holder.workholder == workholder.name
        }
        held = carried & {*own, *workholder.own, *self._jaws}
        return Turn(workholder, begin, workholder.find_orientation(after), carried, held)

    def find_rearrangement(self, skill: Skill, state: State) -> Rearrangement:
        """Return the bodies that a skill without motion fixes, frees, adds and removes."""
        scene, after = self.task.scene, skill.prediction_in(state).apply(state)
        appears: list[tuple[Body, Pose]] = []
        vanishes: list[str] = []
        lead = None
        for body in scene.bodies:
            before, then = body.placement(state), body.placement(after)
            if then is not None and before is None and then.solid:
                appears.append((body, then.pose))
            elif before is not None and then is None:
                vanishes.append(body.name)
                if lead is None:
                    lead = body.name, before.pose
        jaws = tuple(
            (body.name, self._jaws[body.name]) for body, _ in appears if body.name in self._jaws
        )
        held, still_held = map(self._list_in_holders, (state, after))
        return Rearrangement(
            (*sorted(still_held - held), *(name for name, _ in jaws)),
            tuple(sorted(held - still_held)),
            jaws,
            tuple(appears),
            tuple(vanishes),
            lead,
        )


def _is_among(name: str, placement: Placement, facts: Collection[tuple[str, str]]) -> bool:
    """Return whether a body and one of the facts of its placement are among some pairs."""
    return any((name, term) in facts for term in placement.fact.split(AND))


def fix_in_place(world: World, name: str) -> None:
    """Fix a body where it is, unless it is fixed already."""
    if (name, TABLE) not in world.fastened:
        world.fasten(name, TABLE)


def fix_joined(world: World, screw: Body) -> None:
    """Fix the bodies that a driven screw joins to each other."""
    joined = [name for name in screw.joins if name in world.numbers]
    for other in joined[1:]:
        if not {(other, joined[0]), (joined[0], other)} & world.fastened:
            world.fasten(other, joined[0])


def free_joined(world: World, screw: Body, bodies: Iterable[Body]) -> None:
    """Release the bodies that only a screw joined, once it is out of the world."""
    driven = {name for pair in world.fastened for name in pair}
    others = [set(body.joins) for body in bodies if body.joins and body.name in driven]
    for pair in sorted(world.fastened):
        if set(pair) <= set(screw.joins) and not any(set(pair) <= other for other in others):
            world.unfasten(*pair)


def list_fixed_to(world: World, held: Collection[str]) -> frozenset[str]:
    """Return some bodies, and the ones fixed to them directly or through others."""
    fixed = set(held)
    pairs = [pair for pair in world.fastened if TABLE not in pair]
    grows = True
    while grows:
        reached = {name for pair in pairs if fixed & set(pair) for name in pair}
        grows = not reached <= fixed
        fixed |= reached
    return frozenset(fixed)
