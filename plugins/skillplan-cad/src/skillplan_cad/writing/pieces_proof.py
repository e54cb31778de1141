"""Decompose parts into convex pieces, and check them against the blockings of the true meshes."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import manifold3d
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from skillplan_cad.blocking.all_pairs import BlockingTest
from skillplan_cad.joints.cylinder_fits import find_cylinder_fits
from skillplan_cad.planning.assembly_plan import AssemblyPlan
from skillplan_cad.planning.watch import Watch
from skillplan_cad.product import Part, Points, Product, Triangles, make_solid
from skillplan_cad.relation import Relation
from skillplan_cad.writing.convex_pieces import (
    Hollow,
    Pieces,
    build_mesh,
    decompose_convex,
    is_full,
    measure_excess_m,
)
from skillplan_cad.writing.fit_play import FitPlay, Loosened, LoosenedBefore, Played
from skillplan_cad.writing.lanes import JawSpaces, Lane, Lanes, Sweeps, measure_thickness
from skillplan_cad.writing.upright import Upright

Mesh = tuple[Points, Triangles]
# Rotation matrix and shift [m].
Motion = tuple[Points, Points]

# Allowed excess of pieces: at first, and as a share of the tolerance for the second cut.
_COARSE_M = 3e-4
_FINE_SHARE = 0.5
# Share of the time limit at which cutting is interrupted, so that trials have the rest.
_CUTTING_SHARE = 0.7
_SAME_M = 1e-6
# Distance of vertices that mesh files round to the same, and of corners of meshes in single
# precision that are in different places [m]; thickness of a film between them [mm].
_ROUNDED_M, _NEAR_M, _FILM_MM = 5e-8, 2e-7, 1e-3
# Number of rotations tried between meshes of one shape.
_MOST_TRIED = 200


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


class PieceProof:
    """Computes pieces of the parts of a product in one orientation, each once.

    The pieces block the same directions as the relation, as far as cuts allow. They enclose their
    mesh, so blocked directions stay blocked. Free directions are tested with the same rays; parts
    of wrongly blocked pairs are cut finer, and the remaining differences are listed.

    Parameters
    ----------
    product, relation, plan
        True meshes, their blockings, and the planned order of the parts.
    upright
        Pose of the product.
    cuts
        Pieces that other orientations and products have computed.
    watch
        Progress reports, and requests to stop.
    """

    def __init__(
        self,
        product: Product,
        relation: Relation,
        plan: AssemblyPlan,
        upright: Upright,
        cuts: Cuts,
        watch: Watch,
    ) -> None:
        self._product, self._relation, self._upright = product, relation, upright
        self._watch = watch
        fits = find_cylinder_fits(product)
        self._play = play = FitPlay(product, relation, plan, upright, fits, cuts.loosened)
        lanes = Lanes(
            product,
            relation,
            upright,
            play.list_moves,
            play.drawn_m,
            play.waists_m,
            cuts.sweeps,
        )
        self._cutter = _Cutter(upright, lanes, cuts)
        self._meshes: dict[str, Sequence[Mesh]] = {}
        self._pieces: dict[str, tuple[Pieces, ...]] = {}
        self._loosened: dict[str, Loosened] = {}
        self._wrong: tuple[Difference, ...] = ()
        self._fine: set[str] = set()

    def prove(
        self,
        meshes: Mapping[str, Sequence[Mesh]],
        list_jaws: Callable[[], Mapping[str, JawSpaces]],
        order: Sequence[str],
    ) -> ProvedPieces:
        """Return the pieces of some parts, without those that are not cut in their share of time.

        Simple parts come first, so that one that takes long costs no other.

        Parameters
        ----------
        meshes
            Meshes by part name, upright, relative to the centre of the part's bottom [m].
        list_jaws
            Returns the spaces that jaws take by part name, in the same frame; see `Lanes.find`.
        order
            Parts in the order of the task, which may differ from that of the plan.
        """
        self._follow(order)
        new = [name for name in meshes if name not in self._loosened]
        jaws = list_jaws() if new else {}
        new.sort(key=lambda name: sum(len(triangles) for _, triangles in meshes[name]))
        pieces_of: dict[str, tuple[Pieces, ...]] = {}
        for number, name in enumerate(new, 1):
            if self._watch.must_stop():
                break
            self._watch.report(f"writing: convex pieces of {name}, {number} of {len(new)} parts")
            self._cutter.jaws[name] = jaws.get(name, ((), ()))
            pieces = self._cut(name, meshes[name], _COARSE_M)
            if pieces is None:
                break
            self._meshes[name], pieces_of[name] = meshes[name], pieces
            self._loosen(name, pieces)
        if pieces_of:
            self._test(pieces_of.keys())
            wrong = {name for pair in self._wrong for name in (pair.part, pair.by)}
            coarse = (wrong & self._loosened.keys()) - self._fine
            self._fine |= coarse
            self._cut_finer(coarse)
        return self._list_proved().of(meshes)

    def _follow(self, order: Sequence[str]) -> None:
        """Loosen parts anew that go in differently now, as other parts are left out."""
        there = [name for name in order if name in self._loosened]
        before = {name: self._play.describe(name).items() for name in there}
        self._play.follow(order)
        stale = [name for name in there if self._play.describe(name).items() - before[name]]
        for name in stale:
            self._loosen(name, self._pieces[name])
        if stale:
            self._test(stale)

    def _cut_finer(self, names: Collection[str]) -> None:
        """Cut the pieces of some parts anew, unless they are as many as they may be."""
        fine_m = min(_COARSE_M, _FINE_SHARE * self._relation.tolerance_m)
        changed = []
        for number, name in enumerate(sorted(names), 1):
            if self._watch.must_stop():
                break
            self._watch.report(f"writing: finer pieces of {name}, {number} of {len(names)} parts")
            pieces = self._cut(name, self._meshes[name], fine_m)
            if pieces is None:
                break
            self._loosen(name, pieces)
            changed.append(name)
        if changed:
            self._test(changed)

    def _cut(
        self, name: str, meshes: Sequence[Mesh], allowed_m: float
    ) -> tuple[Pieces, ...] | None:
        """Return the pieces of a part, or None if the share of the time is over before."""
        return self._watch.attempt(
            lambda: self._cutter.pieces(self._product.part(name), meshes, allowed_m), _CUTTING_SHARE
        )

    def _loosen(self, name: str, pieces: tuple[Pieces, ...]) -> None:
        """Keep the pieces of a part with play beside the parts that are in place before."""
        part, self._pieces[name] = self._product.part(name), pieces
        self._loosened[name] = self._play.loosen(part, pieces)

    def _test(self, names: Collection[str]) -> None:
        """Find the differences of the pairs with some parts anew."""
        known = [pair for pair in self._wrong if not {pair.part, pair.by} & set(names)]
        pieces_of = {name: own.pieces for name, own in self._loosened.items()}
        differences = _find_differences(
            self._product, self._relation, pieces_of, names, self._upright
        )
        self._wrong = tuple(
            sorted((*known, *differences), key=lambda pair: (pair.direction, pair.part, pair.by))
        )

    def _list_proved(self) -> ProvedPieces:
        excess_m = self._cutter.excess_m
        fits_of = {
            name: tuple(
                replace(fit, outside_m=max(excess_m[name], excess_m.get(fit.into, 0.0)))
                for fit in own.fits
            )
            for name, own in self._loosened.items()
            if own.fits
        }
        pieces_of = {name: own.pieces for name, own in self._loosened.items()}
        return ProvedPieces(pieces_of, tuple(sorted(self._fine)), self._wrong, fits_of)


class Cuts:
    """Pieces of shapes, with play or not, and sweeps, which orientations and groups share."""

    def __init__(self) -> None:
        self.sweeps: Sweeps = {}
        self.loosened: LoosenedBefore = {}
        # By the numbers of corners and triangles, and the allowed excess.
        self._made: dict[tuple[int, int, float], list[_Cut]] = {}

    def cut(
        self,
        vertices_m: Points,
        triangles: Triangles,
        allowed_m: float,
        hollows: Sequence[Hollow],
        lane: Lane | None,
    ) -> tuple[Pieces, float]:
        """Return the pieces of a mesh, and the width by which they are in the way of others [m].

        They are turned from an equal shape that was cut before, if possible.
        """
        key = len(vertices_m), len(triangles)
        for (*other, other_m), cuts in self._made.items():
            if tuple(other) != key or other_m < allowed_m:
                continue
            for cut in cuts:
                # Finer cuts would stop at the same pieces.
                is_same = other_m == allowed_m or is_full(cut.pieces)
                pieces = cut.turn(vertices_m, triangles) if is_same else None
                if pieces is None:
                    continue
                if lane is None:
                    return pieces, 0.0
                # Pieces that are turned free another place.
                if pieces is cut.pieces and lane.is_like(cut.lane):
                    return pieces, cut.excess_m
                most_m = lane.allowed_m
                excess_m = measure_excess_m(pieces, vertices_m, triangles, lane, most_m)
                if excess_m <= lane.allowed_m and lane.frees_jaws(at for at, _ in pieces):
                    return pieces, excess_m
        pieces = decompose_convex(vertices_m, triangles, allowed_m, hollows, lane)
        excess_m = measure_excess_m(pieces, vertices_m, triangles, lane)
        cut = _Cut(vertices_m, triangles, lane, pieces, excess_m)
        self._made.setdefault((*key, allowed_m), []).append(cut)
        return pieces, excess_m


@dataclass(frozen=True, slots=True, eq=False)
class _Cut:
    """A mesh that was cut."""

    vertices_m: Points
    triangles: Triangles
    lane: Lane | None
    pieces: Pieces
    excess_m: float

    def turn(self, vertices_m: Points, triangles: Triangles) -> Pieces | None:
        """Return the pieces for a mesh that is moved as a rigid body, or None."""
        is_same_mesh = np.array_equal(triangles, self.triangles)
        if is_same_mesh and np.abs(vertices_m - self.vertices_m).max() < _ROUNDED_M:
            return self.pieces
        motion = _find_motion(self.vertices_m, self.triangles, vertices_m, triangles)
        if motion is None:
            return None
        # Rounded faces of small pieces are no longer convex, so each piece is a hull anew.
        rebuilt = (
            build_mesh(manifold3d.Manifold.hull_points(_move(points, motion) * 1e3))
            for points, _ in self.pieces
        )
        return tuple(piece for piece in rebuilt if piece is not None)


def _find_motion(
    before_m: Points, before: Triangles, after_m: Points, after: Triangles
) -> Motion | None:
    """Return the motion that brings a mesh onto an equal one, or None."""
    if np.array_equal(before, after):
        motion = _fit_rigid_motion(before_m, after_m)
        is_met = np.abs(_move(before_m, motion) - after_m).max() < _ROUNDED_M
        return motion if is_met else None
    found = _find_rigid_motion(before_m, after_m)
    if found is None:
        return None
    motion, mates = found
    if np.array_equal(_sort_triangles(mates[before]), _sort_triangles(after)):
        return motion
    moved, own = make_solid(_move(before_m, motion), before), make_solid(after_m, after)
    films = [*(moved - own).decompose(), *(own - moved).decompose()]
    return None if any(measure_thickness(film) > _FILM_MM for film in films) else motion


def _sort_triangles(triangles: Triangles) -> Triangles:
    """Return triangles in an order of their corners, each from its first corner on."""
    first = triangles.argmin(axis=1)[:, None]
    turned = np.take_along_axis(triangles, (first + np.arange(3)) % 3, axis=1)
    return turned[np.lexsort(turned.T)]


def _move(points_m: Points, motion: Motion) -> Points:
    turn, shift_m = motion
    return points_m @ turn.T + shift_m


def _fit_rigid_motion(before_m: Points, after_m: Points) -> Motion:
    """Return rotation and shift that bring points closest to others (Kabsch 1976)."""
    centre_before, centre_after = before_m.mean(axis=0), after_m.mean(axis=0)
    u, _, vt = np.linalg.svd((before_m - centre_before).T @ (after_m - centre_after))
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(vt.T @ u.T))])
    turn = (vt.T * signs) @ u.T
    if np.abs(turn - np.round(turn)).max() < _ROUNDED_M:
        # Quarter turns stay exact.
        turn = np.round(turn)
    return turn, centre_after - turn @ centre_before


def _find_rigid_motion(
    before_m: Points, after_m: Points
) -> tuple[Motion, NDArray[np.int64]] | None:
    """Return a motion that brings points onto others in any order, with their numbers, or None.

    Two corners far from the centre and from each other fix the rotation.
    """
    before, after = before_m - before_m.mean(axis=0), after_m - after_m.mean(axis=0)
    radii, others = np.linalg.norm(before, axis=1), np.linalg.norm(after, axis=1)
    if np.abs(np.sort(radii) - np.sort(others)).max() > _NEAR_M:
        return None
    first = int(np.argmax(radii))
    second = int(np.argmax(np.linalg.norm(np.cross(before, before[first]), axis=1)))
    apart = np.linalg.norm(before[first] - before[second])
    tree = cKDTree(after)
    seconds = np.flatnonzero(np.abs(others - radii[second]) < _NEAR_M)
    tried = 0
    for a in np.flatnonzero(np.abs(others - radii[first]) < _NEAR_M).tolist():
        distances = np.linalg.norm(after[seconds] - after[a], axis=1)
        for b in seconds[np.abs(distances - apart) < _NEAR_M].tolist():
            tried += 1
            if tried > _MOST_TRIED:
                return None
            turn, _ = _fit_rigid_motion(
                _build_cross(before, first, second), _build_cross(after, a, b)
            )
            _, mates = tree.query(before @ turn.T)
            turn, shift_m = _fit_rigid_motion(before_m, after_m[mates])
            if np.abs(before_m @ turn.T + shift_m - after_m[mates]).max() < _NEAR_M:
                return (turn, shift_m), mates
    return None


def _build_cross(points: Points, first: int, second: int) -> Points:
    """Return two points, the normal of their plane with the origin, and the origin."""
    a, b = points[first], points[second]
    across = np.cross(a, b)
    normal = across / max(float(np.linalg.norm(across)), 1e-30) * float(np.linalg.norm(a))
    return np.array([a, b, normal, -a, -b, -normal])


class _Cutter:
    """Cuts the parts of a product in one orientation.

    Attributes
    ----------
    excess_m
        Width by which the pieces of each part are in the way of other parts [m].
    jaws
        Spaces that jaws take at each part.
    """

    def __init__(self, upright: Upright, lanes: Lanes, cuts: Cuts) -> None:
        self._upright, self._lanes, self._cuts = upright, lanes, cuts
        self._lanes_of: dict[str, list[Lane | None]] = {}
        self.excess_m: dict[str, float] = {}
        self.jaws: dict[str, JawSpaces] = {}

    def pieces(self, part: Part, meshes: Sequence[Mesh], allowed_m: float) -> tuple[Pieces, ...]:
        """Return the pieces of each mesh of a part."""
        if part.name not in self._lanes_of:
            jaws = self.jaws.get(part.name, ((), ()))
            self._lanes_of[part.name] = [self._lanes.find(part, *mesh, jaws) for mesh in meshes]
        hollows, pieces, excess_m = self._find_hollows(part), [], 0.0
        for mesh, lane in zip(meshes, self._lanes_of[part.name], strict=True):
            own, own_m = self._cuts.cut(*mesh, allowed_m, hollows, lane)
            pieces.append(own)
            excess_m = max(excess_m, own_m)
        self.excess_m[part.name] = excess_m
        return tuple(pieces)

    def _find_hollows(self, part: Part) -> list[Hollow]:
        upright = self._upright.of(part.name)
        bottom = np.array(upright.bottom(part))
        hollows: list[Hollow] = []
        for face in part.faces:
            if face.kind == "cylinder" and face.hollow:
                point = upright.matrix @ np.asarray(face.origin_m) + upright.offset_m - bottom
                axis = upright.matrix @ np.asarray(face.axis)
                if not any(_is_same(hollow, point, axis, face.radius_m) for hollow in hollows):
                    hollows.append(Hollow(point, axis, face.radius_m))
        return hollows


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
    changed: Collection[str],
    upright: Upright,
) -> Iterator[Difference]:
    """Yield the pairs with a changed part that pieces block beyond the relation."""
    parts, numbers = [], []
    for number, part in enumerate(product):
        # Screws are heads only, which pass the holes.
        if part.name in pieces_of:
            pieces = [piece for mesh in pieces_of[part.name] for piece in mesh]
            parts.append(_replace_mesh(part, pieces, upright.of(part.name)) if pieces else part)
            numbers.append(number)
    if len(parts) < 2:
        return
    names = [part.name for part in parts]
    is_changed = np.array([name in changed for name in names])
    is_tested = is_changed[:, None] | is_changed[None, :]
    for fastener in relation.fasteners:
        for mate in fastener.threaded_in:
            if {fastener.part, mate} <= set(names):
                first, second = names.index(fastener.part), names.index(mate)
                is_tested[first, second] = is_tested[second, first] = False
    test = BlockingTest(replace(product, parts=tuple(parts)), relation.tolerance_m)
    matrix = relation.matrix[:, numbers][:, :, numbers]
    for number in range(0, len(relation.directions), 2):
        # A blocking of one part is a blocking of the other in the opposite direction.
        tested = ~(matrix[number] & matrix[number + 1].T) & is_tested
        for first, second in test.find_blocked_pairs(relation.directions[number], tested):
            pairs = ((first, second, number), (second, first, number + 1))
            for a, b, way in pairs:
                if not matrix[way, a, b]:
                    yield Difference(names[a], names[b], way)


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
