"""Travels between two postures: straight where that is free, else planned round what stands there.

What stands in the way is found out bit by bit. A way is planned round what the last one ran into,
and among all that there may be in any state the new one is checked: so that only those bodies are
asked for that some way met, and a travel is the same in all states that agree about them.
"""

from __future__ import annotations

import atexit
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from typing import Any, Final

import numpy as np
import pinocchio as pin

from skillplan_pinocchio.kinematics.fixed_order import length
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.planning.arm_bodies import ArmBodies, Vector
from skillplan_pinocchio.planning.continuous_check import ContinuousCheck, Hit
from skillplan_pinocchio.shapes import Obstacle


class PostureCheck:
    """Checks postures of an arm among obstacles.

    Boxes about all that there is are compared first: at most places only few of them overlap.

    Parameters
    ----------
    bodies
        What moves.
    obstacles
        What stands.
    ends_rad
        Free postures of the arm, each of shape (joints,).
    margin_m
        So far everything keeps from what stands, or half as far as it does at the ends [m]; from
        itself the arm keeps clear.
    """

    def __init__(
        self,
        bodies: ArmBodies,
        obstacles: Sequence[Obstacle],
        ends_rad: Sequence[Vector],
        margin_m: float,
    ) -> None:
        self._model, self._data = bodies.model, bodies.model.createData()
        geometry = bodies.geometry()
        pieces = [piece for obstacle in obstacles for piece in obstacle.pieces]
        for number, piece in enumerate(pieces):
            geometry.addGeometryObject(
                pin.GeometryObject(f"piece {number}", 0, pin.SE3.Identity(), piece.hull)
            )
        # The base of the arm stands where it is put.
        solids = len(bodies.solids)
        for solid in range(bodies.still, solids):
            for number in range(solids, solids + len(pieces)):
                geometry.addCollisionPair(pin.CollisionPair(solid, number))
        nearness = geometry.createData()
        for end_rad in ends_rad:
            pin.computeDistances(self._model, self._data, geometry, nearness, end_rad)
            for distanceResult in nearness.distanceResults:
                margin_m = min(margin_m, distanceResult.min_distance / 2)
        standing = len(geometry.collisionPairs)
        for pair in bodies.pairs:
            geometry.addCollisionPair(pin.CollisionPair(*pair))
        nearness = geometry.createData()
        for number in range(standing):
            nearness.collisionRequests[number].security_margin = margin_m
        # The manager looks into them.
        self._looked_into = (geometry, nearness)
        self._manager = pin.BroadPhaseManager_NaiveCollisionManager(
            bodies.model, geometry, nearness
        )

    def is_free(self, joints_rad: Vector) -> bool:
        """Whether nothing is touched at some joint angles [rad], shape (joints,)."""
        return not pin.computeCollisions(self._model, self._data, self._manager, joints_rad, True)


# How far apart postures of an edge are checked, and how far a tree grows at once: in metres, by
# what a joint moves the arm's end at most.
SPACING_M: Final = 0.03
_RANGE_M: Final = 0.5


@dataclass(frozen=True)
class JointSpace:
    """In which ways are looked for.

    Parameters
    ----------
    low_rad, high_rad
        Limits of the joints, shape (joints,).
    reach_m
        How far from its axis a joint moves anything at most, > 0, shape (joints,): the weight of
        the joint in a distance.
    """

    low_rad: Vector
    high_rad: Vector
    reach_m: Vector

    def length_m(self, one_rad: Vector, other_rad: Vector) -> float:
        """Return how far apart two postures are [m]."""
        return length((other_rad - one_rad) * self.reach_m)

    def edge_is_free(
        self, is_free: Callable[[Vector], bool], one_rad: Vector, other_rad: Vector
    ) -> bool:
        """Whether no posture on a straight edge, `SPACING_M` apart, is blocked."""
        count = max(int(np.ceil(self.length_m(one_rad, other_rad) / SPACING_M)), 1)
        shares = np.arange(1, count) / count
        # From the middle outwards: what is nearer to the ends is likelier to be free.
        ordered = sorted(shares.tolist(), key=lambda share: (abs(share - 0.5), share))
        turn_rad = other_rad - one_rad
        return all(is_free(one_rad + share * turn_rad) for share in ordered)


