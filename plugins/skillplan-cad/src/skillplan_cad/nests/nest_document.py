"""A nest as files to print and for tasks, and as an entry of `skillplan.nest/1`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from skillplan.domains.assembly import MAX_BYTES, MAX_CORNERS
from skillplan_cad.nests.nest import Nest
from skillplan_cad.nests.nest_check import NestCheck
from skillplan_cad.nests.pocket import LowerSurface
from skillplan_cad.product import Part, make_solid
from skillplan_cad.writing.task_document import format_obj, format_pieces

Floats = NDArray[np.float64]
_TO_MM = 1e3
# Heights at which a drawing shows the nest, at most; and corners that it leaves out [mm].
_MOST_HEIGHTS, _SIMPLER_MM = 8, 0.01


def find_origin_m(nest: Nest) -> Floats:
    """Return the centre of a nest's bottom in its upright frame: the origin of its files."""
    low, high = nest.upright_m.min(axis=0), nest.upright_m.max(axis=0)
    return np.array([*((low + high) / 2)[:2], low[2]])


def format_nest_files(label: str, nest: Nest) -> dict[str, str | bytes]:
    """Return an STL to print [mm], and mesh and convex pieces for tasks [m], by file name.

    Without the latter two if a task would refuse them.
    """
    import trimesh
    from trimesh.exchange.stl import export_stl

    origin = find_origin_m(nest)
    vertices_m = np.round(nest.upright_m - origin, 7) + 0.0
    printed = trimesh.Trimesh(vertices_m * _TO_MM, nest.triangles, process=False)
    pieces = [(np.round(points @ nest.turn.T - origin, 7), faces) for points, faces in nest.pieces]
    files: dict[str, str | bytes] = {f"{label}.stl": export_stl(printed)}
    points, faces = nest.coarse or (nest.vertices_m, nest.triangles)
    mesh, whole = f"{label}.obj", format_obj(points @ nest.turn.T - origin, faces)
    fits = len(points) <= MAX_CORNERS and len(whole) <= MAX_BYTES
    split = format_pieces(pieces)
    if fits and pieces and len(split) <= MAX_BYTES:
        files |= {mesh: whole, f"{label}.pieces.obj": split}
    return files


def build_nest_document(
    label: str, nest: Nest, check: NestCheck, parts: Sequence[Part]
) -> dict[str, Any]:
    """Return the entry of a nest in `skillplan.nest/1`.

    Lengths are in millimetres, in the frame of the nest's files: the centre of its bottom, z
    against the insertion.
    """
    settings, origin = nest.settings, find_origin_m(nest)
    upright = np.concatenate([part.vertices_m @ nest.turn.T for part in parts]) - origin
    low, high = upright.min(axis=0), upright.max(axis=0)
    vertices = nest.upright_m - origin
    solid = make_solid(nest.vertices_m, nest.triangles)
    return {
        "name": label,
        "parts": [part.name for part in parts],
        "up": _round(nest.turn[2]),
        "clearance_mm": _mm(settings.clearance_m),
        "draft_deg": settings.draft_deg,
        "wall_mm": _mm(settings.wall_m),
        "base_mm": _mm(settings.base_m),
        "depth_mm": _mm(settings.depth_m or 0.0),
        "layer_mm": _mm(settings.layer_m),
        "size_mm": _mm3(np.ptp(vertices, axis=0)),
        "volume_cm3": round(solid.volume() / 1e3, 3),
        "triangles": len(nest.triangles),
        "pieces": len(nest.pieces),
        "pins": [
            {
                "top_mm": _mm3(np.array([*pin.place_m, pin.top_m]) - origin),
                "diameter_mm": _mm(pin.diameter_m),
            }
            for pin in nest.pins
        ],
        "seated_mm": _mm3(np.array([*((low + high) / 2)[:2], low[2]])),
        "files": {},
        "check": _build_check_document(check, nest, parts),
        "views": _build_views(nest, parts, origin),
    }


