"""Tool trajectories from files: DXF drawings, CSV tables of vertices and G-code programs."""

from __future__ import annotations

import csv
import io
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

from skillplan.files.regular_file import CompanionFileError, read_companion
from skillplan_swarmitfix.trajectory.contours import Choice, FileContours
from skillplan_swarmitfix.trajectory.path import (
    TrajectoryFileError,
    TrajectoryPath,
    merged_note,
    one_line,
)
from skillplan_swarmitfix.trajectory.path_elements import (
    MOST_READ_M,
    SAME_POINT_M,
    Arc,
    Element,
    Line,
    Point2,
    Spline,
)
from skillplan_swarmitfix.trajectory.units import UNITS_M, UnitName

__all__ = [
    "MAX_BYTES",
    "SUFFIXES",
    "FileContours",
    "TrajectoryFileError",
    "TrajectoryPath",
    "read_contours",
    "read_trajectory",
]

MAX_BYTES = 8 * 1024 * 1024
"""Greatest size of a file."""

GCODE_SUFFIXES = (
    *(".nc", ".gcode", ".ngc", ".tap", ".cnc", ".gc", ".g", ".eia", ".iso", ".din"),
    *(".mpf", ".spf", ".h", ".i"),
)
SUFFIXES = (".dxf", ".csv", *GCODE_SUFFIXES)

_HEADERS = {"x_m,y_m": 1.0, "x_mm,y_mm": 1e-3}
_HEADER_WITHOUT_UNIT = "x,y"
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)


def read_trajectory(
    path: Path, unit: UnitName | None = None, *, layer: str | None = None, contour: Choice = None
) -> TrajectoryPath:
    """Return the tool trajectory that a file holds.

    Parameters
    ----------
    path, unit, layer
        As in `read_contours`.
    contour
        As in `FileContours.choose`; a point is in the file's coordinates [m].

    Raises
    ------
    TrajectoryFileError
        If the file cannot be read, or holds several contours and none is chosen.
    """
    return read_contours(path, unit, layer=layer).choose(contour)


def read_contours(
    path: Path, unit: UnitName | None = None, *, layer: str | None = None
) -> FileContours:
    """Return the contours that a file holds.

    A contour that ends within `JOIN_M` of its start is closed. Whether it leaves the bench is
    checked by `workpiece.faults`.

    Parameters
    ----------
    path
        The suffix selects the reader: ``.dxf`` `read_drawing`; ``.nc``, ``.gcode``, ``.ngc`` and
        others of `GCODE_SUFFIXES` `read_program`; ``.csv`` `read_table`.
    unit
        Unit of its lengths: for a drawing it overrides ``$INSUNITS``, for a program it holds until
        G20 or G21, for a table it needs the header ``x,y``. None for the unit of the file, or
        millimetres without one.
    layer
        Layer of a drawing that holds the trajectory; None for all that are on.

    Raises
    ------
    TrajectoryFileError
        If the file cannot be read, is larger than `MAX_BYTES`, or holds no path; with the line or
        the entity.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise TrajectoryFileError(
            path, f"The suffix gives the kind of file; use one of {', '.join(SUFFIXES)}."
        )
    content = _content(path)
    if suffix == ".dxf":
        # Takes ezdxf, which takes half a second to import.
        from skillplan_swarmitfix.trajectory.dxf_entities import read_drawing

        return read_drawing(path, content, unit, layer)
    if layer is not None:
        raise TrajectoryFileError(path, "Only drawings have layers; leave trajectory.layer out.")
    if suffix == ".csv":
        return FileContours(path, (read_table(path, _text(path, content), unit),))
    from skillplan_swarmitfix.trajectory.gcode import read_program

    # Comments may be in any encoding, and code is ASCII.
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    return read_program(path, text, unit)


def read_table(path: Path, text: str, unit: UnitName | None = None) -> TrajectoryPath:
    """Return the trajectory whose vertices a table holds.

    Parameters
    ----------
    path
        The table's file, for messages.
    text
        The header ``x_m,y_m`` or ``x_mm,y_mm``, or ``x,y`` where `unit` is given, and then rows
        of two numbers. Empty rows are passed over. A last row equal to the first closes the
        trajectory.
    unit
        Unit of the numbers under the header ``x,y``.

    Raises
    ------
    TrajectoryFileError
        With the line that cannot be read, or if there are fewer than two vertices.
    """
    rows = csv.reader(io.StringIO(text, newline=""), strict=True)
    unit_m: float | None = None
    vertices: list[Point2] = []
    places: list[str] = []
    try:
        for row in rows:
            place = f"line {rows.line_num}"
            cells = [cell.strip() for cell in row]
            if not any(cells):
                continue
            if unit_m is None:
                unit_m = _unit_of_header(path, ",".join(cells), place, unit)
                continue
            if len(cells) != 2:
                raise TrajectoryFileError(
                    path,
                    f"The row has {len(cells)} cells instead of 2; write x,y with a decimal point "
                    "and a comma between them.",
                    place,
                )
            x, y = (_number(path, cell, place) * unit_m for cell in cells)
            vertices.append((x, y))
            places.append(place)
    except csv.Error as error:
        message = f"The table is damaged ({error}); write x,y without quotes."
        raise TrajectoryFileError(path, message, f"line {rows.line_num}") from None
    if len(vertices) < 2:
        raise TrajectoryFileError(
            path,
            f"The table has {len(vertices)} vertices; give the header x_m,y_m or x_mm,y_mm and "
            "two rows or more.",
        )
    elements: list[Element] = []
    kept: list[str] = []
    here = vertices[0]
    for vertex, place in zip(vertices[1:], places[1:], strict=True):
        if math.dist(here, vertex) > SAME_POINT_M:
            elements.append(Line(vertex))
            kept.append(place)
            here = vertex
    if not elements:
        raise TrajectoryFileError(path, "All vertices of the table are one point; give others.")
    merged = len(vertices) - 1 - len(elements)
    note = (merged_note(merged),) if merged else ()
    table = TrajectoryPath.ended(vertices[0], elements, kept, places[0])
    return replace(table, notes=note)


def _unit_of_header(path: Path, header: str, place: str, unit: UnitName | None) -> float:
    """Return the length of a table's unit [m], from its header or the task file."""
    shown = one_line(header, 40)
    if header == _HEADER_WITHOUT_UNIT and unit is not None:
        return UNITS_M[unit]
    if header == _HEADER_WITHOUT_UNIT:
        message = f"The header {shown!r} has no unit; write x_m,y_m or x_mm,y_mm, or give 'unit'."
        raise TrajectoryFileError(path, message, place)
    if header not in _HEADERS:
        message = f"The header is {shown!r}; write x_m,y_m or x_mm,y_mm."
        raise TrajectoryFileError(path, message, place)
    if unit is not None:
        message = f"The header {shown!r} has a unit; leave 'unit' out, or write x,y."
        raise TrajectoryFileError(path, message, place)
    return _HEADERS[header]


