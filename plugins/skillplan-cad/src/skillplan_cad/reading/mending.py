"""Repair meshes: merge vertices, turn triangles outwards, remove degenerate ones, close gaps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from skillplan_cad.product import Face, Points, Triangles
from skillplan_cad.reading.raw_part import RawPart, compute_area_vectors_m2

# Distances below which vertices are merged, in part sizes; coordinates have single precision.
_SAME, _NEARLY_SAME = 1e-7, 2e-6
# Largest share of the surface in filled holes; larger holes are missing faces.
_MOST_FILLED = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Mended:
    """A part with its mesh repaired as far as possible.

    Parameters
    ----------
    part
        Part with merged vertices and outward triangles.
    open_edges
        Number of edges without a triangle on one side; 0 if the mesh is closed.
    bodies
        Body number of each triangle; cavities belong to their body.
    """

    part: RawPart
    open_edges: int
    gap_point_m: NDArray[np.float64]
    bodies: NDArray[np.int64]
    notes: tuple[str, ...] = ()


def mend(part: RawPart) -> Mended:
    """Return a part with a closed mesh, or with its open edges."""
    notes: list[str] = []
    repaired = _merge_vertices(part, _SAME)
    if len(_find_open_edges(repaired.triangles)):
        repaired = _merge_vertices(part, _NEARLY_SAME)
    if len(_find_open_edges(repaired.triangles)):
        repaired, added = _repair(repaired)
        if added:
            notes.append(f"{part.name}: {added} triangles were added to close holes")
    gaps = _find_open_edges(repaired.triangles)
    bodies = np.zeros(len(repaired.triangles), dtype=np.int64)
    middle = np.zeros(3)
    if len(gaps):
        middle = repaired.vertices_m[gaps[0]].mean(axis=0)
    elif len(repaired.triangles):
        repaired, bodies = _turn_outwards(repaired)
    return Mended(repaired, len(gaps), middle, bodies, tuple(notes))


def compute_volumes_m3(vertices_m: Points, triangles: Triangles) -> NDArray[np.float64]:
    """Return the signed volume between each triangle and the centre of the mesh."""
    middle = vertices_m.mean(axis=0)
    a, b, c = (vertices_m[triangles[:, corner]] - middle for corner in range(3))
    return np.asarray(np.einsum("ij,ij->i", a, np.cross(b, c)) / 6)


def compute_centre_m(vertices_m: Points, triangles: Triangles) -> NDArray[np.float64]:
    """Return the centroid of the volume of a closed mesh."""
    middle = vertices_m.mean(axis=0)
    volumes = compute_volumes_m3(vertices_m, triangles)
    corners = (vertices_m[triangles] - middle).sum(axis=1) / 4
    return np.asarray(middle + (volumes[:, None] * corners).sum(axis=0) / volumes.sum())


def split(repaired: Mended) -> list[RawPart]:
    """Return the bodies of a part as separate parts."""
    part = repaired.part
    return [
        _select_triangles(
            replace(part, name=f"{part.name}.{number + 1}"),
            repaired.bodies == number,
            part.triangles,
        )
        for number in range(int(repaired.bodies.max()) + 1)
    ]


def _merge_vertices(part: RawPart, share: float) -> RawPart:
    """Return a part with close vertices merged."""
    vertices = part.vertices_m
    size = float(np.ptp(vertices, axis=0).max()) or 1.0
    cells = np.round((vertices - vertices.min(axis=0)) / (size * share)).astype(np.int64)
    _, first, which = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    which = which.reshape(-1)
    points = vertices[first]
    # Close vertices may lie in neighbouring cells.
    pairs = cKDTree(points).query_pairs(size * share, output_type="ndarray")
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(points),) * 2)
    count, label = connected_components(graph, directed=False)
    kept = np.full(count, len(points))
    np.minimum.at(kept, label, np.arange(len(points)))
    triangles = label[which][part.triangles]
    whole = (
        (triangles[:, 0] != triangles[:, 1])
        & (triangles[:, 1] != triangles[:, 2])
        & (triangles[:, 2] != triangles[:, 0])
    )
    merged = replace(part, vertices_m=points[kept])
    return _select_triangles(merged, whole, triangles)


def _select_triangles(part: RawPart, chosen: NDArray[np.bool_], triangles: Triangles) -> RawPart:
    """Return a part with only the chosen triangles and their vertices."""
    number = np.cumsum(chosen) - 1
    faces = []
    for face in part.faces:
        left = face.triangles[chosen[face.triangles]]
        if len(left):
            faces.append(replace(face, triangles=number[left]))
    used, renumbered = np.unique(triangles[chosen], return_inverse=True)
    return replace(
        part,
        vertices_m=part.vertices_m[used],
        triangles=renumbered.reshape(-1, 3).astype(np.int64),
        faces=tuple(faces),
    )


def _find_open_edges(triangles: Triangles) -> NDArray[np.int64]:
    """Return the edges, as vertex pairs, that triangles do not pass equally often each way."""
    if not len(triangles):
        return np.zeros((0, 2), dtype=np.int64)
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    forward = edges[:, 0] < edges[:, 1]
    ordered = np.sort(edges, axis=1)
    unique, which = np.unique(ordered, axis=0, return_inverse=True)
    balance = np.zeros(len(unique), dtype=np.int64)
    np.add.at(balance, which.reshape(-1), np.where(forward, 1, -1))
    return np.asarray(unique[balance != 0], dtype=np.int64)


def _repair(part: RawPart) -> tuple[RawPart, int]:
    """Return a part with consistent triangles and small holes filled, and the triangles added."""
    import trimesh

    mesh: Any = trimesh.Trimesh(part.vertices_m, part.triangles, process=False)
    repair: Any = trimesh.repair
    repair.fix_winding(mesh)
    repair.fill_holes(mesh)
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    triangles = np.asarray(mesh.faces, dtype=np.int64)
    added = len(triangles) - len(part.triangles)
    if len(_find_open_edges(triangles)) >= len(_find_open_edges(part.triangles)):
        return part, 0
    areas = np.linalg.norm(compute_area_vectors_m2(vertices, triangles), axis=1)
    if areas[len(part.triangles) :].sum() > _MOST_FILLED * areas.sum():
        return part, 0
    faces = part.faces
    if added and faces:
        extra = np.arange(len(part.triangles), len(triangles))
        faces = (*faces, Face("free", extra))
    return replace(part, vertices_m=vertices, triangles=triangles, faces=faces), added


def _turn_outwards(part: RawPart) -> tuple[RawPart, NDArray[np.int64]]:
    """Return a closed part with outward triangles, and the body of each triangle.

    A shell of negative volume inside another is a cavity of it, not a body.
    """
    triangles = part.triangles
    graph = coo_matrix(
        (np.ones(2 * len(triangles)), (triangles[:, [0, 1]].ravel(), triangles[:, [1, 2]].ravel())),
        shape=(len(part.vertices_m),) * 2,
    )
    count, of_vertex = connected_components(graph, directed=False)
    shell = of_vertex[triangles[:, 0]]
    volume = np.bincount(shell, compute_volumes_m3(part.vertices_m, triangles), count)
    if volume.sum() < 0:
        triangles, volume = triangles[:, ::-1].copy(), -volume
        part = replace(part, triangles=triangles)
    solid = np.flatnonzero(volume > 0)
    low = np.stack([part.vertices_m[of_vertex == number].min(axis=0) for number in range(count)])
    high = np.stack([part.vertices_m[of_vertex == number].max(axis=0) for number in range(count)])
    body = np.zeros(count, dtype=np.int64)
    body[solid] = np.arange(len(solid))
    for cavity in np.flatnonzero(volume <= 0):
        around = [
            number
            for number in solid
            if (low[number] <= low[cavity] + 1e-12).all()
            and (high[number] >= high[cavity] - 1e-12).all()
        ]
        if around:
            body[cavity] = body[min(around, key=lambda shell_number: volume[shell_number])]
    return part, body[shell]
