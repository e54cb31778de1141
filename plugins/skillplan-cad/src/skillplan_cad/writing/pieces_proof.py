"""Decompose parts into convex pieces, and check them against the blockings of the true meshes."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from skillplan_cad.blocking.all_pairs import BlockingTest
from skillplan_cad.joints.cylinder_fits import CylinderFit, find_cylinder_fits
from skillplan_cad.planning.assembly_plan import AssemblyPlan
from skillplan_cad.product import Face, Part, Points, Product, Triangles
from skillplan_cad.relation import Relation
from skillplan_cad.writing.convex_pieces import Hollow, Pieces, decompose_convex, measure_excess_m
from skillplan_cad.writing.fit_play import PLAY_M, FitPlay, Loosened, Played
from skillplan_cad.writing.upright import Upright

Mesh = tuple[Points, Triangles]

# Allowed excess of pieces: at first, and as a share of the tolerance for the second cut.
_COARSE_M = 3e-4
# Share of a clearance that pieces may fill.
_CLEARANCE_SHARE = 0.2
_FINE_SHARE = 0.5
_SAME_M = 1e-6
_DECIMALS = 7


@dataclass(frozen=True, slots=True)
class Difference:
    """A pair that the pieces block but the true meshes do not.

    Parameters
    ----------
    part, by, direction
        As in `Blocking`.
    """

    part: str
    by: str
    direction: int


@dataclass(frozen=True, slots=True, eq=False)
class ProvedPieces:
    """Pieces of parts, and their wrong blockings.

    Parameters
    ----------
    pieces
        Pieces of each mesh by part name, in the frame of the given meshes.
    cut_back
        Names of parts whose first pieces blocked a free direction.
    fits
        Fits that the pieces of a part loosen, by its name.
    """

    pieces: Mapping[str, tuple[Pieces, ...]]
    cut_back: tuple[str, ...]
    differences: tuple[Difference, ...]
    fits: Mapping[str, tuple[Played, ...]] = field(default_factory=dict)

    def of(self, names: Collection[str]) -> ProvedPieces:
        """Return the pieces of some parts, and differences between parts that still have pieces."""
        gone = self.pieces.keys() - set(names)
        return ProvedPieces(
            {name: pieces for name, pieces in self.pieces.items() if name not in gone},
            tuple(name for name in self.cut_back if name not in gone),
            tuple(
                difference
                for difference in self.differences
                if not {difference.part, difference.by} & gone
            ),
            {
                name: tuple(fit for fit in fits if fit.into not in gone)
                for name, fits in self.fits.items()
                if name not in gone
            },
        )


def prove_pieces(
    product: Product,
    relation: Relation,
    plan: AssemblyPlan,
    meshes: Mapping[str, Sequence[Mesh]],
    upright: Upright,
) -> ProvedPieces:
    """Return convex pieces that block the same directions as the relation, as far as cuts allow.

    Pieces enclose their mesh, so blocked directions stay blocked. Free directions are tested with
    the same rays; parts of wrongly blocked pairs are cut finer, and the remaining differences are
    listed.

    Parameters
    ----------
    product, relation, plan
        True meshes, their blockings, and the order of the parts.
    meshes
        Meshes by part name, upright, relative to the centre of the part's bottom.
    """
    fits = find_cylinder_fits(product)
    play = FitPlay(product, relation, plan, upright, fits)
    cutter = _Cutter(product, fits, play.drawn_m, upright)
    pieces_of = {
        name: cutter.pieces(product.parts[product.index(name)], given, _COARSE_M)
        for name, given in meshes.items()
    }
    loosened = _loosen(product, play, pieces_of)
    wrong = _find_differences(product, relation, _list_pieces(loosened), upright)
    cut = sorted(
        {name for difference in wrong for name in (difference.part, difference.by)}
        & pieces_of.keys()
    )
    if cut:
        fine_m = min(_COARSE_M, _FINE_SHARE * relation.tolerance_m)
        for name in cut:
            part = product.parts[product.index(name)]
            pieces_of[name] = cutter.pieces(part, meshes[name], fine_m)
        loosened |= _loosen(product, play, {name: pieces_of[name] for name in cut})
        wrong = _find_differences(product, relation, _list_pieces(loosened), upright)
    excess_m = {
        name: cutter.measure_excess_m(product.parts[product.index(name)], pieces_of[name], given)
        for name, given in meshes.items()
    }
    fits_of = {
        name: tuple(
            replace(fit, outside_m=max(excess_m[name], excess_m.get(fit.into, 0.0)))
            for fit in own.fits
        )
        for name, own in loosened.items()
        if own.fits
    }
    return ProvedPieces(_list_pieces(loosened), tuple(cut), wrong, fits_of)


def _loosen(
    product: Product, play: FitPlay, pieces_of: Mapping[str, Sequence[Pieces]]
) -> dict[str, Loosened]:
    """Return pieces with play beside the parts that are in place before."""
    return {
        name: play.loosen(product.parts[product.index(name)], pieces)
        for name, pieces in pieces_of.items()
    }


def _list_pieces(loosened: Mapping[str, Loosened]) -> dict[str, tuple[Pieces, ...]]:
    return {name: own.pieces for name, own in loosened.items()}


class _Cutter:
    """Computes pieces, once for each shape and orientation."""

    def __init__(
        self,
        product: Product,
        fits: Iterable[CylinderFit],
        drawn_m: Mapping[frozenset[str], float],
        upright: Upright,
    ) -> None:
        self._upright = upright
        # Allowed excess on the walls of holes that hold shafts, by number of the part [m].
        self._fitted: dict[str, list[tuple[Face, float]]] = {}
        for fit in fits:
            inner, outer = product.parts[fit.inner].name, product.parts[fit.outer].name
            clearance_m = min(drawn_m[frozenset((inner, outer))], fit.radius_difference_m)
            allowed_m = _CLEARANCE_SHARE * max(clearance_m, PLAY_M)
            self._fitted.setdefault(outer, []).append((fit.hole, allowed_m))
        self._made: dict[tuple[Any, ...], Pieces] = {}

    def pieces(self, part: Part, meshes: Sequence[Mesh], allowed_m: float) -> tuple[Pieces, ...]:
        """Return the pieces of each mesh of a part."""
        hollows = self._find_hollows(part)
        rows = [
            (*hollow.point_m, *hollow.axis, hollow.radius_m, hollow.allowed_m or 0.0)
            for hollow in hollows
        ]
        pieces = []
        for vertices_m, triangles in meshes:
            key = (
                _round_to_bytes(vertices_m),
                triangles.tobytes(),
                _round_to_bytes(rows),
                allowed_m,
            )
            if key not in self._made:
                self._made[key] = decompose_convex(vertices_m, triangles, allowed_m, hollows)
            pieces.append(self._made[key])
        return tuple(pieces)

    def measure_excess_m(
        self, part: Part, pieces: Sequence[Pieces], meshes: Sequence[Mesh]
    ) -> float:
        """Return the greatest excess of pieces over the walls of holes with shafts [m]."""
        if part.name not in self._fitted:
            return 0.0
        hollows = self._find_hollows(part)
        return max(
            measure_excess_m(own, vertices_m, triangles, hollows)
            for own, (vertices_m, triangles) in zip(pieces, meshes, strict=True)
        )

    def _find_hollows(self, part: Part) -> list[Hollow]:
        upright = self._upright
        bottom = np.array(upright.bottom(part))
        hollows: list[Hollow] = []
        for face in part.faces:
            if face.kind != "cylinder" or not face.hollow:
                continue
            point = upright.matrix @ np.asarray(face.origin_m) + upright.offset_m - bottom
            axis = upright.matrix @ np.asarray(face.axis)
            if not any(_is_same(hollow, point, axis, face.radius_m) for hollow in hollows):
                fits = self._fitted.get(part.name, ())
                allowed = (allowed_m for hole, allowed_m in fits if _are_coaxial(face, hole))
                hollows.append(Hollow(point, axis, face.radius_m, min(allowed, default=None)))
        return hollows


def _are_coaxial(face: Face, other: Face) -> bool:
    """Return whether two faces lie on the same cylinder."""
    offset = np.subtract(other.origin_m, face.origin_m)
    return bool(
        abs(np.dot(face.axis, other.axis)) > 1 - _SAME_M
        and float(np.linalg.norm(np.cross(offset, face.axis))) < _SAME_M
        and abs(face.radius_m - other.radius_m) < _SAME_M
    )


def _round_to_bytes(lengths_m: Any) -> bytes:
    """Return lengths as bytes, rounded to 0.1 micrometres as in mesh files."""
    rounded = np.round(np.asarray(lengths_m, dtype=np.float64), _DECIMALS) + 0.0
    return bytes(rounded.tobytes())


def _is_same(hollow: Hollow, point: Points, axis: Points, radius_m: float) -> bool:
    distance = np.linalg.norm(np.cross(point - hollow.point_m, axis))
    return bool(
        abs(float(hollow.axis @ axis)) > 1 - _SAME_M
        and distance < _SAME_M
        and abs(hollow.radius_m - radius_m) < _SAME_M
    )


def _find_differences(
    product: Product,
    relation: Relation,
    pieces_of: Mapping[str, Sequence[Pieces]],
    upright: Upright,
) -> tuple[Difference, ...]:
    """Return the pairs that pieces block beyond the relation."""
    parts = []
    for part in product:
        pieces = [piece for mesh in pieces_of.get(part.name, ()) for piece in mesh]
        parts.append(_replace_mesh(part, pieces, upright) if pieces else part)
    waived = np.zeros((len(product), len(product)), dtype=bool)
    for fastener in relation.fasteners:
        for mate in fastener.threaded_in:
            first, second = product.index(fastener.part), product.index(mate)
            waived[first, second] = waived[second, first] = True
    test = BlockingTest(replace(product, parts=tuple(parts)), relation.tolerance_m)
    names = [part.name for part in product]
    differences = []
    matrix = relation.matrix
    for number in range(0, len(relation.directions), 2):
        # A blocking of one part is a blocking of the other in the opposite direction.
        tested = ~(matrix[number] & matrix[number + 1].T) & ~waived
        for first, second in test.find_blocked_pairs(relation.directions[number], tested):
            pairs = ((first, second, number), (second, first, number + 1))
            differences += [
                Difference(names[a], names[b], way) for a, b, way in pairs if not matrix[way, a, b]
            ]
    return tuple(sorted(differences, key=lambda pair: (pair.direction, pair.part, pair.by)))


def _replace_mesh(part: Part, pieces: Iterable[Mesh], upright: Upright) -> Part:
    """Return a part with its pieces as its mesh, back in its place in the product."""
    points, triangles, before = [], [], 0
    bottom = np.array(upright.bottom(part))
    for corners, faces in pieces:
        points.append((corners + bottom - upright.offset_m) @ upright.matrix)
        triangles.append(faces + before)
        before += len(corners)
    return replace(
        part, vertices_m=np.concatenate(points), triangles=np.concatenate(triangles), faces=()
    )
