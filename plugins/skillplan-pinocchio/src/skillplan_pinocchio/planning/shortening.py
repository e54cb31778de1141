"""Ways made shorter, and rounded: from postures with edges between them to a smooth path."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from skillplan_pinocchio.kinematics.joint_path import JointPath
from skillplan_pinocchio.planning.moving_solids import Vector
from skillplan_pinocchio.planning.rrt_connect import JointSpace

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
