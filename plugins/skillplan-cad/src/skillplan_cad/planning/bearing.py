"""Find the supports of each placed part: the table, or parts placed before.

The arm releases a placed part, so it needs a level face below, of the table or a supported part,
with its centre of mass above. Parts held by their fit alone, such as a pin in a hole or a cap on a
shaft, need a second hand, a press or a nest, which tasks lack.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from skillplan_cad.planning.stability import find_axes_across, is_over
from skillplan_cad.product import Product, Vector
from skillplan_cad.relation import Contact, LeftOut, Relation

Array = NDArray[np.float64]

ATTITUDES: Mapping[str, Vector] = {
    "z": (0.0, 0.0, 1.0),
    "x": (1.0, 0.0, 0.0),
    "-x": (-1.0, 0.0, 0.0),
    "y": (0.0, 1.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "-z": (0.0, 0.0, -1.0),
}
"""Vectors that may point up, in the file's frame; the first wins ties."""

# Gap tolerance as in `check`, cosine of a level normal, and height tolerance of points.
_TOUCH_M = 2e-4
_LEVEL = 0.999
_SAME_M = 1e-5
_FEWEST_POINTS = 3
_SHOWN = 3
_ROUND = ("cylinder", "cone", "sphere", "torus")


@dataclass(frozen=True, slots=True)
class Bearing:
    """Supports of the parts in one orientation.

    Parameters
    ----------
    up
        Vector that points up, in the product's frame.
    order
        Supported parts, each after its supports.
    on
        Supports of these parts; empty for parts on the table alone.
    why_not
        Reasons why the other parts lack support.
    """

    up: Vector
    order: tuple[str, ...]
    on: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    why_not: Mapping[str, LeftOut] = field(default_factory=dict)


def find_bearing(product: Product, relation: Relation, up: Vector) -> Bearing:
    """Return the supports of each part that a hand brings, in one orientation.

    The lowest parts are left out if more parts then stand in one group, such as above a cap that
    hangs below its mate.
    """
    return _Standing(product, relation, up).best()


def find_best_bearing(product: Product, relation: Relation) -> Bearing:
    """Return the orientation that supports the most parts; the first wins ties."""
    best: Bearing | None = None
    for up in ATTITUDES.values():
        bearing = find_bearing(product, relation, up)
        if best is None or len(bearing.order) > len(best.order):
            best = bearing
        if not best.why_not:
            break
    assert best is not None
    return best


class _Standing:
    """A product in one orientation."""

    def __init__(self, product: Product, relation: Relation, up: Vector) -> None:
        self._up, self._vector, self._plan = up, np.asarray(up), find_axes_across(up)
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
            for upper, lower, points in self._find_level_contacts(contact):
                if upper in self._parts and lower in self._parts:
                    self._beneath[upper][lower] = points

    def best(self) -> Bearing:
        """Return the largest set of parts that stand."""
        present = set(self._parts)
        best: dict[str, tuple[str, ...]] = {}
        while len(present) > len(best):
            borne = self._find_supported(present)
            # Without its base, the rest of the product must be in one piece.
            whole = len(present) == len(self._parts) or self._is_connected(borne)
            if len(borne) > len(best) and whole:
                best = borne
            ground = min(self._lowest[name] for name in present)
            present = {name for name in present if self._lowest[name] > ground + _TOUCH_M}
        others = [name for name in self._parts if name not in best]
        return Bearing(self._up, tuple(best), best, {n: self._explain(n, best) for n in others})

    def _find_supported(self, present: Collection[str]) -> dict[str, tuple[str, ...]]:
        """Return the supported parts in order, each with its supports."""
        ground = min(self._lowest[name] for name in present)
        supports_of: dict[str, tuple[str, ...]] = {}
        waiting = [name for name in self._parts if name in present]
        while True:
            for name in waiting:
                bearers = [other for other in self._beneath[name] if other in supports_of]
                corners = [self._beneath[name][bearer] for bearer in bearers]
                if self._lowest[name] < ground + _TOUCH_M:
                    corners.append(self._find_foot(name))
                if corners and is_over(self._centres[name], np.concatenate(corners)):
                    supports_of[name] = tuple(bearers)
                    waiting.remove(name)
                    break
            else:
                return supports_of

    def _is_connected(self, names: Collection[str]) -> bool:
        """Return whether contacts connect all parts."""
        pairs = [
            contact.parts for contact in self._relation.contacts if set(contact.parts) <= set(names)
        ]
        reached = set(list(names)[:1])
        while more := {name for pair in pairs if reached & set(pair) for name in pair} - reached:
            reached |= more
        return len(reached) == len(names)

    def _find_foot(self, name: str) -> Array:
        """Return the corners of the level faces that a part stands on, in plan view."""
        part = self._parts[name]
        corners = part.vertices_m[part.triangles]
        heights = corners @ self._vector
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        level = normals @ self._vector < -_LEVEL * np.linalg.norm(normals, axis=1)
        for face in part.faces:
            # A level chord of a round face does not prevent rolling.
            level[face.triangles] &= face.kind not in _ROUND
        low = (heights < self._lowest[name] + _TOUCH_M).all(axis=1)
        return np.asarray(corners[level & low].reshape(-1, 3) @ self._plan.T)

    def _find_level_contacts(self, contact: Contact) -> Iterator[tuple[str, str, Array]]:
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
                yield upper, lower, self._select_level_points(points) @ self._plan.T

    def _select_level_points(self, points: Array) -> Array:
        """Return the points that share their height with others: those on a level face."""
        heights = np.round(points @ self._vector / _SAME_M)
        _, which, counts = np.unique(heights, return_inverse=True, return_counts=True)
        level = counts[which] >= _FEWEST_POINTS
        return np.asarray(points[level] if level.any() else points)

    def _explain(self, name: str, borne: Collection[str]) -> LeftOut:
        """Return the reason why a part lacks support."""
        beneath = list(self._beneath[name])
        there = [other for other in beneath if other in borne]
        touched = [
            other
            for contact in self._relation.contacts
            if name in contact.parts
            for other in contact.parts
            if other != name
        ]
        ground = min((self._lowest[supported] for supported in borne), default=-np.inf)
        below = self._lowest[name] < ground - _TOUCH_M
        if below and is_over(self._centres[name], self._find_foot(name)):
            words = "stands lower than all others, more of which stand without it"
            return LeftOut(name, "hangs lower", words)
        if there:
            words = (
                f"would tip off {_format_names(there)}: its centre of mass is beside what bears it"
            )
            return LeftOut(name, "tips", words, tuple(there))
        if beneath:
            words = f"stands on {_format_names(beneath)} alone, which nothing bears"
            return LeftOut(name, "follows", words, tuple(beneath))
        if touched:
            words = (
                f"has no level face beneath it: only its fit to {_format_names(touched)} holds it, "
                "which takes a second hand, a press or a nest"
            )
            return LeftOut(name, "not level", words, tuple(dict.fromkeys(touched)))
        return LeftOut(name, "floats", "has nothing beneath it: it touches no other part")


def _format_names(names: list[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return " or ".join(names[:_SHOWN]) + more
