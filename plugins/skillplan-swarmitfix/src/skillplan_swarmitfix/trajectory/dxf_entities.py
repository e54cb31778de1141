"""Entities of a DXF drawing as pieces of a path, in metres."""

from __future__ import annotations

import io
import itertools
import logging
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ezdxf.entities.arc import Arc as ArcEntity
from ezdxf.entities.circle import Circle
from ezdxf.entities.dxfgfx import DXFGraphic
from ezdxf.entities.ellipse import Ellipse
from ezdxf.entities.line import Line as LineEntity
from ezdxf.entities.lwpolyline import LWPolyline
from ezdxf.entities.polyline import Polyline
from ezdxf.entities.spline import Spline as SplineEntity
from ezdxf.filemanagement import read
from ezdxf.lldxf.const import DXFError
from ezdxf.math import Vec3

from skillplan_swarmitfix.trajectory.path import (
    TrajectoryFileError,
    TrajectoryPath,
    one_line,
)
from skillplan_swarmitfix.trajectory.path_chain import MOST_NAMED, Piece, chained
from skillplan_swarmitfix.trajectory.path_elements import (
    FLAT_RAD,
    MAX_CHORDS,
    Element,
    Line,
    Spline,
    arc_or_line,
)
from skillplan_swarmitfix.trajectory.plane_point import (
    MAX_COORDINATE_M,
    SAME_POINT_M,
    Point2,
    on_any_bench,
)
from skillplan_swarmitfix.trajectory.units import DEFAULT_UNIT, UNITS_M, UnitName

if TYPE_CHECKING:
    from ezdxf.document import Drawing


CURVE_TOLERANCE_M = 1e-5
"""Tolerance of the chords of a SPLINE or an ELLIPSE [m]; the `Spline` is closer."""

_NEEDED = {
    "LINE": ("start", "end"),
    "CIRCLE": ("center", "radius"),
    "ARC": ("center", "radius", "start_angle", "end_angle"),
    "ELLIPSE": ("center", "major_axis"),
}
_MESH_FLAGS = 16 | 64
_SPLINE_FRAME = 16
_MOST_BULGE = 1e4
_MOST_CONTROL_POINTS = 10_000
_CORNER_RAD = math.radians(20)
_LEVEL = 1e-9


