"""A second opinion on what rays found: shrunk meshes, moved, collide or do not.

Rays decide. Where meshes say otherwise the pair is listed, so that nobody need trust either.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import coal
import numpy as np
from numpy.typing import NDArray

from skillplan_cad.planning.shrunk_meshes import MeshTree, shrunk
from skillplan_cad.product import Product, Vector
from skillplan_cad.relation import Blocking

# A blocked pair is tried so far beyond the first contact, in insets; a free one at so many places.
_BEYOND = (3.0, 6.0, 12.0, 25.0, 50.0, 100.0, 200.0, 400.0)
_PLACES = 8


@dataclass(frozen=True, slots=True)
class Doubt:
    """A pair of which rays and meshes say different things.

    Parameters
    ----------
    part, by, direction
        As of `Blocking`.
    rays_say_blocked
        What the relation has; meshes say the opposite.
    """

    part: str
    by: str
    direction: int
    rays_say_blocked: bool


class Confirmation:
    """Shrunk meshes of a product.

    Parameters
    ----------
    product
        The product.
    tolerance_m
        A blocked disc has this radius; meshes are shrunk by half of it each.
    """

    def __init__(self, product: Product, tolerance_m: float) -> None:
        self._product = product
        self._inset_m = tolerance_m / 2
        self._trees: dict[str, MeshTree] = {}

    def doubts(
        self,
        entries: Iterable[Blocking],
        touching: Iterable[tuple[str, str]],
        directions: Sequence[Vector],
    ) -> tuple[Doubt, ...]:
        """Return where meshes contradict rays, in the order of what is tried.

        Parameters
        ----------
        entries
            Blocked pairs; of the two readings of one block only the first is tried.
        touching
            Pairs that touch: where these do not block each other, a narrow edge may still.
        directions
            That entries refer to, each next to its opposite.
        """
        found: list[Doubt] = []
        blocked: set[tuple[str, str, int]] = set()
        for one in entries:
            if (one.by, one.part, one.direction ^ 1) not in blocked:
                way = np.asarray(directions[one.direction])
                places = (one.distance_m + share * self._inset_m for share in _BEYOND)
                if not any(self._collide(one.part, one.by, place * way) for place in places):
                    found.append(Doubt(one.part, one.by, one.direction, True))
            blocked.add((one.part, one.by, one.direction))
        for part, by in touching:
            for number, direction in enumerate(directions):
                if (part, by, number) not in blocked and self._meets(part, by, direction):
                    found.append(Doubt(part, by, number, False))
        return tuple(found)

    def _meets(self, part: str, by: str, direction: Vector) -> bool:
        """Whether a part meets another at any of some places on its way past it."""
        way = np.asarray(direction)
        moving, standing = (self._tree(name).vertices_m @ way for name in (part, by))
        end = max(float(standing.max() - moving.min()), 0.0)
        # Most of what is in the way is near.
        places = end * np.linspace(0.0, 1.0, _PLACES + 1)[1:] ** 2
        return any(self._collide(part, by, place * way) for place in places)

    def _collide(self, part: str, by: str, offset_m: NDArray[np.float64]) -> bool:
        one, other = self._tree(part), self._tree(by)
        if (one.low_m + offset_m > other.high_m).any() or (
            one.high_m + offset_m < other.low_m
        ).any():
            return False
        request, result = coal.CollisionRequest(), coal.CollisionResult()
        moved, still = coal.Transform3s(), coal.Transform3s()
        moved.setTranslation(offset_m)
        coal.collide(one.tree, moved, other.tree, still, request, result)
        return bool(result.isCollision())

    def _tree(self, name: str) -> MeshTree:
        if name not in self._trees:
            part = self._product.parts[self._product.index(name)]
            points = shrunk(part.vertices_m, part.triangles, self._inset_m)
            self._trees[name] = MeshTree(name, points, part.triangles)
        return self._trees[name]
