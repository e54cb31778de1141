"""Meshes of arms as few convex pieces that cover them."""

from __future__ import annotations

import contextlib
import importlib.util
import math
import re
from functools import lru_cache
from typing import Any, Final

import numpy as np
import trimesh
from scipy.spatial import ConvexHull, QhullError

from skillplan.domains.assembly.mesh_files import (
    DECIMALS,
    LEAST_EXTENT_M,
    Floats,
    Indices,
    MeshFileError,
    parse_mesh,
)
from skillplan.robots.arm_description import Triple

SUFFIXES: Final = (".stl", ".obj", ".dae", ".glb", ".ply")

_MOST_EXTENT_M: Final = 10.0
# Directions that thin out large pieces: for a ball of 0.1 m, the surface stands out by less than
# 0.2 mm between them.
_DIRECTIONS: Final = 1_000
# A mesh is cut while that saves this share of its hull's volume, into so many pieces.
_LEAST_SAVING: Final = 0.12
_MOST_PIECES: Final = 4
# Places of a cut along an axis, and cells along the mesh in which volumes are estimated.
_CUTS: Final = (0.25, 0.4, 0.5, 0.6, 0.75)
_CELLS: Final = 60


class ArmMeshError(Exception):
    """A mesh cannot be used as the shape of a link."""


# Links of several arms may use the same file.
@lru_cache(maxsize=128)
def cover_mesh(content: bytes, suffix: str, scale: Triple) -> tuple[tuple[Triple, ...], ...]:
    """Return the corners of convex pieces that cover a surface [m]; empty without a triangle.

    Parameters
    ----------
    suffix
        One of `SUFFIXES`.
    scale
        Factors along x, y and z. Units and node transforms of the file are applied before.

    Raises
    ------
    ArmMeshError
        If the content is unreadable, or too large in space.
    """
    corners, faces = _parse(content, suffix)
    if not len(faces):
        return ()
    if not np.isfinite(corners).all():
        raise ArmMeshError("It has coordinates that are not finite; save it again.")
    with np.errstate(over="ignore", invalid="ignore"):
        corners = corners * np.array(scale)
    used = corners[np.unique(faces)]
    _check_size(used, scale)
    pieces = [_thin_out(piece) for piece in _cut(corners, faces)]
    return tuple(
        tuple((float(x), float(y), float(z)) for x, y, z in piece)
        for piece in pieces
        if _is_solid(piece)
    )


def _parse(content: bytes, suffix: str) -> tuple[Floats, Indices]:
    if suffix not in SUFFIXES:
        raise ArmMeshError(f"The suffix selects the format; give one of {', '.join(SUFFIXES)}.")
    if suffix == ".dae":
        if importlib.util.find_spec("collada") is None:
            raise ArmMeshError("DAE needs pycollada: pip install 'skillplan[urdf]'.")
        if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
            raise ArmMeshError("It declares a document type, which is not read; take it out.")
    if suffix == ".stl" and _is_empty_stl(content):
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64)
    try:
        corners, faces = parse_mesh(content, suffix)
    except MeshFileError as error:
        raise ArmMeshError(str(error)) from None
    return corners * _get_unit(content, suffix), faces


def _is_empty_stl(content: bytes) -> bool:
    """Return whether an STL file has no triangle."""
    if content[:5].lower() == b"solid" and b"facet" not in content[:1000]:
        return b"endsolid" in content
    return len(content) == 84 and content[80:84] == bytes(4)


def _get_unit(content: bytes, suffix: str) -> float:
    """Return the length of a file's unit [m]; only DAE states one."""
    unit = re.search(rb"<unit\b[^>]*\bmeter\s*=\s*[\"']([^\"']+)[\"']", content)
    if suffix != ".dae" or unit is None:
        return 1.0
    try:
        length_m = float(unit[1])
    except ValueError:
        length_m = math.nan
    if not (math.isfinite(length_m) and length_m > 0):
        raise ArmMeshError("Its <unit> has no positive length; save it again.")
    return length_m


def _check_size(used: Floats, scale: Triple) -> None:
    size = used.max(axis=0) - used.min(axis=0)
    longest_m = float(size.max())
    if not longest_m <= _MOST_EXTENT_M:
        hint = ""
        if longest_m * 1e-3 <= _MOST_EXTENT_M:
            hint = f" Is the file in millimetres? Then give scale: {scale[0] * 1e-3:g}."
        raise ArmMeshError(
            f"It is {longest_m:g} m long, where {_MOST_EXTENT_M:g} m are the most.{hint}"
        )
    if longest_m < LEAST_EXTENT_M:
        raise ArmMeshError(f"It is {longest_m:g} m long, where {LEAST_EXTENT_M:g} m are the least.")
    far_m = float(np.abs(used).max())
    if far_m > _MOST_EXTENT_M:
        raise ArmMeshError(
            f"It lies {far_m:g} m from its origin, where {_MOST_EXTENT_M:g} m are the most; move "
            "it there."
        )


