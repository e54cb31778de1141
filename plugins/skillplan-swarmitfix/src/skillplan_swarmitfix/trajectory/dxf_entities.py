"""The contours of a DXF drawing: its entities as pieces of paths, in metres."""

from __future__ import annotations

import io
import itertools
import logging
import math
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from ezdxf import recover
from ezdxf.document import Drawing
from ezdxf.entities.arc import Arc as ArcEntity
from ezdxf.entities.circle import Circle
from ezdxf.entities.dxfgfx import DXFGraphic
from ezdxf.entities.ellipse import Ellipse
from ezdxf.entities.insert import Insert
from ezdxf.entities.line import Line as LineEntity
from ezdxf.entities.lwpolyline import LWPolyline
from ezdxf.entities.mline import MLine
from ezdxf.entities.polyline import Polyline
from ezdxf.entities.spline import Spline as SplineEntity
from ezdxf.filemanagement import read
from ezdxf.lldxf.const import DXFError
from ezdxf.lldxf.tagger import binary_tags_loader
from ezdxf.math import BSpline, Vec3

from skillplan_swarmitfix.trajectory.contours import FileContours
from skillplan_swarmitfix.trajectory.path import (
    Progress,
    TrajectoryFileError,
    TrajectoryPath,
    count,
    merged_note,
    millimetres,
    one_line,
)
from skillplan_swarmitfix.trajectory.path_chain import Piece, join_pieces
from skillplan_swarmitfix.trajectory.path_elements import (
    FLAT_RAD,
    MAX_CHORDS,
    MOST_READ_M,
    SAME_POINT_M,
    Element,
    Line,
    Point2,
    Spline,
    arc_or_line,
)
from skillplan_swarmitfix.trajectory.units import DEFAULT_UNIT, UNITS_M, UnitName
from skillplan_swarmitfix.trajectory.workpiece import CORNER_RAD

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
_LEVEL = 1e-9
_MOST_SPLITS = 50_000


