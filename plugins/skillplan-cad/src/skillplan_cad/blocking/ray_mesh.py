"""Trace rays along a direction against one part: first entry and last exit.

Embree works in single precision, so lengths here are millimetres around the product's centre. It
reports the triangle; the position on it is computed in double precision.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from skillplan_cad.product import Points, Triangles

Floats = NDArray[np.float64]

# Largest number of hits per ray, and the distance between distinct hits.
_MOST_HITS, _STEP_MM = 64, 1e-4


class Meshed(Protocol):
    """A part, or another mesh in metres."""

    @property
    def vertices_m(self) -> Points:
        """Vertices."""

    @property
    def triangles(self) -> Triangles:
        """Indices of vertices."""


@dataclass(frozen=True, slots=True, eq=False)
class Heights:
    """First entry and last exit of rays through a part.

    Parameters
    ----------
    low, high
        Heights along the direction [mm]; nan for rays that miss.
    low_slope, high_slope
        Absolute cosine between surface normal and direction, 0 to 1.
    """

    low: Floats
    high: Floats
    low_slope: Floats
    high_slope: Floats


@cache
def _open_embree_device() -> Any:
    """Return the Embree device of this process, shared by all scenes.

    Each device takes one of the process's 1,024 keys of thread-local storage. Embree allows several
    threads on one device.
    """
    from embreex.rtcore import EmbreeDevice

    return EmbreeDevice()


class RayMesh:
    """A part as a ray-traced mesh.

    Attributes
    ----------
    reach_mm
        Radius of a sphere around the origin that contains the part.
    """

    def __init__(self, part: Meshed, middle_m: Floats) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self.points_mm = (part.vertices_m - middle_m) * 1000
        self.triangles = part.triangles
        corners = self.points_mm[part.triangles]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(across, axis=1)
        self.normals = across / np.where(length > 0, length, 1.0)[:, None]
        self._scene = EmbreeScene(_open_embree_device())
        self._mesh = TriangleMesh(
            self._scene,
            np.ascontiguousarray(self.points_mm, dtype=np.float32),
            np.ascontiguousarray(part.triangles, dtype=np.int32),
        )
        self.reach_mm = float(np.linalg.norm(self.points_mm, axis=1).max()) + 1.0

    def trace(self, origins: Floats, directions: Floats) -> tuple[NDArray[np.int64], Floats]:
        """Return the first triangle hit by each ray, and its distance.

        Rays that miss have triangle -1 and infinite distance. Distances stay within the extent of
        the triangle along the ray, so a ray in the plane of a wall has one of the wall.
        """
        hit = self.find_first_hits(origins, directions)
        distance = np.full(len(hit), np.inf)
        struck = np.flatnonzero(hit >= 0)
        normals = self.normals[hit[struck]]
        facing = np.einsum("ij,ij->i", normals, directions[struck])
        corners = self.points_mm[self.triangles[hit[struck]]] - origins[struck, None]
        offset = np.einsum("ij,ij->i", corners[:, 0], normals)
        along = np.einsum("ijk,ik->ij", corners, directions[struck])
        distance[struck] = np.clip(
            offset / np.where(np.abs(facing) > 1e-12, facing, 1.0),
            np.maximum(along.min(axis=1), 0.0),
            along.max(axis=1),
        )
        return hit, distance

    def find_first_hits(self, origins: NDArray[Any], directions: NDArray[Any]) -> NDArray[np.int64]:
        """Return the first triangle hit by each ray; -1 for a miss."""
        if not len(origins):
            return np.zeros(0, dtype=np.int64)
        hits = self._scene.run(
            np.ascontiguousarray(origins, dtype=np.float32),
            np.ascontiguousarray(directions, dtype=np.float32),
        )
        return np.asarray(hits, dtype=np.int64)


class RayView:
    """A part seen along one direction.

    Parameters
    ----------
    frame
        Two directions across and the direction of the rays, one per row.

    Attributes
    ----------
    facing
        Cosine between each triangle's normal and the direction, -1 to 1.
    """

    def __init__(self, mesh: RayMesh, frame: Floats) -> None:
        self._mesh, self._frame = mesh, frame
        placed = mesh.points_mm @ frame.T
        self.flat = placed[:, :2]
        self.bottom, self.top = float(placed[:, 2].min()), float(placed[:, 2].max())
        normals = mesh.normals @ frame.T
        self.facing = normals[:, 2]
        # A triangle along the direction has no unique height: clip heights to its extent.
        safe = np.where(np.abs(self.facing) <= 1e-12, 1.0, self.facing)
        corner = placed[mesh.triangles]
        away = np.einsum("ij,ij->i", normals, corner[:, 0])
        planes = np.stack([away, -normals[:, 0], -normals[:, 1]], axis=1) / safe[:, None]
        low, high = corner[:, :, 2].min(axis=1), corner[:, :, 2].max(axis=1)
        # One row per triangle; the last row serves rays that miss, with index -1.
        self._planes = np.vstack([planes, np.full(3, np.nan)])
        self._low, self._high = np.append(low, np.nan), np.append(high, np.nan)
        self._slope = np.append(np.abs(self.facing), 0.0)

    def trace_heights(self, flat: Floats) -> Heights:
        """Return the heights of first entry and last exit of rays through points (n, 2)."""
        count, reach = len(flat), self._mesh.reach_mm
        base = flat @ self._frame[:2]
        origins = np.empty((2 * count, 3), dtype=np.float32)
        origins[:count] = base - reach * self._frame[2]
        origins[count:] = base + reach * self._frame[2]
        directions = np.empty((2 * count, 3), dtype=np.float32)
        directions[:count], directions[count:] = self._frame[2], -self._frame[2]
        hit = self._mesh.find_first_hits(origins, directions)
        height, slope = self._evaluate_hits(hit, np.concatenate([flat, flat]))
        return Heights(height[:count], height[count:], slope[:count], slope[count:])

    def trace_first(self, flat: Floats, side: Literal[1, -1]) -> Floats:
        """Return the heights of first entries of rays upwards (1) or downwards (-1); nan if none.

        Parameters
        ----------
        flat
            Points of the rays (n, 2).
        """
        along = side * self._frame[2]
        origins = flat @ self._frame[:2] - self._mesh.reach_mm * along
        hit = self._mesh.find_first_hits(origins, np.repeat(along[None], len(flat), axis=0))
        return self._evaluate_hits(hit, flat)[0]

    def trace_crossings(self, flat: Floats) -> tuple[Floats, Floats]:
        """Return the heights of all entries and exits of each ray, padded with infinity."""
        base = flat @ self._frame[:2]
        at = np.full(len(base), -self._mesh.reach_mm)
        live = np.arange(len(base))
        entries: list[Floats] = []
        exits: list[Floats] = []
        directions = np.repeat(self._frame[2][None], len(base), axis=0)
        for _ in range(_MOST_HITS):
            origins = base[live] + at[live, None] * self._frame[2]
            hit = self._mesh.find_first_hits(origins, directions[live])
            live, hit = live[hit >= 0], hit[hit >= 0]
            if not len(live):
                break
            height, _ = self._evaluate_hits(hit, flat[live])
            height = np.maximum(height, at[live])
            inwards = self.facing[hit] < 0
            for rows, chosen in ((entries, inwards), (exits, ~inwards)):
                row = np.full(len(base), np.inf)
                row[live[chosen]] = height[chosen]
                rows.append(row)
            at[live] = height + _STEP_MM
        none = np.full((1, len(base)), np.inf)
        return np.array(entries or none).T, np.array(exits or none).T

    def _evaluate_hits(self, hit: NDArray[np.int64], flat: Floats) -> tuple[Floats, Floats]:
        """Return heights and slopes at the hit triangles; nan and 0 for index -1."""
        terms = self._planes[hit]
        value = terms[:, 0] + terms[:, 1] * flat[:, 0] + terms[:, 2] * flat[:, 1]
        return np.minimum(np.maximum(value, self._low[hit]), self._high[hit]), self._slope[hit]
