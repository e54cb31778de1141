"""Travels between two postures: straight if that is free, otherwise planned around obstacles.

Obstacles are considered one by one: a path is planned around obstacles of the last path, then
checked against all obstacles of any state. So only facts of bodies that some path met are read, and
a travel is equal in all states that agree on them.
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

from skillplan.robots.arm_description import ArmDescription
from skillplan.robots.link_frames import follow
from skillplan_pinocchio.kinematics.fixed_order import length
from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.planning.arm_bodies import ArmBodies, Vector
from skillplan_pinocchio.planning.continuous_check import ContinuousCheck, Hit
from skillplan_pinocchio.shapes import Obstacle


class PostureCheck:
    """Checks postures of an arm among obstacles.

    Compares bounding boxes first: in most postures only few overlap.

    Parameters
    ----------
    obstacles
        Fixed obstacles.
    ends_rad
        Free postures of the arm, each of shape (joints,).
    margin_m
        Clearance from obstacles, at most half the clearance at the ends [m]. It does not apply to
        self-collisions.
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
        owned = [(obstacle, piece) for obstacle in obstacles for piece in obstacle.pieces]
        for number, (_, piece) in enumerate(owned):
            geometry.addGeometryObject(
                pin.GeometryObject(f"piece {number}", 0, pin.SE3.Identity(), piece.hull)
            )
        # The base of the arm is fixed.
        solids = len(bodies.solids)
        for solid in range(bodies.still, solids):
            for number, (obstacle, _) in enumerate(owned, solids):
                if not obstacle.stops(load=bodies.solids[solid].is_load):
                    continue
                geometry.addCollisionPair(pin.CollisionPair(solid, number))
        nearness = geometry.createData()
        for end_rad in ends_rad:
            pin.computeDistances(self._model, self._data, geometry, nearness, end_rad)
            for distance in nearness.distanceResults:
                margin_m = min(margin_m, distance.min_distance / 2)
        standing = len(geometry.collisionPairs)
        for pair in bodies.pairs:
            geometry.addCollisionPair(pin.CollisionPair(*pair))
        nearness = geometry.createData()
        for number in range(standing):
            nearness.collisionRequests[number].security_margin = margin_m
        # The manager keeps references to them.
        self._looked_into = (geometry, nearness)
        self._manager = pin.BroadPhaseManager_NaiveCollisionManager(
            bodies.model, geometry, nearness
        )

    def is_free(self, joints_rad: Vector) -> bool:
        """Return whether some joint angles [rad], shape (joints,), are free of contacts."""
        return not pin.computeCollisions(self._model, self._data, self._manager, joints_rad, True)


# Spacing of checked postures on an edge, and longest step of a tree [m], measured by the joints'
# reach.
SPACING_M: Final = 0.03
_RANGE_M: Final = 0.5


@dataclass(frozen=True)
class JointSpace:
    """Joint space of the search.

    Parameters
    ----------
    low_rad, high_rad
        Joint limits, shape (joints,).
    reach_m
        Maximum distance from a joint's axis to a point that it moves, > 0, shape (joints,): the
        weight of the joint in a distance.
    arm
        Description of an arm in which joints follow others, None for other arms.
    """

    low_rad: Vector
    high_rad: Vector
    reach_m: Vector
    arm: ArmDescription | None = None

    def follow(self, joints_rad: Vector) -> Vector:
        """Return a posture with each following joint where its leader puts it."""
        return joints_rad if self.arm is None else follow(self.arm, joints_rad)

    def length_m(self, begin_rad: Vector, end_rad: Vector) -> float:
        """Return the distance between two postures [m]."""
        return length((end_rad - begin_rad) * self.reach_m)

    def edge_is_free(
        self, is_free: Callable[[Vector], bool], begin_rad: Vector, end_rad: Vector
    ) -> bool:
        """Return whether all postures on a straight edge, with spacing `SPACING_M`, are free."""
        count = max(int(np.ceil(self.length_m(begin_rad, end_rad) / SPACING_M)), 1)
        shares = np.arange(1, count) / count
        # From the middle outwards: postures near the ends are likelier to be free.
        ordered = sorted(shares.tolist(), key=lambda share: (abs(share - 0.5), share))
        turn_rad = end_rad - begin_rad
        return all(is_free(begin_rad + share * turn_rad) for share in ordered)


