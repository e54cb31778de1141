"""Bodies of revolution, whose spin about their axis changes nothing."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from skillplan.collision import make_polyhedron
from skillplan.task.pose import Point, Pose, plus
from skillplan.task.scene import Body

# Most of a normal that points around the axis, as at the corners of a prism with 16 sides, height
# of ribs that may exceed it, half the least play of fits [m], and share of a surface in slivers.
_AROUND, _RIB_M, _SLIVERS = 0.2, 5e-5, 1e-3
# Cosine of half the angle below which a turn counts: 0.3 degrees.
_STILL = 1 - 3.4e-6


def undo_spin(body: Body, final: Pose, expected: Pose) -> Pose:
    """Return a pose without the spin of a body of revolution about its axis since another pose."""
    turned = expected.inverse().then(final).orientation
    found = _find_axis(body) if abs(turned[3]) < _STILL else None
    if found is None:
        return final
    axis, centre = found
    half_rad = -math.atan2(turned[axis], turned[3])
    x, y, z = (math.sin(half_rad) if number == axis else 0.0 for number in range(3))
    back = Pose((0.0, 0.0, 0.0), (x, y, z, math.cos(half_rad)))
    return final.then(Pose(plus(centre, back.apply(centre), -1.0), back.orientation))


@cache
def _find_axis(body: Body) -> tuple[int, Point] | None:
    """Return the number of the axis of a body of revolution, and a point on it [m]; or None."""
    origin = Pose((0.0, 0.0, 0.0))
    triangles = np.concatenate(
        [make_polyhedron(shape, origin).triangles for shape in body.exact_shapes]
    )
    # Corners of a flat side are as far from the axis as each other, its middle is not.
    points = np.concatenate([triangles, (triangles + np.roll(triangles, 1, axis=1)) / 2], axis=1)
    x, y, z = ((triangles.min(axis=(0, 1)) + triangles.max(axis=(0, 1))) / 2).tolist()
    sides = triangles[:, 1:] - triangles[:, :1]
    across = np.cross(sides[:, 0], sides[:, 1])
    areas = np.linalg.norm(across, axis=1)
    normals = across / np.maximum(areas, 1e-30)[:, None]
    for number, axis in enumerate(np.eye(3)):
        around = np.cross(axis, points - (x, y, z))
        radii_m = np.linalg.norm(around, axis=2)
        shares = np.abs(np.einsum("ijk,ik->ij", around, normals)) / np.maximum(radii_m, 1e-30)
        is_flat = (shares.max(axis=1) > _AROUND) & (np.ptp(radii_m, axis=1) > _RIB_M)
        if areas[is_flat].sum() <= _SLIVERS * areas.sum():
            return number, (x, y, z)
    return None
