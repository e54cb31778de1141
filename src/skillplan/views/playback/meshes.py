"""Meshes in compact form."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skillplan.files.regular_file import read_bytes
from skillplan.task.zone import Zone
from skillplan.views.playback.tracks import Numbers, pack

_MOST_BYTES = 16 * 2**20

Triangles = NDArray[np.int64]


def encode_mesh(points: Numbers, triangles: Triangles) -> dict[str, Any]:
    """Return a mesh as JSON values, from corners [m] and triangles, shapes (n, 3) and (m, 3)."""
    low, high = points.min(axis=0), points.max(axis=0)
    offset = (low + high) / 2
    scale = max(float((high - low).max()) / 2 / 32767, 1e-9)
    wide = len(points) > 0xFFFF
    return {
        "positions": pack(np.round((points - offset) / scale), "<i2"),
        "scale_m": scale,
        "offset_m": [float(value) for value in offset],
        "triangles": pack(triangles, "<u4" if wide else "<u2"),
        "wide": wide,
    }


def build_hull_mesh(points: Sequence[Sequence[float]]) -> tuple[Numbers, Triangles]:
    """Return the convex hull of points as corners and outward triangles."""
    # trimesh calls the same function, but takes as long to import as the rest of a page.
    from scipy.spatial import ConvexHull

    convex = ConvexHull(np.array(points, dtype=np.float64), qhull_options="QbB Pp Qt")
    used, renumbered = np.unique(convex.simplices, return_inverse=True)
    corners, triangles = convex.points[used], renumbered.reshape(-1, 3)
    a, b, c = corners[triangles].transpose(1, 0, 2)
    across = np.cross(b - a, c - a)
    inward = (across * convex.equations[:, :3]).sum(axis=1) < 0
    triangles[inward] = triangles[inward, ::-1]
    wide = np.linalg.norm(across, axis=1) > 0
    return corners, triangles[wide].astype(np.int64)


def build_prism_mesh(zone: Zone, low_m: float, high_m: float) -> tuple[Numbers, Triangles]:
    """Return a zone between two heights [m] as corners and outward triangles."""
    import shapely

    ring = zone.polygon.exterior
    outline = list(ring.coords if ring.is_ccw else ring.reverse().coords)[:-1]
    count = len(outline)
    caps = shapely.constrained_delaunay_triangles(zone.polygon).geoms
    numbers = {point: number for number, point in enumerate(outline)}
    triangles = []
    for cap in caps:
        corners = cap.exterior if cap.exterior.is_ccw else cap.exterior.reverse()
        a, b, c = (numbers[point] for point in list(corners.coords)[:3])
        triangles += [(a, c, b), (a + count, b + count, c + count)]
    for number in range(count):
        after = (number + 1) % count
        triangles += [(number, after, after + count), (number, after + count, number + count)]
    points = [(x, y, z) for z in (low_m, high_m) for x, y in outline]
    return np.array(points), np.array(triangles, dtype=np.int64)


def read_obj(path: Path) -> tuple[Numbers, Triangles]:
    """Return corners and triangles of a Wavefront file, and ignore everything else in it.

    Raises
    ------
    OSError, ValueError
        If it cannot be read or has another format.
    """
    lines = read_bytes(path, _MOST_BYTES).decode("latin-1").splitlines()
    points = [line.split()[1:4] for line in lines if line.startswith("v ")]
    numbers: list[int] = []
    for line in lines:
        if line.startswith("f "):
            first, *others = (int(word.partition("/")[0]) for word in line.split()[1:])
            for pair in pairwise(others):
                numbers += (first, *pair)
    triangles = np.array(numbers, dtype=np.int64).reshape(-1, 3) - 1
    return np.array(points, dtype=np.float64), triangles


def coarsen(points: Numbers, triangles: Triangles, cell_m: float) -> tuple[Numbers, Triangles]:
    """Return a mesh with the corners in each cell of a grid merged (Rossignac and Borrel, 1993).

    Parameters
    ----------
    cell_m
        Size of a cell, > 0 [m].
    """
    cells = np.floor(points / cell_m).astype(np.int64)
    _, group = np.unique(cells, axis=0, return_inverse=True)
    group = group.reshape(-1)
    counts = np.bincount(group).astype(np.float64)
    means = np.stack([np.bincount(group, points[:, k]) / counts for k in range(3)], axis=1)
    merged = group[triangles]
    a, b, c = merged.T
    merged = merged[(a != b) & (b != c) & (a != c)]
    # Of several triangles with the same corners, the first is kept.
    _, first = np.unique(np.sort(merged, axis=1), axis=0, return_index=True)
    merged = merged[np.sort(first)]
    used, renumbered = np.unique(merged, return_inverse=True)
    return means[used], renumbered.reshape(-1, 3).astype(np.int64)
