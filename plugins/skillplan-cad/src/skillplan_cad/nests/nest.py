"""Nests for parts: a block with a pocket that a part enters from above, and pins beneath overhangs.

The pocket is the room that the part sweeps on its way down, wider by a clearance and a draft. So
the part enters without collision, level faces rest on the floor, and every layer of the block
stands on the one below: it prints without supports.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from skillplan.collision import compute_margin_m
from skillplan.domains.assembly import MAX_CORNERS, MAX_PIECES
from skillplan.errors import OptionError
from skillplan_cad.nests.pocket import Layer, LowerSurface, keep_areas, sweep_pocket, widen
from skillplan_cad.nests.stepped_mesh import Body, Column, build_stepped_mesh, list_pieces
from skillplan_cad.product import Points, Triangles, Vector
from skillplan_cad.reading.mending import compute_centre_m, compute_volumes_m3
from skillplan_cad.writing.upright import compute_rotation_to_z

Floats = NDArray[np.float64]

UP: Vector = (0.0, 0.0, 1.0)
_TO_MM = 1e3
# Held height if none is stated: a share of the part's height, within limits [mm].
_DEPTH_SHARE, _LEAST_DEPTH_MM, _MOST_DEPTH_MM = 0.5, 2.0, 15.0
# Walls thinner than this do not print [mm].
_THINNEST_MM = 0.8
_SLIVER_MM2 = 1e-3
# Share of the clearance by which convex pieces may stand into the pocket.
_PIECE_SHARE = 0.25
# Number of pieces above which the layers of slopes are coarser, by powers of two up to the first
# factor; up to the second one if a task would refuse them.
_MOST_PIECES, _COARSER, _COARSEST = 400, 4, 64
# Share of corners or pieces left by coarser layers above which even coarser ones are not tried.
_FEWER = 0.97
# Distance of the centre of mass from the edge of its supports below which pins are added [mm]; tall
# parts need more.
_MARGIN_MM = 1.0
_MOST_PINS = 4
# Largest number of places that are tried for pins.
_TRIED_PINS = 60
_LEVELS_TRIED = 8
# Height of a slope above its lowest edge that counts as lying on the floor [mm].
_TOUCHING_MM = 0.01
# Distance of jaws from the plane that the part stands on [mm].
_ABOVE_TABLE_MM = 0.5


@dataclass(frozen=True, slots=True)
class NestSettings:
    """Sizes of a nest.

    Parameters
    ----------
    clearance_m
        Least distance of the pocket's walls from the part, 0.02 to 5 mm.
    draft_deg
        Angle by which walls lean outwards, 0 to 45.
    wall_m, base_m
        Thickness of the outer walls, and of the floor beneath the lowest point, at least 0.8 mm.
    depth_m
        Height of the walls above the lowest point; None for half of the part's height, at most
        15 mm.
    layer_m
        Greatest height of layers on slopes, at least 0.02 mm.
    pin_m
        Diameter of pins beneath overhangs, at least 0.8 mm; 0 for none.

    Raises
    ------
    OptionError
        If a size is out of range.
    """

    clearance_m: float = 2e-4
    draft_deg: float = 1.0
    wall_m: float = 4e-3
    base_m: float = 3e-3
    depth_m: float | None = None
    layer_m: float = 5e-4
    pin_m: float = 4e-3

    def __post_init__(self) -> None:
        thinnest_m = _THINNEST_MM / _TO_MM
        for name, value, low, high in (
            ("clearance", self.clearance_m, 2e-5, 5e-3),
            ("wall", self.wall_m, thinnest_m, 0.1),
            ("base", self.base_m, thinnest_m, 0.1),
            ("depth", self.depth_m, thinnest_m, 1.0),
            ("layer", self.layer_m, 2e-5, 0.01),
            ("pin", self.pin_m or None, thinnest_m, 0.1),
        ):
            if value is not None and not low - 1e-12 <= value <= high + 1e-12:
                raise OptionError(
                    f"{name} {value * _TO_MM:g} mm: must be from {low * _TO_MM:g} to "
                    f"{high * _TO_MM:g} mm."
                )
        if not 0 <= self.draft_deg <= 45:
            raise OptionError(f"draft {self.draft_deg:g} degrees: must be from 0 to 45.")


@dataclass(frozen=True, slots=True, eq=False)
class KeepFree:
    """A region that a nest leaves open upwards, for fingers, screws or tools.

    Parameters
    ----------
    outline_m
        Polygon across the insertion axis (n, 2) [m], in the frame of the bodies turned upright.
    floor_m
        Height of its bottom in that frame [m]; ``-inf`` to cut through the base, too.
    """

    outline_m: Floats
    floor_m: float = -math.inf

    @property
    def area(self) -> Polygon:
        """The outline in millimetres."""
        return Polygon(np.asarray(self.outline_m) * _TO_MM)


@dataclass(frozen=True, slots=True)
class Pin:
    """A post beneath an overhang; x, y and top in the upright frame, and the diameter [m]."""

    place_m: tuple[float, float]
    top_m: float
    diameter_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Nest:
    """A nest in the frame of the bodies that it was made for, which are seated in it.

    Parameters
    ----------
    vertices_m, triangles
        Watertight mesh.
    pieces
        Convex pieces with upright walls, which keep at least three quarters of the clearance. They
        enclose the mesh, except on slopes of several hundred pieces, whose layers are coarser. None
        if even these are more than a task accepts.
    settings
        Sizes that it was made with; the depth is stated.
    turn
        Rotation to the upright frame, in which the part comes from above.
    pins
        Posts beneath overhangs.
    coarse
        Mesh with higher steps on slopes, if the mesh has more corners than a task accepts.
    """

    vertices_m: Points
    triangles: Triangles
    pieces: tuple[Body, ...]
    settings: NestSettings
    turn: Floats
    pins: tuple[Pin, ...] = ()
    coarse: Body | None = None

    @property
    def upright_m(self) -> Points:
        """Vertices in the upright frame."""
        return self.vertices_m @ self.turn.T


# GEOS leaves floating-point flags, which numpy reports as warnings.
@np.errstate(divide="ignore", invalid="ignore")
def build_nest(
    bodies: Sequence[Body],
    settings: NestSettings | None = None,
    up: Vector = UP,
    free: Sequence[KeepFree] = (),
    heading: int = 0,
) -> Nest:
    """Return a nest for bodies in their pose.

    Parameters
    ----------
    bodies
        Closed meshes in one frame; a sub-assembly has several.
    up
        Vector against which they are inserted.
    free
        Regions that stay open.
    heading
        Quarter turns of its frame about the vertical.

    Raises
    ------
    OptionError
        If a size is out of range, or nothing is left of the nest.
    """
    settings = settings or NestSettings()
    turn = compute_rotation_to_z(up, heading)
    corners = np.concatenate([(v @ turn.T * _TO_MM)[t] for v, t in bodies])
    surface = LowerSurface(corners)
    low_mm, high_mm = float(corners[:, :, 2].min()), float(corners[:, :, 2].max())
    depth_mm = _choose_depth_mm(settings, high_mm - low_mm)
    settings = replace(settings, depth_m=depth_mm / _TO_MM)
    layers = _sweep(surface, low_mm, settings, settings.draft_deg)
    centre = _find_centre_mm(bodies, turn)
    pins = _place_pins(surface, layers, centre, settings) if settings.pin_m else []
    plate = _draw_plate(layers, pins, settings)
    points, triangles = build_stepped_mesh(_list_columns(layers, plate, pins, settings, free))
    coarse, coarser, count = None, 1, math.inf
    while len(points) > MAX_CORNERS and coarser < _COARSEST:
        coarser *= 2
        steps = _sweep(surface, low_mm, settings, settings.draft_deg, coarser)
        less, faces = build_stepped_mesh(_list_columns(steps, plate, pins, settings, free))
        if len(less) <= MAX_CORNERS:
            coarse = (less / _TO_MM @ turn, faces)
        if coarse or len(less) > _FEWER * count:
            break
        count = len(less)
    return Nest(
        points / _TO_MM @ turn,
        triangles,
        tuple(
            (points @ turn, faces)
            for points, faces in _divide(surface, layers, pins, settings, free)
        ),
        settings,
        turn,
        tuple(pins),
        coarse,
    )


def _sweep(
    surface: LowerSurface, low_mm: float, settings: NestSettings, draft_deg: float, coarser: int = 1
) -> list[Layer]:
    return sweep_pocket(
        surface,
        low_mm,
        low_mm + (settings.depth_m or 0.0) * _TO_MM,
        settings.clearance_m * _TO_MM,
        math.radians(draft_deg),
        coarser * settings.layer_m * _TO_MM,
    )


def _choose_depth_mm(settings: NestSettings, height_mm: float) -> float:
    if settings.depth_m is not None:
        return settings.depth_m * _TO_MM
    share_mm = min(max(_DEPTH_SHARE * height_mm, _LEAST_DEPTH_MM), _MOST_DEPTH_MM)
    return max(min(share_mm, height_mm), _THINNEST_MM)


def _find_centre_mm(bodies: Iterable[Body], turn: Floats) -> Floats:
    """Return the centre of mass at equal density."""
    volumes = [float(compute_volumes_m3(*body).sum()) for body in bodies]
    centres = [compute_centre_m(*body) @ turn.T for body in bodies]
    centre: Floats = np.average(centres, axis=0, weights=volumes) * _TO_MM
    return centre


def _draw_plate(
    layers: Sequence[Layer], pins: Sequence[Pin], settings: NestSettings
) -> tuple[BaseGeometry, BaseGeometry]:
    """Return the outlines of the block and of its base, which bears the pins, too."""
    wall_mm = settings.wall_m * _TO_MM
    block = _surround([layers[-1].outline], wall_mm)
    if not pins:
        return block, block
    return block, _surround([block, *map(_draw_disc, pins)], wall_mm / 2)


def _list_columns(
    layers: Sequence[Layer],
    plate: tuple[BaseGeometry, BaseGeometry],
    pins: Sequence[Pin],
    settings: NestSettings,
    free: Sequence[KeepFree],
) -> list[Column]:
    block, base = plate
    bottom_mm = layers[0].low_mm - settings.base_m * _TO_MM
    slabs = [(layers[0].low_mm, base)]
    for layer in layers:
        rest = _keep_thick(block.difference(layer.outline))
        slabs.append((layer.high_mm, keep_areas(rest.intersection(slabs[-1][1]))))
    slabs += [(pin.top_m * _TO_MM, _draw_disc(pin)) for pin in pins]
    cut = [column for slab in slabs for column in _cut_free(bottom_mm, *slab, free)]
    columns = [column for column in cut if column[2].area > _SLIVER_MM2]
    if not columns:
        raise OptionError("nothing is left of the nest outside the regions that stay free.")
    return columns


def _divide(
    surface: LowerSurface,
    layers: Sequence[Layer],
    pins: Sequence[Pin],
    settings: NestSettings,
    free: Sequence[KeepFree],
) -> list[Body]:
    """Return convex pieces of the nest with upright walls, on slopes in few enough layers."""
    plate = _draw_plate(layers, pins, settings)
    coarser, count = 1, math.inf
    while True:
        upright = _sweep(surface, layers[0].low_mm, settings, 0.0, coarser)
        columns = _list_columns(upright, plate, pins, settings, free)
        pieces = list_pieces(columns, settings.clearance_m * _TO_MM * _PIECE_SHARE)
        if len(pieces) <= (_MOST_PIECES if coarser < _COARSER else MAX_PIECES):
            return pieces
        if coarser >= _COARSEST or (coarser > _COARSER and len(pieces) > _FEWER * count):
            return []
        coarser, count = 2 * coarser, len(pieces)


def _surround(shapes: Iterable[BaseGeometry], room_mm: float) -> BaseGeometry:
    """Return the rectangle around shapes, with room on each side."""
    low_x, low_y, high_x, high_y = shapely.union_all([*shapes]).bounds
    return shapely.box(low_x - room_mm, low_y - room_mm, high_x + room_mm, high_y + room_mm)


def _keep_thick(shape: BaseGeometry) -> BaseGeometry:
    """Return a shape without walls that are too thin to print."""
    half = _THINNEST_MM / 2
    opened = shape.buffer(-half, join_style="mitre").buffer(half, join_style="mitre")
    thin = shape.difference(opened.buffer(1e-6))
    slivers = [part for part in shapely.get_parts(keep_areas(thin)) if part.area > half * half]
    return keep_areas(shape.difference(shapely.union_all(slivers))) if slivers else shape


def _cut_free(
    low_mm: float, high_mm: float, outline: BaseGeometry, free: Iterable[KeepFree]
) -> list[Column]:
    """Return the columns of an outline that are left by regions, by their top."""
    columns = [(low_mm, high_mm, outline)]
    for region in free:
        floor_mm = region.floor_m * _TO_MM
        after: list[Column] = []
        for low, high, area in columns:
            if floor_mm >= high:
                after.append((low, high, area))
                continue
            after.append((low, high, keep_areas(area.difference(region.area))))
            if floor_mm > low:
                after.append((low, floor_mm, keep_areas(area.intersection(region.area))))
        columns = after
    return columns


def _draw_disc(pin: Pin) -> BaseGeometry:
    radius_mm = pin.diameter_m * _TO_MM / 2
    return shapely.Point(np.array(pin.place_m) * _TO_MM).buffer(radius_mm, quad_segs=6)


def _place_pins(
    surface: LowerSurface, layers: Sequence[Layer], centre: Floats, settings: NestSettings
) -> list[Pin]:
    """Return pins beneath level overhangs that support the centre of mass, if the floor does not.

    Pins are added as long as each moves the edge of the supports away from the centre.
    """
    floor, overhangs = _find_supports(surface, layers, settings)
    corners = shapely.get_coordinates(floor)
    height_m = (float(centre[2]) - layers[0].low_mm) / _TO_MM
    centre = centre[:2]
    extent_m = surface.extent_mm / _TO_MM
    needed_mm = max(_MARGIN_MM, compute_margin_m(extent_m, height_m) * _TO_MM)
    best = measure_margin(corners, centre)
    places = _list_places(overhangs, settings.pin_m * _TO_MM / 2)
    pins: list[Pin] = []
    while best < needed_mm and len(pins) < _MOST_PINS and places:
        most = 2 if len(pins) + 2 <= _MOST_PINS else 1
        choices = [c for count in range(1, most + 1) for c in combinations(places, count)]
        margins = [
            measure_margin(np.vstack([corners, *(point for point, _ in choice)]), centre)
            for choice in choices
        ]
        index = int(np.argmax(margins))
        if margins[index] <= best + 1e-6:
            break
        best = margins[index]
        for point, height in choices[index]:
            x_mm, y_mm = (float(value) / _TO_MM for value in point[0])
            pins.append(Pin((x_mm, y_mm), height / _TO_MM, settings.pin_m))
            corners = np.vstack([corners, point])
        chosen = choices[index]
        places = [place for place in places if not any(place is other for other in chosen)]
    return pins


def _find_supports(
    surface: LowerSurface, layers: Sequence[Layer], settings: NestSettings
) -> tuple[BaseGeometry, list[tuple[float, BaseGeometry]]]:
    """Return the faces that touch the floor, and level ones above air with their heights."""
    clearance_mm = settings.clearance_m * _TO_MM
    block = _surround([layers[-1].outline], settings.wall_m * _TO_MM)
    rests: list[BaseGeometry] = []
    for height in surface.lowest:
        if height < layers[-1].high_mm - 1e-6:
            touching = surface.project_slice(height, height + _TOUCHING_MM)
            rests.append(_lie_free(touching, layers, height).intersection(block))
    overhangs: list[tuple[float, BaseGeometry]] = []
    for height in surface.levels:
        if height < layers[-1].high_mm - 1e-6 or len(overhangs) >= _LEVELS_TRIED:
            continue
        faces = _lie_free(surface.find_level_faces(height), layers, height)
        if not faces.is_empty:
            shadow = widen(surface.project_slice(layers[0].low_mm, height), clearance_mm)
            overhangs.append((height, keep_areas(faces.difference(shadow))))
    return shapely.union_all(rests), overhangs


def _lie_free(faces: BaseGeometry, layers: Sequence[Layer], height: float) -> BaseGeometry:
    """Return the faces at a height outside of the pocket below it."""
    below = [layer.outline for layer in layers if layer.high_mm <= height + 1e-6]
    return keep_areas(faces.difference(below[-1])) if below else faces


def _list_places(
    overhangs: Iterable[tuple[float, BaseGeometry]], radius_mm: float
) -> list[tuple[Floats, float]]:
    """Return places for pins, spread over the faces above air, with their heights."""
    places: list[tuple[Floats, float]] = []
    for height, faces in overhangs:
        inner = keep_areas(faces.buffer(-radius_mm))
        if inner.is_empty:
            continue
        outline = shapely.segmentize(inner, max(radius_mm, 0.2 * math.sqrt(inner.area)))
        places += [(point[None], height) for point in shapely.get_coordinates(outline)]
    step = max(1, math.ceil(len(places) / _TRIED_PINS))
    return places[::step]


def measure_margin(points: Floats, centre: Floats) -> float:
    """Return the distance of a point from the edge of the hull of points; negative outside."""
    if not len(points):
        return -math.inf
    hull = shapely.MultiPoint(points).convex_hull
    distance = float(shapely.Point(centre).distance(shapely.boundary(hull)))
    if shapely.get_type_id(hull) != 3:
        return -float(shapely.Point(centre).distance(hull))
    return distance if hull.contains(shapely.Point(centre)) else -distance


def build_jaws(
    bodies: Sequence[Body],
    closing: Vector,
    settings: NestSettings | None = None,
    up: Vector = UP,
    gap_m: float = 2e-3,
) -> tuple[Nest, Nest]:
    """Return two soft jaws that close on bodies along a line.

    Each jaw is a nest for the bodies that it meets on its way; they end above the plane that the
    bodies stand on.

    Parameters
    ----------
    closing
        Vector of the line, across `up`.
    gap_m
        Distance of the closed jaws [m]; the bodies must be wider.

    Raises
    ------
    OptionError
        If the bodies are not wider than the gap, or the line is not across `up`.
    """
    settings = settings or NestSettings()
    line, axis = (np.asarray(v, dtype=np.float64) for v in (closing, up))
    line, axis = line / np.linalg.norm(line), axis / np.linalg.norm(axis)
    if abs(float(line @ axis)) > 1e-6:
        raise OptionError("the closing direction of jaws must be level.")
    points = np.concatenate([vertices for vertices, _ in bodies])
    along, heights = points @ line, points @ axis
    width_m = float(np.ptp(along))
    depth_m = (width_m - gap_m) / 2
    if depth_m * _TO_MM < _THINNEST_MM:
        raise OptionError(
            f"jaws {gap_m * _TO_MM:g} mm from each other hold nothing of a part that is "
            f"{width_m * _TO_MM:.4g} mm wide."
        )
    settings = replace(settings, depth_m=depth_m, pin_m=0.0)
    jaws = []
    for side in (1.0, -1.0):
        outwards: Vector = tuple((-side * line).tolist())
        turn = compute_rotation_to_z(outwards)
        below = _find_below(turn @ axis, float(heights.min()) + _ABOVE_TABLE_MM / _TO_MM, points)
        jaws.append(build_nest(bodies, settings, outwards, [KeepFree(below)]))
    return jaws[0], jaws[1]


def _find_below(axis: Floats, height_m: float, points: Points) -> Floats:
    """Return a large rectangle below a height along a level axis of an upright frame."""
    reach_m = 10.0 + 10 * float(np.abs(points).max())
    flat = axis[:2] / np.linalg.norm(axis[:2])
    across = np.array([-flat[1], flat[0]])
    top, deep = height_m * flat, (height_m - reach_m) * flat
    corners = [top - reach_m * across, deep - reach_m * across]
    return np.array([*corners, deep + reach_m * across, top + reach_m * across])