def find_connection(
    space: JointSpace,
    is_free: Callable[[Vector], bool],
    ends_rad: tuple[Vector, Vector],
    seed: int,
    most_checks: int,
) -> tuple[list[Vector] | None, int]:
    """Return postures that connect two others by straight edges, and the number of checks.

    RRT-Connect (Kuffner and LaValle, 2000) in OMPL's version.

    Parameters
    ----------
    ends_rad
        Two free postures.
    seed
        Seed of the random numbers, >= 1.
    most_checks
        Number of checks after which the search gives up and returns None.
    """
    base, geometric, util = _import_ompl()
    joints = len(space.reach_m)
    count = 0

    def checked(state: Any) -> bool:
        nonlocal count
        count += 1
        posture = np.array([state[joint] for joint in range(joints)]) / space.reach_m
        return is_free(space.follow(posture))

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
    nodes = [
        space.follow(np.array([state[joint] for joint in range(joints)]) / space.reach_m)
        for state in inner
    ]
    return [ends_rad[0], *nodes, ends_rad[1]], count


@cache
def _import_ompl() -> tuple[Any, Any, Any]:
    """Return OMPL's modules, imported on first use."""
    from ompl import base, geometric, util

    # Keep OMPL's log off the terminal; results carry the same information.
    util.setLogLevel(util.LogLevel.LOG_NONE)
    atexit.register(_silence_exit)
    return base, geometric, util


def _silence_exit() -> None:
    """Discard the leak reports of OMPL's bindings at exit."""
    with suppress(OSError, ValueError, AttributeError):
        sys.stderr.flush()
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)


_CUTS: Final = 16
# Steps of the plastic number and its square: evenly spread, never repeating.
_GOLDEN: Final = (0.7548776662466927, 0.5698402909980532)
# Pieces below this share of a path are not shortened.
_SHORTEST_CUT: Final = 0.05
_DECIMALS: Final = 6


def shorten(
    space: JointSpace, is_free: Callable[[Vector], bool], nodes: Sequence[Vector]
) -> list[Vector]:
    """Return a path with the same ends and needless corners cut off.

    Parameters
    ----------
    nodes
        Postures with free straight edges between them.
    """
    kept = _skip_detours(space, is_free, list(nodes))
    for number in range(1, _CUTS + 1):
        if len(kept) == 2:
            break
        begin, end = sorted((number * step) % 1.0 for step in _GOLDEN)
        if end - begin < _SHORTEST_CUT:
            continue
        places = _compute_places(space, kept)
        first, last = _interpolate(kept, places, begin), _interpolate(kept, places, end)
        if not space.edge_is_free(is_free, first, last):
            continue
        before = [node for node, place in zip(kept, places, strict=True) if place < begin]
        after = [node for node, place in zip(kept, places, strict=True) if place > end]
        kept = [*before, first, last, *after]
    return _skip_detours(space, is_free, kept)


def round_corners(space: JointSpace, nodes: Sequence[Vector], intervals: int) -> JointPath:
    """Return a spline through postures at equal distances along a path.

    More intervals follow the path more closely. Inner postures are rounded to microradians.

    Parameters
    ----------
    intervals
        Intervals of the spline, >= 1.
    """
    places = _compute_places(space, nodes)
    inner = [
        np.round(_interpolate(nodes, places, number / intervals), _DECIMALS)
        for number in range(1, intervals)
    ]
    return JointPath([nodes[0], *inner, nodes[-1]])


def _skip_detours(
    space: JointSpace, is_free: Callable[[Vector], bool], nodes: list[Vector]
) -> list[Vector]:
    """Return a path that skips nodes wherever a straight edge is free."""
    kept, here = [nodes[0]], 0
    while here < len(nodes) - 1:
        here = next(
            there
            for there in range(len(nodes) - 1, here, -1)
            if there == here + 1 or space.edge_is_free(is_free, nodes[here], nodes[there])
        )
        kept.append(nodes[here])
    return kept


def _compute_places(space: JointSpace, nodes: Sequence[Vector]) -> list[float]:
    """Return the share of a path before each of its nodes, from 0 to 1."""
    sums = np.cumsum([0.0] + [space.length_m(before, after) for before, after in pairwise(nodes)])
    # If the posture does not change, any places will do.
    shares = sums / sums[-1] if sums[-1] > 0 else np.linspace(0.0, 1.0, len(nodes))
    return [float(share) for share in shares]


def _interpolate(nodes: Sequence[Vector], places: Sequence[float], place: float) -> Vector:
    number = min(int(np.searchsorted(places, place, "right")), len(nodes) - 1)
    begin, end = places[number - 1], places[number]
    share = (place - begin) / (end - begin) if end > begin else 1.0
    return np.asarray(nodes[number - 1] + share * (nodes[number] - nodes[number - 1]))


Holds = Callable[[str], bool]
"""Returns whether a fact holds where the travel starts."""

