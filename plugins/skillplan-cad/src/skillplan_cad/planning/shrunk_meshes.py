"""Shrink meshes by moving faces inwards, so that touching parts do not collide.

For coal, meshes are surfaces without volume, and its security margin is unreliable on triangle
trees. Shrinking beforehand separates parts that only touch.
"""

from __future__ import annotations

import coal
import numpy as np
from numpy.typing import NDArray

from skillplan_cad.product import Part, Points, Triangles

# Limit for corners between almost opposite faces, which would move far away.
_FARTHEST_OFFSETS = 4.0


def shrink_mesh(vertices_m: Points, triangles: Triangles, inset_m: float) -> Points:
    """Return vertices moved so that each face is an inset farther inside.

    Parameters
    ----------
    vertices_m, triangles
        Closed mesh with merged vertices and outward triangles.
    inset_m
        Distance of the faces' move along their normals [m].
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
    angles = _compute_angles(corners[sound])
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


def _compute_angles(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the angle at each corner of triangles [rad]."""
    angles = np.empty(corners.shape[:2])
    for corner in range(3):
        first = corners[:, (corner + 1) % 3] - corners[:, corner]
        second = corners[:, (corner + 2) % 3] - corners[:, corner]
        cosines = np.einsum("ij,ij->i", first, second)
        sines = np.linalg.norm(np.cross(first, second), axis=1)
        angles[:, corner] = np.arctan2(sines, cosines)
    return angles


class MeshTree:
    """A mesh as a triangle tree of coal, with its bounding box.

    Parameters
    ----------
    vertices_m, triangles
        Mesh in the product's frame.

    Attributes
    ----------
    size
        Number of triangles.
    """

    def __init__(self, name: str, vertices_m: Points, triangles: Triangles) -> None:
        self.name = name
        self.vertices_m = vertices_m
        self.size = len(triangles)
        points, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
        points.extend(list(vertices_m))
        faces.extend([coal.Triangle(a, b, c) for a, b, c in triangles.tolist()])
        self.tree = coal.BVHModelOBBRSS()
        self.tree.beginModel(len(triangles), len(vertices_m))
        self.tree.addSubModel(points, faces)
        self.tree.endModel()
        self.low_m, self.high_m = vertices_m.min(axis=0), vertices_m.max(axis=0)


class MeshTrees:
    """Shrunk meshes of parts, each built once.

    Parameters
    ----------
    inset_m
        Distance of the faces' move along their normals [m].
    """

    def __init__(self, inset_m: float) -> None:
        self._inset_m = inset_m
        self._trees: dict[str, MeshTree] = {}

    def get(self, part: Part) -> MeshTree:
        """Return the shrunk mesh of a part."""
        if part.name not in self._trees:
            points = shrink_mesh(part.vertices_m, part.triangles, self._inset_m)
            self._trees[part.name] = MeshTree(part.name, points, part.triangles)
        return self._trees[part.name]
