"""Check a nest by rays against the meshes of its part, without knowing how it was made.

Rays from points on the part test the nest, and rays from corners of the nest test the part.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import manifold3d
import numpy as np
import shapely
from numpy.typing import NDArray

from skillplan.collision import compute_margin_m
from skillplan_cad.blocking.ray_mesh import RayMesh, RayView
from skillplan_cad.nests.nest import KeepFree, Nest, measure_margin
from skillplan_cad.nests.stepped_mesh import Body, is_watertight
from skillplan_cad.product import Points, Triangles, Vector, make_solid
from skillplan_cad.reading.mending import compute_centre_m, compute_volumes_m3

Floats = NDArray[np.float64]
_TO_MM = 1e3
# Resolution of rays: greatest overlap that counts as none [mm].
_SLACK_MM = 2e-3
# Distance of sampled points of the part, least and as a share of its extent, and their most.
_SPACING_MM, _SPACING_SHARE = 0.25, 1 / 250
MOST_SAMPLES, _COARSE_SAMPLES = 150_000, 30_000
# The first direction is along no usual wall, since rays along walls are not exact.
_DIRECTIONS, _FIRST_RAD = 24, 0.0123
# Height by which the part is lifted before rays go sideways, so that they miss the floor [mm].
_LIFT_MM = 0.01
# Greatest gap of a point that rests on the nest, as far as facets of curved faces leave it [mm].
_RESTS_MM = 0.02
# Sideways play is measured up to this distance [mm], and turns up to this angle.
_MOST_PLAY_MM = 5.0
_LEAST_TURN_RAD, _MOST_TURN_RAD = 0.002, math.radians(60)
_TURN_STEPS, _TURN_HALVINGS, _TURN_SAMPLES = 16, 6, 10_000
# Walls hold a part that its supports do not if they stop it within this angle, by an overlap that
# round bottoms do not have [mm].
HELD_DEG, _STOPPED_MM = 1.5, 0.1
# A part that turns by this angle without rising, sinking [mm] or meeting a wall is round: it rolls
# on the spot.
_ROLL_RAD, _ROLL_MM = 0.65, 0.05
# An undercut begins at this distance from the wall, as far as it has this share of the held walls.
_UNDERCUT_MM, _UNDERCUT_SHARE = 0.05, 0.01
_LEAST_DROP = 0.9


@dataclass(frozen=True, slots=True)
class Undercut:
    """A region of a body's walls in the pocket that no wall can follow, since it lies further in.

    Parameters
    ----------
    body
        Number of the body.
    low_m, high_m
        Its heights above the part's lowest point.
    area_m2
        Its area.
    """

    body: int
    low_m: float
    high_m: float
    area_m2: float


@dataclass(frozen=True, slots=True)
class NestCheck:
    """The findings about a nest.

    Parameters
    ----------
    rays
        Number of rays.
    samples
        Number of points on the part and of corners of the nest that rays start from.
    overlap_m
        Greatest depth by which the part on its way would enter the nest; at most 0 if it is free.
    least_gap_m
        Least distance between walls and part sideways, in any height of the way.
    gap_point_m
        Place of the least gap, in the frame of the bodies; None if no wall is nearer than 5 mm.
    play_m
        Least and greatest play of the seated part sideways, in 24 directions; at most 5 mm.
    turn_rad
        Angle by which the seated part turns either way about its centre of mass; None if it turns
        by 60 degrees.
    support_margin_m
        Distance of the centre of mass from the edge of its supports; negative outside.
    needed_margin_m
        Distance with which it stands, also if tilted by 2 degrees.
    held_by_walls
        True if the supports do not suffice, but walls stop the part within 1.5 degrees, or it is
        round.
    supports
        Number of points that rest on the nest.
    bodies
        Number of connected bodies of the nest.
    undercuts
        Regions of the part's walls that the pocket cannot follow.
    faults
        Reasons why the nest is not good; empty if it is.
    """

    rays: int
    samples: int
    overlap_m: float
    least_gap_m: float
    gap_point_m: Vector | None
    play_m: tuple[float, float]
    turn_rad: float | None
    support_margin_m: float
    needed_margin_m: float
    held_by_walls: bool
    supports: int
    bodies: int
    undercuts: tuple[Undercut, ...]
    faults: tuple[str, ...]

    @property
    def is_good(self) -> bool:
        """Whether no fault was found."""
        return not self.faults


@dataclass(frozen=True, slots=True, eq=False)
class _Mesh:
    """A mesh as rays see it."""

    vertices_m: Points
    triangles: Triangles


@dataclass(frozen=True, slots=True, eq=False)
class _Samples:
    """Points of the part within the nest, with their normals, bodies and areas [mm]."""

    points: Floats
    normals: Floats
    body: NDArray[np.int64]
    areas: Floats

    def pick(self, chosen: NDArray[Any]) -> _Samples:
        return _Samples(
            self.points[chosen], self.normals[chosen], self.body[chosen], self.areas[chosen]
        )


class _Contact:
    """Part and nest upright in millimetres, about the part's middle."""

    def __init__(self, bodies: Sequence[Body], nest: Nest, most: int) -> None:
        turned = [vertices @ nest.turn.T for vertices, _ in bodies]
        every = np.concatenate(turned)
        self.middle_m = (every.min(axis=0) + every.max(axis=0)) / 2
        offsets = np.cumsum([0, *(len(points) for points in turned)])
        triangles = [t + start for (_, t), start in zip(bodies, offsets, strict=False)]
        self.part = RayMesh(_Mesh(every, np.concatenate(triangles)), self.middle_m)
        self.nest = RayMesh(_Mesh(nest.upright_m, nest.triangles), self.middle_m)
        self.part_view, self.nest_view = (RayView(m, np.eye(3)) for m in (self.part, self.nest))
        self.low, self.top = self.part_view.bottom, self.nest_view.top
        own = np.repeat(np.arange(len(bodies)), [len(t) for _, t in bodies])
        self.samples = _sample(self.part, own, self.top + _SLACK_MM, most)
        self.corners = np.unique(self.nest.points_mm, axis=0)
        self.rays = 0

    def measure_overlap(
        self, points: Floats, corners: Floats, origins: Floats
    ) -> tuple[float, Floats]:
        """Return the greatest overlap of the moved part on its way down, and its place.

        Parameters
        ----------
        points
            Points of the moved part.
        corners
            Corners of the nest, moved the other way.
        origins
            The same corners in place.
        """
        tops = self.nest_view.trace_first(points[:, :2], -1)
        bottoms = self.part_view.trace_first(corners[:, :2], 1)
        self.rays += len(points) + len(corners)
        over = np.concatenate([tops - points[:, 2], corners[:, 2] - bottoms])
        over = np.where(np.isnan(over), -np.inf, over)
        worst = int(np.argmax(over))
        return float(over[worst]), np.concatenate([points, origins])[worst]

    def measure_shifted(self, shift: Floats) -> tuple[float, Floats]:
        """Return the greatest overlap with the part moved aside, and its place."""
        move = np.array([*shift, 0.0])
        points = self.samples.points + move
        return self.measure_overlap(points, self.corners - move, self.corners)

    def measure_play(self, toward: Floats, lift_mm: float) -> tuple[float, Floats]:
        """Return how far the lifted part moves aside until it meets the nest, and where."""
        lift = np.array([0.0, 0.0, lift_mm])
        starts = self.samples.points + lift
        starts = starts[starts[:, 2] < self.top]
        corners = self.corners - lift
        best, place = _MOST_PLAY_MM, np.zeros(3)
        for mesh, origins, sign in ((self.nest, starts, 1.0), (self.part, corners, -1.0)):
            rays = np.repeat((sign * toward)[None], len(origins), axis=0)
            _, distances = mesh.trace(origins - _SLACK_MM * rays, rays)
            self.rays += len(origins)
            if len(distances) and float(distances.min()) - _SLACK_MM < best:
                nearest = int(np.argmin(distances))
                best, place = float(distances[nearest]) - _SLACK_MM, origins[nearest]
        return max(best, 0.0), place

    def measure_turn(self, centre: Floats) -> float | None:
        """Return the angle by which the seated part turns about an axis until it meets the nest."""
        step = max(1, len(self.samples.points) // _TURN_SAMPLES)
        points = self.samples.points[::step]

        def meets(angle: float) -> bool:
            moved = _turn(points, centre, angle)
            corners = _turn(self.corners, centre, -angle)
            return self.measure_overlap(moved, corners, self.corners)[0] > _RESTS_MM

        angles = np.geomspace(_LEAST_TURN_RAD, _MOST_TURN_RAD, _TURN_STEPS).tolist()
        free_rad = math.inf
        for sign in (1.0, -1.0):
            met = next((a for a in angles if a < free_rad and meets(sign * a)), None)
            if met is None:
                continue
            low, high = max((0.0, *(a for a in angles if a < met))), met
            for _ in range(_TURN_HALVINGS):
                middle = (low + high) / 2
                low, high = (low, middle) if meets(sign * middle) else (middle, high)
            free_rad = high
        return free_rad if math.isfinite(free_rad) else None

    def measure_turned(self, pivot: Floats, axis: Floats, angle_rad: float) -> float:
        """Return how deep the turned part would enter the nest; negative if it sinks.

        Parameters
        ----------
        pivot, axis
            Point of the axis, and its direction, which is level.
        """
        step = max(1, len(self.samples.points) // _TURN_SAMPLES)
        turn = _compute_turn(axis, angle_rad)
        points = (self.samples.points[::step] - pivot) @ turn.T + pivot
        tops = self.nest_view.trace_first(points[:, :2], -1)
        self.rays += len(points)
        return float(np.nanmax(tops - points[:, 2], initial=-np.inf))

    def is_kept(self, toward: Floats, pivot: Floats, centre: Floats) -> bool:
        """Return whether walls keep the part from tipping over a support, or it is round."""
        axis = np.array([-toward[1], toward[0], 0.0])
        if self.measure_turned(pivot, axis, math.radians(HELD_DEG)) > _STOPPED_MM:
            return True
        return abs(self.measure_turned(centre, axis, _ROLL_RAD)) < _ROLL_MM


def check_nest(
    bodies: Sequence[Body],
    nest: Nest,
    free: Sequence[KeepFree] = (),
    *,
    stands: bool = True,
    may_turn: bool = True,
    most: int = MOST_SAMPLES,
) -> NestCheck:
    """Return what rays find about a nest and its part.

    Parameters
    ----------
    bodies
        Meshes of the part, seated.
    free
        Regions that stay open.
    stands
        False for jaws, which need no support beneath the centre of mass.
    may_turn
        False if the pocket must keep the part from turning, as that of a nut.
    most
        Number of points spread over the part, at most; corners of its triangles come on top.
    """
    contact = _Contact(bodies, nest, most)
    overlap, place = contact.measure_shifted(np.zeros(2))
    clearance_mm = nest.settings.clearance_m * _TO_MM
    angles = _FIRST_RAD + np.arange(_DIRECTIONS) * 2 * math.pi / _DIRECTIONS
    towards = [np.array([math.cos(angle), math.sin(angle), 0.0]) for angle in angles.tolist()]
    tight = (overlap, place)
    shift_mm = clearance_mm - _SLACK_MM
    for toward in towards:
        tight = max(tight, contact.measure_shifted(shift_mm * toward[:2]), key=lambda way: way[0])
    plays = [contact.measure_play(toward, _LIFT_MM) for toward in towards]
    height_mm = max(contact.top - contact.low, 0.0)
    lifted = [
        contact.measure_play(toward, share * height_mm)
        for share in (0.3, 0.6)
        for toward in towards[::2]
    ]
    least_mm, gap_place = min((*plays, *lifted), key=lambda way: way[0])
    if tight[0] > _SLACK_MM:
        gap_place = tight[1]
    centre = _find_centre(bodies, nest, contact.middle_m)
    rests = _find_rests(contact)
    margin = measure_margin(rests[:, :2], centre[:2])
    extent_m = float(np.ptp(contact.part.points_mm, axis=0).max()) / _TO_MM
    height_m = float(centre[2] - rests[:, 2].min(initial=centre[2])) / _TO_MM
    needed = compute_margin_m(extent_m, height_m) * _TO_MM
    is_held = stands and margin < needed
    is_held = is_held and _is_held(contact, rests, centre, needed, towards)
    turn_rad = contact.measure_turn(centre)
    undercuts = _find_undercuts(contact)
    solid = make_solid(nest.vertices_m, nest.triangles)
    count = len(solid.decompose()) if is_watertight(nest.triangles) else 0
    faults = _list_faults(overlap, tight[0], clearance_mm, count)
    if not len(rests):
        faults.append("the part rests on nothing")
    elif stands and margin < needed and not is_held:
        faults.append(_describe_tipping(margin, needed))
    if not may_turn and (turn_rad is None or turn_rad > math.radians(25)):
        faults.append("the part turns in the pocket, so a nut is not held against its screw")
    faults += _find_blocked_regions(nest, free)
    gap_point = nest.turn.T @ (gap_place / _TO_MM + contact.middle_m)
    x, y, z = gap_point.tolist()
    return NestCheck(
        contact.rays,
        len(contact.samples.points) + len(contact.corners),
        overlap / _TO_MM,
        least_mm / _TO_MM,
        (x, y, z) if least_mm < _MOST_PLAY_MM else None,
        (min(play for play, _ in plays) / _TO_MM, max(play for play, _ in plays) / _TO_MM),
        turn_rad,
        margin / _TO_MM,
        needed / _TO_MM,
        is_held,
        len(rests),
        count,
        undercuts,
        tuple(faults),
    )


def drop_bad_coarse(
    bodies: Sequence[Body], nest: Nest, free: Sequence[KeepFree] = (), *, stands: bool = True
) -> Nest:
    """Return a nest without its coarse mesh if that one fails the check."""
    if nest.coarse is None:
        return nest
    vertices_m, triangles = nest.coarse
    coarse = replace(nest, vertices_m=vertices_m, triangles=triangles)
    is_good = check_nest(bodies, coarse, free, stands=stands, most=_COARSE_SAMPLES).is_good
    return nest if is_good else replace(nest, coarse=None)


def _list_faults(overlap: float, tight: float, clearance_mm: float, count: int) -> list[str]:
    faults: list[str] = []
    if count == 0:
        faults.append("the nest is not watertight")
    elif count > 1:
        faults.append(f"the nest falls apart into {count} bodies")
    if overlap > _SLACK_MM:
        faults.append(f"the part meets the nest on its way down, {overlap:.3g} mm deep")
    elif tight > _SLACK_MM:
        faults.append(f"a wall is nearer than the clearance of {clearance_mm:g} mm")
    return faults


def _describe_tipping(margin: float, needed: float) -> str:
    if margin < -_RESTS_MM:
        where = f"{-margin:.3g} mm outside its supports"
    elif margin < _RESTS_MM:
        where = "on the edge of its supports"
    else:
        where = f"{margin:.2g} mm inside the edge of its supports"
    return (
        f"the part tips: its centre of mass lies {where}, where {needed:.2g} mm inside are needed, "
        f"and no wall stops it within {HELD_DEG:g} degrees"
    )


def _is_held(
    contact: _Contact, rests: Floats, centre: Floats, needed: float, towards: Sequence[Floats]
) -> bool:
    """Return whether walls stop the part in all directions in which its supports do not."""
    if not len(rests):
        return False
    for toward in towards:
        along = rests @ toward
        if along.max() - centre @ toward >= needed:
            continue
        if not contact.is_kept(toward, rests[np.argmax(along)], centre):
            return False
    return True


def _sample(mesh: RayMesh, own: NDArray[np.int64], top: float, most: int) -> _Samples:
    """Return the corners of triangles below a height, and points spread over them."""
    corners = mesh.points_mm[mesh.triangles]
    near = corners[:, :, 2].min(axis=1) < top
    corners, normals, own = corners[near], mesh.normals[near], own[near]
    a, ab, ac = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = 0.5 * np.linalg.norm(np.cross(ab, ac), axis=1)
    spacing = max(_SPACING_MM, _SPACING_SHARE * float(np.ptp(mesh.points_mm, axis=0).max()))
    spacing = max(spacing, math.sqrt(float(areas.sum()) / most))
    per = np.ceil(areas / spacing**2).astype(np.int64)
    which = np.repeat(np.arange(len(corners)), per)
    order = np.arange(len(which))
    # A sequence of low discrepancy, folded into the triangle.
    u, v = (order * 0.7548776662466927) % 1.0, (order * 0.5698402909980532) % 1.0
    over = u + v > 1
    u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    spread = a[which] + u[:, None] * ab[which] + v[:, None] * ac[which]
    ends = corners.reshape(-1, 3)
    middles = (corners + np.roll(corners, 1, axis=1)).reshape(-1, 3) / 2
    share = np.where(per[which] > 0, areas[which] / np.maximum(per[which], 1), 0.0)
    thrice = np.repeat(np.arange(len(corners)), 3)
    samples = _Samples(
        np.concatenate([spread, ends, middles]),
        np.concatenate([normals[which], normals[thrice], normals[thrice]]),
        np.concatenate([own[which], own[thrice], own[thrice]]),
        np.concatenate([share, np.zeros(2 * len(thrice))]),
    )
    return samples.pick(samples.points[:, 2] < top)


def _turn(points: Floats, centre: Floats, angle_rad: float) -> Floats:
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray((points - centre) @ turn.T + centre)


def _compute_turn(axis: Floats, angle_rad: float) -> Floats:
    """Return the rotation about a unit vector."""
    x, y, z = axis
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(
        np.eye(3) + math.sin(angle_rad) * across + (1 - math.cos(angle_rad)) * across @ across
    )


def _find_centre(bodies: Sequence[Body], nest: Nest, middle_m: Floats) -> Floats:
    """Return the centre of mass at equal density [mm]."""
    volumes = [float(compute_volumes_m3(*body).sum()) for body in bodies]
    centres = [compute_centre_m(*body) @ nest.turn.T for body in bodies]
    return np.asarray((np.average(centres, axis=0, weights=volumes) - middle_m) * _TO_MM)


def _find_rests(contact: _Contact) -> Floats:
    """Return the points of the part that face down and lie on the nest."""
    down = contact.samples.pick(contact.samples.normals[:, 2] < -0.1)
    tops = contact.nest_view.trace_first(down.points[:, :2], -1)
    contact.rays += len(down.points)
    return down.points[np.nan_to_num(down.points[:, 2] - tops, nan=np.inf) < _RESTS_MM]


def _find_undercuts(contact: _Contact) -> tuple[Undercut, ...]:
    """Return the regions of walls that have something of the part below them, further out."""
    walls = contact.samples.pick(np.abs(contact.samples.normals[:, 2]) < _LEAST_DROP)
    outside = walls.points[:, :2] + _UNDERCUT_MM * walls.normals[:, :2]
    bottoms = contact.part_view.trace_first(outside, 1)
    contact.rays += len(outside)
    hidden = np.nan_to_num(bottoms, nan=np.inf) < walls.points[:, 2] - _UNDERCUT_MM
    undercuts = []
    for body in np.unique(walls.body).tolist():
        own = walls.body == body
        chosen = own & hidden
        if walls.areas[chosen].sum() <= _UNDERCUT_SHARE * walls.areas[own].sum():
            continue
        heights = (walls.points[chosen][:, 2] - contact.low) / _TO_MM
        area_m2 = float(walls.areas[chosen].sum()) / _TO_MM**2
        undercuts.append(Undercut(body, float(heights.min()), float(heights.max()), area_m2))
    return tuple(undercuts)


def _find_blocked_regions(nest: Nest, free: Sequence[KeepFree]) -> list[str]:
    """Return faults for regions in which material is left."""
    return [
        f"{left_mm3:.3g} mm3 of the nest stand in free region {number}"
        for number, left_mm3 in enumerate(measure_blocked_mm3(nest, free), 1)
        if left_mm3 > 1e-3
    ]


def measure_blocked_mm3(nest: Nest, free: Sequence[KeepFree]) -> list[float]:
    """Return the volume of a nest in each region."""
    if not free:
        return []
    solid = make_solid(nest.upright_m, nest.triangles)
    low, high = (float(value) for value in np.array(solid.bounding_box())[[2, 5]])
    volumes = []
    for region in free:
        ring = shapely.get_coordinates(region.area.buffer(-1e-3))[:-1]
        floor = max(region.floor_m * _TO_MM, low - 1) + 1e-3
        if floor >= high or len(ring) < 3:
            volumes.append(0.0)
            continue
        section = manifold3d.CrossSection([ring], manifold3d.FillRule.EvenOdd)
        room = section.extrude(high + 1 - floor).translate((0.0, 0.0, floor))
        volumes.append(float((solid ^ room).volume()))
    return volumes
