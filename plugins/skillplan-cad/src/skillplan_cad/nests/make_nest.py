"""Run `skillplan nest`: read parts, build a nest or jaws, check by rays, write what passes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from skillplan.errors import OptionError
from skillplan.files.json_file import format_document
from skillplan.files.output_path import check_output_folder
from skillplan.records.schemas import NEST
from skillplan_cad.importing.import_cad import write
from skillplan_cad.nests.nest import (
    KeepFree,
    Nest,
    NestSettings,
    build_jaws,
    build_nest,
)
from skillplan_cad.nests.nest_check import NestCheck, check_nest
from skillplan_cad.nests.pocket import LowerSurface
from skillplan_cad.nests.stepped_mesh import Body
from skillplan_cad.planning.bearing import ATTITUDES
from skillplan_cad.product import Part, make_solid
from skillplan_cad.reading.mesh_folder import resolve_unit_m
from skillplan_cad.reading.names import decode_file_name
from skillplan_cad.reading.product_reader import ReadOptions, read_product
from skillplan_cad.writing.task_document import format_obj, format_pieces

Kind = Literal["nest", "nut", "jaws"]
Draw = Callable[[Mapping[str, Any]], bytes]
"""Returns a drawing as PNG of an entry of `skillplan.nest/1`."""

Floats = NDArray[np.float64]
_TO_MM = 1e3
# Heights at which a drawing shows the nest, at most; and corners that it leaves out [mm].
_MOST_HEIGHTS, _SIMPLER_MM = 8, 0.01
_CHORD_M = 2e-5


@dataclass(frozen=True, slots=True)
class NestOptions:
    """Options of the command; lengths in millimetres.

    Parameters
    ----------
    only
        Patterns of the names of parts; none for all.
    kind
        ``nest``; ``nut`` for a pocket that must keep the part from turning; ``jaws`` for two soft
        jaws.
    up
        Axis of the file against which the part is inserted.
    closing
        Axis of the file along which jaws close.
    free
        Rectangles that stay open, as ``X0,Y0,X1,Y1`` or with the height of their floor.
    """

    unit: str | None = None
    only: tuple[str, ...] = ()
    kind: Kind = "nest"
    up: str = "z"
    closing: str = "x"
    gap_mm: float = 2.0
    clearance_mm: float = 0.2
    draft_deg: float = 1.0
    wall_mm: float = 4.0
    base_mm: float = 3.0
    depth_mm: float | None = None
    layer_mm: float = 0.5
    pin_mm: float = 4.0
    free: tuple[str, ...] = ()

    @property
    def settings(self) -> NestSettings:
        """Sizes of the nest."""
        return NestSettings(
            self.clearance_mm / _TO_MM,
            self.draft_deg,
            self.wall_mm / _TO_MM,
            self.base_mm / _TO_MM,
            None if self.depth_mm is None else self.depth_mm / _TO_MM,
            self.layer_mm / _TO_MM,
            self.pin_mm / _TO_MM,
        )


@dataclass(frozen=True, slots=True)
class MadeNests:
    """The output of the command.

    Parameters
    ----------
    document
        Fields of `nest.json`, without its schema.
    good
        True if all nests passed their check and are written.
    """

    document: dict[str, Any]
    warnings: tuple[str, ...]
    good: bool


def make_nest(
    source: str, out: str, given: Mapping[str, Any], tell: Callable[[str], None], draw: Draw
) -> MadeNests:
    """Build, check and write the nests of parts.

    Parameters
    ----------
    source
        STEP file, mesh, or folder of meshes.
    given
        Options by name; None for the default.

    Raises
    ------
    OptionError
        If an input is invalid; no file is written then.
    """
    chosen: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value in given.items()
        if value is not None
    }
    options = NestOptions(**chosen)
    if options.unit is not None:
        resolve_unit_m(options.unit)
    settings, free = options.settings, [parse_free(text) for text in options.free]
    path, folder = Path(source), check_output_folder("--out", out)
    reading = ReadOptions(options.unit, _CHORD_M, only=options.only, fewest=1)
    product = read_product(path, reading, tell)
    open_parts = [part.name for part in product if part.closure == "surface"]
    if open_parts:
        raise OptionError(f"{path}: {', '.join(open_parts)} is not closed, so it has no nest.")
    bodies = [(part.vertices_m, part.triangles) for part in product]
    names = [part.name for part in product]
    tell(f"building for {', '.join(names[:4])}{' and others' if names[4:] else ''}")
    nests = _build(bodies, options, settings, free)
    tell("checking by rays")
    entries, files = [], dict[str, str | bytes]()
    for label, nest in nests.items():
        regions = free if options.kind != "jaws" else []
        check = check_nest(
            bodies,
            nest,
            regions,
            stands=options.kind != "jaws",
            may_turn=options.kind != "nut",
        )
        entry = build_nest_document(label, nest, check, product.parts)
        entries.append(entry)
        if check.is_good:
            own = format_nest_files(label, nest)
            entry["files"] = {
                name.removeprefix(f"{label}.").replace(".", "_"): name for name in own
            }
            files |= own
        files[f"{label}.png"] = draw(entry)
    good = all(entry["check"]["good"] for entry in entries)
    document = {
        "product": product.name,
        "source": decode_file_name(path),
        "kind": options.kind,
        "good": good,
        "nests": entries,
    }
    files["nest.json"] = format_document(NEST, document) + "\n"
    write(folder, files)
    return MadeNests(document, (*product.notes, *product.warnings), good)


def _build(
    bodies: Sequence[Body],
    options: NestOptions,
    settings: NestSettings,
    free: Sequence[KeepFree],
) -> dict[str, Nest]:
    """Return nests by their name."""
    up = ATTITUDES[options.up]
    if options.kind != "jaws":
        return {options.kind: build_nest(bodies, settings, up, free)}
    if free:
        raise OptionError("--free is for nests; jaws end 0.5 mm above the plane of the part.")
    if options.depth_mm is not None:
        raise OptionError("--depth is for nests; the depth of jaws follows from --gap.")
    jaws = build_jaws(bodies, ATTITUDES[options.closing], settings, up, options.gap_mm / _TO_MM)
    return {f"jaw_{number}": jaw for number, jaw in enumerate(jaws, 1)}


def parse_free(text: str) -> KeepFree:
    """Return a region from ``X0,Y0,X1,Y1[,FLOOR]`` in millimetres.

    Raises
    ------
    OptionError
        If it is not four or five numbers, or empty.
    """
    try:
        x0, y0, x1, y1, *floor = (float(word) for word in text.split(","))
    except ValueError:
        floor = [0.0, 0.0]
    if len(floor) > 1 or not np.isfinite([x0, y0, x1, y1, *floor]).all() or x0 == x1 or y0 == y1:
        raise OptionError(
            f"--free {text}: give a rectangle in mm, X0,Y0,X1,Y1, and the height of its floor if "
            "it does not cut through the base."
        )
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]) / _TO_MM
    return KeepFree(corners, floor[0] / _TO_MM) if floor else KeepFree(corners)


def find_origin_m(nest: Nest) -> Floats:
    """Return the centre of a nest's bottom in its upright frame: the origin of its files."""
    low, high = nest.upright_m.min(axis=0), nest.upright_m.max(axis=0)
    return np.array([*((low + high) / 2)[:2], low[2]])


