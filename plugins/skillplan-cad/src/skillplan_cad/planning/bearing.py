"""What bears each part once it is put in place: the table, or parts that came before it.

One arm lets go of what it has placed. So a part needs a level face beneath it, of the table or of a
part that is borne itself, and its centre of mass over that. What its fit alone would hold, a round
part in a hole or a cap on a shaft, needs a second hand, a press or a nest, which no task has.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from skillplan_cad.planning.stability import axes_across, is_over
from skillplan_cad.product import Product, Vector
from skillplan_cad.relation import Contact, Relation

Array = NDArray[np.float64]

ATTITUDES: Mapping[str, Vector] = {
    "z": (0.0, 0.0, 1.0),
    "x": (1.0, 0.0, 0.0),
    "-x": (-1.0, 0.0, 0.0),
    "y": (0.0, 1.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "-z": (0.0, 0.0, -1.0),
}
"""What may point up, in the file's frame; the first is taken where none bears more parts."""

# How far what is level may be from it, as `check` has it for gaps; and points of one height.
_TOUCH_M = 2e-4
_LEVEL = 0.999
_SAME_M = 1e-5
_FEWEST_POINTS = 3
_SHOWN = 3
_ROUND = ("cylinder", "cone", "sphere", "torus")


@dataclass(frozen=True, slots=True)
class Bearing:
    """Which parts of a product stand, one on the other, with one side up.

    Parameters
    ----------
    up
        What points up, in the product's frame.
    order
        Parts that are borne, each after those that bear it.
    on
        Of these parts what they stand on; nothing of what stands on the table alone.
    why_not
        Of all other parts why they are not borne, in words that go after a name.
    """

    up: Vector
    order: tuple[str, ...]
    on: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    why_not: Mapping[str, str] = field(default_factory=dict)


def bearing_of(product: Product, relation: Relation, up: Vector) -> Bearing:
    """Return what bears each part that a hand brings, with one side up.

    Where more stand, in one group, without the lowest parts, as where a cap hangs below what it is
    put on, those are left out.
    """
    return _Standing(product, relation, up).best()


def best_bearing(product: Product, relation: Relation) -> Bearing:
    """Return the attitude that bears the most parts; the first of those that bear as many."""
    found: Bearing | None = None
    for up in ATTITUDES.values():
        one = bearing_of(product, relation, up)
        if found is None or len(one.order) > len(found.order):
            found = one
        if not found.why_not:
            break
    assert found is not None
    return found