class _PassedOver(Exception):
    """An entity that belongs to no contour; the reason in a word or two."""


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
        self.heights_m: set[float] = set()
        self.merged = 0
        self.fitted = 0
        self._widths: list[float] = []

    def piece(self, entity: DXFGraphic) -> Piece:
        """Return the elements of one entity.

        Raises
        ------
        TrajectoryFileError
            If it has a measure that no path can have.
        _PassedOver
            If it is of no kind that draws a path, or not parallel to the XY plane.
        """
        self._name = f"{one_line(entity.dxftype(), 40)} #{entity.dxf.handle}"
        for attribute in _NEEDED.get(entity.dxftype(), ()):
            if not entity.dxf.hasattr(attribute):
                raise self._fault(f"It lacks its {attribute}; draw it again.")
        match entity:
            case LineEntity():
                start, end = self._points([entity.dxf.start, entity.dxf.end])
                if math.dist(start, end) <= SAME_POINT_M:
                    raise _PassedOver("LINE of no length")
                return self._row(start, [Line(end)])
            case ArcEntity() | Circle():
                return self._circular(entity)
            case LWPolyline():
                sense = self._sense(entity)
                widths = (max(pair) for pair in entity.get_points("se"))
                self._widths.append(max(widths, default=0.0) or entity.dxf.get("const_width", 0.0))
                return self._bulged(
                    list(entity.vertices_in_wcs()),
                    [sense * float(bulge) for (bulge,) in entity.get_points("b")],
                    closed=entity.closed,
                )
            case Polyline() if not entity.dxf.flags & _MESH_FLAGS:
                sense = self._sense(entity)
                keys = ("start_width", "end_width")
                widths = (vertex.dxf.get(key, 0.0) for vertex in entity.vertices for key in keys)
                default = max(entity.dxf.get(f"default_{key}", 0.0) for key in keys)
                self._widths.append(max(*widths, default))
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
                raise _PassedOver(one_line(entity.dxftype(), 40))

    def list_notes(self) -> list[str]:
        """Return notes about everything that was read with a loss, a clause each."""
        notes = []
        if self.merged:
            notes.append(merged_note(self.merged))
        wide = [width for width in self._widths if width * self._unit_m > SAME_POINT_M]
        if wide:
            most = millimetres(max(wide) * self._unit_m)
            which = "its centre line is" if len(wide) == 1 else "their centre lines are"
            notes.append(f"{count(len(wide), 'polyline')} up to {most} mm wide: {which} read")
        if self.fitted:
            notes.append(
                f"{count(self.fitted, 'spline')} without control points: a cubic through the fit "
                "points is read, from which the CAD's own curve may differ"
            )
        if len(self.heights_m) > 1:
            notes.append(
                f"drawn at z from {millimetres(min(self.heights_m))} to "
                f"{millimetres(max(self.heights_m))} mm, flattened"
            )
        return notes

    def _circular(self, entity: Circle) -> Piece:
        self._sense(entity)
        centre, radius = Vec3(entity.dxf.center), float(entity.dxf.radius)
        if not radius * self._unit_m > SAME_POINT_M:
            raise _PassedOver(f"{entity.dxftype()} of radius {radius:g}")
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
            raise _PassedOver("polyline of 1 vertex" if points else "polyline without vertices")
        if closed and math.dist(points[0], points[-1]) > SAME_POINT_M:
            points.append(points[0])
        elements: list[Element] = []
        numbers: list[int] = []
        (ax, ay) = points[0]
        for number, ((bx, by), bulge) in enumerate(zip(points[1:], bulges, strict=False), 1):
            if not abs(bulge) <= _MOST_BULGE:
                raise self._fault(
                    f"It has a bulge of {bulge:g}; give an arc of less than a full turn."
                )
            top = ((ax + bx + bulge * (by - ay)) / 2, (ay + by - bulge * (bx - ax)) / 2)
            if math.dist((ax, ay), (bx, by)) <= SAME_POINT_M:
                self.merged += 1
                continue
            elements.append(arc_or_line((ax, ay), (bx, by), top) if bulge else Line((bx, by)))
            numbers.append(number)
            ax, ay = bx, by
        if not elements:
            raise _PassedOver("polyline of no length")
        places = [f"{self._name}, vertex {i % len(corners) + 1}" for i in numbers]
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
            self.fitted += not len(entity.control_points)
            curve = entity.construction_tool()
            tolerance = CURVE_TOLERANCE_M / self._unit_m
            drawn = (
                curve.flattening(tolerance, segments=4)
                if curve.is_clamped
                else _within_domain(curve, tolerance)
            )
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
        if len(points) < 2:
            raise _PassedOver(f"{entity.dxftype()} of no length")
        return self._row(points[0], list(_smooth_runs(points)))

    def _sense(self, entity: DXFGraphic) -> float:
        """Return 1 or, for an entity that is drawn as seen from below, -1."""
        up = Vec3(entity.dxf.extrusion).normalize()
        if not math.hypot(up.x, up.y) <= _LEVEL:
            raise _PassedOver(f"tilted {entity.dxftype()}")
        return math.copysign(1.0, up.z)

    def _points(self, corners: Iterable[Vec3]) -> list[Point2]:
        """Return the points in metres, all of which have to be at one height."""
        points = []
        height_m: float | None = None
        for corner in corners:
            x, y, z = (coordinate * self._unit_m for coordinate in corner)
            if not (abs(x) <= MOST_READ_M and abs(y) <= MOST_READ_M):
                raise self._fault(f"It leaves every bench; keep within {MOST_READ_M:g} m.")
            height_m = z if height_m is None else height_m
            if not abs(z - height_m) <= SAME_POINT_M:
                raise _PassedOver(f"{self._name.split()[0]} that leaves its plane")
            points.append((x, y))
        if height_m is not None:
            self.heights_m.add(round(height_m, 6))
        return points

    def _row(self, start: Point2, elements: Sequence[Element]) -> Piece:
        return Piece(self._name, start, tuple(elements), (self._name,) * len(elements))

    def _fault(self, message: str) -> TrajectoryFileError:
        return TrajectoryFileError(self._path, message, self._name)


