"""The contacts of a product: what touches, as what, and by how much it overlaps."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan_cad.blocking.all_pairs import BlockingTest
from skillplan_cad.blocking.ray_mesh import Floats, RayMesh
from skillplan_cad.joints.cylinder_fits import CylinderFit
from skillplan_cad.product import Part, Product, Vector
from skillplan_cad.relation import Contact, ContactKind

# Less than this is rounding [mm3].
_NOISE_MM3 = 1e-3


class Overlaps:
    """Intersections of a product's parts.

    Parameters
    ----------
    product
        The product.
    """

    def __init__(self, product: Product) -> None:
        self._product = product
        self._solids: dict[int, Any] = {}

    def between(self, first: int, second: int) -> tuple[float, float, Floats] | None:
        """Return the volume [mm3], the surface [mm2] and the middle [mm] of an overlap, or None.

        Parameters
        ----------
        first, second
            Numbers of the parts.
        """
        one, two = self._solid(first), self._solid(second)
        if one is None or two is None:
            return None
        shared = one ^ two
        volume = float(shared.volume())
        if volume < _NOISE_MM3:
            return None
        box = np.asarray(shared.bounding_box(), dtype=np.float64)
        return volume, float(shared.surface_area()), (box[:3] + box[3:]) / 2

    def _solid(self, number: int) -> Any:
        if number not in self._solids:
            self._solids[number] = _solid(self._product.parts[number])
        return self._solids[number]


def _solid(part: Part) -> Any:
    """Return a part as manifold3d has it, or None where it takes it for no solid."""
    import manifold3d

    mesh = manifold3d.Mesh64(
        vert_properties=np.ascontiguousarray(part.vertices_m * 1000),
        tri_verts=np.ascontiguousarray(part.triangles, dtype=np.uint64),
    )
    made = manifold3d.Manifold(mesh)
    return None if made.is_empty() else made


# Points on a part's surface, and how squarely surfaces look at each other where they touch.
_SAMPLES, _FACING = 4000, -0.7
_NORMALS, _NORMAL_RAD, _POINTS = 24, 0.1, 32


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Points on the surface of a part, about the product's middle [mm]."""

    points_mm: Floats
    normals: Floats
    areas_mm2: Floats
    triangles: NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Touch:
    """Where the first part of a pair touches the second.

    Parameters
    ----------
    area_mm2
        Of the surface that lies on the other part.
    normals
        Distinct normals out of the first part, the largest area first.
    points_mm
        Points of it, spread.
    flat_share
        How much of it is flat on both sides, from 0 to 1.
    """

    area_mm2: float
    normals: Floats
    points_mm: Floats
    flat_share: float


class TouchTest:
    """Looks for touching surfaces of a product's parts.

    Parameters
    ----------
    product
        The product.
    meshes
        Its parts as rays see them.
    middle_m
        What is the origin of these.
    reach_m
        How far apart touching surfaces may be.
    """

    def __init__(
        self, product: Product, meshes: list[RayMesh], middle_m: Floats, reach_m: float
    ) -> None:
        self._meshes, self._reach_mm = meshes, reach_m * 1000
        self._samples = [_samples(part, mesh) for part, mesh in zip(product, meshes, strict=True)]
        self._flat = [_flat_triangles(part) for part in product.parts]
        self._low = np.stack([mesh.points_mm.min(axis=0) for mesh in meshes]) - self._reach_mm
        self._high = np.stack([mesh.points_mm.max(axis=0) for mesh in meshes]) + self._reach_mm

    def near(self) -> list[tuple[int, int]]:
        """Return the pairs whose boxes meet."""
        count = len(self._meshes)
        return [
            (first, second)
            for first in range(count)
            for second in range(first + 1, count)
            if (self._low[first] <= self._high[second]).all()
            and (self._low[second] <= self._high[first]).all()
        ]

    def touch(self, first: int, second: int) -> Touch | None:
        """Return where two parts touch, or None; asked from both sides, for small parts."""
        there = self._onto(first, second)
        back = self._onto(second, first)
        area = max(there[3], back[3])
        if area <= 0:
            return None
        points, normals, areas, _, flat = there if there[3] >= back[3] else back
        if there[3] < back[3]:
            normals = -normals
        return Touch(area, _distinct(normals, areas), _spread(points), flat)

    def _onto(self, first: int, second: int) -> tuple[Floats, Floats, Floats, float, float]:
        samples = self._samples[first]
        inside = (samples.points_mm >= self._low[second]).all(axis=1) & (
            samples.points_mm <= self._high[second]
        ).all(axis=1)
        points, normals = samples.points_mm[inside], samples.normals[inside]
        hit, distance = self._meshes[second].meets(points - self._reach_mm * normals, normals)
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
    # Additive recurrence of the plastic number: evenly spread, the same on every run.
    u, v = (order * 0.7548776662466927 + 0.5) % 1, (order * 0.5698402909980532 + 0.5) % 1
    over = u + v > 1
    u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    points = a[which] + u[:, None] * ab[which] + v[:, None] * ac[which]
    return Samples(points, mesh.normals[which], (area / count)[which], which)


