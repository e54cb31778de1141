"""Closed meshes out of those of files: vertices merged, triangles outwards, none degenerate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from skillplan_cad.product import Face, Points, Triangles
from skillplan_cad.reading.raw_part import RawPart, area_vectors_m2

# Vertices that lie closer are one, as a share of the part's size: coordinates are single precision.
_SAME, _NEARLY_SAME = 1e-7, 2e-6
# Holes are filled up to this share of the surface; beyond it a face is missing.
_MOST_FILLED = 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class Mended:
    """A part whose mesh was mended as far as that is possible.

    Parameters
    ----------
    part
        With merged vertices and triangles that look outwards.
    open_edges
        How many edges have no triangle on one side; 0 where it is closed.
    gap_point_m
        The middle of the first of them.
    bodies
        For every triangle the number of its body, the cavities of a body included.
    notes
        What was done to it, a sentence each.
    """

    part: RawPart
    open_edges: int
    gap_point_m: NDArray[np.float64]
    bodies: NDArray[np.int64]
    notes: tuple[str, ...] = ()


def mended(part: RawPart) -> Mended:
    """Return a part with a closed mesh, or with what keeps it from being closed."""
    notes: list[str] = []
    found = _merged(part, _SAME)
    if len(_open_edges(found.triangles)):
        found = _merged(part, _NEARLY_SAME)
    if len(_open_edges(found.triangles)):
        found, added = _repaired(found)
        if added:
            notes.append(f"{part.name}: {added} triangles were added to close holes")
    gaps = _open_edges(found.triangles)
    bodies = np.zeros(len(found.triangles), dtype=np.int64)
    middle = np.zeros(3)
    if len(gaps):
        middle = found.vertices_m[gaps[0]].mean(axis=0)
    elif len(found.triangles):
        found, bodies = _outwards(found)
    return Mended(found, len(gaps), middle, bodies, tuple(notes))


def volumes_m3(vertices_m: Points, triangles: Triangles) -> NDArray[np.float64]:
    """Return of every triangle the volume between it and the middle of the mesh, with sign."""
    middle = vertices_m.mean(axis=0)
    a, b, c = (vertices_m[triangles[:, corner]] - middle for corner in range(3))
    return np.asarray(np.einsum("ij,ij->i", a, np.cross(b, c)) / 6)


def centre_m(vertices_m: Points, triangles: Triangles) -> NDArray[np.float64]:
    """Return the centre of what a closed mesh encloses."""
    middle = vertices_m.mean(axis=0)
    volumes = volumes_m3(vertices_m, triangles)
    corners = (vertices_m[triangles] - middle).sum(axis=1) / 4
    return np.asarray(middle + (volumes[:, None] * corners).sum(axis=0) / volumes.sum())


def split(found: Mended) -> list[RawPart]:
    """Return the bodies of a part as parts of their own."""
    part = found.part
    return [
        _with_triangles(
            replace(part, name=f"{part.name}.{number + 1}"), found.bodies == number, part.triangles
        )
        for number in range(int(found.bodies.max()) + 1)
    ]


def _merged(part: RawPart, share: float) -> RawPart:
    """Return a part whose vertices are merged where they are as good as one."""
    vertices = part.vertices_m
    size = float(np.ptp(vertices, axis=0).max()) or 1.0
    cells = np.round((vertices - vertices.min(axis=0)) / (size * share)).astype(np.int64)
    _, first, which = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    which = which.reshape(-1)
    points = vertices[first]
    # Two that are as good as one may lie in neighbouring cells.
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
    return _with_triangles(merged, whole, triangles)


def _with_triangles(part: RawPart, chosen: NDArray[np.bool_], triangles: Triangles) -> RawPart:
    """Return a part with the chosen triangles only, and the vertices that they have."""
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


def _open_edges(triangles: Triangles) -> NDArray[np.int64]:
    """Return the edges, as pairs of vertices, that as many triangles do not pass each way."""
    if not len(triangles):
        return np.zeros((0, 2), dtype=np.int64)
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    forward = edges[:, 0] < edges[:, 1]
    ordered = np.sort(edges, axis=1)
    unique, which = np.unique(ordered, axis=0, return_inverse=True)
    balance = np.zeros(len(unique), dtype=np.int64)
    np.add.at(balance, which.reshape(-1), np.where(forward, 1, -1))
    return np.asarray(unique[balance != 0], dtype=np.int64)


def _repaired(part: RawPart) -> tuple[RawPart, int]:
    """Return a part with its triangles turned the same way and small holes filled."""
    import trimesh

    mesh: Any = trimesh.Trimesh(part.vertices_m, part.triangles, process=False)
    repair: Any = trimesh.repair
    repair.fix_winding(mesh)
    repair.fill_holes(mesh)
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    triangles = np.asarray(mesh.faces, dtype=np.int64)
    added = len(triangles) - len(part.triangles)
    if len(_open_edges(triangles)) >= len(_open_edges(part.triangles)):
        return part, 0
    areas = np.linalg.norm(area_vectors_m2(vertices, triangles), axis=1)
    if areas[len(part.triangles) :].sum() > _MOST_FILLED * areas.sum():
        return part, 0
    faces = part.faces
    if added and faces:
        extra = np.arange(len(part.triangles), len(triangles))
        faces = (*faces, Face("free", extra))
    return replace(part, vertices_m=vertices, triangles=triangles, faces=faces), added


def _outwards(part: RawPart) -> tuple[RawPart, NDArray[np.int64]]:
    """Return a closed part that looks outwards, and of every triangle its body.

    A shell of negative volume inside another one is a cavity of it, not a body.
    """
    triangles = part.triangles
    graph = coo_matrix(
        (np.ones(2 * len(triangles)), (triangles[:, [0, 1]].ravel(), triangles[:, [1, 2]].ravel())),
        shape=(len(part.vertices_m),) * 2,
    )
    count, of_vertex = connected_components(graph, directed=False)
    shell = of_vertex[triangles[:, 0]]
    volume = np.bincount(shell, volumes_m3(part.vertices_m, triangles), count)
    if volume.sum() < 0:
        triangles, volume = triangles[:, ::-1].copy(), -volume
        part = replace(part, triangles=triangles)
    solid = np.flatnonzero(volume > 0)
    low = np.stack([part.vertices_m[of_vertex == one].min(axis=0) for one in range(count)])
    high = np.stack([part.vertices_m[of_vertex == one].max(axis=0) for one in range(count)])
    body = np.zeros(count, dtype=np.int64)
    body[solid] = np.arange(len(solid))
    for cavity in np.flatnonzero(volume <= 0):
        around = [
            one
            for one in solid
            if (low[one] <= low[cavity] + 1e-12).all() and (high[one] >= high[cavity] - 1e-12).all()
        ]
        if around:
            body[cavity] = body[min(around, key=lambda one: volume[one])]
    return part, body[shell]
