"""Space that parts pass on their straight way into a product, which pieces of others must not fill.

Sweeps of the true meshes: the faces of a part that point ahead, extruded backwards.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import manifold3d
import numpy as np
from numpy.typing import NDArray

from skillplan_cad.product import Part, Points, Product, Triangles, make_solid
from skillplan_cad.relation import Fastener, Relation
from skillplan_cad.swept_space import list_corners, sweep_faces, unite
from skillplan_cad.writing.upright import Upright

PRESSED_GAP_M = 5e-5
"""Allowed width of a gap where jaws press [m]."""
PLAY_M = 1e-4
"""Smallest clearance that back ends play with, on each side [m]."""

LEAST_HEAD_M = 1e-4
"""Least height of a head that is flush [m]."""
MOST_HOVER_M = 5e-4
"""Greatest height over its seat from which a screw is driven home [m]."""

Floats = NDArray[np.float64]
# Corners of convex spaces that open jaws take, and of those between them and the part [m].
JawSpaces = tuple[Sequence[Points], Sequence[Points]]
# Spaces and their thicknesses in concave parts [mm] by a part, another one, the way in which it
# comes, its clearance [m], and if it is driven.
Sweeps = dict[tuple[Part, Part, bytes, float, bool], tuple[manifold3d.Manifold, float]]

_TO_MM = 1e3
# Share of a clearance that pieces may fill, and the widest clearance that is kept free [m].
_CLEARANCE_SHARE, _WIDEST_M = 0.2, 3e-4
_ROUNDED_M = 1e-9
# Thickness above which a gap may be a recess of a wall [mm]. It is in the way of a part if it
# reaches through the widest clearance, or farther through a narrow one: such a part gets play.
_RECESS_MM, _FURTHER = 0.3, 2.5
# Difference of sizes of lanes that are one, as a share, and of places of their jaws.
_SAME_SIZE, _SAME_PLACE_MM = 1e-4, 1e-3
_LEAST_MM, _LEAST_MM3 = 1e-3, 1e-3
# Thickness of bodies, and size of details, that lanes do without.
_FILM_MM = 1e-3
# Number of triangles up to which a mesh is swept, and the tolerances to which others are simplified
# [mm]; their hull is swept if that does not suffice.
_MANY_FACES, _TOLERANCES_MM = 6000, (0.01, 0.05, 0.2)


@dataclass(frozen=True, slots=True, eq=False)
class Lane:
    """Space in the concave parts of a solid that other parts pass or fill, with their clearance.

    Parameters
    ----------
    solid
        The space, in the frame of the solid [mm].
    clearance_m
        Greatest clearance that is part of it [m].
    allowed_m
        Allowed width of a gap in it [m].
    jaws
        Space of open jaws in the concave parts, in the frame of the solid [mm].
    narrower
        Space of the parts with smaller clearances, in the whole solid.
    pressed
        Space between open jaws and the faces that they press, in the concave parts [mm].
    """

    solid: manifold3d.Manifold
    clearance_m: float
    allowed_m: float
    jaws: manifold3d.Manifold
    narrower: Lane | None = None
    pressed: manifold3d.Manifold = field(default_factory=manifold3d.Manifold)

    def crop(self, hull: manifold3d.Manifold) -> Lane:
        """Return the part of the space in a hull."""
        solid, jaws, pressed = (own ^ hull for own in (self.solid, self.jaws, self.pressed))
        # Solids that are made when they are asked for would keep all that they are cut from.
        solid.num_tri(), jaws.num_tri(), pressed.num_tri()
        return replace(self, solid=solid, jaws=jaws, pressed=pressed)

    def frees_jaws(self, hulls: Iterable[Points]) -> bool:
        """Return whether convex pieces, given by their corners [m], leave room for the jaws."""
        spaces = [(self.jaws, self.allowed_m), (self.pressed, PRESSED_GAP_M)]
        spaces = [(space, width_m) for space, width_m in spaces if not space.is_empty()]
        return not spaces or all(
            2 * measure_thickness(hull ^ space) <= width_m * _TO_MM
            for hull in (manifold3d.Manifold.hull_points(points * _TO_MM) for points in hulls)
            for space, width_m in spaces
        )

    def measure_reach_mm(
        self, gap: manifold3d.Manifold, bodies: Sequence[manifold3d.Manifold] | None = None
    ) -> float:
        """Return the depth to which a gap of a piece is in the way of a part [mm].

        Parameters
        ----------
        bodies
            Bodies of the space in the gap, if they are known.
        """
        # A gap between the faces of a curved wall is a wedge.
        bodies = (gap ^ self.solid).decompose() if bodies is None else bodies
        reach_mm = 2 * max(map(measure_thickness, bodies), default=0.0)
        is_recess = measure_thickness(gap) > _RECESS_MM
        is_wide = self.clearance_m > (1 - _CLEARANCE_SHARE) * _WIDEST_M - _ROUNDED_M
        share = 1.0 if is_wide else _FURTHER
        if not is_recess or reach_mm >= share * self.clearance_m * _TO_MM:
            return reach_mm
        return 0.0 if self.narrower is None else self.narrower.measure_reach_mm(gap)

    def is_like(self, other: Lane | None) -> bool:
        """Return whether another space has the same size, place and clearance, and so its jaws."""
        if other is None:
            return False
        own, its = self.solid, other.solid
        is_as_large = math.isclose(own.volume(), its.volume(), rel_tol=_SAME_SIZE) and math.isclose(
            own.surface_area(), its.surface_area(), rel_tol=_SAME_SIZE
        )
        here, there = (
            np.ravel([own.bounding_box() for own in (lane.solid, lane.jaws, lane.pressed)])
            for lane in (self, other)
        )
        is_there = bool(np.allclose(here, there, atol=_SAME_PLACE_MM))
        return is_as_large and is_there and math.isclose(self.clearance_m, other.clearance_m)


def measure_thickness(solid: manifold3d.Manifold) -> float:
    """Return the ratio of volume and half the surface, at most the thickness of a sheet [mm]."""
    surface_mm2 = float(solid.surface_area())
    # Slivers that a cut leaves may have a volume of 0 and no surface.
    return 2 * float(solid.volume()) / surface_mm2 if surface_mm2 > 0 else 0.0


def measure_depth_mm(solid: manifold3d.Manifold) -> float:
    """Return the greatest depth of the bodies of a solid in the way of a part [mm]."""
    # A gap between the faces of a curved wall is a wedge.
    return 2 * max(map(measure_thickness, solid.decompose()), default=0.0)


def assign_bodies(
    space: manifold3d.Manifold, gaps: Sequence[manifold3d.Manifold]
) -> list[list[manifold3d.Manifold]]:
    """Return the bodies of a space in each of the gaps that contain it.

    A body that only one of the boxes around gaps contains is not cut by others.
    """
    lists: list[list[manifold3d.Manifold]] = [[] for _ in gaps]
    boxes_mm = np.array([gap.bounding_box() for gap in gaps]).reshape(-1, 2, 3)
    for body in space.decompose():
        low_mm, high_mm = np.reshape(body.bounding_box(), (2, 3))
        contains = (boxes_mm[:, 0] < low_mm + _SAME_PLACE_MM) & (
            boxes_mm[:, 1] > high_mm - _SAME_PLACE_MM
        )
        around = np.flatnonzero(contains.all(axis=1)).tolist()
        if len(around) == 1:
            lists[around[0]].append(body)
            continue
        meets = (boxes_mm[:, 0] < high_mm) & (boxes_mm[:, 1] > low_mm)
        for number in np.flatnonzero(meets.all(axis=1)).tolist():
            lists[number] += (gaps[number] ^ body).decompose()
    return lists


class Lanes:
    """Finds the space of other parts in the concave parts of each.

    Parameters
    ----------
    list_moves
        Returns the other parts in the order with their moves past a part in its pose.
    drawn_m
        Clearances as drawn, by the names of both parts [m].
    waists_m
        Depths of press fits, by the names of the part that they leave thinner and the other [m].
    sweeps
        Spaces that were found before, also with other orders and products.
    """

    def __init__(
        self,
        product: Product,
        relation: Relation,
        upright: Upright,
        list_moves: Callable[[str], list[tuple[str, Floats]]],
        drawn_m: Mapping[frozenset[str], float],
        waists_m: Mapping[tuple[str, str], float],
        sweeps: Sweeps,
    ) -> None:
        self._product, self._relation, self._upright = product, relation, upright
        self._sweeps = sweeps
        self._list_part_moves, self._drawn_m = list_moves, drawn_m
        self._waists_m = waists_m
        self._corners: dict[str, tuple[Points, bool]] = {}
        self._threads = {
            frozenset((fastener.part, mate))
            for fastener in relation.fasteners
            if fastener.kind != "screw"
            for mate in fastener.threaded_in
        }

    def find(
        self, part: Part, vertices_m: Points, triangles: Triangles, jaws: JawSpaces = ((), ())
    ) -> Lane | None:
        """Return the space of other parts, or None if a mesh leaves them free as its hull.

        Parameters
        ----------
        vertices_m
            Upright, relative to the centre of the part's bottom [m].
        jaws
            In the same frame.
        """
        solid = make_solid(vertices_m, triangles)
        concave = solid.hull() - solid
        if concave.volume() < _LEAST_MM3:
            return None
        rooms = np.array([body.bounding_box() for body in concave.decompose()]).reshape(-1, 2, 3)
        sweeps: dict[float, list[manifold3d.Manifold]] = {}
        for other, along in self._list_moves(part.name):
            pair = frozenset((part.name, other.name))
            drawn_m = self._drawn_m.get(pair, 0.0)
            clearance_m = (1 - _CLEARANCE_SHARE) * min(max(drawn_m, PLAY_M), _WIDEST_M)
            sweep, thickness_mm = self._sweep(part, other, along, clearance_m, concave, rooms)
            # The waist that a press fit leaves is none: all of the part has to pass.
            if thickness_mm > self._waists_m.get((part.name, other.name), 0.0) * _TO_MM:
                sweeps.setdefault(clearance_m, []).append(sweep)
        room = rooms[:, 0].min(axis=0), rooms[:, 1].max(axis=0)
        near = [
            [
                manifold3d.Manifold.hull_points(box * _TO_MM)
                for box in boxes
                if (box.min(axis=0) * _TO_MM < room[1]).all()
                and (box.max(axis=0) * _TO_MM > room[0]).all()
            ]
            for boxes in jaws
        ]
        # Engines let jaws pass where the mesh does.
        held, pressed = (_simplify(unite(spaces) ^ concave) for spaces in near)
        allowed_m = _CLEARANCE_SHARE * PLAY_M
        lane = Lane(manifold3d.Manifold(), 0.0, allowed_m, held, pressed=pressed)
        for clearance_m in sorted(sweeps):
            space = _simplify(unite([lane.solid, *sweeps[clearance_m]]) ^ concave)
            narrower = None if lane.solid.is_empty() else lane
            lane = replace(lane, solid=space, clearance_m=clearance_m, narrower=narrower)
        volume_mm3 = lane.solid.volume() + held.volume() + pressed.volume()
        return None if volume_mm3 < _LEAST_MM3 else lane

    def _sweep(
        self,
        part: Part,
        other: Part,
        along: Floats,
        clearance_m: float,
        concave: manifold3d.Manifold,
        rooms: Floats,
    ) -> tuple[manifold3d.Manifold, float]:
        """Return the space that another part passes, and its thickness in concave parts [mm].

        It is found once for parts that stand and come alike.
        """
        own, is_driven = self._upright.of(part.name), other.name in self._relation.driven
        place = np.round([*concave.bounding_box(), concave.volume()], 4)
        way = np.concatenate([place, np.round(along, 9), own.matrix.ravel()]).tobytes()
        key = part, other, way, clearance_m, is_driven
        if key not in self._sweeps:
            shift = (own.offset_m - np.array(own.bottom(part))) * _TO_MM
            corners, is_convex = self._list_corners(other)
            moved = corners @ own.matrix.T + shift
            swept = sweep_faces(moved, along, clearance_m * _TO_MM, rooms, is_convex=is_convex)
            sweep = unite(swept).simplify(_FILM_MM).as_original()
            met = sweep ^ concave
            if met.volume() < _LEAST_MM3:
                sweep = met = manifold3d.Manifold()
            self._sweeps[key] = sweep, measure_thickness(met)
        return self._sweeps[key]

    def _list_moves(self, name: str) -> Iterator[tuple[Part, Floats]]:
        """Yield the parts and screws that come along a part, with their move in its pose."""
        own = self._upright.of(name)
        moves = self._list_part_moves(name)
        for fastener in self._relation.fasteners:
            if fastener.part in self._relation.driven - {name}:
                moves.append((fastener.part, -np.asarray(own.vector(fastener.axis))))
        for other, along in moves:
            if frozenset((name, other)) not in self._threads:
                yield self._product.part(other), along

    def _list_corners(self, part: Part) -> tuple[Points, bool]:
        """Return the corners of a part's triangles, in the product's frame [mm]; and if convex.

        A screw has only its head, as in engines.
        """
        if part.name in self._corners:
            return self._corners[part.name]
        fastener = self._relation.fastener(part.name)
        if fastener is not None and part.name in self._relation.driven:
            solid = _build_head(part, fastener)
        else:
            solid = make_solid(part.vertices_m, part.triangles)
        for tolerance_mm in _TOLERANCES_MM:
            if solid.num_tri() > _MANY_FACES:
                solid = solid.simplify(tolerance_mm)
        hull = solid.hull()
        is_convex = solid.num_tri() > _MANY_FACES or hull.volume() - solid.volume() < _LEAST_MM3
        self._corners[part.name] = list_corners(hull if is_convex else solid), is_convex
        return self._corners[part.name]


def _build_head(part: Part, fastener: Fastener) -> manifold3d.Manifold:
    """Return the head of a screw, driven home, as high all over as at its top [mm]."""
    axis, radii_m = np.asarray(fastener.axis), fastener.list_radii_m(part.vertices_m)
    # A screw without a head is as wide as its shank.
    ring_m = (min(fastener.diameter_m / 2, radii_m.max()) + radii_m.max()) / 2
    rim = part.vertices_m[radii_m >= ring_m]
    heights_m, top_m = rim @ axis, float((part.vertices_m @ axis).max())
    low_m = min(float(heights_m.min()), top_m - LEAST_HEAD_M) - MOST_HOVER_M
    ends = [rim + np.outer(end_m - heights_m, axis) for end_m in (low_m, top_m)]
    return manifold3d.Manifold.hull_points(np.concatenate(ends) * _TO_MM)


def _simplify(solid: manifold3d.Manifold) -> manifold3d.Manifold:
    """Return a solid without bodies and details that are thinner than a film.

    It forgets the solids that it was made of: each result of it would have a table of them all.
    """
    bodies = [body for body in solid.decompose() if measure_thickness(body) > _FILM_MM]
    return manifold3d.Manifold.compose(bodies).simplify(_FILM_MM).as_original()