def _flat_triangles(part: Part) -> NDArray[np.bool_]:
    found = np.zeros(len(part.triangles), dtype=np.bool_)
    for face in part.faces:
        if face.kind == "plane":
            found[face.triangles] = True
    return found


def _distinct(normals: Floats, areas: Floats) -> Floats:
    """Return the distinct directions among normals, those of most area first."""
    left = np.arange(len(normals))
    found: list[Floats] = []
    weights: list[float] = []
    while len(left) and len(found) < 4 * _NORMALS:
        close = normals[left] @ normals[left[0]] > np.cos(_NORMAL_RAD)
        mean = (normals[left[close]] * areas[left[close], None]).sum(axis=0)
        found.append(mean / np.linalg.norm(mean))
        weights.append(float(areas[left[close]].sum()))
        left = left[~close]
    order = np.argsort(-np.round(weights, 6), kind="stable")[:_NORMALS]
    return np.array(found)[order]


def _spread(points: Floats) -> Floats:
    """Return some of the points that lie far from each other, corners of the contact first."""
    if len(points) <= _POINTS:
        return points
    chosen = [int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    gap = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < _POINTS:
        chosen.append(int(np.argmax(gap)))
        gap = np.minimum(gap, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return points[chosen]


# A contact is flat where this share of its area is.
_FLAT_SHARE = 0.5


def contacts_of(
    product: Product, test: BlockingTest, fits: Sequence[CylinderFit], tolerance_m: float
) -> tuple[Contact, ...]:
    """Return the contacts of a product.

    Parameters
    ----------
    product
        The product.
    test
        Its parts as rays see them.
    fits
        Cylinders in holes.
    tolerance_m
        How far apart surfaces may be that touch.
    """
    touching = TouchTest(product, test.meshes, test.middle_m, max(tolerance_m, 2 * product.chord_m))
    overlaps = Overlaps(product)
    by_pair: dict[tuple[int, int], list[CylinderFit]] = defaultdict(list)
    for fit in fits:
        by_pair[min(fit.inner, fit.outer), max(fit.inner, fit.outer)].append(fit)
    found = []
    for first, second in touching.near():
        touch = touching.touch(first, second)
        shared = overlaps.between(first, second)
        inside = [
            fit
            for fit in by_pair.get((first, second), ())
            if fit.radius_difference_m <= max(tolerance_m, 0.05 * fit.shaft.radius_m)
        ]
        if touch is None and shared is None and not inside:
            continue
        found.append(_contact(product, (first, second), touch, shared, inside, test.middle_m))
    return tuple(found)


def _contact(
    product: Product,
    pair: tuple[int, int],
    touch: Touch | None,
    shared: tuple[float, float, Floats] | None,
    fits: Sequence[CylinderFit],
    middle_m: Floats,
) -> Contact:
    kind: ContactKind = "free"
    fit = max(fits, key=lambda one: one.length_m * one.shaft.radius_m, default=None)
    if fit is not None:
        kind = "cylinder"
    elif touch is not None and touch.flat_share >= _FLAT_SHARE:
        kind = "plane"
    volume, surface, place = shared if shared is not None else (0.0, 0.0, None)
    return Contact(
        parts=(product.parts[pair[0]].name, product.parts[pair[1]].name),
        kind=kind,
        area_m2=touch.area_mm2 / 1e6 if touch is not None else 0.0,
        normals=tuple(_vector(one) for one in touch.normals) if touch is not None else (),
        axis=fit.shaft.axis if fit is not None else None,
        axis_point_m=_middle_of(fit) if fit is not None else None,
        radius_m=fit.shaft.radius_m if fit is not None else None,
        radius_difference_m=fit.radius_difference_m if fit is not None else None,
        points_m=()
        if touch is None
        else tuple(_vector(one) for one in touch.points_mm / 1000 + middle_m),
        overlap_m3=volume / 1e9,
        overlap_surface_m2=surface / 1e6,
        # Both sides of the overlap may each be off by a chord.
        overlap_allowed_m3=surface / 2 / 1e6 * 2 * product.chord_m,
        overlap_point_m=None if place is None else _vector(place / 1000),
    )


def _middle_of(fit: CylinderFit) -> Vector:
    along = sum(fit.shared_m) / 2
    return _vector(np.asarray(fit.shaft.origin_m) + along * np.asarray(fit.shaft.axis))


def _vector(numbers: Floats) -> Vector:
    x, y, z = (float(one) for one in numbers)
    return x, y, z