def connection(
    space: JointSpace,
    is_free: Callable[[Vector], bool],
    ends_rad: tuple[Vector, Vector],
    seed: int,
    most_checks: int,
) -> tuple[list[Vector] | None, int]:
    """Return postures that lead from one to another along straight edges, and the checks made.

    Parameters
    ----------
    space
        The joints.
    is_free
        Says of a posture whether it is.
    ends_rad
        Two free postures.
    seed
        Of the random numbers, >= 1.
    most_checks
        After so many postures checked it gives up, and there is None.
    """
    base, geometric, util = _ompl()
    joints = len(space.reach_m)
    count = 0

    def checked(state: Any) -> bool:
        nonlocal count
        count += 1
        return is_free(np.array([state[joint] for joint in range(joints)]) / space.reach_m)

    util.RNG.setSeed(seed)
    states = base.RealVectorStateSpace(joints)
    bounds = base.RealVectorBounds(joints)
    for joint in range(joints):
        bounds.setLow(joint, float(space.low_rad[joint] * space.reach_m[joint]))
        bounds.setHigh(joint, float(space.high_rad[joint] * space.reach_m[joint]))
    states.setBounds(bounds)
    information = base.SpaceInformation(states)
    information.setStateValidityChecker(checked)
    information.setStateValidityCheckingResolution(SPACING_M / states.getMaximumExtent())
    information.setup()
    ends = []
    for end_rad in ends_rad:
        state = states.allocState()
        for joint in range(joints):
            state[joint] = float(end_rad[joint] * space.reach_m[joint])
        ends.append(state)
    problem = base.ProblemDefinition(information)
    problem.setStartAndGoalStates(*ends)
    planner = geometric.RRTConnect(information)
    planner.setRange(_RANGE_M)
    planner.setProblemDefinition(problem)
    planner.setup()
    planner.solve(base.PlannerTerminationCondition(lambda: count >= most_checks))
    if not problem.hasExactSolution():
        return None, count
    inner = problem.getSolutionPath().getStates()[1:-1]
    nodes = [np.array([state[joint] for joint in range(joints)]) / space.reach_m for state in inner]
    return [ends_rad[0], *nodes, ends_rad[1]], count


@cache
def _ompl() -> tuple[Any, Any, Any]:
    """Return OMPL's modules; only who plans needs them."""
    from ompl import base, geometric, util

    # It would print what is said better by what is returned.
    util.setLogLevel(util.LogLevel.LOG_NONE)
    atexit.register(_end_in_silence)
    return base, geometric, util


def _end_in_silence() -> None:
    """Have what OMPL's bindings print of leaks, once all else has ended, go nowhere."""
    with suppress(OSError, ValueError, AttributeError):
        sys.stderr.flush()
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)


_CUTS: Final = 16
# Steps of the golden ratio, and of the plastic number's square: even, and never the same twice.
_GOLDEN: Final = (0.7548776662466927, 0.5698402909980532)
# Shorter pieces of a way are left as they are, as a fraction of it.
_SHORTEST_CUT: Final = 0.05
_DECIMALS: Final = 6


def shortened(
    space: JointSpace, is_free: Callable[[Vector], bool], nodes: Sequence[Vector]
) -> list[Vector]:
    """Return a way with the same ends, from which needless corners are cut.

    Parameters
    ----------
    space
        The joints.
    is_free
        Says of a posture whether it is.
    nodes
        Postures with free straight edges between them.
    """
    found = _without_detours(space, is_free, list(nodes))
    for number in range(1, _CUTS + 1):
        if len(found) == 2:
            break
        begin, end = sorted((number * step) % 1.0 for step in _GOLDEN)
        if end - begin < _SHORTEST_CUT:
            continue
        places = _places(space, found)
        one, other = _at(found, places, begin), _at(found, places, end)
        if not space.edge_is_free(is_free, one, other):
            continue
        before = [node for node, place in zip(found, places, strict=True) if place < begin]
        after = [node for node, place in zip(found, places, strict=True) if place > end]
        found = [*before, one, other, *after]
    return _without_detours(space, is_free, found)


