"""Convex pieces of a product's parts, and whether they block what the true meshes block."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from skillplan_cad.blocking.all_pairs import BlockingTest
from skillplan_cad.product import Part, Points, Product, Triangles
from skillplan_cad.relation import Relation
from skillplan_cad.writing.convex_pieces import Hollow, Pieces, convex_pieces
from skillplan_cad.writing.top_grasp import Upright

Mesh = tuple[Points, Triangles]

# How far pieces may stand out of their mesh: at first, and where that blocks what is free.
_COARSE_M = 3e-4
_FINE_SHARE = 0.5
_SAME_M = 1e-6
_DECIMALS = 7


@dataclass(frozen=True, slots=True)
class Difference:
    """A pair that pieces block, and the true meshes do not.

    Parameters
    ----------
    part, by, direction
        As of `Blocking`.
    """

    part: str
    by: str
    direction: int


@dataclass(frozen=True, slots=True, eq=False)
class ProvedPieces:
    """Pieces of parts, and where they are wrong.

    Parameters
    ----------
    pieces
        Of each mesh of each part, by its name, in the frame in which the meshes were given.
    cut_back
        Names of parts whose first pieces blocked what is free.
    differences
        What the pieces still block.
    """

    pieces: Mapping[str, tuple[Pieces, ...]]
    cut_back: tuple[str, ...]
    differences: tuple[Difference, ...]

    def of(self, names: Collection[str]) -> ProvedPieces:
        """Return what is about some parts, and about what has no pieces."""
        gone = self.pieces.keys() - set(names)
        return ProvedPieces(
            {name: pieces for name, pieces in self.pieces.items() if name not in gone},
            tuple(name for name in self.cut_back if name not in gone),
            tuple(one for one in self.differences if not {one.part, one.by} & gone),
        )


def proved_pieces(
    product: Product,
    relation: Relation,
    meshes: Mapping[str, Sequence[Mesh]],
    upright: Upright,
) -> ProvedPieces:
    """Return convex pieces of meshes that block what the relation says, as far as cuts can.

    Pieces enclose their mesh, so that what is blocked stays so. What is free is tested by the same
    rays; parts of pairs that pieces block are cut finer, and what remains is listed.

    Parameters
    ----------
    product, relation
        True meshes, and what these block.
    meshes
        Of parts by name, upright, each from the centre of its own bottom.
    upright
        Where the product stands.
    """
    cutter = _Cutter(upright)
    made = {
        name: cutter.pieces(product.parts[product.index(name)], given, _COARSE_M)
        for name, given in meshes.items()
    }
    wrong = _differences(product, relation, made, upright)
    cut = sorted({name for one in wrong for name in (one.part, one.by)} & made.keys())
    if cut:
        fine_m = min(_COARSE_M, _FINE_SHARE * relation.tolerance_m)
        for name in cut:
            part = product.parts[product.index(name)]
            made[name] = cutter.pieces(part, meshes[name], fine_m)
        wrong = _differences(product, relation, made, upright)
    return ProvedPieces(made, tuple(cut), wrong)


class _Cutter:
    """Makes pieces, once of what has the same shape and lies the same way."""

    def __init__(self, upright: Upright) -> None:
        self._upright = upright
        self._made: dict[tuple[Any, ...], Pieces] = {}

    def pieces(self, part: Part, meshes: Sequence[Mesh], allowed_m: float) -> tuple[Pieces, ...]:
        """Return the pieces of each mesh of a part."""
        hollows = self._hollows(part)
        rows = [(*one.point_m, *one.axis, one.radius_m) for one in hollows]
        found = []
        for vertices_m, triangles in meshes:
            key = (_rounded(vertices_m), triangles.tobytes(), _rounded(rows), allowed_m)
            if key not in self._made:
                self._made[key] = convex_pieces(vertices_m, triangles, allowed_m, hollows)
            found.append(self._made[key])
        return tuple(found)

    def _hollows(self, part: Part) -> list[Hollow]:
        upright = self._upright
        bottom = np.array(upright.bottom(part))
        hollows: list[Hollow] = []
        for face in part.faces:
            if face.kind != "cylinder" or not face.hollow:
                continue
            point = upright.matrix @ np.asarray(face.origin_m) + upright.offset_m - bottom
            axis = upright.matrix @ np.asarray(face.axis)
            if not any(_is_same(one, point, axis, face.radius_m) for one in hollows):
                hollows.append(Hollow(point, axis, face.radius_m))
        return hollows


def _rounded(lengths_m: Any) -> bytes:
    """Return lengths to a tenth of a micrometre, as files of meshes have them."""
    rounded = np.round(np.asarray(lengths_m, dtype=np.float64), _DECIMALS) + 0.0
    return bytes(rounded.tobytes())


def _is_same(one: Hollow, point: Points, axis: Points, radius_m: float) -> bool:
    apart = np.linalg.norm(np.cross(point - one.point_m, axis))
    return bool(
        abs(float(one.axis @ axis)) > 1 - _SAME_M
        and apart < _SAME_M
        and abs(one.radius_m - radius_m) < _SAME_M
    )


def _differences(
    product: Product,
    relation: Relation,
    made: Mapping[str, Sequence[Pieces]],
    upright: Upright,
) -> tuple[Difference, ...]:
    """Return what pieces block beyond the relation."""
    parts = []
    for part in product:
        pieces = [piece for mesh in made.get(part.name, ()) for piece in mesh]
        parts.append(_in_pieces(part, pieces, upright) if pieces else part)
    waived = np.zeros((len(product), len(product)), dtype=bool)
    for fastener in relation.fasteners:
        for mate in fastener.threaded_in:
            one, other = product.index(fastener.part), product.index(mate)
            waived[one, other] = waived[other, one] = True
    test = BlockingTest(replace(product, parts=tuple(parts)), relation.tolerance_m)
    names = [part.name for part in product]
    found = []
    matrix = relation.matrix
    for number in range(0, len(relation.directions), 2):
        # What is blocked one way is so for the other part the other way.
        asked = ~(matrix[number] & matrix[number + 1].T) & ~waived
        for one, other in test.blocked_along(relation.directions[number], asked):
            pairs = ((one, other, number), (other, one, number + 1))
            found += [
                Difference(names[a], names[b], way) for a, b, way in pairs if not matrix[way, a, b]
            ]
    return tuple(sorted(found, key=lambda one: (one.direction, one.part, one.by)))


def _in_pieces(part: Part, pieces: Iterable[Mesh], upright: Upright) -> Part:
    """Return a part with its pieces as its mesh, back where it stands in the product."""
    points, triangles, before = [], [], 0
    bottom = np.array(upright.bottom(part))
    for corners, faces in pieces:
        points.append((corners + bottom - upright.offset_m) @ upright.matrix)
        triangles.append(faces + before)
        before += len(corners)
    return replace(
        part, vertices_m=np.concatenate(points), triangles=np.concatenate(triangles), faces=()
    )
