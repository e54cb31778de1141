"""What a detector compares, as convex hulls to be looked at: what moves, and what stands about."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol, runtime_checkable

from skillplan.task.motion import Point
from skillplan.task.skill import Skill
from skillplan.task.state import State


class HullRole(StrEnum):
    """What a hull stands for."""

    MOVING = "moving"
    STANDING = "standing"
    MET = "met"


@dataclass(frozen=True, slots=True)
class Hull:
    """A convex polyhedron in the world.

    Parameters
    ----------
    name
        Of the body, or of the part of the arm.
    role
        Whether it is swept by something that moves, stands there, or stands there and is named by
        the verdict.
    vertices
        Its corners [m].
    triangles
        Its surface, three indices of vertices each.

    Raises
    ------
    ValueError
        If a triangle names a vertex that there is not.
    """

    name: str
    role: HullRole
    vertices: Sequence[Point]
    triangles: Sequence[tuple[int, int, int]]

    def __post_init__(self) -> None:
        known = range(len(self.vertices))
        if any(corner not in known for triangle in self.triangles for corner in triangle):
            raise ValueError(f"A triangle of the hull {self.name!r} has a corner without a place.")


@dataclass(frozen=True, slots=True)
class HullScene:
    """A skill's swept motion in a state.

    Parameters
    ----------
    hulls
        All that is compared, in no order.
    touches
        Where something runs into something [m]; empty where the motion is free.
    reason
        Reason of an infeasible verdict; empty if the motion is feasible.
    subjects
        Names of the bodies in that reason, moving ones included.
    """

    hulls: Sequence[Hull]
    touches: Sequence[Point] = ()
    reason: str = ""
    subjects: frozenset[str] = frozenset()


@runtime_checkable
class HullDetector(Protocol):
    """A detector that can show the hulls it compares."""

    name: str

    def hulls(self, skill: Skill, state: State) -> HullScene:
        """Return what `skill` sweeps in a state, and what stands in its path or beside it.

        Raises
        ------
        ValueError
            If there is nothing to be seen; the message says why.
        """
