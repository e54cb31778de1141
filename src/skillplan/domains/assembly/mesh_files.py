"""Closed polyhedra from OBJ, STL and PLY files."""

from __future__ import annotations

import hashlib
import io
import math
import warnings
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import numpy.typing as npt

from skillplan.files.companion_file import CompanionFileError, companion_in, read_companion
from skillplan.task.motion import Point

MAX_BYTES = 4 * 1024 * 1024
"""Greatest size of a file."""

MAX_CORNERS = 5_000
"""Most corners of a polyhedron."""

SUFFIXES = (".obj", ".stl", ".ply")

_LEAST_EXTENT_M, _MOST_EXTENT_M = 1e-6, 10.0
# How far a corner may lie outside the plane of a face, of the greatest extent: files hold seven
# digits, of lengths far from the origin fewer.
_FLATNESS = 1e-5
_DECIMALS = 9
# A surface with more corners than this is seen from so many directions: of a ball of 0.1 m, less
# than 0.2 mm stands out between them.
_DIRECTIONS = 1_000

_Floats = npt.NDArray[np.float64]
_Indices = npt.NDArray[np.int64]


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
    """

    corners: tuple[Point, ...]
    faces: tuple[tuple[int, int, int], ...]
    size: Point
    sha256: str
    convex: bool

    def about(self, centre: Point) -> tuple[Point, ...]:
        """Return the corners when the box lies about `centre` [m], to a nanometre."""
        x_m, y_m, z_m = centre
        return tuple(
            (round(x + x_m, _DECIMALS), round(y + y_m, _DECIMALS), round(z + z_m, _DECIMALS))
            for x, y, z in self.corners
        )


def read_mesh(folder: Path, name: str, scale: float) -> Polyhedron:
    """Return the polyhedron that a file holds.

    Parameters
    ----------
    folder
        The task file's folder, which the file must lie in.
    name
        The file's name relative to `folder`; it is read by its suffix, one of `SUFFIXES`.
    scale
        What the lengths are multiplied by to be metres, > 0.

    Raises
    ------
    MeshFileError
        If the file lies elsewhere, cannot be read, is larger than `MAX_BYTES`, or holds anything
        but a closed surface of `MAX_CORNERS` corners at most, 1e-6 m to 10 m long.
    """
    content, suffix = _content(folder, name)
    return _polyhedron(content, suffix, scale)


def read_hull(folder: Path, name: str, scale: Point) -> tuple[tuple[Point, ...], str]:
    """Return corners about a surface [m], convex or not, and the hash of its file.

    Of many corners, those are left out that are not the farthest in any of `_DIRECTIONS` evenly
    spread directions.

    Parameters
    ----------
    folder
        Which the file must lie in.
    name
        The file's name relative to `folder`; it is read by its suffix, one of `SUFFIXES`.
    scale
        What the lengths along x, y and z are multiplied by to be metres.

    Raises
    ------
    MeshFileError
        If the file lies elsewhere, cannot be read, is larger than `MAX_BYTES`, or holds no body.
    """
    content, suffix = _content(folder, name)
    corners, faces = _parsed(content, suffix)
    if not len(faces) or not np.isfinite(corners).all():
        raise MeshFileError("It holds no surface; save it as triangles.")
    with np.errstate(over="ignore"):
        used = np.unique(np.round(corners[np.unique(faces)] * np.array(scale), _DECIMALS), axis=0)
    _check_size(used.max(axis=0) - used.min(axis=0), 1.0)
    if len(used) > _DIRECTIONS:
        middle = used.mean(axis=0)
        used = used[np.unique(np.argmax((used - middle) @ _even_directions().T, axis=0))]
    found = tuple((float(x), float(y), float(z)) for x, y, z in used)
    return found, hashlib.sha256(content).hexdigest()


def _even_directions() -> _Floats:
    """Return unit vectors spread evenly over the sphere (Fibonacci's lattice)."""
    number = np.arange(_DIRECTIONS) + 0.5
    z = 1 - 2 * number / _DIRECTIONS
    angle = math.pi * (1 + math.sqrt(5)) * number
    flat = np.sqrt(1 - z * z)
    return np.column_stack([flat * np.cos(angle), flat * np.sin(angle), z])


def _content(folder: Path, name: str) -> tuple[bytes, str]:
    """Return what a file holds, and its suffix."""
    try:
        path = companion_in(folder, name)
        suffix = path.suffix.lower()
        if suffix not in SUFFIXES:
            raise MeshFileError(
                f"The suffix says what kind of file it is; give one of {', '.join(SUFFIXES)}."
            )
        return read_companion(path, MAX_BYTES, "surface"), suffix
    except CompanionFileError as error:
        raise MeshFileError(str(error)) from None


# Many parts may name one file.
@lru_cache(maxsize=16)
def _polyhedron(content: bytes, suffix: str, scale: float) -> Polyhedron:
    raw_corners, raw_faces = _parsed(content, suffix)
    if not len(raw_faces):
        raise MeshFileError("It holds no faces; save the surface as triangles or polygons.")
    if not np.isfinite(raw_corners).all():
        raise MeshFileError("A coordinate is not finite; save the surface again.")
    with np.errstate(over="ignore"):
        corners = raw_corners * scale
    used = corners[np.unique(raw_faces)]
    size = used.max(axis=0) - used.min(axis=0)
    _check_size(size, scale)
    middle = (used.max(axis=0) + used.min(axis=0)) / 2
    corners, faces = _merged(corners - middle, raw_faces)
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
        hashlib.sha256(content).hexdigest(),
        _is_convex(corners, faces, float(size.max())),
    )