class _Standing:
    """A product with one side up."""

    def __init__(self, product: Product, relation: Relation, up: Vector) -> None:
        self._up, self._vector, self._plan = up, np.asarray(up), axes_across(up)
        self._product, self._relation = product, relation
        driven = relation.driven
        self._parts = {part.name: part for part in product if part.name not in driven}
        self._centres = {
            name: self._plan @ np.asarray(part.centre_m) for name, part in self._parts.items()
        }
        self._lowest = {
            name: float((part.vertices_m @ self._vector).min())
            for name, part in self._parts.items()
        }
        self._beneath: dict[str, dict[str, Array]] = {name: {} for name in self._parts}
        for contact in relation.contacts:
            for upper, lower, points in self._level(contact):
                if upper in self._parts and lower in self._parts:
                    self._beneath[upper][lower] = points

    def best(self) -> Bearing:
        """Return the largest set of parts that stand."""
        present = set(self._parts)
        best: dict[str, tuple[str, ...]] = {}
        while len(present) > len(best):
            found = self._borne(present)
            # What is left of a product without its base has to hang together.
            whole = len(present) == len(self._parts) or self._hang_together(found)
            if len(found) > len(best) and whole:
                best = found
            ground = min(self._lowest[name] for name in present)
            present = {name for name in present if self._lowest[name] > ground + _TOUCH_M}
        others = [name for name in self._parts if name not in best]
        return Bearing(self._up, tuple(best), best, {n: self._reason(n, best) for n in others})

    def _borne(self, present: Collection[str]) -> dict[str, tuple[str, ...]]:
        """Return the parts that stand among some, in order, each with what it stands on."""
        ground = min(self._lowest[name] for name in present)
        found: dict[str, tuple[str, ...]] = {}
        waiting = [name for name in self._parts if name in present]
        while True:
            for name in waiting:
                bearers = [one for one in self._beneath[name] if one in found]
                corners = [self._beneath[name][one] for one in bearers]
                if self._lowest[name] < ground + _TOUCH_M:
                    corners.append(self._foot(name))
                if corners and is_over(self._centres[name], np.concatenate(corners)):
                    found[name] = tuple(bearers)
                    waiting.remove(name)
                    break
            else:
                return found

    def _hang_together(self, names: Collection[str]) -> bool:
        """Return whether parts touch each other in one group."""
        pairs = [one.parts for one in self._relation.contacts if set(one.parts) <= set(names)]
        reached = set(list(names)[:1])
        while more := {name for pair in pairs if reached & set(pair) for name in pair} - reached:
            reached |= more
        return len(reached) == len(names)

    def _foot(self, name: str) -> Array:
        """Return the corners of the level faces on which a part stands, in plan."""
        part = self._parts[name]
        corners = part.vertices_m[part.triangles]
        heights = corners @ self._vector
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        level = normals @ self._vector < -_LEVEL * np.linalg.norm(normals, axis=1)
        for face in part.faces:
            # A chord of what is round is level, and does not keep it from rolling.
            level[face.triangles] &= face.kind not in _ROUND
        low = (heights < self._lowest[name] + _TOUCH_M).all(axis=1)
        return np.asarray(corners[level & low].reshape(-1, 3) @ self._plan.T)

    def _level(self, contact: Contact) -> Iterator[tuple[str, str, Array]]:
        """Yield which part of a contact stands on the other, and where in plan."""
        points = np.asarray(contact.points_m).reshape(-1, 3)
        if not len(points) or (
            contact.axis is not None and abs(float(self._vector @ contact.axis)) < _LEVEL
        ):
            return
        normals = np.asarray(contact.normals).reshape(-1, 3) @ self._vector
        first, second = contact.parts
        for upper, lower, there in (
            (first, second, (normals < -_LEVEL).any()),
            (second, first, (normals > _LEVEL).any()),
        ):
            if there:
                yield upper, lower, self._at_one_height(points) @ self._plan.T

    def _at_one_height(self, points: Array) -> Array:
        """Return the points of which several are as high: those on a level face."""
        heights = np.round(points @ self._vector / _SAME_M)
        _, which, counts = np.unique(heights, return_inverse=True, return_counts=True)
        level = counts[which] >= _FEWEST_POINTS
        return np.asarray(points[level] if level.any() else points)

    def _reason(self, name: str, borne: Collection[str]) -> str:
        """Return why a part is not borne."""
        beneath = list(self._beneath[name])
        there = [one for one in beneath if one in borne]
        touched = [
            other
            for contact in self._relation.contacts
            if name in contact.parts
            for other in contact.parts
            if other != name
        ]
        ground = min((self._lowest[one] for one in borne), default=-np.inf)
        below = self._lowest[name] < ground - _TOUCH_M
        if below and is_over(self._centres[name], self._foot(name)):
            return "stands lower than all others, more of which stand without it"
        if there:
            return f"would tip off {_listed(there)}: its centre of mass is beside what bears it"
        if beneath:
            return f"stands on {_listed(beneath)} alone, which nothing bears"
        if touched:
            return (
                f"has no level face beneath it: only its fit to {_listed(touched)} holds it, which "
                "takes a second hand, a press or a nest"
            )
        return "has nothing beneath it: it touches no other part"


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return " or ".join(names[:_SHOWN]) + more
