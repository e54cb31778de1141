"""Meshes whose faces are moved inwards, so that parts that touch do not collide.

They are surfaces without volume to coal, and a security margin on its trees of triangles is not
to be trusted; so parts that only touch are told apart by what is taken off them beforehand.
"""

from __future__ import annotations

from collections.abc import Sequence

import coal
import numpy as np
from numpy.typing import NDArray

from skillplan_cad.product import Part, Points, Triangles

# A corner between faces that nearly lie against each other would go far away.
_FARTHEST_OFFSETS = 4.0


def shrunk(vertices_m: Points, triangles: Triangles, inset_m: float) -> Points:
    """Return vertices moved so that every face about them is an inset farther inside.

    Parameters
    ----------
    vertices_m, triangles
        A closed mesh with merged vertices, triangles that look outwards.
    inset_m
        How far faces move along their normals.
    """
    corners = vertices_m[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    sound = lengths > 0
    normals = normals[sound] / lengths[sound, None]
    # Least squares at each vertex: n . offset = -inset for all faces about it. The small term keeps
    # offsets in the span of the normals.
    square = np.zeros((len(vertices_m), 3, 3))
    right = np.zeros((len(vertices_m), 3))
    angles = _angles(corners[sound])
    for corner in range(3):
        weights = angles[:, corner]
        at = triangles[sound, corner]
        np.add.at(square, at, weights[:, None, None] * normals[:, :, None] * normals[:, None, :])
        np.add.at(right, at, weights[:, None] * normals)
    square += 1e-9 * np.eye(3)
    offsets = -inset_m * np.linalg.solve(square, right[..., None])[..., 0]
    sizes = np.linalg.norm(offsets, axis=1)
    limit = _FARTHEST_OFFSETS * inset_m
    scale = np.minimum(1.0, limit / np.maximum(sizes, 1e-30))
    return np.asarray(vertices_m + offsets * scale[:, None], dtype=np.float64)


def _angles(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angle at each corner of triangles [rad]."""
    found = np.empty(corners.shape[:2])
    for corner in range(3):
        one = corners[:, (corner + 1) % 3] - corners[:, corner]
        other = corners[:, (corner + 2) % 3] - corners[:, corner]
        cosines = np.einsum("ij,ij->i", one, other)
        sines = np.linalg.norm(np.cross(one, other), axis=1)
        found[:, corner] = np.arctan2(sines, cosines)
    return found


class MeshTree:
    """A mesh as a tree of triangles of coal, with the box about it.

    Parameters
    ----------
    name
        Of its part.
    vertices_m, triangles
        The mesh, in the product's frame.
    """

    def __init__(self, name: str, vertices_m: Points, triangles: Triangles) -> None:
        self.name = name
        self.vertices_m = vertices_m
        points, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
        for point in vertices_m:
            points.append(point)
        for a, b, c in triangles.tolist():
            faces.append(coal.Triangle(a, b, c))
        self.tree = coal.BVHModelOBBRSS()
        self.tree.beginModel(len(triangles), len(vertices_m))
        self.tree.addSubModel(points, faces)
        self.tree.endModel()
        self.low_m, self.high_m = vertices_m.min(axis=0), vertices_m.max(axis=0)


def mesh_trees(parts: Sequence[Part], inset_m: float) -> list[MeshTree]:
    """Return the shrunk meshes of parts."""
    return [
        MeshTree(part.name, shrunk(part.vertices_m, part.triangles, inset_m), part.triangles)
        for part in parts
    ]
