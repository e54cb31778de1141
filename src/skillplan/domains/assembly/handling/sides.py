"""How directions, the sides of a part and grasps are named; the grasps that ``auto`` tries."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import count
from typing import Literal

from skillplan.domains.assembly.handling.schema import GraspConfig
from skillplan.task.grasp import AXES, Grasp, GraspKind
from skillplan.task.pose import DOWN, Point, dot, same_direction

_SIDES: tuple[tuple[str, Point], ...] = (
    ("top", DOWN),
    ("-x", AXES["x"]),
    ("+x", (-1.0, 0.0, 0.0)),
    ("-y", AXES["y"]),
    ("+y", (0.0, -1.0, 0.0)),
    ("bottom", AXES["z"]),
)
"""The sides of a part, and in which direction of its frame a hand there points."""
_AXES: tuple[Literal["x", "y", "z"], ...] = ("x", "y", "z")


def side_name(approach: Point) -> str:
    """Return the side of a part from which a hand comes that points in a direction."""
    for name, direction in _SIDES:
        if same_direction(direction, approach):
            return name
    return direction_name((-approach[0], -approach[1], -approach[2]))


def direction_name(direction: Point) -> str:
    """Return a unit vector in words: ``-x``, or its numbers where it is along no axis."""
    for name, axis in AXES.items():
        for sign in (1.0, -1.0):
            if same_direction((sign * axis[0], sign * axis[1], sign * axis[2]), direction):
                return f"{'+' if sign > 0 else '-'}{name}"
    return "(" + " ".join(f"{value + 0.0:.3g}" for value in direction) + ")"


def automatic() -> list[GraspConfig]:
    """Return the grasps that ``auto`` tries: from every side, closing along either axis there."""
    return [
        GraspConfig(approach=list(approach), closing_axis=axis)
        for _, approach in _SIDES
        for axis in _AXES
        if not dot(AXES[axis], approach)
    ]


def named(grasps: Sequence[Grasp]) -> tuple[Grasp, ...]:
    """Return grasps with names that tell them apart; a single one needs none."""
    if len(grasps) < 2:
        return tuple(grasps)
    names = [side_name(grasp.approach) for grasp in grasps]
    for more in (_closing, _kind):
        taken = Counter(names)
        names = [
            f"{name} {more(grasp)}" if taken[name] > 1 else name
            for name, grasp in zip(names, grasps, strict=True)
        ]
    taken, seen = Counter(names), {name: count(1) for name in names}
    names = [f"{name} {next(seen[name])}" if taken[name] > 1 else name for name in names]
    return tuple(replace(grasp, name=name) for grasp, name in zip(grasps, names, strict=True))


def _closing(grasp: Grasp) -> str:
    axis = grasp.closing_axis
    return f"closing along {axis if axis is not None else direction_name(grasp.closing)}"


def _kind(grasp: Grasp) -> str:
    return "by suction" if grasp.kind is GraspKind.SUCTION else "by jaws"