Surface = tuple[Floats, Indices]
"""Corners, and three indices of them for each triangle."""


def _cut(corners: Floats, faces: Indices) -> list[Floats]:
    """Return the corners of pieces whose hulls fill much less space than the hull of all."""
    coarse = _coarsen(corners, faces)
    least_m3 = _LEAST_SAVING * _measure_hull_m3(coarse)
    # Cuts are chosen on the coarse surface, and made in both.
    waiting: list[tuple[Surface, Surface]] = [(coarse, (corners, faces))]
    done: list[Surface] = []
    while waiting and len(waiting) + len(done) < _MOST_PIECES:
        rough, exact = waiting.pop(0)
        cut = _find_cut(rough, least_m3)
        halves = [] if cut is None else [_slice(exact, *cut, side) for side in (1.0, -1.0)]
        if cut is None or not all(len(half[1]) for half in halves):
            done.append(exact)
            continue
        waiting += zip([_slice(rough, *cut, side) for side in (1.0, -1.0)], halves, strict=True)
    pieces = [*done, *(exact for _, exact in waiting)]
    return [own[np.unique(triangles)] for own, triangles in pieces]


def _coarsen(corners: Floats, faces: Indices) -> Surface:
    """Return a surface with its corners on a grid, for estimates of volumes."""
    low = corners[np.unique(faces)].min(axis=0)
    step_m = max(float(np.ptp(corners[np.unique(faces)], axis=0).max()) / _CELLS, 1e-6)
    cells = np.clip(np.round((corners - low) / step_m), 0, _CELLS).astype(np.int64)
    keys = cells @ np.array([(_CELLS + 1) ** 2, _CELLS + 1, 1])
    _, first, index = np.unique(keys, return_index=True, return_inverse=True)
    triangles = index.reshape(-1)[faces]
    distinct = (
        (triangles[:, 0] != triangles[:, 1])
        & (triangles[:, 1] != triangles[:, 2])
        & (triangles[:, 2] != triangles[:, 0])
    )
    return low + cells[first] * step_m, triangles[distinct]


def _find_cut(surface: Surface, least_m3: float) -> tuple[int, Floats] | None:
    """Return the axis and place of the cut that saves the most volume, None if it saves little."""
    corners, faces = surface
    whole_m3 = _measure_hull_m3(surface)
    # No cut saves more than the hull has beyond the surface.
    if not len(faces) or whole_m3 - abs(_measure_inside_m3(surface)) <= least_m3:
        return None
    used = corners[np.unique(faces)]
    low, size = used.min(axis=0), np.ptp(used, axis=0)
    best: tuple[int, Floats] | None = None
    for axis in range(3):
        for share in _CUTS:
            at = low.copy()
            at[axis] += share * size[axis]
            left_m3 = sum(_measure_hull_m3(_slice(surface, axis, at, side)) for side in (1.0, -1.0))
            if whole_m3 - left_m3 > least_m3:
                best, least_m3 = (axis, at), whole_m3 - left_m3
    return best


def _slice(surface: Surface, axis: int, at: Floats, side: float) -> Surface:
    """Return the part of a surface on one side of a plane across an axis."""
    normal = np.zeros(3)
    normal[axis] = side
    slicing: Any = trimesh.intersections
    sliced = slicing.slice_faces_plane(*surface, normal, at)
    return np.asarray(sliced[0]), np.asarray(sliced[1])


def _measure_hull_m3(surface: Surface) -> float:
    corners, faces = surface
    try:
        return float(ConvexHull(corners[np.unique(faces)]).volume)
    except (QhullError, ValueError):
        return 0.0


def _measure_inside_m3(surface: Surface) -> float:
    """Return the volume that a surface encloses; of open ones, an estimate."""
    corners, faces = surface
    a, b, c = (corners[faces[:, number]] - corners.mean(axis=0) for number in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def _thin_out(points: Floats) -> Floats:
    """Return the distinct corners, of many only the farthest in spread directions."""
    if len(points) > _DIRECTIONS:
        with contextlib.suppress(QhullError):
            points = points[ConvexHull(points).vertices]
    used = np.unique(np.round(points, DECIMALS), axis=0)
    if len(used) <= _DIRECTIONS:
        return used
    middle = used.mean(axis=0)
    return np.asarray(used[np.unique(np.argmax((used - middle) @ _spread_directions().T, axis=0))])


def _is_solid(points: Floats) -> bool:
    """Return whether points have a hull of some thickness along all directions."""
    if len(points) < 4:
        return False
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[-1] / math.sqrt(len(points)) > LEAST_EXTENT_M)


@lru_cache(maxsize=1)
def _spread_directions() -> Floats:
    """Return evenly spread unit vectors (Fibonacci lattice)."""
    number = np.arange(_DIRECTIONS) + 0.5
    z = 1 - 2 * number / _DIRECTIONS
    angle = math.pi * (1 + math.sqrt(5)) * number
    flat = np.sqrt(1 - z * z)
    return np.asarray(np.column_stack([flat * np.cos(angle), flat * np.sin(angle), z]))
