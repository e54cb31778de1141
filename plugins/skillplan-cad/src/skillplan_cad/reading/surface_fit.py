"""Fit planes and cylinders to patches of triangles that CAD does not describe."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from skillplan.collision.contact_forces import find_axes_across
from skillplan_cad.product import Face, Points, Triangles, Vector
from skillplan_cad.reading.raw_part import compute_area_vectors_m2

# Largest angle between triangles of one plane, and of one curved face.
_FLAT_RAD, _SMOOTH_RAD = 1e-3, 0.65
# Smallest number of facets of a cylinder; largest deviation of corners from it, in radii.
_LEAST_FACETS, _ROUND = 6, 0.02


def fit_faces(vertices_m: Points, triangles: Triangles) -> tuple[Face, ...]:
    """Return planes, cylinders and free faces of a mesh."""
    vectors = compute_area_vectors_m2(vertices_m, triangles)
    areas = np.linalg.norm(vectors, axis=1)
    normals = vectors / np.where(areas > 0, areas, 1.0)[:, None]
    first, second = _find_neighbours(triangles)
    angle = np.arccos(np.clip(np.einsum("ij,ij->i", normals[first], normals[second]), -1, 1))
    facet = _find_components(first, second, angle < _FLAT_RAD, len(triangles))
    patch = _find_components(first, second, angle < _SMOOTH_RAD, len(triangles))
    faces: list[Face] = []
    for number in np.unique(patch):
        chosen = np.flatnonzero(patch == number)
        faces += _fit_patch(vertices_m, triangles, normals, areas, facet, chosen)
    return tuple(faces)


def recognise_face(face: Face, vertices_m: Points, triangles: Triangles) -> Face:
    """Return a face with its surface, if a free face is a plane or cylinder."""
    if face.kind == "free":
        vectors = compute_area_vectors_m2(vertices_m, triangles[face.triangles])
        areas = np.linalg.norm(vectors, axis=1)
        normals = vectors / np.where(areas > 0, areas, 1.0)[:, None]
        mean = vectors.sum(axis=0)
        length = float(np.linalg.norm(mean))
        if length > (1 - 1e-7) * areas.sum() > 0:
            face = _build_plane(vertices_m, triangles, face.triangles, mean / length)
        else:
            cylinder = _fit_cylinder(vertices_m, triangles, face.triangles, normals, areas)
            face = cylinder if cylinder is not None else face
    return measure_face(face, vertices_m, triangles)


def measure_face(face: Face, vertices_m: Points, triangles: Triangles) -> Face:
    """Return a face with its extents along and around the axis, and its side."""
    if face.kind in ("free", "sphere"):
        return face
    corners = vertices_m[np.unique(triangles[face.triangles])] - face.origin_m
    axis = np.asarray(face.axis)
    along = corners @ axis
    extent = (float(along.min()), float(along.max()))
    if face.kind == "plane":
        # The winding of the mesh defines the outside.
        outwards = compute_area_vectors_m2(vertices_m, triangles[face.triangles]).sum(axis=0) @ axis
        return replace(face, axis=_vector(axis if outwards > 0 else -axis), extent_m=(0.0, 0.0))
    across = corners - along[:, None] * axis
    middle = vertices_m[triangles[face.triangles]].mean(axis=1) - face.origin_m
    middle -= (middle @ axis)[:, None] * axis
    vectors = compute_area_vectors_m2(vertices_m, triangles[face.triangles])
    inwards = float(np.einsum("ij,ij->", middle, vectors)) < 0
    return replace(face, extent_m=extent, turn_rad=_measure_turn(across, axis), hollow=inwards)


def _fit_patch(
    vertices_m: Points,
    triangles: Triangles,
    normals: NDArray[np.float64],
    areas: NDArray[np.float64],
    facet: NDArray[np.int64],
    chosen: NDArray[np.int64],
) -> list[Face]:
    """Return a patch as a cylinder, as planes, or as a free face."""
    facets = np.unique(facet[chosen])
    if len(facets) >= _LEAST_FACETS:
        cylinder = _fit_cylinder(vertices_m, triangles, chosen, normals[chosen], areas[chosen])
        if cylinder is not None:
            return [measure_face(cylinder, vertices_m, triangles)]
        if len(facets) > len(chosen) / 4:
            return [Face("free", chosen)]
    faces = []
    for number in facets:
        own = chosen[facet[chosen] == number]
        vector = (normals[own] * areas[own, None]).sum(axis=0)
        length = float(np.linalg.norm(vector))
        faces.append(
            _build_plane(vertices_m, triangles, own, vector / length)
            if length > 0
            else Face("free", own)
        )
    return faces


def _build_plane(
    vertices_m: Points, triangles: Triangles, chosen: NDArray[np.int64], normal: NDArray[np.float64]
) -> Face:
    return Face("plane", chosen, _vector(vertices_m[triangles[chosen[0], 0]]), _vector(normal))


def _fit_cylinder(
    vertices_m: Points,
    triangles: Triangles,
    chosen: NDArray[np.int64],
    normals: NDArray[np.float64],
    areas: NDArray[np.float64],
) -> Face | None:
    """Fit a cylinder to triangles: axis from the normals, then a circle; None if it fails."""
    if len(chosen) < _LEAST_FACETS:
        return None
    weighted = normals * np.sqrt(areas / areas.sum())[:, None]
    # Full matrices would have one row and column per triangle.
    _, values, rows = np.linalg.svd(weighted, full_matrices=False)
    if values[2] > 0.02 or values[1] < 0.05:
        return None
    axis = rows[2]
    corners = vertices_m[np.unique(triangles[chosen])]
    x, y = rows[0], rows[1]
    flat = np.stack([corners @ x, corners @ y], axis=1)
    middle = flat.mean(axis=0)
    flat = flat - middle
    system = np.column_stack([2 * flat, np.ones(len(flat))])
    solved, *_ = np.linalg.lstsq(system, (flat**2).sum(axis=1), rcond=None)
    radius = float(np.sqrt(max(solved[2] + solved[:2] @ solved[:2], 0.0)))
    gaps = np.abs(np.linalg.norm(flat - solved[:2], axis=1) - radius)
    if radius <= 0 or gaps.max() > _ROUND * radius:
        return None
    centre = (middle + solved[:2]) @ np.stack([x, y])
    return Face("cylinder", chosen, _vector(centre), _vector(axis), radius)


def _measure_turn(across: Points, axis: NDArray[np.float64]) -> float:
    """Return the angle covered by points around an axis; gaps of the usual width do not count."""
    first, second = find_axes_across(_vector(axis))
    angles = np.unique(np.round(np.arctan2(across @ second, across @ first), 4))
    if len(angles) < 3:
        return 0.0
    gaps = np.diff(np.append(angles, angles[0] + 2 * np.pi))
    widest, usual = float(gaps.max()), float(np.median(gaps))
    return 2 * np.pi if widest <= max(1.5 * usual, 0.7) else 2 * np.pi - widest


def _find_neighbours(triangles: Triangles) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the pairs of triangles with a common edge."""
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(triangles)), 3)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    same = (edges[order[1:]] == edges[order[:-1]]).all(axis=1)
    return owner[order[:-1][same]], owner[order[1:][same]]


def _find_components(
    first: NDArray[np.int64], second: NDArray[np.int64], joined: NDArray[np.bool_], count: int
) -> NDArray[np.int64]:
    pairs = (first[joined], second[joined])
    graph = coo_matrix((np.ones(int(joined.sum())), pairs), shape=(count, count))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _vector(numbers: NDArray[np.float64]) -> Vector:
    x, y, z = (float(number) for number in numbers)
    return x, y, z
