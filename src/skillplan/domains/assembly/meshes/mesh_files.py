"""Closed polyhedra from OBJ, STL and PLY files."""

from __future__ import annotations

import hashlib
import io
import math
import warnings
from functools import lru_cache
from pathlib import Path

import numpy as np

from skillplan.domains.assembly.meshes.polyhedron import (
    DECIMALS,
    LEAST_EXTENT_M,
    Floats,
    Indices,
    MeshFileError,
    Polyhedron,
    polyhedron_of,
)
from skillplan.files.companion_file import CompanionFileError, companion_in, read_companion
from skillplan.task.motion import Point

MAX_BYTES = 4 * 1024 * 1024
"""Greatest size of a file."""

SUFFIXES = (".obj", ".stl", ".ply")

_MOST_EXTENT_M = 10.0
# A surface with more corners than this is seen from so many directions: of a ball of 0.1 m, less
# than 0.2 mm stands out between them.
_DIRECTIONS = 1_000


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
    content, suffix = content_of(folder, name)
    polyhedron = _polyhedron_or_refusal(content, suffix, scale)
    if isinstance(polyhedron, MeshFileError):
        raise MeshFileError(str(polyhedron), polyhedron.key)
    return polyhedron


def read_hull(folder: Path, name: str, scale: Point) -> tuple[tuple[Point, ...], bytes]:
    """Return corners about a surface [m], convex or not, and the content of its file.

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
    content, suffix = content_of(folder, name)
    corners, faces = parsed(content, suffix)
    if not len(faces) or not np.isfinite(corners).all():
        raise MeshFileError("It holds no surface; save it as triangles.")
    with np.errstate(over="ignore", invalid="ignore"):
        used = corners[np.unique(faces)] * np.array(scale)
        size = used.max(axis=0) - used.min(axis=0)
    _check_size(size, 1.0)
    if np.abs(used).max() > _MOST_EXTENT_M:
        far = f"It lies {np.abs(used).max():g} m from its origin, where {_MOST_EXTENT_M:g} m"
        raise MeshFileError(f"{far} are the most; move it there.")
    used = np.unique(np.round(used, DECIMALS), axis=0)
    if len(used) > _DIRECTIONS:
        middle = used.mean(axis=0)
        used = used[np.unique(np.argmax((used - middle) @ _even_directions().T, axis=0))]
    found = tuple((float(x), float(y), float(z)) for x, y, z in used)
    return found, content


def _even_directions() -> Floats:
    """Return unit vectors spread evenly over the sphere (Fibonacci's lattice)."""
    number = np.arange(_DIRECTIONS) + 0.5
    z = 1 - 2 * number / _DIRECTIONS
    angle = math.pi * (1 + math.sqrt(5)) * number
    flat = np.sqrt(1 - z * z)
    return np.column_stack([flat * np.cos(angle), flat * np.sin(angle), z])


def content_of(folder: Path, name: str) -> tuple[bytes, str]:
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


# Hundreds of parts may name one file.
@lru_cache(maxsize=16)
def _polyhedron_or_refusal(content: bytes, suffix: str, scale: float) -> Polyhedron | MeshFileError:
    try:
        return _polyhedron(content, suffix, scale)
    except MeshFileError as refusal:
        return refusal.with_traceback(None)


def _polyhedron(content: bytes, suffix: str, scale: float) -> Polyhedron:
    raw_corners, raw_faces = parsed(content, suffix)
    if not len(raw_faces):
        raise MeshFileError("It holds no faces; save the surface as triangles or polygons.")
    if not np.isfinite(raw_corners).all():
        raise MeshFileError("A coordinate is not finite; save the surface again.")
    with np.errstate(over="ignore", invalid="ignore"):
        corners = raw_corners * scale
        used = corners[np.unique(raw_faces)]
        size = used.max(axis=0) - used.min(axis=0)
    _check_size(size, scale)
    middle = (used.max(axis=0) + used.min(axis=0)) / 2
    return polyhedron_of(corners - middle, raw_faces, hashlib.sha256(content).hexdigest(), middle)


def parsed(content: bytes, suffix: str) -> tuple[Floats, Indices]:
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


def _check_size(size: Floats, scale: float) -> None:
    longest_m = float(size.max())
    if not longest_m <= _MOST_EXTENT_M:
        hint = ""
        if longest_m * 1e-3 <= _MOST_EXTENT_M:
            hint = f" Is the file in millimetres? Then give scale: {scale * 1e-3:g}."
        raise MeshFileError(
            f"It is {longest_m:g} m long, where {_MOST_EXTENT_M:g} m are the most.{hint}", "scale"
        )
    shortest_m = float(size.min())
    if shortest_m < LEAST_EXTENT_M:
        if longest_m < LEAST_EXTENT_M:
            message = f"It is {longest_m:g} m long, where {LEAST_EXTENT_M:g} m are the least."
            raise MeshFileError(message, "scale")
        axis = "xyz"[int(size.argmin())]
        raise MeshFileError(f"It is flat: {shortest_m:g} m along {axis}; give it a thickness.")