def _smooth_runs(points: Sequence[Point2]) -> Iterator[Element]:
    """Yield a spline from corner to corner, or a line where the points are in a row."""
    begin = 0
    for i in range(1, len(points)):
        if i < len(points) - 1 and _bend(*points[i - 1 : i + 2]) <= CORNER_RAD:
            continue
        run = points[begin : i + 1]
        straight = all(_bend(*run[j : j + 3]) <= FLAT_RAD for j in range(len(run) - 2))
        yield Line(run[-1]) if straight else Spline(tuple(run[1:]))
        begin = i


def _bend(a: Point2, b: Point2, c: Point2) -> float:
    before = math.atan2(b[1] - a[1], b[0] - a[0])
    return abs(math.remainder(math.atan2(c[1] - b[1], c[0] - b[0]) - before, math.tau))


def _within_domain(curve: BSpline, tolerance: float) -> Iterator[Vec3]:
    """Yield points of a spline whose knots are not clamped, over its domain only.

    The domain lies between the knots number ``degree`` and, from the end, ``degree``; beyond it
    ezdxf would go on to the origin.
    """
    knots = curve.knots()
    degree = curve.order - 1
    inner = sorted(set(knots[degree : len(knots) - degree]))
    stack = [inner[-1]]
    begin, point = inner[0], curve.point(inner[0])
    yield point
    stack = [
        low + (high - low) * step / 4
        for low, high in itertools.pairwise(inner)
        for step in (1, 2, 3, 4)
    ][::-1]
    while stack:
        end = stack[-1]
        middle, last = curve.point((begin + end) / 2), curve.point(end)
        if len(stack) < _MOST_SPLITS and middle.distance(point.lerp(last)) > tolerance:
            stack.append((begin + end) / 2)
            continue
        yield middle
        yield last
        begin, point = stack.pop(), last


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

_ENGLISH, _FEET_AND_INCHES = 0, (3, 4)
"""A value of $MEASUREMENT, and values of $LUNITS: engineering and architectural."""

_WITHOUT_NOTE = frozenset(("VIEWPORT", "ATTDEF", "ATTRIB"))
_MADE_OF_OTHERS = frozenset(("INSERT", "MLINE"))
_UNPLOTTED = "defpoints"
_logger = logging.getLogger("ezdxf")

MOST_ENTITIES = 100_000
"""Most entities of a drawing, its blocks exploded."""
MOST_NESTED = 16
"""Blocks within blocks are exploded so deep."""
_MOST_KINDS = 8
_LARGE_B = 2_000_000


def read_drawing(
    path: Path, content: bytes, unit: UnitName | None = None, layer: str | None = None
) -> FileContours:
    """Return the contours of a drawing's model space.

    Blocks are exploded. Layers that are off, frozen or not plotted are passed over, and so are
    entities that draw no path, with a note.

    Parameters
    ----------
    path
        The drawing's file, for messages.
    content
        The file's bytes.
    unit
        Unit of its lengths, overriding its own; None for its own.
    layer
        Name of the layer that holds the trajectory; None for all.

    Raises
    ------
    TrajectoryFileError
        If the drawing cannot be read or holds no path; with the entity's kind and handle where one
        is at fault.
    """
    was_disabled = _logger.disabled
    _logger.disabled = True
    try:
        drawing, notes = _load(path, content)
        unit_m, assumed, unit_notes = _unit(path, drawing, content, unit)
        return _contours(path, drawing, unit_m, layer, [*notes, *unit_notes], assumed=assumed)
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


def _load(path: Path, content: bytes) -> tuple[Drawing, list[str]]:
    """Return the drawing, and a note if it had to be mended."""
    if len(content) > _LARGE_B:
        # ezdxf reports nothing while it reads.
        megabytes = len(content) / 1e6
        sys.stderr.write(f"skillplan: reading {one_line(path.name, 60)}, {megabytes:.1f} MB\n")
    if content.startswith(b"AC10"):
        raise TrajectoryFileError(
            path, "This is a DWG file despite its name; save it as ASCII DXF."
        )
    if content.startswith(b"AutoCAD Binary DXF"):
        return Drawing.load(binary_tags_loader(content, errors="ignore")), []
    # Names of layers matter, texts do not: an encoding before R2007 is a guess.
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("cp1252", errors="replace")
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    try:
        return read(io.StringIO(text)), []
    except DXFError:
        drawing, _ = recover.read(io.BytesIO(content))
        if not len(drawing.modelspace()):
            raise
        return drawing, ["the drawing is damaged; this is what could be recovered"]


