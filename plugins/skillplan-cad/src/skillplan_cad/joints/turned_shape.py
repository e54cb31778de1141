"""Describe a part about its main axis: profile, bore, and faces for a tool."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from skillplan.collision.contact_forces import find_axes_across
from skillplan_cad.blocking.ray_mesh import RayMesh
from skillplan_cad.product import Face, Part, Vector
from skillplan_cad.reading.raw_part import compute_area_vectors_m2

Floats = NDArray[np.float64]

_ONE_LINE_RAD, _STEPS = 0.01, 48
# Largest number of pairs of places and triangles processed at a time.
_PAIRS = 100_000
# Angles around an axis; share of them that must meet a hole's wall; stations along a bore.
_ANGLES, _AROUND, _STATIONS = 48, 0.6, 16
# Smallest evenness about an axis of inertia; difference that does not count; largest distance of
# the centre of mass, in radii; smallest difference between the moments that gives an axis.
_EVEN, _AS_EVEN, _CENTRED, _DISTINCT = 0.9, 0.02, 0.1, 0.03


@dataclass(frozen=True, slots=True, eq=False)
class TurnedShape:
    """A part about its main axis.

    Parameters
    ----------
    axis, origin_m
        The axis, which points to the wide end.
    low_m, high_m
        Extent along the axis, from the origin.
    shank_m
        Radius of the shank; of the outside for rings.
    shank_length_m
        Length from the narrow end to the head.
    head_m
        Largest radius at the wide end.
    bore_m
        Radius of the hole along the axis; 0 without a through hole.
    inner_planes, outer_planes
        Number of flat faces along the axis that face it, and that face away from it, at one
        distance.
    drive_m
        Distance of the inner planes from the axis; 0 without any.
    evenness
        Smaller moment of inertia across the axis divided by the larger, 0 to 1.
    offset_m
        Distance of the centre of mass from the axis.
    """

    axis: Floats
    origin_m: Floats
    low_m: float
    high_m: float
    shank_m: float
    shank_length_m: float
    head_m: float
    bore_m: float
    inner_planes: int
    outer_planes: int
    drive_m: float
    evenness: float
    offset_m: float

    @property
    def length_m(self) -> float:
        """Length from end to end."""
        return self.high_m - self.low_m

    @property
    def wide_share(self) -> float:
        """Radius of the wide end divided by that of the shank."""
        return self.head_m / self.shank_m

    def is_on_axis(self, axis: Floats, point_m: Floats) -> bool:
        """Return whether a line is the axis, up to tolerances of CAD."""
        offset = point_m - self.origin_m
        off = float(np.linalg.norm(offset - (offset @ self.axis) * self.axis))
        turned = float(np.linalg.norm(np.cross(self.axis, axis)))
        return turned < 0.02 and off < 0.2 * self.shank_m


def describe_turned_shape(part: Part) -> TurnedShape | None:
    """Return a part about its axis, or None for a part without one.

    The axis is that of inertia about which mass is spread most evenly, or that of the largest
    cylinder if mass is spread as evenly about it: a cylinder is more exact, but those that are
    fitted to triangles may be a part of a fillet.
    """
    moments = _measure_moments(part)
    lines = (_find_cylinder_axis(part), _find_inertia_axis(part, moments))
    round_one, turned = (line and _describe(part, *_square(part, *line), moments) for line in lines)
    if round_one is None or turned is None:
        return round_one or turned
    is_centred = round_one.offset_m <= _CENTRED * round_one.shank_m
    if turned.evenness < _EVEN or (is_centred and round_one.evenness >= turned.evenness - _AS_EVEN):
        return round_one
    return turned


def measure_holes_mm(
    mesh: RayMesh, points_mm: Floats, axis: Floats, limit_mm: float
) -> NDArray[np.float64]:
    """Return the radius of a mesh's hole around each point of an axis [mm].

    The radius is 0 inside of its material, and nan where no wall of radius `limit_mm` surrounds
    the point.
    """
    hit, distance, leaves = _trace_around(mesh, points_mm, axis)
    is_wall = ((hit >= 0) & ~leaves & (distance <= limit_mm)).reshape(-1, _ANGLES)
    is_inside = ((hit >= 0) & leaves).reshape(-1, _ANGLES).mean(axis=1) >= _AROUND
    distance = np.where(is_wall, distance.reshape(-1, _ANGLES), np.nan)
    radii = np.full(len(points_mm), np.nan)
    around = is_wall.mean(axis=1) >= _AROUND
    radii[around] = np.nanmedian(distance[around], axis=1)
    radii[is_inside] = 0.0
    return radii


def trace_outside_mm(mesh: RayMesh, points_mm: Floats, axis: Floats) -> NDArray[np.float64]:
    """Return the distances of a mesh's outside from points in it, (points, angles) [mm].

    Rays that start outside have nan.
    """
    hit, distance, leaves = _trace_around(mesh, points_mm, axis)
    is_inside = (hit >= 0) & leaves
    return np.where(is_inside, distance, np.nan).reshape(-1, _ANGLES)


def _trace_around(
    mesh: RayMesh, points_mm: Floats, axis: Floats
) -> tuple[NDArray[np.int64], Floats, NDArray[np.bool_]]:
    """Trace rays from each point across an axis; return hits, distances, and which leave it."""
    first, second = _find_across(axis)
    angles = (np.arange(_ANGLES) + 0.37) * 2 * np.pi / _ANGLES
    rays = np.cos(angles)[:, None] * first + np.sin(angles)[:, None] * second
    origins = np.repeat(points_mm, _ANGLES, axis=0)
    directions = np.tile(rays, (len(points_mm), 1))
    hit, distance = mesh.trace(origins, directions)
    return hit, distance, np.einsum("ij,ij->i", mesh.normals[hit], directions) > 0


def _find_across(axis: Floats) -> Floats:
    x, y, z = axis.tolist()
    return find_axes_across((x, y, z))


def _describe(part: Part, axis: Floats, origin: Floats, moments: Floats) -> TurnedShape:
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
    head = max(upper, lower)
    own = [face for face in part.faces if _is_coaxial(face, axis, origin)]
    bore = _measure_bore_m(part, axis, origin, low, high)
    for face in own:
        if face.hollow and abs(face.radius_m - bore) < 0.02 * bore:
            bore = face.radius_m
    shank, end = _measure_shank(along, radius, head, [face for face in own if not face.hollow])
    inner, outside, drive = _count_planes(part, axis, origin)
    across = _find_across(axis)
    spread = np.linalg.eigvalsh(across @ moments @ across.T)
    offset = np.asarray(part.centre_m) - origin
    return TurnedShape(
        axis,
        origin,
        low,
        high,
        shank,
        end - low,
        head,
        bore,
        inner,
        outside,
        drive,
        float(spread[0] / spread[1]) if spread[1] > 0 else 0.0,
        float(np.linalg.norm(offset - (offset @ axis) * axis)),
    )


def _find_cylinder_axis(part: Part) -> tuple[Floats, Floats] | None:
    """Return axis and origin of the largest outer cylinder, or of the largest hole."""
    round_faces = [face for face in part.faces if face.kind == "cylinder" and face.radius_m > 0]
    outer = [face for face in round_faces if not face.hollow] or round_faces
    if not outer:
        return None
    main = max(outer, key=lambda face: face.radius_m * _measure_length_m(face) * face.turn_rad)
    axis = np.asarray(main.axis)
    if np.abs(axis).max() > 1 - 1e-9:
        # Axes fitted to triangles differ from the file's by rounding.
        axis = np.round(axis) + 0.0
    return axis, np.asarray(main.origin_m)


def _find_inertia_axis(part: Part, moments: Floats) -> tuple[Floats, Floats] | None:
    """Return the principal axis about which mass is spread most evenly, or None."""
    values, vectors = np.linalg.eigh(moments)
    if values[0] <= 0 or values[2] < (1 + _DISTINCT) * values[0]:
        return None
    smallest, middle, largest = values
    axis = vectors[:, 2] if smallest / middle >= middle / largest else vectors[:, 0]
    axis = np.where(np.abs(axis) < 1e-4, 0.0, axis)
    axis = axis * np.sign(axis[int(np.argmax(np.abs(axis)))])
    return axis / np.linalg.norm(axis), np.asarray(part.centre_m)


def _square(part: Part, axis: Floats, origin: Floats) -> tuple[Floats, Floats]:
    """Return an axis made square to the widest flat end within 0.01 rad, and a point on it.

    Facets of curved faces spoil moments and cylinders that are fitted to them.
    """
    ends = [face for face in part.faces if face.kind == "plane" and _is_along(face.axis, axis)]
    if not ends:
        return axis, origin
    areas_m2 = np.linalg.norm(compute_area_vectors_m2(part.vertices_m, part.triangles), axis=1)
    widest = max(ends, key=lambda face: float(areas_m2[face.triangles].sum()))
    normal = np.asarray(widest.axis)
    middle = origin + ((np.asarray(part.centre_m) - origin) @ axis) * axis
    return normal if normal @ axis > 0 else -normal, middle


def _is_along(direction: Vector, axis: Floats) -> bool:
    return float(np.linalg.norm(np.cross(np.asarray(direction), axis))) < _ONE_LINE_RAD


def _measure_moments(part: Part) -> Floats:
    """Return the second moments of a part's volume about its centre [m5]."""
    corners = part.vertices_m[part.triangles] - part.centre_m
    sixth = np.linalg.det(corners) / 6
    total = corners.sum(axis=1)
    own = np.einsum("n,nki,nkj->ij", sixth, corners, corners)
    return np.asarray((own + np.einsum("n,ni,nj->ij", sixth, total, total)) / 20)