def rounded(space: JointSpace, nodes: Sequence[Vector], intervals: int) -> JointPath:
    """Return a spline along a way, through postures at equal distances from each other.

    The more there are, the closer it follows the way. Inner ones are rounded to microradians.

    Parameters
    ----------
    space
        The joints.
    nodes
        Of the way.
    intervals
        Of the spline, >= 1.
    """
    places = _places(space, nodes)
    inner = [
        np.round(_at(nodes, places, number / intervals), _DECIMALS)
        for number in range(1, intervals)
    ]
    return JointPath([nodes[0], *inner, nodes[-1]])


def _without_detours(
    space: JointSpace, is_free: Callable[[Vector], bool], nodes: list[Vector]
) -> list[Vector]:
    """Return a way that goes from every node to the last that a straight edge leads to."""
    found, here = [nodes[0]], 0
    while here < len(nodes) - 1:
        here = next(
            there
            for there in range(len(nodes) - 1, here, -1)
            if there == here + 1 or space.edge_is_free(is_free, nodes[here], nodes[there])
        )
        found.append(nodes[here])
    return found


def _places(space: JointSpace, nodes: Sequence[Vector]) -> list[float]:
    """Return how much of a way lies before each of its nodes, from 0 to 1."""
    sums = np.cumsum([0.0] + [space.length_m(one, other) for one, other in pairwise(nodes)])
    # Where nothing moves, any places do.
    shares = sums / sums[-1] if sums[-1] > 0 else np.linspace(0.0, 1.0, len(nodes))
    return [float(share) for share in shares]


def _at(nodes: Sequence[Vector], places: Sequence[float], place: float) -> Vector:
    number = min(int(np.searchsorted(places, place, "right")), len(nodes) - 1)
    begin, end = places[number - 1], places[number]
    share = (place - begin) / (end - begin) if end > begin else 1.0
    return np.asarray(nodes[number - 1] + share * (nodes[number] - nodes[number - 1]))


Holds = Callable[[str], bool]
"""Says of a fact whether it holds where the travel starts."""

_SEED: Final = 1
# Postures of a planned way keep so far from everything, or half as far as its ends do [m].
_MARGIN_M: Final = 0.01
# A spline with more intervals follows the edges of a way more closely.
_INTERVALS: Final = (8, 16, 32, 64)
# So often it is planned anew where the spline along a way is not free.
_ATTEMPTS: Final = 3


@dataclass(frozen=True, eq=False)
class Travel:
    """A path that is free, and what was planned round.

    Parameters
    ----------
    path
        Of the joints.
    around
        Bodies that stand in the straight way; none where it is the straight one.
    """

    path: JointPath
    around: tuple[str, ...] = ()

    @property
    def is_straight(self) -> bool:
        """Whether all joints go straight from start to end."""
        return not self.around


@dataclass(frozen=True)
class Unfound:
    """That no travel was found, and why.

    Parameters
    ----------
    reason
        One clause.
    is_proof
        Whether there is none: what the hand holds, or the hand, runs into something at one of
        the ends, however the arm gets there. Else it was not found within the budget.
    hit
        What is touched; at an end, or on the straight way.
    checks
        How many postures were checked in vain.
    """

    reason: str
    is_proof: bool
    hit: Hit
    checks: int = 0


@dataclass
class _Known:
    """What was worked out of the travels between two postures."""

    bodies: ArmBodies
    all: ContinuousCheck
    ends: tuple[tuple[Hit, ...], tuple[Hit, ...]]
    straight: JointPath
    straight_hits: tuple[Hit, ...]
    planned: dict[frozenset[int], tuple[JointPath, tuple[Hit, ...]] | int] = field(
        default_factory=dict
    )


