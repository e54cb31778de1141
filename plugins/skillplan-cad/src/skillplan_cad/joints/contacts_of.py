"""Find the contacts of a product: kind, area and overlap."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan_cad.blocking.all_pairs import BlockingTest
from skillplan_cad.blocking.ray_mesh import Floats, RayMesh
from skillplan_cad.joints.cylinder_fits import CylinderFit
from skillplan_cad.product import Part, Product, Vector
from skillplan_cad.relation import Contact, ContactKind

# Smallest overlap that is not a rounding error [mm3]; rounding error of a flat face [mm].
_NOISE_MM3, _FLAT_NOISE_MM = 1e-3, 1e-3
# Points inside an overlap at which its depth is measured, the share of them that decides, and the
# directions of each: of the nearest surface, and of the largest faces.
_INSIDE, _DEEPEST, _NEAREST, _LARGEST = 300, 0.95, 12, 8
# Surface points that give directions; pieces measured; distance of a ray's start from a face [mm].
_AROUND, _PIECES, _START_MM = 2000, 8, 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Overlap:
    """The volume that two parts share.

    Parameters
    ----------
    allowed_mm3
        Share of the volume explained by the chords of curved faces and by rounding.
    depth_mm
        Distance between the parts' surfaces across the overlap; its longest side if both surfaces
        belong to one part, as for a part inside another. 0 if the volume is explained.
    thickness_mm
        As depth_mm, for half of the volume: parts of it may be deeper.
    section_mm
        Second smallest side of the overlap's box.
    """

    volume_mm3: float
    surface_mm2: float
    allowed_mm3: float
    middle_mm: Floats
    depth_mm: float
    thickness_mm: float
    section_mm: float


class Overlaps:
    """Intersections of a product's parts."""

    def __init__(self, product: Product, meshes: Sequence[RayMesh], middle_m: Floats) -> None:
        self._product, self._meshes, self._middle_m = product, meshes, middle_m
        self._solids: dict[int, tuple[Any, int]] = {}
        self._flat = [_mask_flat(part) for part in product.parts]
        self._chords_mm: dict[int, Floats] = {}

    def intersect(self, first: int, second: int) -> Overlap | None:
        """Return the overlap of two parts, or None."""
        (solid, mark), (other, _) = self._build_solid(first), self._build_solid(second)
        if solid is None or other is None:
            return None
        shared = solid ^ other
        volume = float(shared.volume())
        if volume < _NOISE_MM3:
            return None
        pieces = shared.decompose()
        if any(piece.volume() < -_NOISE_MM3 for piece in pieces):
            # The overlap has a cavity.
            pieces = [shared]
        pieces.sort(key=lambda piece: -piece.volume())
        chords = (self._get_chords_mm(first), self._get_chords_mm(second))
        surfaces = [_OverlapSurface(piece, mark, chords) for piece in pieces[:_PIECES]]
        middle = surfaces[0].find_middle_mm()
        allowed = _OverlapSurface(shared, mark, chords).compute_allowed_mm3()
        depth, thickness, section = 0.0, 0.0, 0.0
        if volume > allowed:
            deep = [
                surface
                for surface, piece in zip(surfaces, pieces, strict=False)
                if piece.volume() > surface.compute_allowed_mm3()
            ]
            meshes = (self._meshes[first], self._meshes[second])
            part = self._product.parts[first]
            depth, thickness, section = max(
                surface.measure(part, meshes, self._middle_m) for surface in deep or surfaces[:1]
            )
        surface = float(shared.surface_area())
        return Overlap(volume, surface, allowed, middle, depth, thickness, section)

    def _get_chords_mm(self, number: int) -> Floats:
        if number not in self._chords_mm:
            chord_m = self._product.chord_m
            part = self._product.parts[number]
            chords = _estimate_chords_mm(part) if not chord_m else chord_m * 1000
            self._chords_mm[number] = np.where(self._flat[number], 0.0, chords)
        return self._chords_mm[number]

    def _build_solid(self, number: int) -> tuple[Any, int]:
        if number not in self._solids:
            self._solids[number] = _build_solid(self._product.parts[number])
        return self._solids[number]