def _unit(
    path: Path, drawing: Drawing, content: bytes, unit: UnitName | None
) -> tuple[float, bool, list[str]]:
    """Return the length of a drawing's unit [m], whether it is a guess, and notes."""
    if unit is not None:
        return UNITS_M[unit], False, []
    header = drawing.header
    insunits = header.get("$INSUNITS", UNITLESS) if b"$INSUNITS" in content else UNITLESS
    if insunits != UNITLESS:
        return _unit_m(path, insunits), False, []
    if b"$LUNITS" in content and header.get("$LUNITS") in _FEET_AND_INCHES:
        note = "the unit is taken to be inches, as the drawing shows lengths in feet and inches"
        return UNITS_M["in"], False, [note]
    if b"$MEASUREMENT" in content and header.get("$MEASUREMENT") == _ENGLISH:
        note = (
            "the drawing has no unit and English settings; it is read in millimetres; give "
            "trajectory.unit: in if it is in inches"
        )
        return UNITS_M[DEFAULT_UNIT], True, [note]
    return UNITS_M[DEFAULT_UNIT], True, []


def _unit_m(path: Path, insunits: int) -> float:
    """Return the length of the unit stated in a drawing [m]."""
    if insunits not in INSUNITS_M:
        known = ", ".join(map(str, INSUNITS_M))
        message = f"The unit {insunits!r} is not read here; set it to 4 (mm), or one of {known}."
        raise TrajectoryFileError(path, message, "$INSUNITS")
    return INSUNITS_M[insunits]


def _contours(
    path: Path,
    drawing: Drawing,
    unit_m: float,
    layer: str | None,
    notes: list[str],
    *,
    assumed: bool,
) -> FileContours:
    reader = EntityReader(path, unit_m)
    expander = _Expander(path, drawing)
    progress = Progress(path)
    space = drawing.modelspace()
    passed_over: Counter[str] = Counter()
    pieces: dict[str, list[Piece]] = {}
    names: dict[str, str] = {}
    for number, (entity, name) in enumerate(expander.entities(space)):
        progress.report(number, max(len(space), number), "entity")
        names.setdefault(name.lower(), name)
        if layer is not None and name.lower() != layer.lower():
            continue
        try:
            piece = reader.piece(entity)
        except _PassedOver as reason:
            passed_over[str(reason)] += 1
        except TrajectoryFileError:
            raise
        except (ArithmeticError, ValueError, DXFError):
            # ezdxf cannot evaluate it, such as a spline with too few knots.
            passed_over[f"damaged {one_line(entity.dxftype(), 40)} #{entity.dxf.handle}"] += 1
        else:
            pieces.setdefault(name.lower(), []).append(piece)
    if layer is not None and layer.lower() not in names:
        listed = ", ".join(repr(one_line(name, 40)) for name in list(names.values())[:_MOST_KINDS])
        message = f"No layer {one_line(layer, 40)!r} is drawn on; give one of {listed}."
        raise TrajectoryFileError(path, message)
    passed_over.update(expander.passed_over)
    for kind in _WITHOUT_NOTE:
        del passed_over[kind]
    if passed_over:
        kinds = ", ".join(
            f"{number} {kind}" for kind, number in passed_over.most_common(_MOST_KINDS)
        )
        more = len(passed_over) - _MOST_KINDS
        notes.append(f"passed over: {kinds}" + (f" and {more} more kinds" if more > 0 else ""))
    if expander.hidden:
        hidden = count(expander.hidden, "entity").replace("entitys", "entities")
        notes.append(f"passed over: {hidden} on layers that are off, frozen or not plotted")
    if not pieces:
        where = "a layer that is on" if layer is None else f"the layer {one_line(layer, 40)!r}"
        reasons = f" ({'; '.join(notes)})" if notes else ""
        message = (
            f"The model space holds no path on {where}{reasons}; "
            "draw one polyline, or lines and arcs that meet."
        )
        raise TrajectoryFileError(path, message)
    notes += reader.list_notes()
    if expander.exploded:
        notes.append(f"{count(expander.exploded, 'block')} exploded")
    contours: list[TrajectoryPath] = []
    for key, parts in pieces.items():
        joined, mended = join_pieces(parts)
        contours += [replace(contour, layer=names[key]) for contour in joined]
        notes += mended
    return FileContours(path, tuple(contours), tuple(notes), unit_assumed=assumed)