def format_nest_files(label: str, nest: Nest) -> dict[str, str | bytes]:
    """Return an STL to print [mm], and mesh and convex pieces for tasks [m], by file name."""
    import trimesh
    from trimesh.exchange.stl import export_stl

    origin = find_origin_m(nest)
    vertices_m = np.round(nest.upright_m - origin, 7) + 0.0
    printed = trimesh.Trimesh(vertices_m * _TO_MM, nest.triangles, process=False)
    pieces = [(np.round(points @ nest.turn.T - origin, 7), faces) for points, faces in nest.pieces]
    return {
        f"{label}.stl": export_stl(printed),
        f"{label}.obj": format_obj(vertices_m, nest.triangles),
        f"{label}.pieces.obj": format_pieces(pieces),
    }


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
        "check": _build_check_document(check, nest.turn @ check.gap_point_m - origin, parts),
        "views": _build_views(nest, parts, origin),
    }


def _build_check_document(
    check: NestCheck, gap_at_m: Floats, parts: Sequence[Part]
) -> dict[str, Any]:
    return {
        "good": check.is_good,
        "faults": list(check.faults),
        "rays": check.rays,
        "samples": check.samples,
        "overlap_mm": _mm(check.overlap_m),
        "least_gap_mm": _mm(check.least_gap_m),
        "gap_at_mm": _mm3(gap_at_m),
        "play_mm": [_mm(play) for play in check.play_m],
        "turn_deg": None if check.turn_rad is None else round(float(np.degrees(check.turn_rad)), 3),
        "support_margin_mm": _mm(max(check.support_margin_m, -1e3)),
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
