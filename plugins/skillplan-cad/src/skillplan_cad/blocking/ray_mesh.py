"""Rays along a direction against one part: where they enter it first and leave it last.

embree works in single precision, so that lengths here are millimetres about the product's middle;
it names the triangle that is hit, and where is worked out in double precision.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan_cad.product import Part

Floats = NDArray[np.float64]

# Hits of one ray that are told apart at most, and how far apart they are.
_MOST_HITS, _STEP_MM = 64, 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Heights:
    """Where rays enter a part first and leave it last along a direction.

    Parameters
    ----------
    low, high
        Heights along the direction [mm]; not-a-number for rays that miss.
    low_slope, high_slope
        How much the surface there faces the direction, from 0 to 1.
    """

    low: Floats
    high: Floats
    low_slope: Floats
    high_slope: Floats


class RayMesh:
    """One part as rays see it.

    Parameters
    ----------
    part
        The part.
    middle_m
        What becomes the origin.
    """

    def __init__(self, part: Part, middle_m: Floats) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self.points_mm = (part.vertices_m - middle_m) * 1000
        self.triangles = part.triangles
        corners = self.points_mm[part.triangles]
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        length = np.linalg.norm(across, axis=1)
        self.normals = across / np.where(length > 0, length, 1.0)[:, None]
        self._corner = corners[:, 0]
        self._corners = corners
        self._scene = EmbreeScene()
        self._mesh = TriangleMesh(
            self._scene,
            np.ascontiguousarray(self.points_mm, dtype=np.float32),
            np.ascontiguousarray(part.triangles, dtype=np.int32),
        )
        self._reach = float(np.linalg.norm(self.points_mm, axis=1).max()) + 1.0

    def heights(self, flat: Floats, frame: Floats) -> Heights:
        """Return where rays through points of a plane enter first and leave last.

        Parameters
        ----------
        flat
            Points (n, 2) of the plane of the frame's first two rows.
        frame
            Two directions across and the direction of the rays, one a row.
        """
        count = len(flat)
        base = flat @ frame[:2]
        origins = np.concatenate([base - self._reach * frame[2], base + self._reach * frame[2]])
        ways = np.repeat(np.stack([frame[2], -frame[2]]), count, axis=0)
        hit = self._hit(origins, ways)
        height, slope = self._at(hit, np.concatenate([base, base]), frame[2])
        return Heights(height[:count], height[count:], slope[:count], slope[count:])

    def crossings(self, flat: Floats, frame: Floats) -> tuple[Floats, Floats]:
        """Return the heights at which each ray enters and leaves, padded by infinity."""
        base = flat @ frame[:2]
        at = np.full(len(base), -self._reach)
        live = np.arange(len(base))
        entries: list[Floats] = []
        exits: list[Floats] = []
        ways = np.repeat(frame[2][None], len(base), axis=0)
        for _ in range(_MOST_HITS):
            origins = base[live] + at[live, None] * frame[2]
            hit = self._hit(origins, ways[live])
            live, hit = live[hit >= 0], hit[hit >= 0]
            if not len(live):
                break
            height, _ = self._at(hit, base[live], frame[2])
            height = np.maximum(height, at[live])
            inwards = self.normals[hit] @ frame[2] < 0
            for rows, chosen in ((entries, inwards), (exits, ~inwards)):
                row = np.full(len(base), np.inf)
                row[live[chosen]] = height[chosen]
                rows.append(row)
            at[live] = height + _STEP_MM
        none = np.full((1, len(base)), np.inf)
        return np.array(entries or none).T.reshape(len(base), -1), np.array(
            exits or none
        ).T.reshape(len(base), -1)

    def meets(self, origins: Floats, ways: Floats) -> tuple[NDArray[np.int64], Floats]:
        """Return the triangles that rays of their own directions meet first, and how far off.

        A ray that meets none has -1 and infinity.
        """
        hit = self._hit(origins, ways)
        distance = np.full(len(hit), np.inf)
        struck = np.flatnonzero(hit >= 0)
        normals = self.normals[hit[struck]]
        facing = np.einsum("ij,ij->i", normals, ways[struck])
        apart = np.einsum("ij,ij->i", self._corner[hit[struck]] - origins[struck], normals)
        distance[struck] = apart / np.where(np.abs(facing) > 1e-12, facing, 1.0)
        return hit, distance

    def _hit(self, origins: Floats, ways: Floats) -> NDArray[np.int64]:
        if not len(origins):
            return np.zeros(0, dtype=np.int64)
        found = self._scene.run(
            np.ascontiguousarray(origins, dtype=np.float32),
            np.ascontiguousarray(ways, dtype=np.float32),
        )
        return np.asarray(found, dtype=np.int64)

    def _at(self, hit: NDArray[np.int64], base: Floats, direction: Floats) -> tuple[Floats, Floats]:
        """Return heights and slopes at the triangles that were hit."""
        height = np.full(len(hit), np.nan)
        slope = np.zeros(len(hit))
        struck = np.flatnonzero(hit >= 0)
        normals, corner = self.normals[hit[struck]], self._corner[hit[struck]]
        facing = normals @ direction
        safe = np.where(np.abs(facing) > 1e-12, facing, 1.0)
        value = np.einsum("ij,ij->i", corner - base[struck], normals) / safe
        span = self._corners[hit[struck]] @ direction
        height[struck] = np.clip(value, span.min(axis=1), span.max(axis=1))
        slope[struck] = np.abs(facing)
        return height, slope