class EntityReader:
    """Makes pieces of a drawing's entities.

    Parameters
    ----------
    path
        The drawing's file, for messages.
    unit_m
        Length of the drawing's unit [m].
    """

    def __init__(self, path: Path, unit_m: float) -> None:
        self._path = path
        self._unit_m = unit_m
        self._name = ""
        self._z_m: float | None = None

    def piece(self, entity: DXFGraphic) -> Piece:
        """Return the elements of one entity.

        Raises
        ------
        TrajectoryFileError
            If it is of no kind that is read, leaves the plane of those before it, or has a
            measure that no path can have.
        """
        self._name = f"{one_line(entity.dxftype(), 40)} #{entity.dxf.handle}"
        for attribute in _NEEDED.get(entity.dxftype(), ()):
            if not entity.dxf.hasattr(attribute):
                raise self._fault(f"It lacks its {attribute}; draw it again.")
        match entity:
            case LineEntity():
                start, end = self._points([entity.dxf.start, entity.dxf.end])
                return self._row(start, [Line(end)])
            case ArcEntity() | Circle():
                return self._circular(entity)
            case LWPolyline():
                sense = self._sense(entity)
                return self._bulged(
                    list(entity.vertices_in_wcs()),
                    [sense * float(bulge) for (bulge,) in entity.get_points("b")],
                    closed=entity.closed,
                )
            case Polyline() if not entity.dxf.flags & _MESH_FLAGS:
                sense = self._sense(entity)
                corners = [
                    (point, vertex.dxf.get("bulge", 0.0))
                    for point, vertex in zip(entity.points_in_wcs(), entity.vertices, strict=True)
                    if not vertex.dxf.flags & _SPLINE_FRAME
                ]
                return self._bulged(
                    [point for point, _ in corners],
                    [sense * float(bulge) for _, bulge in corners],
                    closed=entity.is_closed,
                )
            case SplineEntity() | Ellipse():
                return self._flattened(entity)
            case _:
                raise self._fault(
                    "This kind of entity is not read here; explode it to lines and arcs, "
                    "or delete it."
                )

    def _circular(self, entity: Circle) -> Piece:
        self._sense(entity)
        centre, radius = Vec3(entity.dxf.center), float(entity.dxf.radius)
        if not radius * self._unit_m > SAME_POINT_M:
            raise self._fault(f"Its radius is {radius:g}; give one > 0.")
        first, sweep = 0.0, 360.0
        if isinstance(entity, ArcEntity):
            first = float(entity.dxf.start_angle)
            # From an angle to the same one is once around.
            sweep = (float(entity.dxf.end_angle) - first) % 360.0 or 360.0
        to_wcs = entity.ocs().to_wcs
        start, quarter, half, three_quarters, end = self._points(
            to_wcs(centre + Vec3.from_deg_angle(first + quarter * sweep / 4, radius))
            for quarter in range(5)
        )
        if math.dist(start, end) > SAME_POINT_M:
            return self._row(start, [arc_or_line(start, end, half)])
        return self._row(
            start, [arc_or_line(start, half, quarter), arc_or_line(half, start, three_quarters)]
        )

    def _bulged(self, corners: Sequence[Vec3], bulges: Sequence[float], *, closed: bool) -> Piece:
        """Return the lines and arcs of a polyline; a bulge is the tangent of a quarter arc."""
        points = self._points(corners)
        if len(points) < 2:
            raise self._fault(f"It has {len(points)} vertices; give it two or more, or delete it.")
        if closed and math.dist(points[0], points[-1]) > SAME_POINT_M:
            points.append(points[0])
        elements: list[Element] = []
        for (ax, ay), (bx, by), bulge in zip(points, points[1:], bulges, strict=False):
            if not abs(bulge) <= _MOST_BULGE:
                raise self._fault(
                    f"It has a bulge of {bulge:g}; give an arc of less than a full turn."
                )
            top = (
                (ax + bx + bulge * (by - ay)) / 2,
                (ay + by - bulge * (bx - ax)) / 2,
            )
            elements.append(arc_or_line((ax, ay), (bx, by), top) if bulge else Line((bx, by)))
        places = [f"{self._name}, vertex {i % len(corners) + 1}" for i in range(1, len(points))]
        return Piece(self._name, points[0], tuple(elements), tuple(places))

    def _flattened(self, entity: SplineEntity | Ellipse) -> Piece:
        """Return a curve that has no arcs, by points on it; cut at its corners."""
        if isinstance(entity, SplineEntity):
            given = [*map(Vec3, entity.control_points), *map(Vec3, entity.fit_points)]
            if not 2 <= len(given) <= _MOST_CONTROL_POINTS:
                raise self._fault(
                    f"It has {len(given)} control points; give 2 to {_MOST_CONTROL_POINTS}."
                )
            self._points(given)
            curve = entity.construction_tool()
            if not curve.is_clamped:
                raise self._fault(
                    "Its knots are not clamped at its ends; convert it to a polyline."
                )
            drawn = curve.flattening(CURVE_TOLERANCE_M / self._unit_m, segments=4)
        else:
            self._points([entity.dxf.center, entity.dxf.center + entity.dxf.major_axis])
            drawn = iter(entity.flattening(CURVE_TOLERANCE_M / self._unit_m, segments=16))
        points: list[Point2] = []
        for point in self._points(itertools.islice(drawn, MAX_CHORDS + 1)):
            if not points or math.dist(points[-1], point) > SAME_POINT_M:
                points.append(point)
        if len(points) > MAX_CHORDS:
            raise self._fault(
                f"It needs more than {MAX_CHORDS} points; draw it simpler, or smaller."
            )
        return self._row(points[0], list(_smooth_runs(points)) or [Line(points[0])])

    def _sense(self, entity: DXFGraphic) -> float:
        """Return 1 or, for an entity that is drawn as seen from below, -1."""
        up = Vec3(entity.dxf.extrusion).normalize()
        if not math.hypot(up.x, up.y) <= _LEVEL:
            raise self._fault("It is tilted; draw the trajectory in the XY plane.")
        return math.copysign(1.0, up.z)

    def _points(self, corners: Iterable[Vec3]) -> list[Point2]:
        """Return the points in metres, all of which have to be at one height."""
        points = []
        for corner in corners:
            x, y, z = (coordinate * self._unit_m for coordinate in corner)
            if not on_any_bench((x, y)):
                raise self._fault(f"It leaves every bench; keep within {MAX_COORDINATE_M:g} m.")
            self._z_m = z if self._z_m is None else self._z_m
            if not abs(z - self._z_m) <= SAME_POINT_M:
                raise self._fault(
                    f"It is at z = {z:.9g} m, but the path is at {self._z_m:.9g} m; "
                    "flatten the drawing."
                )
            points.append((x, y))
        return points

    def _row(self, start: Point2, elements: Sequence[Element]) -> Piece:
        return Piece(self._name, start, tuple(elements), (self._name,) * len(elements))

    def _fault(self, message: str) -> TrajectoryFileError:
        return TrajectoryFileError(self._path, message, self._name)


def _smooth_runs(points: Sequence[Point2]) -> Iterator[Element]:
    """Yield a spline from corner to corner, or a line where the points are in a row."""
    begin = 0
    for i in range(1, len(points)):
        if i < len(points) - 1 and _bend(*points[i - 1 : i + 2]) <= _CORNER_RAD:
            continue
        run = points[begin : i + 1]
        straight = all(_bend(*run[j : j + 3]) <= FLAT_RAD for j in range(len(run) - 2))
        yield Line(run[-1]) if straight else Spline(tuple(run[1:]))
        begin = i


