"""Convex decomposition of meshes by CoACD (Wei, Liu, Ling and Su 2022; MIT licence)."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from importlib.metadata import version
from itertools import count
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

# Concavity threshold, relative to half the mesh's greatest extent.
_CONCAVITY: Final = 0.02
_ITERATIONS: Final = 100
# Depth of hollows that pieces fill, above which they are cut again [mm]; largest number of pieces.
_HOLLOW_MM: Final = 0.1
_MOST_PIECES: Final = 96
# Largest depth of a circular segment by twice its area to its outline.
_SEGMENT: Final = 1.5
# Smallest share of a hollow that a cut must remove.
_WORTH: Final = 0.05
_MM: Final = 1e3


class CoacdPieces:
    """Decomposes a closed mesh, deterministically."""

    @property
    def version(self) -> str:
        """Text that changes whenever pieces may change."""
        return (
            f"coacd {version('coacd')} concavity {_CONCAVITY} iterations {_ITERATIONS} "
            f"hollows {_HOLLOW_MM} mm bodies apart"
        )

    def __call__(
        self, corners: NDArray[np.float64], faces: NDArray[np.int64]
    ) -> list[tuple[Any, Any]]:
        """Return corners [m] and triangles of every piece.

        Parameters
        ----------
        corners
            Corners of the mesh [m], shape (corners, 3).
        faces
            Triangles of the mesh, anticlockwise from outside, shape (faces, 3).
        """
        pieces: list[tuple[Any, Any]] = []
        # CoACD takes minutes for two bodies that touch, and fractions of a second for each.
        for body in _split_bodies(corners, faces):
            pieces += _cut_hollows(*body, _run_coacd(*body))
        return pieces


def _run_coacd(corners: NDArray[np.float64], faces: NDArray[np.int64]) -> Any:
    # Imported only for meshes that are not cached.
    import coacd

    coacd.set_log_level("error")
    return coacd.run_coacd(
        coacd.Mesh(corners, faces),
        threshold=_CONCAVITY,
        preprocess_mode="off",
        mcts_iterations=_ITERATIONS,
        seed=0,
    )


def _split_bodies(
    corners: NDArray[np.float64], faces: NDArray[np.int64]
) -> list[tuple[NDArray[np.float64], NDArray[np.int64]]]:
    """Return the closed bodies of a mesh; a body with a cavity stays whole."""
    bodies = _build_solid(corners, faces).decompose()
    if len(bodies) < 2 or any(body.volume() <= 0 for body in bodies):
        return [(corners, faces)]
    return [_extract(body) for body in bodies]


def _cut_hollows(
    corners: NDArray[np.float64], faces: NDArray[np.int64], pieces: Sequence[tuple[Any, Any]]
) -> list[tuple[Any, Any]]:
    """Return pieces that fill no hollow deeper than 0.1 mm, such as the wall of a hole.

    CoACD's threshold is a share of the mesh, so that pieces of a large part fill the play of a
    pin. The deepest are cut in two, and each half gets the hull of what the mesh has in it.
    """
    solid = _build_solid(corners, faces)
    if solid.is_empty():
        return list(pieces)
    numbers = count()
    waiting: list[tuple[float, int, Any, Any]] = []
    done: list[Any] = []

    def sort_in(hull: Any) -> None:
        body = solid ^ hull
        if body.is_empty():
            return
        depth_mm, hollow = _find_deepest(hull - solid)
        if depth_mm > _HOLLOW_MM:
            heapq.heappush(waiting, (-depth_mm, next(numbers), hollow, body))
        else:
            done.append(hull)

    for own, of in pieces:
        sort_in(_build_solid(own, of).hull())
    while waiting and len(done) + len(waiting) < _MOST_PIECES:
        _, _, hollow, body = heapq.heappop(waiting)
        halves = _cut_best(body, hollow)
        if halves:
            for half in halves:
                sort_in(half)
        else:
            done.append(body.hull())
    done += [body.hull() for _, _, _, body in waiting]
    return [_extract(hull) for hull in done]


def _find_deepest(hollows: Any) -> tuple[float, Any]:
    """Return the depth of the deepest hollow [mm], and the hollow."""
    deepest: tuple[float, Any] = (0.0, None)
    for hollow in hollows.decompose():
        surface = hollow.surface_area()
        depth_mm = _SEGMENT * 2 * hollow.volume() / surface if surface > 0 else 0.0
        if depth_mm > deepest[0]:
            deepest = (float(depth_mm), hollow)
    return deepest


def _cut_best(body: Any, hollow: Any) -> list[Any]:
    """Return the hulls of a body cut through a hollow, by the plane that leaves least excess."""
    points = np.asarray(hollow.to_mesh64().vert_properties)[:, :3]
    middle = points.mean(axis=0)
    _, _, axes = np.linalg.svd(points - middle, full_matrices=False)
    before = body.hull().volume() - body.volume()
    best: list[Any] = []
    least = (1 - _WORTH) * before
    for normal in (*axes, *np.eye(3)):
        hulls = [
            part.hull()
            for half in body.split_by_plane(tuple(normal), float(middle @ normal))
            for part in half.decompose()
        ]
        hulls = [hull for hull in hulls if hull.volume() > 0]
        excess = sum(hull.volume() for hull in hulls) - body.volume()
        if len(hulls) > 1 and excess < least:
            best, least = hulls, excess
    return best


def _build_solid(corners: Any, faces: Any) -> Any:
    # Imported only for meshes that are not cached.
    import manifold3d

    return manifold3d.Manifold(
        manifold3d.Mesh64(
            vert_properties=np.ascontiguousarray(np.asarray(corners, dtype=np.float64) * _MM),
            tri_verts=np.ascontiguousarray(faces, dtype=np.uint64),
        )
    )


def _extract(hull: Any) -> tuple[Any, Any]:
    """Return corners [m] and triangles of a hull."""
    mesh = hull.to_mesh64()
    return np.asarray(mesh.vert_properties)[:, :3] / _MM, np.asarray(mesh.tri_verts, dtype=np.int64)


convex_pieces = CoacdPieces()
