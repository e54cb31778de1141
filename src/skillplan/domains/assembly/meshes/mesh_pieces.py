"""Convex pieces of a polyhedron, from a file beside its own."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path

import numpy as np

from skillplan.domains.assembly.meshes.mesh_files import content_of, parsed
from skillplan.domains.assembly.meshes.polyhedron import (
    DECIMALS,
    Indices,
    MeshFileError,
    Polyhedron,
    polyhedron_of,
)
from skillplan.task.motion import Point

MAX_PIECES = 512
"""Most convex pieces of a polyhedron."""

# How far the box about pieces may be off, of the greatest extent.
_PIECES_OFF = 1e-3


def read_pieces(
    folder: Path, name: str | None, scale: float, whole: Polyhedron
) -> tuple[tuple[Polyhedron, ...], str]:
    """Return the convex pieces of a polyhedron, about its middle, and the hash of their file.

    Parameters
    ----------
    folder, name, scale
        As of `read_mesh`; a name of None has no pieces. What hangs together in the file by its
        corners' numbers is a piece.
    whole
        What they are pieces of, in the frame of the same file.

    Raises
    ------
    MeshFileError
        If the file lies elsewhere, cannot be read, holds a piece that is not closed and convex, or
        more than `MAX_PIECES`, or pieces that do not fill the box about the whole.
    """
    if name is None:
        return (), ""
    try:
        content, suffix = content_of(folder, name)
    except MeshFileError as error:
        raise MeshFileError(str(error), "pieces") from None
    return _pieces(content, suffix, scale, whole.middle, whole.size)


# Identical parts have files of the same content.
@lru_cache(maxsize=16)
def _pieces(
    content: bytes, suffix: str, scale: float, middle: Point, size: Point
) -> tuple[tuple[Polyhedron, ...], str]:
    raw_corners, raw_faces = parsed(content, suffix)
    corners = np.round(raw_corners * scale - np.array(middle), DECIMALS) + 0.0
    groups = _components(raw_faces, len(corners))
    if not 0 < len(groups) <= MAX_PIECES:
        raise MeshFileError(f"It holds {len(groups):,} pieces; give 1 to {MAX_PIECES:,}.", "pieces")
    found = []
    for number, faces in enumerate(groups, 1):
        try:
            piece = polyhedron_of(corners, faces, "")
        except MeshFileError as error:
            raise MeshFileError(f"Piece {number}: {error}", "pieces") from None
        if not piece.convex:
            raise MeshFileError(f"Piece {number} is not convex; cut it further.", "pieces")
        found.append(piece)
    points = np.concatenate([piece.corners for piece in found])
    off = np.abs(np.ptp(points, axis=0) - np.array(size)).max()
    off = max(float(off), float(np.abs(points.max(axis=0) + points.min(axis=0)).max()))
    if off > _PIECES_OFF * max(size):
        raise MeshFileError(
            f"The box about all pieces is {off * 1e3:.3g} mm off that about the mesh; give pieces "
            "of this mesh, in its frame.",
            "pieces",
        )
    return tuple(found), hashlib.sha256(content).hexdigest()


def _components(faces: Indices, count: int) -> list[Indices]:
    """Return faces by what hangs together, in the order of the file."""
    owner = np.arange(count)
    while True:
        least = owner[faces].min(axis=1)
        before = owner.copy()
        for column in range(3):
            np.minimum.at(owner, faces[:, column], least)
        if (owner == before).all():
            break
    labels = owner[faces[:, 0]]
    _, first = np.unique(labels, return_index=True)
    return [faces[labels == labels[index]] for index in np.sort(first)]