def _bend(a: Point2, b: Point2, c: Point2) -> float:
    before = math.atan2(b[1] - a[1], b[0] - a[0])
    return abs(math.remainder(math.atan2(c[1] - b[1], c[0] - b[0]) - before, math.tau))


UNITLESS = 0
INSUNITS_M = {
    UNITLESS: UNITS_M[DEFAULT_UNIT],
    1: UNITS_M["in"],
    2: UNITS_M["ft"],
    4: UNITS_M["mm"],
    5: UNITS_M["cm"],
    6: UNITS_M["m"],
    8: 0.0254e-6,
    9: UNITS_M["mil"],
    10: UNITS_M["yd"],
    13: UNITS_M["um"],
    14: UNITS_M["dm"],
}
"""Length of the unit that a value of $INSUNITS stands for [m]."""

_PASSED_OVER = frozenset(
    ("TEXT", "MTEXT", "DIMENSION", "LEADER", "MULTILEADER", "POINT", "VIEWPORT", "TOLERANCE")
)
_logger = logging.getLogger("ezdxf")


def dxf_trajectory(path: Path, content: bytes, unit: UnitName | None = None) -> TrajectoryPath:
    """Return the trajectory of a drawing.

    Parameters
    ----------
    path
        The drawing's file, for messages.
    content
        The file's bytes.
    unit
        Unit of its lengths, overriding its own; None for its own.

    Raises
    ------
    TrajectoryFileError
        If the drawing cannot be read or does not hold just one path; with the entity's kind and
        handle where one is at fault.
    """
    text = _ascii_dxf(path, content)
    was_disabled = _logger.disabled
    _logger.disabled = True
    try:
        drawing = read(io.StringIO(text))
        insunits = drawing.header.get("$INSUNITS", UNITLESS) if "$INSUNITS" in text else UNITLESS
        unit_m = _unit_m(path, insunits) if unit is None else UNITS_M[unit]
        pieces = _pieces(path, drawing, unit_m)
    except TrajectoryFileError:
        raise
    except DXFError as error:
        message = f"The drawing is damaged ({one_line(str(error))}); save it again as DXF."
        raise TrajectoryFileError(path, message) from None
    except Exception as error:
        # ezdxf raises arbitrary exceptions on a damaged drawing.
        name = type(error).__name__
        message = f"The drawing is damaged ({name}: {one_line(str(error))}); save it again as DXF."
        raise TrajectoryFileError(path, message) from None
    finally:
        _logger.disabled = was_disabled
    return replace(chained(path, pieces), unit_assumed=unit is None and insunits == UNITLESS)


def _ascii_dxf(path: Path, content: bytes) -> str:
    if content.startswith(b"AutoCAD Binary DXF"):
        raise TrajectoryFileError(path, "This is a binary DXF; save it as ASCII DXF.")
    if content.startswith(b"AC10"):
        raise TrajectoryFileError(
            path, "This is a DWG file despite its name; save it as ASCII DXF."
        )
    # Non-ASCII characters occur only in names and texts, which are not read.
    return content.decode("utf-8-sig", errors="replace").replace("\r\n", "\n")


def _unit_m(path: Path, insunits: int) -> float:
    """Return the length of the unit stated in a drawing [m]."""
    if insunits not in INSUNITS_M:
        known = ", ".join(map(str, INSUNITS_M))
        message = f"The unit {insunits!r} is not read here; set it to 4 (mm), or one of {known}."
        raise TrajectoryFileError(path, message, "$INSUNITS")
    return INSUNITS_M[insunits]


def _pieces(path: Path, drawing: Drawing, unit_m: float) -> list[Piece]:
    reader = EntityReader(path, unit_m)
    layers: dict[str, str] = {}
    pieces = []
    for entity in drawing.modelspace():
        if entity.dxftype() in _PASSED_OVER or not _is_on(drawing, entity.dxf.layer):
            continue
        layers.setdefault(entity.dxf.layer.lower(), entity.dxf.layer)
        pieces.append(reader.piece(entity))
    if not pieces:
        message = (
            "The model space holds no path on a layer that is on; "
            "draw one polyline, or lines and arcs that meet."
        )
        raise TrajectoryFileError(path, message)
    if len(layers) > 1:
        names = ", ".join(repr(name[:40]) for name in itertools.islice(layers.values(), MOST_NAMED))
        message = f"There are paths on the layers {names}; switch off all but the trajectory's."
        raise TrajectoryFileError(path, message)
    return pieces


def _is_on(drawing: Drawing, name: str) -> bool:
    if not drawing.layers.has_entry(name):
        return True
    layer = drawing.layers.get(name)
    return layer.is_on() and not layer.is_frozen()