def _build_solid(part: Part) -> tuple[Any, int]:
    """Return a part as a manifold3d solid, None if it is not a solid, and the solid's mark."""
    import manifold3d

    if part.closure == "surface":
        # Its sheet is as thick as rays need, so an overlap would have no meaning.
        return None, 0

    mark = manifold3d.Manifold.reserve_ids(1)
    mesh = manifold3d.Mesh64(
        vert_properties=np.ascontiguousarray(part.vertices_m * 1000),
        tri_verts=np.ascontiguousarray(part.triangles, dtype=np.uint64),
        run_index=np.array([0, 3 * len(part.triangles)], dtype=np.uint64),
        run_original_id=np.array([mark], dtype=np.uint32),
        face_id=np.arange(len(part.triangles), dtype=np.uint64),
    )
    manifold = manifold3d.Manifold(mesh)
    return (None if manifold.is_empty() else manifold), mark


class _OverlapSurface:
    """The surface of an overlap, and the part that each triangle comes from.

    Parameters
    ----------
    mark
        Mark of the first part.
    chords_mm
        Chords of the triangles of each part; 0 for flat faces.
    """

    def __init__(self, solid: Any, mark: int, chords_mm: tuple[Floats, Floats]) -> None:
        mesh = solid.to_mesh64()
        self._vertices = np.asarray(mesh.vert_properties, dtype=np.float64)[:, :3]
        self._triangles = np.asarray(mesh.tri_verts, dtype=np.int64)
        starts = np.asarray(mesh.run_index, dtype=np.int64) // 3
        counts = starts[1:] - starts[:-1]
        self._is_first = np.repeat(np.asarray(mesh.run_original_id) == mark, counts)
        faces = np.asarray(mesh.face_id, dtype=np.int64)
        self._chords_mm = np.zeros(len(faces))
        for chords, own in zip(chords_mm, (self._is_first, ~self._is_first), strict=True):
            self._chords_mm[own] = chords[faces[own]]

    def find_middle_mm(self) -> Floats:
        """Return the centre of the volume."""
        corners = self._vertices[self._triangles]
        volumes = np.linalg.det(corners - self._vertices[0]) / 6
        centres = (corners.sum(axis=1) + self._vertices[0]) / 4
        return np.asarray((volumes[:, None] * centres).sum(axis=0) / volumes.sum())

    def compute_allowed_mm3(self) -> float:
        """Return the volume explained by chords of curved faces, on both sides, and rounding."""
        corners = self._vertices[self._triangles]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas = np.linalg.norm(across, axis=1) / 2
        chords = np.where(self._chords_mm > 0, self._chords_mm, _FLAT_NOISE_MM / 2)
        return float(areas @ chords)

    def measure(
        self, like: Part, meshes: tuple[RayMesh, RayMesh], middle_m: Floats
    ) -> tuple[float, float, float]:
        """Return depth, thickness and section [mm]; rays are traced in both parts."""
        part = replace(like, vertices_m=self._vertices / 1000, triangles=self._triangles, faces=())
        samples = _samples(part, RayMesh(part, middle_m))
        start = max(_START_MM, 1e-6 * max(mesh.reach_mm for mesh in meshes))
        origins = samples.points_mm - start * samples.normals
        length = _trace_exits(meshes, origins, -samples.normals).min(axis=0)
        # Coincident faces leave sheets without thickness, whose rays start outside of a part.
        thick = np.isfinite(length)
        points, normals, length = origins[thick], samples.normals[thick], length[thick]
        if not len(points):
            return 0.0, 0.0, 0.0
        ends = np.concatenate([samples.points_mm[thick], points - length[:, None] * normals])
        sides = np.sort(np.ptp(ends, axis=0))
        volumes = np.cumsum(samples.areas_mm2[thick] * length)
        order = np.arange(_INSIDE)
        chosen = np.searchsorted(volumes, (order + 0.5) / _INSIDE * volumes[-1])
        share = (order * 0.7548776662466927 + 0.5) % 1
        inside = points[chosen] - (share * length[chosen])[:, None] * normals[chosen]
        around = np.linspace(0, len(points) - 1, min(_AROUND, len(points))).astype(np.int64)
        distances = np.linalg.norm(inside[:, None] - points[None, around], axis=2)
        near = around[np.argsort(distances, axis=1)[:, :_NEAREST]]
        largest = _merge_directions(normals, samples.areas_mm2[thick])[:_LARGEST]
        directions = np.concatenate(
            [normals[near], np.broadcast_to(largest, (_INSIDE, *largest.shape))], axis=1
        ).reshape(-1, 3)
        origins = np.repeat(inside, near.shape[1] + len(largest), axis=0)
        ahead = _trace_exits(meshes, origins, directions)
        behind = _trace_exits(meshes, origins, -directions)
        # Coincident faces count as faces of both parts.
        ends_ahead, ends_behind = (
            exits <= exits.min(axis=0) + 2 * start for exits in (ahead, behind)
        )
        is_between = (ends_ahead & ends_behind[::-1]).any(axis=0)
        across = np.where(is_between, ahead.min(axis=0) + behind.min(axis=0), np.inf)
        nearest = np.minimum(np.sort(across.reshape(_INSIDE, -1).min(axis=1)), sides[2])
        return (
            float(nearest[int(_DEEPEST * _INSIDE)]),
            float(nearest[_INSIDE // 2]),
            float(sides[1]),
        )


def _trace_exits(
    meshes: tuple[RayMesh, RayMesh], origins: Floats, directions: Floats
) -> NDArray[np.float64]:
    """Return the distance at which rays leave each part [mm], (2, n).

    Rays that do not start in both parts have infinite distances.
    """
    exits = np.empty((2, len(origins)))
    for row, mesh in zip(exits, meshes, strict=True):
        hit, row[:] = mesh.trace(origins, directions)
        row[np.einsum("ij,ij->i", mesh.normals[hit], directions) <= 0] = np.inf
    exits[:, ~np.isfinite(exits).all(axis=0)] = np.inf
    return exits


# Sample points per part; largest cosine between the normals of touching surfaces.
_SAMPLES, _FACING = 4000, -0.7
_NORMALS, _NORMAL_RAD, _POINTS = 24, 0.1, 32


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Sample points on the surface of a part, relative to the product's centre [mm]."""

    points_mm: Floats
    normals: Floats
    areas_mm2: Floats
    triangles: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Touch:
    """The contact area of a pair, on the first part.

    Parameters
    ----------
    normals
        Distinct outward normals of the first part, the largest area first.
    flat_share
        Share of the area that is flat on both parts, 0 to 1.
    """

    area_mm2: float
    normals: Floats
    points_mm: Floats
    flat_share: float


class TouchTest:
    """Finds the touching surfaces of a product's parts.

    Parameters
    ----------
    reach_m
        Largest distance between touching surfaces [m].
    """

    def __init__(
        self, product: Product, meshes: list[RayMesh], middle_m: Floats, reach_m: float
    ) -> None:
        self._meshes, self._reach_mm = meshes, reach_m * 1000
        self._samples = [_samples(part, mesh) for part, mesh in zip(product, meshes, strict=True)]
        self._flat = [_mask_flat(part) for part in product.parts]
        self._low = np.stack([mesh.points_mm.min(axis=0) for mesh in meshes]) - self._reach_mm
        self._high = np.stack([mesh.points_mm.max(axis=0) for mesh in meshes]) + self._reach_mm

    def list_near_pairs(self) -> list[tuple[int, int]]:
        """Return the pairs whose bounding boxes meet."""
        count = len(self._meshes)
        return [
            (first, second)
            for first in range(count)
            for second in range(first + 1, count)
            if (self._low[first] <= self._high[second]).all()
            and (self._low[second] <= self._high[first]).all()
        ]

    def find_touch(self, first: int, second: int) -> Touch | None:
        """Return the contact area of two parts, or None; sampled on both for small parts."""
        there = self._sample_onto(first, second)
        back = self._sample_onto(second, first)
        area = max(there[3], back[3])
        if area <= 0:
            return None
        points, normals, areas, _, flat = there if there[3] >= back[3] else back
        if there[3] < back[3]:
            normals = -normals
        return Touch(area, _merge_directions(normals, areas), _select_spread(points), flat)

    def _sample_onto(self, first: int, second: int) -> tuple[Floats, Floats, Floats, float, float]:
        samples = self._samples[first]
        inside = (samples.points_mm >= self._low[second]).all(axis=1) & (
            samples.points_mm <= self._high[second]
        ).all(axis=1)
        points, normals = samples.points_mm[inside], samples.normals[inside]
        hit, distance = self._meshes[second].trace(points - self._reach_mm * normals, normals)
        good = (hit >= 0) & (distance <= 2 * self._reach_mm)
        good[good] &= (
            np.einsum("ij,ij->i", self._meshes[second].normals[hit[good]], normals[good]) < _FACING
        )
        areas = samples.areas_mm2[inside][good]
        flat = self._flat[first][samples.triangles[inside][good]] & self._flat[second][hit[good]]
        total = float(areas.sum())
        share = float(areas[flat].sum()) / total if total > 0 else 0.0
        return points[good], normals[good], areas, total, share


def _samples(part: Part, mesh: RayMesh) -> Samples:
    corners = mesh.points_mm[part.triangles]
    a, ab, ac = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = 0.5 * np.linalg.norm(np.cross(ab, ac), axis=1)
    total = float(area.sum())
    count = np.maximum(1, np.round(_SAMPLES * area / max(total, 1e-30)).astype(np.int64))
    which = np.repeat(np.arange(len(area)), count)
    order = np.arange(len(which))
    # Additive recurrence with the plastic number: evenly spread and reproducible.
    u, v = (order * 0.7548776662466927 + 0.5) % 1, (order * 0.5698402909980532 + 0.5) % 1
    over = u + v > 1
    u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    points = a[which] + u[:, None] * ab[which] + v[:, None] * ac[which]
    return Samples(points, mesh.normals[which], (area / count)[which], which)


def _estimate_chords_mm(part: Part) -> Floats:
    """Return the distance of each triangle of a mesh from the cylinder that it stands for; or 0."""
    chords = np.zeros(len(part.triangles))
    for face in part.faces:
        if face.kind == "cylinder":
            corners = part.vertices_m[part.triangles[face.triangles]] - face.origin_m
            across = corners - (corners @ face.axis)[..., None] * np.asarray(face.axis)
            middles = (across + across[:, [1, 2, 0]]) / 2
            nearest = np.linalg.norm(middles, axis=2).min(axis=1)
            chords[face.triangles] = np.maximum(0.0, face.radius_m - nearest) * 1000
    return chords


def _mask_flat(part: Part) -> NDArray[np.bool_]:
    is_flat = np.zeros(len(part.triangles), dtype=np.bool_)
    for face in part.faces:
        if face.kind == "plane":
            is_flat[face.triangles] = True
    return is_flat


def _merge_directions(normals: Floats, areas: Floats) -> Floats:
    """Return the distinct directions among normals, the largest area first."""
    left = np.arange(len(normals))
    directions: list[Floats] = []
    weights: list[float] = []
    while len(left) and len(directions) < 4 * _NORMALS:
        close = normals[left] @ normals[left[0]] > np.cos(_NORMAL_RAD)
        mean = (normals[left[close]] * areas[left[close], None]).sum(axis=0)
        directions.append(mean / np.linalg.norm(mean))
        weights.append(float(areas[left[close]].sum()))
        left = left[~close]
    order = np.argsort(-np.round(weights, 6), kind="stable")[:_NORMALS]
    return np.array(directions)[order]


def _select_spread(points: Floats) -> Floats:
    """Return some points far from each other, corners of the contact first."""
    if len(points) <= _POINTS:
        return points
    chosen = [int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    gap = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < _POINTS:
        chosen.append(int(np.argmax(gap)))
        gap = np.minimum(gap, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return points[chosen]


# Smallest share of flat area in a flat contact.
_FLAT_SHARE = 0.5


def find_contacts(
    product: Product, test: BlockingTest, fits: Sequence[CylinderFit], tolerance_m: float
) -> tuple[Contact, ...]:
    """Return the contacts of a product.

    Parameters
    ----------
    tolerance_m
        Largest distance between touching surfaces [m].
    """
    touching = TouchTest(product, test.meshes, test.middle_m, max(tolerance_m, 2 * product.chord_m))
    overlaps = Overlaps(product, test.meshes, test.middle_m)
    by_pair: dict[tuple[int, int], list[CylinderFit]] = defaultdict(list)
    for fit in fits:
        by_pair[min(fit.inner, fit.outer), max(fit.inner, fit.outer)].append(fit)
    contacts = []
    for first, second in touching.list_near_pairs():
        touch = touching.find_touch(first, second)
        shared = overlaps.intersect(first, second)
        inside = [
            fit
            for fit in by_pair.get((first, second), ())
            if fit.radius_difference_m <= max(tolerance_m, 0.05 * fit.shaft.radius_m)
        ]
        if touch is None and shared is None and not inside:
            continue
        contacts.append(
            _build_contact(product, (first, second), touch, shared, inside, test.middle_m)
        )
    return tuple(contacts)


def _build_contact(
    product: Product,
    pair: tuple[int, int],
    touch: Touch | None,
    shared: Overlap | None,
    fits: Sequence[CylinderFit],
    middle_m: Floats,
) -> Contact:
    kind: ContactKind = "free"
    fit = max(
        fits, key=lambda candidate: candidate.length_m * candidate.shaft.radius_m, default=None
    )
    if fit is not None:
        kind = "cylinder"
    elif touch is not None and touch.flat_share >= _FLAT_SHARE:
        kind = "plane"
    return Contact(
        parts=(product.parts[pair[0]].name, product.parts[pair[1]].name),
        kind=kind,
        area_m2=touch.area_mm2 / 1e6 if touch is not None else 0.0,
        normals=tuple(_vector(normal) for normal in touch.normals) if touch is not None else (),
        axis=fit.shaft.axis if fit is not None else None,
        axis_point_m=_find_middle(fit) if fit is not None else None,
        radius_m=fit.shaft.radius_m if fit is not None else None,
        radius_difference_m=fit.radius_difference_m if fit is not None else None,
        points_m=()
        if touch is None
        else tuple(_vector(point) for point in touch.points_mm / 1000 + middle_m),
        overlap_m3=shared.volume_mm3 / 1e9 if shared is not None else 0.0,
        overlap_surface_m2=shared.surface_mm2 / 1e6 if shared is not None else 0.0,
        overlap_allowed_m3=shared.allowed_mm3 / 1e9 if shared is not None else 0.0,
        overlap_point_m=_vector(shared.middle_mm / 1000) if shared is not None else None,
        overlap_depth_m=shared.depth_mm / 1000 if shared is not None else 0.0,
        overlap_thickness_m=shared.thickness_mm / 1000 if shared is not None else 0.0,
        overlap_section_m=shared.section_mm / 1000 if shared is not None else 0.0,
    )


def _find_middle(fit: CylinderFit) -> Vector:
    along = sum(fit.shared_m) / 2
    return _vector(np.asarray(fit.shaft.origin_m) + along * np.asarray(fit.shaft.axis))


def _vector(numbers: Floats) -> Vector:
    x, y, z = (float(number) for number in numbers)
    return x, y, z
