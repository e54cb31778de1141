"""Which parts are identical, and which are mirror images of each other.

Volume, area and distances are the same for both; only laying one mesh over the other tells. So
two corners of one mesh are looked for in the other, and the motion, or the motion with a mirror,
that they determine is tried on all of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from skillplan_cad.product import Points, Triangles
from skillplan_cad.reading.mending import centre_m, volumes_m3
from skillplan_cad.reading.raw_part import RawPart, area_vectors_m2

# Pairs of corners that are tried at most.
_TRIED = 400
_SAMPLES = 400


def shapes_of(parts: Sequence[RawPart], chord_m: float) -> tuple[NDArray[np.int64], dict[int, int]]:
    """Return the number of every part's shape, and of mirrored shapes the number of the original.

    Parameters
    ----------
    parts
        With closed meshes.
    chord_m
        How far meshes of the same shape may differ.
    """
    figures = [_Figure(part, chord_m) for part in parts]
    shape = np.zeros(len(parts), dtype=np.int64)
    originals: list[_Figure] = []
    mirrors: dict[int, int] = {}
    for number, figure in enumerate(figures):
        found = None
        for known, other in enumerate(originals):
            if not figure.may_equal(other):
                continue
            if figure.lies_over(other, mirrored=False):
                found = known
                break
            if known not in mirrors and figure.lies_over(other, mirrored=True):
                mirrors.setdefault(len(originals), known)
        if found is None:
            found = len(originals)
            originals.append(figure)
        else:
            mirrors.pop(len(originals), None)
        shape[number] = found
    return shape, mirrors


class _Figure:
    """A mesh about its centre, with what is the same for all that equal it."""

    def __init__(self, part: RawPart, chord_m: float) -> None:
        vertices, triangles = part.vertices_m, part.triangles
        self.volume = float(volumes_m3(vertices, triangles).sum())
        self.area = float(np.linalg.norm(area_vectors_m2(vertices, triangles), axis=1).sum())
        self.points = vertices - centre_m(vertices, triangles)
        self.radii = np.linalg.norm(self.points, axis=1)
        self.size = float(self.radii.max())
        self.tolerance = max(2 * chord_m, 1e-4 * self.size)
        dense, spacing = _dense(self.points, triangles, self.tolerance)
        self.tree, self.reach = cKDTree(dense), max(3 * self.tolerance, spacing)
        step = max(1, len(self.points) // _SAMPLES)
        self.samples = self.points[::step]

    def may_equal(self, other: _Figure) -> bool:
        """Whether size, volume and area are no reason against it."""
        slack = self.tolerance
        return (
            abs(self.size - other.size) <= 2 * slack
            and abs(self.volume - other.volume) <= slack * min(self.area, other.area) * 0.5
            and abs(self.area - other.area) <= max(0.01 * self.area, slack * self.size)
        )

    def lies_over(self, other: _Figure, *, mirrored: bool) -> bool:
        """Whether a motion, with a mirror if wanted, lays this mesh over the other one."""
        for turn in self._turns(other, mirrored):
            if other.covers(self.samples @ turn.T) and self.covers(other.samples @ turn):
                return True
        return False

    def covers(self, points: Points) -> bool:
        """Whether all points lie on the surface."""
        distances, _ = self.tree.query(points, distance_upper_bound=self.reach)
        return bool(np.isfinite(distances).all())

    def _turns(self, other: _Figure, mirrored: bool) -> Iterator[NDArray[np.float64]]:
        first = int(np.argmax(self.radii))
        a = self.points[first]
        off = np.linalg.norm(np.cross(self.points, a / self.radii[first]), axis=1)
        b = self.points[int(np.argmax(off))]
        own = _frame(a, b, mirrored=False)
        slack, tried = 2 * self.tolerance, 0
        if own is None:
            return
        heads = np.flatnonzero(np.abs(other.radii - np.linalg.norm(a)) < slack)
        seconds = np.flatnonzero(np.abs(other.radii - np.linalg.norm(b)) < slack)
        distance = np.linalg.norm(a - b)
        for head in heads:
            gaps = np.linalg.norm(other.points[seconds] - other.points[head], axis=1)
            for second in seconds[np.abs(gaps - distance) < slack]:
                frame = _frame(other.points[head], other.points[second], mirrored=mirrored)
                if frame is None:
                    continue
                tried += 1
                yield frame @ own.T
                if tried >= _TRIED:
                    return


def _frame(
    a: NDArray[np.float64], b: NDArray[np.float64], *, mirrored: bool
) -> NDArray[np.float64] | None:
    """Return the axes that two points determine, as columns; the third is turned if mirrored."""
    x = a / np.linalg.norm(a)
    across = b - (b @ x) * x
    length = np.linalg.norm(across)
    if length < 1e-9:
        return None
    y = across / length
    z = np.cross(x, y)
    return np.stack([x, y, -z if mirrored else z], axis=1)


def _dense(points: Points, triangles: Triangles, spacing: float) -> tuple[Points, float]:
    """Return the vertices and points spread over the triangles, and how far apart they are."""
    corners = points[triangles]
    a, ab, ac = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = 0.5 * np.linalg.norm(np.cross(ab, ac), axis=1)
    total = float(area.sum())
    count = int(min(20000, max(2000, total / max(spacing, 1e-9) ** 2)))
    per = np.ceil(count * area / max(total, 1e-30)).astype(np.int64)
    which = np.repeat(np.arange(len(triangles)), per)
    order = np.arange(len(which))
    u, v = (order * 0.7548776662466927) % 1.0, (order * 0.5698402909980532) % 1.0
    over = u + v > 1
    u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    spread = a[which] + u[:, None] * ab[which] + v[:, None] * ac[which]
    return np.concatenate([points, spread]), float(np.sqrt(total / max(len(which), 1)))
