"""The space that a mesh passes on a straight way: its faces ahead, extruded backwards."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import manifold3d
import numpy as np
from numpy.typing import NDArray

from skillplan_cad.product import Points, read_solid

Floats = NDArray[np.float64]

# Smallest cosine between the move and the normal of a face that points ahead.
_AHEAD = 1e-6
# Smallest cosine of a face that is square to the move.
_SQUARE = 1 - 1e-9
# Number of swept faces in a union.
_MOST_AT_ONCE = 500


def list_corners(solid: manifold3d.Manifold) -> Points:
    """Return the corners of a solid's triangles, shape (n, 3, 3) [mm]."""
    points, triangles = read_solid(solid)
    return np.asarray(points[triangles])


def unite(solids: Sequence[manifold3d.Manifold]) -> manifold3d.Manifold:
    """Return the union of solids, which is made at once: no alarm ends a long one."""
    whole = manifold3d.Manifold()
    for first in range(0, len(solids), _MOST_AT_ONCE):
        some = solids[first : first + _MOST_AT_ONCE]
        whole += manifold3d.Manifold.batch_boolean(some, manifold3d.OpType.Add)
        whole.num_tri()
    return whole


def sweep_faces(
    corners: Points, along: Floats, clearance_mm: float, rooms: Floats, *, is_convex: bool
) -> list[manifold3d.Manifold]:
    """Return the space near boxes through which the faces ahead of a moved mesh come.

    Parameters
    ----------
    corners
        Corners of triangles, shape (n, 3, 3) [mm].
    rooms
        Lowest and highest corner of each box, shape (boxes, 2, 3) [mm].
    is_convex
        True if the mesh is, so that its sweep is one hull.
    """
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(across, axis=1)
    ahead = across @ along
    corners, is_square = corners[ahead > _AHEAD * lengths], ahead > _SQUARE * lengths
    is_square = is_square[ahead > _AHEAD * lengths]
    low, high = rooms[:, 0].min(axis=0), rooms[:, 1].max(axis=0)
    box = np.stack(np.meshgrid(*np.stack([low, high], axis=1)), axis=-1).reshape(-1, 3)
    length = float((corners @ along).max(initial=-np.inf) - (box @ along).min())
    if length <= 0:
        return []
    side = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    side /= np.linalg.norm(side)
    frame = np.stack([side, np.cross(along, side), along])
    around = clearance_mm * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
    offsets = np.concatenate([around @ frame[:2]] * 2)
    offsets[4:] -= along * length
    prisms = (corners[:, :, None] + offsets).reshape(1 if is_convex else len(corners), -1, 3)
    lows, highs = prisms.min(axis=1), prisms.max(axis=1)
    is_near = np.zeros(len(prisms), dtype=bool)
    for low, high in rooms:
        is_near |= (lows < high).all(axis=1) & (highs > low).all(axis=1)
    if is_convex:
        return [manifold3d.Manifold.hull_points(points) for points in prisms[is_near]]
    slanted, square = prisms[is_near & ~is_square], corners[is_near & is_square]
    return [
        *map(manifold3d.Manifold.hull_points, slanted),
        *_sweep_square(square @ frame.T, around, length, frame),
    ]


def _sweep_square(
    corners: Points, around: Floats, length: float, frame: Floats
) -> Iterator[manifold3d.Manifold]:
    """Yield the sweeps of faces square to their move, one for each height.

    Parameters
    ----------
    corners
        Corners of triangles along the axes of the frame [mm].
    around
        Offsets of the corners across the move [mm].
    frame
        Two directions across the move, and the move.
    """
    heights = np.round(corners[:, 0, 2], 6)
    for height in np.unique(heights).tolist():
        outlines = (corners[heights == height, :, None, :2] + around).reshape(-1, 12, 2)
        section = manifold3d.CrossSection.batch_boolean(
            list(map(manifold3d.CrossSection.hull_points, outlines)), manifold3d.OpType.Add
        )
        shift = frame[2] * (height - length)
        yield section.extrude(length).transform(np.column_stack([*frame, shift]))