def _parsed(content: bytes, suffix: str) -> tuple[_Floats, _Indices]:
    """Return corners and triangles as the file has them."""
    import trimesh

    unread = f"It cannot be read as {suffix[1:].upper()}; save it again."
    try:
        with warnings.catch_warnings(action="ignore"):
            mesh = trimesh.load_scene(
                io.BytesIO(content), file_type=suffix[1:], skip_materials=True, process=False
            ).to_mesh()
            corners = np.asarray(mesh.vertices, dtype=np.float64)
            faces = np.asarray(mesh.faces, dtype=np.int64)
    except Exception:
        # The library raises whatever its parsers meet, in the words of its programmers.
        raise MeshFileError(unread) from None
    is_table = corners.ndim == 2 and corners.shape[1:] == (3,)
    if not is_table or (len(faces) and not 0 <= faces.min() <= faces.max() < len(corners)):
        raise MeshFileError(unread)
    return corners, faces.reshape(-1, 3)


def _check_size(size: _Floats, scale: float) -> None:
    longest_m = float(size.max())
    if longest_m > _MOST_EXTENT_M:
        hint = ""
        if longest_m * 1e-3 <= _MOST_EXTENT_M:
            hint = f" Is the file in millimetres? Then give scale: {scale * 1e-3:g}."
        raise MeshFileError(
            f"It is {longest_m:g} m long, where {_MOST_EXTENT_M:g} m are the most.{hint}", "scale"
        )
    shortest_m = float(size.min())
    if shortest_m < _LEAST_EXTENT_M:
        if longest_m < _LEAST_EXTENT_M:
            message = f"It is {longest_m:g} m long, where {_LEAST_EXTENT_M:g} m are the least."
            raise MeshFileError(message, "scale")
        axis = "xyz"[int(size.argmin())]
        raise MeshFileError(f"It is flat: {shortest_m:g} m along {axis}; give it a thickness.")


def _merged(corners: _Floats, faces: _Indices) -> tuple[_Floats, _Indices]:
    """Return corners to a nanometre, each once, and faces that still have three of them."""
    rounded = np.round(corners, _DECIMALS) + 0.0
    unique, index = np.unique(rounded, axis=0, return_inverse=True)
    faces = index.reshape(-1)[faces]
    distinct = (
        (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    )
    faces = faces[distinct]
    used, compact = np.unique(faces, return_inverse=True)
    return unique[used], compact.reshape(-1, 3)


def _outward(corners: _Floats, faces: _Indices) -> _Indices:
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


def _sides(face: _Indices) -> list[tuple[int, int]]:
    a, b, c = face.tolist()
    return [(a, b), (b, c), (c, a)]


def _volume_m3(corners: _Floats, faces: _Indices) -> float:
    a, b, c = (corners[faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6


def _check_volume(corners: _Floats, faces: _Indices, longest_m: float) -> None:
    volume_m3 = _volume_m3(corners, faces)
    if not (math.isfinite(volume_m3) and volume_m3 > 1e-6 * longest_m * _LEAST_EXTENT_M**2):
        raise MeshFileError("It encloses no volume; give it a thickness.")


def _is_convex(corners: _Floats, faces: _Indices, longest_m: float) -> bool:
    a, b, c = (corners[faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    tolerance_m = max(_FLATNESS * longest_m, 1e-8)
    return all(
        float(((corners - a[i]) @ normals[i]).max()) <= tolerance_m * lengths[i]
        for i in np.flatnonzero(lengths > 1e-12 * longest_m**2)
    )
