"""Play and chamfers at the fits of parts, for back ends whose hands are not exact to a micrometre.

A part that goes in beside another gets smaller pieces: their sides that pass the other keep a
distance from its mesh, and the edges that lead are chamfered. Real shafts and holes have chamfers,
which CAD often leaves out. Either part of a fit may come last, so both have chamfers.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import manifold3d
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from skillplan.task.pose import DOWN
from skillplan_cad.joints.cylinder_fits import CylinderFit
from skillplan_cad.planning.assembly_plan import AssemblyPlan
from skillplan_cad.planning.precedence import encode_set
from skillplan_cad.product import Part, Points, Product, Vector, make_solid
from skillplan_cad.relation import Relation
from skillplan_cad.writing.convex_pieces import Mesh, Pieces, build_mesh
from skillplan_cad.writing.lanes import PLAY_M
from skillplan_cad.writing.upright import Upright

CHAMFER_M = 5e-4
"""Chamfer of the edges that lead into a fit [m]."""

Floats = NDArray[np.float64]
_TO_MM = 1e3
# Clearance below which parts are a fit [m].
_REACH_M = 3e-4
# Depth below a side up to which an overlap of meshes is seen, and that of surfaces that rest on
# each other [mm].
_BELOW_MM, _FILM_MM = 0.3, 0.05
# Largest cosine between a side's normal and a move along it; smaller overlaps are rounding [mm3],
# as shorter edges are [mm].
_SIDEWAYS, _LEAST_MM3, _LEAST_MM = 0.1, 1e-3, 1e-3
# Smallest downward component of an underside's normal.
_STEEP = 0.5
# Distance of pieces that touch, and of planes that are one [mm].
_NEXT_MM = 1e-3
# Share by which a side shrinks towards its middle.
_INWARD = 0.02
# Largest share of a piece that a chamfer takes; least share of a thin piece with others behind it.
_SHARE, _BACKED = 0.25, 0.5
# Shares of chamfers to try, and least share of its seat that they leave a piece.
_CHAMFER_SHARES, _SEATED = (1.0, 0.5, 0.25), 0.2
_DECIMALS = 6
# Difference between components of directions that are one, and height of a level direction.
_SAME = _LEVEL = 1e-6


@dataclass(frozen=True, slots=True)
class Played:
    """A fit that back ends play with more room than is drawn.

    Parameters
    ----------
    part, into
        Names of the part that goes in, and of the one that it passes.
    drawn_m
        Clearance of the drawing, on each side [m]; negative for a press fit.
    play_m
        Clearance that the pieces leave [m].
    outside_m
        Greatest depth to which the pieces of both are in the way of parts [m].
    """

    part: str
    into: str
    drawn_m: float
    play_m: float
    outside_m: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Loosened:
    """Pieces of a part with play and chamfers, and the fits that need them."""

    pieces: tuple[Pieces, ...]
    fits: tuple[Played, ...]


# Pieces without and with play by their part, its attitude, its move, and the parts that it passes.
LoosenedBefore = dict[tuple[object, ...], tuple[Sequence[Pieces], Loosened]]


def list_free_directions(
    relation: Relation, upright: Upright, name: str, before: Sequence[str]
) -> list[tuple[Vector, int]]:
    """Return the directions, none upwards, in which a part can come beside those before it.

    Each comes with the parts that block it, as bits.
    """
    there = encode_set([relation.index(other) for other in before])
    directions = []
    for number, blockers in relation.blocker_sets[relation.index(name)]:
        x, y, z = relation.directions[number]
        vector = upright.of(name).vector((-x, -y, -z))
        if vector[2] < _LEVEL and not blockers & there:
            directions.append((vector, blockers))
    return directions


def choose_direction(possible: Sequence[Vector], planned: Vector) -> Vector:
    """Return the direction in which a part is brought: down, or as planned, or the steepest."""
    for preferred in (DOWN, planned):
        for vector in possible:
            if np.allclose(vector, preferred, atol=_SAME):
                return vector
    return min(possible, key=lambda vector: vector[2], default=DOWN)


class FitPlay:
    """Gives parts play beside other parts.

    Parameters
    ----------
    product
        Parts without interference: press fits touch.
    relation
        Its contacts have the clearances as drawn.
    fits
        Cylinders in holes of the product.
    made
        Pieces that were loosened before, also with other orders and orientations.
    """

    def __init__(
        self,
        product: Product,
        relation: Relation,
        plan: AssemblyPlan,
        upright: Upright,
        fits: Sequence[CylinderFit],
        made: LoosenedBefore,
    ) -> None:
        self._product, self._relation, self._plan = product, relation, plan
        self._made = made
        self._upright = upright
        self._touched: dict[str, list[str]] = {}
        for contact in relation.contacts:
            for name, other in (contact.parts, contact.parts[::-1]):
                self._touched.setdefault(name, []).append(other)
        self._solids: dict[tuple[str, Upright], manifold3d.Manifold] = {}
        drawn = [
            (product.parts[fit.inner].name, product.parts[fit.outer].name, fit.radius_difference_m)
            for fit in fits
        ]
        drawn += [
            (*contact.parts, contact.radius_difference_m)
            for contact in relation.contacts
            if contact.radius_difference_m is not None
        ]
        fitted = [
            (frozenset(contact.parts), contact.fit)
            for contact in relation.contacts
            if contact.fit is not None and contact.kind != "thread"
        ]
        # Depths of drawn overlaps, by the names of both parts [m].
        self._overlaps_m = {pair: fit.depth_m for pair, fit in fitted}
        # Clearances as drawn, by the names of both parts [m].
        self.drawn_m: dict[frozenset[str], float] = {}
        for first, second, clearance_m in drawn:
            pair = frozenset((first, second))
            self.drawn_m[pair] = min(clearance_m, self.drawn_m.get(pair, clearance_m))
        # Depths of the waists that press fits leave, by the names of the part that has it, which is
        # a shaft or the smaller one, and the other.
        self.waists_m: dict[tuple[str, str], float] = {}
        shafts = {frozenset((inner, outer)): inner for inner, outer, _ in drawn[: len(fits)]}
        for pair, fit in fitted:
            if fit.kind not in ("sunk", "pins in solid"):
                smaller = min(sorted(pair), key=lambda name: self._product.part(name).volume_m3)
                thinner = shafts.get(pair, smaller)
                (other,) = pair - {thinner}
                self.waists_m[thinner, other] = fit.depth_m
        self.follow(())

    def follow(self, order: Sequence[str]) -> None:
        """Take an order of the task; parts that are not in it follow in that of the plan."""
        relation, upright, plan = self._relation, self._upright, self._plan
        self._along = {
            name: upright.of(name).vector(step.along) for step in plan.steps for name in step.parts
        }
        self._order = order
        in_order = list(dict.fromkeys((*order, plan.base, *self._along)))
        self._before = {name: in_order[:number] for number, name in enumerate(in_order)}
        # Parts that come later in this order, but may be in place before.
        self._after: dict[str, list[str]] = {}
        for number, name in enumerate(in_order):
            if name not in order:
                continue
            free = list_free_directions(relation, upright, name, self._before[name])
            planned = self._along.get(name, DOWN)
            along = choose_direction([vector for vector, _ in free], planned)
            self._along[name] = along
            blockers = next((bits for vector, bits in free if vector == along), -1)
            self._after[name] = [
                other
                for other in in_order[number + 1 :]
                # Parts of a group are not in the relation of the product that has it as one part.
                if other in relation.names and not blockers & encode_set([relation.index(other)])
            ]

    def describe(self, name: str) -> dict[str, tuple[bool, Vector | None]]:
        """Return the directions of a part and of those that it touches, and which come before it.

        Only parts of the order are among these.
        """
        before, there = {*self._before.get(name, ())}, {*self._order}
        touched = {name, *(other for other in self._touched.get(name, ()) if other in there)}
        return {other: (other in before, self._along.get(other)) for other in touched}

    def list_moves(self, name: str) -> list[tuple[str, Floats]]:
        """Return the other parts in the order of the task with their move past a part in its pose.

        Those before it come against its own move.
        """
        own, before = self._upright.of(name), self._before.get(name, ())
        moves = []
        for other in self._order:
            if other != name:
                mover = name if other in before else other
                turn = own.matrix @ self._upright.of(mover).matrix.T
                along = turn @ np.asarray(self._along.get(mover, DOWN))
                moves.append((other, -along if mover == name else along))
        return moves

    def loosen(self, part: Part, meshes: Sequence[Pieces]) -> Loosened:
        """Return the pieces of a part with play beside earlier parts.

        Later parts have the play themselves, on the sides that face this part.
        """
        along = np.asarray(self._along.get(part.name, DOWN))
        own = self._upright.of(part.name)
        corners = np.concatenate([points for pieces in meshes for points, _ in pieces]) * _TO_MM
        box = corners.min(axis=0), corners.max(axis=0)
        near = [
            (self._product.part(other), others_along, self._measure_pair_m(part.name, other))
            for other, others_along in self._find_near(part, *box, along)
        ]
        there = tuple(
            (other, None if others_along is None else others_along.tobytes(), depths_m)
            for other, others_along, depths_m in near
        )
        key = part, own.matrix.tobytes(), along.tobytes(), tuple(map(id, meshes)), there
        if key not in self._made:
            # With the pieces, so that no others get their ids.
            self._made[key] = meshes, self._loosen(part, meshes, along, near)
        return self._made[key][1]

    def _loosen(
        self,
        part: Part,
        meshes: Sequence[Pieces],
        along: Floats,
        near: Sequence[tuple[Part, Floats | None, tuple[float | None, float]]],
    ) -> Loosened:
        """Compute the pieces for `loosen`.

        Parameters
        ----------
        near
            Parts near it with the direction in which a later one comes, the clearance as drawn, if
            any, and the depth of the drawn overlap [m].
        """
        own = self._upright.of(part.name)
        shift = -np.array(own.bottom(part)) * _TO_MM
        hulls = [[_Hull(points) for points, _ in pieces] for pieces in meshes]
        everything = [hull for mesh in hulls for hull in mesh]
        fits = []
        for other, others_along, (drawn_m, overlap_m) in near:
            solid = self._solid(other.name, own).translate(tuple(shift.tolist()))
            passing = _list_passing(everything, solid, along)
            cropped = _crop_to_ways(solid, passing) if passing else solid
            gaps_mm = [
                gap
                for hull, back in passing
                for gap in hull.face(cropped, along, back, others_along)
            ]
            if gaps_mm:
                if drawn_m is None:
                    # Pieces may reach into the other part where meshes do not.
                    drawn_m = max(-overlap_m, min(gaps_mm) / _TO_MM)
                drawn_m = round(drawn_m, _DECIMALS) + 0.0
                fits.append(Played(part.name, other.name, drawn_m, max(drawn_m, PLAY_M)))
        _continue_sides(everything, along)
        pieces = tuple(
            tuple(_cut_pieces(mesh_hulls, own_pieces, along))
            for mesh_hulls, own_pieces in zip(hulls, meshes, strict=True)
        )
        return Loosened(pieces, tuple(fits))

    def _measure_pair_m(self, name: str, other: str) -> tuple[float | None, float]:
        """Return the clearance as drawn, if any, and the depth of the drawn overlap [m]."""
        pair = frozenset((name, other))
        return self.drawn_m.get(pair), self._overlaps_m.get(pair, 0.0)

    def _solid(self, name: str, upright: Upright) -> manifold3d.Manifold:
        """Return a part in the world, in a pose of the product."""
        key = (name, upright)
        if key not in self._solids:
            part = self._product.part(name)
            self._solids[key] = make_solid(upright.vertices(part), part.triangles)
        return self._solids[key]

    def _find_near(
        self, part: Part, low: Floats, high: Floats, along: Floats
    ) -> Iterator[tuple[str, Floats | None]]:
        """Yield the parts whose boxes a part passes within the clearance of a fit.

        A later part comes with its direction, as it has the play itself; an earlier one with None.
        """
        sideways = np.abs(along) < 1 - 1e-6
        own = self._upright.of(part.name)
        bottom = np.array(own.bottom(part))
        before = [(name, None) for name in self._before.get(part.name, ())]
        after = [
            (name, np.asarray(self._along.get(name, DOWN)))
            for name in self._after.get(part.name, ())
        ]
        for name, others_along in (*before, *after):
            box = np.array(self._solid(name, own).bounding_box()).reshape(2, 3) - bottom * _TO_MM
            room = _REACH_M * _TO_MM
            apart = (box[0] > high + room) | (low > box[1] + room)
            if not (apart & sideways).any() and not self._solid(name, own).is_empty():
                yield name, others_along


def _continue_sides(hulls: Sequence[_Hull], along: Floats) -> None:
    """Note the sides that continue a noted one on the next piece, as at the corners of a pocket.

    Within its play another part comes in front of them.
    """
    lows, highs = np.array([hull.low for hull in hulls]), np.array([hull.high for hull in hulls])
    noted = [(hull, dict(hull.sides)) for hull in hulls if hull.sides]
    for hull, sides in noted:
        next_to = (lows < hull.high + _NEXT_MM).all(axis=1)
        next_to &= (highs > hull.low - _NEXT_MM).all(axis=1)
        for number in np.flatnonzero(next_to).tolist():
            if hulls[number] is not hull:
                hulls[number].note_like(sides, along)


def _cut_pieces(hulls: Sequence[_Hull], pieces: Pieces, along: Floats) -> Iterator[Mesh]:
    """Yield the pieces of a mesh with play.

    A piece thinner than its play goes if others that stay lie behind it. Otherwise the part would
    have a gap.
    """
    cut = [hull.cut(along) if hull.sides else own for hull, own in zip(hulls, pieces, strict=True)]
    # Thin pieces cannot hold each other.
    kept = [hull for hull, piece in zip(hulls, cut, strict=True) if piece is not None]
    for hull, own, piece in zip(hulls, pieces, cut, strict=True):
        if piece is not None:
            yield piece
        elif not hull.is_backed(kept):
            yield own


def _list_passing(
    hulls: Sequence[_Hull], other: manifold3d.Manifold, along: Floats
) -> list[tuple[_Hull, Floats]]:
    """Return the pieces whose boxes pass that of another part, with their way back past it."""
    room, box = _REACH_M * _TO_MM, np.array(other.bounding_box()).reshape(2, 3)
    corners = np.stack(np.meshgrid(*box.T), axis=-1).reshape(-1, 3)
    lengths = np.array([hull.reach(along) for hull in hulls]) - float((corners @ along).min())
    backs = -along * lengths[:, None]
    lows, highs = np.array([hull.low for hull in hulls]), np.array([hull.high for hull in hulls])
    is_apart = (np.minimum(lows, lows + backs) - room > box[1]).any(axis=1)
    is_apart |= (np.maximum(highs, highs + backs) + room < box[0]).any(axis=1)
    passing = np.flatnonzero((lengths > _BELOW_MM) & ~is_apart)
    return [(hulls[number], backs[number]) for number in passing.tolist()]


def _crop_to_ways(
    other: manifold3d.Manifold, passing: Sequence[tuple[_Hull, Floats]]
) -> manifold3d.Manifold:
    """Return the part of a solid in the box around pieces and their ways back."""
    ends = np.array([[hull.low, hull.high, hull.low + b, hull.high + b] for hull, b in passing])
    low, high = ends.min(axis=(0, 1)), ends.max(axis=(0, 1))
    room = _REACH_M * _TO_MM
    box = manifold3d.Manifold.cube(tuple((high - low + 2 * room).tolist()))
    near = other ^ box.translate(tuple((low - room).tolist()))
    # Made at once, or each part of it would be cut from the whole solid.
    near.num_tri()
    return near


class _Hull:
    """A convex piece, and the distances that its sides keep from other parts [mm]."""

    def __init__(self, points_m: Points) -> None:
        self._points = points_m * _TO_MM
        self._solid = manifold3d.Manifold.hull_points(self._points)
        self.low, self.high = self._points.min(axis=0), self._points.max(axis=0)
        # Normal and offset of each side that passes another part, with the least gap; the play if
        # the other part keeps it.
        self.sides: dict[tuple[float, float, float, float], float] = {}
        self._outline: list[tuple[Floats, float, Points]] | None = None
        # Films of the parts that the front of the piece rests on.
        self._seats: list[manifold3d.Manifold] = []

    def reach(self, along: Floats) -> float:
        """Return how far the piece reaches in a direction [mm]."""
        return float((self._points @ along).max())

    def face(
        self,
        other: manifold3d.Manifold,
        along: Floats,
        back: Floats,
        others_along: Floats | None,
    ) -> list[float]:
        """Note the sides that pass another part within the clearance of a fit; return the gaps.

        Parameters
        ----------
        back
            Way back, as far as it passes the other part [mm].
        others_along
            Direction in which a later part comes, None for an earlier one. A later part that comes
            down rests on sides that point up; it has the play itself beside the other sides.
        """
        room = _REACH_M * _TO_MM
        near = _crop_to_ways(other, [(self, back)])
        if near.is_empty():
            return []
        if others_along is None:
            seat = near ^ self._step(self._solid, along)
            self._seats += [seat] if seat.volume() > _LEAST_MM3 else []
        gaps, shape = [], near.to_mesh64().vert_properties[:, :3]
        # What the front of the piece rests on is not passed.
        backs = np.stack([-_FILM_MM * along, back])[:, None]
        swept = manifold3d.Manifold.hull_points((self._points + backs).reshape(-1, 3))
        for normal, offset, points in self._list_sides(along):
            is_level = others_along is not None and abs(normal @ others_along) < _SIDEWAYS
            if others_along is not None and normal[2] > _STEEP and not is_level:
                continue
            heights = shape @ normal
            if heights.max() <= offset or heights.min() > offset + room:
                continue
            ends = np.concatenate([points - _BELOW_MM * normal, points + room * normal])
            front = manifold3d.Manifold.hull_points((ends + backs).reshape(-1, 3))
            gap = self._measure_gap(near ^ front, swept, normal, offset)
            if gap is None:
                continue
            key = (*normal.tolist(), offset)
            # Undersides bear a part, also on a move over its support: they get chamfers only.
            has_play = normal[2] < -_STEEP or (is_level and normal[2] <= _STEEP)
            kept = max(gap, PLAY_M * _TO_MM) if has_play else gap
            self.sides[key] = min(kept, self.sides.get(key, kept))
            if not has_play:
                gaps.append(gap)
        return gaps

    def note_like(
        self, sides: Mapping[tuple[float, float, float, float], float], along: Floats
    ) -> None:
        """Note the own sides that lie in the planes of noted sides of another piece."""
        for normal, offset, _ in self._list_sides(along):
            own = np.array([*normal, offset])
            for key, gap in sides.items():
                if np.abs(own - key).max() < _NEXT_MM:
                    self.sides.setdefault((*normal.tolist(), offset), gap)

    def _measure_gap(
        self, met: manifold3d.Manifold, swept: manifold3d.Manifold, normal: Floats, offset: float
    ) -> float | None:
        """Return the gap of a side to what is near it, or None if it is nearer to other sides."""
        gaps = []
        for piece in met.decompose():
            heights = piece.to_mesh64().vert_properties[:, :3] @ normal
            # A part behind this side of a thin piece lies before its other side.
            if piece.volume() > _LEAST_MM3 and heights.max() > offset:
                inside = (piece ^ swept).to_mesh64().vert_properties[:, :3]
                depths = [
                    end - (inside @ out).min(initial=end) for out, end, _ in self._outline or ()
                ]
                if offset - (inside @ normal).min(initial=offset) < min(depths) + _LEAST_MM:
                    gaps.append(float(heights.min()) - offset)
        return min(gaps, default=None)

    def _list_sides(self, along: Floats) -> list[tuple[Floats, float, Points]]:
        """Return the edges of the outline seen along a move: normal, offset and ends.

        All of a piece has to pass, also if its faces lean.
        """
        if self._outline is None:
            frame = np.linalg.svd(along[None])[2][1:]
            hull = ConvexHull(self._points @ frame.T)
            self._outline = []
            for corners, (x, y, shift) in zip(hull.simplices, hull.equations, strict=True):
                normal = x * frame[0] + y * frame[1]
                ends = np.array([self._find_foremost(number, along) for number in corners])
                if np.linalg.norm(ends[1] - ends[0]) > _LEAST_MM:
                    # Surfaces that touch its ends are not in front of it.
                    ends = ends + _INWARD * (ends.mean(axis=0) - ends)
                    self._outline.append((normal, -float(shift), ends))
        return self._outline

    def _find_foremost(self, corner: int, along: Floats) -> Floats:
        """Return a corner of the outline, as far ahead as faces that lean a little reach."""
        offsets = self._points - self._points[corner]
        heights = offsets @ along
        aside = np.linalg.norm(offsets - heights[:, None] * along, axis=1)
        ahead_mm = heights[aside <= _SIDEWAYS * heights].max(initial=0.0)
        foremost: Floats = self._points[corner] + ahead_mm * along
        return foremost

    def is_backed(self, others: Sequence[_Hull]) -> bool:
        """Return whether other pieces lie behind most of a piece at one of its noted sides."""
        for x, y, z, _ in self.sides:
            behind = self._solid.translate(tuple(-PLAY_M * _TO_MM * np.array([x, y, z])))
            backing_mm3 = sum((behind ^ other._solid).volume() for other in others)
            if backing_mm3 > _BACKED * behind.volume():
                return True
        return False

    def cut(self, along: Floats) -> Mesh | None:
        """Return the piece with play and chamfers at its noted sides; it keeps its seat."""
        seats_mm3 = sum(seat.volume() for seat in self._seats)
        for share in _CHAMFER_SHARES:
            solid = self._trim(along, share)
            ahead = self._step(solid, along)
            if sum((ahead ^ seat).volume() for seat in self._seats) >= _SEATED * seats_mm3:
                break
        return None if solid.is_empty() else build_mesh(solid)

    @staticmethod
    def _step(solid: manifold3d.Manifold, along: Floats) -> manifold3d.Manifold:
        """Return a solid moved ahead into a film of the part that it rests on."""
        return solid.translate(tuple((_FILM_MM * along).tolist()))

    def _trim(self, along: Floats, chamfer_share: float) -> manifold3d.Manifold:
        solid = self._solid
        heights = self._points @ along
        front, length = float(heights.max()), float(np.ptp(heights))
        for (x, y, z, offset), gap in self.sides.items():
            normal = np.array([x, y, z])
            side = offset - max(0.0, PLAY_M * _TO_MM - gap)
            width = float(np.ptp(self._points @ normal))
            if side < offset:
                solid = solid.trim_by_plane((-x, -y, -z), -side)
            chamfer = chamfer_share * min(CHAMFER_M * _TO_MM, _SHARE * min(length, width))
            slope = normal + along
            slope /= np.linalg.norm(slope)
            edge = side * float(normal @ slope) + front * float(along @ slope)
            cosine = float(along @ slope)
            solid = solid.trim_by_plane(tuple((-slope).tolist()), -(edge - chamfer * cosine))
        return solid