def _build_check_document(check: NestCheck, nest: Nest, parts: Sequence[Part]) -> dict[str, Any]:
    gap_at_m, origin = check.gap_point_m, find_origin_m(nest)
    return {
        "good": check.is_good,
        "faults": list(check.faults),
        "rays": check.rays,
        "samples": check.samples,
        "overlap_mm": _mm(check.overlap_m),
        "least_gap_mm": _mm(check.least_gap_m),
        "gap_at_mm": None if gap_at_m is None else _mm3(nest.turn @ gap_at_m - origin),
        "play_mm": [_mm(play) for play in check.play_m],
        "turn_deg": None if check.turn_rad is None else round(float(np.degrees(check.turn_rad)), 3),
        "support_margin_mm": _mm(max(check.support_margin_m, -1e3)),
        "needed_margin_mm": _mm(check.needed_margin_m),
        "held_by_walls": check.held_by_walls,
        "supports": check.supports,
        "undercuts": [
            {
                "part": parts[undercut.body].name,
                "low_mm": _mm(undercut.low_m),
                "high_mm": _mm(undercut.high_m),
                "area_mm2": round(undercut.area_m2 * 1e6, 3),
            }
            for undercut in check.undercuts
        ],
    }


def _build_views(nest: Nest, parts: Sequence[Part], origin: Floats) -> dict[str, Any]:
    """Return outlines of the nest from above by height, and of a section through its part."""
    solid = make_solid(nest.upright_m - origin, nest.triangles)
    heights = np.unique(np.round((nest.upright_m - origin)[:, 2] * _TO_MM, 3))[1:]
    if len(heights) > _MOST_HEIGHTS:
        heights = heights[np.linspace(0, len(heights) - 1, _MOST_HEIGHTS).round().astype(int)]
    placed = [(part.vertices_m @ nest.turn.T - origin, part.triangles) for part in parts]
    corners = np.concatenate([(vertices * _TO_MM)[faces] for vertices, faces in placed])
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    silhouette = LowerSurface(corners).project_slice(float(low[2]), float(high[2]) + 1.0)
    at = float((low + high)[1] / 2)
    solids = [make_solid(*body) for body in placed]
    return {
        "top": [
            {"height_mm": round(float(height), 3), "outlines": _list_outlines(solid, height - 1e-3)}
            for height in heights
        ],
        "part": _list_rings(silhouette),
        "section": {
            "y_mm": round(at, 3),
            "nest": _cut_at(solid, at),
            "part": [ring for body in solids for ring in _cut_at(body, at)],
        },
    }


def _list_outlines(solid: Any, height: float) -> list[list[list[float]]]:
    return [_list_points(ring) for ring in solid.slice(float(height)).to_polygons()]


def _cut_at(solid: Any, at: float) -> list[list[list[float]]]:
    """Return the outlines of a section at a place of y, as x and z."""
    turned = solid.rotate((-90.0, 0.0, 0.0))
    # A plane through a face would return either side of it.
    return [_list_points(ring) for ring in turned.slice(-at - 1e-4).to_polygons()]


def _list_rings(shape: BaseGeometry) -> list[list[list[float]]]:
    return [
        _list_points(shapely.get_coordinates(ring)[:-1])
        for part in shapely.get_parts(shape)
        for ring in (part.exterior, *part.interiors)
    ]


def _list_points(ring: Floats) -> list[list[float]]:
    """Return a ring with as many points as a drawing needs."""
    line = shapely.LineString([*ring, ring[0]]).simplify(_SIMPLER_MM)
    points = shapely.get_coordinates(line)[:-1]
    return (np.round(points, 3) + 0.0).tolist()  # type: ignore[no-any-return]


def _round(values: Floats) -> list[float]:
    return [round(float(value), 9) + 0.0 for value in values]


def _mm(value_m: float) -> float:
    return round(value_m * _TO_MM, 4) + 0.0


def _mm3(point_m: Floats) -> list[float]:
    return [_mm(float(value)) for value in point_m]
