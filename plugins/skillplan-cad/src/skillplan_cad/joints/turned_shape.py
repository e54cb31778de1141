"""What of a part lies about one axis: its cylinders, its profile, and faces for a tool."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan_cad.product import Face, Part

Floats = NDArray[np.float64]

_ONE_LINE_RAD, _STEPS = 0.01, 48
# Most pairs of places and triangles at a time.
_PAIRS = 100_000


@dataclass(frozen=True, slots=True, eq=False)
class TurnedShape:
    """A part about its main axis.

    Parameters
    ----------
    axis, origin_m
        The axis; it looks to the wide end.
    low_m, high_m
        Where the part begins and ends along it, from the origin on.
    shank
        The longest cylinder about it; of a part that has none on its outside the longest hole.
    head_radius_m
        Greatest radius at the wide end.
    shank_length_m
        How much of the part belongs to no head, from the narrow end on.
    bore
        The longest hole about it, or None.
    inner_planes, outer_planes
        How many flat faces along the axis look to it and away from it, at one distance.
    """

    axis: Floats
    origin_m: Floats
    low_m: float
    high_m: float
    shank: Face
    head_radius_m: float
    shank_length_m: float
    bore: Face | None
    inner_planes: int
    outer_planes: int

    @property
    def length_m(self) -> float:
        """From end to end."""
        return self.high_m - self.low_m

    @property
    def wide_share(self) -> float:
        """Radius of the wide end by the shank's."""
        return self.head_radius_m / self.shank.radius_m

    @property
    def is_ring(self) -> bool:
        """Whether nothing but a hole is round about the axis, as in a hexagon nut."""
        return self.shank.hollow


def turned_shape(part: Part) -> TurnedShape | None:
    """Return a part about the axis of its greatest cylinder, or None without one.

    Cylinders on its outside go before holes.
    """
    round_faces = [one for one in part.faces if one.kind == "cylinder" and one.radius_m > 0]
    outer = [one for one in round_faces if not one.hollow] or round_faces
    if not outer:
        return None
    main = max(outer, key=lambda one: one.radius_m * _length_m(one) * one.turn_rad)
    axis, origin = np.asarray(main.axis), np.asarray(main.origin_m)
    if np.abs(axis).max() > 1 - 1e-9:
        # Fitted to triangles, an axis of the file is one but for rounding.
        axis = np.round(axis) + 0.0
    shafts = [one for one in outer if _about(one, axis, origin)]
    bores = [one for one in round_faces if one.hollow and _about(one, axis, origin)]
    shank = max(shafts, key=lambda one: (round(_length_m(one), 7), -one.radius_m))
    along, radius = _profile(part, axis, origin)
    low, high = float(along[0]), float(along[-1])
    quarter = max(1, len(radius) // 4)
    # The drive of a screw without a head shows the end that it is turned by.
    upper, lower = float(np.nanmax(radius[-quarter:])), float(np.nanmax(radius[:quarter]))
    if upper < lower * (1 - 1e-3) or (
        upper < lower * (1 + 1e-3) and _drive_place(part, axis, origin) < (low + high) / 2
    ):
        axis, along, radius = -axis, -along[::-1], radius[::-1]
        low, high = -high, -low
    # Threads stand out from a core; a head is wider than the middle of both.
    limit = max(1.15 * shank.radius_m, (shank.radius_m + max(upper, lower)) / 2)
    narrow = np.nan_to_num(radius, nan=0.0) <= limit
    wide = np.flatnonzero(~narrow)
    end = float(along[wide[0]]) if len(wide) else high
    inner, outside = _planes_along(part, axis, origin)
    return TurnedShape(
        axis,
        origin,
        low,
        high,
        shank,
        max(upper, lower),
        end - low,
        max(bores, key=_length_m, default=None),
        inner,
        outside,
    )


def _about(face: Face, axis: Floats, origin: Floats) -> bool:
    apart = np.asarray(face.origin_m) - origin
    off = np.linalg.norm(apart - (apart @ axis) * axis)
    return bool(
        np.linalg.norm(np.cross(face.axis, axis)) < _ONE_LINE_RAD and off < 0.05 * face.radius_m
    )


def _length_m(face: Face) -> float:
    return face.extent_m[1] - face.extent_m[0]


def _profile(part: Part, axis: Floats, origin: Floats) -> tuple[Floats, Floats]:
    """Return positions along an axis, and the greatest radius of the part at each."""
    apart = part.vertices_m - origin
    along = apart @ axis
    radius = np.linalg.norm(apart - along[:, None] * axis, axis=1)
    low, high = float(along.min()), float(along.max())
    places = np.linspace(low, high, _STEPS)
    corners_along, corners_radius = along[part.triangles], radius[part.triangles]
    slack = (high - low) * 1e-6
    lowest, highest = corners_along.min(axis=1), corners_along.max(axis=1)
    found = np.full(_STEPS, np.nan)
    count = max(1, _PAIRS // max(1, len(lowest)))
    for first in range(0, _STEPS, count):
        rows = places[first : first + count, None]
        cut = (lowest <= rows + slack) & (highest >= rows - slack)
        radii = _radii_at(corners_along, corners_radius, rows, cut)
        found[first : first + count] = np.where(cut.any(axis=1), radii, np.nan)
    return places, found


def _radii_at(along: Floats, radius: Floats, rows: Floats, cut: NDArray[np.bool_]) -> Floats:
    """Return the greatest radius of triangles where they pass each place, of those it cuts."""
    best = np.zeros(len(rows))
    for one, two in ((0, 1), (1, 2), (2, 0)):
        a, b = along[:, one], along[:, two]
        passes = cut & (np.minimum(a, b) <= rows + 1e-9) & (np.maximum(a, b) >= rows - 1e-9)
        run = np.where(np.abs(b - a) > 1e-12, b - a, 1.0)
        share = np.clip((rows - a) / run, 0.0, 1.0)
        value = radius[:, one] + share * (radius[:, two] - radius[:, one])
        best = np.maximum(best, np.where(passes, value, 0.0).max(axis=1))
    return np.asarray(best)


def _planes_along(part: Part, axis: Floats, origin: Floats) -> tuple[int, int]:
    """Return how many flat faces along the axis look to it and away from it, at one distance."""
    counts: dict[tuple[bool, int], int] = {}
    for face in part.faces:
        if face.kind == "plane" and abs(np.dot(face.axis, axis)) < 0.02:
            away = float(np.dot(np.subtract(face.origin_m, origin), face.axis))
            if abs(away) > 1e-6:
                key = away > 0, round(abs(away) * 2e4)
                counts[key] = counts.get(key, 0) + 1
    inner = max((count for (away, _), count in counts.items() if not away), default=0)
    outer = max((count for (away, _), count in counts.items() if away), default=0)
    return inner, outer


def _drive_place(part: Part, axis: Floats, origin: Floats) -> float:
    """Return where along the axis flat faces for a tool lie; infinity without any."""
    places = [
        float(np.mean((part.vertices_m[np.unique(part.triangles[face.triangles])] - origin) @ axis))
        for face in part.faces
        if face.kind == "plane"
        and abs(np.dot(face.axis, axis)) < 0.02
        and float(np.dot(np.subtract(face.origin_m, origin), face.axis)) < -1e-6
    ]
    return float(np.mean(places)) if places else float("inf")
