"""A closed polyhedron, checked: its faces turned outward, and whether it is convex."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from skillplan.task.motion import Point

MAX_CORNERS = 5_000
"""Most corners of a polyhedron."""

LEAST_EXTENT_M = 1e-6
"""What is shorter is flat."""

DECIMALS = 9
"""Lengths are kept to a nanometre."""

# How far a corner may lie outside the plane of a face, of the greatest extent: files hold seven
# digits, of lengths far from the origin fewer.
_FLATNESS = 1e-5

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]


class MeshFileError(Exception):
    """A file holds no polyhedron that a part can be made of.

    Parameters
    ----------
    message
        What is wrong and what to do instead, in a sentence.
    key
        The key of the task file that is at fault, ``file`` or ``scale``.
    """

    def __init__(self, message: str, key: str = "file") -> None:
        self.key = key
        super().__init__(message)


@dataclass(frozen=True, slots=True)
class Polyhedron:
    """What a file holds.

    Parameters
    ----------
    corners
        About the centre of the smallest upright box about them [m].
    faces
        Triangles by three indices of corners each, anticlockwise from outside.
    size
        Extents of the box [m].
    sha256
        Hash of the file's content, in hexadecimal.
    convex
        Whether it is.
    middle
        Where the centre of that box is in the file [m].
    """

    corners: tuple[Point, ...]
    faces: tuple[tuple[int, int, int], ...]
    size: Point
    sha256: str
    convex: bool
    middle: Point

    def about(self, centre: Point) -> tuple[Point, ...]:
        """Return the corners when the box lies about `centre` [m], to a nanometre."""
        x_m, y_m, z_m = centre
        return tuple(
            (round(x + x_m, DECIMALS), round(y + y_m, DECIMALS), round(z + z_m, DECIMALS))
            for x, y, z in self.corners
        )


def polyhedron_of(
    raw_corners: Floats, raw_faces: Indices, sha256: str, middle: Floats | None = None
) -> Polyhedron:
    """Return a polyhedron of corners [m] and faces as a file has them, checked.

    Parameters
    ----------
    raw_corners
        Shape (n, 3), about the centre of the box.
    raw_faces
        Three indices of corners each, shape (m, 3).
    sha256, middle
        As of `Polyhedron`; a middle of None is the origin.

    Raises
    ------
    MeshFileError
        If it is not closed, has no outside or volume, or more than `MAX_CORNERS` corners.
    """
    corners, faces = _merged(raw_corners, raw_faces)
    if not len(faces):
        raise MeshFileError("It encloses no volume; give it a thickness.")
    size = corners.max(axis=0) - corners.min(axis=0)
    if len(corners) > MAX_CORNERS:
        raise MeshFileError(
            f"It has {len(corners):,} corners, where {MAX_CORNERS:,} are the most; simplify it."
        )
    faces = _outward(corners, faces)
    _check_volume(corners, faces, float(size.max()))
    return Polyhedron(
        tuple((float(x), float(y), float(z)) for x, y, z in corners),
        tuple((int(a), int(b), int(c)) for a, b, c in faces),
        (float(size[0]), float(size[1]), float(size[2])),
        sha256,
        _is_convex(corners, faces, float(size.max())),
        (0.0, 0.0, 0.0)
        if middle is None
        else (float(middle[0]), float(middle[1]), float(middle[2])),
    )


def _merged(corners: Floats, faces: Indices) -> tuple[Floats, Indices]:
    """Return corners to a nanometre, each once, and faces that still have three of them."""
    rounded = np.round(corners, DECIMALS) + 0.0
    unique, index = np.unique(rounded, axis=0, return_inverse=True)
    faces = index.reshape(-1)[faces]
    distinct = (
        (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    )
    faces = faces[distinct]
    used, compact = np.unique(faces, return_inverse=True)
    return unique[used], compact.reshape(-1, 3)


def _outward(corners: Floats, faces: Indices) -> Indices:
    """Return the faces of closed surfaces, turned outward."""
    neighbours: dict[tuple[int, int], list[int]] = {}
    for index, face in enumerate(faces.tolist()):
        for a, b in zip(face, [*face[1:], face[0]], strict=True):
            neighbours.setdefault((min(a, b), max(a, b)), []).append(index)
    if any(len(owners) != 2 for owners in neighbours.values()):
        raise MeshFileError(
            "It is not closed: an edge does not lie between two faces. Close its holes, and leave "
            "out what lies inside."
        )
    faces = faces.copy()
    done = np.zeros(len(faces), dtype=bool)
    for first in range(len(faces)):
        if done[first]:
            continue
        # All that hangs together is turned like the first.
        members, waiting = [first], [first]
        done[first] = True
        while waiting:
            own = waiting.pop()
            for a, b in _sides(faces[own]):
                pair = neighbours[min(a, b), max(a, b)]
                other = pair[0] if pair[1] == own else pair[1]
                if (a, b) in _sides(faces[other]):
                    if done[other]:
                        raise MeshFileError(
                            "It has no outside: its faces cannot all be turned outward. Repair it."
                        )
                    faces[other] = faces[other][::-1]
                if not done[other]:
                    done[other] = True
                    members.append(other)
                    waiting.append(other)
        if _volume_m3(corners, faces[members]) < 0:
            faces[members] = faces[members][:, ::-1]
    return faces


def _sides(face: Indices) -> list[tuple[int, int]]:
    a, b, c = face.tolist()
    return [(a, b), (b, c), (c, a)]


def _volume_m3(corners: Floats, faces: Indices) -> float:
    a, b, c = (corners[faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6


def _check_volume(corners: Floats, faces: Indices, longest_m: float) -> None:
    volume_m3 = _volume_m3(corners, faces)
    if not (math.isfinite(volume_m3) and volume_m3 > 1e-6 * longest_m * LEAST_EXTENT_M**2):
        raise MeshFileError("It encloses no volume; give it a thickness.")


def _is_convex(corners: Floats, faces: Indices, longest_m: float) -> bool:
    a, b, c = (corners[faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    tolerance_m = max(_FLATNESS * longest_m, 1e-8)
    return all(
        float(((corners - a[i]) @ normals[i]).max()) <= tolerance_m * lengths[i]
        for i in np.flatnonzero(lengths > 1e-12 * longest_m**2)
    )
