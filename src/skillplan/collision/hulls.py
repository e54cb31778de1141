"""Convex hulls that a detector compares, for pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol, runtime_checkable

from skillplan.task.motion import Point
from skillplan.task.skill import Skill
from skillplan.task.state import State


class HullRole(StrEnum):
    """Role of a hull in a check."""

    MOVING = "moving"
    STANDING = "standing"
    MET = "met"


@dataclass(frozen=True, slots=True)
class Hull:
    """A convex polyhedron in the world.

    Parameters
    ----------
    name
        Name of the body, or of the part of the arm.
    vertices
        Corners [m].

    Raises
    ------
    ValueError
        If a triangle has an unknown vertex.
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
    """The swept motion of a skill in a state.

    Parameters
    ----------
    touches
        Points of collision [m]; empty for a free motion.
    reason
        Reason of an infeasible verdict; empty if the motion is feasible.
    subjects
        Names of the bodies in that reason, including moving ones.
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
        """Return the hulls of `skill` in a state: swept hulls and the bodies around them.

        Raises
        ------
        ValueError
            If there are none; the message gives the reason.
        """
