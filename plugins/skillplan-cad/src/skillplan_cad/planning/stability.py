"""Find the parts that must be held: contact forces against weights.

A part is stable if contact forces within friction balance its weight. A linear program searches
them and allows priced help for each part; a part that needs help must be held. A product on the
table also needs its centre of mass above its support.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from skillplan.collision.contact_forces import FRICTION, find_axes_across, minimize_help
from skillplan_cad.planning.precedence import list_members
from skillplan_cad.product import GRAVITY_M_PER_S2, Product, Vector
from skillplan_cad.relation import Contact, Relation

Array = NDArray[np.float64]
_MOST_POINTS = 8
_GROUND_M = 5e-4  # height above the lowest point that still touches the ground
_TIPPING_M = 1e-4
_HELD_SHARE = 0.02  # share of the weight below which help is ignored


class Stability:
    """Decides which parts are stable, for any set of present parts."""

    def __init__(self, product: Product, relation: Relation) -> None:
        self._masses = np.array([part.mass_kg for part in product])
        self._centres = np.array([part.centre_m for part in product])
        self._product = product
        joined = {
            (fastener.part, second)
            for fastener in relation.fasteners
            for second in fastener.threaded_in
        }
        self._contacts: dict[tuple[int, int], list[tuple[Array, Array]]] = {}
        for contact in relation.contacts:
            first, second = (product.index(name) for name in contact.parts)
            pair = (contact.parts, contact.parts[::-1])
            firm = contact.kind == "thread" or any(names in joined for names in pair)
            forces = _list_forces(contact, firm)
            if forces:
                self._contacts.setdefault((first, second), []).extend(forces)
        self._touched: dict[int, int] = {}
        for first, second in self._contacts:
            self._touched[first] = self._touched.get(first, 0) | 1 << second
            self._touched[second] = self._touched.get(second, 0) | 1 << first
        self._known: dict[tuple[int, int, Vector], bool] = {}
        self._tipping: dict[tuple[int, Vector], bool] = {}
        self._feet: dict[tuple[int, Vector], tuple[float, Array]] = {}
        self._grounds: dict[tuple[tuple[int, ...], Vector], Array | None] = {}
        # Effect of each contact force on each part: force, then torque.
        self._wrenches = {
            pair: [
                [self._compute_wrench(part, sign, *force) for force in forces]
                for part, sign in zip(pair, (1.0, -1.0), strict=True)
            ]
            for pair, forces in self._contacts.items()
        }

    def stays(self, part: int, others: int, up: Vector) -> bool:
        """Return whether a part is stable on others that are held firm."""
        touching = others & self._touched.get(part, 0)
        key = (part, touching, up)
        if key not in self._known:
            self._known[key] = not self._find_held([part], touching, up)
        return self._known[key]

    def must_be_held(self, present: int, base: int, up: Vector) -> tuple[int, ...]:
        """Return the parts of a set that do not stay by themselves; the base stands firm."""
        loose = [part for part in list_members(present) if part != base]
        return self._find_held(loose, 1 << base, up)

    def tips(self, present: int, up: Vector) -> bool:
        """Return whether the centre of mass of a set lies outside its support."""
        key = (present, up)
        if key not in self._tipping:
            self._tipping[key] = self._compute_tips(present, up)
        return self._tipping[key]

    def _compute_tips(self, present: int, up: Vector) -> bool:
        numbers = list(list_members(present))
        masses = self._masses[numbers]
        centre = (self._centres[numbers] * masses[:, None]).sum(axis=0) / masses.sum()
        heights = [self._find_foot(part, up)[0] for part in numbers]
        lowest = min(heights)
        pairs = zip(numbers, heights, strict=True)
        ground = self._find_ground(
            tuple(n for n, height in pairs if height < lowest + _GROUND_M), up
        )
        if ground is None:
            return True
        return not _is_within(find_axes_across(up) @ centre, ground)

    def _find_ground(self, parts: tuple[int, ...], up: Vector) -> Array | None:
        """Return the hull lines of the support, as in `ConvexHull`, or None."""
        key = (parts, up)
        if key not in self._grounds:
            points = np.concatenate([self._find_foot(part, up)[1] for part in parts])
            self._grounds[key] = _find_outline(points @ find_axes_across(up).T)
        return self._grounds[key]

    def _find_foot(self, part: int, up: Vector) -> tuple[float, Array]:
        """Return the lowest height of a part, and its points there."""
        key = (part, up)
        if key not in self._feet:
            points = self._product.parts[part].vertices_m
            heights = points @ np.asarray(up)
            low = float(heights.min())
            self._feet[key] = (low, points[heights < low + _GROUND_M])
        return self._feet[key]

    def _find_held(self, loose: Sequence[int], firm: int, up: Vector) -> tuple[int, ...]:
        """Return the loose parts that no contact forces hold against their weights."""
        rows = {part: 6 * number for number, part in enumerate(loose)}
        columns = self._build_columns(rows, firm)
        if not columns:
            return tuple(loose)
        # Help for each part: force and torque in both directions, priced by weight.
        weights = self._masses[list(loose)] * GRAVITY_M_PER_S2
        reach = np.array([np.ptp(self._product.parts[p].vertices_m, axis=0).max() for p in loose])
        scale = np.repeat(weights, 6) * np.tile([1.0] * 3 + [0.0] * 3, len(loose))
        scale += np.repeat(weights * reach, 6) * np.tile([0.0] * 3 + [1.0] * 3, len(loose))
        loads = np.zeros(6 * len(loose))
        for number in range(len(loose)):
            loads[6 * number : 6 * number + 3] = weights[number] * np.asarray(up)
        help_values = minimize_help(columns, loads, scale)
        if help_values is None:
            return tuple(loose)
        help_at = help_values.reshape(len(loose), 6).sum(axis=1)
        return tuple(part for part, need in zip(loose, help_at, strict=True) if need > _HELD_SHARE)

    def _build_columns(self, rows: Mapping[int, int], firm: int) -> list[list[tuple[int, float]]]:
        """Return the column of each contact force: rows of forces and torques on parts."""
        columns = []
        for (first, second), forces in self._contacts.items():
            sides = [(part, sign) for part, sign in ((first, 1.0), (second, -1.0)) if part in rows]
            whole = all(part in rows or firm >> part & 1 for part in (first, second))
            if not sides or not whole:
                continue
            wrenches = self._wrenches[first, second]
            for number in range(len(forces)):
                entries = []
                for part, sign in sides:
                    wrench = wrenches[0 if sign > 0 else 1][number]
                    entries += [(rows[part] + k, wrench[k]) for k in range(6)]
                columns.append(entries)
        return columns

    def _compute_wrench(self, part: int, sign: float, point: Array, force: Array) -> list[float]:
        """Return the force on a part and the torque about its centre of mass."""
        x, y, z = (point - self._centres[part]).tolist()
        a, b, c = force.tolist()
        torque = (y * c - z * b, z * a - x * c, x * b - y * a)
        return [sign * value for value in (a, b, c, *torque)]


def _list_forces(contact: Contact, firm: bool) -> list[tuple[Array, Array]]:
    """Return (point, force on the first part) pairs that span the forces of a contact."""
    points = _select_spread(np.array(contact.points_m).reshape(-1, 3))
    if firm and not len(points) and contact.axis_point_m is not None:
        # A thread drawn as an overlap has no contact surface.
        points = np.array([contact.axis_point_m])
    if not len(points):
        return []
    if firm:
        axes = np.concatenate([np.eye(3), -np.eye(3)])
        points = np.concatenate([points[:1] + 1e-3 * np.vstack([axes, np.zeros(3)]), points])
        return [(point, axis) for point in points for axis in axes]
    forces = []
    for point in points:
        for normal in _list_normals(contact, point):
            across = find_axes_across((float(normal[0]), float(normal[1]), float(normal[2])))
            # The second part pushes the first one back, against its outward normal.
            for sideways in (across[0], -across[0], across[1], -across[1]):
                forces.append((point, -normal + FRICTION * sideways))
    return forces


def _list_normals(contact: Contact, point: Array) -> list[Array]:
    """Return the outward normals of a contact's first part at a point."""
    listed = [np.asarray(normal) for normal in contact.normals]
    if contact.kind != "cylinder" or contact.axis is None or contact.axis_point_m is None:
        return listed
    axis = np.asarray(contact.axis)
    offset = point - np.asarray(contact.axis_point_m)
    radial = offset - (offset @ axis) * axis
    length = np.linalg.norm(radial)
    if length < 1e-9:
        return listed
    radial = radial / length
    nearest = max(listed, key=lambda normal: abs(float(normal @ radial)), default=radial)
    return [radial if float(nearest @ radial) > 0 else -radial]


def _select_spread(points: Array) -> Array:
    """Return a few points far from each other."""
    if len(points) <= _MOST_POINTS:
        return points
    chosen = [int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    distances = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < _MOST_POINTS:
        chosen.append(int(np.argmax(distances)))
        distances = np.minimum(distances, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return points[sorted(set(chosen))]


def _find_outline(corners: Array) -> Array | None:
    """Return the hull lines of points in the plane; None without area."""
    if len(corners) < 3:
        return None
    try:
        return np.asarray(ConvexHull(corners).equations)
    except QhullError:
        return None


def is_over(point: Array, corners: Array, margin_m: float = -_TIPPING_M) -> bool:
    """Return whether a point of the plane lies in the hull of others.

    Parameters
    ----------
    margin_m
        Distance that it keeps from the edge of the hull [m].
    """
    outline = _find_outline(corners)
    return outline is not None and _is_within(point, outline, margin_m)


def _is_within(point: Array, outline: Array, margin_m: float = -_TIPPING_M) -> bool:
    return bool((outline[:, :2] @ point + outline[:, 2] <= -margin_m).all())
