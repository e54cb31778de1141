"""The tool trajectory of a DXF drawing.

It is a LWPOLYLINE or a POLYLINE, whose bulges are arcs; a CIRCLE; or LINEs, ARCs,
ELLIPSEs, SPLINEs and open polylines in the model space that meet end to end, in any order. They
lie on one layer that is on, in one plane parallel to XY. Texts, dimensions and points are passed
over; any other entity is refused by its handle.

The drawing's unit is what the task file says, else its header variable $INSUNITS, and
millimetres where that is missing or unitless. A SPLINE or an ELLIPSE becomes a `Spline` through
points on it, as dense as `dxf_entities.CURVE_TOLERANCE_M` says. The file is read as it stands: one
that ezdxf would have to repair is refused, for a repair may lose a part of the trajectory.
"""

from __future__ import annotations

import io
import itertools
import logging
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ezdxf.filemanagement import read
from ezdxf.lldxf.const import DXFError

from skillplan_swarmitfix.trajectory.dxf_entities import EntityReader
from skillplan_swarmitfix.trajectory.path import (
    TrajectoryFileError,
    TrajectoryPath,
    one_line,
)
from skillplan_swarmitfix.trajectory.path_chain import MOST_NAMED, Piece, chained
from skillplan_swarmitfix.trajectory.units import DEFAULT_UNIT, UNITS_M, UnitName

if TYPE_CHECKING:
    from ezdxf.document import Drawing

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
        What its lengths are in, whatever it says itself; None for what it says.

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
        # Of a damaged drawing ezdxf raises whatever the damage leads to.
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
        raise TrajectoryFileError(path, "This is a DWG, whatever its name; save it as ASCII DXF.")
    # What is not ASCII is in names and texts only, which do not matter here.
    return content.decode("utf-8-sig", errors="replace").replace("\r\n", "\n")


def _unit_m(path: Path, insunits: int) -> float:
    """Return the length of the unit that a drawing says itself [m]."""
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