class _Expander:
    """Lists the entities of a drawing and of its blocks, and the layer of each.

    Parameters
    ----------
    path, drawing
        The drawing and its file, for messages.
    """

    def __init__(self, path: Path, drawing: Drawing) -> None:
        self._path = path
        self._drawing = drawing
        self._left = MOST_ENTITIES
        self._on: dict[str, bool] = {}
        self.exploded = 0
        self.hidden = 0
        self.passed_over: Counter[str] = Counter()

    def entities(
        self, entities: Iterable[DXFGraphic], layer: str = "0", depth: int = 0
    ) -> Iterator[tuple[DXFGraphic, str]]:
        """Yield entities on layers that are drawn; entities of layer 0 take that of their block."""
        for entity in entities:
            name = entity.dxf.layer
            name = layer if depth and name == "0" else name
            if not self._is_drawn(name):
                self.hidden += 1
                continue
            self._left -= 1
            if self._left < 0:
                message = f"It holds more than {MOST_ENTITIES:,} entities; draw less in one file."
                raise TrajectoryFileError(self._path, message)
            if entity.dxftype() in _MADE_OF_OTHERS:
                yield from self._exploded(entity, name, depth)
            else:
                yield entity, name

    def _exploded(
        self, entity: DXFGraphic, layer: str, depth: int
    ) -> Iterator[tuple[DXFGraphic, str]]:
        place = f"{one_line(entity.dxftype(), 40)} #{entity.dxf.handle}"
        if depth >= MOST_NESTED:
            message = f"Its blocks are nested more than {MOST_NESTED} deep; explode them."
            raise TrajectoryFileError(self._path, message, place)
        copies = [entity]
        if isinstance(entity, Insert):
            block = entity.block()
            if block is None:
                self.passed_over["INSERT without its block"] += 1
                return
            if not (entity.dxf.xscale and entity.dxf.yscale):
                self.passed_over["INSERT of scale 0"] += 1
                return
            # Some programs write 0, which does not matter in plan.
            entity.dxf.zscale = entity.dxf.zscale or 1.0
            if entity.mcount > 1:
                if entity.mcount * max(1, len(block)) > self._left:
                    message = (
                        f"It repeats its block {entity.mcount:,} times, which is more than "
                        f"{MOST_ENTITIES:,} entities; draw less in one file."
                    )
                    raise TrajectoryFileError(self._path, message, place)
                copies = list(entity.multi_insert())
        self.exploded += len(copies)
        for copy in copies:
            yield from self.entities(self._parts(copy), layer, depth + 1)

    def _parts(self, entity: DXFGraphic) -> Iterator[DXFGraphic]:
        def skip(part: DXFGraphic, _: str) -> None:
            self.passed_over[one_line(part.dxftype(), 40)] += 1

        if isinstance(entity, Insert):
            yield from entity.virtual_entities(skipped_entity_callback=skip)
        elif isinstance(entity, MLine):
            yield from entity.virtual_entities()

    def _is_drawn(self, name: str) -> bool:
        key = name.lower()
        if key not in self._on:
            drawn = key != _UNPLOTTED
            if drawn and self._drawing.layers.has_entry(name):
                layer = self._drawing.layers.get(name)
                drawn = layer.is_on() and not layer.is_frozen() and layer.dxf.get("plot", 1) != 0
            self._on[key] = drawn
        return self._on[key]