_SEED: Final = 1
# Clearance of planned postures, at most half that of the ends [m].
_MARGIN_M: Final = 0.01
# Spline intervals to try; more intervals follow the edges more closely.
_INTERVALS: Final = (8, 16, 32, 64)
# Planning attempts if the spline along a path is not free.
_ATTEMPTS: Final = 3


@dataclass(frozen=True, eq=False)
class Travel:
    """A free joint path.

    Parameters
    ----------
    around
        Bodies in the way of the straight path; empty if the path is straight.
    """

    path: JointPath
    around: tuple[str, ...] = ()

    @property
    def is_straight(self) -> bool:
        """Return whether all joints move straight from start to end."""
        return not self.around


@dataclass(frozen=True)
class Unfound:
    """Failure to find a travel, and its reason.

    Parameters
    ----------
    reason
        Reason as one clause.
    is_proof
        True if no travel exists: hand or load collide at one of the ends in any posture. Otherwise
        none was found within the budget.
    hit
        Contact at an end or on the straight path.
    """

    reason: str
    is_proof: bool
    hit: Hit
    checks: int = 0


@dataclass
class _Known:
    """Results for travels between two postures."""

    bodies: ArmBodies
    all: ContinuousCheck
    ends: tuple[tuple[Hit, ...], tuple[Hit, ...]]
    straight: JointPath
    straight_hits: tuple[Hit, ...]
    planned: dict[frozenset[int], tuple[JointPath, tuple[Hit, ...]] | int] = field(
        default_factory=dict
    )


class TravelSearch:
    """Finds travels of an arm with its load.

    Results are cached; the cache changes only run times.

    Parameters
    ----------
    most_checks
        Number of postures checked for one travel before it is given up.
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
        """Return a travel in a state.

        Parameters
        ----------
        key
            Hashable that identifies `bodies` and `spares`.
        ends_rad
            Start and end posture, two of shape (joints,).
        spares
            Bodies that may be touched.
        holds
            Called only for facts that the result rests on.
        """
        start, end = ends_rad
        full = (key, start.tobytes(), end.tobytes())
        if full not in self._known:
            self._known[full] = self._looked_at(bodies(), ends_rad, spares)
        known = self._known[full]
        for hits, where in zip(known.ends, ("begins", "ends"), strict=True):
            hit = next((candidate for candidate in hits if _is_there(candidate, holds)), None)
            if hit is not None:
                reason = f"{hit.mover} runs into {hit.body} where the travel {where}"
                return Unfound(reason, not hit.of_arm, hit)
        path, hits = known.straight, known.straight_hits
        met: frozenset[int] = frozenset()
        first: Hit | None = None
        while True:
            there = [hit for hit in hits if _is_there(hit, holds)]
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
        """Return a path around met obstacles with all its contacts, or the number of checks."""
        always = {number for number, obstacle in enumerate(self.obstacles) if obstacle.fact is None}
        world = met | always
        if world not in known.planned:
            path = self._way_round(known, world)
            known.planned[world] = path if isinstance(path, int) else (path, known.all.hits(path))
        return known.planned[world]

    def _way_round(self, known: _Known, world: frozenset[int]) -> JointPath | int:
        standing = {obstacle.body for obstacle in known.all.obstacles}
        some = [self.obstacles[number] for number in sorted(world)]
        check = ContinuousCheck(
            known.bodies, [obstacle for obstacle in some if obstacle.body in standing]
        )
        ends = (known.straight.nodes[0], known.straight.nodes[-1])
        is_free = PostureCheck(known.bodies, check.obstacles, ends, _MARGIN_M).is_free
        spent = 0
        for attempt in range(_ATTEMPTS):
            left = self.most_checks - spent
            nodes, checks = find_connection(self.space, is_free, ends, _SEED + attempt, left)
            spent += checks
            if nodes is None:
                break
            way = shorten(self.space, is_free, nodes)
            for intervals in _INTERVALS:
                path = round_corners(self.space, way, intervals)
                if self._is_within(path) and check.is_clear(path):
                    return path
            if spent >= self.most_checks:
                break
        return spent

    def _is_within(self, path: JointPath) -> bool:
        """Return whether the joints stay within their limits, sampled densely."""
        places = np.linspace(0.0, 1.0, 4 * (len(path.nodes) - 1) + 1)
        angles = np.array([path.at(place) for place in places.tolist()])
        low, high = self.space.low_rad, self.space.high_rad
        return bool((angles >= low - 1e-9).all() and (angles <= high + 1e-9).all())


def _is_there(hit: Hit, holds: Holds) -> bool:
    return hit.fact is None or holds(hit.fact)