def _number(path: Path, cell: str, place: str) -> float:
    value = float(cell) if _NUMBER.fullmatch(cell) else math.nan
    if not abs(value) <= MOST_READ_M:
        message = (
            f"{one_line(cell, 40)!r} is not a coordinate; write a number such as 0.34, "
            f"within {MOST_READ_M:g}."
        )
        raise TrajectoryFileError(path, message, place)
    return value


def _content(path: Path) -> bytes:
    try:
        return read_companion(path, MAX_BYTES, "trajectory")
    except CompanionFileError as error:
        raise TrajectoryFileError(path, str(error)) from None


def _text(path: Path, content: bytes) -> str:
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        message = f"The byte 0x{content[error.start]:02x} is not UTF-8 text; save it as UTF-8."
        raise TrajectoryFileError(path, message, f"line {line}") from None


# Cosine and sine of quarter turns, which are exact.
_QUARTERS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))


FAR_M = 1000.0
"""A drawing that is farther from its origin has coordinates of a map [m]; `offset_m` ends here."""


def placed(contours: FileContours, offset_m: Point2, rotate_deg: float) -> FileContours:
    """Return contours turned anticlockwise about the origin [deg] and then moved [m].

    The origin of a drawing that lies beyond `FAR_M` from its own is its lower left corner, with a
    note.
    """
    cosine, sine = _turn(rotate_deg)
    x0_m, y0_m, x1_m, y1_m = contours.box_m
    if max(x0_m, -x1_m, y0_m, -y1_m) > FAR_M:
        note = (
            f"the origin lies over {FAR_M:.0f} m away; instead the lower left corner is taken, "
            f"[{x0_m:.3f}, {y0_m:.3f}] m"
        )
        contours = replace(contours, notes=(*contours.notes, note))
    else:
        x0_m = y0_m = 0.0

    def on_bench(point: Point2) -> Point2:
        x_m, y_m = point[0] - x0_m, point[1] - y0_m
        return (cosine * x_m - sine * y_m + offset_m[0], sine * x_m + cosine * y_m + offset_m[1])

    def element_on_bench(element: Element) -> Element:
        match element:
            case Line():
                return Line(on_bench(element.end))
            case Arc():
                return Arc(on_bench(element.end), on_bench(element.through))
            case Spline():
                return Spline(tuple(on_bench(point) for point in element.through))

    def path_on_bench(path: TrajectoryPath) -> TrajectoryPath:
        return replace(
            path,
            start=on_bench(path.start),
            elements=tuple(element_on_bench(element) for element in path.elements),
        )

    return contours.moved(path_on_bench, on_bench)


def _turn(angle_deg: float) -> tuple[float, float]:
    quarters, rest_deg = divmod(angle_deg, 90.0)
    if rest_deg == 0.0:
        return _QUARTERS[int(quarters) % 4]
    return math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))


def content_of(path: TrajectoryPath) -> dict[str, Any]:
    """Return a trajectory read from a file as the keys that would describe it."""
    return {
        "closed": path.closed,
        "start_m": list(path.start),
        "path": [_entry(element) for element in path.elements],
    }


def _entry(element: Element) -> dict[str, Any]:
    if isinstance(element, Line):
        return {"line_to_m": list(element.end)}
    if isinstance(element, Arc):
        return {"arc_to_m": list(element.end), "through_m": list(element.through)}
    return {"spline_through_m": [list(value) for value in element.through]}
