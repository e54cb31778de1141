"""Describe a part about its main axis: cylinders, profile, and faces for a tool."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan_cad.product import Face, Part

Floats = NDArray[np.float64]

_ONE_LINE_RAD, _STEPS = 0.01, 48
# Largest number of pairs of places and triangles processed at a time.
_PAIRS = 100_000


@dataclass(frozen=True, slots=True, eq=False)
class TurnedShape:
    """A part about its main axis.

    Parameters
    ----------
    axis, origin_m
        The axis, which points to the wide end.
    low_m, high_m
        Extent along the axis, from the origin.
    shank
        Longest outer cylinder about the axis; the longest hole if there is none.
    shank_length_m
        Length from the narrow end to the head.
    bore
        Longest hole about the axis, or None.
    inner_planes, outer_planes
        Number of flat faces along the axis that face it, and that face away from it, at one
        distance.
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
        """Length from end to end."""
        return self.high_m - self.low_m

    @property
    def wide_share(self) -> float:
        """Radius of the wide end divided by that of the shank."""
        return self.head_radius_m / self.shank.radius_m

    @property
    def is_ring(self) -> bool:
        """True if a hole is the only round face about the axis, as in a hexagon nut."""
        return self.shank.hollow


def describe_turned_shape(part: Part) -> TurnedShape | None:
    """Return a part about the axis of its largest cylinder, or None without cylinders.

    Outer cylinders have priority over holes.
    """
    round_faces = [face for face in part.faces if face.kind == "cylinder" and face.radius_m > 0]
    outer = [face for face in round_faces if not face.hollow] or round_faces
    if not outer:
        return None
    main = max(outer, key=lambda face: face.radius_m * _measure_length_m(face) * face.turn_rad)
    axis, origin = np.asarray(main.axis), np.asarray(main.origin_m)
    if np.abs(axis).max() > 1 - 1e-9:
        # Axes fitted to triangles differ from the file's by rounding.
        axis = np.round(axis) + 0.0
    shafts = [face for face in outer if _is_coaxial(face, axis, origin)]
    bores = [
        round_face
        for round_face in round_faces
        if round_face.hollow and _is_coaxial(round_face, axis, origin)
    ]
    shank = max(shafts, key=lambda shaft: (round(_measure_length_m(shaft), 7), -shaft.radius_m))
    along, radius = _measure_profile(part, axis, origin)
    low, high = float(along[0]), float(along[-1])
    quarter = max(1, len(radius) // 4)
    # The drive of a headless screw marks its upper end.
    upper, lower = float(np.nanmax(radius[-quarter:])), float(np.nanmax(radius[:quarter]))
    if upper < lower * (1 - 1e-3) or (
        upper < lower * (1 + 1e-3) and _locate_drive(part, axis, origin) < (low + high) / 2
    ):
        axis, along, radius = -axis, -along[::-1], radius[::-1]
        low, high = -high, -low
    # Threads protrude from the core; a head is wider than the mean of both.
    limit = max(1.15 * shank.radius_m, (shank.radius_m + max(upper, lower)) / 2)
    narrow = np.nan_to_num(radius, nan=0.0) <= limit
    wide = np.flatnonzero(~narrow)
    end = float(along[wide[0]]) if len(wide) else high
    inner, outside = _count_planes(part, axis, origin)
    return TurnedShape(
        axis,
        origin,
        low,
        high,
        shank,
        max(upper, lower),
        end - low,
        max(bores, key=_measure_length_m, default=None),
        inner,
        outside,
    )


def _is_coaxial(face: Face, axis: Floats, origin: Floats) -> bool:
    offset = np.asarray(face.origin_m) - origin
    off = np.linalg.norm(offset - (offset @ axis) * axis)
    return bool(
        np.linalg.norm(np.cross(face.axis, axis)) < _ONE_LINE_RAD and off < 0.05 * face.radius_m
    )


def _measure_length_m(face: Face) -> float:
    return face.extent_m[1] - face.extent_m[0]


def _measure_profile(part: Part, axis: Floats, origin: Floats) -> tuple[Floats, Floats]:
    """Return positions along an axis, and the largest radius of the part at each."""
    offsets = part.vertices_m - origin
    along = offsets @ axis
    radius = np.linalg.norm(offsets - along[:, None] * axis, axis=1)
    low, high = float(along.min()), float(along.max())
    places = np.linspace(low, high, _STEPS)
    corners_along, corners_radius = along[part.triangles], radius[part.triangles]
    slack = (high - low) * 1e-6
    lowest, highest = corners_along.min(axis=1), corners_along.max(axis=1)
    profile = np.full(_STEPS, np.nan)
    count = max(1, _PAIRS // max(1, len(lowest)))
    for first in range(0, _STEPS, count):
        rows = places[first : first + count, None]
        cut = (lowest <= rows + slack) & (highest >= rows - slack)
        radii = _measure_radii(corners_along, corners_radius, rows, cut)
        profile[first : first + count] = np.where(cut.any(axis=1), radii, np.nan)
    return places, profile


def _measure_radii(along: Floats, radius: Floats, rows: Floats, cut: NDArray[np.bool_]) -> Floats:
    """Return the largest radius at each place among the triangles cut there."""
    best = np.zeros(len(rows))
    for first, second in ((0, 1), (1, 2), (2, 0)):
        a, b = along[:, first], along[:, second]
        passes = cut & (np.minimum(a, b) <= rows + 1e-9) & (np.maximum(a, b) >= rows - 1e-9)
        run = np.where(np.abs(b - a) > 1e-12, b - a, 1.0)
        share = np.clip((rows - a) / run, 0.0, 1.0)
        value = radius[:, first] + share * (radius[:, second] - radius[:, first])
        best = np.maximum(best, np.where(passes, value, 0.0).max(axis=1))
    return np.asarray(best)


def _count_planes(part: Part, axis: Floats, origin: Floats) -> tuple[int, int]:
    """Return the largest numbers of flat faces at one distance that face the axis and away."""
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


def _locate_drive(part: Part, axis: Floats, origin: Floats) -> float:
    """Return the mean position of flat drive faces along the axis; infinity without any."""
    places = [
        float(np.mean((part.vertices_m[np.unique(part.triangles[face.triangles])] - origin) @ axis))
        for face in part.faces
        if face.kind == "plane"
        and abs(np.dot(face.axis, axis)) < 0.02
        and float(np.dot(np.subtract(face.origin_m, origin), face.axis)) < -1e-6
    ]
    return float(np.mean(places)) if places else float("inf")