def _measure_bore_m(part: Part, axis: Floats, origin: Floats, low: float, high: float) -> float:
    """Return the radius of the through hole along an axis; 0 without one."""
    along = low + (np.arange(_STATIONS) + 0.5) / _STATIONS * (high - low)
    mesh = RayMesh(part, origin)
    radii = measure_holes_mm(mesh, along[:, None] * axis * 1000, axis, 2 * mesh.reach_mm)
    return 0.0 if (~(radii > 0)).any() else float(np.median(radii)) / 1000


def _measure_shank(
    along: Floats, radius: Floats, head: float, cylinders: list[Face]
) -> tuple[float, float]:
    """Return the radius of the shank and the place where the head begins.

    A cylinder gives the exact radius, if there is one as wide as the profile.
    """
    filled = np.where(np.isnan(radius), 0.0, radius)
    shank = float(np.percentile(filled[1:], 30)) or head
    # Threads protrude from the core; a head is wider than the mean of both.
    limit = max(1.15 * shank, (shank + head) / 2)
    wide = np.flatnonzero(filled > limit)
    first = int(wide[0]) if len(wide) else len(filled)
    end = float(along[first]) if len(wide) else float(along[-1])
    if first > 2:
        shank = float(np.percentile(filled[1:first], 75))
    near = [face for face in cylinders if abs(face.radius_m - shank) < 0.06 * shank]
    if near:
        shank = max(near, key=_measure_length_m).radius_m
    return shank, end


def _is_coaxial(face: Face, axis: Floats, origin: Floats) -> bool:
    if face.kind != "cylinder":
        return False
    offset = np.asarray(face.origin_m) - origin
    off = np.linalg.norm(offset - (offset @ axis) * axis)
    return _is_along(face.axis, axis) and bool(off < 0.05 * face.radius_m)


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


def _count_planes(part: Part, axis: Floats, origin: Floats) -> tuple[int, int, float]:
    """Return the largest numbers of flat faces at one distance that face the axis and away.

    The third number is the distance of those that face the axis [m]; 0 without any.
    """
    counts: dict[tuple[bool, int], int] = {}
    for face in part.faces:
        if face.kind == "plane" and abs(np.dot(face.axis, axis)) < 0.02:
            away = float(np.dot(np.subtract(face.origin_m, origin), face.axis))
            if abs(away) > 1e-6:
                key = away > 0, round(abs(away) * 2e4)
                counts[key] = counts.get(key, 0) + 1
    inner = {place: count for (away, place), count in counts.items() if not away}
    outer = max((count for (away, _), count in counts.items() if away), default=0)
    nearest = max(inner, key=lambda place: (inner[place], -place), default=0)
    return inner.get(nearest, 0), outer, nearest / 2e4


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
