"""Points just inside the outline of a part, as seen along a direction.

A link narrower than the lattice is bounded by an outline of one of its parts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skillplan_cad.blocking.ray_mesh import Floats, RayMesh, RayView

# A face that faces a direction less than this stands along it.
_ALONG = 1e-6


class Outline:
    """Edges at which a part's surface turns from one side of a direction to the other.

    Parameters
    ----------
    mesh
        The part.
    view
        The part as rays along the direction see it.
    edges
        Of the mesh: ends of each edge and its two triangles, as `mesh_edges` has them.
    """

    def __init__(self, mesh: RayMesh, view: RayView, edges: NDArray[np.int64]) -> None:
        facing, flat = view.facing, view.flat
        side = np.where(np.abs(facing) < _ALONG, 0, np.sign(facing)).astype(np.int64)
        first, second = edges[:, 2], edges[:, 3]
        turned = edges[side[first] != side[second]]
        self.start, self.end = flat[turned[:, 0]], flat[turned[:, 1]]
        along = self.end - self.start
        length = np.linalg.norm(along, axis=1)
        kept = length > 1e-9
        turned, along, length = turned[kept], along[kept], length[kept]
        self.start, self.end, self.length = self.start[kept], self.end[kept], length
        normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / length[:, None]
        # The triangle that faces the direction more lies inside the outline.
        inner = np.where(
            np.abs(facing[turned[:, 2]]) >= np.abs(facing[turned[:, 3]]),
            turned[:, 2],
            turned[:, 3],
        )
        middle = flat[mesh.triangles[inner]].mean(axis=1)
        inwards = np.einsum("ij,ij->i", middle - self.start, normal) >= 0
        self.inwards = np.where(inwards[:, None], normal, -normal)

    def points(self, inset: float, low: Floats, high: Floats, most: int) -> Floats:
        """Return points inside the outline.

        Parameters
        ----------
        inset
            How far inside.
        low, high
            Corners of the rectangle that they must lie in.
        most
            How many at most, spread by the edges' lengths.
        """
        near = (np.minimum(self.start, self.end) <= high + inset).all(axis=1) & (
            np.maximum(self.start, self.end) >= low - inset
        ).all(axis=1)
        if not near.any():
            return np.zeros((0, 2))
        start, end, inwards = self.start[near], self.end[near], self.inwards[near]
        # Only what lies in the rectangle of an edge counts.
        length = self.length[near]
        ends = np.cumsum(length)
        count = min(most, max(len(length), 16))
        at = (np.arange(count) + 0.5137) * ends[-1] / count
        which = np.minimum(np.searchsorted(ends, at), len(length) - 1)
        share = 1 - (ends[which] - at) / length[which]
        chosen = start[which] + share[:, None] * (end - start)[which] + inset * inwards[which]
        inside = (chosen >= low).all(axis=1) & (chosen <= high).all(axis=1)
        return np.asarray(chosen[inside])


def mesh_edges(triangles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return every edge once: its two vertices and two triangles that share it."""
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(triangles)), 3)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    same = np.flatnonzero((edges[order[1:]] == edges[order[:-1]]).all(axis=1))
    return np.column_stack([edges[order[same]], owner[order[same]], owner[order[same + 1]]])