class TravelSearch:
    """Finds travels of an arm with what it holds.

    It keeps what it found. That changes no answer, only how long it takes.

    Parameters
    ----------
    obstacles
        All that there may be in any state.
    space
        The joints.
    most_checks
        Postures that are checked for one travel before it is given up.
    """

    def __init__(self, obstacles: Sequence[Obstacle], space: JointSpace, most_checks: int) -> None:
        self.obstacles = tuple(obstacles)
        self.space = space
        self.most_checks = most_checks
        self._known: dict[tuple[Any, bytes, bytes], _Known] = {}

    def find(
        self,
        key: Any,
        bodies: Callable[[], ArmBodies],
        ends_rad: tuple[Vector, Vector],
        spares: frozenset[str],
        holds: Holds,
    ) -> Travel | Unfound:
        """Return a travel where some facts hold.

        Parameters
        ----------
        key
            Hashable; says what `bodies` and `spares` are.
        bodies
            Makes what moves.
        ends_rad
            Where the joints start and end, two of shape (joints,).
        spares
            Bodies that may be touched.
        holds
            Asked only for facts that the answer rests on.
        """
        start, end = ends_rad
        full = (key, start.tobytes(), end.tobytes())
        if full not in self._known:
            self._known[full] = self._looked_at(bodies(), ends_rad, spares)
        known = self._known[full]
        for hits, where in zip(known.ends, ("begins", "ends"), strict=True):
            hit = next((one for one in hits if _is_there(one, holds)), None)
            if hit is not None:
                reason = f"{hit.mover} runs into {hit.body} where the travel {where}"
                return Unfound(reason, not hit.of_arm, hit)
        path, hits = known.straight, known.straight_hits
        met: frozenset[int] = frozenset()
        first: Hit | None = None
        while True:
            there = [one for one in hits if _is_there(one, holds)]
            if not there:
                around = sorted({self.obstacles[number].body for number in met})
                return Travel(path, tuple(around) if first is None or around else (first.body,))
            first = first or there[0]
            met |= {
                number
                for number, obstacle in enumerate(self.obstacles)
                if any((obstacle.body, obstacle.fact) == (hit.body, hit.fact) for hit in there)
            }
            planned = self._planned(known, met)
            if isinstance(planned, int):
                reason = (
                    f"{first.mover} runs into {first.body} on the straight travel, and no way "
                    f"round was found in {planned} checks of postures"
                )
                return Unfound(reason, False, first, planned)
            path, hits = planned

    def _looked_at(
        self, bodies: ArmBodies, ends_rad: tuple[Vector, Vector], spares: frozenset[str]
    ) -> _Known:
        standing = [obstacle for obstacle in self.obstacles if obstacle.body not in spares]
        check = ContinuousCheck(bodies, standing)
        straight = JointPath(list(ends_rad))
        start, hits, end = check.hits_and_ends(straight)
        return _Known(bodies, check, (start, end), straight, hits)

    def _planned(
        self, known: _Known, met: frozenset[int]
    ) -> tuple[JointPath, tuple[Hit, ...]] | int:
        """Return a path round what was met and all that it hits, or the checks made in vain."""
        always = {number for number, obstacle in enumerate(self.obstacles) if obstacle.fact is None}
        world = met | always
        if world not in known.planned:
            path = self._way_round(known, world)
            known.planned[world] = path if isinstance(path, int) else (path, known.all.hits(path))
        return known.planned[world]

    def _way_round(self, known: _Known, world: frozenset[int]) -> JointPath | int:
        standing = {obstacle.body for obstacle in known.all.obstacles}
        some = [self.obstacles[number] for number in sorted(world)]
        check = ContinuousCheck(known.bodies, [one for one in some if one.body in standing])
        ends = (known.straight.nodes[0], known.straight.nodes[-1])
        is_free = PostureCheck(known.bodies, check.obstacles, ends, _MARGIN_M).is_free
        spent = 0
        for attempt in range(_ATTEMPTS):
            left = self.most_checks - spent
            nodes, checks = connection(self.space, is_free, ends, _SEED + attempt, left)
            spent += checks
            if nodes is None:
                break
            way = shortened(self.space, is_free, nodes)
            for intervals in _INTERVALS:
                path = rounded(self.space, way, intervals)
                if self._is_within(path) and check.is_clear(path):
                    return path
            if spent >= self.most_checks:
                break
        return spent

    def _is_within(self, path: JointPath) -> bool:
        """Whether the joints stay within their limits, sampled as densely as splines bend."""
        places = np.linspace(0.0, 1.0, 4 * (len(path.nodes) - 1) + 1)
        angles = np.array([path.at(place) for place in places.tolist()])
        low, high = self.space.low_rad, self.space.high_rad
        return bool((angles >= low - 1e-9).all() and (angles <= high + 1e-9).all())


def _is_there(hit: Hit, holds: Holds) -> bool:
    return hit.fact is None or holds(hit.fact)
