"""Travels between two postures: straight where that is free, else planned round what stands there.

What stands in the way is found out bit by bit. A way is planned round what the last one ran into,
and among all that there may be in any state the new one is checked: so that only those bodies are
asked for that some way met, and a travel is the same in all states that agree about them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.obstacles import Obstacle
from skillplan_pinocchio.planning.arm_bodies import ArmBodies
from skillplan_pinocchio.planning.continuous_check import ContinuousCheck, Hit
from skillplan_pinocchio.planning.moving_solids import Vector
from skillplan_pinocchio.planning.posture_check import PostureCheck
from skillplan_pinocchio.planning.rrt_connect import JointSpace, connection
from skillplan_pinocchio.planning.shortening import rounded, shortened

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
                for number, one in enumerate(self.obstacles)
                if any((one.body, one.fact) == (hit.body, hit.fact) for hit in there)
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
        standing = [one for one in self.obstacles if one.body not in spares]
        check = ContinuousCheck(bodies, standing)
        straight = JointPath(list(ends_rad))
        start, hits, end = check.hits_and_ends(straight)
        return _Known(bodies, check, (start, end), straight, hits)

    def _planned(
        self, known: _Known, met: frozenset[int]
    ) -> tuple[JointPath, tuple[Hit, ...]] | int:
        """Return a path round what was met and all that it hits, or the checks made in vain."""
        always = {number for number, one in enumerate(self.obstacles) if one.fact is None}
        world = met | always
        if world not in known.planned:
            path = self._way_round(known, world)
            known.planned[world] = path if isinstance(path, int) else (path, known.all.hits(path))
        return known.planned[world]

    def _way_round(self, known: _Known, world: frozenset[int]) -> JointPath | int:
        standing = {one.body for one in known.all.obstacles}
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
